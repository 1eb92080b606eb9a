#include "common/system/trash.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <pthread.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "common/base/buffer.h"
#include "common/system/file.h"
#include "common/system/log.h"
#include "common/base/memory.h"

enum {
    DEPTH_MAX = 8,             /* of folders in the trash */
    DESCRIPTORS_MAX = 256,     /* that wait to be closed; more are closed at once */
    SMALL_BYTES = 1 << 20,     /* freed in no time */
    REMOVAL_LOOK_NS = 20000000, /* how often to look whether a removal has ended */
};

struct trash {
    char *path;
    pthread_t thread;
    int ending;
};

/* One for the process: who removes a file knows its path, and needs no handle for that. A notice wakes the threads of
 * all folders, which is one in a coordinator. */
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static pthread_cond_t changed = PTHREAD_COND_INITIALIZER;
static unsigned open_count;
static uint64_t taken, notices;
static int descriptors[DESCRIPTORS_MAX];
static size_t descriptor_count;

/* ---- the thread ------------------------------------------------------------------------------ */

static int is_ending(const struct trash *trash)
{
    int ends;

    pthread_mutex_lock(&lock);
    ends = trash->ending;
    pthread_mutex_unlock(&lock);
    return ends;
}

/* Has this process the file open? Its room would be freed where that descriptor is closed, here. */
static int is_open_here(const struct stat *file)
{
    DIR *folder = opendir("/proc/self/fd");
    const struct dirent *entry;
    struct stat info;
    int found = 0;

    while (folder && !found && (entry = readdir(folder)))
        found = entry->d_name[0] != '.' && fstatat(dirfd(folder), entry->d_name, &info, 0) == 0 &&
                info.st_dev == file->st_dev && info.st_ino == file->st_ino;
    if (folder)
        closedir(folder);
    return found;
}

/* Another process removes the file, and goes on if the trash is closed meanwhile: a process cannot end while the
 * kernel frees room for it. An errno; EBUSY: not before it is closed here, which is a notice. */
static int remove_large(const struct trash *trash, int folder, const char *name, const struct stat *info)
{
    pid_t pid = is_open_here(info) ? -1 : file_remove_apart(folder, name);

    if (pid < 0)
        return EBUSY;
    if (pid == 0)
        return unlinkat(folder, name, 0) == 0 ? 0 : errno;
    pthread_mutex_lock(&lock);
    while (!trash->ending && waitpid(pid, NULL, WNOHANG) == 0) {
        struct timespec until;
        clock_gettime(CLOCK_REALTIME, &until);
        until.tv_nsec += REMOVAL_LOOK_NS;
        until.tv_sec += until.tv_nsec / 1000000000;
        until.tv_nsec %= 1000000000;
        pthread_cond_timedwait(&changed, &lock, &until);
    }
    pthread_mutex_unlock(&lock);
    return 0;
}

/* Remove what is in the folder until the trash is closed; the first errno. Takes fd. */
static int empty(const struct trash *trash, int fd, int depth)
{
    DIR *folder = fd >= 0 ? fdopendir(fd) : NULL;
    const struct dirent *entry;
    int code = folder || errno == ENOENT ? 0 : errno;

    if (!folder && fd >= 0)
        close(fd);
    while (folder && (entry = readdir(folder)) && !is_ending(trash)) {
        struct stat info;
        int failed;
        if (strcmp(entry->d_name, ".") == 0 || strcmp(entry->d_name, "..") == 0)
            continue;
        if (fstatat(dirfd(folder), entry->d_name, &info, AT_SYMLINK_NOFOLLOW) == 0 && file_is_large(&info))
            failed = remove_large(trash, dirfd(folder), entry->d_name, &info);
        else
            failed = unlinkat(dirfd(folder), entry->d_name, 0) == 0 ? 0 : errno;
        if ((failed == EISDIR || failed == EPERM) && depth < DEPTH_MAX) {
            failed = empty(trash, openat(dirfd(folder), entry->d_name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC),
                           depth + 1);
            if (!failed && unlinkat(dirfd(folder), entry->d_name, AT_REMOVEDIR) != 0 && !is_ending(trash))
                failed = errno;
        }
        code = code || failed == ENOENT ? code : failed;
    }
    if (folder)
        closedir(folder);
    return code;
}

static void close_descriptors(void)
{
    int taken_out[DESCRIPTORS_MAX];
    size_t count;

    pthread_mutex_lock(&lock);
    count = descriptor_count;
    memcpy(taken_out, descriptors, count * sizeof *descriptors);
    descriptor_count = 0;
    pthread_mutex_unlock(&lock);
    for (size_t i = 0; i < count; i++)
        close(taken_out[i]);
}

/* Wait for a notice after the one that was seen last. 0: the trash is closed. */
static int await_notice(const struct trash *trash, uint64_t *seen)
{
    int goes_on;

    pthread_mutex_lock(&lock);
    while (!trash->ending && *seen == notices)
        pthread_cond_wait(&changed, &lock);
    *seen = notices;
    goes_on = !trash->ending;
    pthread_mutex_unlock(&lock);
    return goes_on;
}

static void *run(void *user)
{
    const struct trash *trash = user;
    uint64_t seen = UINT64_MAX; /* no notice has this number: what a kill left goes now */
    int logged = 0;

    while (await_notice(trash, &seen)) {
        int code;

        close_descriptors();
        code = empty(trash, open(trash->path, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC), 0);
        if (code && code != EBUSY && code != logged)
            log_warn("%s: cannot be emptied: %s", trash->path, strerror(code));
        logged = code;
    }
    close_descriptors();
    return NULL;
}

status trash_open(struct trash **out, const char *folder, struct error *err)
{
    struct trash *trash = mem_calloc(1, sizeof *trash);

    *out = NULL;
    if (trash)
        trash->path = file_join(folder, "trash");
    if (!trash || !trash->path || pthread_create(&trash->thread, NULL, run, trash) != 0) {
        mem_free(trash ? trash->path : NULL);
        mem_free(trash);
        return error_set(err, STATUS_ERR_NO_MEMORY, "%s: no thread for what is removed", folder);
    }
    pthread_mutex_lock(&lock);
    open_count++;
    pthread_mutex_unlock(&lock);
    *out = trash;
    return STATUS_OK;
}

void trash_close(struct trash *trash)
{
    if (!trash)
        return;
    pthread_mutex_lock(&lock);
    open_count--;
    trash->ending = 1;
    pthread_cond_broadcast(&changed);
    pthread_mutex_unlock(&lock);
    pthread_join(trash->thread, NULL);
    mem_free(trash->path);
    mem_free(trash);
}

/* ---- what goes ------------------------------------------------------------------------------- */

void trash_wake(void)
{
    pthread_mutex_lock(&lock);
    notices++;
    pthread_cond_broadcast(&changed);
    pthread_mutex_unlock(&lock);
}

/* A name that nothing else has in this trash: what an earlier run left may still be there. */
static status name_next(const char *folder, struct buffer *name)
{
    struct timespec now;
    uint64_t number;
    unsigned emptied;

    clock_gettime(CLOCK_REALTIME, &now);
    pthread_mutex_lock(&lock);
    emptied = open_count;
    number = ++taken;
    pthread_mutex_unlock(&lock);
    buffer_printf(name, "%s/trash/%" PRId64 ".%09ld-%" PRIu64, folder, (int64_t)now.tv_sec, now.tv_nsec, number);
    errno = !emptied ? ENOTSUP : ENOMEM;
    return emptied && buffer_ok(name) ? STATUS_OK : STATUS_ERR_IO;
}

int trash_take(const char *folder, const char *path)
{
    struct buffer name = BUFFER_INIT;
    int done = name_next(folder, &name) == STATUS_OK && rename(path, buffer_text(&name)) == 0;
    int code = errno;

    buffer_release(&name);
    if (done)
        trash_wake();
    errno = code;
    return done;
}

int trash_unlink(const char *folder, const char *path)
{
    return trash_take(folder, path) || unlink(path) == 0 ? 0 : -1;
}

void trash_close_file(int fd)
{
    struct stat info;
    int queued = 0;

    if (fstat(fd, &info) == 0 && info.st_size > SMALL_BYTES) {
        pthread_mutex_lock(&lock);
        queued = open_count > 0 && descriptor_count < DESCRIPTORS_MAX;
        if (queued) {
            descriptors[descriptor_count++] = fd;
            notices++;
            pthread_cond_broadcast(&changed);
        }
        pthread_mutex_unlock(&lock);
    }
    if (!queued)
        close(fd);
}
