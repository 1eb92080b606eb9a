#include "coordinator/store/store_hold.h"

#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <sys/file.h>
#include <unistd.h>

#include "common/base/file.h"
#include "common/base/memory.h"

static status hold(const char *folder, int how, int *out, struct error *err)
{
    char *path = file_join(folder, "hold"), *database = file_join(folder, "queue.sqlite");
    int code, there = database && file_exists(database);
    status s = STATUS_OK;

    *out = -1;
    mem_free(database);
    if (!path)
        return error_no_memory(err, "a path");
    if (!there) { /* not made in a mount point whose disk is gone */
        mem_free(path);
        return error_set(err, STATUS_ERR_IO,
                         "%s: is no store at present; was it moved or unmounted?", folder);
    }
    *out = open(path, O_RDWR | O_CREAT | O_CLOEXEC, 0600);
    do
        code = *out < 0 || flock(*out, how) == 0 ? 0 : errno;
    while (code == EINTR);
    if (*out < 0)
        s = error_set(err, STATUS_ERR_IO, "%s: cannot be opened: %s", path, strerror(errno));
    else if (code == EWOULDBLOCK)
        s = error_set(err, STATUS_ERR_REFUSED,
                      "a backup is being made of the store: nothing is removed until it ends");
    else if (code != 0)
        s = error_set(err, STATUS_ERR_IO, "%s: cannot be locked: %s", path, strerror(code));
    mem_free(path);
    return s;
}

status store_hold_exclude(const char *folder, int *out, struct error *err)
{
    return hold(folder, LOCK_EX | LOCK_NB, out, err);
}

status store_hold_begin(const char *folder, int *out, struct error *err)
{
    return hold(folder, LOCK_SH, out, err);
}

void store_hold_end(int fd)
{
    if (fd >= 0)
        close(fd);
}
