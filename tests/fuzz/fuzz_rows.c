/* Rows of queue.sqlite with any values, whose digests are right: a coordinator starts and goes on, or says why not; no crash.
 * The input is changes: table, row, column and kind of the value, a byte each, the value's size (2 bytes), the value. */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "common/base/buffer.h"
#include "common/base/memory.h"
#include "common/system/clock.h"
#include "common/system/file.h"
#include "common/system/log.h"
#include "coordinator/store/store_keys.h"
#include "coordinator/store/store_parts.h"
#include "coordinator/store/store_web.h"
#include "tests/support/sim_states.h"

enum { HEAD = 6, TABLES_MAX = 64, COLUMNS_MAX = 64, NAME_SIZE = 64 };

int LLVMFuzzerInitialize(int *argc, char ***argv);
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static struct sim_stored *farm; /* its folder's database is another for each input */
static struct buffer before;   /* the database of a farm with a job in each state */
static char database[SCRATCH_PATH + 32], log_file[SCRATCH_PATH + 40], index_file[SCRATCH_PATH + 40], tables[TABLES_MAX][NAME_SIZE];
static size_t table_count;

/* ---- what is changed ------------------------------------------------------------------------- */

static size_t names(sqlite3 *db, const char *question, int column, char out[][NAME_SIZE], size_t most)
{
    sqlite3_stmt *asked = NULL;
    size_t count = 0;

    if (sqlite3_prepare_v2(db, question, -1, &asked, NULL) != SQLITE_OK)
        abort();
    while (count < most && sqlite3_step(asked) == SQLITE_ROW)
        snprintf(out[count++], NAME_SIZE, "%s", (const char *)sqlite3_column_text(asked, column));
    sqlite3_finalize(asked);
    return count;
}

static void bind(sqlite3_stmt *change, int kind, const uint8_t *value, size_t size)
{
    int64_t number = 0;
    double real = 0;

    memcpy(&number, value, size < sizeof number ? size : sizeof number);
    memcpy(&real, value, size < sizeof real ? size : sizeof real);
    switch (kind % 5) {
    case 0: sqlite3_bind_int64(change, 1, number); break;
    case 1: sqlite3_bind_double(change, 1, real); break;
    case 2: sqlite3_bind_text(change, 1, (const char *)value, (int)size, SQLITE_TRANSIENT); break;
    case 3: sqlite3_bind_blob(change, 1, size ? (const void *)value : "", (int)size, SQLITE_TRANSIENT); break;
    default: sqlite3_bind_null(change, 1);
    }
}

/* The value takes the place of a column's, or with the kind's high bit of a part of it, so that what is parsed of it is reached. */
static void change_row(sqlite3 *db, const uint8_t *head, const uint8_t *value, size_t size)
{
    const char *table = tables[head[0] % table_count], *column;
    const unsigned at = head[3] & 127u;
    char columns[COLUMNS_MAX][NAME_SIZE], sql[512], new[192] = "?1";
    sqlite3_stmt *change = NULL;

    snprintf(sql, sizeof sql, "PRAGMA table_info(%s)", table);
    column = columns[head[2] % names(db, sql, 1, columns, COLUMNS_MAX)];
    if (head[3] & 128)
        snprintf(new, sizeof new, "CAST(substr(%s,1,%u)||?1||substr(%s,%u) AS BLOB)", column, at, column,
                 at + 1 + (unsigned)size);
    snprintf(sql, sizeof sql, "UPDATE %s SET %s=%s WHERE %s IS (SELECT %s FROM %s LIMIT 1 OFFSET %u)", table, column,
             new, column, column, table, head[1] % 8u);
    if (sqlite3_prepare_v2(db, sql, -1, &change, NULL) != SQLITE_OK)
        abort();
    bind(change, head[3] & 128 ? 3 : head[3] & 127, value, size);
    (void)sqlite3_step(change); /* the schema may refuse it */
    sqlite3_finalize(change);
}

/* ---- the start ------------------------------------------------------------------------------- */

static status any_token(void *user, const struct token_row *token, struct error *err)
{
    (void)user;
    (void)token;
    (void)err;
    return STATUS_OK;
}

static status any_key(void *user, const struct key_row *row, struct error *err)
{
    (void)user;
    (void)row;
    (void)err;
    return STATUS_OK;
}

/* As the coordinator starts; then some seconds. */
static void start(void)
{
    const struct farm_events nobody = {0};
    struct farm probe;
    struct error err = {0};
    uint32_t damaged;
    status s;

    if (store_open(&farm->store, farm->folder, &err) != STATUS_OK) {
        if (!err.text[0])
            abort(); /* every refusal says why */
        return;
    }
    s = farm_init(&probe, farm->store, 10 * NS_PER_SECOND, &nobody, 1000, &err);
    if (s == STATUS_OK) {
        farm_release(&probe, 5 * NS_PER_SECOND);
        sim_init(farm->sim, farm->store, 1);
        for (int i = 0; i < 3; i++)
            sim_stored_tick(farm);
        sim_release(farm->sim);
        s = store_tokens_load(farm->store, any_token, NULL, &err);
        if (s == STATUS_OK)
            s = store_keys_load(farm->store, any_key, NULL, &damaged, &err);
    }
    if (s != STATUS_OK && !err.text[0])
        abort();
    store_close(farm->store);
}

static void end(void) { file_remove_tree(farm->folder); }

int LLVMFuzzerInitialize(int *argc, char ***argv)
{
    static const enum job_state states[] = {JOB_STATE_DONE,   JOB_STATE_CANCELLED, JOB_STATE_FAILED,
                                            JOB_STATE_PAUSED, JOB_STATE_PARKED,    JOB_STATE_QUEUED};
    void *made;

    (void)argc;
    (void)argv;
    file_forgo_syncs();
    log_setup("fuzz_rows", LOG_LEVEL_ERROR);
    sim_stored_set_up(&made);
    farm = made;
    (void)atexit(end);
    for (size_t i = 0; i < sizeof states / sizeof *states; i++)
        (void)sim_job_in(farm, states[i]);
    sim_release(farm->sim);
    table_count = names(farm->store->db, "SELECT name FROM sqlite_master WHERE type='table' AND name NOT LIKE 'sqlite%' AND name<>'sums'",
                        0, tables, TABLES_MAX);
    store_close(farm->store);
    snprintf(database, sizeof database, "%s/queue.sqlite", farm->folder);
    snprintf(log_file, sizeof log_file, "%s-wal", database);
    snprintf(index_file, sizeof index_file, "%s-shm", database);
    if (file_read(database, SIZE_MAX, &before, NULL) != STATUS_OK)
        abort();
    return 0;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct error err = {0};

    (void)unlink(log_file);
    (void)unlink(index_file);
    if (file_write_atomic(database, before.data, before.size, &err) != STATUS_OK ||
        store_open(&farm->store, farm->folder, &err) != STATUS_OK)
        abort();
    while (size >= HEAD) {
        const uint8_t *head = data;
        size_t length = (size_t)head[4] | (size_t)head[5] << 8;
        data += HEAD;
        size -= HEAD;
        length = length < size ? length : size;
        change_row(farm->store->db, head, data, length);
        data += length;
        size -= length;
    }
    store_close(farm->store);
    start();
    return 0;
}
