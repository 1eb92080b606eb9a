/* The database file: its tables and their versions, and the few ways to run a statement. */
#include <stdio.h>

#include "common/base/file.h"
#include "common/base/memory.h"
#include "coordinator/store_parts.h"

/* Version of the tables, kept in SQLite's user_version. */
enum { STORE_VERSION = 2, BUSY_MS = 5000 };

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

/* No new version: a store without this table, or a release that does not know it, has no frame that
 * was cut short. */
static const char schema_cuts[] =
    "CREATE TABLE IF NOT EXISTS cut_frames (job INTEGER NOT NULL REFERENCES jobs(id),"
    " frame INTEGER NOT NULL, samples INTEGER NOT NULL, least INTEGER NOT NULL,"
    " most INTEGER NOT NULL, tiles INTEGER NOT NULL, tiles_empty INTEGER NOT NULL,"
    " PRIMARY KEY (job, frame)) WITHOUT ROWID;";

status sql_error(const struct store *store, const char *what, struct error *err)
{
    int code = sqlite3_errcode(store->db);

    return error_set(err,
                     code == SQLITE_NOMEM ? STATUS_ERR_NO_MEMORY
                     : code == SQLITE_CORRUPT || code == SQLITE_NOTADB ? STATUS_ERR_CORRUPT
                                                                       : STATUS_ERR_IO,
                     "%s/queue.sqlite: %s: %s", store->folder, what, sqlite3_errmsg(store->db));
}

static status sql_exec(const struct store *store, const char *sql, const char *what,
                       struct error *err)
{
    if (sqlite3_exec(store->db, sql, NULL, NULL, NULL) != SQLITE_OK)
        return sql_error(store, what, err);
    return STATUS_OK;
}

status sql_prepare(const struct store *store, const char *sql, sqlite3_stmt **out,
                   struct error *err)
{
    if (sqlite3_prepare_v2(store->db, sql, -1, out, NULL) != SQLITE_OK)
        return sql_error(store, "prepare", err);
    return STATUS_OK;
}

status sql_run(const struct store *store, sqlite3_stmt *statement, const char *what,
               struct error *err)
{
    status s = STATUS_OK;

    if (sqlite3_step(statement) != SQLITE_DONE)
        s = sql_error(store, what, err);
    sqlite3_finalize(statement);
    return s;
}

void bind_text(sqlite3_stmt *statement, int at, const char *text)
{
    sqlite3_bind_text(statement, at, text, -1, SQLITE_TRANSIENT);
}

void bind_number(sqlite3_stmt *statement, int at, uint64_t value)
{
    sqlite3_bind_int64(statement, at, (sqlite3_int64)value);
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

status database_open(struct store *store, struct error *err)
{
    char *path = file_join(store->folder, "queue.sqlite");
    sqlite3_stmt *statement = NULL;
    int version = 0;
    status s;

    if (!path)
        return error_no_memory(err, "the store");
    if (sqlite3_open_v2(path, &store->db,
                        SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_FULLMUTEX,
                        NULL) != SQLITE_OK) {
        s = store->db ? sql_error(store, "cannot be opened", err) : error_no_memory(err, path);
        mem_free(path);
        return s;
    }
    mem_free(path);
    sqlite3_extended_result_codes(store->db, 0);
    sqlite3_busy_timeout(store->db, BUSY_MS);
    s = sql_exec(store, "PRAGMA journal_mode=WAL; PRAGMA synchronous=FULL; PRAGMA foreign_keys=ON",
                 "cannot be read", err);
    if (s == STATUS_OK)
        s = sql_prepare(store, "PRAGMA user_version", &statement, err);
    if (s != STATUS_OK)
        return s;
    if (sqlite3_step(statement) == SQLITE_ROW)
        version = sqlite3_column_int(statement, 0);
    sqlite3_finalize(statement);
    if (version > STORE_VERSION)
        return error_set(err, STATUS_ERR_CORRUPT,
                         "%s: was written by a newer azulejo (store version %d; this one reads %d)",
                         store->folder, version, STORE_VERSION);
    if (version == STORE_VERSION)
        return sql_exec(store, schema_cuts, "cannot be brought up to date", err);
    s = sql_exec(store, "BEGIN IMMEDIATE", "cannot be written", err);
    if (s == STATUS_OK && version < 1)
        s = sql_exec(store, schema, "cannot be set up", err);
    if (s == STATUS_OK)
        s = sql_exec(store, schema_2, "cannot be brought up to date", err);
    if (s == STATUS_OK)
        s = sql_exec(store, schema_cuts, "cannot be brought up to date", err);
    if (s == STATUS_OK)
        s = sql_exec(store, "PRAGMA user_version=2; COMMIT", "cannot be set up", err);
    return s;
}
