#include "coordinator/steering/retention.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/bytes_text.h"
#include "common/base/duration.h"
#include "common/base/memory.h"
#include "coordinator/farm/farm.h"

uint64_t room_limit_bytes(const struct room_limit *limit, uint64_t disk_bytes)
{
    uint64_t share = limit->share > 0 ? (uint64_t)(limit->share * (double)disk_bytes) : 0;

    if (share == 0 || (limit->bytes > 0 && limit->bytes < share))
        return limit->bytes;
    return share;
}

int retention_makes_room(const struct retention_policy *policy)
{
    return policy->store.bytes > 0 || policy->store.share > 0;
}

void retention_plan_release(struct retention_plan *plan)
{
    mem_free(plan->steps);
    *plan = (struct retention_plan){0};
}

/* ---- the plan -------------------------------------------------------------------------------- */

/* A job while the plan is made. */
struct candidate {
    const struct retention_job *job;
    int films_gone, gone;
};

struct planning {
    struct retention_plan *plan;
    struct candidate *candidates; /* those that ended first first, then those that have not */
    size_t count;
    struct error *err;
};

static int compare(const void *a, const void *b)
{
    const struct retention_job *left = ((const struct candidate *)a)->job;
    const struct retention_job *right = ((const struct candidate *)b)->job;

    if (left->ended != right->ended)
        return left->ended ? -1 : 1;
    if (left->ended && left->ended_at != right->ended_at)
        return left->ended_at < right->ended_at ? -1 : 1;
    return (left->job > right->job) - (left->job < right->job);
}

static uint64_t bytes_of(const struct candidate *c)
{
    return c->gone ? 0 : (c->films_gone ? 0 : c->job->films) + c->job->pictures;
}

static status add_step(struct planning *p, struct candidate *c, int whole, enum retention_reason reason,
                       uint64_t *freed)
{
    struct retention_plan *plan = p->plan;
    uint64_t bytes = whole ? bytes_of(c) + c->job->blobs : c->job->films;

    NEED(MEM_GROW(plan->steps, plan->capacity, plan->count + 1), p->err, "a plan of what to remove");
    plan->steps[plan->count++] = (struct retention_step){
        .job = c->job->job, .whole = whole, .reason = reason, .bytes = bytes};
    c->films_gone = 1;
    c->gone = whole;
    *freed += bytes;
    return STATUS_OK;
}

int64_t retention_keep_s(const struct retention_policy *policy, int failed)
{
    return failed && policy->keep_failed_s >= 0 ? policy->keep_failed_s : policy->keep_s;
}

void retention_ages_wait(struct retention_policy *policy)
{
    policy->keep_failed_s = retention_keep_s(policy, 1) > 0 ? INT64_MAX : retention_keep_s(policy, 1);
    if (policy->keep_s > 0)
        policy->keep_s = INT64_MAX;
}

static status plan_ages(struct planning *p, const struct retention_policy *policy, int64_t now_s, uint64_t *freed)
{
    status s = STATUS_OK;

    for (size_t i = 0; i < p->count && s == STATUS_OK; i++) {
        const struct retention_job *job = p->candidates[i].job;
        int failed = job->failed && policy->keep_failed_s >= 0;
        int64_t keep_s = retention_keep_s(policy, job->failed), age_s = now_s - job->ended_at;
        if (!job->ended || keep_s < 0 || age_s < keep_s)
            continue;
        if (job->busy) {
            p->plan->in_use++;
            continue;
        }
        s = add_step(p, &p->candidates[i], 1, RETENTION_AGE, freed);
        if (s == STATUS_OK) {
            struct retention_step *step = &p->plan->steps[p->plan->count - 1];
            step->age_s = age_s;
            step->keep_s = keep_s;
            step->failed = failed;
        }
    }
    return s;
}

/* May this step of the order take from the job? */
enum turn { TURN_ENDED_FILMS, TURN_KEPT_FILMS, TURN_JOBS, TURNS };
static int has_turn(const struct candidate *c, enum turn turn)
{
    if (c->gone || c->job->busy)
        return 0;
    if (turn == TURN_JOBS)
        return c->job->ended;
    return !c->films_gone && c->job->films > 0 && c->job->ended == (turn == TURN_ENDED_FILMS);
}

/* Free `excess` bytes, of one owner's jobs or with NULL of all. */
static status plan_excess(struct planning *p, const char *owner, uint64_t excess, enum retention_reason reason,
                          uint64_t *freed)
{
    uint64_t done = 0;
    status s = STATUS_OK;

    for (int turn = 0; turn < TURNS; turn++)
        for (size_t i = 0; i < p->count && s == STATUS_OK && done < excess; i++) {
            struct candidate *c = &p->candidates[i];
            if (has_turn(c, (enum turn)turn) && (!owner || strcmp(owner, c->job->owner) == 0))
                s = add_step(p, c, turn == TURN_JOBS, reason, &done);
        }
    *freed += done;
    return s;
}

static int compare_owners(const void *a, const void *b)
{
    return strcmp((*(const struct candidate *const *)a)->job->owner, (*(const struct candidate *const *)b)->job->owner);
}

static status plan_owners(struct planning *p, uint64_t limit, uint64_t *freed)
{
    struct candidate **by_owner = mem_alloc_array(p->count, sizeof(struct candidate *));
    status s = STATUS_OK;

    NEED(by_owner, p->err, "a plan of what to remove");
    for (size_t i = 0; i < p->count; i++)
        by_owner[i] = &p->candidates[i];
    if (p->count > 0)
        qsort(by_owner, p->count, sizeof *by_owner, compare_owners);
    for (size_t begin = 0, end; begin < p->count && s == STATUS_OK; begin = end) {
        uint64_t used = 0;
        for (end = begin; end < p->count && compare_owners(&by_owner[begin], &by_owner[end]) == 0; end++)
            used += bytes_of(by_owner[end]);
        if (used > limit)
            s = plan_excess(p, by_owner[begin]->job->owner, used - limit, RETENTION_OWNER, freed);
    }
    mem_free(by_owner);
    return s;
}

status retention_make(struct retention_plan *plan, const struct retention_policy *policy,
                      const struct retention_job *jobs, size_t count, uint64_t used, uint64_t limit, int64_t now_s,
                      struct error *err)
{
    struct planning p = {.plan = plan,
                         .count = count,
                         .err = err,
                         .candidates = mem_calloc(count ? count : 1, sizeof *p.candidates)};
    uint64_t freed = 0;
    status s = p.candidates ? STATUS_OK : error_no_memory(err, "a plan of what to remove");

    plan->count = plan->in_use = 0;
    plan->used = used;
    plan->limit = limit;
    for (size_t i = 0; i < count && s == STATUS_OK; i++)
        p.candidates[i].job = &jobs[i];
    if (s == STATUS_OK && count > 0)
        qsort(p.candidates, count, sizeof *p.candidates, compare);
    THEN(s, plan_ages(&p, policy, now_s, &freed));
    if (s == STATUS_OK && policy->owner_limit > 0)
        s = plan_owners(&p, policy->owner_limit, &freed);
    if (s == STATUS_OK && limit > 0 && used > limit && freed < used - limit)
        s = plan_excess(&p, NULL, used - limit - freed, RETENTION_STORE, &freed);
    if (s != STATUS_OK)
        plan->count = 0;
    mem_free(p.candidates);
    return s;
}

/* ---- words ----------------------------------------------------------------------------------- */

void retention_text(char out[RETENTION_TEXT_MAX + 1], const struct retention_plan *plan,
                    const struct retention_step *step, const struct retention_policy *policy)
{
    char used[BYTES_TEXT_SIZE], limit[BYTES_TEXT_SIZE];
    char age[DURATION_TEXT_SIZE], keep[DURATION_TEXT_SIZE];

    switch (step->reason) {
    case RETENTION_AGE:
        snprintf(out, RETENTION_TEXT_MAX + 1, "it ended %s ago (--keep%s %s)", duration_words(age, step->age_s),
                 step->failed ? "-failed" : "", duration_text(keep, step->keep_s));
        return;
    case RETENTION_OWNER:
        snprintf(out, RETENTION_TEXT_MAX + 1, "its owner has more than %s in the store (--owner-limit)",
                 bytes_text(limit, policy->owner_limit));
        return;
    default:
        snprintf(out, RETENTION_TEXT_MAX + 1, "the store takes %s, and %s are allowed (--store-limit)",
                 bytes_text(used, plan->used), bytes_text(limit, plan->limit));
    }
}

/* ---- how much a job will take ---------------------------------------------------------------- */

/* Bytes a pixel as they usually are on disk (docs/OPERATIONS.md). */
static const double exr_bytes = 10.5, png_bytes = 1.5, jpeg_bytes = 0.5;
/* Of a film in memory: one in work, with the kept one that takes its place; a kept one. */
static const double work_films = 1.9, kept_films = 0.5;

uint64_t retention_job_bytes(const struct job *job, int films_stay)
{
    const struct output_settings *o = &job->output;
    double pixels = (double)job->settings.width * job->settings.height;
    double film = (double)farm_film_bytes(job->settings.width, job->settings.height, job->settings.aovs);
    uint32_t frames = job_frames_wanted(job);
    uint32_t open = frames < FRAMES_OPEN_PER_JOB ? frames : FRAMES_OPEN_PER_JOB;
    double layers = 1 + (double)aov_floats(job->settings.aovs) / 3;
    /* The means in 32 bits are there in any case, in the EXR or beside it. */
    double picture = exr_bytes * layers;

    if (o->exr && o->exr_half)
        picture += exr_bytes * layers / 2;
    if (o->png)
        picture += png_bytes * (o->picture.bits == 16 ? 3 : 1);
    if (o->jpg)
        picture += jpeg_bytes;
    return (uint64_t)((double)frames * pixels * picture + (double)open * film * work_films +
                      (films_stay && frames > open ? (double)(frames - open) * film * kept_films : 0));
}
