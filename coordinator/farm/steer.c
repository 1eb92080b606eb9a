#include "coordinator/farm/steer.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "common/base/log.h"
#include "common/base/memory.h"
#include "coordinator/farm/closing.h"
#include "coordinator/farm/retarget.h"
#include "coordinator/farm/waiting.h"

/* ERR_REFUSED: what cannot be done to a job in its state, and what can. */
static status refuse(const struct job *job, const char *what, struct error *err)
{
    static const char *const remedies[JOB_STATE_COUNT] = {
        [JOB_STATE_QUEUED] = "it goes on by itself; 'pause' or 'cancel' stops it",
        [JOB_STATE_RUNNING] = "it goes on by itself; 'pause' or 'cancel' stops it",
        [JOB_STATE_DONE] = "'extend' gives it more samples, 'retry --frames' makes frames again",
        [JOB_STATE_FAILED] = "'retry' goes on with it",
        [JOB_STATE_CANCELLED] = "'retry' goes on with it",
        [JOB_STATE_PARKED] = "its workers died or hung: 'resume' tries again, 'cancel' ends it",
        [JOB_STATE_CANCELLING] = "wait until its pictures are made",
        [JOB_STATE_PAUSED] = "'resume' goes on with it, 'cancel' ends it",
        [JOB_STATE_FINISHING] = "it ends with the first pass of its frames in work; 'cancel' ends it now",
    };

    return error_set(err, STATUS_ERR_REFUSED, "job %" PRIu64 " is %s and cannot be %s: %s", job->id,
                     job_state_word(job->state), what, remedies[job->state]);
}

status steer_pause(struct farm *farm, struct job *job, const char *who, uint64_t now_ns,
                   struct error *err)
{
    char text[JOB_WHO_MAX + 16];

    if (job->state == JOB_STATE_PAUSED)
        return STATUS_OK;
    if (job->state != JOB_STATE_QUEUED && job->state != JOB_STATE_RUNNING)
        return refuse(job, "paused", err);
    snprintf(text, sizeof text, "paused by %s", who);
    log_info("job %" PRIu64 " (%s) is %s", job->id, job->name, text);
    farm_job_revoke(farm, job, "the job is paused");
    farm_note(farm, job, who, "paused");
    farm_job_change(farm, job, JOB_STATE_PAUSED, text, now_ns);
    farm_job_save(farm, job, now_ns);
    closing_step(farm, job, now_ns);
    return STATUS_OK;
}

status steer_resume(struct farm *farm, struct job *job, const char *who, uint64_t now_ns,
                    struct error *err)
{
    if (job->state != JOB_STATE_PAUSED && job->state != JOB_STATE_PARKED)
        return refuse(job, "resumed", err);
    log_info("job %" PRIu64 " (%s) is resumed by %s", job->id, job->name, who);
    suspicion_clear(&job->suspicion);
    hangs_clear(&job->hangs);
    job->broken_count = 0;
    farm_note(farm, job, who, "resumed");
    farm_job_change(farm, job, JOB_STATE_QUEUED, NULL, now_ns);
    farm_job_save(farm, job, now_ns);
    return STATUS_OK;
}

status steer_finish(struct farm *farm, struct job *job, const char *who, uint64_t now_ns,
                    struct error *err)
{
    if (job->state == JOB_STATE_FINISHING)
        return STATUS_OK;
    if (job->state != JOB_STATE_QUEUED && job->state != JOB_STATE_RUNNING &&
        job->state != JOB_STATE_PAUSED)
        return refuse(job, "finished", err);
    if (!closing_has_begun(farm, job))
        return error_set(err, STATUS_ERR_REFUSED,
                         "job %" PRIu64 " has no frame in work that could be finished: 'cancel' it instead",
                         job->id);
    log_info("job %" PRIu64 " (%s) is finished early by %s", job->id, job->name, who);
    farm_note(farm, job, who, "finish: frames in work complete their first pass");
    farm_job_change(farm, job, JOB_STATE_FINISHING, NULL, now_ns);
    farm_job_save(farm, job, now_ns);
    closing_step(farm, job, now_ns);
    return STATUS_OK;
}

void steer_cancel(struct farm *farm, struct job *job, int discard, const char *who, uint64_t now_ns)
{
    if (!job_state_ended(job->state) && (job->state != JOB_STATE_CANCELLING || discard))
        farm_note(farm, job, who, "cancel%s", discard ? ", discarding unfinished frames" : "");
    else if (discard)
        farm_note(farm, job, who, "discard: its films are removed");
    farm_cancel(farm, job, discard, now_ns);
}

status steer_priority(struct farm *farm, struct job *job, int32_t priority, const char *who,
                      uint64_t now_ns, struct error *err)
{
    int32_t before = job->priority;

    if (job_state_ended(job->state))
        return refuse(job, "served earlier or later", err);
    if (priority == before)
        return STATUS_OK;
    queue_set_priority(&farm->queue, job, priority);
    farm_note(farm, job, who, "priority %d, was %d", priority, before);
    farm_job_save(farm, job, now_ns);
    farm->pump_wanted = 1;
    farm->events.job_changed(farm->events.user, job);
    return STATUS_OK;
}

status steer_start(struct farm *farm, struct job *job, const char *who, uint64_t now_ns, struct error *err)
{
    if (job_state_ended(job->state))
        return refuse(job, "started", err);
    if (job->needs.after_count == 0 && job->needs.not_before == 0)
        return STATUS_OK;
    waiting_end(farm, job);
    log_info("job %" PRIu64 " (%s) is started by %s, whatever it waited for", job->id, job->name, who);
    farm_note(farm, job, who, "started: it waits for no other job and for no time");
    farm_job_save(farm, job, now_ns);
    farm->events.job_changed(farm->events.user, job);
    return STATUS_OK;
}

/* ---- extend ---------------------------------------------------------------------------------- */

static void note_rules(struct farm *farm, const struct job *job, const char *who, const struct stop_rules *before,
                       uint32_t spp_before, const struct retarget_result *result)
{
    char now[STOP_RULES_TEXT_SIZE], was[STOP_RULES_TEXT_SIZE], frames[128] = "";

    if (result->reopened > 0)
        snprintf(frames, sizeof frames, "; %" PRIu32 " done frame%s go%s on", result->reopened,
                 result->reopened == 1 ? "" : "s", result->reopened == 1 ? "es" : "");
    else if (result->without_film > 0)
        snprintf(frames, sizeof frames, "; done frames whose films were not kept stay as they are");
    stop_rules_text(now, &job->stop, job->settings.spp);
    stop_rules_text(was, before, spp_before);
    log_info("job %" PRIu64 " (%s) is extended by %s to %s, was %s%s", job->id, job->name, who, now, was, frames);
    farm_note(farm, job, who, "extended to %s, was %s%s", now, was, frames);
}

status steer_extend(struct farm *farm, struct job *job, const struct job_extension *extension, const char *who,
                    uint64_t now_ns, struct error *err)
{
    const struct stop_rules before = job->stop;
    uint32_t spp_before = job->settings.spp;
    struct retarget_result result = {0};
    status s = retarget_takes(job->state) ? farm_retarget(farm, job, extension, &result, now_ns, err)
                                          : farm_extend(farm, job, extension, err);

    if (s != STATUS_OK || result.same)
        return s;
    note_rules(farm, job, who, &before, spp_before, &result);
    farm_job_save(farm, job, now_ns);
    return STATUS_OK;
}

/* ---- retry ----------------------------------------------------------------------------------- */

static int is_cut_by_a_person(const struct job *job, uint32_t frame)
{
    for (size_t i = 0; i < job->cut_count; i++)
        if (job->cuts[i].frame == frame)
            return job->cuts[i].end == FRAME_END_CANCEL || job->cuts[i].end == FRAME_END_FINISH;
    return 0;
}

/* The frames that go on if none are named; the caller frees them. */
static status unfinished_frames(const struct job *job, uint32_t **out, size_t *count,
                                struct error *err)
{
    *count = 0;
    *out = mem_alloc_array(job_frame_count(job), sizeof **out);
    if (!*out)
        return error_no_memory(err, "frames to try again");
    for (uint64_t at = job->first_frame; at <= job->last_frame; at++) {
        uint32_t frame = (uint32_t)at;
        if (job_frame_is_done(job, frame) ? is_cut_by_a_person(job, frame)
                                          : !job_frame_is_resting(job, frame))
            (*out)[(*count)++] = frame;
    }
    if (*count == 0 && job->state == JOB_STATE_DONE)
        return refuse(job, "tried again", err);
    if (*count == 0)
        return error_set(err, STATUS_ERR_REFUSED,
                         "job %" PRIu64 " has all of its frames: name those to try again (--frames)",
                         job->id);
    return STATUS_OK;
}

/* Of those that are not done, only the chosen ones are rendered. */
static void rest_others(struct job *job, const struct job_reopening *chosen)
{
    for (uint64_t at = job->first_frame; at <= job->last_frame; at++) {
        uint32_t frame = (uint32_t)at;
        if (job_reopening_has(chosen, job, frame))
            job_frame_wake(job, frame);
        else if (!job_frame_is_done(job, frame))
            job_frame_rest(job, frame);
    }
}

static status reopen(struct farm *farm, struct job *job, const struct job_reopening *chosen,
                     struct error *err)
{
    size_t bytes = job_frame_count(job) / 8 + 1;
    uint32_t resting_count = job->frames_resting_count;
    uint8_t *resting = mem_alloc(bytes);
    struct job before;
    status s;

    if (!resting)
        return error_no_memory(err, "frames to try again");
    memcpy(resting, job->frames_resting, bytes);
    rest_others(job, chosen);
    before = *job;
    s = farm_go_on(farm, job, &before, chosen, NULL, err);
    if (s != STATUS_OK) {
        memcpy(job->frames_resting, resting, bytes);
        job->frames_resting_count = resting_count;
    }
    mem_free(resting);
    return s;
}

status steer_retry(struct farm *farm, struct job *job, const uint32_t *frames, size_t count,
                   const char *who, struct error *err)
{
    struct job_reopening chosen = {0};
    uint32_t *unfinished = NULL;
    size_t named = count;
    status s = STATUS_OK;

    if (!job_state_ended(job->state))
        return refuse(job, "tried again", err);
    if (job->release[0])
        s = extend_check_release(job, err);
    if (s == STATUS_OK && count == 0) {
        s = unfinished_frames(job, &unfinished, &count, err);
        frames = unfinished;
    }
    if (s == STATUS_OK)
        s = job_reopening_init(&chosen, job, frames, count, job->settings.spp, err);
    if (s == STATUS_OK)
        s = farm_store_usable(farm, err);
    if (s == STATUS_OK)
        s = job_reopen_check(&farm->queue, job, err);
    if (s == STATUS_OK)
        s = reopen(farm, job, &chosen, err);
    if (s == STATUS_OK) {
        suspicion_clear(&job->suspicion);
        job->broken_count = 0;
        log_info("job %" PRIu64 " (%s) is tried again by %s", job->id, job->name, who);
        farm_note(farm, job, who, "retry: %zu frame%s%s", count, count == 1 ? "" : "s",
                  named ? ", chosen" : "");
    }
    job_reopening_release(&chosen);
    mem_free(unfinished);
    return s;
}

/* ---- remove ---------------------------------------------------------------------------------- */

status steer_remove(struct farm *farm, struct job *job, const char *who, uint64_t now_ns,
                    struct error *err)
{
    status s = STATUS_OK;

    if (!job_state_ended(job->state))
        return error_set(err, STATUS_ERR_REFUSED,
                         "job %" PRIu64 " is %s and cannot be removed: 'cancel' it first", job->id,
                         job_state_word(job->state));
    waiting_settle(farm, now_ns); /* while it is there */
    if (farm->store)
        s = store_job_remove(farm->store, job->id, err);
    if (s != STATUS_OK)
        return s;
    log_info("job %" PRIu64 " (%s) of %s is removed by %s", job->id, job->name,
             job->owner[0] ? job->owner : "nobody known", who);
    farm_pictures_unwanted(farm, job);
    queue_remove(&farm->queue, job);
    job->removed = 1;
    if (farm->events.job_removed)
        farm->events.job_removed(farm->events.user, job->id);
    farm_job_dispose(farm, job);
    return STATUS_OK;
}
