#include "coordinator/store/store_hold.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <unistd.h>

#include "common/system/file.h"
#include "common/system/log.h"
#include "common/base/memory.h"

static status open_lock(struct store_lock *lock, const char *path, const char *folder, struct error *err)
{
    char *blobs = file_join(folder, "blobs");

    NEED(blobs, err, "the store");
    lock->blobs = open(blobs, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    mem_free(blobs);
    lock->file = open(path, O_RDWR | O_CREAT | O_CLOEXEC, 0600);
    if (lock->file < 0 && (errno == EROFS || errno == EACCES)) /* it can be locked all the same */
        lock->file = open(path, O_RDONLY | O_CLOEXEC);
    if (lock->file < 0)
        return error_set(err, STATUS_ERR_IO, "%s: cannot be opened: %s (choose a --store that can be written to)", path,
                         strerror(errno));
    return STATUS_OK;
}

/* Not every file system can lock a folder: NFS cannot. */
static int is_taken(int fd) { return fd >= 0 && flock(fd, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK; }

static status refuse_second(const struct store_lock *lock, const char *folder, struct error *err)
{
    char text[32], process[48] = "";
    ssize_t got = read(lock->file, text, sizeof text - 1);

    text[got > 0 ? got : 0] = 0;
    if (atoi(text) > 0) /* else its file was deleted: this one is new */
        snprintf(process, sizeof process, " (process %d)", atoi(text));
    return error_set(err, STATUS_ERR_REFUSED,
                     "%s: another coordinator%s uses this store; end it, or choose another --store", folder, process);
}

status store_lock(struct store_lock *out, const char *folder, struct error *err)
{
    char *path = file_join(folder, "lock"), text[32];
    int length = snprintf(text, sizeof text, "%d\n", (int)getpid());
    status s;

    *out = STORE_UNLOCKED;
    NEED(path, err, "the store");
    s = open_lock(out, path, folder, err);
    /* A coordinator that was killed may leave a child between its fork and its exec, which holds it for a moment: 2 s at most. */
    for (int tries = 0; s == STATUS_OK && (flock(out->file, LOCK_EX | LOCK_NB) != 0 || is_taken(out->blobs)); tries++)
        s = tries < 100 ? (usleep(20000), STATUS_OK) : refuse_second(out, folder, err);
    if (s == STATUS_OK && (ftruncate(out->file, 0) != 0 || write(out->file, text, (size_t)length) < 0))
        log_debug("%s: the process number could not be noted", path);
    if (s != STATUS_OK)
        store_unlock(out);
    mem_free(path);
    return s;
}

void store_unlock(struct store_lock *lock)
{
    if (lock->file >= 0)
        close(lock->file);
    if (lock->blobs >= 0)
        close(lock->blobs);
    *lock = STORE_UNLOCKED;
}

static status hold(const char *folder, int how, int *out, struct error *err)
{
    char *path = file_join(folder, "hold"), *database = file_join(folder, "queue.sqlite");
    int code, there = database && file_exists(database);
    status s = STATUS_OK;

    *out = -1;
    mem_free(database);
    NEED(path, err, "a path");
    if (!there) { /* not made in a mount point whose disk is gone */
        mem_free(path);
        return error_set(err, STATUS_ERR_IO, "%s: is no store at present; was it moved or unmounted?", folder);
    }
    *out = open(path, O_RDWR | O_CREAT | O_CLOEXEC, 0600);
    do
        code = *out < 0 || flock(*out, how) == 0 ? 0 : errno;
    while (code == EINTR);
    if (*out < 0)
        s = error_set(err, STATUS_ERR_IO, "%s: cannot be opened: %s", path, strerror(errno));
    else if (code == EWOULDBLOCK)
        s = error_set(err, STATUS_ERR_REFUSED, "a backup is being made of the store: nothing is removed until it ends");
    else if (code != 0)
        s = error_set(err, STATUS_ERR_IO, "%s: cannot be locked: %s", path, strerror(code));
    mem_free(path);
    return s;
}

/* Those of this process who remove share one lock. */
static struct {
    pthread_mutex_t lock;
    int file, users; /* how many have it */
    char folder[PATH_MAX];
} exclusive = {.lock = PTHREAD_MUTEX_INITIALIZER};

status store_hold_exclude(const char *folder, int *out, struct error *err)
{
    status s = STATUS_OK;
    pthread_mutex_lock(&exclusive.lock);
    if (exclusive.users > 0 && strcmp(exclusive.folder, folder) == 0) {
        exclusive.users++;
        *out = exclusive.file;
    } else {
        s = hold(folder, LOCK_EX | LOCK_NB, out, err);
        if (s == STATUS_OK && exclusive.users == 0 && strlen(folder) < sizeof exclusive.folder) {
            strcpy(exclusive.folder, folder);
            exclusive.file = *out;
            exclusive.users = 1;
        }
    }
    pthread_mutex_unlock(&exclusive.lock);
    return s;
}

status store_hold_begin(const char *folder, int *out, struct error *err) { return hold(folder, LOCK_SH, out, err); }

void store_hold_end(int fd)
{
    if (fd < 0)
        return;
    pthread_mutex_lock(&exclusive.lock);
    if (exclusive.users == 0 || fd != exclusive.file || --exclusive.users == 0) {
        flock(fd, LOCK_UN); /* a program that is being started may still have a copy of the descriptor */
        close(fd);
    }
    pthread_mutex_unlock(&exclusive.lock);
}
