/* Workers that delivered results: films' logs hold their numbers, this table the rest. */
#include <string.h>

#include "coordinator/store/store_parts.h"

const char deliverers_schema[] =
    "CREATE TABLE deliverers (number INTEGER PRIMARY KEY, host TEXT NOT NULL,"
    " process INTEGER NOT NULL, software TEXT NOT NULL, first_seen INTEGER NOT NULL);";

status deliverer_write(struct store *store, const struct deliverer *d, struct error *err)
{
    return sql_change_reserved(store,
                               "INSERT OR REPLACE INTO deliverers (number, host, process, "
                               "software, first_seen) VALUES (?, ?, ?, ?, ?)",
                               SQL_VALUES(sql_number(d->number), sql_text(d->host),
                                          sql_number(d->process), sql_text(d->software),
                                          sql_number(d->first_seen)),
                               "the worker that delivers results cannot be stored", err);
}

status store_deliverers_last(struct store *store, uint32_t *last, struct error *err)
{
    sqlite3_stmt *statement = NULL;
    status s = sql_select(store, "SELECT COALESCE(MAX(number), 0) FROM deliverers", NULL, 0,
                          &statement, err);

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
    sqlite3 *db = reader_take(store);
    status s = sql_ask(store, db,
                       "SELECT host, process, software, first_seen,"
                       " (SELECT name FROM workers w WHERE w.host=d.host AND w.process=d.process"
                       "  ORDER BY joined_at DESC LIMIT 1)"
                       " FROM deliverers d WHERE number=?",
                       SQL_VALUES(sql_number(number)), &statement, err);
    int code = s == STATUS_OK ? sqlite3_step(statement) : SQLITE_DONE;

    memset(out, 0, sizeof *out);
    if (code == SQLITE_ROW) {
        out->number = number;
        column_text(statement, 0, out->host, sizeof out->host);
        out->process = (uint32_t)column_number(statement, 1);
        column_text(statement, 2, out->software, sizeof out->software);
        out->first_seen = sqlite3_column_int64(statement, 3);
        column_text(statement, 4, out->label, sizeof out->label);
    } else if (code != SQLITE_DONE) {
        s = sql_failed(store, db, "the deliverers cannot be read", err);
    }
    sqlite3_finalize(statement);
    reader_leave(store, db);
    return s;
}
