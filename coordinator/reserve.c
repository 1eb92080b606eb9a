#include "coordinator/reserve.h"

#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/base/file.h"
#include "common/base/memory.h"

static status make_file(const char *path, struct error *err)
{
    int fd = open(path, O_RDWR | O_CREAT | O_CLOEXEC, 0600);
    int code = fd < 0 ? errno : posix_fallocate(fd, 0, RESERVE_BYTES);

    if (fd >= 0)
        close(fd);
    if (code == 0)
        return STATUS_OK;
    if (fd >= 0)
        unlink(path);
    return error_set(err, STATUS_ERR_IO, "%s: no room for %d MB that the store keeps back: %s", path,
                     RESERVE_BYTES >> 20, strerror(code));
}

status reserve_hold(const char *folder, struct error *err)
{
    char *path = file_join(folder, "reserve");
    struct stat info;
    status s = STATUS_OK;

    if (!path)
        return error_no_memory(err, "the store's reserve");
    if (stat(path, &info) != 0 || info.st_size < RESERVE_BYTES)
        s = make_file(path, err);
    mem_free(path);
    return s;
}

int reserve_release(const char *folder)
{
    char *path = file_join(folder, "reserve");
    int released = path && unlink(path) == 0;

    mem_free(path);
    return released;
}

int reserve_allows(int fd)
{
    struct rlimit limit;

    return getrlimit(RLIMIT_NOFILE, &limit) != 0 || limit.rlim_cur == RLIM_INFINITY ||
           (rlim_t)fd + RESERVE_DESCRIPTORS < limit.rlim_cur;
}

int reserve_is_short(void)
{
    int fd = open("/dev/null", O_RDONLY | O_CLOEXEC);
    int allowed = fd >= 0 && reserve_allows(fd);

    if (fd >= 0)
        close(fd);
    return !allowed;
}
