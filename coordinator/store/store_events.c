/* The event logs of jobs: what happened, when, and who did it. An event is noted in memory and
 * written soon by the store's own thread; the answer to the person who caused it waits for that. A reader of a
 * log finds both the stored events and those in memory. */
#include <inttypes.h>
#include <string.h>

#include "common/system/log.h"
#include "common/base/memory.h"
#include "coordinator/store/store_parts.h"

enum {
    EVENTS_WAITING_MAX = 4096,
    EVENTS_GAP = 1 << 20, /* numbers that a run may have given without writing them, while the store failed */
};

const char events_schema[] = "CREATE TABLE events (seq INTEGER PRIMARY KEY AUTOINCREMENT, job INTEGER NOT NULL,"
                             " at INTEGER NOT NULL, worker INTEGER NOT NULL, who TEXT NOT NULL, text TEXT NOT NULL);"
                             "CREATE INDEX events_job ON events (job, worker, seq);";

struct saved_event {
    struct noted noted;
    struct job_event event;
};

status events_begin(struct store *store, struct error *err)
{
    struct sql_rows rows = sql_select(store, "SELECT seq FROM sqlite_sequence WHERE name='events'", NULL, 0,
                                      "the number of the last event cannot be read", err);

    store->event_next = sql_next(&rows) ? column_number(rows.row, 0) + EVENTS_GAP : 1;
    return sql_end(&rows);
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
    noted_add(&store->events, saved, EVENTS_WAITING_MAX);
    pthread_cond_signal(&store->work);
    pthread_mutex_unlock(&store->lock);
    return seq;
}

static status event_write(struct store *store, const struct job_event *e, struct error *err)
{
    TRY(sql_change(store, "INSERT INTO events (seq, job, at, worker, who, text) VALUES (?, ?, ?, ?, ?, ?)",
                   SQL_VALUES(sql_number(e->seq), sql_number((int64_t)e->job), sql_number(e->at),
                              sql_number(e->from_worker), sql_text(e->who), sql_text(e->text)),
                   "a job's event cannot be stored", err));
    return sql_change(store,
                      "DELETE FROM events WHERE job=?1 AND worker=?2 AND seq <= (SELECT seq FROM "
                      "events WHERE job=?1 AND worker=?2 ORDER BY seq DESC LIMIT 1 OFFSET ?3)",
                      SQL_VALUES(sql_number((int64_t)e->job), sql_number(e->from_worker),
                                 sql_number(e->from_worker ? JOB_WORKER_LINES_MAX : JOB_EVENTS_MAX)),
                      "a job's old events cannot be removed", err);
}

status events_write(struct store *store, struct error *err)
{
    for (const struct noted *e = store->events.taken; e; e = e->next)
        TRY(event_write(store, &((const struct saved_event *)e)->event, err));
    return STATUS_OK;
}

typedef status event_visit(void *user, const struct job_event *event, struct error *err);

/* ---- reading: the stored ones, then those that are not on disk yet --------------------------------- */

/* The noted events, in their order. Those on disk are a beginning of all: the writer takes them in order. */
struct noted_events {
    struct job_event *events;
    size_t count, capacity;
};

static status copy_list(struct noted_events *noted, const struct noted *at, uint64_t job, uint64_t after,
                        struct error *err)
{
    for (; at; at = at->next) {
        const struct saved_event *e = (const struct saved_event *)at;
        if ((job && e->event.job != job) || e->event.seq <= after)
            continue;
        NEED(MEM_GROW(noted->events, noted->capacity, noted->count + 1), err, "a job's log");
        noted->events[noted->count++] = e->event;
    }
    return STATUS_OK;
}

/* job 0: of all. Call it before the stored ones are read: then none is missed, and those that are written in between
 * are found twice. */
static status noted_copy(struct store *store, uint64_t job, uint64_t after, struct noted_events *noted,
                         struct error *err)
{
    status s;

    pthread_mutex_lock(&store->lock);
    s = copy_list(noted, store->events.taken, job, after, err);
    THEN(s, copy_list(noted, store->events.first, job, after, err));
    pthread_mutex_unlock(&store->lock);
    return s;
}

/* Call visit for each row: seq, job, at, worker, who, text. */
static status load_rows(struct store *store, const char *sql, const struct sql_value *values, size_t count,
                        event_visit *visit, void *user, struct error *err)
{
    struct sql_rows rows = sql_read(store, sql, values, count, "events cannot be read", err);

    while (sql_next(&rows)) {
        struct job_event e = {.seq = column_number(rows.row, 0), .job = column_number(rows.row, 1),
                              .at = sqlite3_column_int64(rows.row, 2),
                              .from_worker = sqlite3_column_int(rows.row, 3)};
        column_text(rows.row, 4, e.who, sizeof e.who);
        column_text(rows.row, 5, e.text, sizeof e.text);
        rows.result = visit(user, &e, err);
    }
    return sql_end(&rows);
}

struct log_reading {
    event_visit *visit;
    void *user;
    uint64_t last; /* the seq of the last visited one */
    uint32_t count;
};

static status visit_stored(void *user, const struct job_event *event, struct error *err)
{
    struct log_reading *r = user;

    r->last = event->seq;
    r->count++;
    return r->visit(r->user, event, err);
}

/* Go on with those that were found in memory only. */
static status visit_noted(struct log_reading *r, const struct noted_events *noted, uint32_t limit, struct error *err)
{
    status s = STATUS_OK;

    for (size_t i = 0; i < noted->count && r->count < limit && s == STATUS_OK; i++)
        if (noted->events[i].seq > r->last)
            s = visit_stored(r, &noted->events[i], err);
    return s;
}

status store_events_load(struct store *store, uint64_t job, uint64_t after, event_visit *visit, void *user,
                         struct error *err)
{
    struct noted_events noted = {0};
    struct log_reading r = {visit, user, after, 0};
    status s = noted_copy(store, job, after, &noted, err);

    THEN(s, load_rows(store, "SELECT seq, job, at, worker, who, text FROM events WHERE job=? AND seq>? ORDER BY seq",
                      SQL_VALUES(sql_number((int64_t)job), sql_number((int64_t)after)), visit_stored, &r, err));
    THEN(s, visit_noted(&r, &noted, UINT32_MAX, err));
    mem_free(noted.events);
    return s;
}

/* How many of the noted ones are newer than all stored ones? */
static status count_unstored(struct store *store, const struct noted_events *noted, size_t *out, struct error *err)
{
    struct sql_rows rows =
        sql_read(store, "SELECT coalesce(max(seq), 0) FROM events", NULL, 0, "events cannot be read", err);
    const uint64_t last = sql_next(&rows) ? column_number(rows.row, 0) : 0;

    for (*out = 0; *out < noted->count && noted->events[noted->count - 1 - *out].seq > last;)
        ++*out;
    return sql_end(&rows);
}

/* The newest: of the stored ones as many as those in memory leave room for. */
static status load_newest(struct store *store, uint64_t after, uint32_t limit, struct noted_events *noted,
                          struct log_reading *r, struct error *err)
{
    size_t unstored = 0, skipped;
    status s = count_unstored(store, noted, &unstored, err);

    if (s != STATUS_OK)
        return s;
    skipped = unstored > limit ? unstored - limit : 0; /* the oldest of them */
    if (unstored > 0)                                  /* else there may be no array */
        memmove(noted->events, noted->events + (noted->count - unstored) + skipped,
                (unstored - skipped) * sizeof *noted->events);
    noted->count = unstored - skipped;
    if (noted->count < limit)
        s = load_rows(store,
                      "SELECT * FROM (SELECT seq, job, at, worker, who, text FROM events WHERE seq>? AND seq<? "
                      "ORDER BY seq DESC LIMIT ?) ORDER BY seq",
                      SQL_VALUES(sql_number((int64_t)after),
                                 sql_number(noted->count ? (int64_t)noted->events[0].seq : INT64_MAX),
                                 sql_number(limit - (int64_t)noted->count)),
                      visit_stored, r, err);
    return s;
}

status store_events_load_all(struct store *store, uint64_t after, int newest, uint32_t limit, event_visit *visit,
                             void *user, struct error *err)
{
    struct noted_events noted = {0};
    struct log_reading r = {visit, user, after, 0};
    status s = noted_copy(store, 0, after, &noted, err);

    if (s == STATUS_OK && newest)
        s = load_newest(store, after, limit, &noted, &r, err);
    else if (s == STATUS_OK)
        s = load_rows(store, "SELECT seq, job, at, worker, who, text FROM events WHERE seq>? ORDER BY seq LIMIT ?",
                      SQL_VALUES(sql_number((int64_t)after), sql_number(limit)), visit_stored, &r, err);
    THEN(s, visit_noted(&r, &noted, limit, err));
    mem_free(noted.events);
    return s;
}
