#include "worker/cache/blob_cache.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "common/system/file.h"
#include "common/system/log.h"
#include "common/base/memory.h"
#include "worker/cache/blob_cache_parts.h"

struct cached_blob {
    struct blob_cache *cache;
    struct cached_blob *chain; /* in its hash bucket */
    struct digest digest;
    const uint8_t *data;
    size_t size_bytes;
    int mapped;          /* munmap it */
    unsigned references; /* under the cache's lock */
};

/* A file that this process has hashed is not hashed again while it is unchanged. */
struct verified {
    struct verified *chain;
    struct digest digest;
    dev_t device;
    ino_t inode;
};

static size_t bucket_of(const struct digest *d) { return ((size_t)d->bytes[0] << 8 | d->bytes[1]) % CACHE_BUCKETS; }

char *cache_blob_path(const struct blob_cache *cache, const struct digest *digest, int folder_only)
{
    size_t size = strlen(cache->folder) + CACHE_PATH_ROOM;
    char hex[DIGEST_HEX_SIZE], *path = mem_alloc(size);

    digest_to_hex(digest, hex);
    if (path)
        snprintf(path, size, "%s/%.2s%s%s", cache->folder, hex, folder_only ? "" : "/", folder_only ? "" : hex + 2);
    return path;
}

/* ---- blobs in use ---------------------------------------------------------------------- */

static struct cached_blob *live_find(struct blob_cache *cache, const struct digest *digest)
{
    struct cached_blob *b = cache->live[bucket_of(digest)];

    while (b && !digest_equal(&b->digest, digest))
        b = b->chain;
    return b;
}

static void blob_unmap(struct cached_blob *blob)
{
    if (blob->mapped)
        munmap((void *)blob->data, blob->size_bytes);
    mem_free(blob);
}

struct cached_blob *cached_blob_new(struct blob_cache *cache, const struct digest *digest, const uint8_t *data,
                                    size_t size_bytes)
{
    static const uint8_t nothing[16];
    struct cached_blob *blob = mem_calloc(1, sizeof *blob);

    if (!blob)
        return NULL;
    blob->cache = cache;
    blob->digest = *digest;
    blob->data = data ? data : nothing;
    blob->size_bytes = size_bytes;
    blob->mapped = data != NULL;
    blob->references = 1;
    return blob;
}

struct cached_blob *cache_add(struct blob_cache *cache, struct cached_blob *blob)
{
    struct cached_blob *other;
    size_t bucket = bucket_of(&blob->digest);

    pthread_mutex_lock(&cache->lock);
    other = live_find(cache, &blob->digest);
    if (other) {
        other->references++;
    } else {
        blob->chain = cache->live[bucket];
        cache->live[bucket] = blob;
    }
    pthread_mutex_unlock(&cache->lock);
    if (!other)
        return blob;
    blob_unmap(blob);
    return other;
}

struct cached_blob *cached_blob_retain(struct cached_blob *blob)
{
    pthread_mutex_lock(&blob->cache->lock);
    blob->references++;
    pthread_mutex_unlock(&blob->cache->lock);
    return blob;
}

void cached_blob_release(struct cached_blob *blob)
{
    struct blob_cache *cache;
    struct cached_blob **at;
    int last;

    if (!blob)
        return;
    cache = blob->cache;
    pthread_mutex_lock(&cache->lock);
    last = --blob->references == 0;
    if (last) {
        for (at = &cache->live[bucket_of(&blob->digest)]; *at != blob; at = &(*at)->chain)
            ;
        *at = blob->chain;
    }
    pthread_mutex_unlock(&cache->lock);
    if (last)
        blob_unmap(blob);
}

const struct digest *cached_blob_digest(const struct cached_blob *blob) { return &blob->digest; }

const uint8_t *cached_blob_data(const struct cached_blob *blob) { return blob->data; }

size_t cached_blob_size(const struct cached_blob *blob) { return blob->size_bytes; }

/* ---- files ----------------------------------------------------------------------------- */

static int is_verified(struct blob_cache *cache, const struct digest *digest, const struct stat *info)
{
    struct verified *v;

    pthread_mutex_lock(&cache->lock);
    v = cache->verified[bucket_of(digest)];
    while (v && !(digest_equal(&v->digest, digest) && v->device == info->st_dev && v->inode == info->st_ino))
        v = v->chain;
    pthread_mutex_unlock(&cache->lock);
    return v != NULL;
}

void cache_remember_verified(struct blob_cache *cache, const struct digest *digest, const struct stat *info)
{
    struct verified *v = mem_calloc(1, sizeof *v);
    size_t bucket = bucket_of(digest);

    if (!v)
        return;
    v->digest = *digest;
    v->device = info->st_dev;
    v->inode = info->st_ino;
    pthread_mutex_lock(&cache->lock);
    v->chain = cache->verified[bucket];
    cache->verified[bucket] = v;
    pthread_mutex_unlock(&cache->lock);
}

status cache_map_file(struct blob_cache *cache, int fd, const char *path, const struct digest *digest,
                      struct cached_blob **out, struct error *err)
{
    struct stat info;
    struct digest actual;
    void *data = NULL;
    size_t size;

    if (fstat(fd, &info) != 0)
        return error_set(err, STATUS_ERR_IO, "%s: %s", path, strerror(errno));
    if (!S_ISREG(info.st_mode)) {
        log_warn("%s: not a regular file; fetching the blob again", path);
        return error_set(err, STATUS_ERR_NOT_FOUND, "%s: not a regular file", path);
    }
    size = (size_t)info.st_size;
    if (size > 0) {
        data = mmap(NULL, size, PROT_READ, MAP_PRIVATE, fd, 0);
        if (data == MAP_FAILED)
            return error_set(err, STATUS_ERR_NO_MEMORY, "%s: cannot be mapped: %s", path, strerror(errno));
    }
    if (!is_verified(cache, digest, &info)) {
        status s = digest_of(&actual, data ? data : "", size);
        if (s != STATUS_OK || !digest_equal(&actual, digest)) {
            if (data)
                munmap(data, size);
            if (s != STATUS_OK)
                return error_set(err, s, "%s: cannot be hashed", path);
            log_warn("%s: damaged; removed, fetching it again", path);
            if (unlink(path) != 0 && errno != ENOENT)
                return error_set(err, STATUS_ERR_IO, "%s: damaged, and cannot be removed: %s", path, strerror(errno));
            return error_set(err, STATUS_ERR_NOT_FOUND, "%s: damaged", path);
        }
        cache_remember_verified(cache, digest, &info);
    }
    *out = cached_blob_new(cache, digest, data, size);
    if (!*out) {
        if (data)
            munmap(data, size);
        return error_no_memory(err, path);
    }
    return STATUS_OK;
}

status blob_cache_get(struct blob_cache *cache, const struct digest *digest, struct cached_blob **out,
                      struct error *err)
{
    char *path;
    status s;
    int fd;

    pthread_mutex_lock(&cache->lock);
    *out = live_find(cache, digest);
    if (*out)
        (*out)->references++;
    pthread_mutex_unlock(&cache->lock);
    if (*out)
        return STATUS_OK;
    path = cache_blob_path(cache, digest, 0);
    NEED(path, err, "a path");
    fd = open(path, O_RDONLY | O_CLOEXEC | O_NOFOLLOW);
    if (fd < 0) {
        /* For any reason that makes the file unusable, a new copy can be fetched. */
        if (errno != ENOENT)
            log_warn("%s: cannot be read: %s; fetching it again", path, strerror(errno));
        s = error_set(err, STATUS_ERR_NOT_FOUND, "%s: %s", path, strerror(errno));
        mem_free(path);
        return s;
    }
    s = cache_map_file(cache, fd, path, digest, out, err);
    if (s == STATUS_OK) {
        (void)futimens(fd, NULL);         *out = cache_add(cache, *out);
    }
    close(fd);
    mem_free(path);
    return s;
}

/* ---- life ------------------------------------------------------------------------------ */

/* Can files be created, listed and read there? */
static status folder_check(const char *folder, const char *temporaries, struct error *err)
{
    char *probe = file_join(temporaries, "probe-XXXXXX");
    status s = STATUS_OK;
    DIR *dir;
    int fd;

    NEED(probe, err, "a path");
    fd = mkostemp(probe, O_CLOEXEC);
    dir = opendir(folder);
    if (fd < 0 || !dir)
        s = error_set(err, STATUS_ERR_IO, "%s: the cache folder cannot be used: %s (choose another with --cache)",
                      folder, strerror(errno));
    if (dir)
        closedir(dir);
    if (fd >= 0) {
        close(fd);
        unlink(probe);
    }
    mem_free(probe);
    return s;
}

status blob_cache_open(struct blob_cache **out, const char *folder, uint64_t limit_bytes, struct error *err)
{
    struct blob_cache *cache = mem_calloc(1, sizeof *cache);
    char *temporaries = file_join(folder, "tmp");
    status s = STATUS_OK;

    *out = NULL;
    if (cache)
        cache->folder = mem_strdup(folder);
    if (!cache || !cache->folder || !temporaries) {
        s = error_no_memory(err, "the blob cache");
        goto failed;
    }
    cache->limit_bytes = limit_bytes;
    s = file_make_private_folder(temporaries, err);
    if (s != STATUS_OK) {
        error_prefix(err, "the cache folder cannot be used (choose another with --cache)");
        goto failed;
    }
    s = folder_check(folder, temporaries, err);
    if (s != STATUS_OK)
        goto failed;
    pthread_mutex_init(&cache->lock, NULL);
    cache_sweep_temporaries(temporaries);
    cache_sweep(cache);
    mem_free(temporaries);
    *out = cache;
    return STATUS_OK;
failed:
    mem_free(temporaries);
    if (cache)
        mem_free(cache->folder);
    mem_free(cache);
    return s;
}

uint64_t blob_cache_bytes(struct blob_cache *cache)
{
    uint64_t bytes;

    pthread_mutex_lock(&cache->lock);
    bytes = cache->stored_bytes;
    pthread_mutex_unlock(&cache->lock);
    return bytes;
}

void blob_cache_close(struct blob_cache *cache)
{
    if (!cache)
        return;
    for (size_t i = 0; i < CACHE_BUCKETS; i++) {
        while (cache->verified[i]) {
            struct verified *v = cache->verified[i];
            cache->verified[i] = v->chain;
            mem_free(v);
        }
    }
    pthread_mutex_destroy(&cache->lock);
    mem_free(cache->folder);
    mem_free(cache);
}
