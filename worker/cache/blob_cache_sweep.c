/* The cache's size limit: the least recently used files are removed. */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "common/system/log.h"
#include "common/base/memory.h"
#include "worker/cache/blob_cache_parts.h"

enum { TEMPORARY_AGE_S = 3600 }; /* an older file being received was left by a crash */

struct cache_file {
    char path[CACHE_PATH_ROOM]; /* below the cache's folder */
    uint64_t size_bytes;
    struct timespec used;
};

struct cache_listing {
    struct cache_file *files;
    size_t count, capacity;
    uint64_t total_bytes;
    int failed; /* out of memory */
};

static int is_hex(const char *name, size_t length)
{
    return strlen(name) == length && strspn(name, "0123456789abcdef") == length;
}

static void list_folder(int folder_fd, const char *name, struct cache_listing *out)
{
    int fd = openat(folder_fd, name, O_RDONLY | O_DIRECTORY | O_CLOEXEC | O_NOFOLLOW);
    DIR *dir = fd >= 0 ? fdopendir(fd) : NULL;
    struct dirent *entry;

    if (!dir) {
        if (fd >= 0)
            close(fd);
        return;
    }
    while ((entry = readdir(dir)) != NULL) {
        struct stat info;
        struct cache_file *file;
        if (!is_hex(entry->d_name, 2 * DIGEST_BYTES - 2) ||
            fstatat(fd, entry->d_name, &info, AT_SYMLINK_NOFOLLOW) != 0 || !S_ISREG(info.st_mode))
            continue;
        if (!MEM_GROW(out->files, out->capacity, out->count + 1)) {
            out->failed = 1;
            break;
        }
        file = &out->files[out->count++];
        snprintf(file->path, sizeof file->path, "%.2s/%.62s", name, entry->d_name);
        file->size_bytes = (uint64_t)info.st_size;
        file->used = info.st_mtim;
        out->total_bytes += file->size_bytes;
    }
    closedir(dir);
}

static int compare_by_use(const void *a, const void *b)
{
    const struct cache_file *x = a, *y = b;

    if (x->used.tv_sec != y->used.tv_sec)
        return x->used.tv_sec < y->used.tv_sec ? -1 : 1;
    if (x->used.tv_nsec != y->used.tv_nsec)
        return x->used.tv_nsec < y->used.tv_nsec ? -1 : 1;
    return strcmp(x->path, y->path);
}

void cache_sweep(struct blob_cache *cache)
{
    struct cache_listing list = {0};
    uint64_t total, target = cache->limit_bytes - cache->limit_bytes / 10;
    size_t removed = 0;
    int fd = open(cache->folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);

    if (fd < 0)
        return;
    for (int i = 0; i < 256 && !list.failed; i++) {
        char name[3];
        snprintf(name, sizeof name, "%02x", (unsigned)i & 255);
        list_folder(fd, name, &list);
    }
    total = list.total_bytes;
    if (total > cache->limit_bytes && list.count > 0) {
        qsort(list.files, list.count, sizeof *list.files, compare_by_use);
        for (size_t i = 0; i < list.count && total > target; i++) {
            if (unlinkat(fd, list.files[i].path, 0) == 0)
                removed++;
            else if (errno != ENOENT)
                continue;
            total -= list.files[i].size_bytes;
        }
        log_debug("%s: removed %zu least recently used blobs, %llu bytes are left", cache->folder, removed,
                  (unsigned long long)total);
    }
    pthread_mutex_lock(&cache->lock);
    cache->stored_bytes = total;
    pthread_mutex_unlock(&cache->lock);
    mem_free(list.files);
    close(fd);
}

void cache_sweep_temporaries(const char *folder)
{
    DIR *dir = opendir(folder);
    struct dirent *entry;
    time_t now = time(NULL);

    if (!dir)
        return;
    while ((entry = readdir(dir)) != NULL) {
        struct stat info;
        if (entry->d_name[0] != '.' && fstatat(dirfd(dir), entry->d_name, &info, 0) == 0 && S_ISREG(info.st_mode) &&
            now - info.st_mtime > TEMPORARY_AGE_S)
            unlinkat(dirfd(dir), entry->d_name, 0);
    }
    closedir(dir);
}
