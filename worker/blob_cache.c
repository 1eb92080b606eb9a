#include "worker/blob_cache.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "common/base/file.h"
#include "common/base/log.h"
#include "common/base/memory.h"

enum {
    BUCKETS = 4096,
    TEMPORARY_AGE_S = 3600, /* an older file being received was left by a crash */
    PATH_ROOM = 96,         /* what follows the folder's name in a path */
};

struct cached_blob {
    struct blob_cache *cache;
    struct cached_blob *chain; /* in its hash bucket */
    struct digest digest;
    const uint8_t *data;
    size_t size_bytes;
    int mapped;                /* munmap it */
    unsigned references;       /* under the cache's lock */
};

/* What this process has hashed once need not be hashed again while the file is the same. */
struct verified {
    struct verified *chain;
    struct digest digest;
    dev_t device;
    ino_t inode;
};

struct blob_cache {
    pthread_mutex_t lock;
    char *folder;
    uint64_t limit_bytes;
    uint64_t stored_bytes; /* files, as of the last sweep and with what was stored since */
    uint64_t temporary_count;
    struct cached_blob *live[BUCKETS];
    struct verified *verified[BUCKETS];
};

struct cache_writer {
    struct blob_cache *cache;
    struct digest digest;
    struct digest_stream *stream;
    uint64_t total_bytes, got_bytes;
    int fd;        /* -1: in memory */
    char *path;    /* of the temporary file; NULL: in memory */
    uint8_t *data; /* in memory: an anonymous mapping of total_bytes */
};

static atomic_int disk_full;

void blob_cache_fault_disk_full(int on)
{
    atomic_store(&disk_full, on);
}

static ssize_t disk_write(int fd, const void *data, size_t size_bytes)
{
    if (atomic_load_explicit(&disk_full, memory_order_relaxed)) {
        errno = ENOSPC;
        return -1;
    }
    return write(fd, data, size_bytes);
}

static size_t bucket_of(const struct digest *d)
{
    return ((size_t)d->bytes[0] << 8 | d->bytes[1]) % BUCKETS;
}

/* FOLDER/ab/cdef... ; NULL: out of memory. */
static char *blob_path(const struct blob_cache *cache, const struct digest *digest, int folder_only)
{
    size_t size = strlen(cache->folder) + PATH_ROOM;
    char hex[DIGEST_HEX_SIZE], *path = mem_alloc(size);

    digest_to_hex(digest, hex);
    if (path)
        snprintf(path, size, "%s/%.2s%s%s", cache->folder, hex, folder_only ? "" : "/",
                 folder_only ? "" : hex + 2);
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

static struct cached_blob *blob_new(struct blob_cache *cache, const struct digest *digest,
                                    const uint8_t *data, size_t size_bytes)
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

/* Make it findable. If another thread was faster, its blob is taken and ours dropped. */
static struct cached_blob *live_add(struct blob_cache *cache, struct cached_blob *blob)
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

const struct digest *cached_blob_digest(const struct cached_blob *blob)
{
    return &blob->digest;
}

const uint8_t *cached_blob_data(const struct cached_blob *blob)
{
    return blob->data;
}

size_t cached_blob_size(const struct cached_blob *blob)
{
    return blob->size_bytes;
}

/* ---- files ----------------------------------------------------------------------------- */

static int is_verified(struct blob_cache *cache, const struct digest *digest,
                       const struct stat *info)
{
    struct verified *v;

    pthread_mutex_lock(&cache->lock);
    v = cache->verified[bucket_of(digest)];
    while (v && !(digest_equal(&v->digest, digest) && v->device == info->st_dev &&
                  v->inode == info->st_ino))
        v = v->chain;
    pthread_mutex_unlock(&cache->lock);
    return v != NULL;
}

/* Failing to remember only costs another hashing. */
static void remember_verified(struct blob_cache *cache, const struct digest *digest,
                              const struct stat *info)
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

/* Map the open file and see that it is what its name says. */
static status map_file(struct blob_cache *cache, int fd, const char *path,
                       const struct digest *digest, struct cached_blob **out, struct error *err)
{
    struct stat info;
    struct digest actual;
    void *data = NULL;
    size_t size;

    if (fstat(fd, &info) != 0)
        return error_set(err, STATUS_ERR_IO, "%s: %s", path, strerror(errno));
    if (!S_ISREG(info.st_mode)) {
        log_warn("%s: is no file; the blob is fetched anew", path);
        return error_set(err, STATUS_ERR_NOT_FOUND, "%s: is no file", path);
    }
    size = (size_t)info.st_size;
    if (size > 0) {
        data = mmap(NULL, size, PROT_READ, MAP_PRIVATE, fd, 0);
        if (data == MAP_FAILED)
            return error_set(err, STATUS_ERR_NO_MEMORY, "%s: cannot be mapped: %s", path,
                             strerror(errno));
    }
    if (!is_verified(cache, digest, &info)) {
        status s = digest_of(&actual, data ? data : "", size);
        if (s != STATUS_OK || !digest_equal(&actual, digest)) {
            if (data)
                munmap(data, size);
            if (s != STATUS_OK)
                return error_set(err, s, "%s: cannot be hashed", path);
            log_warn("%s: damaged; removed, and fetched anew", path);
            if (unlink(path) != 0 && errno != ENOENT)
                return error_set(err, STATUS_ERR_IO, "%s: damaged, and cannot be removed: %s",
                                 path, strerror(errno));
            return error_set(err, STATUS_ERR_NOT_FOUND, "%s: damaged", path);
        }
        remember_verified(cache, digest, &info);
    }
    *out = blob_new(cache, digest, data, size);
    if (!*out) {
        if (data)
            munmap(data, size);
        return error_no_memory(err, path);
    }
    return STATUS_OK;
}

status blob_cache_get(struct blob_cache *cache, const struct digest *digest,
                      struct cached_blob **out, struct error *err)
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
    path = blob_path(cache, digest, 0);
    if (!path)
        return error_no_memory(err, "a path");
    fd = open(path, O_RDONLY | O_CLOEXEC | O_NOFOLLOW);
    if (fd < 0) {
        /* Whatever keeps the file from us: a fresh copy can be fetched. */
        if (errno != ENOENT)
            log_warn("%s: cannot be read: %s; fetched anew", path, strerror(errno));
        s = error_set(err, STATUS_ERR_NOT_FOUND, "%s: %s", path, strerror(errno));
        mem_free(path);
        return s;
    }
    s = map_file(cache, fd, path, digest, out, err);
    if (s == STATUS_OK) {
        (void)futimens(fd, NULL); /* used now; on a read-only cache it just ages */
        *out = live_add(cache, *out);
    }
    close(fd);
    mem_free(path);
    return s;
}

/* ---- the size limit -------------------------------------------------------------------- */

struct cache_file {
    char path[PATH_ROOM]; /* below the cache's folder */
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

/* Count what is there; above the limit, remove the least recently used files until a tenth of
 * it is free again, so that not every new blob sweeps. Other processes may do the same at the
 * same time: a file that is already gone is no matter. */
static void sweep(struct blob_cache *cache)
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
        log_debug("%s: removed %zu least recently used blobs, %llu bytes are left", cache->folder,
                  removed, (unsigned long long)total);
    }
    pthread_mutex_lock(&cache->lock);
    cache->stored_bytes = total;
    pthread_mutex_unlock(&cache->lock);
    mem_free(list.files);
    close(fd);
}

static void sweep_temporaries(const char *folder)
{
    DIR *dir = opendir(folder);
    struct dirent *entry;
    time_t now = time(NULL);

    if (!dir)
        return;
    while ((entry = readdir(dir)) != NULL) {
        struct stat info;
        if (entry->d_name[0] != '.' && fstatat(dirfd(dir), entry->d_name, &info, 0) == 0 &&
            S_ISREG(info.st_mode) && now - info.st_mtime > TEMPORARY_AGE_S)
            unlinkat(dirfd(dir), entry->d_name, 0);
    }
    closedir(dir);
}

/* ---- life ------------------------------------------------------------------------------ */

/* Can files be made, listed and read there? */
static status folder_check(const char *folder, const char *temporaries, struct error *err)
{
    char *probe = file_join(temporaries, "probe-XXXXXX");
    status s = STATUS_OK;
    DIR *dir;
    int fd;

    if (!probe)
        return error_no_memory(err, "a path");
    fd = mkostemp(probe, O_CLOEXEC);
    dir = opendir(folder);
    if (fd < 0 || !dir)
        s = error_set(err, STATUS_ERR_IO,
                      "%s: the cache folder cannot be used: %s (choose another with --cache)",
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

status blob_cache_open(struct blob_cache **out, const char *folder, uint64_t limit_bytes,
                       struct error *err)
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
    s = file_make_folder(temporaries, err);
    if (s != STATUS_OK) {
        error_prefix(err, "the cache folder cannot be used (choose another with --cache)");
        goto failed;
    }
    s = folder_check(folder, temporaries, err);
    if (s != STATUS_OK)
        goto failed;
    pthread_mutex_init(&cache->lock, NULL);
    sweep_temporaries(temporaries);
    sweep(cache);
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

void blob_cache_close(struct blob_cache *cache)
{
    if (!cache)
        return;
    for (size_t i = 0; i < BUCKETS; i++) {
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

/* ---- receiving ------------------------------------------------------------------------- */

static void writer_drop_file(struct cache_writer *w)
{
    if (w->fd >= 0)
        close(w->fd);
    w->fd = -1;
    if (w->path)
        unlink(w->path);
    mem_free(w->path);
    w->path = NULL;
}

/* The disk takes no more: go on in memory, with what the file has so far. */
static status writer_to_memory(struct cache_writer *w, const char *why, struct error *err)
{
    uint64_t at = 0;

    log_warn("%s: %s; a blob of %llu bytes is kept in memory only", w->cache->folder, why,
             (unsigned long long)w->total_bytes);
    if (w->total_bytes > 0) {
        w->data = mmap(NULL, (size_t)w->total_bytes, PROT_READ | PROT_WRITE,
                       MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
        if (w->data == MAP_FAILED) {
            w->data = NULL;
            return error_set(err, STATUS_ERR_NO_MEMORY,
                             "no disk and no memory for a blob of %llu bytes",
                             (unsigned long long)w->total_bytes);
        }
    }
    while (at < w->got_bytes) {
        ssize_t got = pread(w->fd, w->data + at, (size_t)(w->got_bytes - at), (off_t)at);
        if (got < 0 && errno == EINTR)
            continue;
        if (got <= 0)
            return error_set(err, STATUS_ERR_IO, "%s: cannot be read back: %s", w->path,
                             got < 0 ? strerror(errno) : "it is too short");
        at += (uint64_t)got;
    }
    writer_drop_file(w);
    return STATUS_OK;
}

status cache_writer_new(struct cache_writer **out, struct blob_cache *cache,
                        const struct digest *digest, uint64_t total_bytes, struct error *err)
{
    size_t size = strlen(cache->folder) + PATH_ROOM;
    struct cache_writer *w = mem_calloc(1, sizeof *w);
    char host[32] = "host";
    uint64_t number;
    status s = STATUS_OK;

    *out = NULL;
    if (!w)
        return error_no_memory(err, "a blob being received");
    w->fd = -1;
    w->cache = cache;
    w->digest = *digest;
    w->total_bytes = total_bytes;
    w->stream = digest_stream_new();
    w->path = mem_alloc(size);
    if (!w->stream || !w->path || total_bytes > SIZE_MAX / 2) {
        s = error_no_memory(err, "a blob being received");
        mem_free(w->path);
        w->path = NULL;
        cache_writer_abandon(w);
        return s;
    }
    pthread_mutex_lock(&cache->lock);
    number = cache->temporary_count++;
    pthread_mutex_unlock(&cache->lock);
    (void)gethostname(host, sizeof host - 1);
    snprintf(w->path, size, "%s/tmp/%.31s-%ld-%llu", cache->folder, host, (long)getpid(),
             (unsigned long long)number);
    /* O_EXCL: two containers on one folder may have the same host name and process number. */
    w->fd = open(w->path, O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, 0666);
    if (w->fd < 0) {
        int code = errno;
        mem_free(w->path);
        w->path = NULL;
        s = writer_to_memory(w, strerror(code), err);
    }
    if (s != STATUS_OK) {
        cache_writer_abandon(w);
        return s;
    }
    *out = w;
    return STATUS_OK;
}

status cache_writer_add(struct cache_writer *w, const void *data, size_t size_bytes,
                        struct error *err)
{
    const uint8_t *at = data;
    status s;

    if (size_bytes > w->total_bytes - w->got_bytes)
        return error_set(err, STATUS_ERR_CORRUPT, "a blob is longer than its %llu bytes",
                         (unsigned long long)w->total_bytes);
    s = digest_stream_add(w->stream, data, size_bytes);
    if (s != STATUS_OK)
        return error_set(err, s, "a blob cannot be hashed");
    while (w->fd >= 0 && size_bytes > 0) {
        ssize_t put = disk_write(w->fd, at, size_bytes);
        if (put < 0 && errno == EINTR)
            continue;
        if (put < 0) {
            s = writer_to_memory(w, strerror(errno), err);
            if (s != STATUS_OK)
                return s;
            break;
        }
        at += put;
        w->got_bytes += (uint64_t)put;
        size_bytes -= (size_t)put;
    }
    if (size_bytes > 0) {
        memcpy(w->data + w->got_bytes, at, size_bytes);
        w->got_bytes += size_bytes;
    }
    return STATUS_OK;
}

uint64_t cache_writer_bytes(const struct cache_writer *w)
{
    return w->got_bytes;
}

/* Put the finished file in its place. The blob that is mapped from it is good even if the
 * rename fails. */
static void writer_publish(struct cache_writer *w)
{
    char *folder = blob_path(w->cache, &w->digest, 1), *path = blob_path(w->cache, &w->digest, 0);
    uint64_t stored;

    if (!folder || !path)
        goto done;
    /* No fsync: after a power cut a file may be short, and its digest will say so. */
    if ((mkdir(folder, 0777) != 0 && errno != EEXIST) || rename(w->path, path) != 0) {
        log_warn("%s: cannot be put into the cache: %s", path, strerror(errno));
        goto done;
    }
    mem_free(w->path);
    w->path = NULL;
    pthread_mutex_lock(&w->cache->lock);
    stored = w->cache->stored_bytes += w->total_bytes;
    pthread_mutex_unlock(&w->cache->lock);
    if (stored > w->cache->limit_bytes)
        sweep(w->cache);
done:
    mem_free(folder);
    mem_free(path);
}

status cache_writer_finish(struct cache_writer *w, struct cached_blob **out, struct error *err)
{
    struct digest actual;
    struct stat info;
    struct digest_stream *stream = w->stream;
    status s;

    *out = NULL;
    w->stream = NULL;
    s = digest_stream_final(stream, &actual);
    if (s != STATUS_OK) {
        (void)error_set(err, s, "a blob cannot be hashed");
        goto done;
    }
    if (w->got_bytes != w->total_bytes || !digest_equal(&actual, &w->digest)) {
        s = error_set(err, STATUS_ERR_CORRUPT,
                      "a blob of %llu bytes arrived damaged: its SHA-256 is not its name",
                      (unsigned long long)w->got_bytes);
        goto done;
    }
    if (w->fd < 0) {
        *out = blob_new(w->cache, &w->digest, w->data, (size_t)w->total_bytes);
        if (*out)
            w->data = NULL;
        else
            s = error_no_memory(err, "a blob");
        goto done;
    }
    if (fstat(w->fd, &info) != 0) {
        s = error_set(err, STATUS_ERR_IO, "%s: %s", w->path, strerror(errno));
        goto done;
    }
    remember_verified(w->cache, &w->digest, &info);
    s = map_file(w->cache, w->fd, w->path, &w->digest, out, err);
    if (s == STATUS_OK)
        writer_publish(w);
done:
    if (*out)
        *out = live_add(w->cache, *out);
    cache_writer_abandon(w);
    return s;
}

void cache_writer_abandon(struct cache_writer *w)
{
    if (!w)
        return;
    writer_drop_file(w);
    if (w->data)
        munmap(w->data, (size_t)w->total_bytes);
    digest_stream_free(w->stream);
    mem_free(w);
}
