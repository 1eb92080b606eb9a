/* The store as a whole: its folder, its lock, the lease epoch. */
#include "coordinator/store/store.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/base/file.h"
#include "common/base/log.h"
#include "common/base/memory.h"
#include "common/base/trash.h"
#include "coordinator/store/reserve.h"
#include "coordinator/store/store_backup.h"
#include "coordinator/store/store_parts.h"

/* The space that must be free beside the reserve for the store to be usable. */
enum { PROBE_BYTES = 64 << 10 };

/* Epochs that one run may grant. At a million leases a second they last 12 days; the wall clock's
 * part grows faster. */
#define EPOCHS_A_RUN ((uint64_t)1 << 40)

static status take_lock(struct store *store, struct error *err)
{
    char *path = file_join(store->folder, "lock");
    char text[32];
    status s = STATUS_OK;
    ssize_t got;

    if (!path)
        return error_no_memory(err, "the store");
    store->lock_fd = open(path, O_RDWR | O_CREAT | O_CLOEXEC, 0600);
    if (store->lock_fd < 0 && (errno == EROFS || errno == EACCES)) /* it can be locked all the same
                                                                      */
        store->lock_fd = open(path, O_RDONLY | O_CLOEXEC);
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

/* Is the folder still the one that was locked? Its disk may have been unmounted. */
static status same_folder(const struct store *store, struct error *err)
{
    char *path = file_join(store->folder, "lock");
    struct stat ours, found;
    status s = STATUS_OK;

    if (!path)
        return error_no_memory(err, "the store");
    if (stat(path, &found) != 0)
        s = error_set(err, STATUS_ERR_IO, "%s: cannot be found: %s; was the store moved or unmounted?",
                      path, strerror(errno));
    else if (fstat(store->lock_fd, &ours) != 0 || ours.st_ino != found.st_ino ||
             ours.st_dev != found.st_dev)
        s = error_set(err, STATUS_ERR_IO,
                      "%s: is another folder than at the start; was it moved or unmounted?",
                      store->folder);
    mem_free(path);
    return s;
}

status store_make_folder(const struct store *store, const char *name, struct error *err)
{
    char *path = file_join(store->folder, name);
    status s = path ? same_folder(store, err) : error_no_memory(err, "the store");

    if (s == STATUS_OK)
        s = file_make_private_folder(path, err);
    mem_free(path);
    return s;
}

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

status store_open(struct store **out, const char *folder, struct error *err)
{
    struct store *store = mem_calloc(1, sizeof *store);
    struct error why = {0};
    status s;

    *out = NULL;
    if (!store)
        return error_no_memory(err, "the store");
    store->lock_fd = -1;
    saves_init(store);
    store->folder = mem_strdup(folder);
    s = store->folder ? file_make_private_folder(folder, err) : error_no_memory(err, "the store");
    if (s == STATUS_OK)
        s = take_lock(store, err);
    if (s == STATUS_OK && store_restoring(folder))
        s = error_set(err, STATUS_ERR_CORRUPT, "%s: a restore of it was not finished: run it again", folder);
    if (s == STATUS_OK)
        s = database_open(store, err);
    if (s == STATUS_OK)
        s = events_begin(store, err);
    if (s == STATUS_OK)
        s = saves_start(store, err);
    if (s == STATUS_OK)
        s = trash_open(&store->trash, folder, err);
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

int store_suspect(const struct store *store)
{
    return atomic_load(&store->suspect);
}

/* Write a small file, to check for space beside the reserve, a descriptor, and permission. */
static status write_probe(const struct store *store, struct error *err)
{
    static const uint8_t bytes[PROBE_BYTES];
    char *path = file_join(store->folder, "probe");
    int fd = path ? open(path, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600) : -1;
    status s = STATUS_OK;
    ssize_t put = fd >= 0 ? write(fd, bytes, sizeof bytes) : 0;

    if (!path)
        return error_no_memory(err, "the store");
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
    if (s == STATUS_OK)
        s = store_make_folder(store, "films", err);
    if (s == STATUS_OK)
        s = store_make_folder(store, "outputs", err);
    if (s == STATUS_OK)
        s = store_make_folder(store, "trash", err);
    if (s == STATUS_OK && store->read_only)
        s = database_reopen(store, err);
    if (s == STATUS_OK)
        s = epoch_store(store, err);
    if (s == STATUS_OK)
        s = reserve_hold(store->folder, err);
    if (s == STATUS_OK)
        s = write_probe(store, err);
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
    s = sql_change_reserved(store,
                            "INSERT OR REPLACE INTO meta (name, value) VALUES ('epoch_limit', ?)",
                            SQL_VALUES(sql_number(store->epoch_limit)),
                            "the lease epoch cannot be stored", err);
    pthread_mutex_unlock(&store->order);
    if (s == STATUS_OK)
        store->epoch_limit = 0;
    return s;
}

int store_epoch_stored(const struct store *store)
{
    return store->epoch_limit == 0;
}

status store_epoch_begin(struct store *store, int64_t wall_s, uint64_t *epoch, struct error *err)
{
    sqlite3_stmt *statement = NULL;
    uint64_t wall = wall_s > 0 ? (uint64_t)wall_s << 24 : 1;
    struct error why = {0};
    int code;
    status s = sql_select(store, "SELECT value FROM meta WHERE name='epoch_limit'", NULL, 0,
                          &statement, err);

    if (s != STATUS_OK)
        return s;
    *epoch = wall;
    code = sqlite3_step(statement);
    if (code != SQLITE_ROW && code != SQLITE_DONE)
        s = sql_error(store, "the lease epoch cannot be read", err);
    else if (code == SQLITE_ROW && column_number(statement, 0) > wall)
        *epoch = column_number(statement, 0);
    sqlite3_finalize(statement);
    if (s != STATUS_OK)
        return s;
    store->epoch_limit = *epoch + EPOCHS_A_RUN;
    if (epoch_store(store, &why) != STATUS_OK)
        log_debug("%s", why.text); /* the store is suspect now: the farm checks it and reports the
                                      cause */
    return STATUS_OK;
}
