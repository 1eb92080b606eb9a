#include "common/base/file.h"

#include <errno.h>
#include <fcntl.h>
#include <ftw.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/base/memory.h"

enum { TREE_DESCRIPTORS = 16 };

status file_read(const char *path, size_t limit_bytes, struct buffer *out, struct error *err)
{
    status result = STATUS_OK;
    struct stat info;
    size_t start = out->size;
    int fd = open(path, O_RDONLY | O_CLOEXEC);

    if (fd < 0)
        return error_set(err, STATUS_ERR_INPUT, "%s: cannot be opened: %s", path, strerror(errno));
    if (fstat(fd, &info) != 0) {
        result = error_set(err, STATUS_ERR_INPUT, "%s: %s", path, strerror(errno));
        goto done;
    }
    if (S_ISDIR(info.st_mode)) {
        result = error_set(err, STATUS_ERR_INPUT, "%s: is a folder, a file is needed", path);
        goto done;
    }
    if (S_ISREG(info.st_mode)) {
        if ((uint64_t)info.st_size > limit_bytes) {
            result = error_set(err, STATUS_ERR_LIMIT, "%s: %lld bytes, more than the limit of %zu",
                               path, (long long)info.st_size, limit_bytes);
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
            result = error_set(err, STATUS_ERR_INPUT, "%s: cannot be read: %s", path,
                               strerror(errno));
            goto done;
        }
        if (out->size - start + (size_t)got > limit_bytes) {
            result = error_set(err, STATUS_ERR_LIMIT, "%s: more than the limit of %zu bytes", path,
                               limit_bytes);
            goto done;
        }
        buffer_append(out, chunk, (size_t)got);
        if (!buffer_ok(out)) {
            result = error_no_memory(err, path);
            goto done;
        }
    }
done:
    close(fd);
    return result;
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

static void sync_folder_of(const char *path)
{
    char *folder = file_dirname(path);
    int fd = folder ? open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC) : -1;

    if (fd >= 0) {
        fsync(fd); /* some file systems cannot sync a folder; the rename stands all the same */
        close(fd);
    }
    mem_free(folder);
}

status file_write_atomic(const char *path, const void *data, size_t size_bytes, struct error *err)
{
    struct buffer temporary = BUFFER_INIT;
    status result = STATUS_OK;
    int fd = -1;
    mode_t mask;

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
    mask = umask(0);
    umask(mask);
    if (fchmod(fd, 0666 & ~mask) != 0 || write_all(fd, data, size_bytes) != 0 || fsync(fd) != 0) {
        result = error_set(err, STATUS_ERR_IO, "%s: cannot be written: %s", path, strerror(errno));
        close(fd);
        unlink((char *)temporary.data);
    } else if (close(fd) != 0 || rename((char *)temporary.data, path) != 0) {
        result = error_set(err, STATUS_ERR_IO, "%s: cannot be written: %s", path, strerror(errno));
        unlink((char *)temporary.data);
    } else {
        sync_folder_of(path);
    }
    buffer_release(&temporary);
    return result;
}

status file_make_folder(const char *path, struct error *err)
{
    char *copy = mem_strdup(path);
    status result = STATUS_OK;
    struct stat info;

    if (!copy)
        return error_no_memory(err, path);
    for (char *at = copy + 1; *copy; at++) {
        char saved = *at;
        if (saved != '/' && saved != 0)
            continue;
        *at = 0;
        if (mkdir(copy, 0777) != 0 && errno != EEXIST) {
            result = error_set(err, STATUS_ERR_IO, "%s: the folder cannot be made: %s", copy,
                               strerror(errno));
            goto done;
        }
        *at = saved;
        if (saved == 0)
            break;
    }
    if (stat(path, &info) != 0 || !S_ISDIR(info.st_mode))
        result = error_set(err, STATUS_ERR_IO, "%s: is not a folder", path);
done:
    mem_free(copy);
    return result;
}

static int remove_entry(const char *path, const struct stat *info, int type, struct FTW *where)
{
    (void)info;
    (void)type;
    (void)where;
    (void)remove(path);
    return 0; /* go on: what can be removed shall be */
}

void file_remove_tree(const char *path)
{
    (void)nftw(path, remove_entry, TREE_DESCRIPTORS, FTW_DEPTH | FTW_PHYS | FTW_MOUNT);
}

int file_exists(const char *path)
{
    return access(path, F_OK) == 0;
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
