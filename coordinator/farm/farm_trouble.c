/* The farm while it cannot use its store: a failure is noted and tried again, without limit.
 * trouble.h has the states. */
#include <inttypes.h>
#include <stdio.h>

#include "common/system/log.h"
#include "coordinator/farm/farm.h"

static void tell_jobs(struct farm *farm)
{
    for (size_t i = 0; i < farm->queue.active_count; i++)
        farm->events.job_changed(farm->events.user, farm->queue.active[i]);
}

static void store_failed(struct farm *farm, const struct error *why, uint64_t now_ns)
{
    if (!trouble_note(&farm->trouble, why->text, now_ns))
        return;
    log_error("the store cannot be used: %s; jobs wait, and the coordinator keeps trying", why->text);
    tell_jobs(farm);
}

void farm_trouble(struct farm *farm, const struct job *job, uint32_t frame, struct trouble *trouble, const char *what,
                  const struct error *why, uint64_t now_ns)
{
    char text[sizeof trouble->text];
    struct error store_why = {0};

    if (farm->store && !trouble_is(&farm->trouble) && store_check(farm->store, &store_why) != STATUS_OK)
        store_failed(farm, &store_why, now_ns);
    snprintf(text, sizeof text, "frame %u%s%s: %.200s", frame, what[0] ? " " : "", what, why->text);
    if (!trouble_note(trouble, text, now_ns) && !trouble->quiet)
        return;
    queue_frames_changed(&farm->queue, (struct job *)job);
    trouble->quiet = trouble_is(&farm->trouble);
    if (!trouble->quiet)
        farm_note(farm, job, NULL, "waits: %s", text);
    if (!trouble->quiet)
        log_error("job %" PRIu64 ", %s; the coordinator keeps trying", job->id, text);
    farm->events.job_changed(farm->events.user, (struct job *)job);
}

void farm_trouble_over(struct farm *farm, struct job *job, struct trouble *trouble, uint64_t now_ns)
{
    int quiet = trouble->quiet;
    uint64_t lasted_ns;

    if (!trouble_end(trouble, now_ns, &lasted_ns))
        return;
    queue_frames_changed(&farm->queue, job);
    if (!quiet)
        farm_note(farm, job, NULL, "continues after %.1f s", (double)lasted_ns / 1e9);
    if (!quiet)
        log_info("job %" PRIu64 " (%s) continues after %.1f s", job->id, job->name, (double)lasted_ns / 1e9);
    farm->events.job_changed(farm->events.user, job);
}

void farm_store_failed(struct farm *farm, const struct error *why, uint64_t now_ns)
{
    if (!trouble_is(&farm->trouble))
        store_failed(farm, why, now_ns);
}

status farm_store_usable(const struct farm *farm, struct error *err)
{
    if (!trouble_is(&farm->trouble))
        return STATUS_OK;
    return error_set(err, STATUS_ERR_IO, "the coordinator's store cannot be used: %s; try again when it can",
                     farm->trouble.text);
}

int farm_may_lease(const struct farm *farm, const struct job_frame *frame)
{
    if (frame->leaving || (farm->store && !store_epoch_stored(farm->store)))
        return 0;
    return (!trouble_is(&farm->trouble) && !trouble_is(&frame->trouble)) ||
           frame->ack_count + frame->outstanding_count < TROUBLE_RESULTS_MAX;
}

int farm_takes_again(const struct farm *farm, uint64_t id)
{
    const struct job *job = queue_find(&farm->queue, id);

    return !trouble_is(&farm->trouble) && (!job || job_state_ended(job->state) || !trouble_is(&job->trouble));
}

void farm_store_check(struct farm *farm, uint64_t now_ns)
{
    struct error why = {0};
    uint64_t lasted_ns;

    if (!farm->store || trouble_waits(&farm->trouble, now_ns) ||
        (!trouble_is(&farm->trouble) && !store_suspect(farm->store)))
        return;
    if (store_check(farm->store, &why) != STATUS_OK) {
        store_failed(farm, &why, now_ns);
        return;
    }
    if (!trouble_end(&farm->trouble, now_ns, &lasted_ns))
        return;
    log_info("the store can be used again after %.1f s: jobs continue", (double)lasted_ns / 1e9);
    farm_wake(farm);
    farm->barren.lanes = 0;
    farm->resume_wanted = 1;
    tell_jobs(farm);
}
