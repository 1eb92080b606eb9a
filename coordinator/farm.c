#include "coordinator/farm.h"

#include <assert.h>
#include <stdio.h>
#include <string.h>

#include "common/base/clock.h"
#include "common/base/log.h"
#include "common/base/memory.h"
#include "coordinator/closing.h"
#include "coordinator/figures.h"
#include "coordinator/freeze.h"
#include "coordinator/merge.h"

/* A cancelled job must not come back, so the canceller waits for the disk. All else may be
 * lost in a crash: counters are estimates, and a job that was all but done is ended again at the
 * start. The pinned kernel is on disk before any result is: see merge_commit_run. */
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

/* ---- life ----------------------------------------------------------------------------------- */

static status adopt_job(void *user, struct job *job, struct error *err)
{
    struct farm *farm = user;

    return queue_add(&farm->queue, job, err);
}

status farm_init(struct farm *farm, struct store *store, uint64_t lease_ns,
                 const struct farm_events *events, int64_t wall_s, struct error *err)
{
    uint64_t epoch = 1;
    status s = STATUS_OK;

    memset(farm, 0, sizeof *farm);
    queue_init(&farm->queue);
    farm->store = store;
    farm->events = *events;
    farm->wall_s = wall_s;
    farm->pump_wanted = 1;
    if (store) {
        s = store_epoch_begin(store, wall_s, &epoch, err);
        if (s == STATUS_OK)
            s = store_deliverers_last(store, &farm->last_deliverer, err);
        if (s == STATUS_OK)
            s = store_jobs_load(store, adopt_job, farm, err);
    }
    if (s != STATUS_OK) {
        queue_release(&farm->queue);
        return s;
    }
    lease_table_init(&farm->leases, epoch, lease_ns);
    return STATUS_OK;
}

/* What a film holds in memory when it is full. */
static uint64_t film_bytes(uint32_t width, uint32_t height, uint32_t aovs)
{
    return (uint64_t)width * height * GROUPS * (PIXEL_FLOATS + aov_floats(aovs)) * sizeof(double);
}

static void frame_unlink(struct farm *farm, struct job_frame *frame)
{
    struct job_frame **at = &frame->job->frames;

    while (*at != frame)
        at = &(*at)->next;
    *at = frame->next;
    farm->open_frames--;
    farm->open_bytes -= film_bytes(film_width(frame->film), film_height(frame->film),
                                   film_aovs(frame->film));
}

/* Revoke the leases of one frame, or with NULL of all frames of the job. */
static void revoke_leases(struct farm *farm, const struct job *job, const struct job_frame *frame,
                          const char *reason)
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

    /* Workers keep these results for our answer, also where their leases are settled. */
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
}

void farm_frame_unpin(struct farm *farm, struct job_frame *frame)
{
    (void)farm;
    assert(frame->in_flight > 0);
    frame->in_flight--;
    if (frame->closing && frame->in_flight == 0)
        job_frame_free(frame);
}

void farm_release(struct farm *farm, uint64_t now_ns)
{
    for (size_t i = 0; i < farm->queue.active_count; i++) {
        struct job *job = farm->queue.active[i];
        farm_job_save(farm, job, now_ns);
    }
    lease_table_release(&farm->leases);
    for (size_t i = 0; i < farm->queue.count; i++)
        while (farm->queue.all[i]->frames) {
            farm->queue.all[i]->frames->ack_count = 0; /* the workers keep them for the next run */
            farm_frame_close(farm, farm->queue.all[i]->frames, "the coordinator ends");
        }
    queue_release(&farm->queue);
}

/* ---- jobs ----------------------------------------------------------------------------------- */

status farm_prepare(const struct farm *farm, struct job *job, struct error *err)
{
    job->epoch_floor = farm->leases.epoch + 1;
    job->submitted_at = farm->wall_s;
    if (farm_store_usable(farm, err) != STATUS_OK)
        return STATUS_ERR_IO;
    if (farm->queue.active_count >= JOBS_ACTIVE_MAX)
        return error_set(err, STATUS_ERR_LIMIT,
                         "%d jobs are queued or running already; wait for some to end",
                         JOBS_ACTIVE_MAX);
    return STATUS_OK;
}

status farm_adopt(struct farm *farm, struct job *job, struct error *err)
{
    status s = queue_add(&farm->queue, job, err);

    if (s != STATUS_OK) {
        if (farm->store)
            store_job_forget(farm->store, job->id);
        return s;
    }
    farm->pump_wanted = 1;
    farm->events.job_changed(farm->events.user, job);
    return STATUS_OK;
}

status farm_submit(struct farm *farm, struct job *job, struct error *err)
{
    status s = farm_prepare(farm, job, err);

    if (s != STATUS_OK)
        return s;
    if (farm->store) {
        s = store_job_insert(farm->store, job, err);
        if (s != STATUS_OK)
            return s;
    } else {
        job->id = farm->queue.count ? farm->queue.all[farm->queue.count - 1]->id + 1 : 1;
    }
    return farm_adopt(farm, job, err);
}

void farm_job_change(struct farm *farm, struct job *job, enum job_state state, const char *text,
                     uint64_t now_ns)
{
    int ends = job_state_ended(state);

    while (ends && job->frames)
        farm_frame_close(farm, job->frames, "the job ended");
    job_set_state(&farm->queue, job, state, text, now_ns, farm->wall_s);
    farm_job_save(farm, job, now_ns); /* its films go when that is on disk */
    farm->pump_wanted = 1;
    farm->events.job_changed(farm->events.user, job);
}

void farm_cancel(struct farm *farm, struct job *job, int discard, uint64_t now_ns)
{
    if (job->state == JOB_STATE_DONE && discard && farm->store) {
        store_films_remove(farm->store, job->id);
        log_info("job %llu (%s): its kept films are removed", (unsigned long long)job->id, job->name);
    }
    if (job_state_ended(job->state) || (job->state == JOB_STATE_CANCELLING && !discard))
        return;
    if (!discard) {
        closing_begin(farm, job, now_ns);
        return;
    }
    farm_job_change(farm, job, JOB_STATE_CANCELLED, "cancelled, unfinished frames discarded", now_ns);
    log_info("job %llu (%s) is cancelled, and what it holds discarded", (unsigned long long)job->id,
             job->name);
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
    /* Another one than before: whoever had units then has gone without a result. */
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

/* ---- workers -------------------------------------------------------------------------------- */

status farm_worker_add(struct farm *farm, struct farm_worker *worker, struct error *err)
{
    if (farm->worker_count == WORKERS_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "%d workers are connected already", WORKERS_MAX);
    credit_init(&worker->credit, worker->threads);
    farm->workers[farm->worker_count++] = worker;
    farm->pump_wanted = 1;
    return STATUS_OK;
}

void farm_deliverer_begin(struct farm *farm, struct farm_worker *worker)
{
    struct error err = {0};

    if (worker->deliverer.number)
        return;
    worker->deliverer.number = ++farm->last_deliverer;
    worker->deliverer.first_seen = farm->wall_s;
    /* A conflict is then told with the number only. */
    if (farm->store &&
        store_deliverer_save_later(farm->store, &worker->deliverer, &err) != STATUS_OK)
        log_warn("%s", err.text);
}

void farm_deliverer_text(const struct farm *farm, uint32_t deliverer, char out[DELIVERER_TEXT_MAX])
{
    struct deliverer gone;

    for (uint32_t i = 0; i < farm->worker_count; i++) {
        const struct farm_worker *worker = farm->workers[i];
        if (worker->deliverer.number != deliverer)
            continue;
        snprintf(out, DELIVERER_TEXT_MAX, "session %u (%s)", worker->held.session, worker->name);
        return;
    }
    if (farm->store && store_deliverer_find(farm->store, deliverer, &gone, NULL) == STATUS_OK &&
        gone.number)
        snprintf(out, DELIVERER_TEXT_MAX, "a worker that has gone (%s, process %u, %s)", gone.host,
                 gone.process, gone.software);
    else
        snprintf(out, DELIVERER_TEXT_MAX, "a worker that has gone (number %u)", deliverer);
}

void farm_worker_remove(struct farm *farm, struct farm_worker *worker, int died, uint64_t now_ns)
{
    uint64_t lent_ns = 0;
    struct job *job = died ? closing_suspected(farm, worker, &lent_ns) : NULL;

    lease_end_all_of(&farm->leases, &worker->held);
    if (job)
        closing_note_death(farm, job, worker, lent_ns, now_ns);
    for (uint32_t i = 0; i < farm->worker_count; i++) {
        if (farm->workers[i] == worker) {
            farm->workers[i] = farm->workers[--farm->worker_count];
            break;
        }
    }
    farm->pump_wanted = 1;
}

static int job_has_results(const struct job *job)
{
    if (job->frames_done_count > 0 || job->stats.cpu_ns > 0)
        return 1;
    for (const struct job_frame *frame = job->frames; frame; frame = frame->next)
        if (frame->ack_count > 0 || film_samples(frame->film) > 0)
            return 1;
    return 0;
}

/* Is anything there, or on its way, that was rendered with the job's kernel? */
static int job_is_begun(const struct job *job)
{
    return job->leases > 0 || job_has_results(job);
}

int farm_can_serve(const struct job *job, const struct farm_worker *worker, char *why,
                   size_t why_size)
{
    if (!(worker->isa_mask >> job->settings.isa & 1))
        snprintf(why, why_size,
                 "it does not offer %s, which job %llu is pinned to (its CPU has none, or its --isa "
                 "leaves it out)",
                 isa_name(job->settings.isa), (unsigned long long)job->id);
    else if (job->kernel[0] && strcmp(job->kernel, worker->kernel) != 0 && job_is_begun(job))
        snprintf(why, why_size,
                 "it traces rays with %s, but job %llu was begun with %s; mixing them would change "
                 "the picture's bits",
                 worker->kernel, (unsigned long long)job->id, job->kernel);
    else if (job_is_broken_for(job, worker->machine))
        snprintf(why, why_size, "its machine said that it cannot render job %llu",
                 (unsigned long long)job->id);
    else
        return 1;
    return 0;
}

void farm_job_broken(struct farm *farm, struct job *job, struct farm_worker *worker,
                     const char *text, uint64_t now_ns)
{
    uint32_t able = 0, held = 0;
    status s = STATUS_OK;
    char why[256];

    for (struct lease *lease = farm->leases.oldest, *newer; lease; lease = newer) {
        newer = lease->newer;
        if (lease->holder != &worker->held || lease->frame->job != job)
            continue;
        lease_end(&farm->leases, lease);
        held++;
    }
    if (held == 0 || !job_state_is_open(job->state))
        return; /* its second lease, one that was revoked meanwhile, or an intruder's word */
    farm->pump_wanted = 1;
    if (!job_is_broken_for(job, worker->machine))
        s = job_set_broken_for(job, worker->machine);
    for (uint32_t i = 0; i < farm->worker_count; i++)
        able += (uint32_t)farm_can_serve(job, farm->workers[i], why, sizeof why);
    /* With a result there are machines that can: those that cannot are passed over. */
    if (s != STATUS_OK || able == 0 || job->broken_count >= JOB_BROKEN_MACHINES_MAX ||
        (job->broken_count >= JOB_BROKEN_MAX && !job_has_results(job)))
        farm_fail(farm, job, now_ns, "%zu machine%s cannot render it: %s", job->broken_count,
                  job->broken_count == 1 ? "" : "s", text);
}

/* ---- frames --------------------------------------------------------------------------------- */

struct job_frame *farm_frame_find(const struct job *job, uint32_t number)
{
    for (struct job_frame *frame = job->frames; frame; frame = frame->next)
        if (frame->number == number)
            return frame;
    return NULL;
}

static int frame_may_open(const struct farm *farm, const struct job *job)
{
    uint64_t bytes = film_bytes(job->settings.width, job->settings.height, job->settings.aovs);
    int of_job = 0;

    for (const struct job_frame *frame = job->frames; frame; frame = frame->next)
        of_job++;
    return of_job < FRAMES_OPEN_PER_JOB && farm->open_frames < FRAMES_OPEN_MAX &&
           (farm->open_frames == 0 || farm->open_bytes + bytes <= FRAMES_OPEN_BYTES);
}

/* A frame with what the store has of it. On failure *out is NULL. */
static status frame_load(struct farm *farm, struct job *job, uint32_t number,
                         struct job_frame **out, struct error *err)
{
    const struct render_settings *settings = &job->settings;
    struct job_frame *frame = job_frame_new(job, number, settings->width, settings->height,
                                            settings->spp, settings->aovs, NULL);
    status s = STATUS_OK;

    if (!frame)
        s = error_no_memory(err, "the film");
    else if (farm->store)
        s = store_film_open(farm->store, job->id, number, frame->film, frame->durable, frame->slot,
                            &frame->file, err);
    if (s == STATUS_OK)
        s = freeze_open(frame, err);
    if (s == STATUS_OK && farm->store)
        s = store_clock_load(farm->store, job->id, number, &frame->clock, err);
    if (s == STATUS_OK)
        s = job_frame_begin(frame, err);
    if (s != STATUS_OK) {
        job_frame_free(frame);
        frame = NULL;
    }
    *out = frame;
    return s;
}

/* An estimate may have rendered more than the job's rules want. The job's bits shall not depend on whether it was
 * estimated, so such a frame begins again: it needs less than the estimate took. */
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
    log_info("job %llu, frame %u: needs less than its estimate, and begins again",
             (unsigned long long)job->id, number);
    job_frame_free(*frame);
    *frame = NULL;
    store_film_remove(farm->store, job->id, number);
    return frame_load(farm, job, number, frame, err);
}

struct job_frame *farm_frame_open(struct farm *farm, struct job *job, uint32_t number,
                                  uint64_t now_ns)
{
    const struct render_settings *settings = &job->settings;
    struct job_frame *frame, **at = &job->frames;
    struct error err = {0};
    status s;

    if (!frame_may_open(farm, job) || trouble_waits(&job->trouble, now_ns) ||
        (trouble_is(&farm->trouble) && !store_film_exists(farm->store, job->id, number)))
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
    figures_open(farm, frame, now_ns);
    while (*at && (*at)->number < number)
        at = &(*at)->next;
    frame->next = *at;
    *at = frame;
    farm->open_frames++;
    farm->open_bytes += film_bytes(settings->width, settings->height, settings->aovs);
    if (film_samples(frame->film) > 0)
        log_info("job %llu, frame %u: goes on at %.1f %%", (unsigned long long)job->id, number,
                 100.0 * (double)film_samples(frame->film) /
                     (double)film_samples_total(frame->film));
    freeze_step(farm, frame, now_ns);
    farm_frame_decide(farm, frame, now_ns);
    farm_frame_advance(farm, frame, now_ns);
    return frame;
}

struct job_frame *farm_frame_open_next(struct farm *farm, struct job *job, uint64_t now_ns)
{
    if (!frame_may_open(farm, job))
        return NULL;
    for (uint64_t number = job->first_frame; number <= job->last_frame; number++)
        if (!job_frame_is_done(job, (uint32_t)number) &&
            !job_frame_is_resting(job, (uint32_t)number) && !farm_frame_find(job, (uint32_t)number))
            return farm_frame_open(farm, job, (uint32_t)number, now_ns);
    return NULL;
}

void farm_frame_decide(struct farm *farm, struct job_frame *frame, uint64_t now_ns)
{
    struct error err = {0};
    int changed;

    if (frame->end != FRAME_END_NONE)
        return;
    /* Without memory it is tried again at the next result, and at the next tick. */
    if (rounds_step(&frame->rounds, frame->film, &frame->job->stop, &changed, &err) != STATUS_OK)
        log_debug("job %llu, frame %u: %s", (unsigned long long)frame->job->id, frame->number,
                  err.text);
    if (!changed)
        return;
    job_frame_wish(frame);
    job_frame_mark_folded(frame, now_ns);
    merge_send_acks(farm, frame);
    farm->pump_wanted = 1;
}

void farm_frame_advance(struct farm *farm, struct job_frame *frame, uint64_t now_ns)
{
    struct error err = {0};
    status s;

    if (frame->end == FRAME_END_NONE && rounds_are_over(&frame->rounds) &&
        film_complete(frame->film))
        closing_end_frame(farm, frame, rounds_end(&frame->rounds));
    if (frame->state != FRAME_COMPLETE || frame->closing || frame->measuring ||
        trouble_is(&farm->trouble) ||
        trouble_waits(&frame->trouble, now_ns) ||
        !job_frame_is_durable(frame))
        return;
    figures_spend(frame, now_ns);
    s = farm->events.develop(farm->events.user, frame);
    if (s != STATUS_OK) {
        error_set(&err, s, "%s", status_text(s));
        farm_trouble(farm, frame->job, frame->number, &frame->trouble, "cannot be developed", &err,
                     now_ns);
        return;
    }
    job_frame_set_state(frame, FRAME_DEVELOPING);
    frame->in_flight++;
}

/* ---- pictures made anew ----------------------------------------------------------------------- */

/* Every frame is done and its pictures are made: the job is. */
static void job_end_when_done(struct farm *farm, struct job *job, uint64_t now_ns)
{
    if (job_state_ended(job->state) || job->state == JOB_STATE_CANCELLING ||
        job->frames_done_count < job_frames_wanted(job) ||
        job->frames_developed_count < job->frames_done_count)
        return;
    if (job->state == JOB_STATE_PARKED)
        job_set_state(&farm->queue, job, JOB_STATE_QUEUED, NULL, now_ns, farm->wall_s);
    if (job->state == JOB_STATE_QUEUED) /* all of it came back from disk */
        job_set_state(&farm->queue, job, JOB_STATE_RUNNING, NULL, now_ns, farm->wall_s);
    log_info("job %llu (%s) is done", (unsigned long long)job->id, job->name);
    farm_job_change(farm, job, JOB_STATE_DONE, NULL, now_ns);
}

static void develop_list_add(struct farm *farm, struct job *job)
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

static void develop_list_remove(struct farm *farm, struct job *job)
{
    struct job **at = &farm->to_develop;

    while (*at && *at != job)
        at = &(*at)->next_to_develop;
    if (*at)
        *at = job->next_to_develop;
    job->to_develop = 0;
}

/* Begin with the next picture that can be made, one at a time: rendering has the other threads. */
static void develop_next(struct farm *farm, uint64_t now_ns)
{
    if (farm->developing || trouble_is(&farm->trouble))
        return;
    for (struct job *job = farm->to_develop; job; job = job->next_to_develop) {
        uint32_t frame;

        if (trouble_waits(&job->pictures, now_ns) || !job_frame_to_develop(job, &frame))
            continue;
        if (farm->events.redevelop(farm->events.user, job, frame) == STATUS_OK)
            farm->developing = 1;
        return;
    }
}

status farm_develop(struct farm *farm, struct job *job, const struct output_settings *output,
                    struct error *err)
{
    struct output_settings before = job->output;
    uint32_t revision = job->revision;
    status s = STATUS_OK;

    job->output = *output;
    job->output.exr = before.exr;
    job->output.exr_half = before.exr_half;
    job->revision++;
    if (farm->store)
        s = store_job_revise(farm->store, job, err);
    job->revision = revision;
    if (s != STATUS_OK) {
        job->output = before;
        return s;
    }
    job_revise(job);
    log_info("job %llu (%s) is developed with %s", (unsigned long long)job->id, job->name,
             job->output.tonemap.op->name);
    develop_list_add(farm, job);
    farm->events.job_changed(farm->events.user, job);
    return STATUS_OK;
}

/* Try a picture again later, or give the job's pictures up. */
static void develop_failed(struct farm *farm, struct job *job, uint32_t frame,
                           const struct error *why, uint64_t now_ns)
{
    char text[sizeof job->pictures.text];

    if (status_is_environment(why->code)) {
        farm_trouble(farm, job, frame, &job->pictures, "", why, now_ns);
        return;
    }
    snprintf(text, sizeof text, "frame %u: %.200s", frame, why->text);
    (void)trouble_note(&job->pictures, text, now_ns);
    job->pictures.next_ns = UINT64_MAX;
    log_error("job %llu: the picture of frame %u cannot be made: %s", (unsigned long long)job->id,
              frame, why->text);
    develop_list_remove(farm, job);
    if (!job_state_ended(job->state))
        farm_fail(farm, job, now_ns, "the picture of %s", text);
}

void farm_pictures_made(struct farm *farm, struct job *job, uint32_t frame, int64_t revision,
                        status result, const struct error *why, uint64_t now_ns)
{
    farm->developing = 0;
    if (revision == (int64_t)job->revision && result == STATUS_OK) {
        job_frame_set_developed(job, frame);
        farm_trouble_over(farm, job, &job->pictures, now_ns);
    } else if (revision == (int64_t)job->revision) {
        develop_failed(farm, job, frame, why, now_ns);
    }
    if (job->frames_developed_count == job->frames_done_count)
        develop_list_remove(farm, job);
    job_end_when_done(farm, job, now_ns);
    farm->events.job_changed(farm->events.user, job);
    develop_next(farm, now_ns);
    closing_step(farm, job, now_ns);
}

void farm_frame_developed(struct farm *farm, struct job_frame *frame, int64_t revision,
                          status result, const struct error *why, uint64_t now_ns)
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
    unit_work_add(&job->work, &work);
    farm_frame_unpin(farm, frame);
    farm_frame_close(farm, frame, "the frame is done");
    job_frame_set_done(job, number);
    if (coverage.samples < job_frame_samples(job) &&
        job_frame_set_cut(job, number, end, &coverage, &err) != STATUS_OK)
        log_error("job %llu, frame %u: %s", (unsigned long long)job->id, number, err.text);
    if (revision == (int64_t)job->revision)
        job_frame_set_developed(job, number);
    log_info("job %llu (%s), frame %u is done: %u of %u", (unsigned long long)job->id, job->name,
             number, job->frames_done_count, job_frame_count(job));
    farm->pump_wanted = 1;
    develop_list_add(farm, job);
    job_end_when_done(farm, job, now_ns);
    if (!job_state_ended(job->state))
        farm->events.job_changed(farm->events.user, job);
    develop_next(farm, now_ns);
    closing_step(farm, job, now_ns);
}

/* ---- after a restart ------------------------------------------------------------------------- */

/* Open the frames of which there is something on disk. */
static void resume_films(struct farm *farm, struct job *job, uint64_t now_ns)
{
    for (uint64_t number = job->first_frame; number <= job->last_frame; number++)
        if (!job_frame_is_done(job, (uint32_t)number) && !farm_frame_find(job, (uint32_t)number) &&
            store_film_exists(farm->store, job->id, (uint32_t)number) &&
            !farm_frame_open(farm, job, (uint32_t)number, now_ns))
            return;
}

void farm_resume_films(struct farm *farm, uint64_t now_ns)
{
    for (size_t i = 0; farm->store && i < farm->queue.active_count; i++)
        if (farm->queue.active[i]->state == JOB_STATE_RUNNING)
            resume_films(farm, farm->queue.active[i], now_ns);
}

/* The coordinator was killed after the job's end was stored, and before its films were removed. */
static void remove_left_films(void *user, uint64_t id)
{
    const struct farm *farm = user;
    const struct job *job = queue_find(&farm->queue, id);

    if (job && job_state_ended(job->state) && job->state != JOB_STATE_DONE)
        store_films_remove(farm->store, id);
}

void farm_resume(struct farm *farm, uint64_t now_ns)
{
    if (farm->store)
        store_films_list(farm->store, remove_left_films, farm);
    farm_trouble_tick(farm, now_ns);
    for (size_t i = 0; i < farm->queue.count; i++)
        if (farm->queue.all[i]->state != JOB_STATE_FAILED)
            develop_list_add(farm, farm->queue.all[i]);
    for (size_t i = 0; i < farm->queue.active_count;) {
        struct job *job = farm->queue.active[i];
        if (job->state != JOB_STATE_CANCELLING && job->frames_done_count == job_frames_wanted(job) &&
            job->frames_developed_count == job->frames_done_count) {
            job_end_when_done(farm, job, now_ns);
            continue;
        }
        if (job->state == JOB_STATE_RUNNING)
            log_info("job %llu (%s) goes on: %u of %u frames are done", (unsigned long long)job->id,
                     job->name, job->frames_done_count, job_frame_count(job));
        closing_step(farm, job, now_ns);
        /* A job that ended just now has left its place to the next. */
        if (i < farm->queue.active_count && farm->queue.active[i] == job)
            i++;
    }
    farm_resume_films(farm, now_ns);
}

/* ---- time ----------------------------------------------------------------------------------- */

void farm_pause(struct farm *farm, uint64_t paused_ns)
{
    for (struct lease *lease = farm->leases.oldest; lease; lease = lease->newer)
        lease->deadline_ns += paused_ns;
}

static void worker_lapsed(struct farm *farm, const struct lease *lease, uint64_t now_ns)
{
    for (uint32_t i = 0; i < farm->worker_count; i++)
        if (&farm->workers[i]->held == lease->holder)
            credit_lapsed(&farm->workers[i]->credit, lease->granted_ns, now_ns);
}

void farm_tick(struct farm *farm, uint64_t now_ns)
{
    struct lease *lease;

    farm_trouble_tick(farm, now_ns);
    while ((lease = lease_lapsed(&farm->leases, now_ns))) {
        log_warn("lease %llu of session %u lapsed: %u work units go to other workers",
                 (unsigned long long)lease->id, lease->holder->session, lease->open_count);
        farm->events.revoke(farm->events.user, lease->holder->session, lease->id,
                            "the lease lapsed");
        worker_lapsed(farm, lease, now_ns);
        lease_end(&farm->leases, lease);
        farm->pump_wanted = 1;
    }
    for (size_t i = 0; i < farm->queue.active_count; i++) {
        struct job *job = farm->queue.active[i];
        for (struct job_frame *frame = job->frames; frame; frame = frame->next) {
            freeze_step(farm, frame, now_ns);
            farm_frame_decide(farm, frame, now_ns);
            closing_note_limits(farm, frame, now_ns);
            if (frame->state != FRAME_DEVELOPING)
                farm_frame_advance(farm, frame, now_ns);
            if (frame->state == FRAME_RENDERING)
                figures_tick(farm, frame, now_ns);
        }
        if (job->leases > 0 && now_ns - job->saved_ns >= PROGRESS_SAVE_MS * NS_PER_MS)
            farm_job_save(farm, job, now_ns);
        closing_step(farm, job, now_ns); /* the last: it may end the job */
    }
    develop_next(farm, now_ns);
}
