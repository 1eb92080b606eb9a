/* farm_pictures: a frame's pictures are made, and those of stored frames are made again when the
 * output settings change; the last one ends the job. */
#include <stdio.h>

#include "common/system/log.h"
#include "coordinator/farm/closing.h"
#include "coordinator/farm/farm.h"

void farm_job_end_when_done(struct farm *farm, struct job *job, uint64_t now_ns)
{
    if (job_state_ended(job->state) || job->state == JOB_STATE_CANCELLING || job->state == JOB_STATE_FINISHING ||
        job->frames_done_count < job_frames_wanted(job) || job->frames_developed_count < job->frames_done_count)
        return;
    if (job->state == JOB_STATE_PARKED || job->state == JOB_STATE_PAUSED)
        job_set_state(&farm->queue, job, JOB_STATE_QUEUED, NULL, now_ns, farm->wall_s);
    if (job->state == JOB_STATE_QUEUED) /* all of it came back from disk */
        job_set_state(&farm->queue, job, JOB_STATE_RUNNING, NULL, now_ns, farm->wall_s);
    log_info("job %llu (%s) is done", (unsigned long long)job->id, job->name);
    farm_job_change(farm, job, JOB_STATE_DONE, NULL, now_ns);
}

void farm_pictures_wanted(struct farm *farm, struct job *job)
{
    struct job **at = &farm->to_develop;

    if (job->to_develop || job->frames_developed_count == job->frames_done_count)
        return;
    while (*at)
        at = &(*at)->next_to_develop;
    *at = job;
    job->next_to_develop = NULL;
    job->to_develop = 1;
}

void farm_pictures_unwanted(struct farm *farm, struct job *job)
{
    struct job **at = &farm->to_develop;

    while (*at && *at != job)
        at = &(*at)->next_to_develop;
    if (*at)
        *at = job->next_to_develop;
    job->to_develop = 0;
}

void farm_pictures_next(struct farm *farm, uint64_t now_ns)
{
    if (farm->developing || trouble_is(&farm->trouble))
        return;
    for (struct job *job = farm->to_develop; job; job = job->next_to_develop) {
        uint32_t frame;

        if (trouble_waits(&job->pictures, now_ns) || !job_frame_to_develop(job, &frame))
            continue;
        if (farm->events.redevelop(farm->events.user, job, frame) == STATUS_OK)
            farm->developing = job;
        return;
    }
}

status farm_develop(struct farm *farm, struct job *job, const struct output_settings *output, struct error *err)
{
    struct job revised = *job;

    revised.output = *output;
    revised.output.exr = job->output.exr;
    revised.output.exr_half = job->output.exr_half;
    revised.revision++;
    if (farm->store)
        TRY(store_job_revise(farm->store, &revised, err));
    job_revise(job, &revised.output);
    log_info("job %llu (%s) is developed with %s", (unsigned long long)job->id, job->name,
             job->output.tonemap.op->name);
    farm_pictures_wanted(farm, job);
    farm->events.job_changed(farm->events.user, job);
    return STATUS_OK;
}

/* Try a picture again later, or give up the job's pictures. */
static void develop_failed(struct farm *farm, struct job *job, uint32_t frame, const struct error *why, uint64_t now_ns)
{
    char text[sizeof job->pictures.text];

    /* A damaged picture is made again (coordinator/steering/remake.h). */
    if (status_is_environment(why->code) ||
        (why->code == STATUS_ERR_CORRUPT && farm->store && store_film_exists(farm->store, job->id, frame))) {
        farm_trouble(farm, job, frame, &job->pictures, "", why, now_ns);
        return;
    }
    snprintf(text, sizeof text, "frame %u: %.200s", frame, why->text);
    (void)trouble_note(&job->pictures, text, now_ns);
    job->pictures.next_ns = UINT64_MAX;
    log_error("job %llu: the picture of frame %u cannot be made: %s", (unsigned long long)job->id, frame, why->text);
    farm_pictures_unwanted(farm, job);
    if (!job_state_ended(job->state))
        farm_fail(farm, job, now_ns, "the picture of %s", text);
}

void farm_pictures_made(struct farm *farm, struct job *job, uint32_t frame, int64_t revision, status result,
                        const struct error *why, uint64_t now_ns)
{
    farm->developing = NULL;
    if (job->removed) {
        farm_job_dispose(farm, job);
        farm_pictures_next(farm, now_ns);
        return;
    }
    if (revision == (int64_t)job->revision && result == STATUS_OK) {
        job_frame_set_developed(job, frame);
        farm_trouble_over(farm, job, &job->pictures, now_ns);
    } else if (revision == (int64_t)job->revision) {
        develop_failed(farm, job, frame, why, now_ns);
    }
    if (job->frames_developed_count == job->frames_done_count)
        farm_pictures_unwanted(farm, job);
    farm_job_end_when_done(farm, job, now_ns);
    farm->events.job_changed(farm->events.user, job);
    farm_pictures_next(farm, now_ns);
    closing_step(farm, job, now_ns);
}

void farm_frame_developed(struct farm *farm, struct job_frame *frame, int64_t revision, status result,
                          const struct error *why, uint64_t now_ns)
{
    struct job *job = frame->job;
    uint32_t number = frame->number;
    struct film_coverage coverage;
    struct unit_work work;
    enum frame_end end = frame->end;
    struct error err = {0};

    if (frame->closing) {
        farm_frame_unpin(farm, frame);
        return;
    }
    if (frame->returns) { /* whatever the store noted is deleted there, or was refused */
        farm_frame_unpin(farm, frame);
        farm_frame_leave(farm, frame, now_ns);
        return;
    }
    if (result != STATUS_OK) {
        farm_frame_unpin(farm, frame);
        job_frame_set_state(frame, FRAME_COMPLETE);
        if (status_is_environment(result))
            farm_trouble(farm, job, number, &frame->trouble, "cannot be written", why, now_ns);
        else
            farm_fail(farm, job, now_ns, "frame %u cannot be written: %s", number, why->text);
        return;
    }
    farm_trouble_over(farm, job, &frame->trouble, now_ns);
    coverage = film_coverage(frame->film);
    work = film_work(frame->film);
    health_of_frame(&work.health, number);
    unit_work_add(&job->work, &work);
    farm_frame_unpin(farm, frame);
    farm_frame_close(farm, frame, "the frame is done");
    farm->counts.frames++;
    job_frame_set_done(job, number);
    if (coverage.samples < job_frame_samples(job) && job_frame_set_cut(job, number, end, &coverage, &err) != STATUS_OK)
        log_error("job %llu, frame %u: %s", (unsigned long long)job->id, number, err.text);
    if (revision == (int64_t)job->revision)
        job_frame_set_developed(job, number);
    log_info("job %llu (%s), frame %u is done: %u of %u", (unsigned long long)job->id, job->name, number,
             job->frames_done_count, job_frame_count(job));
    farm_wake(farm);
    farm_pictures_wanted(farm, job);
    farm_job_end_when_done(farm, job, now_ns);
    if (!job_state_ended(job->state))
        farm->events.job_changed(farm->events.user, job);
    farm_pictures_next(farm, now_ns);
    closing_step(farm, job, now_ns);
}
