/* Jobs are removed: rows first, in one transaction, which notes that the files are still to go; then these. */
#include <inttypes.h>

#include "common/system/log.h"
#include "common/base/memory.h"
#include "coordinator/store/store_hold.h"
#include "coordinator/store/store_parts.h"

status store_job_remove(struct store *store, uint64_t id, struct error *err)
{
    static const char *const changes[] = {
        "DELETE FROM frames WHERE job=?", "DELETE FROM cut_frames WHERE job=?",
        "DELETE FROM clocks WHERE job=?", "DELETE FROM history WHERE job=?",
        "DELETE FROM events WHERE job=?", "DELETE FROM jobs WHERE id=?",
        "INSERT INTO removed (job) VALUES (?)"};
    struct noted_list list = {0};
    status s = STATUS_OK;

    for (size_t i = 0; i < sizeof changes / sizeof *changes && s == STATUS_OK; i++)
        s = changes_add(&list, changes[i], SQL_VALUES(sql_number((int64_t)id)), "a job cannot be removed", err);
    if (s == STATUS_OK) {
        /* Other jobs may wait for this one no longer (waiting.c): their rows are in the same transaction, or before it. */
        saves_forget(store, id);
        changes_note(store, &list);
    }
    noted_drop(&list);
    return s;
}

/* ---- its files, when that is on disk ---------------------------------------------------------- */

struct noted_clear {
    struct noted link;
    uint64_t id;
};

static void clear(struct store *store, uint64_t id)
{
    struct error err = {0};

    store_films_remove(store, id);
    if (store_outputs_remove(store, id) &&
        sql_change(store, "DELETE FROM removed WHERE job=?", SQL_VALUES(sql_number((int64_t)id)),
                   "a removed job cannot be forgotten", &err) != STATUS_OK)
        log_warn("%s", err.text);
}

void clears_run(struct store *store)
{
    for (const struct noted *n = store->clears.taken; n; n = n->next) {
        uint64_t id = ((const struct noted_clear *)n)->id;
        struct error err = {0};
        int hold;

        if (store_hold_exclude(store->folder, &hold, &err) != STATUS_OK) {
            log_info("job %" PRIu64 ": its files are removed later: %s", id, err.text);
            atomic_store(&store->clear_held, 1);
        } else {
            clear(store, id);
        }
        store_hold_end(hold);
    }
    noted_settle(&store->clears, 1); /* only the writer thread has those taken */
}

void store_job_clear(struct store *store, uint64_t id)
{
    struct noted_clear *clear = mem_calloc(1, sizeof *clear);

    if (!clear) {
        log_warn("job %" PRIu64 ": out of memory; its files are removed at the next start", id);
        return;
    }
    clear->id = id;
    pthread_mutex_lock(&store->lock);
    noted_add(&store->clears, clear, SIZE_MAX);
    pthread_cond_signal(&store->work);
    pthread_mutex_unlock(&store->lock);
}

void store_clear_removed(struct store *store)
{
    uint64_t id = 0;
    int found = 1;

    while (found) {
        struct error err = {0};
        struct sql_rows rows = sql_read(store, "SELECT job FROM removed WHERE job>? ORDER BY job LIMIT 1",
                                        SQL_VALUES(sql_number((int64_t)id)), "the removed jobs cannot be read", &err);

        found = sql_next(&rows);
        id = found ? column_number(rows.row, 0) : 0;
        if (sql_end(&rows) != STATUS_OK)
            log_warn("%s", err.text);
        if (found)
            store_job_clear(store, id);
    }
}

void store_clear_held(struct store *store)
{
    if (atomic_exchange(&store->clear_held, 0))
        store_clear_removed(store);
}
