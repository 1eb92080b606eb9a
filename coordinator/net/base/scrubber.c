#include "coordinator/net/base/scrubber.h"

#include <inttypes.h>
#include <stdio.h>

#include "common/system/clock.h"
#include "common/system/log.h"
#include "coordinator/farm/farm.h"
#include "coordinator/net/base/task.h"
#include "coordinator/net/server.h"

struct scrub_task {
    struct task task;
    struct scrub *scrub;
    uint64_t bytes;
    struct scrub_report report;
};

static void run(struct task *task)
{
    struct scrub_task *t = (struct scrub_task *)task;

    scrub_step(t->scrub, t->bytes, &t->report);
}

/* The row as this process knows it. */
static void save_again(struct server *server, uint64_t id, uint64_t now_ns)
{
    struct job *job = queue_find(&server->farm.queue, id);

    if (job && !job->is_damaged)
        farm_job_save(&server->farm, job, now_ns);
}

static void end(struct task *task)
{
    const struct scrub_task *t = (const struct scrub_task *)task;
    struct scrubber *s = &task->server->scrubber;
    uint64_t now_ns = clock_monotonic_ns();

    s->is_looking = 0;
    s->files += t->report.files;
    s->round_files += t->report.files;
    s->faults += t->report.faults;
    for (uint32_t i = 0; i < t->report.line_count; i++) {
        log_error("%s (found while nothing was rendered). Check the disk", t->report.lines[i]);
        snprintf(s->last, sizeof s->last, "%s", t->report.lines[i]);
    }
    for (uint32_t i = 0; i < t->report.job_count; i++)
        save_again(task->server, t->report.jobs[i], now_ns);
    s->next_ns = now_ns + SCRUB_STEP_MS * NS_PER_MS;
    if (!t->report.is_round)
        return;
    s->done_s = clock_wall_s();
    s->next_ns = now_ns + SCRUB_AGAIN_S * NS_PER_SECOND;
    log_info("the store was looked through for damage: %" PRIu64 " files and tables, %" PRIu64 " faults since the start",
             s->round_files, s->faults);
    s->round_files = 0;
    s->is_said = 0;
}

static const struct task_kind kind = {"a look for damage", sizeof(struct scrub_task), run, end, NULL, 0};

static int is_idle(const struct server *server)
{
    struct error why = {0};

    return server->farm.leases.count == 0 && !server->commit_running && !server->farm.developing &&
           server->previews == 0 && server->submits == 0 && farm_store_usable(&server->farm, &why) == STATUS_OK;
}

void scrubber_tick(struct server *server, uint64_t now_ns)
{
    struct scrubber *s = &server->scrubber;
    struct scrub_task *t;

    if (s->rate == 0 || s->is_looking)
        return;
    if (!is_idle(server)) {
        s->idle_ns = 0;
        return;
    }
    if (s->idle_ns == 0)
        s->idle_ns = now_ns;
    if (now_ns - s->idle_ns < SCRUB_IDLE_MS * NS_PER_MS || now_ns < s->next_ns)
        return;
    if (!s->scrub && !(s->scrub = scrub_new(server->store)))
        return;
    t = task_new(server, &kind, NULL);
    if (!t)
        return;
    if (!s->is_said)
        log_debug("nothing is rendered: looking through the store for damage");
    s->is_said = 1;
    t->scrub = s->scrub;
    t->bytes = s->rate / (1000 / SCRUB_STEP_MS) + 1;
    s->is_looking = 1;
    task_start(&t->task);
}

void scrubber_release(struct scrubber *scrubber)
{
    scrub_free(scrubber->scrub);
    scrubber->scrub = NULL;
}
