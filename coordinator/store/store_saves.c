/* Saves of what changes while jobs run, at once or later: a job's row, a new deliverer. */
#include <stdio.h>
#include <string.h>

#include "common/base/log.h"
#include "common/base/memory.h"
#include "coordinator/farm/farm.h"
#include "coordinator/job/frame.h"
#include "coordinator/store/store_parts.h"
#include "coordinator/job/wire.h"

/* Deliverers wait in the same list, under ids that no job has. */
#define DELIVERER_ID ((uint64_t)1 << 63)

/* A snapshot of a job's row, or a deliverer. */
struct saved_job {
    struct saved_job *next;
    uint64_t id;
    struct deliverer deliverer;  /* its number is 0: this is a job */
    enum job_state state;
    unsigned marks;
    int32_t priority;
    char waits_for[NEEDS_AFTER_TEXT_SIZE];
    int64_t not_before;
    char state_text[JOB_TEXT_MAX + 1], kernel[KERNEL_NAME_MAX + 1], release[RELEASE_NAME_MAX + 1];
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
    row->state = job->state;
    row->marks = job->marks;
    row->priority = job->priority;
    needs_after_text(row->waits_for, &job->needs);
    row->not_before = job->needs.not_before;
    memcpy(row->state_text, job->state_text, sizeof row->state_text);
    memcpy(row->kernel, job->kernel, sizeof row->kernel);
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
        s = clock_write(store, row->id, row->clocks[i].frame, row->clocks[i].active_ns,
                        row->clocks[i].cpu_ns, err);
    return s;
}

static status row_write(struct store *store, const struct saved_job *row, struct error *err)
{
    status s = sql_change_reserved(
        store,
        "UPDATE jobs SET state=?, state_text=?, kernel=?, finished_at=?, active_ns=?, conflicts=?, "
        "cpu_ns=?, trace_ns=?, release=?, marks=?, priority=?, waits_for=?, not_before=? WHERE id=?",
        SQL_VALUES(sql_number(row->state), sql_text(row->state_text), sql_text(row->kernel),
                   sql_number(row->finished_at), sql_number(row->active_ns),
                   sql_number(row->conflicts), sql_number(row->stats.cpu_ns),
                   sql_number(row->stats.trace_ns), sql_text(row->release), sql_number(row->marks),
                   sql_number(row->priority), sql_text(row->waits_for), sql_number(row->not_before),
                   sql_number(row->id)),
        "the job's state cannot be stored", err);

    return s == STATUS_OK ? clocks_write(store, row, err) : s;
}

/* Its films will not be continued. */
static int films_are_over(const struct saved_job *row)
{
    return row->state == JOB_STATE_CANCELLED && (row->marks & JOB_MARK_DISCARDED);
}

static struct saved_job **saves_find(struct store *store, uint64_t id)
{
    struct saved_job **at = &store->saves;

    while (*at && (*at)->id != id)
        at = &(*at)->next;
    return at;
}

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

/* Note the result of a row that left the list; `order` is held. A failed row goes back unless a
 * newer one came. */
static void row_written(struct store *store, struct saved_job *row, status s,
                        const struct error *why)
{
    pthread_mutex_lock(&store->lock);
    store->failing = s != STATUS_OK;
    store->retry = 0;
    if (store->failing) {
        store->save_error = *why;
        if (row && !*saves_find(store, row->id)) {
            row->next = store->saves;
            store->saves = row;
            row = NULL;
        }
    }
    store->busy = 0;
    if (!store->saves || store->failing)
        pthread_cond_broadcast(&store->idle);
    pthread_mutex_unlock(&store->lock);
    mem_free(row);
}

static int nothing_waits(const struct store *store)
{
    return !store->saves && !store->events && !store->workers && !store->shares;
}

/* Wait until there is a row or an event that may be written. 0: the store closes, and there is
 * none. */
static int await_row(struct store *store)
{
    int there;

    pthread_mutex_lock(&store->lock);
    while (!store->ending && (nothing_waits(store) || (store->failing && !store->retry)))
        pthread_cond_wait(&store->wake, &store->lock);
    there = !nothing_waits(store) && (!store->failing || store->retry);
    if (!there && store->saves)
        log_error("%s; the present states of jobs are not stored: jobs that ended continue at the next start",
                  store->save_error.text);
    store->busy = there;
    pthread_mutex_unlock(&store->lock);
    return there;
}

/* The writer thread: one row after another, until the store closes and none is left. */
static void *write_saves(void *user)
{
    struct store *store = user;

    while (await_row(store)) {
        struct error err = {0};
        struct saved_job *row;
        uint64_t ended = 0;
        status s = STATUS_OK;

        pthread_mutex_lock(&store->order);
        pthread_mutex_lock(&store->lock);
        row = store->saves; /* the first row may have been replaced */
        if (row)
            store->saves = row->next;
        pthread_mutex_unlock(&store->lock);
        if (row)
            s = row->deliverer.number ? deliverer_write(store, &row->deliverer, &err)
                                      : row_write(store, row, &err);
        if (row && s == STATUS_OK && !row->deliverer.number && films_are_over(row))
            ended = row->id;
        if (s == STATUS_OK) {
            s = events_write(store, &err);
            if (s == STATUS_OK)
                s = workers_write(store, &err);
            if (s == STATUS_OK)
                s = shares_write(store, &err);
            mem_free(s == STATUS_OK ? NULL : row); /* it is written */
            row = s == STATUS_OK ? row : NULL;
        }
        row_written(store, row, s, &err);
        pthread_mutex_unlock(&store->order);
        if (ended) /* not earlier: the job's end is on disk now */
            store_films_remove(store, ended);
    }
    return NULL;
}

void saves_init(struct store *store)
{
    pthread_mutex_init(&store->lock, NULL);
    pthread_mutex_init(&store->order, NULL);
    pthread_cond_init(&store->wake, NULL);
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
        pthread_cond_signal(&store->wake);
        pthread_mutex_unlock(&store->lock);
        pthread_join(store->writer, NULL);
    }
    while (store->saves)
        saves_drop(store, store->saves->id);
    events_drop(store);
    workers_drop(store);
    shares_drop(store);
    pthread_cond_destroy(&store->wake);
    pthread_cond_destroy(&store->idle);
    pthread_mutex_destroy(&store->lock);
    pthread_mutex_destroy(&store->order);
}

status store_job_save(struct store *store, const struct job *job, uint64_t now_ns,
                      struct error *err)
{
    struct saved_job row;
    status s;

    row_take(&row, job, now_ns);
    pthread_mutex_lock(&store->order);
    pthread_mutex_lock(&store->lock);
    saves_drop(store, job->id);
    pthread_mutex_unlock(&store->lock);
    s = row_write(store, &row, err);
    pthread_mutex_unlock(&store->order);
    if (s == STATUS_OK && films_are_over(&row))
        store_films_remove(store, row.id);
    return s;
}

/* Write the row after all that wait. */
static void save_later(struct store *store, struct saved_job *row)
{
    pthread_mutex_lock(&store->lock);
    saves_drop(store, row->id);
    *saves_find(store, UINT64_MAX) = row;
    pthread_cond_signal(&store->wake);
    pthread_mutex_unlock(&store->lock);
}

status store_deliverer_save_later(struct store *store, const struct deliverer *deliverer,
                                  struct error *err)
{
    struct saved_job *row = mem_calloc(1, sizeof *row);

    if (!row)
        return error_no_memory(err, "a worker that delivers results");
    row->id = DELIVERER_ID | deliverer->number;
    row->deliverer = *deliverer;
    save_later(store, row);
    return STATUS_OK;
}

/* Change the frame's row, or with -1 all rows of the job. */
static status change_rows(struct store *store, const char *change, uint64_t job, int64_t frame,
                          struct error *err)
{
    char text[128];

    snprintf(text, sizeof text, "%s WHERE job=?1%s", change, frame < 0 ? "" : " AND frame=?2");
    return sql_change(store, text, (const struct sql_value[]){sql_number(job), sql_number(frame)},
                      frame < 0 ? 1 : 2, "the job's frames cannot be stored", err);
}

static status forget_frames(struct store *store, const struct job *job,
                            const struct job_reopening *chosen, struct error *err)
{
    static const char *const changes[] = {
        "DELETE FROM frames", "DELETE FROM cut_frames",
        "UPDATE clocks SET from_active_ns=active_ns, from_cpu_ns=cpu_ns"};
    status s = STATUS_OK;

    for (size_t i = 0; i < sizeof changes / sizeof *changes && s == STATUS_OK; i++) {
        if (!chosen->chosen)
            s = change_rows(store, changes[i], job->id, -1, err);
        for (uint64_t frame = job->first_frame;
             chosen->chosen && frame <= job->last_frame && s == STATUS_OK; frame++)
            if (job_reopening_has(chosen, job, (uint32_t)frame))
                s = change_rows(store, changes[i], job->id, (int64_t)frame, err);
    }
    for (uint64_t frame = job->first_frame; frame <= job->last_frame && s == STATUS_OK; frame++)
        if (job_reopening_is_whole(chosen, job, (uint32_t)frame))
            s = cut_insert(store, job->id, (uint32_t)frame, FRAME_END_CAP, &chosen->coverage, err);
    return s;
}

static status change_rules(struct store *store, const struct job *job, const struct buffer *request,
                           struct error *err)
{
    return sql_change(store,
                      "UPDATE jobs SET submitted=coalesce(submitted, request), request=?, epoch_floor=? WHERE id=?",
                      SQL_VALUES(sql_bytes(request), sql_number(job->epoch_floor), sql_number(job->id)),
                      "the job's settings cannot be stored", err);
}

static status extend_rows(struct store *store, const struct job *job,
                          const struct job_reopening *chosen, const struct buffer *request,
                          const struct buffer *submitted, struct error *err)
{
    status s = !job_state_ended(job->state) ? change_rules(store, job, request, err) : sql_change(
        store,
        "UPDATE jobs SET request=?1, state=?2, state_text='', finished_at=0, epoch_floor=?3, "
        "marks=0, priority=?9, owner=?10, waits_for=NULL, not_before=NULL, name=?4, token=?5, submitted=coalesce(?6, submitted, request), submitted_at=?7 "
        "WHERE id=?8",
        SQL_VALUES(sql_bytes(request), sql_number(JOB_STATE_QUEUED), sql_number(job->epoch_floor),
                   sql_text(job->name), sql_text(job->token[0] ? job->token : NULL),
                   sql_bytes(submitted), sql_number(job->submitted_at), sql_number(job->id),
                   sql_number(job->priority), sql_text(job->owner)),
        "the job's settings cannot be stored", err);

    return s == STATUS_OK ? forget_frames(store, job, chosen, err) : s;
}

status store_job_extend(struct store *store, const struct job *job,
                        const struct job_reopening *chosen, const struct job *submitted,
                        struct error *err)
{
    struct buffer request = BUFFER_INIT, as_sent = BUFFER_INIT;
    status s = wire_job_pack(job, &request, err);

    if (s == STATUS_OK && submitted)
        s = wire_job_pack(submitted, &as_sent, err);
    pthread_mutex_lock(&store->order);
    if (job_state_ended(job->state)) {
        pthread_mutex_lock(&store->lock);
        saves_drop(store, job->id); /* its end */
        pthread_mutex_unlock(&store->lock);
    }
    if (s == STATUS_OK)
        s = sql_exec(store, "BEGIN IMMEDIATE", "cannot be written", err);
    if (s == STATUS_OK) {
        s = extend_rows(store, job, chosen, &request, &as_sent, err);
        if (s == STATUS_OK)
            s = sql_exec(store, "COMMIT", "the job's settings cannot be stored", err);
        if (s != STATUS_OK)
            (void)sqlite3_exec(store->db, "ROLLBACK", NULL, NULL, NULL);
    }
    pthread_mutex_unlock(&store->order);
    buffer_release(&as_sent);
    buffer_release(&request);
    return s;
}

status store_job_save_later(struct store *store, const struct job *job, uint64_t now_ns,
                            struct error *err)
{
    struct saved_job *row = mem_alloc(sizeof *row);

    if (!row)
        return error_no_memory(err, "a job's state");
    row_take(row, job, now_ns);
    save_later(store, row);
    return STATUS_OK;
}

void saves_retry(struct store *store)
{
    pthread_mutex_lock(&store->lock);
    store->retry = 1;
    if (nothing_waits(store) && !store->busy) /* what failed was written at once, or is gone */
        store->failing = 0;
    pthread_cond_signal(&store->wake);
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
    waits = *saves_find(store, id) != NULL;
    pthread_mutex_unlock(&store->lock);
    return waits;
}
