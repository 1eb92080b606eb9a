/* The store as a whole: its folder, its lock, the lease epoch. */
#include "coordinator/store/store.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/system/file.h"
#include "common/system/log.h"
#include "common/base/memory.h"
#include "common/system/trash.h"
#include "coordinator/store/files/reserve.h"
#include "coordinator/store/store_backup.h"
#include "coordinator/store/store_parts.h"

/* The space that must be free beside the reserve for the store to be usable. */
enum { PROBE_BYTES = 64 << 10 };

/* Epochs that one run may grant. At a million leases a second they last 12 days; the wall clock's part grows faster. */
#define EPOCHS_A_RUN ((uint64_t)1 << 40)

/* Warn about a store that other users can read. The permissions are not changed: they may be
 * intended, for example by a volume's group. */
static void warn_of_rights(const char *folder)
{
    static const char *const inside[] = {"queue.sqlite", "blobs", "films", "outputs"};
    struct stat info;

    if (stat(folder, &info) != 0 || !(info.st_mode & 077))
        return;
    for (size_t i = 0; i < sizeof inside / sizeof inside[0]; i++) {
        char *path = file_join(folder, inside[i]);
        int open_to_others = path && stat(path, &info) == 0 && (info.st_mode & 077);
        mem_free(path);
        if (!open_to_others)
            continue;
        log_warn("%s: other users may read scenes and pictures in it; unless that is intended, run "
                 "chmod -R go= %s",
                 folder, folder);
        return;
    }
}

/* Before the lock, which it is a part of. A store that cannot be written has it, or is refused elsewhere. */
static void make_blobs(const char *folder)
{
    char *path = file_join(folder, "blobs");

    if (path && mkdir(path, 0700) != 0 && errno != EEXIST)
        log_debug("%s: cannot be made: %s", path, strerror(errno));
    mem_free(path);
}

status store_open(struct store **out, const char *folder, struct error *err)
{
    struct store *store = mem_calloc(1, sizeof *store);
    struct error why = {0};
    status s;

    *out = NULL;
    NEED(store, err, "the store");
    store->folder_lock = STORE_UNLOCKED;
    saves_init(store);
    store->folder = mem_strdup(folder);
    store->damage = damage_new();
    s = store->folder && store->damage ? file_make_private_folder(folder, err) : error_no_memory(err, "the store");
    if (s == STATUS_OK)
        make_blobs(folder);
    THEN(s, store_lock(&store->folder_lock, folder, err));
    if (s == STATUS_OK && store_restoring(folder))
        s = error_set(err, STATUS_ERR_CORRUPT, "%s: a restore of it was not finished: run it again", folder);
    THEN(s, database_open(store, err));
    THEN(s, events_begin(store, err));
    THEN(s, saves_start(store, err));
    THEN(s, trash_open(&store->trash, folder, err));
    if (s != STATUS_OK) {
        store_close(store);
        return s;
    }
    warn_of_rights(folder);
    if (store_check(store, &why) != STATUS_OK)
        atomic_store(&store->suspect, 1); /* the farm checks again, and reports it */
    *out = store;
    return STATUS_OK;
}

void store_close(struct store *store)
{
    if (!store)
        return;
    saves_stop(store); /* it removes films, too */
    trash_close(store->trash);
    sqlite3_close(store->reader);
    database_close(store);
    damage_free(store->damage);
    store_unlock(&store->folder_lock);
    mem_free(store->folder);
    mem_free(store);
}

const char *store_folder(const struct store *store) { return store->folder; }

int store_suspect(const struct store *store) { return atomic_load(&store->suspect); }

/* Write a small file, to check for space beside the reserve, a descriptor, and permission. */
static status write_probe(const struct store *store, struct error *err)
{
    static const uint8_t bytes[PROBE_BYTES];
    char *path = file_join(store->folder, "probe");
    int fd = path ? open(path, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600) : -1;
    status s = STATUS_OK;
    ssize_t put = fd >= 0 ? write(fd, bytes, sizeof bytes) : 0;

    NEED(path, err, "the store");
    if (fd >= 0 && put >= 0 && put < (ssize_t)sizeof bytes)
        errno = ENOSPC;
    if (put < (ssize_t)sizeof bytes)
        s = error_set(err, STATUS_ERR_IO, "%s: cannot be written: %s", path, strerror(errno));
    if (fd >= 0) {
        close(fd);
        unlink(path);
    }
    mem_free(path);
    return s;
}

status store_check(struct store *store, struct error *err)
{
    status s;

    atomic_store(&store->suspect, 0);
    s = store_make_folder(store, "blobs/tmp", err);
    THEN(s, store_make_folder(store, "films", err));
    THEN(s, store_make_folder(store, "outputs", err));
    THEN(s, store_make_folder(store, "trash", err));
    if (s == STATUS_OK && store->read_only)
        s = database_reopen(store, err);
    THEN(s, epoch_store(store, err));
    THEN(s, reserve_hold(store->folder, err));
    THEN(s, write_probe(store, err));
    saves_retry(store);
    trash_wake();
    return s == STATUS_OK ? saves_state(store, err) : s;
}

status epoch_store(struct store *store, struct error *err)
{
    status s;

    if (store->epoch_limit == 0)
        return STATUS_OK;
    pthread_mutex_lock(&store->order);
    s = sql_change_reserved(store, "INSERT OR REPLACE INTO meta (name, value) VALUES ('epoch_limit', ?)",
                            SQL_VALUES(sql_number(store->epoch_limit)), "the lease epoch cannot be stored", err);
    pthread_mutex_unlock(&store->order);
    if (s == STATUS_OK)
        store->epoch_limit = 0;
    return s;
}

int store_epoch_stored(const struct store *store) { return store->epoch_limit == 0; }

status store_epoch_begin(struct store *store, int64_t wall_s, uint64_t *epoch, struct error *err)
{
    struct error why = {0};
    struct sql_rows rows = sql_select(store, 
                                      "SELECT max(m.value, b.least) FROM (SELECT coalesce(max(epoch_floor), 0) AS least FROM jobs"
                                      " WHERE id NOT IN (SELECT key FROM temp.bad WHERE tab='jobs')) AS b, (SELECT"
                                      " coalesce(max(value), 0) AS value FROM meta WHERE name='epoch_limit' AND name NOT IN"
                                      " (SELECT key FROM temp.bad WHERE tab='meta')) AS m", NULL, 0,
                                      "the lease epoch cannot be read", err);

    *epoch = wall_s > 0 ? (uint64_t)wall_s << 24 : 1;
    if (sql_next(&rows) && column_number(rows.row, 0) > *epoch)
        *epoch = column_number(rows.row, 0);
    TRY(sql_end(&rows));
    store->epoch_limit = *epoch + EPOCHS_A_RUN;
    if (epoch_store(store, &why) != STATUS_OK)
        log_debug("%s", why.text); /* the store is suspect now: the farm checks it and reports the
                                      cause */
    return STATUS_OK;
}
