#include "coordinator/net/base/previews.h"

#include <stdio.h>

#include "common/system/clock.h"
#include "common/system/log.h"
#include "common/base/memory.h"
#include "common/system/parallel.h"
#include "coordinator/pictures/develop.h"
#include "coordinator/net/server.h"
#include "coordinator/net/session/session.h"
#include "coordinator/net/base/session_table.h"
#include "coordinator/net/base/task.h"
#include "coordinator/net/base/transfer.h"

enum { PREVIEW_WAITING_MAX = 1024 }; /* that wait for the same preview */

struct request_of {
    uint32_t session;
    uint64_t request;
};

struct preview_task {
    struct task task;
    uint64_t job;
    uint32_t frame;
    enum preview_kind kind;
    struct development *development;
    struct job_frame *taken_of; /* while the film is copied */
    struct buffer picture;
    struct preview_file *file; /* of these bytes, on the loop's thread */
    struct preview shows;      /* of the frame when it was taken; its `file` is not used */
    uint64_t pixels;
    uint64_t cost_ns;
    struct request_of *waiting;
    size_t waiting_count, waiting_capacity;
    uint64_t holder; /* that it is made for; 0: none */
};

static struct preview_now look_at(const struct job_frame *frame, uint64_t now_ns)
{
    return (struct preview_now){.covered = film_covered_share(frame->film),
                                .samples = film_samples(frame->film),
                                .now_ns = now_ns,
                                .revision = frame->job->revision};
}

static void send_file(struct session *session, uint64_t request, uint32_t frame, enum preview_kind kind,
                      struct preview_file *file, const struct transfer_preview *shows)
{
    struct error err = {0};
    char name[64];

    snprintf(name, sizeof name, "frame-%04u-preview.%s", frame, kind == PREVIEW_EXR ? "exr" : "png");
    if (transfer_bytes(&session->transfers, request, file, name, shows, &err) != STATUS_OK)
        session_fail(session, request, &err);
    transfers_pump(&session->transfers, session->channel);
}

/* ---- memory goes back ------------------------------------------------------------------------ */

void previews_ended(struct server *server, uint64_t holder)
{
    server->previews--;
    server->trim_wanted = 1;
    holders_preview_end(&server->holders, holder);
}

static void trim_run(struct task *task UNUSED) { mem_trim(); }
static void trim_end(struct task *task UNUSED) {}

/* A picture's operators take gigabytes at 4K, which the allocator would keep for its threads. */
static void trim(struct server *server)
{
    static const struct task_kind kind = {"memory to give back", sizeof(struct task), trim_run, trim_end, NULL, 0};
    struct task *task = server->trim_wanted && server->previews == 0 ? task_new(server, &kind, NULL) : NULL;

    if (!task)
        return;
    server->trim_wanted = 0;
    task_start(task);
}

/* ---- making one ----------------------------------------------------------------------------- */

static void preview_run(struct task *task)
{
    struct preview_task *p = (struct preview_task *)task;
    uint64_t begin_ns = parallel_cpu_ns();

    task->result = develop_encode(p->development, task->server->store, p->kind == PREVIEW_EXR ? &p->picture : NULL,
                                  p->kind == PREVIEW_PNG ? &p->picture : NULL, &task->error);
    p->cost_ns += parallel_cpu_ns() - begin_ns;
}

static int preview_prepare(struct task *task)
{
    struct preview_task *p = (struct preview_task *)task;
    uint64_t begin_ns = parallel_cpu_ns();
    int more = development_take(p->development);

    p->cost_ns += parallel_cpu_ns() - begin_ns;
    if (!more)
        farm_frame_unpin(&task->server->farm, p->taken_of);
    return more;
}

/* Answer those that wait. */
static void answer(struct preview_task *p)
{
    struct transfer_preview shows = {p->shows.covered,
                                     (double)p->shows.samples / (double)p->pixels};

    for (size_t i = 0; i < p->waiting_count; i++) {
        struct session *session = session_find(p->task.server, p->waiting[i].session);
        if (!session || session->state != SESSION_OPEN)
            continue;
        if (p->task.result == STATUS_OK)
            send_file(session, p->waiting[i].request, p->frame, p->kind, p->file, &shows);
        else
            session_fail(session, p->waiting[i].request, &p->task.error);
    }
}

static void preview_end(struct task *task)
{
    struct preview_task *p = (struct preview_task *)task;
    const struct job *job = queue_find(&task->server->farm.queue, p->job);
    struct job_frame *frame = job ? farm_frame_find(job, p->frame) : NULL;
    struct preview *kept = frame ? &frame->previews[p->kind] : NULL;

    previews_ended(task->server, p->holder);
    log_debug("job %llu, frame %u: a preview took %.0f ms of processor time", (unsigned long long)p->job, p->frame,
              (double)p->cost_ns / 1e6);
    if (task->result == STATUS_OK && !(p->file = preview_file_new(&p->picture)))
        task->result = error_no_memory(&task->error, "a preview");
    answer(p);
    if (!kept || kept->making != task) /* the frame was closed, and perhaps opened again */
        return;
    kept->making = NULL;
    kept->made_ns = clock_monotonic_ns();
    kept->cost_ns = p->cost_ns;
    preview_release(kept);
    if (task->result != STATUS_OK) {
        log_debug("job %llu, frame %u: no preview: %s", (unsigned long long)p->job, p->frame, task->error.text);
        return;
    }
    kept->covered = p->shows.covered;
    kept->samples = p->shows.samples;
    kept->revision = p->shows.revision;
    kept->too_large = p->file->bytes.size > PREVIEW_KEPT_BYTES;
    if (!kept->too_large)
        kept->file = preview_file_hold(p->file);
}

static void preview_free(struct task *task)
{
    struct preview_task *p = (struct preview_task *)task;

    development_free(p->development);
    buffer_release(&p->picture);
    preview_file_drop(p->file);
    mem_free(p->waiting);
}

static const struct task_kind preview_kind = {"a preview", sizeof(struct preview_task), preview_run,
                                              preview_end, preview_free, 0};

/* NULL: an error. The task has begun. */
static struct preview_task *make(struct server *server, struct job_frame *frame, enum preview_kind kind,
                                 const struct request_of *who, struct error *err)
{
    struct preview_now now = look_at(frame, clock_monotonic_ns());
    struct preview_task *p = task_new(server, &preview_kind, err);
    uint64_t begin_ns = parallel_cpu_ns();

    if (!p)
        return NULL;
    if (development_new_preview(&p->development, frame, NULL, err) != STATUS_OK) {
        task_drop(&p->task);
        return NULL;
    }
    if (who && MEM_GROW(p->waiting, p->waiting_capacity, 1))
        p->waiting[p->waiting_count++] = *who;
    if (who && p->waiting_count == 0) {
        error_no_memory(err, "a preview");
        task_drop(&p->task);
        return NULL;
    }
    p->job = frame->job->id;
    p->frame = frame->number;
    p->kind = kind;
    p->shows = (struct preview){
        .covered = now.covered, .samples = now.samples, .revision = now.revision};
    p->pixels = (uint64_t)film_width(frame->film) * film_height(frame->film);
    p->cost_ns = parallel_cpu_ns() - begin_ns;
    frame->previews[kind].making = p;
    server->previews++;
    p->taken_of = frame;
    farm_frame_pin(frame);
    task_prepare(&p->task, preview_prepare);
    return p;
}

/* ---- asking --------------------------------------------------------------------------------- */

/* Wait for the preview that is being made. */
static status join(const struct preview *kept, const struct request_of *who, struct error *err)
{
    struct preview_task *p = (struct preview_task *)kept->making;

    if (p->waiting_count >= PREVIEW_WAITING_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "%d clients wait for this preview; try again in a second",
                         PREVIEW_WAITING_MAX);
    NEED(MEM_GROW(p->waiting, p->waiting_capacity, p->waiting_count + 1), err, "a preview");
    p->waiting[p->waiting_count++] = *who;
    return STATUS_OK;
}

/* Within what the session's token or key may have. */
static status make_for(struct session *session, struct job_frame *frame, enum preview_kind kind,
                       const struct request_of *who, struct error *err)
{
    struct server *server = session->server;
    struct preview_task *p;

    TRY(holders_preview_begin(&server->holders, session->holder, session->may, err));
    p = make(server, frame, kind, who, err);
    if (!p) {
        holders_preview_end(&server->holders, session->holder);
        return err->code;
    }
    p->holder = session->holder;
    return STATUS_OK;
}

void previews_ask(struct session *session, uint64_t request, struct job_frame *frame, enum preview_kind kind)
{
    struct server *server = session->server;
    struct preview *kept = &frame->previews[kind];
    struct preview_now now = look_at(frame, clock_monotonic_ns());
    struct request_of who = {session->id, request};
    double pixels = (double)film_width(frame->film) * film_height(frame->film);
    struct error err = {0};
    status s = STATUS_OK;

    kept->asked_ns = now.now_ns;
    if (preview_is_good(kept, kind, &now)) {
        struct transfer_preview shows = {kept->covered, (double)kept->samples / pixels};
        send_file(session, request, frame->number, kind, kept->file, &shows);
        return;
    }
    if (kept->making && ((const struct preview_task *)kept->making)->shows.revision == now.revision)
        s = join(kept, &who, &err);
    else if (server->previews >= PREVIEWS_MAX)
        s = error_set(&err, STATUS_ERR_LIMIT, "%d previews are being made; try again in a second", PREVIEWS_MAX);
    else
        s = make_for(session, frame, kind, &who, &err);
    if (s != STATUS_OK)
        session_fail(session, request, &err);
}

/* ---- keeping them ready --------------------------------------------------------------------- */

static void keep(struct server *server, struct job_frame *frame, uint64_t now_ns)
{
    struct preview_now now = look_at(frame, now_ns);

    for (int kind = 0; kind < PREVIEW_KINDS; kind++) {
        struct preview *kept = &frame->previews[kind];
        struct error err = {0};
        preview_age(kept, now_ns);
        if (!kept->making && server->previews == 0 && preview_is_due(kept, &now) &&
            !make(server, frame, kind, NULL, &err))
            kept->made_ns = now_ns; /* tried again after a while */
    }
}

void previews_tick(struct server *server, uint64_t now_ns)
{
    const struct farm *farm = &server->farm;
    uint32_t left = farm->open_frames;

    if (server->state != SERVER_LISTENING)
        return;
    trim(server);
    for (size_t i = 0; i < farm->queue.active_count && left > 0; i++)
        for (struct job_frame *frame = farm->queue.active[i]->frames; frame; frame = frame->next) {
            if (frame->end == FRAME_END_NONE) /* else its pictures are on their way */
                keep(server, frame, now_ns);
            left -= left > 0;
        }
}
