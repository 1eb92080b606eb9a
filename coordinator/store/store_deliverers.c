/* Who delivered results: films' logs keep a number for each, this table what is behind it. */
#include <string.h>

#include "coordinator/store/store_parts.h"

const char deliverers_schema[] =
    "CREATE TABLE deliverers (number INTEGER PRIMARY KEY, host TEXT NOT NULL,"
    " process INTEGER NOT NULL, software TEXT NOT NULL, first_seen INTEGER NOT NULL);";

status deliverer_write(struct store *store, const struct deliverer *d, struct error *err)
{
    sqlite3_stmt *statement = NULL;
    status s = sql_prepare(store,
                           "INSERT OR REPLACE INTO deliverers (number, host, process, software, "
                           "first_seen) VALUES (?, ?, ?, ?, ?)",
                           &statement, err);

    if (s != STATUS_OK)
        return s;
    sqlite3_bind_int64(statement, 1, d->number);
    bind_text(statement, 2, d->host);
    sqlite3_bind_int64(statement, 3, d->process);
    bind_text(statement, 4, d->software);
    sqlite3_bind_int64(statement, 5, d->first_seen);
    return sql_run_reserved(store, statement, "who delivers results cannot be stored", err);
}

status store_deliverers_last(struct store *store, uint32_t *last, struct error *err)
{
    sqlite3_stmt *statement = NULL;
    status s = sql_prepare(store, "SELECT COALESCE(MAX(number), 0) FROM deliverers", &statement, err);

    *last = 0;
    if (s != STATUS_OK)
        return s;
    if (sqlite3_step(statement) == SQLITE_ROW)
        *last = (uint32_t)column_number(statement, 0);
    else
        s = sql_error(store, "the deliverers cannot be read", err);
    sqlite3_finalize(statement);
    return s;
}

status store_deliverer_find(struct store *store, uint32_t number, struct deliverer *out,
                            struct error *err)
{
    sqlite3_stmt *statement = NULL;
    status s = sql_prepare(store,
                           "SELECT host, process, software, first_seen FROM deliverers "
                           "WHERE number=?",
                           &statement, err);
    int code;

    memset(out, 0, sizeof *out);
    if (s != STATUS_OK)
        return s;
    bind_number(statement, 1, number);
    code = sqlite3_step(statement);
    if (code == SQLITE_ROW) {
        out->number = number;
        column_text(statement, 0, out->host, sizeof out->host);
        out->process = (uint32_t)column_number(statement, 1);
        column_text(statement, 2, out->software, sizeof out->software);
        out->first_seen = sqlite3_column_int64(statement, 3);
    } else if (code != SQLITE_DONE) {
        s = sql_error(store, "the deliverers cannot be read", err);
    }
    sqlite3_finalize(statement);
    return s;
}
