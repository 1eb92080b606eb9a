/* farm_open: frames are opened with the films on disk. */
#include "common/system/log.h"
#include "coordinator/farm/distrusted.h"
#include "coordinator/farm/farm.h"
#include "coordinator/farm/figures.h"
#include "coordinator/farm/freeze.h"

static int frame_may_open(const struct farm *farm, const struct job *job)
{
    uint64_t bytes = farm_film_bytes(job->settings.width, job->settings.height, job->settings.aovs);
    int of_job = 0;

    for (const struct job_frame *frame = job->frames; frame; frame = frame->next)
        of_job++;
    return of_job < FRAMES_OPEN_PER_JOB && farm->open_frames < FRAMES_OPEN_MAX &&
           (farm->open_frames == 0 || farm->open_bytes + bytes <= FRAMES_OPEN_BYTES);
}

/* A frame with its film from the store, before it begins. On failure *out is NULL. */
static status frame_read(struct farm *farm, struct job *job, uint32_t number, struct job_frame **out, struct error *err)
{
    const struct render_settings *settings = &job->settings;
    struct job_frame *frame =
        job_frame_new(job, number, settings->width, settings->height, settings->spp, settings->aovs, NULL);
    status s = STATUS_OK;

    if (!frame)
        s = error_no_memory(err, "the film");
    else if (farm->store)
        s = store_film_open(farm->store, job->id, number, frame->film, frame->durable, &frame->file, err);
    if (s != STATUS_OK) {
        job_frame_free(frame);
        frame = NULL;
    }
    *out = frame;
    return s;
}

/* What deliverers sent that are not believed is rendered again (distrusted.h). */
static status frame_drop_distrusted(struct farm *farm, struct job_frame **frame, struct error *err)
{
    struct job *job = (*frame)->job;
    uint32_t number = (*frame)->number, all = film_tile_count((*frame)->film);
    struct distrusted_loss loss;
    status s = distrusted_take_out(farm, *frame, &loss, err);

    if (s == STATUS_OK && loss.part == DISTRUSTED_ALL) {
        job_frame_free(*frame);
        store_film_remove(farm->store, job->id, number);
        s = frame_read(farm, job, number, frame, err);
    }
    if (s != STATUS_OK || loss.part == DISTRUSTED_NONE)
        return s;
    if (loss.part == DISTRUSTED_ALL)
        farm_note(farm, job, NULL, "frame %u is rendered again from its beginning: %u of its %u tiles have samples of a worker that is not believed",
                  number, loss.tiles, all);
    else
        farm_note(farm, job, NULL, "%u of the %u tiles of frame %u are rendered again from their beginning: a worker that is not believed had sent samples of them",
                  loss.tiles, all, number);
    return s;
}

static status frame_begin(struct farm *farm, struct job_frame *frame, struct error *err)
{
    const struct job *job = frame->job;
    status s;

    if (farm->store)
        job_frame_keep_journal(frame);
    s = freeze_open(frame, err);
    if (s == STATUS_OK && farm->store && stop_has_rounds(&job->stop) && film_has_skipped(frame->film))
        s = store_film_measure(farm->store, job->id, frame->number, frame->film, err); /* it had no rounds before */
    if (s == STATUS_OK && farm->store)
        s = store_clock_load(farm->store, job->id, frame->number, &frame->clock, err);
    THEN(s, job_frame_begin(frame, err));
    return s;
}

/* On failure *out is NULL. */
static status frame_load(struct farm *farm, struct job *job, uint32_t number, struct job_frame **out, struct error *err)
{
    status s = frame_read(farm, job, number, out, err);

    if (s == STATUS_OK && farm->store)
        s = frame_drop_distrusted(farm, out, err);
    THEN(s, frame_begin(farm, *out, err));
    if (s != STATUS_OK) {
        job_frame_free(*out);
        *out = NULL;
    }
    return s;
}

/* An estimate may have rendered more than the job's rules want. The job's pictures must not depend on an earlier
 * estimate, so such a frame begins again: it needs fewer samples than the estimate took. */
static status frame_drop_excess(struct farm *farm, struct job_frame **frame, struct error *err)
{
    struct job *job = (*frame)->job;
    uint32_t number = (*frame)->number;
    int changed;
    status s;

    if (job->estimate != ESTIMATE_CONTINUED || film_samples((*frame)->film) == 0)
        return STATUS_OK;
    s = rounds_step(&(*frame)->rounds, (*frame)->film, &job->stop, &changed, err);
    if (s != STATUS_OK || !rounds_exceeded(&(*frame)->rounds, (*frame)->film)) {
        job_frame_wish(*frame);
        return s;
    }
    log_info("job %llu, frame %u: needs fewer samples than its estimate took, and begins again",
             (unsigned long long)job->id, number);
    job_frame_free(*frame);
    *frame = NULL;
    store_film_remove(farm->store, job->id, number);
    return frame_load(farm, job, number, frame, err);
}

struct job_frame *farm_frame_open(struct farm *farm, struct job *job, uint32_t number, uint64_t now_ns)
{
    const struct render_settings *settings = &job->settings;
    struct job_frame *frame, **at = &job->frames;
    struct error err = {0};
    status s;

    if (!frame_may_open(farm, job) || trouble_waits(&job->trouble, now_ns) ||
        (trouble_is(&farm->trouble) && !(farm->store && store_film_exists(farm->store, job->id, number))))
        return NULL;
    s = frame_load(farm, job, number, &frame, &err);
    if (s == STATUS_OK && farm->store)
        s = frame_drop_excess(farm, &frame, &err);
    if (s != STATUS_OK) {
        job_frame_free(frame);
        farm_trouble(farm, job, number, &job->trouble, "cannot be opened", &err, now_ns);
        return NULL;
    }
    farm_trouble_over(farm, job, &job->trouble, now_ns);
    job_note_closed(job, number, (struct closed_frame){0});
    figures_open(farm, frame, now_ns);
    while (*at && (*at)->number < number)
        at = &(*at)->next;
    frame->next = *at;
    *at = frame;
    queue_frames_changed(&farm->queue, job);
    farm->open_frames++;
    farm->open_bytes += farm_film_bytes(settings->width, settings->height, settings->aovs);
    if (film_samples(frame->film) > 0)
        log_info("job %llu, frame %u: continues at %.1f %%", (unsigned long long)job->id, number,
                 100.0 * (double)film_samples(frame->film) / (double)film_samples_total(frame->film));
    freeze_step(farm, frame, now_ns);
    farm_frame_decide(farm, frame, now_ns);
    farm_frame_advance(farm, frame, now_ns);
    return frame;
}

struct closed_films {
    const struct farm *farm;
    struct job *job;
};

static void note_closed(void *user, uint32_t frame, uint64_t samples, double core_s)
{
    const struct closed_films *c = user;

    if (frame >= c->job->first_frame && frame <= c->job->last_frame && !job_frame_is_done(c->job, frame) &&
        !farm_frame_find(c->job, frame) && store_film_exists(c->farm->store, c->job->id, frame))
        job_note_closed(c->job, frame,
                        (struct closed_frame){samples, core_s, (double)samples / (double)job_frame_samples(c->job)});
}

void farm_note_closed(struct farm *farm, struct job *job)
{
    struct closed_films closed = {farm, job};
    struct error err = {0};

    if (farm->store && store_history_samples(farm->store, job->id, note_closed, &closed, &err) != STATUS_OK)
        log_debug("job %llu: %s", (unsigned long long)job->id, err.text); /* it only seems to have less */
}

int farm_may_begin(const struct farm *farm)
{
    return farm->open_frames < FRAMES_OPEN_MAX && (farm->open_frames == 0 || farm->open_bytes < FRAMES_OPEN_BYTES);
}

/* ---- room ------------------------------------------------------------------------------------ */

/* A job before others in the order has no frame open, because theirs take all the room: the last frame of
 * the last of them leaves memory. Its film stays on disk. */
static void make_room(struct farm *farm, const struct job *job)
{
    struct job_frame *victim = NULL;

    if (!farm->store || trouble_is(&farm->trouble) || job->frames || farm->leaving || !job->place.ready ||
        farm->order.seen_changes != farm->queue.changes)
        return;
    for (size_t i = farm->order.count; i-- > 0 && farm->order.jobs[i] != job && !victim;)
        for (struct job_frame *frame = farm->order.jobs[i]->frames; frame; frame = frame->next)
            if (frame->state == FRAME_RENDERING && frame->end == FRAME_END_NONE && !trouble_is(&frame->trouble))
                victim = frame;
    if (!victim)
        return;
    log_info("job %llu, frame %u leaves memory, to make room for job %llu", (unsigned long long)victim->job->id,
             victim->number, (unsigned long long)job->id);
    victim->leaving = 1;
    farm->leaving++;
    farm_frame_revoke(farm, victim, "its frame makes room for another");
}

void farm_frame_leave(struct farm *farm, struct job_frame *frame, uint64_t now_ns)
{
    struct job *job = frame->job;
    uint32_t number = frame->number;
    int returns = frame->returns;

    if (!frame->leaving || (frame->state != FRAME_RENDERING && !returns) || frame->dirty_count > 0 ||
        frame->in_flight > 0)
        return;
    farm_frame_close(farm, frame, returns ? "the job has other rules" : "its frame makes room for another");
    farm_wake(farm);
    /* Now, because it may have enough samples: no worker would ask for it then. */
    if (returns && job_state_is_open(job->state) && farm->store && store_film_exists(farm->store, job->id, number))
        (void)farm_frame_open(farm, job, number, now_ns);
}

void farm_frame_renew(struct farm *farm, struct job_frame *frame, uint64_t now_ns)
{
    farm_frame_revoke(farm, frame, "the job has other rules");
    farm->leaving += !frame->leaving;
    frame->leaving = frame->returns = 1;
    farm_frame_leave(farm, frame, now_ns);
}

struct job_frame *farm_frame_open_next(struct farm *farm, struct job *job, uint64_t now_ns)
{
    if (job->state == JOB_STATE_FINISHING)
        return NULL;
    if (!frame_may_open(farm, job)) {
        make_room(farm, job);
        return NULL;
    }
    for (uint64_t number = job->begin_from; number <= job->last_frame; number++) {
        if (!job_frame_is_done(job, (uint32_t)number) && !job_frame_is_resting(job, (uint32_t)number) &&
            !farm_frame_find(job, (uint32_t)number))
            return farm_frame_open(farm, job, (uint32_t)number, now_ns);
        job_begun_before(job, (uint32_t)number);
    }
    queue_all_begun(&farm->queue, job);
    return NULL;
}
