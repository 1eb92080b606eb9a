/* What owners of jobs used recently (order.h). A share is noted in memory and written soon by the store's
 * own thread. */
#include <string.h>

#include "common/base/memory.h"
#include "coordinator/store/store_parts.h"

struct saved_share {
    struct saved_share *next;
    struct owner_share share;
};

status store_share_save_later(struct store *store, const struct owner_share *share, struct error *err)
{
    struct saved_share *saved;

    pthread_mutex_lock(&store->lock);
    for (saved = store->shares; saved && strcmp(saved->share.owner, share->owner) != 0; saved = saved->next)
        ;
    if (!saved) {
        saved = mem_calloc(1, sizeof *saved);
        if (saved) {
            saved->next = store->shares;
            store->shares = saved;
        }
    }
    if (saved)
        saved->share = *share;
    pthread_cond_signal(&store->work);
    pthread_mutex_unlock(&store->lock);
    return saved ? STATUS_OK : error_no_memory(err, "an owner's share");
}

/* Put back what could not be written, unless a newer one came. */
static void put_back(struct store *store, struct saved_share *saved)
{
    struct saved_share *newer;

    for (newer = store->shares; newer && strcmp(newer->share.owner, saved->share.owner) != 0; newer = newer->next)
        ;
    if (!newer) {
        saved->next = store->shares;
        store->shares = saved;
        saved = NULL;
    }
    mem_free(saved);
}

void shares_take(struct store *store)
{
    store->shares_taken = store->shares;
    store->shares = NULL;
}

status shares_write(struct store *store, struct error *err)
{
    status s = STATUS_OK;

    for (const struct saved_share *saved = store->shares_taken; saved && s == STATUS_OK; saved = saved->next)
        s = sql_change(store, "INSERT OR REPLACE INTO shares (owner, core_s, at) VALUES (?, ?, ?)",
                       SQL_VALUES(sql_text(saved->share.owner), sql_real(saved->share.core_s),
                                  sql_number(saved->share.at_s)),
                       "an owner's share cannot be stored", err);
    return s;
}

void shares_settle(struct store *store, int written)
{
    while (store->shares_taken) {
        struct saved_share *saved = store->shares_taken;

        store->shares_taken = saved->next;
        if (written)
            mem_free(saved);
        else
            put_back(store, saved);
    }
}

void shares_drop(struct store *store)
{
    while (store->shares) {
        struct saved_share *next = store->shares->next;
        mem_free(store->shares);
        store->shares = next;
    }
}

status store_shares_load(struct store *store, struct order *order, struct error *err)
{
    struct sql_rows rows =
        sql_select(store, "SELECT owner, core_s, at FROM shares", NULL, 0, "the owners' shares cannot be read", err);

    while (sql_next(&rows)) {
        struct owner_share row = {.core_s = sqlite3_column_double(rows.row, 1),
                                  .at_s = sqlite3_column_int64(rows.row, 2)};
        struct owner_share *share;
        column_text(rows.row, 0, row.owner, sizeof row.owner);
        share = order_share(order, row.owner);
        if (!share)
            rows.result = error_no_memory(err, "an owner's share");
        else
            *share = row;
    }
    return sql_end(&rows);
}
