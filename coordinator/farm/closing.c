#include "coordinator/farm/closing.h"

#include <stdio.h>

#include "common/system/clock.h"
#include "common/system/log.h"

/* Everything that was merged is on disk, and acknowledged. */
static int frame_is_settled(const struct job_frame *frame) { return frame->dirty_count == 0 && frame->in_flight == 0; }

void closing_note_limits(struct farm *farm, struct job_frame *frame, uint64_t now_ns)
{
    const struct stop_rules *rules = &frame->job->stop;

    if (frame->end != FRAME_END_NONE || !film_covered(frame->film))
        return;
    if (rules->time_limit_ms > 0 &&
        job_frame_active_ns(frame, now_ns) - frame->clock.from_active_ns >= rules->time_limit_ms * NS_PER_MS)
        farm_frame_end(farm, frame, FRAME_END_TIME);
    else if (rules->core_limit_ms > 0 &&
             job_frame_cpu_ns(frame) - frame->clock.from_cpu_ns >= rules->core_limit_ms * NS_PER_MS)
        farm_frame_end(farm, frame, FRAME_END_CORES);
    else if (rules->max_rays > 0 && film_rays(frame->film) >= rules->max_rays)
        farm_frame_end(farm, frame, FRAME_END_RAYS);
}

/* A cancelled job's frame: closed, or on its way to its pictures. */
static void frame_cut(struct farm *farm, struct job_frame *frame, uint64_t now_ns)
{
    const struct job *job = frame->job;
    uint32_t number = frame->number;

    if (frame->state != FRAME_RENDERING)
        return;
    if (film_samples(frame->film) == 0) {
        farm_frame_close(farm, frame, "the job was cancelled");
        if (farm->store)
            store_film_remove(farm->store, job->id, number);
        return;
    }
    farm_frame_end(farm, frame, FRAME_END_CANCEL);
    farm_frame_advance(farm, frame, now_ns);
}

/* Open the next film that is on disk. 0: there is none. */
static int open_next_film(struct farm *farm, struct job *job, uint64_t now_ns)
{
    for (uint64_t number = job->first_frame; farm->store && number <= job->last_frame; number++) {
        if (job_frame_is_done(job, (uint32_t)number) || !store_film_exists(farm->store, job->id, (uint32_t)number))
            continue;
        (void)farm_frame_open(farm, job, (uint32_t)number, now_ns);
        return 1;
    }
    return 0;
}

static void cut_frames(struct farm *farm, struct job *job, uint64_t now_ns)
{
    for (struct job_frame *frame = job->frames, *next; frame; frame = next) {
        next = frame->next;
        frame_cut(farm, frame, now_ns);
    }
}

/* The cancel came when the last picture was being made. */
static int left_out_nothing(const struct job *job)
{
    for (size_t i = 0; i < job->cut_count; i++)
        if (job->cuts[i].end == FRAME_END_CANCEL)
            return 0;
    return job->frames_done_count == job_frames_wanted(job);
}

static void cancelling_step(struct farm *farm, struct job *job, uint64_t now_ns)
{
    uint32_t frame;

    /* A film whose folder cannot be read may still exist. */
    if (trouble_is(&farm->trouble) && job->ray_tracer[0])
        return;
    cut_frames(farm, job, now_ns);
    while (!job->frames) {
        if (!open_next_film(farm, job, now_ns))
            break;
        if (job->state != JOB_STATE_CANCELLING || !job->frames)
            return; /* it could not be opened, or it waits for space */
        cut_frames(farm, job, now_ns);
    }
    if (job->frames || (job->pictures.next_ns != UINT64_MAX && job_frame_to_develop(job, &frame)))
        return;
    if (left_out_nothing(job)) {
        log_info("job %llu (%s) is done: it was cancelled when all of its frames had been rendered",
                 (unsigned long long)job->id, job->name);
        farm_job_change(farm, job, JOB_STATE_DONE, NULL, now_ns);
        return;
    }
    log_info("job %llu (%s) was cancelled: %u of %u frames have a picture, %zu of them cut short",
             (unsigned long long)job->id, job->name, job->frames_done_count, job_frame_count(job), job->cut_count);
    farm_job_change(farm, job, JOB_STATE_CANCELLED, "cancelled", now_ns);
}

/* ---- finishing ------------------------------------------------------------------------------- */

static int has_open_film(const struct farm *farm, const struct job *job)
{
    for (uint64_t number = job->first_frame; farm->store && number <= job->last_frame; number++)
        if (!job_frame_is_done(job, (uint32_t)number) && store_film_exists(farm->store, job->id, (uint32_t)number))
            return 1;
    return 0;
}

int closing_has_begun(const struct farm *farm, const struct job *job)
{
    return job->frames || has_open_film(farm, job);
}

/* Did the finish leave out samples that the job's rules want? */
static int is_early(const struct job *job)
{
    for (size_t i = 0; i < job->cut_count; i++)
        if (job->cuts[i].end == FRAME_END_FINISH)
            return 1;
    return job->frames_done_count < job_frames_wanted(job);
}

static void finishing_end(struct farm *farm, struct job *job, uint64_t now_ns)
{
    int early = is_early(job);

    if (early)
        job_mark(job, JOB_MARK_EARLY);
    log_info("job %llu (%s) is done%s: %u of %u frames", (unsigned long long)job->id, job->name,
             early ? ", finished early" : "", job->frames_done_count, job_frame_count(job));
    farm_job_change(farm, job, JOB_STATE_DONE, early ? "finished early" : NULL, now_ns);
}

static void finishing_step(struct farm *farm, struct job *job, uint64_t now_ns)
{
    uint32_t waits;

    if (trouble_is(&farm->trouble)) /* a film whose folder cannot be read may still exist */
        return;
    for (struct job_frame *frame = job->frames, *next; frame; frame = next) {
        next = frame->next;
        if (frame->state == FRAME_RENDERING && film_covered(frame->film)) {
            farm_frame_end(farm, frame, FRAME_END_FINISH);
            farm_frame_advance(farm, frame, now_ns);
        }
    }
    if (!job->frames && open_next_film(farm, job, now_ns)) {
        farm_wake(farm);
        return; /* the next step looks at it, or tries again */
    }
    if (!job->frames && job->state == JOB_STATE_FINISHING &&
        (job->pictures.next_ns == UINT64_MAX || !job_frame_to_develop(job, &waits)))
        finishing_end(farm, job, now_ns);
}

void closing_begin(struct farm *farm, struct job *job, uint64_t now_ns)
{
    farm_job_revoke(farm, job, "the job was cancelled");
    farm_job_change(farm, job, JOB_STATE_CANCELLING, "cancelled", now_ns);
    closing_step(farm, job, now_ns);
}

static void park(struct farm *farm, struct job *job, const char *text, uint64_t now_ns)
{
    log_error("job %llu (%s) is parked: %s", (unsigned long long)job->id, job->name, text);
    farm_job_revoke(farm, job, "the job is parked");
    farm_job_change(farm, job, JOB_STATE_PARKED, text, now_ns);
    closing_step(farm, job, now_ns);
}

static void park_for_deaths(struct farm *farm, struct job *job, uint64_t now_ns)
{
    char text[JOB_TEXT_MAX + 1];

    snprintf(text, sizeof text,
             "%u workers in a row died while they held its work, without a result (on %s); see "
             "their logs, then 'azulejo resume %llu' or 'azulejo cancel %llu'",
             job->suspicion.deaths, job->suspicion.several ? "several machines" : "one machine",
             (unsigned long long)job->id, (unsigned long long)job->id);
    park(farm, job, text, now_ns);
}

struct job *closing_suspected(const struct farm *farm UNUSED, const struct farm_worker *worker, uint64_t *lent_ns)
{
    for (const struct lease *lease = worker->held.oldest; lease; lease = lease->holder_newer) {
        if (lease->frame->job->id == worker->delivered_job)
            continue;
        *lent_ns = lease->granted_ns;
        return lease->frame->job;
    }
    return NULL;
}

void closing_note_death(struct farm *farm, struct job *job, const struct farm_worker *worker, uint64_t lent_ns,
                        uint64_t now_ns)
{
    struct suspicion *suspicion = &job->suspicion;

    if (!suspicion_add(suspicion, worker->machine, lent_ns, now_ns))
        return;
    log_warn("job %llu (%s): session %u was lost while it held work of this job, number %u in a row without a result; the job is lent to one worker at a time until a result comes",
             (unsigned long long)job->id, job->name, worker->held.session, suspicion->deaths);
    farm_note(farm, job, NULL, "%s was lost while it held work, number %u in a row without a result",
              worker->name, suspicion->deaths);
    if (suspicion_is_enough(suspicion) && job_state_is_open(job->state))
        park_for_deaths(farm, job, now_ns);
}

void closing_note_hang(struct farm *farm, struct job *job, const struct hang_unit *unit, uint64_t now_ns)
{
    char text[JOB_TEXT_MAX + 1];

    snprintf(text, sizeof text,
             "%u workers hung on one work unit (frame %u, tile %u, group %u, pass %u); restart them, then "
             "'azulejo resume %llu' or 'azulejo cancel %llu'",
             unit->session_count, unit->frame, unit->tile, unit->group, unit->pass, (unsigned long long)job->id,
             (unsigned long long)job->id);
    park(farm, job, text, now_ns);
}

void closing_step(struct farm *farm, struct job *job, uint64_t now_ns)
{
    if (job->state == JOB_STATE_CANCELLING)
        cancelling_step(farm, job, now_ns);
    if (job->state == JOB_STATE_FINISHING)
        finishing_step(farm, job, now_ns);
    if (job->state != JOB_STATE_PARKED && job->state != JOB_STATE_PAUSED)
        return;
    for (struct job_frame *frame = job->frames, *next; frame; frame = next) {
        next = frame->next;
        if (frame->state == FRAME_RENDERING && frame_is_settled(frame))
            farm_frame_close(farm, frame, job->state == JOB_STATE_PAUSED ? "the job is paused" : "the job is parked");
    }
}
