#include "coordinator/store/store_keys.h"

#include "coordinator/store/store_parts.h"

status store_key_put(struct store *store, const struct key_row *row, struct error *err)
{
    return sql_write(store,
                     "INSERT INTO keys (name, oldest, generation, oldest_until, roles, revoked, used_at, changed_at, changed_by,"
                     " changes) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?) ON CONFLICT (name) DO UPDATE SET oldest=excluded.oldest,"
                     " generation=excluded.generation, oldest_until=excluded.oldest_until, roles=excluded.roles,"
                     " revoked=excluded.revoked, used_at=excluded.used_at, changed_at=excluded.changed_at,"
                     " changed_by=excluded.changed_by, changes=excluded.changes WHERE excluded.changes > keys.changes",
                     SQL_VALUES(sql_text(row->name), sql_number(row->oldest), sql_number(row->generation),
                                sql_number(row->oldest_until), sql_number(row->roles), sql_number(row->revoked),
                                sql_number(row->used_at), sql_number(row->changed_at), sql_text(row->changed_by), sql_number((int64_t)row->changes)),
                     "the keys of a name cannot be stored", NULL, err);
}

static status count_damaged(struct store *store, uint32_t *damaged, struct error *err)
{
    struct sql_rows rows = sql_select(store, "SELECT count(*) FROM temp.bad WHERE tab='keys'", NULL, 0,
                                      "the keys of names cannot be read", err);

    if (sql_next(&rows))
        *damaged = (uint32_t)column_number(rows.row, 0);
    return sql_end(&rows);
}

status store_keys_load(struct store *store, status (*visit)(void *user, const struct key_row *row, struct error *err),
                       void *user, uint32_t *damaged, struct error *err)
{
    struct sql_rows rows;

    *damaged = 0;
    TRY(count_damaged(store, damaged, err));
    rows = sql_select(store,
                      "SELECT name, oldest, generation, oldest_until, roles, revoked, used_at, changed_at, changed_by, changes FROM keys"
                      " WHERE name NOT IN (SELECT key FROM temp.bad WHERE tab='keys') ORDER BY name",
                      NULL, 0, "the keys of names cannot be read", err);
    while (sql_next(&rows)) {
        struct key_row row = {.oldest = (uint32_t)column_number(rows.row, 1),
                              .generation = (uint32_t)column_number(rows.row, 2),
                              .oldest_until = sqlite3_column_int64(rows.row, 3),
                              .roles = (uint32_t)column_number(rows.row, 4),
                              .revoked = sqlite3_column_int(rows.row, 5) != 0,
                              .used_at = sqlite3_column_int64(rows.row, 6),
                              .changed_at = sqlite3_column_int64(rows.row, 7),
                              .changes = column_number(rows.row, 9)};
        column_text(rows.row, 0, row.name, sizeof row.name);
        column_text(rows.row, 8, row.changed_by, sizeof row.changed_by);
        rows.result = visit(user, &row, err);
    }
    return sql_end(&rows);
}
