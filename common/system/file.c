#include "common/system/file.h"

#include <errno.h>
#include <fcntl.h>
#include <ftw.h>
#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "common/base/memory.h"

enum { TREE_DESCRIPTORS = 16, REMOVE_WAIT_MS = 200, FILE_LARGE_BYTES = 4 << 20 };

/* Is the failure the machine's, not the path's? */
static int errno_is_machine(int number)
{
    return number == EIO || number == EMFILE || number == ENFILE || number == ENOMEM || number == ESTALE;
}

static status read_failed(const char *name, const char *what, struct error *err)
{
    return error_set(err, errno_is_machine(errno) ? STATUS_ERR_IO : STATUS_ERR_INPUT, "%s: %s: %s", name, what,
                     strerror(errno));
}

status file_read_as(const char *path, const char *name, size_t limit_bytes, struct buffer *out, struct error *err)
{
    status result = STATUS_OK;
    struct stat info;
    size_t start = out->size;
    int fd = open(path, O_RDONLY | O_CLOEXEC);

    if (fd < 0)
        return read_failed(name, "cannot be opened", err);
    if (fstat(fd, &info) != 0) {
        result = read_failed(name, "cannot be read", err);
        goto done;
    }
    if (S_ISDIR(info.st_mode)) {
        result = error_set(err, STATUS_ERR_INPUT, "%s: is a folder, a file is needed", name);
        goto done;
    }
    if (S_ISREG(info.st_mode)) {
        if ((uint64_t)info.st_size > limit_bytes) {
            result = error_set(err, STATUS_ERR_LIMIT, "%s: %lld bytes, more than the limit of %zu", name,
                               (long long)info.st_size, limit_bytes);
            goto done;
        }
        buffer_reserve(out, (size_t)info.st_size);
    }
    for (;;) {
        uint8_t chunk[65536];
        ssize_t got = read(fd, chunk, sizeof chunk);
        if (got == 0)
            break;
        if (got < 0) {
            if (errno == EINTR)
                continue;
            result = read_failed(name, "cannot be read", err);
            goto done;
        }
        if (out->size - start + (size_t)got > limit_bytes) {
            result = error_set(err, STATUS_ERR_LIMIT, "%s: more than the limit of %zu bytes", name, limit_bytes);
            goto done;
        }
        buffer_append(out, chunk, (size_t)got);
        if (!buffer_ok(out)) {
            result = error_no_memory(err, name);
            goto done;
        }
    }
done:
    close(fd);
    return result;
}

status file_read(const char *path, size_t limit_bytes, struct buffer *out, struct error *err)
{
    return file_read_as(path, path, limit_bytes, out, err);
}

/* Does the folder exist that holds the file's folder? */
static int keeper_is_there(const char *path)
{
    char *folder = file_dirname(path);
    char *keeper = folder ? file_dirname(folder) : NULL;
    int there = keeper && file_exists(keeper);

    mem_free(keeper);
    mem_free(folder);
    return there;
}

status file_read_kept(const char *path, size_t limit_bytes, struct buffer *out, struct error *err)
{
    struct error why = {0};
    struct stat info;
    status s = file_read(path, limit_bytes, out, &why);

    if (s == STATUS_ERR_INPUT) {
        int missing = stat(path, &info) != 0 && (errno == ENOENT || errno == ENOTDIR);
        s = missing && keeper_is_there(path) ? STATUS_ERR_NOT_FOUND : STATUS_ERR_IO;
    }
    return s == STATUS_OK ? s : error_set(err, s, "%s", why.text);
}

static int write_all(int fd, const uint8_t *data, size_t size_bytes)
{
    while (size_bytes > 0) {
        ssize_t put = write(fd, data, size_bytes);
        if (put < 0) {
            if (errno == EINTR)
                continue;
            return -1;
        }
        data += put;
        size_bytes -= (size_t)put;
    }
    return 0;
}

static int forgone; /* syncs */

void file_forgo_syncs(void) { forgone = 1; }

int file_syncs(void) { return !forgone; }

int file_sync(int fd) { return forgone ? 0 : fsync(fd); }

int file_sync_data(int fd) { return forgone ? 0 : fdatasync(fd); }

status file_sync_folder_of(const char *path, struct error *err)
{
    char *folder = file_dirname(path);
    int fd = folder ? open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC) : -1;
    status s = STATUS_OK;

    if (!folder)
        return error_no_memory(err, path);
    /* A folder that may be written to but not listed cannot be opened, either. */
    if (fd < 0 ? errno != EACCES : file_sync(fd) != 0 && errno != EINVAL && errno != ENOTSUP)
        s = error_set(err, STATUS_ERR_IO, "%s: the folder cannot be synced: %s", folder, strerror(errno));
    if (fd >= 0)
        close(fd);
    mem_free(folder);
    return s;
}

static status write_file(const char *path, const void *data, size_t size_bytes, mode_t mode, int sync_folder,
                         struct error *err)
{
    struct buffer temporary = BUFFER_INIT;
    status result = STATUS_OK;
    int fd = -1;

    buffer_printf(&temporary, "%s.XXXXXX", path);
    if (!buffer_ok(&temporary)) {
        buffer_release(&temporary);
        return error_no_memory(err, path);
    }
    fd = mkostemp((char *)temporary.data, O_CLOEXEC);
    if (fd < 0) {
        result = error_set(err, STATUS_ERR_IO,
                           "%s: cannot be written: %s (choose a folder that exists and can be "
                           "written to)",
                           path, strerror(errno));
        buffer_release(&temporary);
        return result;
    }
    if (fchmod(fd, mode) != 0 || write_all(fd, data, size_bytes) != 0 || file_sync(fd) != 0) {
        result = error_set(err, STATUS_ERR_IO, "%s: cannot be written: %s", path, strerror(errno));
        close(fd);
        unlink((char *)temporary.data);
    } else if (close(fd) != 0 || rename((char *)temporary.data, path) != 0) {
        result = error_set(err, STATUS_ERR_IO, "%s: cannot be written: %s", path, strerror(errno));
        unlink((char *)temporary.data);
    } else if (sync_folder) {
        result = file_sync_folder_of(path, err);
    }
    buffer_release(&temporary);
    return result;
}

status file_write_atomic(const char *path, const void *data, size_t size_bytes, struct error *err)
{
    mode_t mask = umask(0);

    umask(mask);
    return write_file(path, data, size_bytes, 0666 & ~mask, 1, err);
}

status file_write_private(const char *path, const void *data, size_t size_bytes, struct error *err)
{
    return write_file(path, data, size_bytes, 0600, 1, err);
}

status file_write_one_of_many(const char *path, const void *data, size_t size_bytes, struct error *err)
{
    return write_file(path, data, size_bytes, 0600, 0, err);
}

static int is_folder(const char *path)
{
    struct stat info;

    return stat(path, &info) == 0 && S_ISDIR(info.st_mode);
}

/* One folder, whose parent exists. */
static status make_one(const char *path, mode_t mode, int synced, struct error *err)
{
    int code = mkdir(path, mode) == 0 ? 0 : errno;

    if (code == 0)
        return synced ? file_sync_folder_of(path, err) : STATUS_OK;
    if (code == EEXIST || is_folder(path))
        return STATUS_OK;
    return error_set(err, STATUS_ERR_IO, "%s: the folder cannot be made: %s", path, strerror(code));
}

static status make_folders(const char *path, mode_t mode, int synced, struct error *err)
{
    status result = STATUS_OK;
    char *copy;

    if (is_folder(path))
        return STATUS_OK;
    copy = mem_strdup(path);
    if (!copy)
        return error_no_memory(err, path);
    for (char *at = copy + 1; *copy && result == STATUS_OK; at++) {
        char saved = *at;
        if (saved != '/' && saved != 0)
            continue;
        *at = 0;
        result = make_one(copy, mode, synced, err);
        *at = saved;
        if (saved == 0)
            break;
    }
    if (result == STATUS_OK && !is_folder(path))
        result = error_set(err, STATUS_ERR_IO, "%s: is not a folder", path);
    mem_free(copy);
    return result;
}

status file_make_folder(const char *path, struct error *err) { return make_folders(path, 0777, 1, err); }

status file_make_private_folder(const char *path, struct error *err) { return make_folders(path, 0700, 1, err); }

status file_make_scratch_folder(const char *path, struct error *err) { return make_folders(path, 0700, 0, err); }

static int remove_entry(const char *path, const struct stat *info UNUSED, int type UNUSED, struct FTW *where UNUSED)
{
    (void)remove(path);
    return 0; /* continue: remove as much as possible */
}

int file_is_large(const struct stat *info)
{
    return S_ISREG(info->st_mode) && (uint64_t)info->st_blocks * 512 > FILE_LARGE_BYTES;
}

pid_t file_remove_apart(int at, const char *name)
{
    char *const argv[] = {(char *)"rm", (char *)"-rf", (char *)"--one-file-system", (char *)"--", (char *)name, NULL};
    posix_spawn_file_actions_t actions;
    posix_spawnattr_t attributes;
    sigset_t none;
    pid_t pid = 0;
    int failed;

    if (posix_spawn_file_actions_init(&actions) != 0)
        return 0;
    if (posix_spawnattr_init(&attributes) != 0) {
        posix_spawn_file_actions_destroy(&actions);
        return 0;
    }
    sigemptyset(&none);
    failed = posix_spawnattr_setsigmask(&attributes, &none) |
             posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSID | POSIX_SPAWN_SETSIGMASK) |
             posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDWR, 0) |
             posix_spawn_file_actions_adddup2(&actions, STDIN_FILENO, STDOUT_FILENO) |
             posix_spawn_file_actions_adddup2(&actions, STDIN_FILENO, STDERR_FILENO);
    if (at != AT_FDCWD)
        failed |= posix_spawn_file_actions_addfchdir_np(&actions, at);
    failed |= posix_spawn_file_actions_addclosefrom_np(&actions, STDERR_FILENO + 1);
    if (failed || posix_spawnp(&pid, "rm", &actions, &attributes, argv, environ) != 0)
        pid = 0;
    posix_spawnattr_destroy(&attributes);
    posix_spawn_file_actions_destroy(&actions);
    return pid;
}

static int find_large(const char *path UNUSED, const struct stat *info, int type, struct FTW *where UNUSED)
{
    return type == FTW_F && file_is_large(info);
}

void file_remove_tree(const char *path)
{
    const struct timespec little = {.tv_nsec = 5000000};
    pid_t pid = 0;

    if (nftw(path, find_large, TREE_DESCRIPTORS, FTW_PHYS | FTW_MOUNT) == 1)
        pid = file_remove_apart(AT_FDCWD, path);
    for (int ms = 0; pid > 0 && ms < REMOVE_WAIT_MS && waitpid(pid, NULL, WNOHANG) == 0; ms += 5)
        nanosleep(&little, NULL);
    if (pid == 0)
        (void)nftw(path, remove_entry, TREE_DESCRIPTORS, FTW_DEPTH | FTW_PHYS | FTW_MOUNT);
}

int file_exists(const char *path) { return access(path, F_OK) == 0; }

void file_hold_standard(void)
{
    for (int fd = STDIN_FILENO; fd <= STDERR_FILENO; fd++)
        if (fcntl(fd, F_GETFD) < 0 && errno == EBADF && open("/dev/null", fd == STDIN_FILENO ? O_WRONLY : O_RDONLY) < 0)
            return; /* open() takes the lowest number, which is this one */
}

char *file_join(const char *folder, const char *name)
{
    struct buffer joined = BUFFER_INIT;
    size_t length = strlen(folder);

    buffer_printf(&joined, "%s%s%s", folder, length && folder[length - 1] == '/' ? "" : "/", name);
    if (!buffer_ok(&joined)) {
        buffer_release(&joined);
        return NULL;
    }
    return (char *)joined.data;
}

char *file_dirname(const char *path)
{
    const char *slash = strrchr(path, '/');
    char *folder;
    size_t length;

    if (!slash)
        return mem_strdup(".");
    length = slash == path ? 1 : (size_t)(slash - path);
    folder = mem_alloc(length + 1);
    if (folder) {
        memcpy(folder, path, length);
        folder[length] = 0;
    }
    return folder;
}

const char *file_basename(const char *path)
{
    const char *slash = strrchr(path, '/');

    return slash ? slash + 1 : path;
}

const char *file_extension(const char *path)
{
    const char *name = file_basename(path);
    const char *dot = strrchr(name, '.');

    return dot ? dot + 1 : "";
}
