/* farm_jobs: how a job changes its state, on disk and for its watchers. */
#include <stdio.h>
#include <string.h>

#include "common/system/log.h"
#include "coordinator/farm/farm.h"

/* The store's thread writes it soon; nothing here waits for the disk. What a person did must not be undone by a
 * crash, so the answer is sent when it is on disk (session_answer_change). Everything else may be lost in a crash:
 * counters are estimates, and a job with nothing left to render is ended again at the start. The pinned ray tracer is on
 * disk before any result: see merge_commit_run. */
void farm_job_save(struct farm *farm, struct job *job, uint64_t now_ns)
{
    struct error err = {0};
    status s;

    job->saved_ns = now_ns;
    job->unsaved = 0;
    if (!farm->store)
        return;
    s = store_job_save_later(farm->store, job, now_ns, &err);
    job->unsaved = s != STATUS_OK;
    farm->unsaved |= job->unsaved;
    if (job->unsaved)
        log_debug("job %llu: its state cannot be stored now: %s", (unsigned long long)job->id, err.text);
}

void farm_event(struct farm *farm, const struct job_event *event)
{
    struct job_event noted = *event;

    noted.seq = store_event_later(farm->store, event);
    if (farm->events.job_event)
        farm->events.job_event(farm->events.user, &noted);
}

void farm_note(struct farm *farm, const struct job *job, const char *who, const char *format, ...)
{
    struct job_event event = {.job = job->id, .at = farm->wall_s};
    va_list args;

    if (!farm->store)
        return;
    snprintf(event.who, sizeof event.who, "%s", who ? who : "coordinator");
    va_start(args, format);
    vsnprintf(event.text, sizeof event.text, format, args);
    va_end(args);
    farm_event(farm, &event);
}

void farm_job_dispose(struct farm *farm, struct job *job)
{
    if (!job->removed || job->closing_frames > 0 || job->measurements > 0 || farm->developing == job)
        return;
    if (farm->store)
        store_job_clear(farm->store, job->id);
    trace_forget(&farm->trace, job->id);
    job_free(job);
}

/* What people read in the job's log. */
static void note_state(struct farm *farm, const struct job *job)
{
    switch (job->state) {
    case JOB_STATE_DONE:
        farm_note(farm, job, NULL, "done%s%s: %u of %u frames", job->state_text[0] ? ", " : "",
                  job->state_text, job->frames_done_count, job_frame_count(job));
        return;
    case JOB_STATE_FAILED:
        farm_note(farm, job, NULL, "failed: %s", job->state_text);
        return;
    case JOB_STATE_CANCELLED:
        farm_note(farm, job, NULL, "%s: %u of %u frames have a picture", job->state_text,
                  job->frames_done_count, job_frame_count(job));
        return;
    case JOB_STATE_PARKED:
        farm_note(farm, job, NULL, "parked: %s", job->state_text);
        return;
    default: /* a person did it, and is named */
        return;
    }
}

void farm_job_change(struct farm *farm, struct job *job, enum job_state state, const char *text, uint64_t now_ns)
{
    int ends = job_state_ended(state);

    while (ends && job->frames)
        farm_frame_close(farm, job->frames, "the job ended");
    job_set_state(&farm->queue, job, state, text, now_ns, farm->wall_s);
    farm->counts.jobs[state]++;
    if (farm->events.job_state)
        farm->events.job_state(farm->events.user, job);
    note_state(farm, job);
    farm_job_save(farm, job, now_ns); /* its films are removed when that is on disk */
    farm_wake(farm);
    farm->events.job_changed(farm->events.user, job);
}

void farm_fail(struct farm *farm, struct job *job, uint64_t now_ns, const char *format, ...)
{
    char text[JOB_TEXT_MAX + 1];
    va_list args;

    if (job_state_ended(job->state))
        return;
    va_start(args, format);
    vsnprintf(text, sizeof text, format, args);
    va_end(args);
    log_error("job %llu (%s) failed: %s", (unsigned long long)job->id, job->name, text);
    farm_job_change(farm, job, JOB_STATE_FAILED, text, now_ns);
}

void farm_job_started(struct farm *farm, struct job *job, const struct farm_worker *worker, uint64_t now_ns)
{
    int changed = 0;

    job_start_clock(job, now_ns);
    /* The pinned ray tracer changes: the workers that held its units disconnected without a result. */
    if (strcmp(job->ray_tracer, worker->ray_tracer) != 0) {
        /* A job without one is QUEUED: its change to RUNNING moves it to its new lane (candidates.h). */
        snprintf(job->ray_tracer, sizeof job->ray_tracer, "%s", worker->ray_tracer);
        snprintf(job->release, sizeof job->release, "%s", AZULEJO_VERSION);
        changed = 1;
    }
    if (job->state == JOB_STATE_QUEUED) {
        job_set_state(&farm->queue, job, JOB_STATE_RUNNING, NULL, now_ns, farm->wall_s);
        log_info("job %llu (%s) runs", (unsigned long long)job->id, job->name);
        farm_note(farm, job, NULL, "runs, first on %s", worker->name);
        changed = 1;
    }
    if (!changed)
        return;
    farm_job_save(farm, job, now_ns);
    farm->events.job_changed(farm->events.user, job);
}
