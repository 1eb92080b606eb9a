#include "coordinator/steering/remake.h"

#include <inttypes.h>

#include "common/system/log.h"
#include "coordinator/steering/extend.h"
#include "coordinator/steering/steer.h"

/* The end of a frame that was cut short, and the samples it had then. */
static enum frame_end cut_of(const struct job *job, uint32_t number, uint64_t *samples)
{
    *samples = 0;
    for (size_t i = 0; i < job->cut_count; i++)
        if (job->cuts[i].frame == number) {
            *samples = job->cuts[i].coverage.samples;
            return job->cuts[i].end;
        }
    return FRAME_END_NONE;
}

/* A frame that was cut short ends where it did, or its limits would give it more samples. */
static void open_again(struct farm *farm, struct job *job, uint32_t number, enum frame_end end, uint64_t samples,
                       uint64_t now_ns)
{
    struct job_frame *frame = farm_frame_open(farm, job, number, now_ns);

    if (!frame || end == FRAME_END_NONE || film_samples(frame->film) != samples)
        return;
    farm_frame_end(farm, frame, end);
    farm_frame_advance(farm, frame, now_ns);
}

static status from_film(struct farm *farm, struct job *job, uint32_t number, uint64_t now_ns, struct error *err)
{
    struct job_reopening chosen = {0};
    uint64_t samples;
    enum frame_end end = cut_of(job, number, &samples);
    status s = extend_check_release(job, err);

    THEN(s, farm_store_usable(farm, err));
    THEN(s, job_reopening_init(&chosen, job, &number, 1, job->settings.spp, err));
    THEN(s, job_reopen_check(&farm->queue, job, err));
    THEN(s, steer_reopen(farm, job, &chosen, err));
    if (s == STATUS_OK)
        open_again(farm, job, number, end, samples, now_ns);
    job_reopening_release(&chosen);
    return s;
}

static void remake(struct farm *farm, struct job *job, const struct damaged_output *found, uint64_t now_ns)
{
    int film = store_film_exists(farm->store, job->id, found->frame);
    struct error err = {0};

    if (film && from_film(farm, job, found->frame, now_ns, &err) == STATUS_OK) {
        farm_note(farm, job, NULL, "frame %u: its pictures were damaged on disk and are made again from its film",
                  found->frame);
    } else if (found->is_display) {
        job_frame_set_undeveloped(job, found->frame);
        farm_pictures_wanted(farm, job);
        farm_note(farm, job, NULL, "frame %u: its pictures were damaged on disk and are developed again", found->frame);
    } else {
        log_error("job %" PRIu64 ", frame %u: its picture is damaged%s%s; 'azulejo retry %" PRIu64
                  " --frames %u' renders it again",
                  job->id, found->frame, film ? ": " : ", and its film is not kept", err.text, job->id, found->frame);
    }
}

void remake_step(struct farm *farm, uint64_t now_ns)
{
    struct damaged_output found;

    if (!farm->store || farm->developing || !farm_may_begin(farm))
        return;
    while (store_damage_take(farm->store, &found)) {
        struct job *job = queue_find(&farm->queue, found.job);
        if (job && job_state_ended(job->state) && !job->is_damaged && job_frame_is_done(job, found.frame))
            remake(farm, job, &found, now_ns);
    }
}
