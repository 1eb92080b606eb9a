#include "client/link/scratch.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "common/system/file.h"

#define PREFIX "azulejo-render-"
/* A folder without an owner file is just being created, or its creator died while doing so. */
enum { MAKING_LIMIT_S = 60 };

static const char *temporary_folder(void)
{
    const char *folder = getenv("TMPDIR");

    return folder && *folder ? folder : "/tmp";
}

/* Lock a file below the folder, created if `flags` allow; returns its descriptor. -1: there is no
 * file. -2: another process holds the lock. */
static int lock_file(const char *folder, const char *name, int flags)
{
    char path[SCRATCH_PATH_SIZE + 16];
    int fd;

    snprintf(path, sizeof path, "%s/%s", folder, name);
    fd = open(path, O_RDWR | O_CLOEXEC | O_NOFOLLOW | flags, 0600);
    if (fd < 0)
        return errno == ENOENT ? -1 : -2;
    if (flock(fd, LOCK_EX | LOCK_NB) != 0) {
        close(fd);
        return -2;
    }
    return fd;
}

static int is_stale(const char *folder)
{
    int owner, store = -1, stale = 0;
    struct stat info;

    if (lstat(folder, &info) != 0 || !S_ISDIR(info.st_mode) || info.st_uid != geteuid())
        return 0;
    owner = lock_file(folder, "owner", 0);
    if (owner == -1)
        return time(NULL) - info.st_mtime > MAKING_LIMIT_S;
    if (owner >= 0) {
        store = lock_file(folder, "lock", 0);
        stale = store != -2;
        close(owner);
    }
    if (store >= 0)
        close(store);
    return stale;
}

static void sweep(const char *parent)
{
    char path[SCRATCH_PATH_SIZE];
    DIR *folder = opendir(parent);
    const struct dirent *entry;

    while (folder && (entry = readdir(folder)))
        if (strncmp(entry->d_name, PREFIX, sizeof PREFIX - 1) == 0 &&
            snprintf(path, sizeof path, "%s/%s", parent, entry->d_name) < (int)sizeof path && is_stale(path))
            file_remove_tree(path);
    if (folder)
        closedir(folder);
}

status scratch_make(struct scratch *scratch, struct error *err)
{
    const char *parent = temporary_folder();

    scratch->path[0] = 0;
    scratch->owner_fd = -1;
    sweep(parent);
    if (snprintf(scratch->path, sizeof scratch->path, "%s/" PREFIX "XXXXXX", parent) >= (int)sizeof scratch->path) {
        scratch->path[0] = 0;
        return error_set(err, STATUS_ERR_IO, "TMPDIR is too long");
    }
    if (!mkdtemp(scratch->path)) {
        scratch->path[0] = 0;
        return error_set(err, STATUS_ERR_IO,
                         "%s: no temporary folder can be made there: %s (set TMPDIR to one where "
                         "it can)",
                         parent, strerror(errno));
    }
    scratch->owner_fd = lock_file(scratch->path, "owner", O_CREAT);
    if (scratch->owner_fd < 0)
        return error_set(err, STATUS_ERR_IO, "%s/owner: cannot be made: %s", scratch->path, strerror(errno));
    return STATUS_OK;
}

void scratch_remove(struct scratch *scratch)
{
    if (scratch->path[0])
        file_remove_tree(scratch->path);
    scratch->path[0] = 0;
    if (scratch->owner_fd >= 0)
        close(scratch->owner_fd);
    scratch->owner_fd = -1;
}
