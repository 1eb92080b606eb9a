#include "coordinator/store/store_web.h"

#include <string.h>

#include "coordinator/store/store_parts.h"

/* ---- running a statement while no other thread writes ----------------------------------------- */

static status write_row(struct store *store, const char *sql, const struct sql_value *values, size_t count,
                        const char *what, struct error *err)
{
    status s;

    pthread_mutex_lock(&store->order);
    s = sql_change_reserved(store, sql, values, count, what, err);
    pthread_mutex_unlock(&store->order);
    return s;
}

static status insert_row(struct store *store, const char *sql, const struct sql_value *values, size_t count,
                         const char *what, uint64_t *number, struct error *err)
{
    status s;

    pthread_mutex_lock(&store->order);
    s = sql_change_reserved(store, sql, values, count, what, err);
    if (s == STATUS_OK)
        *number = (uint64_t)sqlite3_last_insert_rowid(store->db);
    pthread_mutex_unlock(&store->order);
    return s;
}

/* Step through the rows; `read` ends it with an error. */
static status read_rows(struct store *store, const char *sql, const char *what,
                        status (*read)(void *user, sqlite3_stmt *statement, struct error *err), void *user,
                        struct error *err)
{
    sqlite3_stmt *statement = NULL;
    int code = SQLITE_DONE;
    status s = sql_select(store, sql, NULL, 0, &statement, err);

    while (s == STATUS_OK && (code = sqlite3_step(statement)) == SQLITE_ROW)
        s = read(user, statement, err);
    if (s == STATUS_OK && code != SQLITE_DONE)
        s = sql_error(store, what, err);
    sqlite3_finalize(statement);
    return s;
}

/* Exactly so many bytes. A row that is shorter was damaged. */
static status column_bytes(struct store *store, sqlite3_stmt *statement, int at, void *out, size_t size,
                           struct error *err)
{
    if ((size_t)sqlite3_column_bytes(statement, at) != size)
        return error_set(err, STATUS_ERR_CORRUPT, "%s/queue.sqlite: a token or a webhook is damaged", store->folder);
    memcpy(out, sqlite3_column_blob(statement, at), size);
    return STATUS_OK;
}

static struct sql_value sql_blob(const void *data, size_t size)
{
    return (struct sql_value){.kind = SQL_BYTES, .data = data, .size_bytes = size};
}

/* ---- tokens ----------------------------------------------------------------------------------- */

status store_token_add(struct store *store, struct token_row *row, struct error *err)
{
    return insert_row(store,
                      "INSERT INTO tokens (name, role, owner, made_by, hash, made_at, used_at, expires_at)"
                      " VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
                      SQL_VALUES(sql_text(row->name), sql_number(row->role), sql_text(row->owner),
                                 sql_text(row->made_by), sql_blob(&row->hash, sizeof row->hash),
                                 sql_number(row->made_at), sql_number(row->used_at), sql_number(row->expires_at)),
                      "the token cannot be stored", &row->number, err);
}

status store_token_renew(struct store *store, uint64_t number, const struct digest *hash, int64_t made_at,
                         struct error *err)
{
    return write_row(store, "UPDATE tokens SET hash=?, made_at=?, used_at=0 WHERE number=?",
                     SQL_VALUES(sql_blob(hash, sizeof *hash), sql_number(made_at), sql_number((int64_t)number)),
                     "the token cannot be stored", err);
}

status store_token_remove(struct store *store, uint64_t number, struct error *err)
{
    return write_row(store, "DELETE FROM tokens WHERE number=?", SQL_VALUES(sql_number((int64_t)number)),
                     "the token cannot be removed", err);
}

status store_token_used(struct store *store, uint64_t number, int64_t at, struct error *err)
{
    return write_row(store, "UPDATE tokens SET used_at=? WHERE number=?",
                     SQL_VALUES(sql_number(at), sql_number((int64_t)number)),
                     "when a token was used cannot be stored", err);
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
                         status (*visit)(void *user, const struct token_row *row, struct error *err),
                         void *user, struct error *err)
{
    struct visit_tokens v = {store, visit, user};

    return read_rows(store,
                     "SELECT number, name, role, owner, made_by, hash, made_at, used_at, expires_at FROM tokens"
                     " ORDER BY number",
                     "the tokens cannot be read", read_token, &v, err);
}

/* ---- webhooks --------------------------------------------------------------------------------- */

status store_webhook_add(struct store *store, struct webhook_row *row, struct error *err)
{
    return insert_row(store, "INSERT INTO webhooks (url, secret, made_by, made_at) VALUES (?, ?, ?, ?)",
                      SQL_VALUES(sql_text(row->url), sql_blob(row->secret, sizeof row->secret),
                                 sql_text(row->made_by), sql_number(row->made_at)),
                      "the webhook cannot be stored", &row->number, err);
}

status store_webhook_remove(struct store *store, uint64_t number, struct error *err)
{
    return write_row(store, "DELETE FROM webhooks WHERE number=?", SQL_VALUES(sql_number((int64_t)number)),
                     "the webhook cannot be removed", err);
}

struct visit_webhooks {
    struct store *store;
    status (*visit)(void *user, const struct webhook_row *row, struct error *err);
    void *user;
};

static status read_webhook(void *user, sqlite3_stmt *statement, struct error *err)
{
    struct visit_webhooks *v = user;
    struct webhook_row row = {.number = column_number(statement, 0),
                              .made_at = sqlite3_column_int64(statement, 4)};
    status s = column_bytes(v->store, statement, 2, row.secret, sizeof row.secret, err);

    column_text(statement, 1, row.url, sizeof row.url);
    column_text(statement, 3, row.made_by, sizeof row.made_by);
    return s == STATUS_OK ? v->visit(v->user, &row, err) : s;
}

status store_webhooks_load(struct store *store,
                           status (*visit)(void *user, const struct webhook_row *row, struct error *err),
                           void *user, struct error *err)
{
    struct visit_webhooks v = {store, visit, user};

    return read_rows(store, "SELECT number, url, secret, made_by, made_at FROM webhooks ORDER BY number",
                     "the webhooks cannot be read", read_webhook, &v, err);
}

status store_webhook_event_add(struct store *store, struct webhook_event *event, struct error *err)
{
    uint64_t id = 0;
    int made;
    status s;

    pthread_mutex_lock(&store->order);
    s = sql_change_reserved(store,
                            "INSERT INTO webhook_events (webhook, at, body) SELECT number, ?2, ?3 FROM webhooks"
                            " WHERE number=?1",
                            SQL_VALUES(sql_number((int64_t)event->webhook), sql_number(event->at),
                                       sql_text(event->body)),
                            "what a webhook is to be sent cannot be stored", err);
    made = s == STATUS_OK && sqlite3_changes(store->db) == 1;
    if (made)
        id = (uint64_t)sqlite3_last_insert_rowid(store->db);
    pthread_mutex_unlock(&store->order);
    if (s == STATUS_OK && !made)
        return error_set(err, STATUS_ERR_NOT_FOUND, "webhook %llu was removed", (unsigned long long)event->webhook);
    event->id = id;
    return s;
}

status store_webhook_event_remove(struct store *store, uint64_t id, struct error *err)
{
    return write_row(store, "DELETE FROM webhook_events WHERE id=?", SQL_VALUES(sql_number((int64_t)id)),
                     "what a webhook was sent cannot be removed", err);
}

struct visit_events {
    status (*visit)(void *user, const struct webhook_event *event, struct error *err);
    void *user;
};

static status read_event(void *user, sqlite3_stmt *statement, struct error *err)
{
    struct visit_events *v = user;
    struct webhook_event event = {.id = column_number(statement, 0),
                                  .webhook = column_number(statement, 1),
                                  .at = sqlite3_column_int64(statement, 2),
                                  .body = (const char *)sqlite3_column_text(statement, 3)};

    return event.body ? v->visit(v->user, &event, err) : error_no_memory(err, "what a webhook is to be sent");
}

status store_webhook_events_load(struct store *store,
                                 status (*visit)(void *user, const struct webhook_event *event,
                                                 struct error *err),
                                 void *user, struct error *err)
{
    struct visit_events v = {visit, user};

    return read_rows(store, "SELECT id, webhook, at, body FROM webhook_events ORDER BY id",
                     "what webhooks are to be sent cannot be read", read_event, &v, err);
}
