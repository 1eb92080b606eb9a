#include "coordinator/store/files/footprint.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include "common/base/memory.h"

enum { DEPTH_MAX = 8 }; /* of folders in a store; it has 3 */

static uint64_t bytes_of(const struct stat *info) { return (uint64_t)info->st_blocks * 512; }

/* The bytes below the folder, its own included. Takes fd. */
static uint64_t tree_bytes(int fd, int depth)
{
    DIR *folder = fd >= 0 ? fdopendir(fd) : NULL;
    const struct dirent *entry;
    uint64_t sum = 0;

    if (!folder) {
        if (fd >= 0)
            close(fd);
        return 0;
    }
    while ((entry = readdir(folder))) {
        struct stat info;
        if (strcmp(entry->d_name, "..") == 0 || fstatat(dirfd(folder), entry->d_name, &info, AT_SYMLINK_NOFOLLOW) != 0)
            continue;
        if (S_ISDIR(info.st_mode) && strcmp(entry->d_name, ".") != 0 && depth < DEPTH_MAX)
            sum += tree_bytes(openat(dirfd(folder), entry->d_name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC),
                              depth + 1);
        else
            sum += bytes_of(&info);
    }
    closedir(folder);
    return sum;
}

static uint64_t folder_bytes(int store, const char *name)
{
    return tree_bytes(openat(store, name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC), 0);
}

/* What is in the trash, without its folder, which stays. */
static uint64_t being_freed(int store)
{
    uint64_t all = folder_bytes(store, "trash");
    struct stat info;

    return fstatat(store, "trash", &info, AT_SYMLINK_NOFOLLOW) == 0 && all > bytes_of(&info) ? all - bytes_of(&info)
                                                                                             : 0;
}

static int compare(const void *a, const void *b)
{
    uint64_t left = ((const struct job_footprint *)a)->job, right = ((const struct job_footprint *)b)->job;

    return (left > right) - (left < right);
}

/* Add a row for each of the folder's folders that is named by a number. */
static status walk_jobs(struct footprint *out, int store, const char *name, int films, struct error *err)
{
    int fd = openat(store, name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
    DIR *folder = fd >= 0 ? fdopendir(fd) : NULL;
    const struct dirent *entry;
    status s = STATUS_OK;

    if (!folder) {
        if (fd >= 0)
            close(fd);
        return errno == ENOENT ? STATUS_OK
                               : error_set(err, STATUS_ERR_IO, "%s: cannot be read: %s", name, strerror(errno));
    }
    while (s == STATUS_OK && (entry = readdir(folder))) {
        struct job_footprint row = {0};
        uint64_t bytes;
        char *end;
        row.job = strtoull(entry->d_name, &end, 10);
        if (row.job == 0 || *end != 0)
            continue;
        bytes = tree_bytes(openat(dirfd(folder), entry->d_name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC), 0);
        *(films ? &row.films : &row.pictures) = bytes;
        *(films ? &out->films : &out->pictures) += bytes;
        if (MEM_GROW(out->jobs, out->capacity, out->count + 1))
            out->jobs[out->count++] = row;
        else
            s = error_no_memory(err, "what takes the store's room");
    }
    closedir(folder);
    return s;
}

/* Rows of one job become one. */
static void join_rows(struct footprint *out)
{
    size_t kept = 0;

    if (out->count > 0)
        qsort(out->jobs, out->count, sizeof *out->jobs, compare);
    for (size_t i = 0; i < out->count; i++) {
        if (kept > 0 && out->jobs[kept - 1].job == out->jobs[i].job) {
            out->jobs[kept - 1].films += out->jobs[i].films;
            out->jobs[kept - 1].pictures += out->jobs[i].pictures;
        } else {
            out->jobs[kept++] = out->jobs[i];
        }
    }
    out->count = kept;
}

/* The files in the store's own folder. */
static void walk_files(struct footprint *out, int store)
{
    int fd = openat(store, ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    DIR *folder = fd >= 0 ? fdopendir(fd) : NULL;
    const struct dirent *entry;

    if (!folder && fd >= 0)
        close(fd);
    while (folder && (entry = readdir(folder))) {
        struct stat info;
        if (fstatat(store, entry->d_name, &info, AT_SYMLINK_NOFOLLOW) != 0 || !S_ISREG(info.st_mode))
            continue;
        if (strncmp(entry->d_name, "queue.sqlite", strlen("queue.sqlite")) == 0)
            out->database += bytes_of(&info);
        else if (strcmp(entry->d_name, "reserve") == 0)
            out->reserve += bytes_of(&info);
        else
            out->other += bytes_of(&info);
    }
    if (folder)
        closedir(folder);
}

status footprint_disk(const char *folder, uint64_t *disk_bytes, uint64_t *free_bytes, struct error *err)
{
    struct statvfs disk;

    *disk_bytes = *free_bytes = 0;
    if (statvfs(folder, &disk) != 0)
        return error_set(err, STATUS_ERR_IO, "%s: cannot be looked at: %s", folder, strerror(errno));
    *disk_bytes = (uint64_t)disk.f_blocks * disk.f_frsize;
    *free_bytes = (uint64_t)disk.f_bavail * disk.f_frsize;
    return STATUS_OK;
}

status footprint_measure(struct footprint *out, const char *folder, struct error *err)
{
    int store = open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    status s;

    if (store < 0)
        return error_set(err, STATUS_ERR_IO, "%s: cannot be read: %s", folder, strerror(errno));
    s = walk_jobs(out, store, "films", 1, err);
    THEN(s, walk_jobs(out, store, "outputs", 0, err));
    THEN(s, footprint_disk(folder, &out->disk_bytes, &out->free_bytes, err));
    join_rows(out);
    out->blobs = folder_bytes(store, "blobs");
    out->trash = being_freed(store);
    walk_files(out, store);
    close(store);
    return s;
}

uint64_t footprint_trash(const char *folder)
{
    int store = open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    uint64_t bytes = store >= 0 ? being_freed(store) : 0;

    if (store >= 0)
        close(store);
    return bytes;
}

void footprint_release(struct footprint *footprint)
{
    mem_free(footprint->jobs);
    *footprint = (struct footprint){0};
}

uint64_t footprint_total(const struct footprint *footprint)
{
    return footprint->films + footprint->pictures + footprint->blobs + footprint->database + footprint->reserve +
           footprint->other;
}

const struct job_footprint *footprint_find(const struct footprint *footprint, uint64_t job)
{
    const struct job_footprint key = {.job = job};

    return footprint->count ? bsearch(&key, footprint->jobs, footprint->count, sizeof key, compare) : NULL;
}
