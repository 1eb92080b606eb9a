/* The database file: its tables and their versions, and the few ways to run a statement. */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/system/file.h"
#include "common/system/log.h"
#include "common/base/memory.h"
#include "coordinator/store/files/reserve.h"
#include "coordinator/store/store_parts.h"
#include "coordinator/store/store_web.h"

/* Version of the tables, kept in SQLite's user_version. */
enum { STORE_VERSION = 13, BUSY_MS = 5000 };

static const char schema[] =
    "CREATE TABLE meta (name TEXT PRIMARY KEY, value INTEGER NOT NULL) WITHOUT ROWID;"
    "CREATE TABLE jobs ("
    " id INTEGER PRIMARY KEY AUTOINCREMENT, name TEXT NOT NULL, state INTEGER NOT NULL,"
    " state_text TEXT NOT NULL, scene_name TEXT NOT NULL, kernel TEXT NOT NULL,"
    " epoch_floor INTEGER NOT NULL, submitted_at INTEGER NOT NULL, finished_at INTEGER NOT NULL,"
    " active_ns INTEGER NOT NULL, conflicts INTEGER NOT NULL, samples INTEGER NOT NULL,"
    " rays INTEGER NOT NULL, vertices INTEGER NOT NULL, dropped INTEGER NOT NULL,"
    " cpu_ns INTEGER NOT NULL, trace_ns INTEGER NOT NULL,"
    " request BLOB NOT NULL);" /* the wire's JobSubmit */
    "CREATE TABLE frames (job INTEGER NOT NULL REFERENCES jobs(id), frame INTEGER NOT NULL,"
    " relative_mse REAL, PRIMARY KEY (job, frame)) WITHOUT ROWID;";

/* Version 2: which frames' pictures follow the job's present output settings. */
static const char schema_2[] = "ALTER TABLE jobs ADD COLUMN revision INTEGER NOT NULL DEFAULT 0;"
                               "ALTER TABLE frames ADD COLUMN revision INTEGER NOT NULL DEFAULT 0;";

/* Version 3: the tokens of submissions, NULL for jobs without one; the frames that were cut short. */
static const char schema_3[] = "ALTER TABLE jobs ADD COLUMN token TEXT;"
                               "CREATE UNIQUE INDEX jobs_token ON jobs (token) WHERE token IS NOT NULL;"
                               "CREATE TABLE cut_frames (job INTEGER NOT NULL REFERENCES jobs(id),"
                               " frame INTEGER NOT NULL, samples INTEGER NOT NULL, least INTEGER NOT NULL,"
                               " most INTEGER NOT NULL, tiles INTEGER NOT NULL, tiles_empty INTEGER NOT NULL,"
                               " PRIMARY KEY (job, frame)) WITHOUT ROWID;";

/* Version 4: the release that a job was begun with; its original JobSubmit, if an extension changed
 * it; the work of each frame instead of its sums in jobs (the sums go to the first done frame; the
 * columns of jobs are no longer used); the reason why a frame ended (frames cut short before were
 * cancelled: FRAME_END_CANCEL); how long frames have been rendered, and from when their limits
 * count; the history of each frame's errors. relative_mse above is no longer used. */
static const char schema_4[] =
    "ALTER TABLE jobs ADD COLUMN release TEXT NOT NULL DEFAULT '';"
    "ALTER TABLE jobs ADD COLUMN submitted BLOB;"
    "ALTER TABLE frames ADD COLUMN samples INTEGER NOT NULL DEFAULT 0;"
    "ALTER TABLE frames ADD COLUMN rays INTEGER NOT NULL DEFAULT 0;"
    "ALTER TABLE frames ADD COLUMN vertices INTEGER NOT NULL DEFAULT 0;"
    "ALTER TABLE frames ADD COLUMN dropped INTEGER NOT NULL DEFAULT 0;"
    "ALTER TABLE frames ADD COLUMN leaked INTEGER NOT NULL DEFAULT 0;"
    "ALTER TABLE frames ADD COLUMN clamped_values INTEGER NOT NULL DEFAULT 0;"
    "ALTER TABLE frames ADD COLUMN clamped INTEGER NOT NULL DEFAULT 0;"
    "ALTER TABLE frames ADD COLUMN clamped_luminance REAL NOT NULL DEFAULT 0;"
    "ALTER TABLE frames ADD COLUMN kept_luminance REAL NOT NULL DEFAULT 0;"
    "UPDATE frames SET (samples, rays, vertices, dropped) ="
    " (SELECT samples, rays, vertices, dropped FROM jobs WHERE id=job)"
    " WHERE frame=(SELECT min(frame) FROM frames AS f WHERE f.job=frames.job);"
    "ALTER TABLE cut_frames ADD COLUMN ended INTEGER NOT NULL DEFAULT 5;"
    "ALTER TABLE cut_frames ADD COLUMN group_most INTEGER NOT NULL DEFAULT 0;"
    "CREATE TABLE clocks (job INTEGER NOT NULL REFERENCES jobs(id), frame INTEGER NOT NULL,"
    " active_ns INTEGER NOT NULL, cpu_ns INTEGER NOT NULL,"
    " from_active_ns INTEGER NOT NULL DEFAULT 0, from_cpu_ns INTEGER NOT NULL DEFAULT 0,"
    " PRIMARY KEY (job, frame)) WITHOUT ROWID;"
    "CREATE TABLE history (job INTEGER NOT NULL REFERENCES jobs(id), frame INTEGER NOT NULL,"
    " place INTEGER NOT NULL, core_s REAL NOT NULL, wall_s REAL NOT NULL, samples INTEGER NOT NULL,"
    " rays INTEGER NOT NULL, known INTEGER NOT NULL, reliable INTEGER NOT NULL,"
    " reasons INTEGER NOT NULL, display REAL, display_lo REAL, display_hi REAL, psnr REAL,"
    " psnr_lo REAL, psnr_hi REAL, rmse REAL, rmse_lo REAL, rmse_hi REAL, mean REAL,"
    " top_share REAL, disagreement REAL, unseen REAL, tail REAL, lone REAL, dark REAL,"
    " PRIMARY KEY (job, frame, place)) WITHOUT ROWID;";

/* Version 5: each frame's health, rows of (kind, count, first example), 64 bits each, little-endian; NULL:
 * only `dropped` and `clamped_values` are known. */
static const char schema_5[] = "ALTER TABLE frames ADD COLUMN health BLOB;";

/* Version 6: what people do to jobs. The priority may differ from the request's (NULL: as there). */
static const char schema_6[] = "ALTER TABLE jobs ADD COLUMN owner TEXT NOT NULL DEFAULT '';"
                               "ALTER TABLE jobs ADD COLUMN marks INTEGER NOT NULL DEFAULT 0;" /* enum job_mark */
                               "ALTER TABLE jobs ADD COLUMN priority INTEGER;"
                               "CREATE TABLE removed (job INTEGER PRIMARY KEY);"; /* whose files may still be there */

/* Version 7: what workers did, and the names that people drained or blocked. An instance is the life of a
 * worker's process; left_at 0: it is connected. */
static const char schema_7[] =
    "CREATE TABLE workers (seq INTEGER PRIMARY KEY AUTOINCREMENT, name TEXT NOT NULL,"
    " instance INTEGER NOT NULL, host TEXT NOT NULL, process INTEGER NOT NULL, address TEXT NOT NULL,"
    " software TEXT NOT NULL, threads INTEGER NOT NULL, joined_at INTEGER NOT NULL,"
    " left_at INTEGER NOT NULL, seen_at INTEGER NOT NULL, connections INTEGER NOT NULL,"
    " units INTEGER NOT NULL, samples INTEGER NOT NULL, cpu_ns INTEGER NOT NULL, why TEXT NOT NULL,"
    " lines TEXT NOT NULL);"
    "CREATE UNIQUE INDEX workers_process ON workers (name, instance);"
    "CREATE INDEX workers_left ON workers (left_at);"
    "CREATE TABLE worker_marks (name TEXT PRIMARY KEY, blocked INTEGER NOT NULL,"
    " instance INTEGER NOT NULL, who TEXT NOT NULL, at INTEGER NOT NULL) WITHOUT ROWID;";

/* And what jobs still wait for, if that may differ from the request (NULL: as there); the owners' shares. */
static const char needs_schema[] =
    "ALTER TABLE jobs ADD COLUMN waits_for TEXT;"
    "ALTER TABLE jobs ADD COLUMN not_before INTEGER;"
    "CREATE TABLE shares (owner TEXT PRIMARY KEY, core_s REAL NOT NULL, at INTEGER NOT NULL) WITHOUT ROWID;";

/* Version 8: tokens of the page. The first row of `tokens` gets number TOKEN_FIRST. */
static const char schema_8[] =
    "CREATE TABLE tokens (number INTEGER PRIMARY KEY AUTOINCREMENT, name TEXT NOT NULL, role INTEGER NOT NULL,"
    " owner TEXT NOT NULL, made_by TEXT NOT NULL, hash BLOB NOT NULL, made_at INTEGER NOT NULL,"
    " used_at INTEGER NOT NULL, expires_at INTEGER NOT NULL);"
    "INSERT INTO sqlite_sequence (name, seq) VALUES ('tokens', 1);";
_Static_assert(TOKEN_FIRST == 2, "as in schema_8");

/* Version 9: comments; each frame's sums of light by depth, doubles of 64 bits, little-endian; NULL: not known;
 * how unequally far the tiles of a measured picture were (film_unevenness). */
static const char schema_9[] = "ALTER TABLE jobs ADD COLUMN comment TEXT NOT NULL DEFAULT '';"
                               "ALTER TABLE frames ADD COLUMN depth BLOB;"
                               "ALTER TABLE history ADD COLUMN uneven REAL;";

/* Version 11: the keys of names; the figures of denoised pictures (store_history.c), NULL: none; the names of deliverers, and
 * since when they are not believed (NULL: they are); who rendered each done frame, numbers of 32 bits, little-endian (NULL: not
 * known), and when it was done (store_trust.c); which effects a job's results had, and the accounts of their time (stats_pack),
 * NULL: not known. */
static const char keys_schema[] =
    "CREATE TABLE IF NOT EXISTS keys (name TEXT PRIMARY KEY, oldest INTEGER NOT NULL, generation INTEGER NOT NULL,"
    " oldest_until INTEGER NOT NULL, roles INTEGER NOT NULL, revoked INTEGER NOT NULL, used_at INTEGER NOT NULL,"
    " changed_at INTEGER NOT NULL, changed_by TEXT NOT NULL, changes INTEGER NOT NULL) WITHOUT ROWID;";

static const char schema_11[] = "ALTER TABLE history ADD COLUMN display_all REAL;"
                                "ALTER TABLE history ADD COLUMN worst_part REAL;"
                                "ALTER TABLE history ADD COLUMN fireflies REAL;"
                                "ALTER TABLE history ADD COLUMN subject REAL;"
                                "ALTER TABLE history ADD COLUMN denoised BLOB;"
                                "ALTER TABLE deliverers ADD COLUMN label TEXT NOT NULL DEFAULT '';"
                                "ALTER TABLE deliverers ADD COLUMN distrusted INTEGER;"
                                "ALTER TABLE frames ADD COLUMN deliverers BLOB;"
                                "ALTER TABLE frames ADD COLUMN done_at INTEGER NOT NULL DEFAULT 0;"
                                "ALTER TABLE jobs ADD COLUMN accounts BLOB;";

/* Version 12: the answers for units that are to be rendered again (store_trust.c). `unit`: job/frame/tile/group/pass; `digest`: as
 * hexadecimal, '': not known. */
static const char votes_schema[] = "CREATE TABLE IF NOT EXISTS votes (unit TEXT NOT NULL, worker TEXT NOT NULL, place INTEGER NOT NULL,"
                                   " epoch_floor INTEGER NOT NULL, hash INTEGER NOT NULL, digest TEXT NOT NULL,"
                                   " PRIMARY KEY (unit, worker)) WITHOUT ROWID;";

/* Version 13: events that wait for the program of --on-event, and no webhooks, which versions 8 to 12 had. */
static const char schema_13[] = "DROP TABLE IF EXISTS webhook_events; DROP TABLE IF EXISTS webhooks;"
                                "DELETE FROM sums WHERE tab IN ('webhooks', 'webhook_events');"
                                "CREATE TABLE IF NOT EXISTS waiting_events (id INTEGER PRIMARY KEY, at INTEGER NOT NULL, json TEXT NOT NULL);";

/* Films have another format since version 9 (and since 4 and 5), so an unfinished frame's film is useless
 * (film_file_open renames it): a job without a finished frame counts as not begun, and workers of any release
 * may begin it. The numbers are those of enum job_state: not DONE, FAILED or CANCELLED. */
#define NOT_BEGUN " state NOT IN (2, 3, 4) AND NOT EXISTS (SELECT 1 FROM frames WHERE job=jobs.id)"
static const char convert_9[] =
    "DELETE FROM clocks WHERE job IN (SELECT id FROM jobs WHERE" NOT_BEGUN ");"
    "DELETE FROM history WHERE job IN (SELECT id FROM jobs WHERE" NOT_BEGUN ");"
    "UPDATE jobs SET kernel='', active_ns=0, conflicts=0, samples=0, rays=0, vertices=0, dropped=0,"
    " cpu_ns=0, trace_ns=0 WHERE" NOT_BEGUN ";";

_Static_assert(JOB_STATE_DONE == 2 && JOB_STATE_FAILED == 3 && JOB_STATE_CANCELLED == 4, "as in NOT_BEGUN");

static const char deliverers_schema[] = "CREATE TABLE deliverers (number INTEGER PRIMARY KEY, host TEXT NOT NULL,"
                                        " process INTEGER NOT NULL, software TEXT NOT NULL, first_seen INTEGER NOT NULL);";

/* What brings the tables to each version; `converts`: only tables that had rows. */
static const struct {
    int version;
    const char *sql;
    int converts;
} steps[] = {{1, schema, 0}, {2, schema_2, 0}, {3, schema_3, 0}, {4, schema_4, 0}, {4, deliverers_schema, 0},
             {5, schema_5, 0}, {6, schema_6, 0}, {6, events_schema, 0}, {7, schema_7, 0}, {7, needs_schema, 0},
             {8, schema_8, 0}, {9, schema_9, 0}, {9, convert_9, 1}, {10, sums_schema, 0}, {11, keys_schema, 0},
             {11, schema_11, 0}, {12, votes_schema, 0}, {13, schema_13, 0}};

status sql_failed(struct store *store, sqlite3 *db, const char *what, struct error *err)
{
    int code = sqlite3_errcode(db);
    int number = sqlite3_system_errno(db); /* of its last I/O error */
    int has_reason = number && (code == SQLITE_IOERR || code == SQLITE_CANTOPEN);

    atomic_store(&store->suspect, 1);
    if (code == SQLITE_READONLY) /* where a file could not be opened for writing, SQLite has opened it for reading */
        atomic_store(&store->read_only, 1);
    return error_set(err, code == SQLITE_NOMEM ? STATUS_ERR_NO_MEMORY : STATUS_ERR_IO, "%s/queue.sqlite: %s: %s%s%s",
                     store->folder, what, sqlite3_errmsg(db), has_reason ? ": " : "",
                     has_reason ? strerror(number) : "");
}

status sql_error(struct store *store, const char *what, struct error *err)
{
    return sql_failed(store, store->db, what, err);
}

status sql_exec(struct store *store, const char *sql, const char *what, struct error *err)
{
    if (sqlite3_exec(store->db, sql, NULL, NULL, NULL) != SQLITE_OK)
        return sql_error(store, what, err);
    return STATUS_OK;
}

struct sql_value sql_number(int64_t number) { return (struct sql_value){.kind = SQL_NUMBER, .number = number}; }

struct sql_value sql_real(double value) { return (struct sql_value){.kind = SQL_REAL, .real = value}; }

struct sql_value sql_text(const char *text)
{
    return (struct sql_value){.kind = SQL_TEXT, .data = text, .size_bytes = text ? strlen(text) : 0};
}

struct sql_value sql_bytes(const struct buffer *bytes)
{
    return (struct sql_value){.kind = SQL_BYTES, .data = bytes->size ? bytes->data : NULL, .size_bytes = bytes->size};
}

static int bind(sqlite3_stmt *statement, int at, const struct sql_value *value)
{
    switch (value->kind) {
    case SQL_NUMBER: return sqlite3_bind_int64(statement, at, value->number);
    case SQL_REAL: return sqlite3_bind_double(statement, at, value->real);
    case SQL_TEXT: return sqlite3_bind_text(statement, at, value->data, (int)value->size_bytes, SQLITE_TRANSIENT);
    default: return sqlite3_bind_blob(statement, at, value->data, (int)value->size_bytes, SQLITE_TRANSIENT);
    }
}

/* *out: NULL, or the statement that was prepared before. */
static status prepare(struct store *store, sqlite3 *db, const char *sql, const struct sql_value *values, size_t count,
                      sqlite3_stmt **out, struct error *err)
{
    int code = *out ? SQLITE_OK : sqlite3_prepare_v2(db, sql, -1, out, NULL);
    status s;

    for (size_t i = 0; code == SQLITE_OK && i < count; i++)
        code = bind(*out, (int)i + 1, &values[i]);
    if (code == SQLITE_OK)
        return STATUS_OK;
    s = sql_failed(store, db, "prepare", err);
    sqlite3_finalize(*out);
    *out = NULL;
    return s;
}

struct sql_rows sql_ask(struct store *store, sqlite3 *db, const char *sql, const struct sql_value *values, size_t count,
                        const char *what, struct error *err)
{
    struct sql_rows rows = {.store = store, .db = db, .what = what, .err = err};

    rows.result = prepare(store, db, sql, values, count, &rows.row, err);
    return rows;
}

struct sql_rows sql_select(struct store *store, const char *sql, const struct sql_value *values, size_t count,
                           const char *what, struct error *err)
{
    return sql_ask(store, store->db, sql, values, count, what, err);
}

struct sql_rows sql_read(struct store *store, const char *sql, const struct sql_value *values, size_t count,
                         const char *what, struct error *err)
{
    struct sql_rows rows = sql_ask(store, reader_take(store), sql, values, count, what, err);

    rows.reading = 1;
    return rows;
}

int sql_next(struct sql_rows *rows)
{
    int code = rows->result == STATUS_OK ? sqlite3_step(rows->row) : SQLITE_DONE;

    if (code != SQLITE_ROW && code != SQLITE_DONE)
        rows->result = sql_failed(rows->store, rows->db, rows->what, rows->err);
    return code == SQLITE_ROW;
}

status sql_end(struct sql_rows *rows)
{
    sqlite3_finalize(rows->row);
    if (rows->reading)
        reader_leave(rows->store, rows->db);
    return rows->result;
}

/* Did the last statement fail for lack of space? Some of SQLite's files report that as an I/O
 * error, and the index of its log without an error number. */
static int found_no_room(const struct store *store)
{
    int number = sqlite3_system_errno(store->db);

    return sqlite3_errcode(store->db) == SQLITE_FULL ||
           (sqlite3_errcode(store->db) == SQLITE_IOERR && (number == 0 || number == ENOSPC || number == EDQUOT));
}

int sql_give_reserve(struct store *store)
{
    if (!found_no_room(store) || !reserve_release(store->folder))
        return 0;
    atomic_store(&store->suspect, 1);
    return 1;
}

/* A statement that ran before: the next time it is parsed already. NULL: there is none. */
static sqlite3_stmt *ready_take(struct store *store, const char *sql)
{
    for (int i = 0; i < STATEMENTS_READY; i++) {
        sqlite3_stmt *statement = store->ready[i];
        if (!statement || strcmp(sqlite3_sql(statement), sql) != 0)
            continue;
        store->ready[i] = NULL;
        return statement;
    }
    return NULL;
}

static void ready_keep(struct store *store, sqlite3_stmt *statement)
{
    sqlite3_stmt **place = &store->ready[store->ready_next++ % STATEMENTS_READY];

    sqlite3_reset(statement);
    sqlite3_clear_bindings(statement);
    sqlite3_finalize(*place);
    *place = statement;
}

void database_close(struct store *store)
{
    for (int i = 0; i < STATEMENTS_READY; i++) {
        sqlite3_finalize(store->ready[i]);
        store->ready[i] = NULL;
    }
    sqlite3_close(store->db);
    store->db = NULL;
}

static status change(struct store *store, const char *sql, const struct sql_value *values, size_t count, int reserved,
                     const char *what, struct error *err)
{
    sqlite3_stmt *statement = ready_take(store, sql);
    /* In a transaction, which such an error may have ended, its owner repeats all of it. */
    int alone = sqlite3_get_autocommit(store->db);
    status s = prepare(store, store->db, sql, values, count, &statement, err);
    int code;

    if (s != STATUS_OK)
        return s;
    code = sqlite3_step(statement);
    if (code != SQLITE_DONE && alone && reserved && sql_give_reserve(store)) {
        sqlite3_reset(statement);
        code = sqlite3_step(statement);
    }
    if (code == SQLITE_DONE) {
        ready_keep(store, statement);
        return STATUS_OK;
    }
    s = sql_error(store, what, err);
    sqlite3_finalize(statement);
    return s;
}

status sql_change(struct store *store, const char *sql, const struct sql_value *values, size_t count, const char *what,
                  struct error *err)
{
    return change(store, sql, values, count, 0, what, err);
}

status sql_change_reserved(struct store *store, const char *sql, const struct sql_value *values, size_t count,
                           const char *what, struct error *err)
{
    return change(store, sql, values, count, 1, what, err);
}

status sql_write(struct store *store, const char *sql, const struct sql_value *values, size_t count, const char *what,
                 uint64_t *number, struct error *err)
{
    status s;

    pthread_mutex_lock(&store->order);
    s = change(store, sql, values, count, 1, what, err);
    if (s == STATUS_OK && number)
        *number = (uint64_t)sqlite3_last_insert_rowid(store->db);
    pthread_mutex_unlock(&store->order);
    return s;
}

static status transaction_once(struct store *store, status (*body)(struct store *, const void *, struct error *),
                               const void *user, int *again, struct error *err)
{
    status s = sql_exec(store, "BEGIN IMMEDIATE", "cannot be written", err);

    THEN(s, body(store, user, err));
    THEN(s, sql_exec(store, "COMMIT", "cannot be written", err));
    *again = s != STATUS_OK && s != STATUS_ERR_REFUSED && sql_give_reserve(store);
    if (!sqlite3_get_autocommit(store->db))
        (void)sqlite3_exec(store->db, "ROLLBACK", NULL, NULL, NULL);
    return s;
}

status sql_transaction(struct store *store, status (*body)(struct store *, const void *, struct error *),
                       const void *user, struct error *err)
{
    status s = STATUS_OK;

    for (int turn = 0, again = 1; again && turn < 2; turn++)
        s = transaction_once(store, body, user, &again, err);
    return s;
}

void column_text(sqlite3_stmt *statement, int at, char *out, size_t size)
{
    const unsigned char *text = sqlite3_column_text(statement, at);

    snprintf(out, size, "%s", text ? (const char *)text : "");
}

uint64_t column_number(sqlite3_stmt *statement, int at) { return (uint64_t)sqlite3_column_int64(statement, at); }

static status schema_version(struct store *store, int *version, struct error *err)
{
    struct sql_rows rows = sql_select(store, "PRAGMA user_version", NULL, 0, "cannot be read", err);

    if (sql_next(&rows))
        *version = sqlite3_column_int(rows.row, 0);
    TRY(sql_end(&rows));
    if (*version > STORE_VERSION)
        return error_set(err, STATUS_ERR_CORRUPT,
                         "%s: was written by a newer azulejo (store version %d; this one reads %d)", store->folder,
                         *version, STORE_VERSION);
    return STATUS_OK;
}

static status connect(struct store *store, const char *name, int flags, struct error *err)
{
    if (sqlite3_open_v2(name, &store->db, flags | SQLITE_OPEN_FULLMUTEX, NULL) != SQLITE_OK)
        return store->db ? sql_error(store, "cannot be opened", err) : error_no_memory(err, name);
    sqlite3_extended_result_codes(store->db, 0);
    sqlite3_busy_timeout(store->db, BUSY_MS);
    return STATUS_OK;
}

/* A job's folder below `kind`, as kind/NUMBER. 0: there is none. */
static int find_job_folder(const struct store *store, const char *kind, char *out, size_t size)
{
    char *path = file_join(store->folder, kind);
    DIR *folder = path ? opendir(path) : NULL;
    const struct dirent *entry;
    int found = 0;

    while (folder && !found && (entry = readdir(folder)))
        found = entry->d_name[0] >= '1' && entry->d_name[0] <= '9' &&
                snprintf(out, size, "%s/%s", kind, entry->d_name) < (int)size;
    if (folder)
        closedir(folder);
    mem_free(path);
    return found;
}

/* Films or pictures without a queue: a new one would number its jobs from 1 and write into theirs. */
static status refuse_lost_queue(const struct store *store, const char *path, struct error *err)
{
    struct stat info;
    char found[64];
    int is_there = stat(path, &info) == 0;

    if ((is_there && info.st_size > 0) || (!is_there && errno != ENOENT) ||
        (!find_job_folder(store, "outputs", found, sizeof found) && !find_job_folder(store, "films", found, sizeof found)))
        return STATUS_OK;
    return error_set(err, STATUS_ERR_CORRUPT,
                     "%s: %s, but %s is there: jobs would get its number again. Put the file back, or restore a back-up "
                     "('azulejo-coordinator restore'); for a new farm choose another --store, or move films and outputs "
                     "away. 'azulejo-coordinator --check --repair' parks the old jobs under their numbers",
                     path, is_there ? "is empty" : "is missing", found);
}

/* The sorted names of a table's columns, in a statement with one row. */
static sqlite3_stmt *columns_of(sqlite3 *db, const char *table)
{
    sqlite3_stmt *row = NULL;

    if (sqlite3_prepare_v2(db, "SELECT coalesce(group_concat(name), '') FROM (SELECT lower(name) AS name FROM pragma_table_info(?1)"
                           " ORDER BY 1)", -1, &row, NULL) == SQLITE_OK)
        (void)!sqlite3_bind_text(row, 1, table, -1, SQLITE_STATIC);
    (void)!sqlite3_step(row);
    return row;
}

const char *database_other_columns(sqlite3 *db)
{
    const char *other = NULL;
    sqlite3 *fresh = NULL;
    int code = sqlite3_open(":memory:", &fresh);

    for (size_t i = 0; i < sizeof steps / sizeof *steps && code == SQLITE_OK; i++)
        if (!steps[i].converts)
            code = sqlite3_exec(fresh, steps[i].sql, NULL, NULL, NULL);
    for (const struct guarded_table *t = guarded_tables; t->name && code == SQLITE_OK && !other; t++) {
        sqlite3_stmt *is = columns_of(db, t->name), *should_be = columns_of(fresh, t->name);
        const char *names = (const char *)sqlite3_column_text(is, 0), *wanted = (const char *)sqlite3_column_text(should_be, 0);
        if (wanted && names && strcmp(names, wanted) != 0)
            other = t->name;
        sqlite3_finalize(is);
        sqlite3_finalize(should_be);
    }
    sqlite3_close(fresh);
    return other;
}

static status guard(struct store *store, struct error *err)
{
    return rows_guard(store->db) == SQLITE_OK ? STATUS_OK : sql_error(store, "cannot be opened", err);
}

/* How many the store had, before they go. */
static int count_webhooks(sqlite3 *db)
{
    sqlite3_stmt *row = NULL;
    int count = 0;

    if (sqlite3_prepare_v2(db, "SELECT count(*) FROM webhooks", -1, &row, NULL) == SQLITE_OK && sqlite3_step(row) == SQLITE_ROW)
        count = sqlite3_column_int(row, 0);
    sqlite3_finalize(row);
    return count;
}

status database_make(struct store *store, const char *path, struct error *err)
{
    int version = 0, webhooks;
    int fd;
    status s;

    fd = open(path, O_RDWR | O_CREAT | O_CLOEXEC, 0600); /* SQLite gives its other files these permissions */
    if (fd < 0)
        return error_set(err, STATUS_ERR_IO, "%s: cannot be opened: %s", path, strerror(errno));
    close(fd);
    s = connect(store, path, SQLITE_OPEN_READWRITE, err);
    THEN(s, sql_exec(store, file_syncs() ? "PRAGMA synchronous=FULL" : "PRAGMA synchronous=OFF", "cannot be opened", err));
    THEN(s, sql_exec(store, "PRAGMA journal_mode=WAL; PRAGMA foreign_keys=ON", "cannot be opened", err));
    THEN(s, schema_version(store, &version, err));
    if (s != STATUS_OK || version == STORE_VERSION)
        return s == STATUS_OK ? guard(store, err) : s;
    webhooks = count_webhooks(store->db);
    s = sql_exec(store, "BEGIN IMMEDIATE", "cannot be written", err);
    for (size_t i = 0; i < sizeof steps / sizeof *steps && s == STATUS_OK; i++)
        if (version < steps[i].version && (version > 0 || !steps[i].converts))
            s = sql_exec(store, steps[i].sql, i ? "cannot be brought up to date" : "cannot be set up", err);
    THEN(s, guard(store, err));
    if (s == STATUS_OK && rows_sum_all(store->db) != SQLITE_OK)
        s = sql_error(store, "cannot be brought up to date", err);
    THEN(s, sql_exec(store, "PRAGMA user_version=13; COMMIT", "cannot be set up", err));
    if (s == STATUS_OK && version > 0)
        log_info("%s: brought up from store version %d to %d; finished jobs stay as they are%s", store->folder, version,
                 STORE_VERSION, version < 9 ? ", unfinished frames are rendered from their beginning" : "");
    if (s == STATUS_OK && webhooks > 0)
        log_warn("%s: had %d webhook%s, which nothing is posted to any more: --on-event PROGRAM runs a program for each event, and "
                 "deploy/on-event/post.py is one that posts", store->folder, webhooks, webhooks == 1 ? "" : "s");
    return s;
}

static status open_to_write(struct store *store, const char *path, struct error *err)
{
    const char *other;

    TRY(refuse_lost_queue(store, path, err)); /* before SQLite removes the log of an empty file */
    TRY(database_make(store, path, err));
    other = database_other_columns(store->db);
    if (other)
        return error_set(err, STATUS_ERR_CORRUPT, "%s: is damaged: the table %s has other columns; 'azulejo-coordinator --check "
                         "--repair --store %s' saves what can be read, or restore a back-up", path, other, store->folder);
    return STATUS_OK;
}

/* The path as a URI that declares the file immutable: SQLite then needs neither its index of the log nor a lock. */
static void immutable_name(const char *path, struct buffer *name)
{
    buffer_printf(name, "file:");
    for (const char *at = path; *at; at++)
        buffer_printf(name, strchr("?#%", *at) ? "%%%02X" : "%c", (unsigned char)*at);
    buffer_printf(name, "?immutable=1");
}

/* Without permission or space to write, the log can only be read if its index exists. If the log is
 * empty, as after an orderly end, it need not be read. */
static status open_to_read(struct store *store, const char *path, struct error *err)
{
    struct buffer name = BUFFER_INIT, log = BUFFER_INIT;
    struct stat info;
    int version = 0;
    status s;

    buffer_printf(&log, "%s-wal", path);
    if (stat(buffer_text(&log), &info) == 0 && info.st_size > 0)
        buffer_printf(&name, "%s", path);
    else
        immutable_name(path, &name);
    s = buffer_ok(&name) && buffer_ok(&log)
            ? connect(store, buffer_text(&name), SQLITE_OPEN_READONLY | SQLITE_OPEN_URI, err)
            : error_no_memory(err, "the store");
    THEN(s, schema_version(store, &version, err));
    if (s == STATUS_OK && version != STORE_VERSION)
        s = error_set(err, STATUS_ERR_IO, "%s: its tables have an older version", path);
    buffer_release(&name);
    buffer_release(&log);
    return s;
}

/* Close a connection that did not open. Here damage is distinguished from failures of the
 * environment: it ends the coordinator before anything is written. */
static status disconnect(struct store *store, status s, struct error *err)
{
    int code = store->db ? sqlite3_errcode(store->db) : SQLITE_OK;

    if (code == SQLITE_CORRUPT || code == SQLITE_NOTADB || code == SQLITE_ERROR) {
        struct error why = *err;
        s = error_set(err, STATUS_ERR_CORRUPT,
                      "%.300s; 'azulejo-coordinator --check --repair --store %s' saves what can be read, or restore a back-up",
                      why.text, store->folder);
    }
    database_close(store);
    return s;
}

/* Open for writing, with the reserve's space if there is no other, or at least for reading. The
 * reason why it cannot be written is in `err` even if it can be read. */
static status open_as_possible(struct store *store, const char *path, struct error *err)
{
    struct error why = {0};
    status s = open_to_write(store, path, err);

    if (status_is_environment(s) && store->db && sql_give_reserve(store)) {
        database_close(store);
        s = open_to_write(store, path, err);
    }
    store->read_only = s != STATUS_OK;
    if (s == STATUS_OK)
        return s;
    s = disconnect(store, s, err);
    if (!status_is_environment(s) || open_to_read(store, path, &why) == STATUS_OK)
        return s;
    database_close(store);
    return s;
}

static void reader_close(struct store *store)
{
    sqlite3_close(store->reader);
    store->reader = NULL;
}

/* The second connection. Without it, questions wait for what is being written. */
static void reader_open(struct store *store, const char *path)
{
    if (store->read_only)
        return; /* it is not written to */
    if (sqlite3_open_v2(path, &store->reader, SQLITE_OPEN_READONLY | SQLITE_OPEN_FULLMUTEX, NULL) != SQLITE_OK ||
        sqlite3_exec(store->reader, "SELECT count(*) FROM meta", NULL, NULL, NULL) != SQLITE_OK) {
        log_debug("%s: no connection for reading: %s", path, store->reader ? sqlite3_errmsg(store->reader) : "no memory");
        reader_close(store);
        return;
    }
    sqlite3_busy_timeout(store->reader, BUSY_MS);
}

sqlite3 *reader_take(struct store *store)
{
    pthread_mutex_lock(&store->reading);
    if (store->reader)
        return store->reader;
    pthread_mutex_unlock(&store->reading);
    pthread_mutex_lock(&store->order); /* also, because `db` may be exchanged */
    return store->db;
}

void reader_leave(struct store *store, sqlite3 *db)
{
    pthread_mutex_unlock(db && db == store->reader ? &store->reading : &store->order);
}

/* Say which rows are damaged. A file whose structure is, is closed. */
static status find_damage(struct store *store, const char *path, struct error *err)
{
    char why[128];
    int sound = rows_sound(store->db, why, sizeof why), code = sound ? rows_find(store->db) : sqlite3_errcode(store->db);
    struct sql_rows rows;

    if (!sound || code != SQLITE_OK) {
        if (code == SQLITE_NOMEM || code == SQLITE_IOERR || code == SQLITE_BUSY || code == SQLITE_FULL) {
            (void)sql_error(store, "cannot be read", err);
            database_close(store);
            return err->code;
        }
        if (sound)
            snprintf(why, sizeof why, "%s", sqlite3_errmsg(store->db));
        database_close(store);
        return error_set(err, STATUS_ERR_CORRUPT,
                         "%s: is damaged (%s): 'azulejo-coordinator --check --repair --store %s' saves what can be read, or "
                         "restore a back-up", path, why, store->folder);
    }
    rows = sql_select(store, "SELECT tab, key, lost FROM temp.bad", NULL, 0, "cannot be read", err);
    while (sql_next(&rows))
        log_error("%s: table %s, row %s: is %s; 'azulejo-coordinator --check --store %s' says what to do", path,
                  sqlite3_column_text(rows.row, 0), sqlite3_column_text(rows.row, 1),
                  sqlite3_column_int(rows.row, 2) ? "lost" : "damaged", store->folder);
    return sql_end(&rows);
}

status database_open(struct store *store, struct error *err)
{
    char *path = file_join(store->folder, "queue.sqlite");
    status s = path ? open_as_possible(store, path, err) : error_no_memory(err, "the store");

    if (path && store->db)
        s = find_damage(store, path, err);
    if (path && store->db)
        reader_open(store, path);
    mem_free(path);
    return store->db ? STATUS_OK : s;
}

/* SQLite shares the log's index between a process's connections, and the old one opened it for
 * reading: that connection must be closed first. */
status database_reopen(struct store *store, struct error *err)
{
    char *path = file_join(store->folder, "queue.sqlite");
    int fd = path ? open(path, O_RDWR | O_CLOEXEC) : -1;
    struct error why = {0};
    status s;

    NEED(path, err, "the store");
    if (fd < 0) {
        s = error_set(err, STATUS_ERR_IO, "%s: cannot be opened: %s", path, strerror(errno));
    } else {
        close(fd);
        pthread_mutex_lock(&store->order);
        pthread_mutex_lock(&store->reading);
        reader_close(store);
        database_close(store);
        s = open_as_possible(store, path, err);
        if (store->db && find_damage(store, path, &why) != STATUS_OK)
            s = error_set(err, why.code, "%s", why.text);
        if (store->db)
            reader_open(store, path);
        pthread_mutex_unlock(&store->reading);
        pthread_mutex_unlock(&store->order);
    }
    mem_free(path);
    return s;
}
