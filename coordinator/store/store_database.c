/* The database file: its tables and their versions, and the few ways to run a statement. */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/base/file.h"
#include "common/base/log.h"
#include "common/base/memory.h"
#include "coordinator/store/reserve.h"
#include "coordinator/store/store_parts.h"
#include "coordinator/store/store_web.h"

/* Version of the tables, kept in SQLite's user_version. */
enum { STORE_VERSION = 9, BUSY_MS = 5000 };

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
static const char schema_2[] =
    "ALTER TABLE jobs ADD COLUMN revision INTEGER NOT NULL DEFAULT 0;"
    "ALTER TABLE frames ADD COLUMN revision INTEGER NOT NULL DEFAULT 0;";

/* Version 3: the tokens of submissions, NULL for jobs without one; the frames that were cut short. */
static const char schema_3[] =
    "ALTER TABLE jobs ADD COLUMN token TEXT;"
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
static const char schema_6[] =
    "ALTER TABLE jobs ADD COLUMN owner TEXT NOT NULL DEFAULT '';"
    "ALTER TABLE jobs ADD COLUMN marks INTEGER NOT NULL DEFAULT 0;" /* enum job_mark */
    "ALTER TABLE jobs ADD COLUMN priority INTEGER;"
    "CREATE TABLE removed (job INTEGER PRIMARY KEY);"; /* whose files may still be there */

static status add_steering(struct store *store, struct error *err)
{
    status s = sql_exec(store, schema_6, "cannot be brought up to date", err);

    return s == STATUS_OK ? sql_exec(store, events_schema, "cannot be brought up to date", err) : s;
}

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

static status add_workers_and_needs(struct store *store, struct error *err)
{
    status s = sql_exec(store, schema_7, "cannot be brought up to date", err);

    return s == STATUS_OK ? sql_exec(store, needs_schema, "cannot be brought up to date", err) : s;
}

/* Version 8: tokens and webhooks of the page. The first row of `tokens` gets number TOKEN_FIRST. */
static const char schema_8[] =
    "CREATE TABLE tokens (number INTEGER PRIMARY KEY AUTOINCREMENT, name TEXT NOT NULL, role INTEGER NOT NULL,"
    " owner TEXT NOT NULL, made_by TEXT NOT NULL, hash BLOB NOT NULL, made_at INTEGER NOT NULL,"
    " used_at INTEGER NOT NULL, expires_at INTEGER NOT NULL);"
    "INSERT INTO sqlite_sequence (name, seq) VALUES ('tokens', 1);"
    "CREATE TABLE webhooks (number INTEGER PRIMARY KEY AUTOINCREMENT, url TEXT NOT NULL, secret BLOB NOT NULL,"
    " made_by TEXT NOT NULL, made_at INTEGER NOT NULL);"
    "CREATE TABLE webhook_events (id INTEGER PRIMARY KEY AUTOINCREMENT,"
    " webhook INTEGER NOT NULL REFERENCES webhooks(number) ON DELETE CASCADE, at INTEGER NOT NULL,"
    " body TEXT NOT NULL);";
_Static_assert(TOKEN_FIRST == 2, "as in schema_8");

/* Version 9: comments; each frame's sums of light by depth, doubles of 64 bits, little-endian; NULL: not known. */
static const char schema_9[] = "ALTER TABLE jobs ADD COLUMN comment TEXT NOT NULL DEFAULT '';"
                               "ALTER TABLE frames ADD COLUMN depth BLOB;";

/* Films have another format since version 9 (and since 4 and 5), so an unfinished frame's film is useless
 * (film_file_open renames it): a job without a finished frame counts as not begun, and workers of any release
 * may begin it. The numbers are those of enum job_state: not DONE, FAILED or CANCELLED. */
#define NOT_BEGUN " state NOT IN (2, 3, 4) AND NOT EXISTS (SELECT 1 FROM frames WHERE job=jobs.id)"
static const char convert_9[] =
    "DELETE FROM clocks WHERE job IN (SELECT id FROM jobs WHERE" NOT_BEGUN ");"
    "DELETE FROM history WHERE job IN (SELECT id FROM jobs WHERE" NOT_BEGUN ");"
    "UPDATE jobs SET kernel='', active_ns=0, conflicts=0, samples=0, rays=0, vertices=0, dropped=0,"
    " cpu_ns=0, trace_ns=0 WHERE" NOT_BEGUN ";";

_Static_assert(JOB_STATE_DONE == 2 && JOB_STATE_FAILED == 3 && JOB_STATE_CANCELLED == 4,
               "as in NOT_BEGUN");

status sql_failed(struct store *store, sqlite3 *db, const char *what, struct error *err)
{
    int code = sqlite3_errcode(db);
    int number = sqlite3_system_errno(db); /* of its last I/O error */
    int told = number && (code == SQLITE_IOERR || code == SQLITE_CANTOPEN);

    atomic_store(&store->suspect, 1);
    return error_set(err, code == SQLITE_NOMEM ? STATUS_ERR_NO_MEMORY : STATUS_ERR_IO,
                     "%s/queue.sqlite: %s: %s%s%s", store->folder, what, sqlite3_errmsg(db),
                     told ? ": " : "", told ? strerror(number) : "");
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

struct sql_value sql_number(int64_t number)
{
    return (struct sql_value){.kind = SQL_NUMBER, .number = number};
}

struct sql_value sql_real(double value)
{
    return (struct sql_value){.kind = SQL_REAL, .real = value};
}

struct sql_value sql_text(const char *text)
{
    return (struct sql_value){.kind = SQL_TEXT, .data = text, .size_bytes = text ? strlen(text) : 0};
}

struct sql_value sql_bytes(const struct buffer *bytes)
{
    return (struct sql_value){
        .kind = SQL_BYTES, .data = bytes->size ? bytes->data : NULL, .size_bytes = bytes->size};
}

static int bind(sqlite3_stmt *statement, int at, const struct sql_value *value)
{
    switch (value->kind) {
    case SQL_NUMBER: return sqlite3_bind_int64(statement, at, value->number);
    case SQL_REAL: return sqlite3_bind_double(statement, at, value->real);
    case SQL_TEXT:
        return sqlite3_bind_text(statement, at, value->data, (int)value->size_bytes,
                                 SQLITE_TRANSIENT);
    default:
        return sqlite3_bind_blob(statement, at, value->data, (int)value->size_bytes,
                                 SQLITE_TRANSIENT);
    }
}

status sql_ask(struct store *store, sqlite3 *db, const char *sql, const struct sql_value *values, size_t count,
               sqlite3_stmt **out, struct error *err)
{
    int code = sqlite3_prepare_v2(db, sql, -1, out, NULL);
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

status sql_select(struct store *store, const char *sql, const struct sql_value *values,
                  size_t count, sqlite3_stmt **out, struct error *err)
{
    return sql_ask(store, store->db, sql, values, count, out, err);
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

static status change(struct store *store, const char *sql, const struct sql_value *values,
                     size_t count, int reserved, const char *what, struct error *err)
{
    sqlite3_stmt *statement = NULL;
    /* In a transaction, which such an error may have ended, its owner repeats all of it. */
    int alone = sqlite3_get_autocommit(store->db);
    status s = sql_select(store, sql, values, count, &statement, err);
    int code;

    if (s != STATUS_OK)
        return s;
    code = sqlite3_step(statement);
    if (code != SQLITE_DONE && alone && reserved && sql_give_reserve(store)) {
        sqlite3_reset(statement);
        code = sqlite3_step(statement);
    }
    if (code != SQLITE_DONE)
        s = sql_error(store, what, err);
    sqlite3_finalize(statement);
    return s;
}

status sql_change(struct store *store, const char *sql, const struct sql_value *values,
                  size_t count, const char *what, struct error *err)
{
    return change(store, sql, values, count, 0, what, err);
}

status sql_change_reserved(struct store *store, const char *sql, const struct sql_value *values,
                           size_t count, const char *what, struct error *err)
{
    return change(store, sql, values, count, 1, what, err);
}

void column_text(sqlite3_stmt *statement, int at, char *out, size_t size)
{
    const unsigned char *text = sqlite3_column_text(statement, at);

    snprintf(out, size, "%s", text ? (const char *)text : "");
}

uint64_t column_number(sqlite3_stmt *statement, int at)
{
    return (uint64_t)sqlite3_column_int64(statement, at);
}

static status schema_version(struct store *store, int *version, struct error *err)
{
    sqlite3_stmt *statement = NULL;
    status s = sql_select(store, "PRAGMA user_version", NULL, 0, &statement, err);

    if (s != STATUS_OK)
        return s;
    if (sqlite3_step(statement) == SQLITE_ROW)
        *version = sqlite3_column_int(statement, 0);
    else
        s = sql_error(store, "cannot be read", err);
    sqlite3_finalize(statement);
    if (s == STATUS_OK && *version > STORE_VERSION)
        return error_set(err, STATUS_ERR_CORRUPT,
                         "%s: was written by a newer azulejo (store version %d; this one reads %d)",
                         store->folder, *version, STORE_VERSION);
    return s;
}

static status connect(struct store *store, const char *name, int flags, struct error *err)
{
    if (sqlite3_open_v2(name, &store->db, flags | SQLITE_OPEN_FULLMUTEX, NULL) != SQLITE_OK)
        return store->db ? sql_error(store, "cannot be opened", err) : error_no_memory(err, name);
    sqlite3_extended_result_codes(store->db, 0);
    sqlite3_busy_timeout(store->db, BUSY_MS);
    return STATUS_OK;
}

static status open_to_write(struct store *store, const char *path, struct error *err)
{
    int version = 0;
    /* SQLite gives its other files the permissions of this one. */
    int fd = open(path, O_RDWR | O_CREAT | O_CLOEXEC, 0600);
    status s;

    if (fd < 0)
        return error_set(err, STATUS_ERR_IO, "%s: cannot be opened: %s", path, strerror(errno));
    close(fd);
    s = connect(store, path, SQLITE_OPEN_READWRITE, err);
    if (s == STATUS_OK)
        s = sql_exec(store, "PRAGMA journal_mode=WAL; PRAGMA synchronous=FULL; "
                            "PRAGMA foreign_keys=ON", "cannot be opened", err);
    if (s == STATUS_OK)
        s = schema_version(store, &version, err);
    if (s != STATUS_OK || version == STORE_VERSION)
        return s;
    s = sql_exec(store, "BEGIN IMMEDIATE", "cannot be written", err);
    if (s == STATUS_OK && version < 1)
        s = sql_exec(store, schema, "cannot be set up", err);
    if (s == STATUS_OK && version < 2)
        s = sql_exec(store, schema_2, "cannot be brought up to date", err);
    if (s == STATUS_OK && version < 3)
        s = sql_exec(store, schema_3, "cannot be brought up to date", err);
    if (s == STATUS_OK && version < 4)
        s = sql_exec(store, schema_4, "cannot be brought up to date", err);
    if (s == STATUS_OK && version < 4)
        s = sql_exec(store, deliverers_schema, "cannot be brought up to date", err);
    if (s == STATUS_OK && version < 5)
        s = sql_exec(store, schema_5, "cannot be brought up to date", err);
    if (s == STATUS_OK && version < 6)
        s = add_steering(store, err);
    if (s == STATUS_OK && version < 7)
        s = add_workers_and_needs(store, err);
    if (s == STATUS_OK && version < 8)
        s = sql_exec(store, schema_8, "cannot be brought up to date", err);
    if (s == STATUS_OK && version < 9)
        s = sql_exec(store, schema_9, "cannot be brought up to date", err);
    if (s == STATUS_OK && version > 0 && version < 9)
        s = sql_exec(store, convert_9, "cannot be brought up to date", err);
    if (s == STATUS_OK)
        s = sql_exec(store, "PRAGMA user_version=9; COMMIT", "cannot be set up", err);
    if (s == STATUS_OK && version > 0)
        log_info("%s: brought up from store version %d to %d; finished jobs stay as they are%s",
                 store->folder, version, STORE_VERSION,
                 version < 9 ? ", unfinished frames are rendered from their beginning" : "");
    return s;
}

/* The path as a URI that declares the file immutable: SQLite then needs neither its index of the
 * log nor a lock. */
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
    if (s == STATUS_OK)
        s = schema_version(store, &version, err);
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
        s = STATUS_ERR_CORRUPT;
        if (err)
            err->code = s;
    }
    sqlite3_close(store->db);
    store->db = NULL;
    return s;
}

/* Open for writing, with the reserve's space if there is no other, or at least for reading. The
 * reason why it cannot be written is in `err` even if it can be read. */
static status open_as_possible(struct store *store, const char *path, struct error *err)
{
    struct error why = {0};
    status s = open_to_write(store, path, err);

    if (status_is_environment(s) && store->db && sql_give_reserve(store)) {
        sqlite3_close(store->db);
        store->db = NULL;
        s = open_to_write(store, path, err);
    }
    store->read_only = s != STATUS_OK;
    if (s == STATUS_OK)
        return s;
    s = disconnect(store, s, err);
    if (!status_is_environment(s) || open_to_read(store, path, &why) == STATUS_OK)
        return s;
    sqlite3_close(store->db);
    store->db = NULL;
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
        return; /* nobody writes */
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

status database_open(struct store *store, struct error *err)
{
    char *path = file_join(store->folder, "queue.sqlite");
    status s = path ? open_as_possible(store, path, err) : error_no_memory(err, "the store");

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
    status s;

    if (!path)
        return error_no_memory(err, "the store");
    if (fd < 0) {
        s = error_set(err, STATUS_ERR_IO, "%s: cannot be opened: %s", path, strerror(errno));
    } else {
        close(fd);
        pthread_mutex_lock(&store->order);
        pthread_mutex_lock(&store->reading);
        reader_close(store);
        sqlite3_close(store->db);
        store->db = NULL;
        s = open_as_possible(store, path, err);
        if (store->db)
            reader_open(store, path);
        pthread_mutex_unlock(&store->reading);
        pthread_mutex_unlock(&store->order);
    }
    mem_free(path);
    return s;
}
