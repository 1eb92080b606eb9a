#include "coordinator/steering/distrust.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/bytes.h"
#include "common/base/memory.h"
#include "common/system/log.h"
#include "coordinator/farm/distrusted.h"
#include "coordinator/farm/roster.h"
#include "coordinator/steering/extend.h"
#include "coordinator/steering/steer.h"

void distrust_report_release(struct distrust_report *report)
{
    mem_free(report->frames);
    *report = (struct distrust_report){0};
}

/* ---- which frames ------------------------------------------------------------------------------- */

struct search {
    struct farm *farm;
    const struct buffer *numbers; /* of one worker, as distrusted_numbers; NULL: of all that are not believed */
    struct distrust_report *report;
};

static int is_one(const struct search *search, uint32_t number, int64_t done_at)
{
    int found = search->numbers == NULL;

    for (size_t at = 0; !found && at + sizeof number <= search->numbers->size; at += sizeof number)
        found = memcmp(search->numbers->data + at, &number, sizeof number) == 0;
    return found && distrusted_has(search->farm, number, done_at);
}

static status report_add(struct distrust_report *report, const struct job *job, uint32_t frame, enum distrust_fate fate,
                         struct error *err)
{
    NEED(MEM_GROW(report->frames, report->capacity, report->count + 1), err, "a worker's frames");
    report->frames[report->count++] = (struct distrust_frame){job->id, frame, fate};
    return STATUS_OK;
}

static enum distrust_fate fate_of(const struct farm *farm, const struct job *job, uint32_t frame)
{
    if (job->release[0] && extend_check_release(job, NULL) != STATUS_OK)
        return DISTRUST_RELEASE;
    return store_film_exists(farm->store, job->id, frame) ? DISTRUST_AGAIN : DISTRUST_NO_FILM;
}

static status look_at_done(void *user, uint64_t id, uint32_t frame, const struct frame_makers *makers, struct error *err)
{
    struct search *search = user;
    struct job *job = queue_find(&search->farm->queue, id);
    int found = 0;

    if (!job || job->removed || !job_frame_is_done(job, frame))
        return STATUS_OK;
    for (size_t at = 0; !found && at + 4 <= makers->deliverers.size; at += 4)
        found = is_one(search, bytes_get32(makers->deliverers.data + at), makers->done_at);
    return found ? report_add(search->report, job, frame, fate_of(search->farm, job, frame), err) : STATUS_OK;
}

static int is_in_film(const struct search *search, const struct film *film)
{
    for (uint32_t t = 0; t < film_tile_count(film); t++)
        for (uint32_t g = 0; g < GROUPS; g++)
            for (uint32_t p = 0; p < film_pass_count(film, g); p++) {
                uint32_t who = film_deliverer(film, t, g, p);
                if (who && is_one(search, who, INT64_MAX))
                    return 1;
            }
    return 0;
}

static int in_order(const void *one, const void *other)
{
    const struct distrust_frame *a = one, *b = other;

    if (a->job != b->job)
        return a->job < b->job ? -1 : 1;
    return a->frame < b->frame ? -1 : a->frame > b->frame;
}

static status find_frames(struct search *search, struct error *err)
{
    struct farm *farm = search->farm;
    status s = STATUS_OK;

    for (size_t i = 0; i < farm->queue.count; i++)
        for (const struct job_frame *f = farm->queue.all[i]->frames; f && s == STATUS_OK; f = f->next)
            if (!job_frame_is_done(f->job, f->number) && is_in_film(search, f->film))
                s = report_add(search->report, f->job, f->number, DISTRUST_AGAIN, err);
    if (farm->store)
        THEN(s, store_frames_made(farm->store, look_at_done, search, err));
    if (search->report->count > 1)
        qsort(search->report->frames, search->report->count, sizeof *search->report->frames, in_order);
    return s;
}

/* ---- not believing ------------------------------------------------------------------------------ */

static status render_again(struct farm *farm, const struct distrust_report *report, struct error *err)
{
    for (size_t i = 0; i < report->count; i++) {
        const struct distrust_frame *f = &report->frames[i];
        size_t k = 0;
        while (k < farm->again_count && (farm->again[k].job != f->job || farm->again[k].frame != f->frame))
            k++;
        if (f->fate != DISTRUST_AGAIN || k < farm->again_count)
            continue;
        NEED(MEM_GROW(farm->again, farm->again_capacity, farm->again_count + 1), err, "frames to render again");
        farm->again[farm->again_count++] = (struct again){f->job, f->frame};
    }
    return STATUS_OK;
}

/* A line in the logs of jobs that keep wrong frames. */
static void note_left(struct farm *farm, const struct distrust_report *report, const char *name)
{
    uint64_t last = 0;

    for (size_t i = 0; i < report->count; i++) {
        const struct distrust_frame *f = &report->frames[i];
        const struct job *job = queue_find(&farm->queue, f->job);
        if (f->fate == DISTRUST_AGAIN || f->job == last || !job)
            continue;
        last = f->job;
        if (f->fate == DISTRUST_NO_FILM)
            farm_note(farm, job, NULL, "frame %u, and perhaps others, has samples of worker %s, which is not believed, and its film was"
                      " not kept: 'azulejo retry %" PRIu64 " --frames %u' renders it again", f->frame, name, f->job, f->frame);
        else
            farm_note(farm, job, NULL, "frame %u, and perhaps others, has samples of worker %s, which is not believed: submit the scene"
                      " again, because another release rendered it", f->frame, name);
    }
}

status distrust_worker(struct farm *farm, const char *name, int64_t since, const char *who,
                       struct distrust_report *report, struct error *err)
{
    struct buffer numbers = BUFFER_INIT;
    struct search search = {farm, &numbers, report};
    status s = distrusted_numbers(farm, name, &numbers, err);

    if (s == STATUS_OK && numbers.size == 0 && !roster_knows(farm, name))
        s = error_set(err, STATUS_ERR_NOT_FOUND,
                      "no worker '%.64s' is connected, and none of that name has delivered a result that is known: 'azulejo "
                      "workers --gone' lists those that left", name);
    THEN(s, roster_steer(farm, name, WORKER_VERB_BLOCK, who, err));
    THEN(s, distrusted_add(farm, &numbers, since, err));
    THEN(s, find_frames(&search, err));
    THEN(s, render_again(farm, report, err));
    if (s == STATUS_OK) {
        log_info("worker %s is not believed any more: %s; %zu frames have results of it", name, who, report->count);
        note_left(farm, report, name);
        farm_wake(farm);
    }
    buffer_release(&numbers);
    return s;
}

/* ---- rendering again ------------------------------------------------------------------------------ */

static status reopen(struct farm *farm, struct job *job, uint32_t frame, struct error *err)
{
    struct job_reopening chosen = {0};
    status s = job_reopening_init(&chosen, job, &frame, 1, job->settings.spp, err);

    THEN(s, job_reopen_check(&farm->queue, job, err));
    if (s == STATUS_OK && job_state_ended(job->state)) {
        s = steer_reopen(farm, job, &chosen, err);
    } else if (s == STATUS_OK) {
        s = store_job_extend(farm->store, job, &chosen, NULL, err);
        if (s == STATUS_OK) {
            job_reopen_frames(&farm->queue, job, &chosen);
            farm_pictures_wanted(farm, job);
            s = store_job_sum(farm->store, job, err);
        }
    }
    job_reopening_release(&chosen);
    return s;
}

/* 0: later. */
static int begin_again(struct farm *farm, const struct again *again)
{
    struct job *job = queue_find(&farm->queue, again->job);
    struct job_frame *frame = job ? farm_frame_find(job, again->frame) : NULL;
    struct error err = {0};

    if (!job || job->removed)
        return 1;
    if (job->closing_frames > 0 || farm->developing == job || (frame && frame->in_flight > 0) || trouble_is(&farm->trouble))
        return 0;
    if (job_frame_is_done(job, again->frame)) {
        if (!store_film_exists(farm->store, job->id, again->frame))
            return 1;
        if (reopen(farm, job, again->frame, &err) != STATUS_OK) {
            log_error("job %" PRIu64 ", frame %u cannot be rendered again: %s; it is tried again", job->id,
                      again->frame, err.text);
            return 0;
        }
    }
    if (frame)
        farm_frame_close(farm, frame, "a worker that delivered results of it is not believed any more");
    job_note_closed(job, again->frame, (struct closed_frame){0});
    farm_wake(farm);
    return 1;
}

/* What an earlier run did not get to. */
static void find_of_earlier_runs(struct farm *farm)
{
    struct distrust_report report = {0};
    struct search search = {farm, NULL, &report};
    struct error err = {0};
    status s = farm->distrusted_count > 0 ? find_frames(&search, &err) : STATUS_OK;

    THEN(s, render_again(farm, &report, &err));
    farm->again_known = s == STATUS_OK;
    if (s != STATUS_OK)
        log_debug("%s", err.text); /* at the next tick */
    distrust_report_release(&report);
}

void distrust_tick(struct farm *farm)
{
    size_t kept = 0;

    if (!farm->store)
        return;
    if (!farm->again_known && !trouble_is(&farm->trouble))
        find_of_earlier_runs(farm);
    for (size_t i = 0; i < farm->again_count; i++)
        if (!begin_again(farm, &farm->again[i]))
            farm->again[kept++] = farm->again[i];
    farm->again_count = kept;
}
