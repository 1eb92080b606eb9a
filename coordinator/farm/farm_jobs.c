/* farm_jobs: how a job changes its state, on disk and for its watchers. */
#include <stdio.h>
#include <string.h>

#include "common/base/log.h"
#include "coordinator/farm/farm.h"

/* A cancelled job must not return after a crash, so a cancel waits for the disk. Everything else
 * may be lost in a crash: counters are estimates, and a job with nothing left to render is ended
 * again at the start. The pinned kernel is on disk before any result: see merge_commit_run. */
void farm_job_save(struct farm *farm, struct job *job, uint64_t now_ns)
{
    struct error err = {0};
    status s = STATUS_OK;

    job->saved_ns = now_ns;
    job->unsaved = 0;
    if (!farm->store)
        return;
    if ((job->state != JOB_STATE_CANCELLED && job->state != JOB_STATE_CANCELLING) ||
        store_job_save(farm->store, job, now_ns, &err) != STATUS_OK)
        s = store_job_save_later(farm->store, job, now_ns, &err);
    job->unsaved = s != STATUS_OK;
    farm->unsaved |= job->unsaved;
    if (job->unsaved)
        log_debug("job %llu: its state cannot be stored now: %s", (unsigned long long)job->id,
                  err.text);
}

void farm_job_change(struct farm *farm, struct job *job, enum job_state state, const char *text,
                     uint64_t now_ns)
{
    int ends = job_state_ended(state);

    while (ends && job->frames)
        farm_frame_close(farm, job->frames, "the job ended");
    job_set_state(&farm->queue, job, state, text, now_ns, farm->wall_s);
    farm_job_save(farm, job, now_ns); /* its films are removed when that is on disk */
    farm->pump_wanted = 1;
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

void farm_job_started(struct farm *farm, struct job *job, const struct farm_worker *worker,
                      uint64_t now_ns)
{
    int changed = 0;

    if (!job->active_since_ns)
        job->active_since_ns = now_ns ? now_ns : 1;
    /* The pinned kernel changes: the workers that held its units disconnected without a result. */
    if (strcmp(job->kernel, worker->kernel) != 0) {
        snprintf(job->kernel, sizeof job->kernel, "%s", worker->kernel);
        snprintf(job->release, sizeof job->release, "%s", AZULEJO_VERSION);
        changed = 1;
    }
    if (job->state == JOB_STATE_QUEUED) {
        job_set_state(&farm->queue, job, JOB_STATE_RUNNING, NULL, now_ns, farm->wall_s);
        log_info("job %llu (%s) runs", (unsigned long long)job->id, job->name);
        changed = 1;
    }
    if (!changed)
        return;
    farm_job_save(farm, job, now_ns);
    farm->events.job_changed(farm->events.user, job);
}
