/* The event logs of jobs: what happened, when, and who did it. An event is noted in memory and
 * written soon by the store's own thread, or before the answer to the person who caused it. */
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "common/base/log.h"
#include "common/base/memory.h"
#include "coordinator/store/store_parts.h"

enum {
    EVENTS_WAITING_MAX = 4096,
    EVENTS_GAP = 1 << 20, /* numbers that a run may have given without writing them, while the store failed */
};

const char events_schema[] =
    "CREATE TABLE events (seq INTEGER PRIMARY KEY AUTOINCREMENT, job INTEGER NOT NULL,"
    " at INTEGER NOT NULL, worker INTEGER NOT NULL, who TEXT NOT NULL, text TEXT NOT NULL);"
    "CREATE INDEX events_job ON events (job, worker, seq);";

struct saved_event {
    struct saved_event *next;
    struct job_event event;
};

status events_begin(struct store *store, struct error *err)
{
    sqlite3_stmt *statement = NULL;
    status s = sql_select(store, "SELECT seq FROM sqlite_sequence WHERE name='events'", NULL, 0, &statement, err);
    int code;

    if (s != STATUS_OK)
        return s;
    store->event_next = 1;
    code = sqlite3_step(statement);
    if (code == SQLITE_ROW)
        store->event_next = column_number(statement, 0) + EVENTS_GAP;
    else if (code != SQLITE_DONE)
        s = sql_error(store, "the number of the last event cannot be read", err);
    sqlite3_finalize(statement);
    return s;
}

uint64_t store_event_later(struct store *store, const struct job_event *event)
{
    struct saved_event *saved = mem_alloc(sizeof *saved);
    uint64_t seq;

    if (!saved) {
        log_warn("job %" PRIu64 ": '%s' is not in its log: no memory", event->job, event->text);
        return 0;
    }
    *saved = (struct saved_event){.event = *event};
    pthread_mutex_lock(&store->lock);
    seq = saved->event.seq = store->event_next++;
    if (store->events_waiting == EVENTS_WAITING_MAX) { /* the store has failed for long */
        struct saved_event *oldest = store->events;
        store->events = oldest->next;
        store->events_waiting--;
        mem_free(oldest);
    }
    if (!store->events)
        store->events_end = &store->events;
    *store->events_end = saved;
    store->events_end = &saved->next;
    store->events_waiting++;
    pthread_cond_signal(&store->wake);
    pthread_mutex_unlock(&store->lock);
    return seq;
}

static status event_write(struct store *store, const struct job_event *e, struct error *err)
{
    status s = sql_change(store,
                          "INSERT INTO events (seq, job, at, worker, who, text) VALUES (?, ?, ?, ?, ?, ?)",
                          SQL_VALUES(sql_number(e->seq), sql_number((int64_t)e->job), sql_number(e->at),
                                     sql_number(e->from_worker), sql_text(e->who),
                                     sql_text(e->text)),
                          "a job's event cannot be stored", err);

    if (s != STATUS_OK)
        return s;
    return sql_change(store,
                      "DELETE FROM events WHERE job=?1 AND worker=?2 AND seq <= (SELECT seq FROM "
                      "events WHERE job=?1 AND worker=?2 ORDER BY seq DESC LIMIT 1 OFFSET ?3)",
                      SQL_VALUES(sql_number((int64_t)e->job), sql_number(e->from_worker),
                                 sql_number(e->from_worker ? JOB_WORKER_LINES_MAX : JOB_EVENTS_MAX)),
                      "a job's old events cannot be removed", err);
}

/* Put events back that could not be written; newer ones may have come. */
static void put_back(struct store *store, struct saved_event *first, size_t count)
{
    struct saved_event *last = first;

    while (last->next)
        last = last->next;
    pthread_mutex_lock(&store->lock);
    last->next = store->events;
    if (!store->events)
        store->events_end = &last->next;
    store->events = first;
    store->events_waiting += count;
    pthread_mutex_unlock(&store->lock);
}

status events_write(struct store *store, struct error *err)
{
    struct saved_event *first;
    size_t count;
    status s;

    pthread_mutex_lock(&store->lock);
    first = store->events;
    count = store->events_waiting;
    store->events = NULL;
    store->events_waiting = 0;
    pthread_mutex_unlock(&store->lock);
    if (!first)
        return STATUS_OK;
    s = sql_exec(store, "BEGIN IMMEDIATE", "cannot be written", err);
    if (s == STATUS_OK) {
        for (const struct saved_event *e = first; e && s == STATUS_OK; e = e->next)
            s = event_write(store, &e->event, err);
        if (s == STATUS_OK)
            s = sql_exec(store, "COMMIT", "a job's events cannot be stored", err);
        if (s != STATUS_OK)
            (void)sqlite3_exec(store->db, "ROLLBACK", NULL, NULL, NULL);
    }
    if (s != STATUS_OK) {
        put_back(store, first, count);
        return s;
    }
    while (first) {
        struct saved_event *next = first->next;
        mem_free(first);
        first = next;
    }
    return STATUS_OK;
}

void events_drop(struct store *store)
{
    while (store->events) {
        struct saved_event *next = store->events->next;
        mem_free(store->events);
        store->events = next;
    }
    store->events_waiting = 0;
}

void store_events_flush(struct store *store)
{
    struct error err = {0};

    pthread_mutex_lock(&store->order);
    if (events_write(store, &err) != STATUS_OK)
        log_debug("%s", err.text);
    pthread_mutex_unlock(&store->order);
}

typedef status event_visit(void *user, const struct job_event *event, struct error *err);

/* Call visit for each row: seq, job, at, worker, who, text. */
static status load_rows(struct store *store, const char *sql, const struct sql_value *values, size_t count,
                        event_visit *visit, void *user, struct error *err)
{
    sqlite3_stmt *statement = NULL;
    int code = SQLITE_DONE;
    status s;

    pthread_mutex_lock(&store->order);
    s = sql_select(store, sql, values, count, &statement, err);
    while (s == STATUS_OK && (code = sqlite3_step(statement)) == SQLITE_ROW) {
        struct job_event e = {.seq = column_number(statement, 0), .job = column_number(statement, 1),
                              .at = sqlite3_column_int64(statement, 2),
                              .from_worker = sqlite3_column_int(statement, 3)};
        column_text(statement, 4, e.who, sizeof e.who);
        column_text(statement, 5, e.text, sizeof e.text);
        s = visit(user, &e, err);
    }
    if (s == STATUS_OK && code != SQLITE_DONE)
        s = sql_error(store, "events cannot be read", err);
    sqlite3_finalize(statement);
    pthread_mutex_unlock(&store->order);
    return s;
}

status store_events_load(struct store *store, uint64_t job, uint64_t after, event_visit *visit, void *user,
                         struct error *err)
{
    return load_rows(store,
                     "SELECT seq, job, at, worker, who, text FROM events WHERE job=? AND seq>? ORDER BY seq",
                     SQL_VALUES(sql_number((int64_t)job), sql_number((int64_t)after)), visit, user, err);
}

status store_events_load_all(struct store *store, uint64_t after, int newest, uint32_t limit, event_visit *visit,
                             void *user, struct error *err)
{
    return load_rows(store,
                     newest ? "SELECT * FROM (SELECT seq, job, at, worker, who, text FROM events WHERE seq>? "
                              "ORDER BY seq DESC LIMIT ?) ORDER BY seq"
                            : "SELECT seq, job, at, worker, who, text FROM events WHERE seq>? ORDER BY seq LIMIT ?",
                     SQL_VALUES(sql_number((int64_t)after), sql_number(limit)), visit, user, err);
}
