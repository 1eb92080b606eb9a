#include "coordinator/store/store_web.h"

#include <string.h>

#include "coordinator/store/store_parts.h"

/* Step through the rows; `read` ends it with an error. */
static status read_rows(struct store *store, const char *sql, const char *what,
                        status (*read)(void *user, sqlite3_stmt *statement, struct error *err), void *user,
                        struct error *err)
{
    struct sql_rows rows = sql_select(store, sql, NULL, 0, what, err);

    while (sql_next(&rows))
        rows.result = read(user, rows.row, err);
    return sql_end(&rows);
}

/* Exactly so many bytes. A row that is shorter was damaged. */
static status column_bytes(struct store *store, sqlite3_stmt *statement, int at, void *out, size_t size,
                           struct error *err)
{
    if ((size_t)sqlite3_column_bytes(statement, at) != size)
        return error_set(err, STATUS_ERR_CORRUPT, "%s/queue.sqlite: a token is damaged", store->folder);
    memcpy(out, sqlite3_column_blob(statement, at), size);
    return STATUS_OK;
}

static struct sql_value sql_blob(const void *data, size_t size)
{
    return (struct sql_value){.kind = SQL_BYTES, .data = data, .size_bytes = size};
}

/* Numbers are never given again. */
static status next_token(struct store *store, uint64_t *out, struct error *err)
{
    struct sql_rows rows;

    if (store->last_token == 0) {
        rows = sql_read(store, "SELECT seq FROM sqlite_sequence WHERE name='tokens'", NULL, 0,
                        "the next number cannot be read", err);
        if (sql_next(&rows))
            store->last_token = column_number(rows.row, 0);
        TRY(sql_end(&rows));
    }
    *out = ++store->last_token;
    return STATUS_OK;
}

/* ---- tokens ----------------------------------------------------------------------------------- */

status store_token_add(struct store *store, struct token_row *row, struct error *err)
{
    TRY(next_token(store, &row->number, err));
    return sql_note(store,
                    "INSERT INTO tokens (number, name, role, owner, made_by, hash, made_at, used_at, expires_at)"
                    " VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)",
                    SQL_VALUES(sql_number((int64_t)row->number), sql_text(row->name), sql_number(row->role),
                               sql_text(row->owner), sql_text(row->made_by), sql_blob(&row->hash, sizeof row->hash),
                               sql_number(row->made_at), sql_number(row->used_at), sql_number(row->expires_at)),
                    "the token cannot be stored", err);
}

status store_token_renew(struct store *store, uint64_t number, const struct digest *hash, int64_t made_at,
                         struct error *err)
{
    return sql_note(store, "UPDATE tokens SET hash=?, made_at=?, used_at=0 WHERE number=?",
                    SQL_VALUES(sql_blob(hash, sizeof *hash), sql_number(made_at), sql_number((int64_t)number)),
                    "the token cannot be stored", err);
}

status store_token_remove(struct store *store, uint64_t number, struct error *err)
{
    return sql_note(store, "DELETE FROM tokens WHERE number=?", SQL_VALUES(sql_number((int64_t)number)),
                    "the token cannot be removed", err);
}

status store_token_used(struct store *store, uint64_t number, int64_t at, struct error *err)
{
    return sql_write(store, "UPDATE tokens SET used_at=? WHERE number=?",
                     SQL_VALUES(sql_number(at), sql_number((int64_t)number)), "when a token was used cannot be stored",
                     NULL, err);
}

struct visit_tokens {
    struct store *store;
    status (*visit)(void *user, const struct token_row *row, struct error *err);
    void *user;
};

static status read_token(void *user, sqlite3_stmt *statement, struct error *err)
{
    struct visit_tokens *v = user;
    struct token_row row = {.number = column_number(statement, 0),
                            .role = (uint32_t)column_number(statement, 2),
                            .made_at = sqlite3_column_int64(statement, 6),
                            .used_at = sqlite3_column_int64(statement, 7),
                            .expires_at = sqlite3_column_int64(statement, 8)};
    status s = column_bytes(v->store, statement, 5, &row.hash, sizeof row.hash, err);

    column_text(statement, 1, row.name, sizeof row.name);
    column_text(statement, 3, row.owner, sizeof row.owner);
    column_text(statement, 4, row.made_by, sizeof row.made_by);
    return s == STATUS_OK ? v->visit(v->user, &row, err) : s;
}

status store_tokens_load(struct store *store,
                         status (*visit)(void *user, const struct token_row *row, struct error *err), void *user,
                         struct error *err)
{
    struct visit_tokens v = {store, visit, user};

    return read_rows(store,
                     "SELECT number, name, role, owner, made_by, hash, made_at, used_at, expires_at FROM tokens"
                     " WHERE number NOT IN (SELECT key FROM temp.bad WHERE tab='tokens')"
                     " ORDER BY number",
                     "the tokens cannot be read", read_token, &v, err);
}

/* ---- events that wait for their program --------------------------------------------------------- */

status store_waiting_event_add(struct store *store, uint64_t id, int64_t at, const char *json, struct error *err)
{
    return sql_note(store, "INSERT INTO waiting_events (id, at, json) VALUES (?, ?, ?)",
                    SQL_VALUES(sql_number((int64_t)id), sql_number(at), sql_text(json)), "an event cannot be stored", err);
}

status store_waiting_event_remove(struct store *store, uint64_t id, struct error *err)
{
    return sql_note(store, "DELETE FROM waiting_events WHERE id=?", SQL_VALUES(sql_number((int64_t)id)),
                    "an event cannot be removed", err);
}

struct visit_waiting {
    status (*visit)(void *user, uint64_t id, const char *json, struct error *err);
    void *user;
};

static status read_waiting(void *user, sqlite3_stmt *statement, struct error *err)
{
    struct visit_waiting *v = user;
    const char *json = (const char *)sqlite3_column_text(statement, 1);

    return json ? v->visit(v->user, column_number(statement, 0), json, err) : error_no_memory(err, "the events that wait");
}

status store_waiting_events_load(struct store *store,
                                 status (*visit)(void *user, uint64_t id, const char *json, struct error *err),
                                 void *user, struct error *err)
{
    struct visit_waiting v = {visit, user};

    return read_rows(store, "SELECT id, json FROM waiting_events WHERE id NOT IN"
                     " (SELECT key FROM temp.bad WHERE tab='waiting_events') ORDER BY id",
                     "the events that wait cannot be read", read_waiting, &v, err);
}
