#include "coordinator/store/files/copy.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/system/file.h"
#include "common/base/memory.h"

enum { COPY_BUFFER = 1 << 20, COPY_DEPTH_MAX = 8 };

static status failed(const char *path, const char *what, struct error *err)
{
    return error_set(err, STATUS_ERR_IO, "%s: cannot be %s: %s", path, what, strerror(errno));
}

/* Copy one run of bytes; the source may end early. */
static status copy_run(int in, int out, off_t at, off_t end, uint8_t *bytes, const char *from, const char *to,
                       struct copied *sum, struct error *err)
{
    while (at < end) {
        size_t wanted = end - at < COPY_BUFFER ? (size_t)(end - at) : COPY_BUFFER;
        ssize_t got = pread(in, bytes, wanted, at);
        if (got < 0 && errno == EINTR)
            continue;
        if (got < 0)
            return failed(from, "read", err);
        if (got == 0)
            return STATUS_OK;
        for (ssize_t put = 0, n; put < got; put += n) {
            n = pwrite(out, bytes + put, (size_t)(got - put), at + put);
            if (n < 0 && errno != EINTR)
                return failed(to, "written", err);
            n = n < 0 ? 0 : n;
        }
        at += got;
        sum->bytes += (uint64_t)got;
    }
    return STATUS_OK;
}

/* What the source has now, from *size on. A film in work makes room only for what it wrote again before, further behind: so it is
 * copied to the end that it has when all before is copied. */
static int has_grown(int in, off_t *size)
{
    struct stat info;
    int grown = fstat(in, &info) == 0 && info.st_size > *size;

    *size = grown ? info.st_size : *size;
    return grown;
}

/* Films in work have holes. */
static status copy_data(int in, int out, const struct stat *info, const char *from, const char *to, struct copied *sum,
                        struct error *err)
{
    const struct timespec times[2] = {{.tv_nsec = UTIME_OMIT}, info->st_mtim};
    uint8_t *bytes = mem_alloc(COPY_BUFFER);
    status s = bytes ? STATUS_OK : error_no_memory(err, "a copy");
    off_t at = 0, size = info->st_size;

    while (s == STATUS_OK && (at < size || has_grown(in, &size))) {
        off_t data = lseek(in, at, SEEK_DATA), hole;
        if (data < 0 && errno == ENXIO)
            break;
        data = data < 0 ? at : data; /* a file system without holes */
        hole = lseek(in, data, SEEK_HOLE);
        if (hole < 0 || hole > size)
            hole = size;
        s = copy_run(in, out, data, hole, bytes, from, to, sum, err);
        at = hole;
    }
    if (s == STATUS_OK && (ftruncate(out, size) != 0 || futimens(out, times) != 0))
        s = failed(to, "written", err);
    mem_free(bytes);
    return s;
}

status copy_file(const char *from, const char *to, struct copied *sum, struct error *err)
{
    int in = open(from, O_RDONLY | O_NOFOLLOW | O_CLOEXEC), out;
    struct stat info;
    status s = STATUS_OK;

    if (in < 0)
        return failed(from, "opened", err);
    unlink(to); /* not written into: it may be a link */
    out = open(to, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
    if (out < 0)
        s = failed(to, "made", err);
    else if (fstat(in, &info) != 0)
        s = failed(from, "read", err);
    else
        s = copy_data(in, out, &info, from, to, sum, err);
    close(in);
    if (out >= 0 && close(out) != 0 && s == STATUS_OK)
        s = failed(to, "written", err);
    sum->files += s == STATUS_OK;
    return s;
}

static int is_copied(const struct stat *from, const char *to)
{
    struct stat info;

    return stat(to, &info) == 0 && info.st_size == from->st_size && info.st_mtim.tv_sec == from->st_mtim.tv_sec &&
           info.st_mtim.tv_nsec == from->st_mtim.tv_nsec;
}

static status copy_folder(const char *from, const char *to, int depth, struct copied *sum, struct error *err);

static status copy_entry(const char *from, const char *to, int depth, struct copied *sum, struct error *err)
{
    struct stat info;
    struct error why = {0};
    status s = STATUS_OK;

    if (lstat(from, &info) != 0)
        return errno == ENOENT ? STATUS_OK : failed(from, "read", err);
    if (S_ISDIR(info.st_mode))
        return depth < COPY_DEPTH_MAX ? copy_folder(from, to, depth + 1, sum, err) : STATUS_OK;
    if (!S_ISREG(info.st_mode) || is_copied(&info, to))
        return STATUS_OK;
    s = copy_file(from, to, sum, &why);
    if (s != STATUS_OK && lstat(from, &info) != 0 && errno == ENOENT)
        return STATUS_OK;
    if (s != STATUS_OK)
        *err = why;
    return s;
}

static status copy_folder(const char *from, const char *to, int depth, struct copied *sum, struct error *err)
{
    DIR *folder = opendir(from);
    const struct dirent *entry;
    status s;

    if (!folder)
        return errno == ENOENT ? STATUS_OK : failed(from, "read", err);
    s = file_make_private_folder(to, err);
    while (s == STATUS_OK && (entry = readdir(folder))) {
        char *source, *target;
        if (strcmp(entry->d_name, ".") == 0 || strcmp(entry->d_name, "..") == 0)
            continue;
        source = file_join(from, entry->d_name);
        target = file_join(to, entry->d_name);
        s = source && target ? copy_entry(source, target, depth, sum, err) : error_no_memory(err, "a copy");
        mem_free(target);
        mem_free(source);
    }
    closedir(folder);
    return s;
}

status copy_tree(const char *from, const char *to, struct copied *sum, struct error *err)
{
    return copy_folder(from, to, 0, sum, err);
}
