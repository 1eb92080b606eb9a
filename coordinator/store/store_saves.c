/* Saves of what changes while jobs run: a job's row, a new deliverer. The writer thread writes all that is noted in
 * one transaction, so that a disk that takes long to sync is asked once; then it tells who waits for that. */
#include <stdio.h>
#include <string.h>

#include "common/system/log.h"
#include "common/base/memory.h"
#include "coordinator/farm/farm.h"
#include "coordinator/frame/frame.h"
#include "coordinator/store/store_parts.h"
#include "coordinator/job/wire.h"

/* Deliverers wait in the same list, under ids that no job has. */
#define DELIVERER_ID ((uint64_t)1 << 63)

/* A snapshot of a job's row, or a deliverer. */
struct saved_job {
    struct saved_job *next;
    uint64_t id;
    struct deliverer deliverer; /* its number is 0: this is a job */
    int stale;                  /* the job has changed since this was taken: it goes on */
    enum job_state state;
    unsigned marks;
    int32_t priority;
    char waits_for[NEEDS_AFTER_TEXT_SIZE], comment[JOB_COMMENT_MAX + 1];
    int64_t not_before;
    char state_text[JOB_TEXT_MAX + 1], ray_tracer[RAY_TRACER_NAME_MAX + 1], release[RELEASE_NAME_MAX + 1];
    int64_t finished_at;
    uint64_t active_ns, conflicts;
    struct work_stats stats;
    /* The clocks of the limits of frames in work. */
    uint32_t clock_count;
    struct {
        uint32_t frame;
        uint64_t active_ns, cpu_ns;
    } clocks[FRAMES_OPEN_PER_JOB];
};

static void row_take(struct saved_job *row, const struct job *job, uint64_t now_ns)
{
    row->next = NULL;
    row->id = job->id;
    row->deliverer.number = 0;
    row->stale = 0;
    row->state = job->state;
    row->marks = job->marks;
    row->priority = job->priority;
    needs_after_text(row->waits_for, &job->needs);
    row->not_before = job->needs.not_before;
    memcpy(row->comment, job->comment, sizeof row->comment);
    memcpy(row->state_text, job->state_text, sizeof row->state_text);
    memcpy(row->ray_tracer, job->ray_tracer, sizeof row->ray_tracer);
    memcpy(row->release, job->release, sizeof row->release);
    row->finished_at = job->finished_at;
    row->active_ns = (uint64_t)(job_active_seconds(job, now_ns) * 1e9);
    row->conflicts = job->conflicts;
    row->stats = job->stats;
    row->clock_count = 0;
    for (const struct job_frame *f = job->frames; f && row->clock_count < FRAMES_OPEN_PER_JOB;
         f = f->next) {
        row->clocks[row->clock_count].frame = f->number;
        row->clocks[row->clock_count].active_ns = job_frame_active_ns(f, now_ns);
        row->clocks[row->clock_count++].cpu_ns = job_frame_cpu_ns(f);
    }
}

static status clocks_write(struct store *store, const struct saved_job *row, struct error *err)
{
    status s = STATUS_OK;

    for (uint32_t i = 0; i < row->clock_count && s == STATUS_OK; i++)
        s = clock_write(store, row->id, row->clocks[i].frame, row->clocks[i].active_ns, row->clocks[i].cpu_ns, err);
    return s;
}

static status row_write(struct store *store, const struct saved_job *row, struct error *err)
{
    uint8_t accounts[STATS_BYTES];
    struct buffer bytes = {.data = accounts, .size = sizeof accounts}; /* only read */
    status s;

    stats_pack(&row->stats, accounts);
    s = sql_change_reserved(
        store,
        "UPDATE jobs SET state=?, state_text=?, kernel=?, finished_at=?, active_ns=?, conflicts=?, "
        "cpu_ns=?, trace_ns=?, release=?, marks=?, priority=?, waits_for=?, not_before=?, comment=?, accounts=? WHERE id=?",
        SQL_VALUES(sql_number(row->state), sql_text(row->state_text), sql_text(row->ray_tracer),
                   sql_number(row->finished_at), sql_number(row->active_ns), sql_number(row->conflicts),
                   sql_number(row->stats.cpu_ns), sql_number(row->stats.trace_ns), sql_text(row->release),
                   sql_number(row->marks), sql_number(row->priority), sql_text(row->waits_for),
                   sql_number(row->not_before), sql_text(row->comment), sql_bytes(&bytes), sql_number(row->id)),
        "the job's state cannot be stored", err);

    if (s == STATUS_OK && sqlite3_changes(store->db) == 0)
        return STATUS_OK; /* the job was removed meanwhile */
    return s == STATUS_OK ? clocks_write(store, row, err) : s;
}

/* Its films will not be continued. */
static int films_are_over(const struct saved_job *row)
{
    return job_state_ended(row->state) && (row->marks & JOB_MARK_DISCARDED);
}

static struct saved_job **find_in(struct saved_job **list, uint64_t id)
{
    while (*list && (*list)->id != id)
        list = &(*list)->next;
    return list;
}

static struct saved_job **saves_find(struct store *store, uint64_t id) { return find_in(&store->saves, id); }

/* Take the job's waiting row out of the list: a newer one follows. */
static void saves_drop(struct store *store, uint64_t id)
{
    struct saved_job **at = saves_find(store, id), *row = *at;

    if (!row)
        return;
    *at = row->next;
    mem_free(row);
}

void saves_forget(struct store *store, uint64_t id)
{
    pthread_mutex_lock(&store->lock);
    saves_drop(store, id);
    pthread_mutex_unlock(&store->lock);
}

/* ---- who waits ------------------------------------------------------------------------------ */

struct saved_wait {
    struct saved_wait *next;
    store_done_fn *done;
    void *user;
    status result;
    struct error error;
};

status store_when_saved(struct store *store, store_done_fn *done, void *user, struct error *err)
{
    struct saved_wait *wait = mem_calloc(1, sizeof *wait);

    NEED(wait, err, "an answer that waits for the disk");
    wait->done = done;
    wait->user = user;
    pthread_mutex_lock(&store->lock);
    if (!store->waits)
        store->waits_end = &store->waits;
    *store->waits_end = wait;
    store->waits_end = &wait->next;
    store->retry = 1; /* a failure is found by trying */
    pthread_cond_signal(&store->work);
    pthread_mutex_unlock(&store->lock);
    return STATUS_OK;
}

void store_on_saved(struct store *store, void (*wake)(void *user), void *user)
{
    pthread_mutex_lock(&store->lock);
    store->wake = wake;
    store->wake_user = user;
    pthread_mutex_unlock(&store->lock);
}

void store_deliver(struct store *store)
{
    struct saved_wait *over;

    pthread_mutex_lock(&store->lock);
    over = store->waits_over;
    store->waits_over = NULL;
    pthread_mutex_unlock(&store->lock);
    while (over) {
        struct saved_wait *next = over->next;
        over->done(over->user, over->result, &over->error);
        mem_free(over);
        over = next;
    }
}

static int nothing_is_noted(const struct store *store)
{
    return !store->saves && !store->changes.first && !store->clears.first && !store->events.first &&
           !store->workers.first && !store->shares;
}

static int nothing_waits(const struct store *store) { return nothing_is_noted(store) && !store->waits; }

void store_settle(struct store *store)
{
    pthread_mutex_lock(&store->lock);
    while (store->has_writer && (store->busy || (!nothing_waits(store) && (!store->failing || store->retry))))
        pthread_cond_wait(&store->idle, &store->lock);
    pthread_mutex_unlock(&store->lock);
    store_deliver(store);
}

/* ---- the writer thread ---------------------------------------------------------------------- */

/* Wait until there is something that may be written. 0: the store closes, and there is nothing. */
static int await_work(struct store *store)
{
    int there;

    pthread_mutex_lock(&store->lock);
    while (!store->ending && (nothing_waits(store) || (store->failing && !store->retry)))
        pthread_cond_wait(&store->work, &store->lock);
    there = !nothing_waits(store) && (!store->failing || store->retry);
    if (!there && store->saves)
        log_error("%s; the present states of jobs are not stored: jobs that ended continue at the next start",
                  store->save_error.text);
    store->busy = there;
    pthread_mutex_unlock(&store->lock);
    return there;
}

/* Set aside what is noted, and who waits for it. */
static struct saved_wait *take_all(struct store *store)
{
    struct saved_wait *waits;

    pthread_mutex_lock(&store->lock);
    waits = store->waits;
    store->waits = NULL;
    store->saves_taken = store->saves;
    store->saves = NULL;
    noted_take(&store->changes);
    noted_take(&store->clears);
    noted_take(&store->events);
    noted_take(&store->workers);
    shares_take(store);
    pthread_mutex_unlock(&store->lock);
    return waits;
}

static status rows_write(struct store *store, struct error *err)
{
    status s = STATUS_OK;

    for (const struct saved_job *row = store->saves_taken; row && s == STATUS_OK; row = row->next)
        s = row->deliverer.number ? deliverer_write(store, &row->deliverer, err) : row_write(store, row, err);
    return s;
}

static status others_write(struct store *store, struct error *err)
{
    TRY(events_write(store, err));
    TRY(workers_write(store, err));
    return shares_write(store, err);
}

/* In one transaction: the rows, what else was noted, or both. */
static status write_once(struct store *store, int rows, int others, struct error *err)
{
    status s = sql_exec(store, "BEGIN IMMEDIATE", "cannot be written", err);

    if (s != STATUS_OK)
        return s;
    if (rows) {
        s = changes_write(store, err);
        THEN(s, rows_write(store, err));
    }
    if (s == STATUS_OK && others)
        s = others_write(store, err);
    THEN(s, sql_exec(store, "COMMIT", "the job's state cannot be stored", err));
    return s;
}

static void roll_back(struct store *store)
{
    if (!sqlite3_get_autocommit(store->db))
        (void)sqlite3_exec(store->db, "ROLLBACK", NULL, NULL, NULL);
}

/* The states of jobs must not wait for others to free space, nor for what else cannot be written: they are tried
 * again alone, on a full disk with the reserve. */
static status write_taken(struct store *store, int *rows, int *others, struct error *err)
{
    status s = write_once(store, 1, 1, err);

    *rows = *others = s == STATUS_OK;
    if (s == STATUS_OK)
        return s;
    if (store->saves_taken || store->changes.taken) {
        (void)sql_give_reserve(store);
        roll_back(store);
        *rows = write_once(store, 1, 0, err) == STATUS_OK;
        roll_back(store);
        if (*rows && (s = write_once(store, 0, 1, err)) == STATUS_OK)
            *others = 1;
    }
    roll_back(store);
    return s;
}

/* Rows that could not be written are noted again, unless newer ones came; the films of jobs that were cancelled for good
 * go when that is on disk, not earlier. `lock` is held. */
static void rows_settle(struct store *store, int written)
{
    while (store->saves_taken) {
        struct saved_job *row = store->saves_taken;

        store->saves_taken = row->next;
        if (written && !row->stale && !row->deliverer.number && films_are_over(row))
            store_films_remove(store, row->id); /* with `lock`: such a job may go on, and have new films */
        if (!written && !row->stale && !*saves_find(store, row->id)) {
            row->next = store->saves;
            store->saves = row;
        } else {
            mem_free(row);
        }
    }
}

/* `order` is held: no other row of these jobs was written meanwhile. */
static void settle(struct store *store, int rows, int others, status s, const struct error *why)
{
    pthread_mutex_lock(&store->lock);
    rows_settle(store, rows);
    noted_settle(&store->changes, rows);
    if (!rows)
        noted_settle(&store->clears, 0);
    noted_settle(&store->events, others);
    noted_settle(&store->workers, others);
    shares_settle(store, others);
    store->failing = s != STATUS_OK;
    store->retry = store->waits != NULL;
    if (store->failing)
        store->save_error = *why;
    pthread_mutex_unlock(&store->lock);
}

static void end_waits(struct store *store, struct saved_wait *waits, status s, const struct error *why)
{
    struct saved_wait **last;

    for (struct saved_wait *wait = waits; wait; wait = wait->next) {
        wait->result = s;
        wait->error = *why;
    }
    pthread_mutex_lock(&store->lock);
    for (last = &store->waits_over; *last; last = &(*last)->next)
        ;
    *last = waits;
    store->busy = 0;
    pthread_cond_broadcast(&store->idle);
    if (waits && store->wake)
        store->wake(store->wake_user);
    pthread_mutex_unlock(&store->lock);
}

/* Until the store closes and nothing is left. */
static void *write_saves(void *user)
{
    struct store *store = user;

    while (await_work(store)) {
        struct error err = {0};
        struct saved_wait *waits;
        int rows = 1, others = 1;
        status s = STATUS_OK;

        pthread_mutex_lock(&store->order);
        waits = take_all(store);
        if (store->saves_taken || store->changes.taken || store->events.taken || store->workers.taken || store->shares_taken)
            s = write_taken(store, &rows, &others, &err);
        settle(store, rows, others, s, &err);
        clears_run(store);
        pthread_mutex_unlock(&store->order);
        end_waits(store, waits, s, &err);
    }
    return NULL;
}

void saves_init(struct store *store)
{
    pthread_mutex_init(&store->lock, NULL);
    pthread_mutex_init(&store->order, NULL);
    pthread_mutex_init(&store->reading, NULL);
    pthread_cond_init(&store->work, NULL);
    pthread_cond_init(&store->idle, NULL);
}

status saves_start(struct store *store, struct error *err)
{
    if (pthread_create(&store->writer, NULL, write_saves, store) != 0)
        return error_set(err, STATUS_ERR_NO_MEMORY, "%s: no thread for the store", store->folder);
    store->has_writer = 1;
    return STATUS_OK;
}

void saves_stop(struct store *store)
{
    if (store->has_writer) {
        pthread_mutex_lock(&store->lock);
        store->ending = store->retry = 1;
        pthread_cond_signal(&store->work);
        pthread_mutex_unlock(&store->lock);
        pthread_join(store->writer, NULL);
        store->has_writer = 0;
    }
    store_deliver(store);
    while (store->saves)
        saves_drop(store, store->saves->id);
    noted_drop(&store->changes);
    noted_drop(&store->clears);
    noted_drop(&store->events);
    noted_drop(&store->workers);
    shares_drop(store);
    pthread_cond_destroy(&store->work);
    pthread_cond_destroy(&store->idle);
    pthread_mutex_destroy(&store->lock);
    pthread_mutex_destroy(&store->order);
    pthread_mutex_destroy(&store->reading);
}

/* Write the row after all that wait. */
static void save_later(struct store *store, struct saved_job *row)
{
    pthread_mutex_lock(&store->lock);
    saves_drop(store, row->id);
    *saves_find(store, UINT64_MAX) = row;
    pthread_cond_signal(&store->work);
    pthread_mutex_unlock(&store->lock);
}

status store_deliverer_save_later(struct store *store, const struct deliverer *deliverer, struct error *err)
{
    struct saved_job *row = mem_calloc(1, sizeof *row);

    NEED(row, err, "a worker that delivers results");
    row->id = DELIVERER_ID | deliverer->number;
    row->deliverer = *deliverer;
    save_later(store, row);
    return STATUS_OK;
}

/* Note the change of the frame's row, or with -1 of all rows of the job. */
static status change_rows(struct noted_list *list, const char *change, uint64_t job, int64_t frame, struct error *err)
{
    char text[128];

    snprintf(text, sizeof text, "%s WHERE job=?1%s", change, frame < 0 ? "" : " AND frame=?2");
    return changes_add(list, text, (const struct sql_value[]){sql_number((int64_t)job), sql_number(frame)},
                       frame < 0 ? 1 : 2, "the job's frames cannot be stored", err);
}

/* `frame` -1: all. */
static status forget_rows(struct noted_list *list, uint64_t job, int64_t frame, struct error *err)
{
    TRY(change_rows(list, "DELETE FROM frames", job, frame, err));
    TRY(change_rows(list, "DELETE FROM cut_frames", job, frame, err));
    return changes_add_clock(list, job, frame, err);
}

static status forget_frames(struct noted_list *list, const struct job *job, const struct job_reopening *chosen,
                            struct error *err)
{
    status s = STATUS_OK;

    if (!chosen->chosen)
        s = forget_rows(list, job->id, -1, err);
    for (uint64_t frame = job->first_frame; chosen->chosen && frame <= job->last_frame && s == STATUS_OK; frame++)
        if (job_reopening_has(chosen, job, (uint32_t)frame))
            s = forget_rows(list, job->id, (int64_t)frame, err);
    for (uint64_t frame = job->first_frame; frame <= job->last_frame && s == STATUS_OK; frame++)
        if (job_reopening_is_whole(chosen, job, (uint32_t)frame))
            s = cut_note(list, job->id, (uint32_t)frame, FRAME_END_CAP, &chosen->coverage, err);
    for (uint64_t frame = job->first_frame; frame <= job->last_frame && s == STATUS_OK; frame++)
        if (job_reopening_remakes(chosen, job, (uint32_t)frame))
            s = change_rows(list, "UPDATE frames SET revision=-1", job->id, (int64_t)frame, err);
    return s;
}

static status change_rules(struct noted_list *list, const struct job *job, const struct buffer *request, struct error *err)
{
    return changes_add(list,
                       "UPDATE jobs SET submitted=coalesce(submitted, request), request=?, epoch_floor=? WHERE id=?",
                       SQL_VALUES(sql_bytes(request), sql_number(job->epoch_floor), sql_number(job->id)),
                       "the job's settings cannot be stored", err);
}

static status extend_rows(struct noted_list *list, const struct job *job, const struct job_reopening *chosen,
                          const struct buffer *request, const struct buffer *submitted, struct error *err)
{
    status s = !job_state_ended(job->state) ? change_rules(list, job, request, err) : changes_add(
        list,
        "UPDATE jobs SET request=?1, state=?2, state_text='', finished_at=0, epoch_floor=?3, "
        "marks=0, priority=?9, owner=?10, waits_for=NULL, not_before=NULL, name=?4, token=?5, submitted=coalesce(?6, submitted, request), submitted_at=?7 "
        "WHERE id=?8",
        SQL_VALUES(sql_bytes(request), sql_number(JOB_STATE_QUEUED), sql_number(job->epoch_floor),
                   sql_text(job->name), sql_text(job->token[0] ? job->token : NULL),
                   sql_bytes(submitted), sql_number(job->submitted_at), sql_number(job->id),
                   sql_number(job->priority), sql_text(job->owner)),
        "the job's settings cannot be stored", err);

    return s == STATUS_OK ? forget_frames(list, job, chosen, err) : s;
}

/* Its end is not to be written any more, nor, if it is being written, again after this. */
static void forget_end(struct store *store, uint64_t id)
{
    pthread_mutex_lock(&store->lock);
    saves_drop(store, id);
    for (struct saved_job *row = store->saves_taken; row; row = row->next)
        if (row->id == id)
            row->stale = 1;
    pthread_mutex_unlock(&store->lock);
}

status store_job_extend(struct store *store, const struct job *job, const struct job_reopening *chosen,
                        const struct job *submitted, struct error *err)
{
    struct buffer request = BUFFER_INIT, as_sent = BUFFER_INIT;
    struct noted_list list = {0};
    status s = wire_job_pack(job, &request, err);

    if (s == STATUS_OK && submitted)
        s = wire_job_pack(submitted, &as_sent, err);
    THEN(s, extend_rows(&list, job, chosen, &request, &as_sent, err));
    if (s == STATUS_OK) {
        if (job_state_ended(job->state))
            forget_end(store, job->id);
        changes_note(store, &list);
    }
    noted_drop(&list);
    buffer_release(&as_sent);
    buffer_release(&request);
    return s;
}

status store_job_save_later(struct store *store, const struct job *job, uint64_t now_ns, struct error *err)
{
    struct saved_job *row = mem_alloc(sizeof *row);

    NEED(row, err, "a job's state");
    row_take(row, job, now_ns);
    save_later(store, row);
    return STATUS_OK;
}

void saves_retry(struct store *store)
{
    pthread_mutex_lock(&store->lock);
    store->retry = 1;
    if (nothing_is_noted(store) && !store->busy) /* what failed was written at once, or is gone */
        store->failing = 0;
    pthread_cond_signal(&store->work);
    pthread_mutex_unlock(&store->lock);
}

status saves_state(struct store *store, struct error *err)
{
    status s = STATUS_OK;

    pthread_mutex_lock(&store->lock);
    if (store->failing)
        s = error_set(err, store->save_error.code, "%s", store->save_error.text);
    pthread_mutex_unlock(&store->lock);
    return s;
}

status store_await_saves(struct store *store, struct error *err)
{
    pthread_mutex_lock(&store->lock);
    while (!store->failing && (store->saves || store->busy))
        pthread_cond_wait(&store->idle, &store->lock);
    pthread_mutex_unlock(&store->lock);
    return saves_state(store, err);
}

int store_job_unsaved(struct store *store, uint64_t id)
{
    int waits;

    pthread_mutex_lock(&store->lock);
    waits = *saves_find(store, id) || *find_in(&store->saves_taken, id);
    pthread_mutex_unlock(&store->lock);
    return waits;
}
