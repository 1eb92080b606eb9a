/* farm_tasks: the farm's work outside the loop's thread: making results durable, measuring
 * displays, estimating figures, developing pictures. */
#include "coordinator/net/farm_tasks.h"

#include <inttypes.h>

#include "common/system/clock.h"
#include "common/system/log.h"
#include "common/system/parallel.h"
#include "coordinator/pictures/develop.h"
#include "coordinator/farm/figures.h"
#include "coordinator/farm/freeze.h"
#include "coordinator/farm/merge.h"
#include "coordinator/net/server.h"
#include "coordinator/net/base/task.h"

/* Note for the job's trace when the task ran. */
static void note_task(const struct task *task, enum trace_kind kind, const struct job *job, uint32_t frame)
{
    struct trace_event event = {.kind = (uint8_t)kind, .frame = frame, .begin_ns = task->begun_ns,
                                .end_ns = task->ended_ns};

    trace_add(&task->server->farm.trace, job->id, &event);
}

/* ---- results go to disk --------------------------------------------------------------------- */

struct commit_task {
    struct task task;
    struct commit *commit;
};

static void commit_run(struct task *task) { merge_commit_run(((struct commit_task *)task)->commit); }

static void commit_end(struct task *task)
{
    struct server *server = task->server;
    struct commit *commit = ((struct commit_task *)task)->commit;

    server->commit_running = 0;
    if (server->state == SERVER_DRAINING && commit->result != STATUS_OK) {
        /* There is no time to wait for the disk: results that are not on it were not acknowledged. */
        log_error("%s; the workers keep the results that are not on disk", commit->error.text);
        merge_commit_abandon(&server->farm, commit);
    } else {
        merge_commit_end(&server->farm, commit, clock_monotonic_ns());
    }
}

static const struct task_kind commit_kind = {"a commit", sizeof(struct commit_task), commit_run,
                                             commit_end, NULL, 1};

void farm_task_commit(struct server *server)
{
    struct commit_task *t = task_new(server, &commit_kind, NULL);

    if (!t)
        return; /* the tick tries again */
    t->commit =
        merge_commit_begin(&server->farm, server->state == SERVER_LISTENING ? clock_monotonic_ns() : UINT64_MAX);
    if (!t->commit) {
        task_drop(&t->task);
        return;
    }
    server->commit_running = 1;
    task_start(&t->task);
}

/* ---- how a display shows a frame ------------------------------------------------------------ */

struct freeze_task {
    struct task task;
    struct freezing *freezing;
};

static void freeze_run(struct task *task) { freezing_run(((struct freeze_task *)task)->freezing); }

static void freeze_end(struct task *task)
{
    struct server *server = task->server;
    struct freezing *freezing = ((struct freeze_task *)task)->freezing;
    const struct job_frame *frame = freezing_frame(freezing);

    note_task(task, TRACE_FREEZE, frame->job, frame->number);
    /* Results that wait for it were not acknowledged: at a shutdown the workers keep them. */
    if (server->state == SERVER_DRAINING)
        freezing_abandon(&server->farm, freezing);
    else
        freezing_end(&server->farm, freezing, clock_monotonic_ns());
}

static const struct task_kind freeze_kind = {"a frame's statistics", sizeof(struct freeze_task),
                                             freeze_run, freeze_end, NULL, 1};

status farm_task_freeze(void *server, struct freezing *freezing, struct error *err)
{
    struct freeze_task *t = task_new(server, &freeze_kind, err);

    if (!t)
        return STATUS_ERR_NO_MEMORY;
    t->freezing = freezing;
    task_start(&t->task);
    return STATUS_OK;
}

/* ---- developments --------------------------------------------------------------------------- */

/* For a frame in work, or for a stored one. */
struct develop_task {
    struct task task;
    struct development *development;
    struct job_frame *frame; /* in work, for a frame's own pictures */
    int keep_film;
    struct job *job; /* not freed before the task ends (farm_job_dispose) */
    uint32_t number;
    uint64_t cost_ns; /* processor time of figures */
};

static void develop_release(struct task *task) { development_free(((struct develop_task *)task)->development); }

/* Start `t` when its development could be made, after `prepare` if there is one, or drop it and log why not. */
static status develop_start(struct develop_task *t, struct job *job, uint32_t number, int (*prepare)(struct task *task),
                            status made, const struct error *err)
{
    if (made != STATUS_OK) {
        log_debug("job %llu, frame %u: %s; trying again", (unsigned long long)job->id, number, err->text);
        task_drop(t ? &t->task : NULL);
        return made;
    }
    t->job = job;
    t->number = number;
    if (!prepare)
        task_start(&t->task);
    else
        task_prepare(&t->task, prepare);
    return STATUS_OK;
}

/* If there is no space for it, the film in work is kept; it can be continued as well. */
static void keep_film(const struct develop_task *t)
{
    const struct job_frame *frame = t->frame;
    struct store *store = t->task.server->store;
    struct error err = {0};

    if (!t->keep_film) {
        store_film_remove(store, frame->job->id, frame->number);
        return;
    }
    if (store_film_keep(store, frame->job->id, frame->number, frame->film, frame->file, &err) != STATUS_OK)
        log_warn("job %llu, frame %u: its film is kept as it is: %s", (unsigned long long)frame->job->id, frame->number,
                 err.text);
}

static void develop_run(struct task *task)
{
    struct develop_task *t = (struct develop_task *)task;

    task->result = develop_frame(t->development, task->server->store, &task->error);
    if (task->result == STATUS_OK)
        keep_film(t);
}

static void develop_end(struct task *task)
{
    struct develop_task *t = (struct develop_task *)task;
    struct farm *farm = &task->server->farm;

    note_task(task, TRACE_DEVELOP, t->job, t->number);
    if (task->result == STATUS_OK && !t->frame->closing && !t->frame->returns)
        figures_finished(farm, t->job, t->number, development_point(t->development));
    farm_frame_developed(farm, t->frame, development_revision(t->development), task->result, &task->error,
                         clock_monotonic_ns());
}

static const struct task_kind develop_kind = {"a picture", sizeof(struct develop_task), develop_run,
                                              develop_end, develop_release, 1};

status farm_task_develop(void *user, struct job_frame *frame)
{
    struct server *server = user;
    struct error err = {0};
    struct develop_task *t = task_new(server, &develop_kind, &err);
    status s = t ? development_new_frame(&t->development, frame, &err) : STATUS_ERR_NO_MEMORY;

    if (t) {
        t->frame = frame;
        t->keep_film = !server->farm.discards_films || tonemap_around(&frame->job->output.tonemap) > 0;
    }
    return develop_start(t, frame->job, frame->number, NULL, s, &err);
}

static void figures_run(struct task *task)
{
    struct develop_task *t = (struct develop_task *)task;
    uint64_t begin_ns = parallel_cpu_ns();

    task->result = develop_figures(t->development, task->server->store, &task->error);
    t->cost_ns += parallel_cpu_ns() - begin_ns;
}

static void figures_end(struct task *task)
{
    struct develop_task *t = (struct develop_task *)task;

    note_task(task, TRACE_FIGURES, t->job, t->number);
    if (task->result != STATUS_OK)
        log_debug("job %llu, frame %u: its figures: %s", (unsigned long long)t->job->id, t->number, task->error.text);
    figures_measured(&task->server->farm, t->job, t->number,
                     &(struct figures_result){development_point(t->development), development_evidence(t->development),
                                              t->cost_ns},
                     clock_monotonic_ns());
}

static int figures_prepare(struct task *task)
{
    struct develop_task *t = (struct develop_task *)task;
    uint64_t begin_ns = parallel_cpu_ns();
    int more = development_take(t->development);

    t->cost_ns += parallel_cpu_ns() - begin_ns;
    if (!more)
        farm_frame_unpin(&task->server->farm, t->frame);
    return more;
}

static const struct task_kind figures_kind = {"a frame's figures", sizeof(struct develop_task),
                                              figures_run, figures_end, develop_release, 1};

status farm_task_measure(void *user, struct job_frame *frame)
{
    struct server *server = user;
    uint64_t begin_ns = parallel_cpu_ns();
    struct error err = {0};
    struct develop_task *t;
    status s;

    if (server->state != SERVER_LISTENING)
        return STATUS_ERR_REFUSED;
    t = task_new(server, &figures_kind, &err);
    s = t ? development_new_measure(&t->development, frame, &err) : STATUS_ERR_NO_MEMORY;
    if (t)
        t->cost_ns = parallel_cpu_ns() - begin_ns;
    if (s == STATUS_OK) {
        t->frame = frame;
        farm_frame_pin(frame);
    }
    return develop_start(t, frame->job, frame->number, figures_prepare, s, &err);
}

static void redevelop_run(struct task *task)
{
    task->result = develop_again(((struct develop_task *)task)->development, task->server->store, &task->error);
}

/* Films that were kept only until the pictures around them were made. */
static void drop_films(struct server *server, const struct job *job, uint32_t number)
{
    const uint32_t around = tonemap_around(&job->output.tonemap);

    for (uint32_t d = 0; d <= 2 * around; d++)
        if (number + d >= job->first_frame + around && number + d - around <= job->last_frame &&
            job_film_is_spent(job, number + d - around))
            store_film_remove(server->store, job->id, number + d - around);
}

static void redevelop_end(struct task *task)
{
    struct develop_task *t = (struct develop_task *)task;
    const int drops = task->server->farm.discards_films && !t->job->removed;

    note_task(task, TRACE_REDEVELOP, t->job, t->number);
    if (task->result == STATUS_OK)
        figures_denoised(t->job, t->number, development_denoised(t->development));
    if (task->result == STATUS_OK && !t->job->removed && development_is_as_before(t->development))
        farm_note(&task->server->farm, t->job, NULL,
                  "frame %" PRIu32 " stays as it was denoised with the frames around it, which were rendered again since: its film was "
                  "not kept, and 'azulejo retry %" PRIu64 " --frames %" PRIu32 "' renders it again", t->number, t->job->id, t->number);
    farm_pictures_made(&task->server->farm, t->job, t->number, development_revision(t->development), task->result,
                       &task->error, clock_monotonic_ns());
    if (drops)
        drop_films(task->server, t->job, t->number);
}

static const struct task_kind redevelop_kind = {"a picture", sizeof(struct develop_task),
                                                redevelop_run, redevelop_end, develop_release, 1};

status farm_task_redevelop(void *user, struct job *job, uint32_t frame)
{
    struct server *server = user;
    struct error err = {0};
    struct develop_task *t;
    status s;

    if (server->state != SERVER_LISTENING)
        return STATUS_ERR_REFUSED;
    t = task_new(server, &redevelop_kind, &err);
    s = t ? development_new_stored(&t->development, job, frame, &err) : STATUS_ERR_NO_MEMORY;
    return develop_start(t, job, frame, NULL, s, &err);
}
