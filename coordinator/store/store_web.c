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
        return error_set(err, STATUS_ERR_CORRUPT, "%s/queue.sqlite: a token or a webhook is damaged", store->folder);
    memcpy(out, sqlite3_column_blob(statement, at), size);
    return STATUS_OK;
}

static struct sql_value sql_blob(const void *data, size_t size)
{
    return (struct sql_value){.kind = SQL_BYTES, .data = data, .size_bytes = size};
}

/* The next number of a table whose numbers are never given again; *last: the last one, 0: not known. */
static status next_number(struct store *store, const char *table, uint64_t *last, struct error *err)
{
    struct sql_rows rows;

    if (*last == 0) {
        rows = sql_read(store, "SELECT seq FROM sqlite_sequence WHERE name=?", SQL_VALUES(sql_text(table)),
                        "the next number cannot be read", err);
        if (sql_next(&rows))
            *last = column_number(rows.row, 0);
        TRY(sql_end(&rows));
    }
    ++*last;
    return STATUS_OK;
}

/* ---- tokens ----------------------------------------------------------------------------------- */

status store_token_add(struct store *store, struct token_row *row, struct error *err)
{
    TRY(next_number(store, "tokens", &store->last_token, err));
    row->number = store->last_token;
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

/* ---- webhooks --------------------------------------------------------------------------------- */

status store_webhook_add(struct store *store, struct webhook_row *row, struct error *err)
{
    TRY(next_number(store, "webhooks", &store->last_webhook, err));
    row->number = store->last_webhook;
    return sql_note(store, "INSERT INTO webhooks (number, url, secret, made_by, made_at) VALUES (?, ?, ?, ?, ?)",
                     SQL_VALUES(sql_number((int64_t)row->number), sql_text(row->url), sql_blob(row->secret, sizeof row->secret), sql_text(row->made_by),
                                sql_number(row->made_at)),
                     "the webhook cannot be stored", err);
}

status store_webhook_remove(struct store *store, uint64_t number, struct error *err)
{
    return sql_note(store, "DELETE FROM webhooks WHERE number=?", SQL_VALUES(sql_number((int64_t)number)),
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
                           status (*visit)(void *user, const struct webhook_row *row, struct error *err), void *user,
                           struct error *err)
{
    struct visit_webhooks v = {store, visit, user};

    return read_rows(store, "SELECT number, url, secret, made_by, made_at FROM webhooks WHERE number NOT IN"
                     " (SELECT key FROM temp.bad WHERE tab='webhooks') ORDER BY number",
                     "the webhooks cannot be read", read_webhook, &v, err);
}

status store_webhook_event_add(struct store *store, struct webhook_event *event, struct error *err)
{
    uint64_t id = 0;
    int made;
    status s = changes_await(store, err); /* it may be new itself */

    if (s != STATUS_OK)
        return s;
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
    return sql_write(store, "DELETE FROM webhook_events WHERE id=?", SQL_VALUES(sql_number((int64_t)id)),
                     "what a webhook was sent cannot be removed", NULL, err);
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
                                 status (*visit)(void *user, const struct webhook_event *event, struct error *err),
                                 void *user, struct error *err)
{
    struct visit_events v = {visit, user};

    return read_rows(store, "SELECT id, webhook, at, body FROM webhook_events WHERE id NOT IN"
                     " (SELECT key FROM temp.bad WHERE tab='webhook_events') ORDER BY id",
                     "what webhooks are to be sent cannot be read", read_event, &v, err);
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
