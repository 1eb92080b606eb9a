#include "coordinator/farm/farm.h"

#include <string.h>

#include "common/system/clock.h"
#include "common/system/log.h"
#include "common/base/memory.h"
#include "coordinator/farm/closing.h"
#include "coordinator/farm/figures.h"
#include "coordinator/farm/freeze.h"
#include "coordinator/farm/roster.h"
#include "coordinator/farm/waiting.h"

/* ---- life ----------------------------------------------------------------------------------- */

static status adopt_job(void *user, struct job *job, struct error *err)
{
    struct farm *farm = user;

    return queue_add(&farm->queue, job, err);
}

status farm_init(struct farm *farm, struct store *store, uint64_t lease_ns, const struct farm_events *events,
                 int64_t wall_s, struct error *err)
{
    uint64_t epoch = 1;
    status s = STATUS_OK;

    memset(farm, 0, sizeof *farm);
    queue_init(&farm->queue);
    order_init(&farm->order);
    farm->store = store;
    farm->events = *events;
    farm->wall_s = farm->begun_s = wall_s;
    farm_wake(farm);
    farm->hang_ns = HANG_LEAST_S * NS_PER_SECOND;
    if (store) {
        s = store_epoch_begin(store, wall_s, &epoch, err);
        THEN(s, store_deliverers_last(store, &farm->last_deliverer, err));
        THEN(s, store_jobs_load(store, adopt_job, farm, err));
        THEN(s, roster_load(farm, err));
        THEN(s, store_shares_load(store, &farm->order, err));
    }
    if (s != STATUS_OK) {
        roster_release(farm);
        queue_release(&farm->queue);
        order_release(&farm->order);
        return s;
    }
    if (farm->queue.count > 0)
        farm->last_old_job = farm->queue.all[farm->queue.count - 1]->id;
    farm->told = epoch;
    lease_table_init(&farm->leases, epoch, lease_ns);
    return STATUS_OK;
}

void farm_release(struct farm *farm, uint64_t now_ns)
{
    for (size_t i = 0; i < farm->queue.active_count; i++) {
        struct job *job = farm->queue.active[i];
        farm_job_save(farm, job, now_ns);
    }
    waiting_save_shares(farm, 1, now_ns);
    lease_table_release(&farm->leases);
    for (size_t i = 0; i < farm->queue.count; i++)
        while (farm->queue.all[i]->frames) {
            farm->queue.all[i]->frames->ack_count = 0; /* the workers keep them for the next run */
            farm_frame_close(farm, farm->queue.all[i]->frames, "the coordinator ends");
        }
    queue_release(&farm->queue);
    trace_release(&farm->trace);
    roster_release(farm);
    mem_free(farm->distrusted);
    mem_free(farm->again);
    order_release(&farm->order);
}

/* ---- jobs ----------------------------------------------------------------------------------- */

status farm_prepare(const struct farm *farm, struct job *job, struct error *err)
{
    job_fence(job, farm->leases.epoch);
    job_set_submitted(job, farm->wall_s);
    if (farm_store_usable(farm, err) != STATUS_OK)
        return STATUS_ERR_IO;
    if (farm->queue.active_count >= JOBS_ACTIVE_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "%d jobs are queued or running already; wait for some to end",
                         JOBS_ACTIVE_MAX);
    return waiting_check(farm, job, err);
}

status farm_adopt(struct farm *farm, struct job *job, struct error *err)
{
    status s = queue_add(&farm->queue, job, err);

    if (s != STATUS_OK) {
        if (farm->store)
            store_job_forget(farm->store, job->id);
        return s;
    }
    farm_note(farm, job, job->owner[0] ? job->owner : NULL, "submitted as %s", job->name);
    farm_wake(farm);
    farm->events.job_changed(farm->events.user, job);
    return STATUS_OK;
}

status farm_submit(struct farm *farm, struct job *job, struct error *err)
{
    TRY(farm_prepare(farm, job, err));
    if (farm->store) {
        TRY(store_job_insert(farm->store, job, err));
    } else {
        job_set_id(job, farm->queue.count ? farm->queue.all[farm->queue.count - 1]->id + 1 : 1);
    }
    return farm_adopt(farm, job, err);
}

void farm_cancel(struct farm *farm, struct job *job, int discard, uint64_t now_ns)
{
    if (job_state_ended(job->state) && discard) {
        job_mark(job, JOB_MARK_DISCARDED);
        farm_job_save(farm, job, now_ns);
    }
    if (job_state_ended(job->state) || (job->state == JOB_STATE_CANCELLING && !discard))
        return;
    if (!discard) {
        closing_begin(farm, job, now_ns);
        return;
    }
    job_mark(job, JOB_MARK_DISCARDED);
    farm_job_change(farm, job, JOB_STATE_CANCELLED, "cancelled, unfinished frames discarded", now_ns);
}

/* ---- after a restart ------------------------------------------------------------------------- */

/* Open the frames that have a film on disk. */
static void resume_films(struct farm *farm, struct job *job, uint64_t now_ns)
{
    for (uint64_t number = job->first_frame; number <= job->last_frame; number++)
        if (!job_frame_is_done(job, (uint32_t)number) && !farm_frame_find(job, (uint32_t)number) &&
            store_film_exists(farm->store, job->id, (uint32_t)number) &&
            !farm_frame_open(farm, job, (uint32_t)number, now_ns))
            return;
}

static void resume_all_films(struct farm *farm, uint64_t now_ns)
{
    for (size_t i = 0; farm->store && i < farm->queue.active_count; i++)
        if (farm->queue.active[i]->state == JOB_STATE_RUNNING)
            resume_films(farm, farm->queue.active[i], now_ns);
}

static void save_again(struct farm *farm, uint64_t now_ns)
{
    if (!farm->unsaved)
        return;
    farm->unsaved = 0;
    for (size_t i = 0; i < farm->queue.count; i++)
        if (farm->queue.all[i]->unsaved)
            farm_job_save(farm, farm->queue.all[i], now_ns);
}

static void trouble_tick(struct farm *farm, uint64_t now_ns)
{
    farm_store_check(farm, now_ns);
    if (trouble_is(&farm->trouble))
        return;
    if (farm->resume_wanted) {
        farm->resume_wanted = 0;
        resume_all_films(farm, now_ns);
    }
    save_again(farm, now_ns);
    for (struct job *job = queue_next(&farm->queue, CANDIDATES_BIT(CANDIDATES_TROUBLED), NULL); job;
         job = queue_next(&farm->queue, CANDIDATES_BIT(CANDIDATES_TROUBLED), job))
        if (job_state_is_open(job->state) && !trouble_waits(&job->trouble, now_ns))
            (void)farm_frame_open_next(farm, job, now_ns);
}

/* A job's films: what they have, or, if the coordinator was killed after the job's end was stored and before its films
 * were removed, they are not needed. */
static void look_at_films(void *user, uint64_t id)
{
    struct farm *farm = user;
    struct job *job = queue_find(&farm->queue, id);

    if (job && job_state_ended(job->state) && (job->marks & JOB_MARK_DISCARDED))
        store_films_remove(farm->store, id);
    else if (job && (!job_state_ended(job->state) || job->state == JOB_STATE_FAILED))
        farm_note_closed(farm, job);
}

void farm_resume(struct farm *farm, uint64_t now_ns)
{
    if (farm->store)
        store_clear_removed(farm->store);
    if (farm->store)
        store_films_list(farm->store, look_at_films, farm);
    trouble_tick(farm, now_ns);
    for (size_t i = 0; i < farm->queue.count; i++)
        if (farm->queue.all[i]->state != JOB_STATE_FAILED)
            farm_pictures_wanted(farm, farm->queue.all[i]);
    (void)waiting_order(farm, now_ns);
    for (size_t i = 0; i < farm->queue.active_count;) {
        struct job *job = farm->queue.active[i];
        if (job->state != JOB_STATE_CANCELLING && job->state != JOB_STATE_FINISHING &&
            job->frames_done_count == job_frames_wanted(job) &&
            job->frames_developed_count == job->frames_done_count) {
            farm_job_end_when_done(farm, job, now_ns);
            continue;
        }
        if (job->state == JOB_STATE_RUNNING)
            log_info("job %llu (%s) continues: %u of %u frames are done", (unsigned long long)job->id, job->name,
                     job->frames_done_count, job_frame_count(job));
        closing_step(farm, job, now_ns);
        /* A job that has just ended has left its place to the next one. */
        if (i < farm->queue.active_count && farm->queue.active[i] == job)
            i++;
    }
    resume_all_films(farm, now_ns);
}

/* ---- time ----------------------------------------------------------------------------------- */

void farm_pause(struct farm *farm, uint64_t paused_ns)
{
    for (struct lease *lease = farm->leases.oldest; lease; lease = lease->newer)
        lease->deadline_ns += paused_ns;
}

static void worker_lapsed(struct farm *farm, const struct lease *lease, uint64_t now_ns)
{
    struct farm_worker *worker = farm_worker_of(lease);

    credit_lapsed(&worker->credit, lease->granted_ns, now_ns);
    workforce_counts(farm, worker);
}

/* How many threads are at work for each job, for its time left. Of a worker that holds leases of several jobs, for that of the
 * oldest one. */
static void count_threads(struct farm *farm, uint64_t now_ns)
{
    const unsigned in_work = CANDIDATES_BIT(CANDIDATES_WORKING) | CANDIDATES_BIT(CANDIDATES_CLOSING);
    struct job *job;

    for (job = queue_next(&farm->queue, in_work, NULL); job; job = queue_next(&farm->queue, in_work, job))
        job->threads = 0;
    farm->counting++;
    for (struct lease *lease = farm->leases.oldest; lease; lease = lease->newer) {
        struct farm_worker *worker = farm_worker_of(lease);
        if (worker->counted == farm->counting)
            continue;
        worker->counted = farm->counting;
        lease->frame->job->threads += worker->threads;
    }
    for (job = queue_next(&farm->queue, in_work, NULL); job; job = queue_next(&farm->queue, in_work, job))
        if (job->threads > 0)
            throughput_set_threads(&job->throughput, job->threads, now_ns);
}

void farm_tick(struct farm *farm, uint64_t now_ns)
{
    const unsigned in_work = CANDIDATES_BIT(CANDIDATES_WORKING) | CANDIDATES_BIT(CANDIDATES_CLOSING);
    struct lease *lease;

    trouble_tick(farm, now_ns);
    (void)waiting_order(farm, now_ns);
    waiting_save_shares(farm, 0, now_ns);
    while ((lease = lease_lapsed(&farm->leases, now_ns))) {
        log_warn("lease %llu of session %u lapsed: %u work units go to other workers", (unsigned long long)lease->id,
                 lease->holder->session, lease->open_count);
        farm->events.revoke(farm->events.user, lease->holder->session, lease->id, "the lease lapsed");
        worker_lapsed(farm, lease, now_ns);
        farm->counts.leases_lapsed++;
        lease_end(&farm->leases, lease);
        farm_wake(farm);
    }
    farm_workers_tick(farm, now_ns);
    count_threads(farm, now_ns);
    for (struct job *job = queue_next(&farm->queue, in_work, NULL), *next; job; job = next) {
        for (struct job_frame *frame = job->frames, *frame_next; frame; frame = frame_next) {
            frame_next = frame->next;
            freeze_step(farm, frame, now_ns);
            farm_frame_decide(farm, frame, now_ns);
            closing_note_limits(farm, frame, now_ns);
            if (frame->state != FRAME_DEVELOPING)
                farm_frame_advance(farm, frame, now_ns);
            if (frame->state == FRAME_RENDERING)
                figures_tick(farm, frame, now_ns);
            farm_frame_leave(farm, frame, now_ns);
        }
        if (job->leases > 0 && now_ns - job->saved_ns >= PROGRESS_SAVE_MS * NS_PER_MS)
            farm_job_save(farm, job, now_ns);
        next = queue_next(&farm->queue, in_work, job);
        closing_step(farm, job, now_ns); /* the last: it may end the job */
    }
    farm_pictures_next(farm, now_ns);
}
