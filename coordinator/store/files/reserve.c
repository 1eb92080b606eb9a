#include "coordinator/store/files/reserve.h"

#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/system/file.h"
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
    return error_set(err, STATUS_ERR_IO, "%s: no space for the store's reserve of %d MB: %s", path, RESERVE_BYTES >> 20,
                     strerror(code));
}

status reserve_hold(const char *folder, struct error *err)
{
    char *path = file_join(folder, "reserve");
    struct stat info;
    status s = STATUS_OK;

    NEED(path, err, "the store's reserve");
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

/* Are more than this many parts of the reserve free above this descriptor? */
static int leaves(int fd, unsigned parts)
{
    struct rlimit limit;
    rlim_t part = RESERVE_DESCRIPTORS;

    if (getrlimit(RLIMIT_NOFILE, &limit) != 0 || limit.rlim_cur == RLIM_INFINITY)
        return 1;
    if (limit.rlim_cur < 4 * part)
        part = limit.rlim_cur / 8;
    return (rlim_t)fd + parts * part < limit.rlim_cur;
}

int reserve_allows(int fd) { return leaves(fd, 1); }

int reserve_is_short(void)
{
    int fd = open("/dev/null", O_RDONLY | O_CLOEXEC);
    int enough = fd >= 0 && leaves(fd, 2);

    if (fd >= 0)
        close(fd);
    return !enough;
}
