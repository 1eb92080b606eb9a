/* What clients ask for, and what everybody asks about blobs. */
#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "common/base/clock.h"
#include "common/base/file.h"
#include "common/base/log.h"
#include "common/base/memory.h"
#include "common/scene/manifest.h"
#include "common/scene/scene.h"
#include "coordinator/farm/extend.h"
#include "coordinator/farm/closing.h"
#include "coordinator/farm/report.h"
#include "coordinator/net/server.h"
#include "coordinator/net/session_tasks.h"
#include "coordinator/net/session.h"
#include "coordinator/job/wire.h"
#include "protocol/message.h"

enum {
    JOB_LIST_MAX = 1000,        /* jobs in one list: below 3 MiB, whatever their names and texts */
    MISSING_NAMED_MAX = 4,      /* digests named in a failure */
};

static void reply(struct session *session, Azulejo__Wire__Envelope *envelope, uint64_t request)
{
    envelope->request = request;
    if (session->state == SESSION_OPEN && channel_send(session->channel, envelope) != STATUS_OK)
        log_debug("session %u: %s was not sent", session->id, message_name(envelope));
}

/* ---- job lists ------------------------------------------------------------------------------ */

/* The newest jobs that the query lets through, at most JOB_LIST_MAX, in ascending order; how many
 * older ones it would let through goes to *older. */
static size_t select_jobs(const struct queue *queue, const Azulejo__Wire__JobQuery *query,
                          struct job *out[JOB_LIST_MAX], uint64_t *older)
{
    size_t count = 0;

    *older = 0;
    for (size_t i = queue->count; i-- > 0;) {
        struct job *job = queue->all[i];
        int ended = job_state_ended(job->state);

        if ((query->before && job->id >= query->before) ||
            (query->filter == AZULEJO__WIRE__JOB_FILTER__JOBS_ACTIVE && ended) ||
            (query->filter == AZULEJO__WIRE__JOB_FILTER__JOBS_ENDED && !ended))
            continue;
        if (count < JOB_LIST_MAX)
            out[JOB_LIST_MAX - ++count] = job;
        else
            ++*older;
    }
    memmove(out, out + JOB_LIST_MAX - count, count * sizeof *out);
    return count;
}

static void send_list(struct session *session, uint64_t request, struct job *const *jobs,
                      size_t count, uint64_t older, uint64_t now_ns)
{
    struct job_report *reports = mem_alloc_array(count, sizeof *reports);
    Azulejo__Wire__JobInfo **pointers = mem_alloc_array(count, sizeof(Azulejo__Wire__JobInfo *));
    Azulejo__Wire__JobList list = AZULEJO__WIRE__JOB_LIST__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(JOB_LIST, job_list, &list);
    struct error err = {0};

    if (!reports || !pointers) {
        error_no_memory(&err, "a list of jobs");
        session_fail(session, request, &err);
    } else {
        for (size_t i = 0; i < count; i++) {
            job_report_make(&reports[i], &session->server->farm, jobs[i], now_ns);
            pointers[i] = &reports[i].message;
        }
        list.n_jobs = count;
        list.jobs = pointers;
        list.older = older;
        reply(session, &envelope, request);
    }
    mem_free(pointers);
    mem_free(reports);
}

/* Send the job, or with NULL those that the query lets through (NULL: any). */
static void send_jobs(struct session *session, uint64_t request, struct job *only,
                      const Azulejo__Wire__JobQuery *query, uint64_t now_ns)
{
    static const Azulejo__Wire__JobQuery any = AZULEJO__WIRE__JOB_QUERY__INIT;
    struct job *jobs[JOB_LIST_MAX];
    uint64_t older = 0;
    size_t count;

    if (only) {
        send_list(session, request, &only, 1, 0, now_ns);
        return;
    }
    count = select_jobs(&session->server->farm.queue, query ? query : &any, jobs, &older);
    send_list(session, request, jobs, count, older, now_ns);
}

/* The job, or a Failure and NULL. */
static struct job *find_job(struct session *session, uint64_t id, uint64_t request)
{
    struct job *job = queue_find(&session->server->farm.queue, id);
    struct error err = {0};

    if (!job) {
        error_set(&err, STATUS_ERR_NOT_FOUND, "there is no job %" PRIu64, id);
        session_fail(session, request, &err);
    }
    return job;
}

static void answer_query(struct session *session, const Azulejo__Wire__JobQuery *query,
                         uint64_t request, uint64_t now_ns)
{
    struct job *job = NULL;

    if (query->job != 0 && !(job = find_job(session, query->job, request)))
        return;
    send_jobs(session, request, job, query, now_ns);
}

static void begin_watch(struct session *session, const Azulejo__Wire__JobWatch *message,
                        uint64_t request, uint64_t now_ns)
{
    struct error err = {0};
    struct watch *watch;

    if (message->job != 0 && !find_job(session, message->job, request))
        return;
    if (session->watch_count == SESSION_WATCHES_MAX) {
        error_set(&err, STATUS_ERR_LIMIT, "a connection may watch %d things at once",
                  SESSION_WATCHES_MAX);
        session_fail(session, request, &err);
        return;
    }
    watch = &session->watches[session->watch_count++];
    memset(watch, 0, sizeof *watch);
    watch->request = request;
    watch->job = message->job;
    watch->interval_ms = message->interval_ms;
    if (watch->interval_ms < WATCH_INTERVAL_MIN_MS)
        watch->interval_ms = WATCH_INTERVAL_MIN_MS;
    if (watch->interval_ms > WATCH_INTERVAL_MAX_MS)
        watch->interval_ms = WATCH_INTERVAL_MAX_MS;
    watch->due = 1;
    session_watches_send(session, now_ns, 1);
}

void session_watches_send(struct session *session, uint64_t now_ns, int only_due)
{
    uint32_t kept = 0;

    for (uint32_t i = 0; i < session->watch_count; i++) {
        struct watch *watch = &session->watches[i];
        struct job *job = watch->job ? queue_find(&session->server->farm.queue, watch->job) : NULL;
        int timely = now_ns - watch->sent_ns >= watch->interval_ms * NS_PER_MS;
        /* A peer that does not read gets no more until it does. */
        int blocked = channel_queued_bytes(session->channel) > CHANNEL_QUEUE_HIGH;

        if (!blocked && (watch->due || (!only_due && timely))) {
            watch->due = 0;
            watch->sent_ns = now_ns;
            send_jobs(session, watch->request, job, NULL, now_ns);
            if (job && job_state_ended(job->state))
                continue;
        }
        session->watches[kept++] = *watch;
    }
    session->watch_count = kept;
}

/* ---- submitting ----------------------------------------------------------------------------- */

/* Are all blobs of the scene there, in the sizes that it says? */
static status check_blobs(const char *folder, const struct scene *scene, struct error *err)
{
    struct scene_blob *blobs = NULL;
    char named[MISSING_NAMED_MAX * 20] = "";
    size_t count = 0, missing = 0;
    status s = scene_blobs(scene, &blobs, &count, err);

    for (size_t i = 0; s == STATUS_OK && i < count; i++) {
        char hex[DIGEST_HEX_SIZE];
        uint64_t size;
        int found = blobs_find(folder, &blobs[i].digest, &size);
        if (found < 0) {
            s = error_set(err, STATUS_ERR_IO, "the coordinator cannot look for the scene's blobs: %s",
                          strerror(errno));
            continue;
        }
        if (found) {
            if (size != blobs[i].size_bytes)
                s = error_set(err, STATUS_ERR_INPUT,
                              "the scene says that a blob has %" PRIu64
                              " bytes, but it has %" PRIu64,
                              blobs[i].size_bytes, size);
            continue;
        }
        digest_to_hex(&blobs[i].digest, hex);
        if (missing++ < MISSING_NAMED_MAX)
            snprintf(named + strlen(named), sizeof named - strlen(named), " %.12s", hex);
    }
    if (s == STATUS_OK && missing > 0)
        s = error_set(
            err, STATUS_ERR_NOT_FOUND,
            "%zu of the scene's %zu blobs are not on the coordinator:%s%s; send them first",
            missing, count, named, missing > MISSING_NAMED_MAX ? " ..." : "");
    mem_free(blobs);
    return s;
}

/* Is the file of the tone mapping there? */
static status check_tonemap_file(const char *folder, const struct output_settings *output,
                                 struct error *err)
{
    uint64_t size;

    if (!output->tonemap.has_file || blobs_find(folder, &output->tonemap.file, &size))
        return STATUS_OK;
    return error_set(err, STATUS_ERR_NOT_FOUND,
                     "the file %s of the tone mapping is not on the coordinator; send it first",
                     output->tonemap.file_name);
}

static status make_job(const char *folder, const Azulejo__Wire__JobSubmit *message,
                       struct job **out, struct error *err)
{
    struct buffer packed = BUFFER_INIT;
    struct digest digest;
    struct scene scene;
    status s = wire_digest_get(&digest, &message->scene, "the scene", err);

    scene_init(&scene);
    if (s == STATUS_OK) {
        s = blobs_read(folder, &digest, SCENE_BYTES_MAX, &packed, err);
        if (s != STATUS_OK)
            error_prefix(err, "the scene");
    }
    if (s == STATUS_OK)
        s = scene_unpack(&scene, packed.data, packed.size, err);
    if (s == STATUS_OK)
        s = check_blobs(folder, &scene, err);
    if (s == STATUS_OK)
        s = wire_job_get(out, message, scene.camera_count, err);
    if (s == STATUS_OK) {
        s = check_tonemap_file(folder, &(*out)->output, err);
        if (s != STATUS_OK) {
            job_free(*out);
            *out = NULL;
        }
    }
    if (s == STATUS_OK) {
        message_text((*out)->scene_name, sizeof (*out)->scene_name, scene.name ? scene.name : "");
        if (!(*out)->name[0])
            snprintf((*out)->name, sizeof (*out)->name, "%s", (*out)->scene_name);
    }
    scene_release(&scene);
    buffer_release(&packed);
    return s;
}

static void submit(struct session *session, const Azulejo__Wire__JobSubmit *message,
                   uint64_t request)
{
    struct job *job = NULL;
    struct error err = {0};

    if (make_job(store_folder(session->server->store), message, &job, &err) != STATUS_OK) {
        log_info("a job from %s was not taken: %s", session->host, err.text);
        session_fail(session, request, &err);
        return;
    }
    session_task_submit(session, request, job);
}

void session_accepted(struct session *session, uint64_t request, uint64_t job,
                      uint32_t estimate_spp)
{
    Azulejo__Wire__JobAccepted accepted = AZULEJO__WIRE__JOB_ACCEPTED__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(JOB_ACCEPTED, job_accepted, &accepted);

    accepted.job = job;
    accepted.estimate_spp = estimate_spp;
    reply(session, &envelope, request);
}

static void develop(struct session *session, const Azulejo__Wire__JobDevelop *message,
                    uint64_t request, uint64_t now_ns)
{
    struct job *job = find_job(session, message->job, request);
    struct output_settings output;
    struct error err = {0};
    status s;

    if (!job)
        return;
    s = wire_output_get(&output, message->output, &err);
    if (s == STATUS_OK)
        s = check_tonemap_file(store_folder(session->server->store), &output, &err);
    if (s == STATUS_OK)
        s = farm_develop(&session->server->farm, job, &output, &err);
    if (s == STATUS_OK)
        send_jobs(session, request, job, NULL, now_ns);
    else
        session_fail(session, request, &err);
}

static void resume(struct session *session, const Azulejo__Wire__JobResume *message,
                   uint64_t request, uint64_t now_ns)
{
    struct job *job = find_job(session, message->job, request);
    struct error err = {0};

    if (!job)
        return;
    if (closing_unpark(&session->server->farm, job, now_ns, &err) == STATUS_OK)
        send_jobs(session, request, job, NULL, now_ns);
    else
        session_fail(session, request, &err);
}

static void extend(struct session *session, const Azulejo__Wire__JobExtend *message,
                   uint64_t request, uint64_t now_ns)
{
    struct job *job = find_job(session, message->job, request);
    struct job_extension extension = {.spp = message->spp, .frames = message->frames,
                                      .frame_count = message->n_frames};
    struct error err = {0};
    status s;

    if (!job)
        return;
    s = wire_stop_get(&extension.rules, message->stop, &err);
    if (s == STATUS_OK && message->spp > SETTINGS_SPP_MAX)
        s = error_set(&err, STATUS_ERR_INPUT, "%u samples a pixel: must be 1..%d", message->spp,
                      SETTINGS_SPP_MAX);
    if (s == STATUS_OK)
        s = farm_extend(&session->server->farm, job, &extension, &err);
    if (s == STATUS_OK)
        send_jobs(session, request, job, NULL, now_ns);
    else
        session_fail(session, request, &err);
}

/* ---- workers -------------------------------------------------------------------------------- */

static void fill_worker(Azulejo__Wire__WorkerInfo *info, struct session *s, uint64_t now_ns)
{
    info->session = s->id;
    info->host = s->host;
    info->process = s->process;
    info->address = s->peer;
    info->software = s->software;
    info->kernel = s->worker->kernel;
    info->threads = s->worker->threads;
    info->isa_mask = s->worker->isa_mask;
    info->units_leased = s->worker->held.units;
    info->units_done = s->worker->units_done;
    info->samples_done = s->worker->samples_done;
    info->samples_per_second = rate_per_second(&s->worker->rate, now_ns);
    info->connected_s = (now_ns - s->begun_ns) / NS_PER_SECOND;
    info->note = s->worker->note;
}

static void send_workers(struct session *session, uint64_t request, uint64_t now_ns)
{
    struct server *server = session->server;
    size_t room = server->farm.worker_count, count = 0;
    Azulejo__Wire__WorkerInfo *infos = mem_alloc_array(room, sizeof *infos);
    Azulejo__Wire__WorkerInfo **pointers =
        mem_alloc_array(room, sizeof(Azulejo__Wire__WorkerInfo *));
    Azulejo__Wire__WorkerList list = AZULEJO__WIRE__WORKER_LIST__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(WORKER_LIST, worker_list, &list);
    struct error err = {0};

    if (!infos || !pointers) {
        error_no_memory(&err, "a list of workers");
        session_fail(session, request, &err);
    } else {
        for (struct session *s = server->sessions; s && count < room; s = s->next) {
            Azulejo__Wire__WorkerInfo info = AZULEJO__WIRE__WORKER_INFO__INIT;
            if (!s->worker)
                continue;
            infos[count] = info;
            fill_worker(&infos[count], s, now_ns);
            pointers[count] = &infos[count];
            count++;
        }
        list.n_workers = count;
        list.workers = pointers;
        reply(session, &envelope, request);
    }
    mem_free(pointers);
    mem_free(infos);
}

/* ---- outputs -------------------------------------------------------------------------------- */

static status send_file(struct session *session, const struct job *job, uint32_t frame,
                        const char *extension, uint64_t request, struct error *err)
{
    struct buffer path = BUFFER_INIT;
    status s;

    store_output_path(session->server->store, job->id, frame, extension, &path);
    if (!buffer_ok(&path))
        s = error_no_memory(err, "a path");
    else if (!file_exists(buffer_text(&path)))
        s = error_set(err, STATUS_ERR_NOT_FOUND,
                      "job %" PRIu64 ", frame %u: its %s file is not on the coordinator any more",
                      job->id, frame, extension);
    else
        s = transfer_file(&session->transfers, request, NULL, buffer_text(&path), err);
    buffer_release(&path);
    return s;
}

/* One of a finished frame's files. */
static status send_picture(struct session *session, const struct job *job,
                           const Azulejo__Wire__OutputGet *message, uint64_t request,
                           struct error *err)
{
    int exr = message->kind == AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_EXR;
    int png = message->kind == AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_PNG;
    const char *extension = exr ? "exr" : png ? "png" : "jpg";

    if (!job_frame_is_done(job, message->frame))
        return error_set(err, STATUS_ERR_NOT_FOUND, "job %" PRIu64 ", frame %u is not finished",
                         job->id, message->frame);
    if (!(exr ? job->output.exr : png ? job->output.png : job->output.jpg))
        return error_set(err, STATUS_ERR_NOT_FOUND, "job %" PRIu64 " has no %s output", job->id,
                         extension);
    if (!exr && !job_frame_is_developed(job, message->frame))
        return error_set(err, STATUS_ERR_NOT_FOUND,
                         "job %" PRIu64 ", frame %u is not tone mapped yet%s%s; try again in a "
                         "moment",
                         job->id, message->frame, trouble_is(&job->pictures) ? ": " : "",
                         job->pictures.text);
    return send_file(session, job, message->frame, extension, request, err);
}

/* The frame as it stands; of one that is done, its file. */
static status send_preview(struct session *session, const struct job *job,
                           const Azulejo__Wire__OutputGet *message, uint64_t request,
                           struct error *err)
{
    int linear = message->kind == AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_PREVIEW_EXR;
    uint32_t number = message->frame;
    struct job_frame *frame = farm_frame_find(job, number);

    if (job_frame_is_done(job, number)) {
        if (linear ? job->output.exr : job->output.png && job_frame_is_developed(job, number))
            return send_file(session, job, number, linear ? "exr" : "png", request, err);
        return error_set(err, STATUS_ERR_NOT_FOUND,
                         "job %" PRIu64 ", frame %u is finished: fetch its files without --preview",
                         job->id, number);
    }
    if (!frame || film_samples(frame->film) == 0)
        return error_set(err, STATUS_ERR_NOT_FOUND, "job %" PRIu64 ", frame %u has no samples yet",
                         job->id, number);
    session_task_preview(session, request, frame, linear);
    return STATUS_OK;
}

static status send_output(struct session *session, const struct job *job,
                          const Azulejo__Wire__OutputGet *message, uint64_t request,
                          struct error *err)
{
    uint32_t number = message->frame;

    if (number < job->first_frame || number > job->last_frame)
        return error_set(err, STATUS_ERR_NOT_FOUND, "job %" PRIu64 " has frames %u to %u", job->id,
                         job->first_frame, job->last_frame);
    switch (message->kind) {
    case AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_EXR:
    case AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_PNG:
    case AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_JPEG:
        return send_picture(session, job, message, request, err);
    case AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_EFFECTS_JSON:
        if (!job_frame_is_done(job, number))
            return error_set(err, STATUS_ERR_NOT_FOUND, "job %" PRIu64 ", frame %u is not finished",
                             job->id, number);
        return send_file(session, job, number, MANIFEST_EXTENSION, request, err);
    case AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_PREVIEW_PNG:
    case AZULEJO__WIRE__OUTPUT_KIND__OUTPUT_PREVIEW_EXR:
        return send_preview(session, job, message, request, err);
    default:
        return error_set(err, STATUS_ERR_UNSUPPORTED, "unknown kind of output %d",
                         (int)message->kind);
    }
}

static void get_output(struct session *session, const Azulejo__Wire__OutputGet *message,
                       uint64_t request)
{
    const struct job *job = find_job(session, message->job, request);
    struct error err = {0};

    if (!job)
        return;
    if (send_output(session, job, message, request, &err) != STATUS_OK)
        session_fail(session, request, &err);
    transfers_pump(&session->transfers, session->channel);
}

/* ---- history --------------------------------------------------------------------------------- */

static void send_history(struct session *session, uint64_t request, const struct job *job,
                         uint32_t frame, const struct history *history)
{
    Azulejo__Wire__HistoryPoint points[HISTORY_MAX], *pointers[HISTORY_MAX];
    Azulejo__Wire__Figures figures[HISTORY_MAX];
    Azulejo__Wire__History message = AZULEJO__WIRE__HISTORY__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(HISTORY, history, &message);

    for (uint32_t i = 0; i < history->count; i++) {
        wire_point_set(&points[i], &figures[i], &history->points[i]);
        pointers[i] = &points[i];
    }
    message.job = job->id;
    message.frame = frame;
    message.n_points = history->count;
    message.points = pointers;
    reply(session, &envelope, request);
}

/* Of a frame that is done the store has it; of one that nobody began there is none. */
static void get_history(struct session *session, const Azulejo__Wire__HistoryGet *message,
                        uint64_t request)
{
    const struct job *job = find_job(session, message->job, request);
    struct history history = {.count = 0};
    const struct job_frame *frame;
    struct error err = {0};
    status s = STATUS_OK;

    if (!job)
        return;
    frame = farm_frame_find(job, message->frame);
    if (frame)
        history = frame->history;
    else if (message->frame < job->first_frame || message->frame > job->last_frame)
        s = error_set(&err, STATUS_ERR_NOT_FOUND, "job %" PRIu64 " has frames %u to %u", job->id,
                      job->first_frame, job->last_frame);
    else
        s = store_history_load(session->server->store, job->id, message->frame, &history, &err);
    if (s == STATUS_OK)
        send_history(session, request, job, message->frame, &history);
    else
        session_fail(session, request, &err);
}

/* ---- blobs ---------------------------------------------------------------------------------- */

static void query_blobs(struct session *session, const Azulejo__Wire__BlobQuery *message,
                        uint64_t request)
{
    const char *folder = store_folder(session->server->store);
    Azulejo__Wire__BlobMissing missing = AZULEJO__WIRE__BLOB_MISSING__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(BLOB_MISSING, blob_missing, &missing);
    ProtobufCBinaryData *digests = mem_alloc_array(message->n_digest, sizeof *digests);
    struct error err = {0};
    status s = digests ? STATUS_OK : error_no_memory(&err, "a list of blobs");

    if (s == STATUS_OK && message->n_digest > MESSAGE_DIGESTS_MAX)
        s = error_set(&err, STATUS_ERR_LIMIT, "at most %d blobs in one question",
                      MESSAGE_DIGESTS_MAX);
    for (size_t i = 0; s == STATUS_OK && i < message->n_digest; i++) {
        struct digest digest;
        uint64_t size;
        s = wire_digest_get(&digest, &message->digest[i], "a blob", &err);
        if (s == STATUS_OK && !blobs_find(folder, &digest, &size))
            digests[missing.n_digest++] = message->digest[i];
    }
    missing.digest = digests;
    if (s == STATUS_OK)
        reply(session, &envelope, request);
    else
        session_fail(session, request, &err);
    mem_free(digests);
}

static void send_stored(struct session *session, const struct digest *digest, uint64_t request)
{
    Azulejo__Wire__BlobStored stored = AZULEJO__WIRE__BLOB_STORED__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(BLOB_STORED, blob_stored, &stored);

    wire_digest_set(&stored.digest, digest);
    reply(session, &envelope, request);
}

static struct upload **upload_slot(struct session *session, const struct digest *digest)
{
    for (uint32_t i = 0; i < SESSION_UPLOADS_MAX; i++) {
        struct upload *upload = session->uploads[i];
        if (digest ? upload && digest_equal(upload_digest(upload), digest) : !upload)
            return &session->uploads[i];
    }
    return NULL;
}

static status add_piece(struct session *session, struct upload **slot,
                        const struct blob_piece *piece, uint64_t request, struct error *err)
{
    static uint8_t bytes[BLOB_PIECE_BYTES];
    struct upload *upload = *slot;
    status s;

    if (piece->offset != upload_size(upload) || piece->total_bytes != upload_total(upload))
        return error_set(err, STATUS_ERR_PROTOCOL, "the pieces of a blob must come in order");
    s = blob_piece_unpack(piece, bytes, err);
    if (s == STATUS_OK)
        s = upload_add(upload, bytes, piece->raw_bytes, err);
    if (s != STATUS_OK || upload_size(upload) < upload_total(upload))
        return s;
    *slot = NULL;
    session_task_upload(session, request, upload);
    return STATUS_OK;
}

static void put_blob(struct session *session, const Azulejo__Wire__BlobPut *message,
                     uint64_t request)
{
    const char *folder = store_folder(session->server->store);
    struct blob_piece piece;
    struct upload **slot = NULL;
    struct error err = {0};
    uint64_t size;
    status s = blob_piece_of_put(&piece, message, &err);

    if (s == STATUS_OK) {
        slot = upload_slot(session, &piece.digest);
        if (!slot && piece.offset > 0)
            return; /* the rest of one that was there already, or failed: it was answered */
        if (!slot && blobs_find(folder, &piece.digest, &size) == 1) {
            send_stored(session, &piece.digest, request);
            return;
        }
    }
    if (s == STATUS_OK && !slot) {
        slot = upload_slot(session, NULL);
        if (!slot || session->storing >= SESSION_STORING_MAX)
            s = error_set(&err, STATUS_ERR_LIMIT, "too many blobs at once: end %d of them first",
                          SESSION_UPLOADS_MAX);
        else
            s = farm_store_usable(&session->server->farm, &err);
        if (s == STATUS_OK)
            s = upload_begin(slot, folder, &piece.digest, piece.total_bytes, &err);
    }
    if (s == STATUS_OK)
        s = add_piece(session, slot, &piece, request, &err);
    if (s != STATUS_OK) {
        if (slot) {
            upload_free(*slot);
            *slot = NULL;
        }
        log_warn("session %u (%s): a blob was not taken: %s", session->id, session->host, err.text);
        session_fail(session, request, &err);
    }
}

static void get_blob(struct session *session, const Azulejo__Wire__BlobGet *message,
                     uint64_t request)
{
    const char *folder = store_folder(session->server->store);
    struct buffer path = BUFFER_INIT;
    struct digest digest;
    struct error err = {0};
    uint64_t size;
    status s = wire_digest_get(&digest, &message->digest, "a blob", &err);

    if (s == STATUS_OK && blobs_find(folder, &digest, &size) == 0) {
        char hex[DIGEST_HEX_SIZE];
        digest_to_hex(&digest, hex);
        s = error_set(&err, STATUS_ERR_NOT_FOUND, "the coordinator has no blob %s", hex);
    }
    if (s == STATUS_OK) {
        blobs_path(folder, &digest, &path);
        s = buffer_ok(&path) ? transfer_file(&session->transfers, request, &digest,
                                             buffer_text(&path), &err)
                             : error_no_memory(&err, "a path");
    }
    if (s != STATUS_OK)
        session_fail(session, request, &err);
    buffer_release(&path);
    transfers_pump(&session->transfers, session->channel);
}

/* ---- dispatch ------------------------------------------------------------------------------- */

static int client_only(struct session *session, const Azulejo__Wire__Envelope *message,
                       uint64_t now_ns)
{
    uint64_t request = message->request;
    struct job *job;

    switch (message->body_case) {
    case AZULEJO__WIRE__ENVELOPE__BODY_BLOB_PUT:
        put_blob(session, message->blob_put, request);
        return 1;
    case AZULEJO__WIRE__ENVELOPE__BODY_JOB_SUBMIT:
        submit(session, message->job_submit, request);
        return 1;
    case AZULEJO__WIRE__ENVELOPE__BODY_JOB_QUERY:
        answer_query(session, message->job_query, request, now_ns);
        return 1;
    case AZULEJO__WIRE__ENVELOPE__BODY_JOB_WATCH:
        begin_watch(session, message->job_watch, request, now_ns);
        return 1;
    case AZULEJO__WIRE__ENVELOPE__BODY_JOB_CANCEL:
        job = find_job(session, message->job_cancel->job, request);
        if (job) {
            farm_cancel(&session->server->farm, job, message->job_cancel->discard, now_ns);
            send_jobs(session, request, job, NULL, now_ns);
        }
        return 1;
    case AZULEJO__WIRE__ENVELOPE__BODY_JOB_RESUME:
        resume(session, message->job_resume, request, now_ns);
        return 1;
    case AZULEJO__WIRE__ENVELOPE__BODY_JOB_EXTEND:
        extend(session, message->job_extend, request, now_ns);
        return 1;
    case AZULEJO__WIRE__ENVELOPE__BODY_JOB_DEVELOP:
        develop(session, message->job_develop, request, now_ns);
        return 1;
    case AZULEJO__WIRE__ENVELOPE__BODY_WORKER_QUERY:
        send_workers(session, request, now_ns);
        return 1;
    case AZULEJO__WIRE__ENVELOPE__BODY_OUTPUT_GET:
        get_output(session, message->output_get, request);
        return 1;
    case AZULEJO__WIRE__ENVELOPE__BODY_RENDER_REQUEST:
        render_request_begin(session, message->render_request, request);
        return 1;
    case AZULEJO__WIRE__ENVELOPE__BODY_HISTORY_GET:
        get_history(session, message->history_get, request);
        return 1;
    default:
        return 0;
    }
}

int session_client_message(struct session *session, const Azulejo__Wire__Envelope *message,
                           uint64_t now_ns)
{
    switch (message->body_case) {
    case AZULEJO__WIRE__ENVELOPE__BODY_BLOB_QUERY:
        query_blobs(session, message->blob_query, message->request);
        return 1;
    case AZULEJO__WIRE__ENVELOPE__BODY_BLOB_GET:
        get_blob(session, message->blob_get, message->request);
        return 1;
    default:
        break;
    }
    if (session->role != FARM_ROLE_CLIENT && session->role != FARM_ROLE_ADMIN)
        return 0;
    return client_only(session, message, now_ns);
}
