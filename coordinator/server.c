#include "coordinator/server.h"

#include <assert.h>
#include <stdio.h>
#include <string.h>

#include "common/base/clock.h"
#include "common/base/file.h"
#include "common/base/log.h"
#include "common/base/memory.h"
#include "common/math/elementary.h"
#include "coordinator/develop.h"
#include "coordinator/extend.h"
#include "coordinator/figures.h"
#include "coordinator/freeze.h"
#include "coordinator/merge.h"
#include "protocol/message.h"

struct session *server_session(struct server *server, uint32_t id)
{
    struct session *s = server->by_id[id % SESSION_BUCKETS];

    while (s && s->id != id)
        s = s->same_bucket;
    return s;
}

void server_session_add(struct server *server, struct session *session)
{
    struct session **bucket;

    session->server = server;
    session->id = ++server->last_session;
    session->next = server->sessions;
    if (server->sessions)
        server->sessions->previous = session;
    server->sessions = session;
    bucket = &server->by_id[session->id % SESSION_BUCKETS];
    session->same_bucket = *bucket;
    *bucket = session;
    server->session_count++;
}

void server_session_remove(struct server *server, struct session *session)
{
    struct session **at = &server->by_id[session->id % SESSION_BUCKETS];

    while (*at != session)
        at = &(*at)->same_bucket;
    *at = session->same_bucket;
    *(session->previous ? &session->previous->next : &server->sessions) = session->next;
    if (session->next)
        session->next->previous = session->previous;
    server->session_count--;
}

/* ---- what the farm asks for ----------------------------------------------------------------- */

static void on_revoke(void *user, uint32_t session, uint64_t lease, const char *reason)
{
    struct session *s = server_session(user, session);

    if (s)
        session_revoke(s, lease, reason);
}

static void on_ack(void *user, uint32_t session, const struct job *job, uint32_t frame,
                   struct unit_name unit)
{
    struct session *s = server_session(user, session);

    if (s && s->state == SESSION_OPEN)
        session_ack(s, job->id, frame, unit, 0);
}

static void on_notice(void *user, uint32_t session, const char *text)
{
    struct session *s = server_session(user, session);

    log_warn("session %u: %s", session, text);
    if (s)
        session_notice(s, LOG_LEVEL_WARN, text);
}

static void on_job_changed(void *user, struct job *job)
{
    struct server *server = user;

    for (struct session *s = server->sessions; s; s = s->next)
        for (uint32_t i = 0; i < s->watch_count; i++)
            if (s->watches[i].job == 0 || s->watches[i].job == job->id)
                s->watches[i].due = server->watches_due = 1;
}

/* ---- work in the thread pool ---------------------------------------------------------------- */

struct work {
    uv_work_t request;
    struct server *server;
    status result;
    struct error error;
    struct commit *commit;
    struct job_frame *frame;
    int keep_film;               /* of `frame` */
    struct development *development;
    struct freezing *freezing;
    struct job *stored_job;      /* whose stored_frame is developed again or measured; never freed */
    uint32_t stored_frame;
    uint64_t cost_ns;            /* processor time of figures */
    uint32_t session;            /* who asked, for a preview or an upload */
    uint64_t wire_request;
    struct buffer picture;       /* a preview */
    int linear;                  /* it is an EXR, not a PNG */
    struct upload *upload;
    struct job *job;
    uint64_t existing;           /* the job that was submitted with the same token; 0: none */
    uint64_t estimate;           /* of this job, which goes on from it; 0: none */
    status refused;              /* why no job can be taken now, OK: it can; its error is `refusal` */
    struct error refusal;
    char name[64];
};

static struct work *work_new(struct server *server)
{
    struct work *work = mem_calloc(1, sizeof *work);

    if (work) {
        work->request.data = work;
        work->server = server;
    }
    return work;
}

static void work_free(struct work *work)
{
    development_free(work->development);
    buffer_release(&work->picture);
    upload_free(work->upload);
    job_free(work->job);
    mem_free(work);
}

static void work_start(struct work *work, uv_work_cb run, uv_after_work_cb end)
{
    int code = uv_queue_work(&work->server->loop, &work->request, run, end);

    assert(code == 0); /* it fails only without a function to run */
    (void)code;
    work->server->works++;
}

static void run_commit(uv_work_t *request)
{
    struct work *work = request->data;

    merge_commit_run(work->commit);
}

static void end_commit(uv_work_t *request, int code)
{
    struct work *work = request->data;
    struct server *server = work->server;

    (void)code;
    server->works--;
    server->commit_running = 0;
    if (server->state == SERVER_DRAINING && work->commit->result != STATUS_OK) {
        /* No time to wait for the disk: what is not on it was not acknowledged either. */
        log_error("%s; its workers keep what is not on disk", work->commit->error.text);
        merge_commit_abandon(&server->farm, work->commit);
    } else {
        merge_commit_end(&server->farm, work->commit, clock_monotonic_ns());
    }
    work_free(work);
}

static void start_commit(struct server *server)
{
    struct work *work = work_new(server);

    if (!work)
        return; /* the tick tries again */
    work->commit = merge_commit_begin(
        &server->farm, server->state == SERVER_LISTENING ? clock_monotonic_ns() : UINT64_MAX);
    if (!work->commit) {
        work_free(work);
        return;
    }
    server->commit_running = 1;
    work_start(work, run_commit, end_commit);
}

/* Without room for it the film in work is kept, which can be gone on from, too. */
static void keep_film(const struct work *work)
{
    const struct job_frame *frame = work->frame;
    struct error err = {0};

    if (work->keep_film &&
        store_film_keep(work->server->store, frame->job->id, frame->number, frame->film, frame->file, &err) !=
            STATUS_OK)
        log_warn("job %llu, frame %u: its film is kept as it is: %s",
                 (unsigned long long)frame->job->id, frame->number, err.text);
    if (work->keep_film)
        return;
    film_file_discard(frame->file);
    store_film_remove(work->server->store, frame->job->id, frame->number);
}

static void run_develop(uv_work_t *request)
{
    struct work *work = request->data;

    work->result = develop_frame(work->development, work->server->store, &work->error);
    if (work->result != STATUS_OK)
        return;
    keep_film(work);
}

static void end_develop(uv_work_t *request, int code)
{
    struct work *work = request->data;
    struct server *server = work->server;

    (void)code;
    server->works--;
    work->frame->job->map_max = development_map_max(work->development);
    if (work->result == STATUS_OK && !work->frame->closing)
        figures_finished(&server->farm, work->frame->job, work->frame->number,
                         development_point(work->development));
    farm_frame_developed(&server->farm, work->frame, development_revision(work->development),
                         work->result, &work->error, clock_monotonic_ns());
    work_free(work);
}

static status on_develop(void *user, struct job_frame *frame)
{
    struct server *server = user;
    struct work *work = work_new(server);
    struct error err = {0};
    status s = work ? STATUS_OK : error_no_memory(&err, "a picture");

    if (s == STATUS_OK)
        s = development_new_frame(&work->development, frame, &err);
    if (s != STATUS_OK) {
        log_debug("job %llu, frame %u: %s", (unsigned long long)frame->job->id, frame->number,
                  err.text);
        if (work)
            work_free(work);
        return s;
    }
    work->frame = frame;
    work->keep_film = frame->end != FRAME_END_CANCEL && !server->farm.discards_films;
    work_start(work, run_develop, end_develop);
    return STATUS_OK;
}

static void run_measure(uv_work_t *request)
{
    struct work *work = request->data;
    uint64_t begin_ns = clock_thread_cpu_ns();

    work->result = develop_figures(work->development, work->server->store, &work->error);
    work->cost_ns += clock_thread_cpu_ns() - begin_ns;
}

static void end_measure(uv_work_t *request, int code)
{
    struct work *work = request->data;
    struct server *server = work->server;

    (void)code;
    server->works--;
    if (work->result != STATUS_OK)
        log_debug("job %llu, frame %u: its figures: %s", (unsigned long long)work->stored_job->id,
                  work->stored_frame, work->error.text);
    work->stored_job->map_max = development_map_max(work->development);
    figures_measured(&server->farm, work->stored_job, work->stored_frame,
                     development_point(work->development), work->cost_ns, clock_monotonic_ns());
    work_free(work);
}

static status on_measure(void *user, struct job_frame *frame)
{
    struct server *server = user;
    uint64_t begin_ns = clock_thread_cpu_ns();
    struct work *work;
    struct error err = {0};
    status s;

    if (server->state != SERVER_LISTENING)
        return STATUS_ERR_REFUSED;
    work = work_new(server);
    s = work ? development_new_measure(&work->development, frame, &err)
             : error_no_memory(&err, "a frame's figures");
    if (s != STATUS_OK) {
        log_debug("job %llu, frame %u: %s", (unsigned long long)frame->job->id, frame->number,
                  err.text);
        if (work)
            work_free(work);
        return s;
    }
    work->stored_job = frame->job;
    work->stored_frame = frame->number;
    work->cost_ns = clock_thread_cpu_ns() - begin_ns;
    work_start(work, run_measure, end_measure);
    return STATUS_OK;
}

static void run_redevelop(uv_work_t *request)
{
    struct work *work = request->data;

    work->result = develop_again(work->development, work->server->store, &work->error);
}

static void end_redevelop(uv_work_t *request, int code)
{
    struct work *work = request->data;
    struct server *server = work->server;

    (void)code;
    server->works--;
    farm_pictures_made(&server->farm, work->stored_job, work->stored_frame,
                       development_revision(work->development), work->result, &work->error,
                       clock_monotonic_ns());
    work_free(work);
}

static status on_redevelop(void *user, struct job *job, uint32_t frame)
{
    struct server *server = user;
    struct work *work = work_new(server);
    struct error err = {0};
    status s = work ? STATUS_OK : error_no_memory(&err, "a picture");

    if (server->state != SERVER_LISTENING)
        s = error_set(&err, STATUS_ERR_REFUSED, "the coordinator is ending");
    if (s == STATUS_OK)
        s = development_new_stored(&work->development, job, frame, &err);
    if (s != STATUS_OK) {
        log_debug("job %llu, frame %u: %s; trying again", (unsigned long long)job->id, frame,
                  err.text);
        if (work)
            work_free(work);
        return s;
    }
    work->stored_job = job;
    work->stored_frame = frame;
    work_start(work, run_redevelop, end_redevelop);
    return STATUS_OK;
}

static void run_freeze(uv_work_t *request)
{
    struct work *work = request->data;

    freezing_run(work->freezing);
}

static void end_freeze(uv_work_t *request, int code)
{
    struct work *work = request->data;
    struct server *server = work->server;

    (void)code;
    server->works--;
    /* What waits for it was not acknowledged: at the end its workers keep that. */
    if (server->state == SERVER_DRAINING)
        freezing_abandon(&server->farm, work->freezing);
    else
        freezing_end(&server->farm, work->freezing, clock_monotonic_ns());
    work_free(work);
}

static status on_freeze(void *user, struct freezing *freezing, struct error *err)
{
    struct work *work = work_new(user);

    if (!work)
        return error_no_memory(err, "a frame's statistics");
    work->freezing = freezing;
    work_start(work, run_freeze, end_freeze);
    return STATUS_OK;
}

static void run_preview(uv_work_t *request)
{
    struct work *work = request->data;

    work->result = develop_encode(work->development, work->server->store,
                                  work->linear ? &work->picture : NULL,
                                  work->linear ? NULL : &work->picture, &work->error);
}

static void end_preview(uv_work_t *request, int code)
{
    struct work *work = request->data;
    struct server *server = work->server;
    struct session *session = server_session(server, work->session);

    (void)code;
    server->works--;
    server->previews--;
    if (session && session->state == SESSION_OPEN) {
        if (work->result == STATUS_OK)
            work->result = transfer_bytes(&session->transfers, work->wire_request, &work->picture,
                                          work->name, &work->error);
        if (work->result != STATUS_OK)
            session_fail(session, work->wire_request, &work->error);
        transfers_pump(&session->transfers, session->channel);
    }
    work_free(work);
}

void server_preview(struct server *server, struct session *session, uint64_t request,
                    const struct job_frame *frame, int linear)
{
    struct work *work = NULL;
    struct error err = {0};
    status s = STATUS_OK;

    if (server->previews >= PREVIEWS_MAX)
        s = error_set(&err, STATUS_ERR_LIMIT, "%d previews are being made; try again in a second",
                      PREVIEWS_MAX);
    else if (!(work = work_new(server)))
        s = error_no_memory(&err, "a preview");
    else
        s = development_new_preview(&work->development, frame, &err);
    if (s != STATUS_OK) {
        session_fail(session, request, &err);
        if (work)
            work_free(work);
        return;
    }
    work->session = session->id;
    work->wire_request = request;
    work->linear = linear;
    snprintf(work->name, sizeof work->name, "frame-%04u-preview.%s", frame->number,
             linear ? "exr" : "png");
    server->previews++;
    work_start(work, run_preview, end_preview);
}

static void run_upload(uv_work_t *request)
{
    struct work *work = request->data;

    work->result = upload_finish(work->upload, &work->error);
}

static void end_upload(uv_work_t *request, int code)
{
    struct work *work = request->data;
    struct server *server = work->server;
    struct session *session = server_session(server, work->session);

    (void)code;
    server->works--;
    if (work->result != STATUS_OK)
        log_warn("a blob was not stored: %s", work->error.text);
    if (session && session->state == SESSION_OPEN) {
        session->storing--;
        if (work->result == STATUS_OK) {
            Azulejo__Wire__BlobStored stored = AZULEJO__WIRE__BLOB_STORED__INIT;
            Azulejo__Wire__Envelope envelope = MESSAGE(BLOB_STORED, blob_stored, &stored);
            wire_digest_set(&stored.digest, upload_digest(work->upload));
            envelope.request = work->wire_request;
            if (channel_send(session->channel, &envelope) != STATUS_OK)
                log_debug("session %u: blob_stored was not sent", session->id);
        } else {
            session_fail(session, work->wire_request, &work->error);
        }
    }
    work_free(work);
}

void server_store_upload(struct server *server, struct session *session, uint64_t request,
                         struct upload *upload)
{
    struct work *work = work_new(server);
    struct error err = {0};

    if (!work) {
        upload_free(upload);
        error_no_memory(&err, "an upload");
        session_fail(session, request, &err);
        return;
    }
    work->upload = upload;
    work->session = session->id;
    work->wire_request = request;
    session->storing++;
    work_start(work, run_upload, end_upload);
}

static void run_submit(uv_work_t *request)
{
    struct work *work = request->data;

    struct store *store = work->server->store;

    work->result = store_job_find(store, work->job, &work->existing, &work->error);
    if (work->result != STATUS_OK || work->existing)
        return;
    if (work->refused != STATUS_OK) {
        work->result = work->refused;
        work->error = work->refusal;
        return;
    }
    if (work->estimate)
        return; /* the queue's to do */
    work->result = store_job_insert(store, work->job, &work->error);
    /* Another thread may have stored the same submission in between. */
    if (work->result != STATUS_OK && work->job->token[0]) {
        struct error again = {0};
        status found = store_job_find(store, work->job, &work->existing, &again);
        if (found != STATUS_OK || work->existing) {
            work->result = found;
            work->error = again;
        }
    }
}

/* The estimate becomes the job, in the loop's thread, which has the queue. */
static void continue_estimate(struct work *work, struct session *session)
{
    struct farm *farm = &work->server->farm;
    struct job *estimate = queue_find(&farm->queue, work->estimate);
    uint32_t spp = estimate ? estimate->settings.spp : 0;

    work->result = estimate ? farm_continue_estimate(farm, estimate, work->job, &work->error)
                            : error_set(&work->error, STATUS_ERR_NOT_FOUND, "the estimate is gone");
    if (!session)
        return;
    if (work->result == STATUS_OK)
        session_accepted(session, work->wire_request, estimate->id, spp);
    else
        session_fail(session, work->wire_request, &work->error);
}

static void end_submit(uv_work_t *request, int code)
{
    struct work *work = request->data;
    struct server *server = work->server;
    struct session *session = server_session(server, work->session);

    (void)code;
    server->works--;
    if (work->result == STATUS_OK && work->existing) {
        log_info("job %llu (%s) was submitted again with its token",
                 (unsigned long long)work->existing, work->job->name);
        if (session)
            session_accepted(session, work->wire_request, work->existing, 0);
        work_free(work);
        return;
    }
    if (work->result == STATUS_OK && work->estimate) {
        continue_estimate(work, session);
        work_free(work);
        return;
    }
    if (work->result == STATUS_OK)
        work->result = farm_adopt(&server->farm, work->job, &work->error);
    if (work->result == STATUS_OK) {
        const struct job *job = work->job;
        work->job = NULL;
        log_info("job %llu (%s): %ux%u, %u spp, frames %u to %u, priority %d",
                 (unsigned long long)job->id, job->name, job->settings.width, job->settings.height,
                 job->settings.spp, job->first_frame, job->last_frame, job->priority);
        if (session)
            session_accepted(session, work->wire_request, job->id, 0);
    } else if (session) {
        session_fail(session, work->wire_request, &work->error);
    }
    work_free(work);
}

void server_submit(struct server *server, struct session *session, uint64_t request,
                   struct job *job)
{
    struct work *work = work_new(server);
    const struct job *estimate;
    struct error err = {0};

    if (!work) {
        error_no_memory(&err, "a job");
        session_fail(session, request, &err);
        job_free(job);
        return;
    }
    /* What was submitted before is answered even when nothing new can be taken. */
    work->refused = farm_prepare(&server->farm, job, &work->refusal);
    estimate = farm_find_estimate(&server->farm, job);
    work->estimate = estimate ? estimate->id : 0;
    work->job = job;
    work->session = session->id;
    work->wire_request = request;
    work_start(work, run_submit, end_submit);
}

/* ---- ending --------------------------------------------------------------------------------- */

static void close_handles(struct server *server)
{
    if (server->state == SERVER_CLOSING)
        return;
    server->state = SERVER_CLOSING;
    for (struct session *s = server->sessions, *next; s; s = next) {
        next = s->next;
        session_end(s, NULL);
    }
    door_close(&server->door);
    uv_close((uv_handle_t *)&server->tick, NULL);
    uv_close((uv_handle_t *)&server->commit_timer, NULL);
    uv_close((uv_handle_t *)&server->prepare, NULL);
    uv_close((uv_handle_t *)&server->terminate, NULL);
    uv_close((uv_handle_t *)&server->interrupt, NULL);
}

static void on_signal(uv_signal_t *handle, int number)
{
    struct server *server = handle->data;

    if (server->state != SERVER_LISTENING)
        return;
    log_info("ending on %s: what was received goes to disk first",
             number == SIGTERM ? "SIGTERM" : "SIGINT");
    server->state = SERVER_DRAINING;
    server->drain_since_ns = clock_monotonic_ns();
    uv_close((uv_handle_t *)&server->listener, NULL);
    for (struct session *s = server->sessions; s; s = s->next)
        if (s->state == SESSION_OPEN)
            session_notice(s, LOG_LEVEL_INFO, "the coordinator is ending");
}

/* ---- the loop ------------------------------------------------------------------------------- */

static void on_commit_timer(uv_timer_t *timer)
{
    (void)timer; /* the turn that follows looks at what is dirty */
}

static void commit_when_due(struct server *server, uint64_t now_ns)
{
    uint64_t due_ns;
    uint32_t tiles;

    if (server->commit_running || !merge_is_dirty(&server->farm, &due_ns, &tiles))
        return;
    if (tiles >= COMMIT_TILES_ENOUGH)
        due_ns = now_ns;
    if (now_ns >= due_ns || server->state != SERVER_LISTENING)
        start_commit(server);
    else if (!uv_is_active((uv_handle_t *)&server->commit_timer))
        uv_timer_start(&server->commit_timer, on_commit_timer,
                       (due_ns - now_ns) / NS_PER_MS + 1, 0);
}

static void grant_all(struct server *server, uint64_t now_ns)
{
    server->farm.pump_wanted = 0;
    for (struct session *s = server->sessions; s; s = s->next)
        if (s->worker && s->worker->room > 0)
            session_grant(s, now_ns);
}

/* Once a turn of the loop, before it waits: everything that the turn's events made due. */
static void on_prepare(uv_prepare_t *handle)
{
    struct server *server = handle->data;
    uint64_t now_ns = clock_monotonic_ns();

    if (server->farm.pump_wanted && server->state == SERVER_LISTENING)
        grant_all(server, now_ns);
    commit_when_due(server, now_ns);
    if (server->acks_due || server->watches_due) {
        server->acks_due = server->watches_due = 0;
        for (struct session *s = server->sessions; s; s = s->next)
            session_flush(s, now_ns);
    }
    if (server->state == SERVER_DRAINING) {
        uint64_t due_ns;
        uint32_t tiles;
        int idle = server->works == 0 && !merge_is_dirty(&server->farm, &due_ns, &tiles);
        if (idle || now_ns - server->drain_since_ns > SERVER_DRAIN_MS * NS_PER_MS)
            close_handles(server);
    }
}

static void on_tick(uv_timer_t *timer)
{
    struct server *server = timer->data;
    uint64_t now_ns = clock_monotonic_ns();

    /* Timers run before sockets are read: after a pause everybody would look silent. */
    if (server->ticked_ns && now_ns - server->ticked_ns > SERVER_PAUSE_MS * NS_PER_MS) {
        log_warn("the coordinator was held up for %.1f s",
                 (double)(now_ns - server->ticked_ns) / 1e9);
        server->awake_ns = now_ns;
        farm_pause(&server->farm, now_ns - server->ticked_ns);
    }
    server->ticked_ns = now_ns;
    server->farm.wall_s = clock_wall_s();
    farm_tick(&server->farm, now_ns);
    for (struct session *s = server->sessions, *next; s; s = next) {
        next = s->next;
        session_tick(s, now_ns);
    }
    server->farm.pump_wanted = 1; /* work may have become overdue */
}

static void on_connection(uv_stream_t *listener, int code)
{
    struct server *server = listener->data;

    door_connection(&server->door, listener, code);
}

static status resolve(struct server *server, const char *host, uint16_t port,
                      struct sockaddr_storage *out, struct error *err)
{
    struct addrinfo hints = {.ai_family = AF_UNSPEC, .ai_socktype = SOCK_STREAM,
                             .ai_flags = AI_PASSIVE};
    uv_getaddrinfo_t request;
    char service[8];
    int code;

    snprintf(service, sizeof service, "%u", port);
    code = uv_getaddrinfo(&server->loop, &request, NULL, host[0] ? host : NULL, service, &hints);
    if (code != 0)
        return error_set(err, STATUS_ERR_IO, "--listen %s: %s", host, uv_strerror(code));
    memcpy(out, request.addrinfo->ai_addr, request.addrinfo->ai_addrlen);
    uv_freeaddrinfo(request.addrinfo);
    return STATUS_OK;
}

static status announce(struct server *server, const char *ready_file, struct error *err)
{
    struct sockaddr_storage address;
    int length = sizeof address;
    char host[64] = "", line[16];
    int port, six;

    if (uv_tcp_getsockname(&server->listener, (struct sockaddr *)&address, &length) != 0)
        return error_set(err, STATUS_ERR_INTERNAL, "the listening address is not known");
    six = address.ss_family == AF_INET6;
    if (six)
        uv_ip6_name((struct sockaddr_in6 *)&address, host, sizeof host);
    else
        uv_ip4_name((struct sockaddr_in *)&address, host, sizeof host);
    port = ntohs(six ? ((struct sockaddr_in6 *)&address)->sin6_port
                     : ((struct sockaddr_in *)&address)->sin_port);
    log_info("listening on %s%s%s:%d, store %s", six ? "[" : "", host, six ? "]" : "", port,
             store_folder(server->store));
    printf("listening on %s%s%s:%d\n", six ? "[" : "", host, six ? "]" : "", port);
    fflush(stdout);
    if (!ready_file)
        return STATUS_OK;
    snprintf(line, sizeof line, "%d\n", port);
    return file_write_atomic(ready_file, line, strlen(line), err);
}

static status listen_on(struct server *server, const struct server_options *options,
                        struct error *err)
{
    struct sockaddr_storage address = {0};
    int code;
    status s = resolve(server, options->host, options->port, &address, err);

    if (s != STATUS_OK)
        return s;
    code = uv_tcp_bind(&server->listener, (const struct sockaddr *)&address, 0);
    if (code == 0)
        code = uv_listen((uv_stream_t *)&server->listener, SERVER_BACKLOG, on_connection);
    if (code == UV_EADDRINUSE)
        return error_set(err, STATUS_ERR_IO,
                         "%s:%u is in use: another coordinator may run there; choose another port "
                         "with --listen",
                         options->host, options->port);
    if (code != 0)
        return error_set(err, STATUS_ERR_IO, "cannot listen on %s:%u: %s", options->host,
                         options->port, uv_strerror(code));
    return announce(server, options->ready_file, err);
}

static void init_handles(struct server *server)
{
    uv_tcp_init(&server->loop, &server->listener);
    uv_timer_init(&server->loop, &server->tick);
    uv_timer_init(&server->loop, &server->commit_timer);
    uv_prepare_init(&server->loop, &server->prepare);
    uv_signal_init(&server->loop, &server->terminate);
    uv_signal_init(&server->loop, &server->interrupt);
    server->listener.data = server->tick.data = server->commit_timer.data = server;
    server->prepare.data = server->terminate.data = server->interrupt.data = server;
}

status server_run(const struct server_options *options, struct error *err)
{
    struct server *server = mem_calloc(1, sizeof *server);
    struct farm_events events = {on_revoke, on_ack, on_notice, on_job_changed, on_develop,
                                 on_redevelop, on_measure, on_freeze, server};
    status s;

    if (!server)
        return error_no_memory(err, "the server");
    server->key = options->key;
    server->store = options->store;
    server->fingerprint = elementary_fingerprint();
    if (uv_loop_init(&server->loop) != 0) {
        mem_free(server);
        return error_set(err, STATUS_ERR_INTERNAL, "no event loop");
    }
    init_handles(server);
    server->descriptors = options->descriptors;
    door_init(&server->door, server);
    s = farm_init(&server->farm, options->store, options->lease_ns, &events, clock_wall_s(), err);
    if (s == STATUS_OK) {
        server->farm.discards_films = options->discards_films;
        s = listen_on(server, options, err);
        if (s == STATUS_OK) {
            uv_timer_start(&server->tick, on_tick, SERVER_TICK_MS, SERVER_TICK_MS);
            uv_prepare_start(&server->prepare, on_prepare);
            uv_signal_start(&server->terminate, on_signal, SIGTERM);
            uv_signal_start(&server->interrupt, on_signal, SIGINT);
            farm_resume(&server->farm, clock_monotonic_ns());
        } else {
            uv_close((uv_handle_t *)&server->listener, NULL);
            close_handles(server);
        }
        uv_run(&server->loop, UV_RUN_DEFAULT);
        farm_release(&server->farm, clock_monotonic_ns());
    } else {
        uv_close((uv_handle_t *)&server->listener, NULL);
        close_handles(server);
        uv_run(&server->loop, UV_RUN_DEFAULT);
    }
    uv_loop_close(&server->loop);
    mem_free(server);
    return s;
}
