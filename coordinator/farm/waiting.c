#include "coordinator/farm/waiting.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#include "common/base/bytes_text.h"
#include "common/system/clock.h"
#include "common/system/log.h"
#include "coordinator/farm/roster.h"

enum { MACHINES_NAMED_MAX = 3 };  /* that have too little memory */

/* ---- the order ------------------------------------------------------------------------------- */

static int is_ready(void *user UNUSED, const struct job *job)
{
    return job->needs.after_count == 0 && job->needs.not_before == 0;
}

static int has_worker(void *user, const struct job *job)
{
    const struct farm *farm = user;
    char why[256];

    for (uint32_t i = 0; i < farm->worker_count; i++)
        if (worker_takes_work(farm->workers[i]) && farm_can_serve(job, farm->workers[i], why, sizeof why))
            return 1;
    return 0;
}

/* The moments that have come are forgotten, so that a clock that is set back stops no job. */
static void look_at_the_clock(struct farm *farm)
{
    if (farm->wall_s < farm->ready_at_s)
        return;
    farm->ready_at_s = INT64_MAX;
    for (size_t i = 0; i < farm->queue.active_count; i++) {
        struct job_needs *needs = &farm->queue.active[i]->needs;
        if (needs->not_before && needs->not_before <= farm->wall_s) {
            needs->not_before = 0;
            farm->order.stale = 1;
            farm->events.job_changed(farm->events.user, farm->queue.active[i]);
        }
        if (needs->not_before && needs->not_before < farm->ready_at_s)
            farm->ready_at_s = needs->not_before;
    }
}

static void wait_no_longer(struct farm *farm, struct job *job, uint32_t i, uint64_t now_ns)
{
    struct job_needs *needs = &job->needs;

    farm_note(farm, job, NULL, "job %" PRIu64 " is done", needs->after[i]);
    needs->after_count--; /* also on disk: an extension of that job is not waited for */
    memmove(needs->after + i, needs->after + i + 1, (needs->after_count - i) * sizeof *needs->after);
    farm->order.stale = 1;
    farm_job_save(farm, job, now_ns); /* the done job may be removed next: store_job_remove waits for that */
    farm->events.job_changed(farm->events.user, job);
}

void waiting_settle(struct farm *farm, uint64_t now_ns)
{
    if (farm->queue.changes == farm->order.seen_changes)
        return;
    farm->ready_at_s = 0; /* a new job may wait for an earlier moment */
    for (size_t j = 0; j < farm->queue.active_count; j++) {
        struct job *job = farm->queue.active[j];
        for (uint32_t i = job->needs.after_count; i-- > 0;) {
            const struct job *other = queue_find(&farm->queue, job->needs.after[i]);
            if (other && other->state == JOB_STATE_DONE)
                wait_no_longer(farm, job, i, now_ns);
        }
    }
}

const struct order *waiting_order(struct farm *farm, uint64_t now_ns)
{
    const struct order_questions ask = {is_ready, has_worker, farm};

    waiting_settle(farm, now_ns);
    look_at_the_clock(farm);
    if (order_update(&farm->order, &farm->queue, &ask, now_ns, farm->wall_s))
        queue_order_changed(&farm->queue);
    return &farm->order;
}

/* ---- jobs that wait for jobs ----------------------------------------------------------------- */

status waiting_check(const struct farm *farm, const struct job *job, struct error *err)
{
    for (uint32_t i = 0; i < job->needs.after_count; i++)
        if (!queue_find(&farm->queue, job->needs.after[i]))
            return error_set(err, STATUS_ERR_INPUT,
                             "--after %" PRIu64 ": there is no such job ('azulejo list' shows which there are)",
                             job->needs.after[i]);
    return STATUS_OK;
}

void waiting_end(struct farm *farm, struct job *job)
{
    needs_waited(&job->needs);
    farm->order.stale = 1;
    farm_wake(farm);
}

/* ---- words ----------------------------------------------------------------------------------- */

static void explain_after(char *out, size_t size, const struct farm *farm, const struct job *job)
{
    const struct job_needs *needs = &job->needs;
    size_t used = (size_t)snprintf(out, size, "waits for job%s ", needs->after_count == 1 ? "" : "s");

    for (uint32_t i = 0; i < needs->after_count && used < size; i++)
        used += (size_t)snprintf(out + used, size - used, "%s%" PRIu64,
                                 i == 0 ? "" : i + 1 < needs->after_count ? ", " : " and ", needs->after[i]);
    for (uint32_t i = 0; i < needs->after_count && used < size; i++) {
        const struct job *other = queue_find(&farm->queue, needs->after[i]);
        if (other && !job_state_ended(other->state))
            continue;
        if (!other)
            snprintf(out + used, size - used,
                     "; %" PRIu64 " was removed before it was done: 'start' this one without it", needs->after[i]);
        else if (other->state != JOB_STATE_DONE)
            snprintf(out + used, size - used, "; %" PRIu64 " %s%s: 'retry' it, or 'start' this one without it",
                     needs->after[i], other->state == JOB_STATE_FAILED ? "" : "was ", job_state_word(other->state));
        return;
    }
}

int waiting_explain(char *out, size_t size, const struct farm *farm, const struct job *job)
{
    time_t when = (time_t)job->needs.not_before;
    char text[32] = "then";
    struct tm utc;

    if (job->needs.after_count > 0) {
        explain_after(out, size, farm, job);
        return 1;
    }
    if (job->needs.not_before == 0)
        return 0;
    if (gmtime_r(&when, &utc))
        strftime(text, sizeof text, "%Y-%m-%d %H:%M", &utc);
    snprintf(out, size, "waits until %s UTC", text);
    return 1;
}

/* A tag of the job that no worker has. 0: there is none. */
static int tag_nobody_has(const struct farm *farm, const char *require, char tag[TAG_MAX + 1])
{
    while (*require) {
        size_t length = strcspn(require, ",");
        char missing[TAG_MAX + 1];
        int found = 0;
        snprintf(tag, TAG_MAX + 1, "%.*s", (int)length, require);
        for (uint32_t i = 0; i < farm->worker_count && !found; i++)
            found = tags_have(farm->workers[i]->tags, tag, missing);
        if (!found)
            return 1;
        require += length + (require[length] == ',');
    }
    return 0;
}

static int has_tags(const struct farm_worker *worker, const struct job *job)
{
    char missing[TAG_MAX + 1];

    return tags_have(worker->tags, job->needs.require, missing);
}

/* The machines that have the tags, and too little memory. */
static void explain_memory(char *out, size_t size, const struct farm *farm, const struct job *job)
{
    char amount[BYTES_TEXT_SIZE];
    uint32_t named = 0;
    size_t used = (size_t)snprintf(
        out, size, "waits: no worker has enough memory: it needs %s%s%s;", job->needs.memory_said ? "" : "about ",
        bytes_text(amount, job->needs.memory),
        job->needs.memory_said ? ""
                               : ", an estimate from its files' sizes and triangles ('submit --memory' says it better)");

    for (uint32_t i = 0; i < farm->worker_count && used < size; i++) {
        const struct farm_worker *worker = farm->workers[i];
        if (!has_tags(worker, job))
            continue;
        if (named++ == MACHINES_NAMED_MAX) {
            snprintf(out + used, size - used, " ...");
            return;
        }
        used += (size_t)snprintf(out + used, size - used, "%s %.64s has %s", named > 1 ? "," : "",
                                 worker->deliverer.host, bytes_text(amount, worker->memory));
    }
}

int waiting_explain_workers(char *out, size_t size, const struct farm *farm, const struct job *job)
{
    const struct job_needs *needs = &job->needs;
    char tag[TAG_MAX + 1];
    uint32_t tagged = 0;

    if (farm->worker_count == 0)
        return 0;
    for (uint32_t i = 0; i < farm->worker_count; i++) {
        const struct farm_worker *worker = farm->workers[i];
        if (needs_fit(needs, job->id, worker->tags, worker->memory, NULL, 0))
            return 0;
        tagged += (uint32_t)has_tags(worker, job);
    }
    if (tagged > 0)
        explain_memory(out, size, farm, job);
    else if (tag_nobody_has(farm, needs->require, tag))
        snprintf(out, size, "waits: no worker has the tag %s", tag);
    else
        snprintf(out, size, "waits: no worker has all of the tags %s", needs->require);
    return 1;
}

/* ---- shares ---------------------------------------------------------------------------------- */

void waiting_save_shares(struct farm *farm, int now, uint64_t now_ns)
{
    struct error err = {0};

    if (!farm->store || (!now && now_ns - farm->shares_saved_ns < SHARES_SAVE_MS * NS_PER_MS))
        return;
    farm->shares_saved_ns = now_ns;
    for (size_t i = 0; i < farm->order.share_count; i++) {
        struct owner_share *share = farm->order.shares[i];
        if (!share->changed)
            continue;
        if (store_share_save_later(farm->store, share, &err) != STATUS_OK) {
            log_debug("%s", err.text);
            return;
        }
        share->changed = 0;
    }
}
