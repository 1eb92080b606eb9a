/* Workers: what each process of a worker did, and the names that people drained or blocked. Rows of
 * what they did are noted in memory and written soon by the store's own thread. */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/system/log.h"
#include "common/base/memory.h"
#include "coordinator/store/store_parts.h"

enum { WORKERS_WAITING_MAX = 1 << 15 };

struct saved_worker {
    struct noted noted;
    struct worker_row row;
};

/* ---- what they did -------------------------------------------------------------------------- */

void store_worker_later(struct store *store, const struct worker_row *row)
{
    /* Only the lines that there are: many workers join at once. */
    size_t left_out = (WORKER_LINES_MAX - row->line_count) * sizeof row->lines[0];
    struct saved_worker *saved = mem_alloc(sizeof *saved - left_out);

    if (!saved) {
        log_warn("worker %s: what it did is not stored: no memory", row->name);
        return;
    }
    memcpy(&saved->row, row, sizeof *row - left_out);
    pthread_mutex_lock(&store->lock);
    noted_add(&store->workers, saved, WORKERS_WAITING_MAX);
    pthread_cond_signal(&store->work);
    pthread_mutex_unlock(&store->lock);
}

/* A line each: its time, a space, its text, which has no control character. */
static void lines_join(struct buffer *out, const struct worker_row *row)
{
    for (uint32_t i = 0; i < row->line_count; i++)
        buffer_printf(out, "%" PRId64 " %s\n", row->lines[i].at, row->lines[i].text);
}

static void lines_split(struct worker_row *row, const char *text)
{
    row->line_count = 0;
    while (*text && row->line_count < WORKER_LINES_MAX) {
        struct worker_line *line = &row->lines[row->line_count];
        char *end;
        size_t length = strcspn(text, "\n");

        line->at = strtoll(text, &end, 10);
        if (*end == ' ')
            end++;
        if (end > text + length)
            return;
        snprintf(line->text, sizeof line->text, "%.*s", (int)(text + length - end), end);
        row->line_count++;
        text += length + (text[length] == '\n');
    }
}

static status row_add(struct store *store, const struct worker_row *row, struct error *err)
{
    struct buffer lines = BUFFER_INIT;
    status s;

    lines_join(&lines, row);
    if (!buffer_ok(&lines)) {
        buffer_release(&lines);
        return error_no_memory(err, "a worker's lines");
    }
    s = sql_change(store,
                   "INSERT INTO workers (name, instance, host, process, address, software, threads, joined_at,"
                   " left_at, seen_at, connections, units, samples, cpu_ns, why, lines)"
                   " VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)"
                   " ON CONFLICT (name, instance) DO UPDATE SET address=excluded.address,"
                   " left_at=excluded.left_at, seen_at=excluded.seen_at,"
                   " connections=connections+excluded.connections, units=units+excluded.units,"
                   " samples=samples+excluded.samples, cpu_ns=cpu_ns+excluded.cpu_ns, why=excluded.why,"
                   " lines=CASE WHEN excluded.lines='' THEN lines ELSE excluded.lines END",
                   SQL_VALUES(sql_text(row->name), sql_number((int64_t)row->instance), sql_text(row->host),
                              sql_number(row->process), sql_text(row->address), sql_text(row->software),
                              sql_number(row->threads), sql_number(row->joined_at), sql_number(row->left_at),
                              sql_number(row->seen_at), sql_number(row->connections), sql_number(row->units),
                              sql_number(row->samples), sql_number(row->cpu_ns), sql_text(row->why),
                              sql_text(lines.size ? buffer_text(&lines) : "")),
                   "what a worker did cannot be stored", err);
    buffer_release(&lines);
    return s;
}

static status forget_oldest(struct store *store, struct error *err)
{
    return sql_change(store,
                      "DELETE FROM workers WHERE seq IN (SELECT seq FROM workers WHERE left_at>0 "
                      "ORDER BY left_at DESC, seq DESC LIMIT -1 OFFSET ?)",
                      SQL_VALUES(sql_number(WORKERS_GONE_MAX)), "workers that left long ago cannot be removed", err);
}

status workers_write(struct store *store, struct error *err)
{
    for (const struct noted *w = store->workers.taken; w; w = w->next)
        TRY(row_add(store, &((const struct saved_worker *)w)->row, err));
    return store->workers.taken ? forget_oldest(store, err) : STATUS_OK;
}

status store_workers_begin(struct store *store, struct error *err)
{
    status s;

    pthread_mutex_lock(&store->order);
    s = sql_change(store, "UPDATE workers SET left_at=max(seen_at, 1), why='the coordinator ended' WHERE left_at=0",
                   NULL, 0, "the workers of the last run cannot be stored", err);
    pthread_mutex_unlock(&store->order);
    return s;
}

static void read_row(sqlite3_stmt *statement, struct worker_row *row)
{
    memset(row, 0, sizeof *row);
    column_text(statement, 0, row->name, sizeof row->name);
    row->instance = column_number(statement, 1);
    column_text(statement, 2, row->host, sizeof row->host);
    row->process = (uint32_t)column_number(statement, 3);
    column_text(statement, 4, row->address, sizeof row->address);
    column_text(statement, 5, row->software, sizeof row->software);
    row->threads = (uint32_t)column_number(statement, 6);
    row->joined_at = sqlite3_column_int64(statement, 7);
    row->left_at = sqlite3_column_int64(statement, 8);
    row->connections = (uint32_t)column_number(statement, 9);
    row->units = column_number(statement, 10);
    row->samples = column_number(statement, 11);
    row->cpu_ns = column_number(statement, 12);
    column_text(statement, 13, row->why, sizeof row->why);
    if (sqlite3_column_text(statement, 14))
        lines_split(row, (const char *)sqlite3_column_text(statement, 14));
}

status store_workers_gone(struct store *store, const char *name,
                          status (*visit)(void *user, const struct worker_row *row, struct error *err), void *user,
                          struct error *err)
{
    struct sql_rows rows =
        sql_read(store,
                 "SELECT name, instance, host, process, address, software, threads, joined_at,"
                 " left_at, connections, units, samples, cpu_ns, why, lines FROM workers"
                 " WHERE left_at>0 AND (?1='' OR name=?1) ORDER BY left_at DESC, seq DESC LIMIT ?2",
                 SQL_VALUES(sql_text(name), sql_number(WORKERS_GONE_MAX)), "the workers that left cannot be read", err);

    while (sql_next(&rows)) {
        struct worker_row row;
        read_row(rows.row, &row);
        rows.result = visit(user, &row, err);
    }
    return sql_end(&rows);
}

/* ---- marks ----------------------------------------------------------------------------------- */

status store_worker_mark(struct store *store, const struct worker_mark *mark, struct error *err)
{
    return sql_note(store,
                    "INSERT OR REPLACE INTO worker_marks (name, blocked, instance, who, at) VALUES (?, ?, ?, ?, ?)",
                    SQL_VALUES(sql_text(mark->name), sql_number(mark->blocked), sql_number((int64_t)mark->instance),
                               sql_text(mark->who), sql_number(mark->at)),
                    "the worker's state cannot be stored", err);
}

status store_worker_unmark(struct store *store, const char *name, struct error *err)
{
    return sql_note(store, "DELETE FROM worker_marks WHERE name=?", SQL_VALUES(sql_text(name)),
                    "the worker's state cannot be stored", err);
}

status store_worker_marks_load(struct store *store,
                               status (*visit)(void *user, const struct worker_mark *mark, struct error *err),
                               void *user, struct error *err)
{
    struct sql_rows rows = sql_select(store, "SELECT name, blocked, instance, who, at FROM worker_marks", NULL, 0,
                                      "the workers' states cannot be read", err);

    while (sql_next(&rows)) {
        struct worker_mark mark = {.blocked = column_number(rows.row, 1) != 0,
                                   .instance = column_number(rows.row, 2),
                                   .at = sqlite3_column_int64(rows.row, 4)};
        column_text(rows.row, 0, mark.name, sizeof mark.name);
        column_text(rows.row, 3, mark.who, sizeof mark.who);
        rows.result = visit(user, &mark, err);
    }
    return sql_end(&rows);
}

/* ---- workers that delivered results: films' logs hold their numbers, this table the rest ------- */

status deliverer_write(struct store *store, const struct deliverer *d, struct error *err)
{
    return sql_change_reserved(store,
                               "INSERT INTO deliverers (number, host, process, software, first_seen, label) VALUES (?, ?, ?, ?, ?, ?)"
                               " ON CONFLICT (number) DO UPDATE SET host=excluded.host, process=excluded.process,"
                               " software=excluded.software, first_seen=excluded.first_seen, label=excluded.label",
                               SQL_VALUES(sql_number(d->number), sql_text(d->host), sql_number(d->process),
                                          sql_text(d->software), sql_number(d->first_seen), sql_text(d->label)),
                               "the worker that delivers results cannot be stored", err);
}

status store_deliverers_last(struct store *store, uint32_t *last, struct error *err)
{
    struct sql_rows rows = sql_select(store, "SELECT COALESCE(MAX(number), 0) FROM deliverers", NULL, 0,
                                      "the deliverers cannot be read", err);

    *last = sql_next(&rows) ? (uint32_t)column_number(rows.row, 0) : 0;
    return sql_end(&rows);
}

status store_deliverer_find(struct store *store, uint32_t number, struct deliverer *out, struct error *err)
{
    struct sql_rows rows = sql_read(store,
                       "SELECT host, process, software, first_seen,"
                       " CASE WHEN label<>'' THEN label ELSE (SELECT name FROM workers w WHERE w.host=d.host AND"
                       "  w.process=d.process ORDER BY joined_at DESC LIMIT 1) END"
                       " FROM deliverers d WHERE number=?",
                       SQL_VALUES(sql_number(number)), "the deliverers cannot be read", err);

    memset(out, 0, sizeof *out);
    if (sql_next(&rows)) {
        out->number = number;
        column_text(rows.row, 0, out->host, sizeof out->host);
        out->process = (uint32_t)column_number(rows.row, 1);
        column_text(rows.row, 2, out->software, sizeof out->software);
        out->first_seen = sqlite3_column_int64(rows.row, 3);
        column_text(rows.row, 4, out->label, sizeof out->label);
    }
    return sql_end(&rows);
}
