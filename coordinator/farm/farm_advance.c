/* farm_advance: what a frame still wants, and when its pictures can be made. Called after every
 * event that a frame may be waiting for. */
#include "common/system/log.h"
#include "coordinator/farm/farm.h"
#include "coordinator/farm/figures.h"

void farm_frame_decide(struct farm *farm, struct job_frame *frame, uint64_t now_ns)
{
    struct error err = {0};
    int changed;

    if (frame->end != FRAME_END_NONE)
        return;
    /* If memory is short, it is tried again at the next result and at the next tick. */
    if (rounds_step(&frame->rounds, frame->film, &frame->job->stop, &changed, &err) != STATUS_OK)
        log_debug("job %llu, frame %u: %s", (unsigned long long)frame->job->id, frame->number, err.text);
    if (!changed)
        return;
    job_frame_wish(frame);
    job_frame_mark_folded(frame, now_ns);
    farm_frame_send_acks(farm, frame);
    farm_wake(farm);
}

void farm_frame_advance(struct farm *farm, struct job_frame *frame, uint64_t now_ns)
{
    struct error err = {0};
    status s;

    if (frame->returns)
        return;
    if (frame->end == FRAME_END_NONE && rounds_are_over(&frame->rounds) && film_complete(frame->film))
        farm_frame_end(farm, frame, rounds_end(&frame->rounds));
    if (frame->state != FRAME_COMPLETE || frame->closing || frame->measuring || trouble_is(&farm->trouble) ||
        trouble_waits(&frame->trouble, now_ns) || !job_frame_is_durable(frame))
        return;
    figures_spend(frame, now_ns);
    s = farm->events.develop(farm->events.user, frame);
    if (s != STATUS_OK) {
        error_set(&err, s, "%s", status_text(s));
        farm_trouble(farm, frame->job, frame->number, &frame->trouble, "cannot be developed", &err, now_ns);
        return;
    }
    job_frame_set_state(frame, FRAME_DEVELOPING);
    frame->in_flight++;
}
