/* session_tasks: the sessions' work outside the loop's thread: uploads, jobs. */

#include <string.h>
#include "coordinator/net/session/session_tasks.h"

#include "common/system/clock.h"
#include "common/system/log.h"
#include "common/base/memory.h"
#include "coordinator/steering/extend.h"
#include "coordinator/net/server.h"
#include "coordinator/net/session/session_audit.h"
#include "coordinator/net/session/session.h"
#include "coordinator/net/base/session_table.h"
#include "coordinator/net/base/task.h"
#include "coordinator/store/files/blobs.h"
#include "protocol/message.h"

/* A task that answers a request; its session may have ended by then. */
struct request_task {
    struct task task;
    uint32_t session;
    uint64_t request;
};

static void *request_new(struct session *session, uint64_t request, const struct task_kind *kind, struct error *err)
{
    struct request_task *r = task_new(session->server, kind, err);

    if (r) {
        r->session = session->id;
        r->request = request;
    }
    return r;
}

/* NULL: it has ended or is ending. */
static struct session *request_session(const struct request_task *r)
{
    struct session *session = session_find(r->task.server, r->session);

    return session && session->state == SESSION_OPEN ? session : NULL;
}

/* ---- a frame's files --------------------------------------------------------- */

struct output_task {
    struct request_task r;
    struct output_asked asked;
    struct digest is;
    uint64_t size_bytes;
    char *path;
};

static void output_run(struct task *task)
{
    struct output_task *o = (struct output_task *)task;
    const struct output_asked *a = &o->asked;

    task->result = digest_of_file(&o->is, &o->size_bytes, o->path, &task->error);
    THEN(task->result, store_output_check(task->server->store, a->job, a->frame, a->extension, &o->is, &task->error));
}

static status output_send(struct output_task *o, struct session *session, struct error *err)
{
    const struct output_asked *a = &o->asked;

    if (a->is_preview)
        return transfer_file_preview(&session->transfers, o->r.request, o->path, &a->shows, err);
    return a->has ? transfer_output(&session->transfers, o->r.request, &o->is, o->path, err)
                  : transfer_file(&session->transfers, o->r.request, o->path, err);
}

static void output_end(struct task *task)
{
    struct output_task *o = (struct output_task *)task;
    struct session *session = request_session(&o->r);
    Azulejo__Wire__OutputData same = AZULEJO__WIRE__OUTPUT_DATA__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(OUTPUT_DATA, output_data, &same);

    if (!session)
        return;
    if (task->result == STATUS_OK && o->asked.has && digest_equal(&o->asked.have, &o->is)) {
        same.total_bytes = same.offset = o->size_bytes;
        same.unchanged = 1;
        wire_digest_set(&same.digest, &o->is);
        session_reply(session, o->r.request, &envelope);
        return;
    }
    if (task->result == STATUS_OK)
        task->result = output_send(o, session, &task->error);
    if (task->result != STATUS_OK)
        session_fail(session, o->r.request, &task->error);
    transfers_pump(&session->transfers, session->channel);
}

static void output_release(struct task *task) { mem_free(((struct output_task *)task)->path); }

static const struct task_kind output_kind = {"an output", sizeof(struct output_task), output_run,
                                             output_end, output_release, 0};

void session_task_output(struct session *session, uint64_t request, const char *path, const struct output_asked *asked)
{
    struct error err = {0};
    struct output_task *o = request_new(session, request, &output_kind, &err);

    if (o && !(o->path = mem_strdup(path)))
        error_no_memory(&err, "a path");
    if (!o || !o->path) {
        task_drop(o ? &o->r.task : NULL);
        session_fail(session, request, &err);
        return;
    }
    o->asked = *asked;
    task_start(&o->r.task);
}

/* ---- blobs that a client need not send ------------------------------------------------------ */

struct vouch_task {
    struct request_task r;
    char *folder;
    int64_t since_ns;
    struct digest *digests;
    size_t count; /* of digests; afterwards, of those that are missing */
};

static void vouch_run(struct task *task)
{
    struct vouch_task *v = (struct vouch_task *)task;
    size_t missing = 0;
    uint64_t size;

    for (size_t i = 0; i < v->count; i++)
        if (blobs_vouch(v->folder, &v->digests[i], v->since_ns, &size) == 0)
            v->digests[missing++] = v->digests[i];
    v->count = missing;
}

static void vouch_end(struct task *task)
{
    struct vouch_task *v = (struct vouch_task *)task;
    struct session *session = request_session(&v->r);
    Azulejo__Wire__BlobMissing missing = AZULEJO__WIRE__BLOB_MISSING__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(BLOB_MISSING, blob_missing, &missing);

    if (!session)
        return;
    missing.digest = mem_alloc_array(v->count, sizeof *missing.digest);
    if (!missing.digest) {
        (void)error_no_memory(&task->error, "a list of blobs");
        session_fail(session, v->r.request, &task->error);
        return;
    }
    for (size_t i = 0; i < v->count; i++)
        wire_digest_set(&missing.digest[missing.n_digest++], &v->digests[i]);
    session_reply(session, v->r.request, &envelope);
    mem_free(missing.digest);
}

static void vouch_release(struct task *task)
{
    struct vouch_task *v = (struct vouch_task *)task;

    mem_free(v->folder);
    mem_free(v->digests);
}

static const struct task_kind vouch_kind = {"a list of blobs", sizeof(struct vouch_task), vouch_run, vouch_end,
                                            vouch_release, 0};

void session_task_vouch(struct session *session, uint64_t request, struct digest *digests, size_t count)
{
    struct error err = {0};
    struct vouch_task *v = request_new(session, request, &vouch_kind, &err);

    if (v && !(v->folder = mem_strdup(store_folder(session->server->store))))
        (void)error_no_memory(&err, "a path");
    if (!v || !v->folder) {
        task_drop(v ? &v->r.task : NULL);
        mem_free(digests);
        session_fail(session, request, &err);
        return;
    }
    v->since_ns = session->blobs_since_ns;
    v->digests = digests;
    v->count = count;
    task_start(&v->r.task);
}

/* ---- uploads -------------------------------------------------------------------------------- */

struct upload_task {
    struct request_task r;
    struct upload *upload;
};

static void upload_run(struct task *task)
{
    task->result = upload_finish(((struct upload_task *)task)->upload, &task->error);
}

static void upload_end(struct task *task)
{
    struct upload_task *u = (struct upload_task *)task;
    struct session *session = request_session(&u->r);

    if (task->result != STATUS_OK)
        log_warn("a blob was not stored: %s", task->error.text);
    if (task->result == STATUS_OK)
        task->server->collector.sent += upload_total(u->upload);
    if (!session)
        return;
    session->storing--;
    if (task->result == STATUS_OK)
        holders_blob_stored(&task->server->holders, session->holder, upload_digest(u->upload));
    if (task->result == STATUS_OK)
        session_stored(session, u->r.request, upload_digest(u->upload));
    else
        session_fail(session, u->r.request, &task->error);
}

static void upload_release(struct task *task) { upload_free(((struct upload_task *)task)->upload); }

static const struct task_kind upload_kind = {"an upload", sizeof(struct upload_task), upload_run,
                                             upload_end, upload_release, 1};

void session_task_upload(struct session *session, uint64_t request, struct upload *upload)
{
    struct error err = {0};
    struct upload_task *u = request_new(session, request, &upload_kind, &err);

    if (!u) {
        upload_free(upload);
        session_fail(session, request, &err);
        return;
    }
    u->upload = upload;
    session->storing++;
    task_start(&u->r.task);
}

/* ---- jobs ----------------------------------------------------------------------------------- */

struct submit_task {
    struct request_task r;
    struct job *job;
    uint64_t existing; /* the job that was submitted with the same token; 0: none */
    uint64_t estimate; /* the estimate that this job continues; 0: none */
    status refused;    /* why no job can be accepted now (OK: it can); its error is `refusal` */
    struct error refusal;
    struct audit_actor actor;
    char name[JOB_NAME_MAX + 1];
    struct owner_room room; /* of those who have a ceiling */
    uint64_t holder;        /* that submits it (holders.h); 0: none */
    struct digest *blobs;   /* that it needs */
    size_t blob_count;
};

static void submit_run(struct task *task)
{
    struct submit_task *t = (struct submit_task *)task;
    struct store *store = task->server->store;

    task->result = store_job_find(store, t->job, &t->existing, &task->error);
    if (task->result != STATUS_OK || t->existing)
        return;
    if (t->refused != STATUS_OK) {
        task->result = t->refused;
        task->error = t->refusal;
        return;
    }
    task->result = owner_room_check(&t->room, store_folder(store), &task->error);
    if (task->result != STATUS_OK || t->estimate)
        return; /* the queue continues an estimate */
    task->result = store_job_insert(store, t->job, &task->error);
    /* Another thread may have stored the same submission in between. */
    if (task->result != STATUS_OK && t->job->token[0]) {
        struct error again = {0};
        status found = store_job_find(store, t->job, &t->existing, &again);
        if (found != STATUS_OK || t->existing) {
            task->result = found;
            task->error = again;
        }
    }
}

/* Put the job in the queue, or continue its estimate with it: `*number` is the job's number, `*spp`
 * the estimate's samples. */
static status submit_take(struct submit_task *t, uint64_t *number, uint32_t *spp)
{
    struct task *task = &t->r.task;
    struct farm *farm = &task->server->farm;
    const struct job *job = t->job;

    *number = t->existing;
    *spp = 0;
    if (t->existing) {
        log_info("job %llu (%s) was submitted again with its token", (unsigned long long)t->existing, job->name);
        return STATUS_OK;
    }
    if (t->estimate) {
        struct job *estimate = queue_find(&farm->queue, t->estimate);
        if (!estimate)
            return error_set(&task->error, STATUS_ERR_NOT_FOUND, "the estimate is gone");
        *number = estimate->id;
        *spp = estimate->settings.spp;
        return farm_continue_estimate(farm, estimate, t->job, &task->error);
    }
    TRY(farm_adopt(farm, t->job, &task->error));
    farm_shortages_hurry(farm, clock_monotonic_ns()); /* its blobs may be those that another job waits for */
    t->job = NULL;                                    /* the queue has it */
    *number = job->id;
    log_info("job %llu (%s): %ux%u, %u spp, frames %u to %u, priority %d", (unsigned long long)job->id, job->name,
             job->settings.width, job->settings.height, job->settings.spp, job->first_frame, job->last_frame,
             job->priority);
    return STATUS_OK;
}

static void submit_end(struct task *task)
{
    struct submit_task *t = (struct submit_task *)task;
    struct session *session;
    uint64_t number = 0;
    uint32_t spp = 0;

    if (task->result == STATUS_OK)
        task->result = submit_take(t, &number, &spp);
    if (task->result == STATUS_OK)
        holders_blobs_used(&task->server->holders, t->holder, t->blobs, t->blob_count);
    task->server->submits--;
    session_audit_submission(task->server, &t->actor, t->name, number, t->existing != 0, task->result, &task->error);
    session = session_find(task->server, t->r.session);
    if (!session)
        return;
    if (task->result == STATUS_OK)
        session_accepted(session, t->r.request, number, spp);
    else
        session_fail(session, t->r.request, &task->error);
}

static void submit_release(struct task *task)
{
    struct submit_task *t = (struct submit_task *)task;

    job_free(t->job);
    mem_free(t->blobs);
    owner_room_release(&t->room);
}

static const struct task_kind submit_kind = {"a job", sizeof(struct submit_task), submit_run,
                                             submit_end, submit_release, 1};

void session_task_submit(struct session *session, uint64_t request, struct job *job, struct digest *blobs,
                         size_t blob_count, int force)
{
    struct error err = {0};
    struct submit_task *t = request_new(session, request, &submit_kind, &err);
    const struct job *estimate;
    int64_t since_ns;

    if (!t) {
        session_fail(session, request, &err);
        job_free(job);
        mem_free(blobs);
        return;
    }
    session_actor(session, &t->actor);
    memcpy(t->name, job->name, sizeof t->name);
    t->holder = session->holder;
    t->blobs = blobs;
    t->blob_count = blob_count;
    /* A repeated submission is answered even when no new job can be accepted. */
    t->refused = farm_prepare(&session->server->farm, job, &t->refusal);
    if (t->refused == STATUS_OK)
        t->refused = collector_check_room(session->server, job, force, &t->refusal);
    estimate = farm_find_estimate(&session->server->farm, job);
    t->estimate = estimate ? estimate->id : 0;
    if (t->refused == STATUS_OK && session->holder)
        t->refused = collector_owner_room(session->server, session->may, job, t->estimate, &t->room, &t->refusal);
    t->job = job;
    /* Its blobs are held since then, until it is in the queue: the session may end before. */
    since_ns = session->blobs_since_ns ? session->blobs_since_ns : blobs_now();
    if (session->server->submits++ == 0 || since_ns < session->server->submits_since_ns)
        session->server->submits_since_ns = since_ns;
    task_start(&t->r.task);
}
