/* farm_frames: a frame's leases, acknowledgements and end; farm_open opens it and farm_advance advances it. */
#include <assert.h>

#include "common/system/log.h"
#include "coordinator/farm/farm.h"
#include "coordinator/farm/forecast.h"

uint64_t farm_film_bytes(uint32_t width, uint32_t height, uint32_t aovs)
{
    /* Sums, and the radiance since the last level. */
    return (uint64_t)width * height * GROUPS *
           ((PIXEL_FLOATS + aov_floats(aovs)) * sizeof(double) + PIXEL_FLOATS * sizeof(float));
}

struct job_frame *farm_frame_find(const struct job *job, uint32_t number)
{
    for (struct job_frame *frame = job->frames; frame; frame = frame->next)
        if (frame->number == number)
            return frame;
    return NULL;
}

static void frame_unlink(struct farm *farm, struct job_frame *frame)
{
    const struct history_point *last = history_last(&frame->history);
    struct job_frame **at = &frame->job->frames;

    while (*at != frame)
        at = &(*at)->next;
    *at = frame->next;
    if (farm->store)
        job_note_closed(frame->job, frame->number,
                        (struct closed_frame){film_samples(frame->film), (double)job_frame_cpu_ns(frame) / 1e9,
                                              forecast_frame_share(frame)});
    if (last && frame->state != FRAME_DEVELOPING) /* what was developed has newer ones */
        job_note_last(frame->job, frame->number, last);
    queue_frame_closed(&farm->queue, frame->job, frame->number);
    farm->open_frames--;
    farm->leaving -= (uint32_t)frame->leaving;
    farm->open_bytes -= farm_film_bytes(film_width(frame->film), film_height(frame->film), film_aovs(frame->film));
}

/* Revoke the leases of one frame, or with NULL of all frames of the job. */
static void revoke_leases(struct farm *farm, const struct job *job, const struct job_frame *frame, const char *reason)
{
    for (struct lease *lease = farm->leases.oldest, *newer; lease; lease = newer) {
        newer = lease->newer;
        if (lease->frame->job != job || (frame && lease->frame != frame))
            continue;
        farm->events.revoke(farm->events.user, lease->holder->session, lease->id, reason);
        lease_end(&farm->leases, lease);
    }
}

void farm_frame_revoke(struct farm *farm, const struct job_frame *frame, const char *reason)
{
    revoke_leases(farm, frame->job, frame, reason);
}

void farm_job_revoke(struct farm *farm, const struct job *job, const char *reason)
{
    revoke_leases(farm, job, NULL, reason);
}

void farm_frame_close(struct farm *farm, struct job_frame *frame, const char *reason)
{
    uint64_t last = 0;

    /* Workers keep these results until we answer, even if their leases are settled. */
    for (size_t i = 0; i < frame->ack_count; i++) {
        const struct pending_ack *ack = &frame->acks[i];
        if (ack->lease != last && !lease_find(&farm->leases, ack->lease, 0))
            farm->events.revoke(farm->events.user, ack->session, ack->lease, reason);
        last = ack->lease;
    }
    frame->ack_count = 0;
    revoke_leases(farm, frame->job, frame, reason);
    frame_unlink(farm, frame);
    frame->closing = 1;
    if (frame->in_flight == 0)
        job_frame_free(frame);
    else
        frame->job->closing_frames++;
}

void farm_frame_pin(struct job_frame *frame) { frame->in_flight++; }

void farm_frame_unpin(struct farm *farm, struct job_frame *frame)
{
    struct job *job = frame->job;

    assert(frame->in_flight > 0);
    frame->in_flight--;
    if (!frame->closing || frame->in_flight > 0)
        return;
    job_frame_free(frame);
    job->closing_frames--;
    /* A film may have been kept after the others were removed: saving its end again removes it, and
     * not before that end is on disk. */
    if (job->marks & JOB_MARK_DISCARDED)
        job->unsaved = farm->unsaved = 1;
    farm_job_dispose(farm, job);
}

void farm_frame_send_acks(struct farm *farm, struct job_frame *frame)
{
    size_t kept = 0;

    for (size_t i = 0; i < frame->ack_count; i++) {
        struct pending_ack ack = frame->acks[i];
        if (job_frame_is_settled(frame, ack.unit))
            farm->events.ack(farm->events.user, ack.session, frame->job, frame->number, ack.unit);
        else
            frame->acks[kept++] = ack;
    }
    frame->ack_count = kept;
}

void farm_frame_end(struct farm *farm, struct job_frame *frame, enum frame_end end)
{
    if (frame->end != FRAME_END_NONE)
        return;
    frame->end = end;
    job_frame_set_state(frame, FRAME_COMPLETE);
    if (frame->outstanding_count > 0)
        farm_frame_revoke(farm, frame, "the frame has ended");
    if (!frame_end_is_whole(end))
        log_info("job %llu, frame %u: %s; its picture has %.1f %% of the samples", (unsigned long long)frame->job->id,
                 frame->number, frame_end_text(end),
                 100.0 * (double)film_samples(frame->film) / (double)film_samples_total(frame->film));
}
