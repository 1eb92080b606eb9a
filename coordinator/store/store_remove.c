/* Jobs are removed: rows first, in one transaction, which notes that the files are still to go. */
#include <inttypes.h>

#include "common/base/log.h"
#include "coordinator/store/store_hold.h"
#include "coordinator/store/store_parts.h"

/* Run the statements, each with the job's number, in one transaction. *again: it failed for lack of space, and
 * now there is some. */
static status change_all(struct store *store, const char *const *changes, size_t count, uint64_t id, int *again,
                         struct error *err)
{
    status s = sql_exec(store, "BEGIN IMMEDIATE", "cannot be written", err);

    *again = s != STATUS_OK && sql_give_reserve(store);
    if (s != STATUS_OK)
        return s;
    for (size_t i = 0; i < count && s == STATUS_OK; i++)
        s = sql_change(store, changes[i], SQL_VALUES(sql_number((int64_t)id)),
                       "a job cannot be removed", err);
    if (s == STATUS_OK)
        s = sql_exec(store, "COMMIT", "a job cannot be removed", err);
    *again = s != STATUS_OK && sql_give_reserve(store);
    if (s != STATUS_OK)
        (void)sqlite3_exec(store->db, "ROLLBACK", NULL, NULL, NULL);
    return s;
}

status store_job_remove(struct store *store, uint64_t id, struct error *err)
{
    static const char *const changes[] = {
        "DELETE FROM frames WHERE job=?", "DELETE FROM cut_frames WHERE job=?",
        "DELETE FROM clocks WHERE job=?", "DELETE FROM history WHERE job=?",
        "DELETE FROM events WHERE job=?", "DELETE FROM jobs WHERE id=?",
        "INSERT INTO removed (job) VALUES (?)"};
    struct error ignored;
    int again;
    status s;

    saves_forget(store, id);
    /* Other jobs may wait for this one no longer (waiting.c): that must not be lost when it is gone. Where they cannot be
     * written, removing must work all the same: it makes room. */
    (void)!store_await_saves(store, &ignored);
    pthread_mutex_lock(&store->order);
    s = change_all(store, changes, sizeof changes / sizeof *changes, id, &again, err);
    if (again) /* removing makes room, so it must work on a full disk */
        s = change_all(store, changes, sizeof changes / sizeof *changes, id, &again, err);
    pthread_mutex_unlock(&store->order);
    return s;
}

static void clear(struct store *store, uint64_t id)
{
    struct error err = {0};
    status s = STATUS_OK;

    store_films_remove(store, id);
    if (!store_outputs_remove(store, id))
        return;
    pthread_mutex_lock(&store->order);
    s = sql_change(store, "DELETE FROM removed WHERE job=?", SQL_VALUES(sql_number((int64_t)id)),
                   "a removed job cannot be forgotten", &err);
    pthread_mutex_unlock(&store->order);
    if (s != STATUS_OK)
        log_warn("%s", err.text);
}

void store_job_clear(struct store *store, uint64_t id)
{
    struct error err = {0};
    int hold;

    if (store_hold_exclude(store->folder, &hold, &err) != STATUS_OK) {
        log_info("job %" PRIu64 ": its files are removed later: %s", id, err.text);
        store->clear_held = 1;
    } else {
        clear(store, id);
    }
    store_hold_end(hold);
}

void store_clear_removed(struct store *store)
{
    uint64_t id = 0;
    int found = 1;

    while (found) { /* one at a time: clearing changes the table */
        sqlite3_stmt *statement = NULL;
        struct error err = {0};

        if (sql_select(store, "SELECT job FROM removed WHERE job>? ORDER BY job LIMIT 1",
                       SQL_VALUES(sql_number((int64_t)id)), &statement, &err) != STATUS_OK) {
            log_warn("%s", err.text);
            return;
        }
        found = sqlite3_step(statement) == SQLITE_ROW;
        id = found ? column_number(statement, 0) : 0;
        sqlite3_finalize(statement);
        if (found)
            store_job_clear(store, id);
    }
}

void store_clear_held(struct store *store)
{
    if (!store->clear_held)
        return;
    store->clear_held = 0;
    store_clear_removed(store);
}
