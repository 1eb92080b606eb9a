/* Each row of queue.sqlite has a digest, in the table `sums`; which rows do not have theirs any more.
 *
 * Triggers of the connection keep `sums` (they are TEMP: the file's schema has the table alone), so a row and its digest
 * change in one transaction, whatever statement changes it. A row whose digest is another, or that has none, is damaged;
 * a digest without a row says that a row is lost. rows_find notes both in the connection's temp.bad, for its readers. */
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "common/system/log.h"
#include "coordinator/store/store_parts.h"

const char sums_schema[] = "CREATE TABLE sums (tab TEXT NOT NULL, key TEXT NOT NULL, sum INTEGER NOT NULL,"
                           " PRIMARY KEY (tab, key)) WITHOUT ROWID;";

/* What a table's rows are called, and what becomes of a damaged one that --repair removes. `of_job`: its first column of
 * the key is a job's number; `stays`: it is not removed. */
const struct guarded_table guarded_tables[] = {
    {"jobs", "job", "the job is parked: submit it again, then cancel and remove this one", 1, 1},
    {"frames", "job, frame", "is removed: 'azulejo retry' makes that frame again, with the same bits", 1, 0},
    {"cut_frames", "job, frame", "is removed: 'azulejo retry' makes that frame again", 1, 0},
    {"clocks", "job, frame", "is removed: its limits count from their beginning", 0, 0},
    {"history", "job, frame, point", "is removed: that point of its errors is missing", 0, 0},
    {"removed", "job", "is removed: delete its folder in outputs, if it is there", 0, 0},
    {"meta", "meta", "is made again", 0, 0},
    {"deliverers", "worker", "is removed: who rendered some tiles is not known", 0, 0},
    {"shares", "owner", "is removed: that owner's share begins at nothing", 0, 0},
    {"workers", "worker that left", "is removed", 0, 0},
    {"worker_marks", "name", "is removed: block or drain that worker again", 0, 0},
    {"votes", "unit, worker", "is removed: what that worker delivered for the unit is not judged", 0, 0},
    {"tokens", "token", "is removed: make another one (azulejo token create)", 0, 0},
    {"keys", "name's keys", "is removed: revoke that name's keys again (azulejo key revoke), if they were revoked", 0, 0},
    {"waiting_events", "event", "is removed: the program of --on-event does not get it", 0, 0},
    {"events", "line of a log", "is removed", 0, 0},
    {0},
};

/* ---- a row's digest -------------------------------------------------------------------------- */

static uint64_t mix(uint64_t sum, const void *data, size_t size)
{
    const uint8_t *at = data;

    for (size_t i = 0; i < size; i++) { /* FNV-1a, 64 bits: every flipped bit and every other length changes it */
        sum ^= at[i];
        sum *= UINT64_C(0x100000001b3);
    }
    return sum;
}

/* row_sum(column, ...): types, lengths and bytes. */
static void row_sum(sqlite3_context *context, int count, sqlite3_value **values)
{
    uint64_t sum = UINT64_C(0xcbf29ce484222325);

    for (int i = 0; i < count; i++) {
        int type = sqlite3_value_type(values[i]);
        int64_t number = type == SQLITE_INTEGER ? sqlite3_value_int64(values[i]) : 0;
        double real = type == SQLITE_FLOAT ? sqlite3_value_double(values[i]) : 0;
        const void *bytes = type == SQLITE_TEXT ? (const void *)sqlite3_value_text(values[i])
                            : type == SQLITE_BLOB ? sqlite3_value_blob(values[i]) : NULL;
        int size = bytes ? sqlite3_value_bytes(values[i]) : 0;
        sum = mix(mix(mix(mix(sum, &type, sizeof type), &number, sizeof number), &real, sizeof real), &size, sizeof size);
        sum = mix(sum, bytes, (size_t)size);
    }
    sqlite3_result_int64(context, (int64_t)(sum ^ sum >> 32));
}

/* ---- statements over a table's columns -------------------------------------------------------- */

/* "before.a, before.b"; the columns of its key are joined by '/'. All of them, or SQLite's error: a digest over some of the columns
 * would call every row damaged. */
static int list_columns(sqlite3 *db, const char *table, const char *before, struct buffer *all, struct buffer *key)
{
    struct buffer sql = BUFFER_INIT;
    sqlite3_stmt *row = NULL;
    int code = SQLITE_NOMEM;

    buffer_printf(&sql, "SELECT name, pk FROM pragma_table_info('%s') ORDER BY cid", table);
    if (buffer_ok(&sql))
        code = sqlite3_prepare_v2(db, buffer_text(&sql), -1, &row, NULL);
    while (row && (code = sqlite3_step(row)) == SQLITE_ROW) {
        const char *name = (const char *)sqlite3_column_text(row, 0);
        buffer_printf(all, "%s%s\"%s\"", all->size ? ", " : "", before, name);
        if (sqlite3_column_int(row, 1) > 0)
            buffer_printf(key, "%s%s\"%s\"", key->size ? "||'/'||" : "''||", before, name);
    }
    sqlite3_finalize(row);
    buffer_release(&sql);
    if (code != SQLITE_DONE)
        return code;
    return !buffer_ok(all) || !buffer_ok(key) ? SQLITE_NOMEM : all->size > 0 ? SQLITE_OK : SQLITE_ERROR;
}

static int run(sqlite3 *db, struct buffer *sql)
{
    int code = buffer_ok(sql) ? sqlite3_exec(db, buffer_text(sql), NULL, NULL, NULL) : SQLITE_NOMEM;

    buffer_clear(sql);
    return code;
}

static int guard_table(sqlite3 *db, const char *table)
{
    struct buffer all = BUFFER_INIT, key = BUFFER_INIT, old = BUFFER_INIT, old_key = BUFFER_INIT, sql = BUFFER_INIT;
    int code = list_columns(db, table, "new.", &all, &key);

    if (code == SQLITE_OK)
        code = list_columns(db, table, "old.", &old, &old_key);
    for (int k = 0; k < 3 && code == SQLITE_OK; k++) {
        static const char *const when[] = {"INSERT", "UPDATE", "DELETE"};
        buffer_printf(&sql, "CREATE TEMP TRIGGER IF NOT EXISTS sum_%s_%d AFTER %s ON main.%s BEGIN ", table, k, when[k], table);
        buffer_printf(&sql, "DELETE FROM sums WHERE tab='%s' AND key=%s;", table, buffer_text(k == 0 ? &key : &old_key));
        if (k < 2)
            buffer_printf(&sql, "INSERT INTO sums VALUES ('%s', %s, row_sum(%s));", table, buffer_text(&key), buffer_text(&all));
        buffer_printf(&sql, "END");
        code = run(db, &sql);
    }
    buffer_release(&sql);
    buffer_release(&old_key);
    buffer_release(&old);
    buffer_release(&key);
    buffer_release(&all);
    return code;
}

/* What the statements below need of a connection, also of one that only reads. */
static int begin(sqlite3 *db)
{
    int code = sqlite3_create_function(db, "row_sum", -1, SQLITE_UTF8 | SQLITE_DETERMINISTIC, NULL, row_sum, NULL, NULL);

    return code == SQLITE_OK ? sqlite3_exec(db, "PRAGMA temp_store=MEMORY", NULL, NULL, NULL) : code;
}

int rows_guard(sqlite3 *db)
{
    int code = begin(db);

    if (sqlite3_table_column_metadata(db, "main", "sums", "sum", NULL, NULL, NULL, NULL, NULL) != SQLITE_OK)
        return code; /* of an older version */
    for (const struct guarded_table *t = guarded_tables; t->name && code == SQLITE_OK; t++)
        code = guard_table(db, t->name);
    /* The highest number is kept beside SQLite's own, which has no digest. */
    return code != SQLITE_OK ? code : sqlite3_exec(db,
        "CREATE TEMP TRIGGER IF NOT EXISTS last_job AFTER INSERT ON main.jobs BEGIN INSERT INTO meta VALUES ('last_job', new.id)"
        " ON CONFLICT (name) DO UPDATE SET value=max(value, excluded.value); END", NULL, NULL, NULL);
}

int rows_sum_all(sqlite3 *db)
{
    int code = SQLITE_OK;

    for (const struct guarded_table *t = guarded_tables; t->name && code == SQLITE_OK; t++) {
        struct buffer all = BUFFER_INIT, key = BUFFER_INIT, sql = BUFFER_INIT;
        code = list_columns(db, t->name, "", &all, &key);
        if (code == SQLITE_OK) {
            buffer_printf(&sql, "INSERT OR REPLACE INTO sums SELECT '%s', %s, row_sum(%s) FROM %s", t->name,
                          buffer_text(&key), buffer_text(&all), t->name);
            code = run(db, &sql);
        }
        buffer_release(&sql);
        buffer_release(&key);
        buffer_release(&all);
    }
    return code;
}

static int find_in_table(sqlite3 *db, const struct guarded_table *t)
{
    struct buffer all = BUFFER_INIT, key = BUFFER_INIT, sql = BUFFER_INIT;
    int code = list_columns(db, t->name, "", &all, &key);

    if (code == SQLITE_OK) {
        buffer_printf(&sql,
                      "INSERT INTO temp.bad SELECT '%s', r.key, 0, %s FROM (SELECT %s AS key, row_sum(%s) AS is_now"
                      " FROM main.%s) AS r WHERE r.is_now IS NOT"
                      " (SELECT s.sum FROM main.sums AS s WHERE s.tab='%s' AND s.key=r.key)",
                      t->name, t->of_job ? "CAST(r.key AS INTEGER)" : "0", buffer_text(&key), buffer_text(&all),
                      t->name, t->name);
        code = run(db, &sql);
    }
    if (code == SQLITE_OK) {
        buffer_printf(&sql,
                      "INSERT INTO temp.bad SELECT '%s', key, 1, %s FROM main.sums WHERE tab='%s' AND key NOT IN"
                      " (SELECT %s FROM main.%s)",
                      t->name, t->of_job ? "CAST(key AS INTEGER)" : "0", t->name, buffer_text(&key), t->name);
        code = run(db, &sql);
    }
    buffer_release(&sql);
    buffer_release(&key);
    buffer_release(&all);
    return code;
}

int rows_find(sqlite3 *db)
{
    int code = begin(db);

    if (code == SQLITE_OK)
        code = sqlite3_exec(db,
                            "CREATE TEMP TABLE IF NOT EXISTS bad (tab TEXT, key TEXT, lost INTEGER, job INTEGER,"
                            " PRIMARY KEY (tab, key)) WITHOUT ROWID; DELETE FROM temp.bad",
                            NULL, NULL, NULL);

    for (const struct guarded_table *t = guarded_tables; t->name && code == SQLITE_OK; t++)
        code = find_in_table(db, t);
    return code;
}

int rows_sound(sqlite3 *db, char *why, size_t size)
{
    sqlite3_stmt *row = NULL;
    int code = sqlite3_prepare_v2(db, "PRAGMA quick_check(1)", -1, &row, NULL);
    const char *text = NULL;
    int sound;

    if (code == SQLITE_OK && sqlite3_step(row) == SQLITE_ROW)
        text = (const char *)sqlite3_column_text(row, 0);
    sound = text && strcmp(text, "ok") == 0;
    snprintf(why, size, "%s", text ? text : sqlite3_errmsg(db));
    for (char *at = why; *at; at++)
        if (*at == '\n')
            *at = ' ';
    sqlite3_finalize(row);
    return sound;
}

void rows_delete_text(sqlite3 *db, const char *table, struct buffer *sql)
{
    struct buffer all = BUFFER_INIT, key = BUFFER_INIT;

    if (list_columns(db, table, "", &all, &key) == SQLITE_OK)
        buffer_printf(sql, "DELETE FROM %s WHERE %s=?", table, buffer_text(&key));
    buffer_release(&key);
    buffer_release(&all);
}

/* ---- saving what can be read ------------------------------------------------------------------- */

static int copy_row(sqlite3_stmt *from, sqlite3_stmt *to)
{
    int code;

    for (int i = 0; i < sqlite3_column_count(from); i++)
        if (sqlite3_bind_value(to, i + 1, sqlite3_column_value(from, i)) != SQLITE_OK)
            return SQLITE_NOMEM;
    code = sqlite3_step(to);
    sqlite3_reset(to);
    return code == SQLITE_DONE || code == SQLITE_CONSTRAINT ? SQLITE_OK : code;
}

/* Rows in the order of `sql` until one cannot be read. *last: the first column of the last one, if that is a number. */
static int copy_run(sqlite3 *old, const char *sql, int64_t after, sqlite3_stmt *to, int64_t *last, uint64_t *copied)
{
    sqlite3_stmt *from = NULL;
    int code = SQLITE_OK;

    if (sqlite3_prepare_v2(old, sql, -1, &from, NULL) != SQLITE_OK)
        return SQLITE_DONE;
    (void)!sqlite3_bind_int64(from, 1, after);
    while (code == SQLITE_OK && (code = sqlite3_step(from)) == SQLITE_ROW) {
        *last = sqlite3_column_int64(from, 0);
        code = copy_row(from, to);
        *copied += code == SQLITE_OK;
    }
    sqlite3_finalize(from);
    return code;
}

static int can_select(sqlite3 *db, const char *columns, const char *from)
{
    struct buffer sql = BUFFER_INIT;
    sqlite3_stmt *row = NULL;
    int can;

    buffer_printf(&sql, "SELECT %s FROM %s", columns, from);
    can = buffer_ok(&sql) && sqlite3_prepare_v2(db, buffer_text(&sql), -1, &row, NULL) == SQLITE_OK;
    sqlite3_finalize(row);
    buffer_release(&sql);
    return can;
}

/* Numbers whose page is damaged are jumped over; of other keys, the rows from both ends. Where a column's name is damaged, by place. */
static void copy_table(sqlite3 *db, sqlite3 *old, const char *from, const char *into, uint64_t *copied)
{
    struct buffer all = BUFFER_INIT, key = BUFFER_INIT, sql = BUFFER_INIT, marks = BUFFER_INIT;
    sqlite3_stmt *to = NULL;
    int64_t last = INT64_MIN;
    const char *columns;
    int numbered;

    (void)list_columns(db, from, "", &all, &key);
    for (const char *at = buffer_ok(&all) ? buffer_text(&all) : ""; *at; at++)
        if (*at == ',')
            buffer_puts(&marks, "?,");
    buffer_puts(&marks, "?");
    buffer_printf(&sql, "INSERT OR IGNORE INTO %s (%s) VALUES (%s)", into, buffer_text(&all), buffer_text(&marks));
    if (buffer_ok(&sql))
        (void)!sqlite3_prepare_v2(db, buffer_text(&sql), -1, &to, NULL);
    buffer_clear(&sql);
    numbered = !strstr(buffer_text(&key), "||'/'||") && can_select(db, "rowid", from);
    columns = can_select(old, buffer_text(&all), from) ? buffer_text(&all) : "*";
    buffer_printf(&sql, numbered ? "SELECT %s FROM %s WHERE rowid>?1 ORDER BY rowid" : "SELECT %s FROM %s NOT INDEXED",
                  columns, from);
    if (to && buffer_ok(&sql) && copy_run(old, buffer_text(&sql), last, to, &last, copied) != SQLITE_DONE) {
        for (int64_t skip = 1; numbered && skip < INT64_C(1) << 20; skip *= 2) {
            int64_t begin = last, after = last < 0 ? skip : last + skip;
            (void)!copy_run(old, buffer_text(&sql), after, to, &last, copied);
            if (last != begin)
                skip = 1;
        }
        if (!numbered) {
            const char *order = strcmp(from, "sums") == 0 ? "tab DESC, key DESC" : NULL;
            struct buffer keys = BUFFER_INIT;
            sqlite3_stmt *names = NULL;
            buffer_clear(&sql);
            buffer_printf(&keys, "SELECT name FROM pragma_table_info('%s') WHERE pk>0 ORDER BY pk", from);
            if (!order && buffer_ok(&keys))
                (void)!sqlite3_prepare_v2(db, buffer_text(&keys), -1, &names, NULL);
            buffer_clear(&keys);
            while (names && sqlite3_step(names) == SQLITE_ROW)
                buffer_printf(&keys, "%s%s DESC", keys.size ? ", " : "", sqlite3_column_text(names, 0));
            sqlite3_finalize(names);
            buffer_printf(&sql, "SELECT %s FROM %s ORDER BY %s", columns, from, order ? order : buffer_text(&keys));
            if (buffer_ok(&sql) && buffer_ok(&keys))
                (void)!copy_run(old, buffer_text(&sql), 0, to, &last, copied);
            buffer_release(&keys);
        }
    }
    sqlite3_finalize(to);
    buffer_release(&marks);
    buffer_release(&sql);
    buffer_release(&key);
    buffer_release(&all);
}

int rows_salvage(sqlite3 *db, const char *damaged, uint64_t *copied)
{
    sqlite3 *old = NULL;
    uint64_t sums = 0;
    int code = sqlite3_exec(db,
                            "PRAGMA foreign_keys=OFF; DROP TRIGGER IF EXISTS temp.last_job;"
                            "CREATE TEMP TABLE old_sums (tab TEXT, key TEXT, sum INTEGER, PRIMARY KEY (tab, key)) WITHOUT ROWID;"
                            "BEGIN", NULL, NULL, NULL);

    if (code == SQLITE_OK && sqlite3_open_v2(damaged, &old, SQLITE_OPEN_READWRITE, NULL) == SQLITE_OK) {
        (void)!sqlite3_db_config(old, SQLITE_DBCONFIG_DQS_DML, 0, NULL); /* a column that is not there is no text */
        (void)!sqlite3_exec(old, "PRAGMA writable_schema=ON", NULL, NULL, NULL); /* damage there hides one table only */
        copy_table(db, old, "sums", "temp.old_sums", &sums);
        for (const struct guarded_table *t = guarded_tables; t->name; t++)
            copy_table(db, old, t->name, t->name, copied);
    }
    sqlite3_close(old);
    /* Rows keep the digests that they were written with; rows that are lost, too. */
    if (code == SQLITE_OK)
        code = sqlite3_exec(db,
                            "INSERT OR REPLACE INTO sums SELECT tab, key, sum FROM temp.old_sums"
                            " WHERE tab IS NOT NULL AND key IS NOT NULL AND typeof(sum)='integer'; COMMIT",
                            NULL, NULL, NULL);
    return code;
}
