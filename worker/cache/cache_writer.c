#include "worker/cache/cache_writer.h"

#include <errno.h>
#include <fcntl.h>
#include <stdatomic.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "common/system/log.h"
#include "common/base/memory.h"
#include "worker/cache/blob_cache_parts.h"

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

void blob_cache_fault_disk_full(int on) { atomic_store(&disk_full, on); }

static ssize_t disk_write(int fd, const void *data, size_t size_bytes)
{
    if (atomic_load_explicit(&disk_full, memory_order_relaxed)) {
        errno = ENOSPC;
        return -1;
    }
    return write(fd, data, size_bytes);
}

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

/* The disk accepts no more: continue in memory, with what the file has so far. */
static status writer_to_memory(struct cache_writer *w, const char *why, struct error *err)
{
    uint64_t at = 0;

    log_warn("%s: %s; a blob of %llu bytes is kept in memory only", w->cache->folder, why,
             (unsigned long long)w->total_bytes);
    if (w->total_bytes > 0) {
        w->data = mmap(NULL, (size_t)w->total_bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
        if (w->data == MAP_FAILED) {
            w->data = NULL;
            return error_set(err, STATUS_ERR_NO_MEMORY, "neither disk nor memory for a blob of %llu bytes",
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

status cache_writer_new(struct cache_writer **out, struct blob_cache *cache, const struct digest *digest,
                        uint64_t total_bytes, struct error *err)
{
    size_t size = strlen(cache->folder) + CACHE_PATH_ROOM;
    struct cache_writer *w = mem_calloc(1, sizeof *w);
    char host[32] = "host";
    uint64_t number;
    status s = STATUS_OK;

    *out = NULL;
    NEED(w, err, "a blob being received");
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
    snprintf(w->path, size, "%s/tmp/%.31s-%ld-%llu", cache->folder, host, (long)getpid(), (unsigned long long)number);
    /* O_EXCL: two containers that share a folder may have the same host name and process number. */
    w->fd = open(w->path, O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, 0600);
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

status cache_writer_add(struct cache_writer *w, const void *data, size_t size_bytes, struct error *err)
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
            TRY(writer_to_memory(w, strerror(errno), err));
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

uint64_t cache_writer_bytes(const struct cache_writer *w) { return w->got_bytes; }

/* Move the finished file to its place. The blob that is mapped from it is usable even if the rename fails. */
static void writer_publish(struct cache_writer *w)
{
    char *folder = cache_blob_path(w->cache, &w->digest, 1);
    char *path = cache_blob_path(w->cache, &w->digest, 0);
    uint64_t stored;

    if (!folder || !path)
        goto done;
    /* No fsync: after a power failure a file may be short, and its digest will reveal it. */
    if ((mkdir(folder, 0700) != 0 && errno != EEXIST) || rename(w->path, path) != 0) {
        log_warn("%s: cannot be put into the cache: %s", path, strerror(errno));
        goto done;
    }
    mem_free(w->path);
    w->path = NULL;
    pthread_mutex_lock(&w->cache->lock);
    stored = w->cache->stored_bytes += w->total_bytes;
    pthread_mutex_unlock(&w->cache->lock);
    if (stored > w->cache->limit_bytes)
        cache_sweep(w->cache);
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
        s = error_set(err, STATUS_ERR_CORRUPT, "a blob of %llu bytes arrived damaged: its SHA-256 is not its name",
                      (unsigned long long)w->got_bytes);
        goto done;
    }
    if (w->fd < 0) {
        *out = cached_blob_new(w->cache, &w->digest, w->data, (size_t)w->total_bytes);
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
    cache_remember_verified(w->cache, &w->digest, &info);
    s = cache_map_file(w->cache, w->fd, w->path, &w->digest, out, err);
    if (s == STATUS_OK)
        writer_publish(w);
done:
    if (*out)
        *out = cache_add(w->cache, *out);
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
