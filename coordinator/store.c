/* The store as a whole: its folder, who holds it, the lease epoch. */
#include "coordinator/store.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <unistd.h>

#include "common/base/file.h"
#include "common/base/log.h"
#include "common/base/memory.h"
#include "coordinator/store_parts.h"

/* Epochs that one run may grant. At a million leases a second they last 12 days; the wall clock's
 * part outgrows them. */
#define EPOCHS_A_RUN ((uint64_t)1 << 40)

static status take_lock(struct store *store, struct error *err)
{
    char *path = file_join(store->folder, "lock");
    char text[32];
    status s = STATUS_OK;
    ssize_t got;

    if (!path)
        return error_no_memory(err, "the store");
    store->lock_fd = open(path, O_RDWR | O_CREAT | O_CLOEXEC, 0666);
    if (store->lock_fd < 0) {
        s = error_set(err, STATUS_ERR_IO,
                      "%s: cannot be opened: %s (choose a --store that can be written to)", path,
                      strerror(errno));
    } else if (flock(store->lock_fd, LOCK_EX | LOCK_NB) != 0) {
        got = read(store->lock_fd, text, sizeof text - 1);
        text[got > 0 ? got : 0] = 0;
        s = error_set(err, STATUS_ERR_REFUSED,
                      "%s: another coordinator (process %d) uses this store; end it, or choose "
                      "another --store",
                      store->folder, atoi(text));
    } else {
        int length = snprintf(text, sizeof text, "%d\n", (int)getpid());
        if (ftruncate(store->lock_fd, 0) != 0 || write(store->lock_fd, text, (size_t)length) < 0)
            log_debug("%s: the process number could not be noted", path);
    }
    mem_free(path);
    return s;
}

static status make_folder(const struct store *store, const char *name, struct error *err)
{
    char *path = file_join(store->folder, name);
    status s = path ? file_make_folder(path, err) : error_no_memory(err, "the store");

    mem_free(path);
    return s;
}

status store_open(struct store **out, const char *folder, struct error *err)
{
    struct store *store = mem_calloc(1, sizeof *store);
    status s;

    *out = NULL;
    if (!store)
        return error_no_memory(err, "the store");
    store->lock_fd = -1;
    saves_init(store);
    store->folder = mem_strdup(folder);
    s = store->folder ? file_make_folder(folder, err) : error_no_memory(err, "the store");
    if (s == STATUS_OK)
        s = take_lock(store, err);
    if (s == STATUS_OK)
        s = make_folder(store, "blobs/tmp", err);
    if (s == STATUS_OK)
        s = make_folder(store, "films", err);
    if (s == STATUS_OK)
        s = make_folder(store, "outputs", err);
    if (s == STATUS_OK)
        s = database_open(store, err);
    if (s == STATUS_OK)
        s = saves_start(store, err);
    if (s != STATUS_OK) {
        store_close(store);
        return s;
    }
    *out = store;
    return STATUS_OK;
}

void store_close(struct store *store)
{
    if (!store)
        return;
    saves_stop(store);
    sqlite3_close(store->db);
    if (store->lock_fd >= 0)
        close(store->lock_fd);
    mem_free(store->folder);
    mem_free(store);
}

const char *store_folder(const struct store *store)
{
    return store->folder;
}

status store_epoch_begin(struct store *store, int64_t wall_s, uint64_t *epoch, struct error *err)
{
    sqlite3_stmt *statement = NULL;
    uint64_t wall = wall_s > 0 ? (uint64_t)wall_s << 24 : 1;
    status s = sql_prepare(store, "SELECT value FROM meta WHERE name='epoch_limit'", &statement,
                           err);

    if (s != STATUS_OK)
        return s;
    *epoch = wall;
    if (sqlite3_step(statement) == SQLITE_ROW && column_number(statement, 0) > wall)
        *epoch = column_number(statement, 0);
    sqlite3_finalize(statement);
    s = sql_prepare(store, "INSERT OR REPLACE INTO meta (name, value) VALUES ('epoch_limit', ?)",
                    &statement, err);
    if (s != STATUS_OK)
        return s;
    bind_number(statement, 1, *epoch + EPOCHS_A_RUN);
    return sql_run(store, statement, "the lease epoch cannot be stored", err);
}
