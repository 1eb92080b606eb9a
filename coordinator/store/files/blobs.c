#include "coordinator/store/files/blobs.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "common/system/clock.h"
#include "common/system/file.h"
#include "common/system/log.h"
#include "common/base/memory.h"
#include "common/system/trash.h"
#include "coordinator/store/files/reserve.h"

struct upload {
    char *folder;                   /* the store's */
    struct buffer temporary, final; /* paths; `temporary` is empty once renamed */
    struct digest digest;
    struct digest_stream *stream;
    uint64_t total, size;
    int fd;
};

void blobs_path(const char *folder, const struct digest *digest, struct buffer *path)
{
    char hex[DIGEST_HEX_SIZE];

    digest_to_hex(digest, hex);
    buffer_printf(path, "%s/blobs/%.2s/%s", folder, hex, hex);
}

void blobs_clean(const char *folder)
{
    char *path = file_join(folder, "blobs/tmp");
    DIR *stream = path ? opendir(path) : NULL;
    const struct dirent *entry;

    while (stream && (entry = readdir(stream))) {
        char *file = entry->d_name[0] != '.' ? file_join(path, entry->d_name) : NULL;
        if (file)
            (void)trash_unlink(folder, file);
        mem_free(file);
    }
    if (stream)
        closedir(stream);
    mem_free(path);
}

/* Does the folder of blobs exist? If not, a missing file does not mean a missing blob. */
static int folder_is_there(const char *folder)
{
    char *path = file_join(folder, "blobs");
    int there = path && file_exists(path);

    mem_free(path);
    return there;
}

int blobs_find(const char *folder, const struct digest *digest, uint64_t *size_bytes)
{
    struct buffer path = BUFFER_INIT;
    struct stat info;
    int found = -1;

    *size_bytes = 0;
    blobs_path(folder, digest, &path);
    if (!buffer_ok(&path))
        errno = ENOMEM;
    else if (stat(buffer_text(&path), &info) == 0)
        found = S_ISREG(info.st_mode) != 0;
    else if (errno == ENOENT && folder_is_there(folder))
        found = 0;
    if (found == 1)
        *size_bytes = (uint64_t)info.st_size;
    buffer_release(&path);
    return found;
}

/* ---- ages ----------------------------------------------------------------------------------- */

/* A blob's age is its file's time of modification. Of looking at it and acting upon it. */
static pthread_mutex_t age_lock = PTHREAD_MUTEX_INITIALIZER;
static int64_t last_now;

static int64_t now_locked(void)
{
    struct timespec now;
    int64_t ns;

    clock_gettime(CLOCK_REALTIME, &now);
    ns = (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
    if (ns > last_now)
        last_now = ns;
    return last_now;
}

int64_t blobs_now(void)
{
    int64_t now;

    pthread_mutex_lock(&age_lock);
    now = now_locked();
    pthread_mutex_unlock(&age_lock);
    return now;
}

/* Nanoseconds since 1970; 0: not known. */
static int64_t age_of(const char *path)
{
    struct stat info;

    return stat(path, &info) == 0 ? (int64_t)info.st_mtim.tv_sec * 1000000000 + info.st_mtim.tv_nsec : 0;
}

static void times_now(struct timespec times[2])
{
    int64_t now = now_locked();

    times[0] = (struct timespec){.tv_nsec = UTIME_OMIT};
    times[1] = (struct timespec){.tv_sec = now / 1000000000, .tv_nsec = now % 1000000000};
}

int blobs_hold(const char *folder, const struct digest *digest, int64_t since_ns, uint64_t *size_bytes)
{
    struct buffer path = BUFFER_INIT;
    struct timespec times[2];
    int found, code;

    pthread_mutex_lock(&age_lock);
    found = blobs_find(folder, digest, size_bytes);
    code = errno;
    blobs_path(folder, digest, &path);
    if (found == 1 && buffer_ok(&path) && age_of(buffer_text(&path)) < since_ns) {
        times_now(times);
        if (utimensat(AT_FDCWD, buffer_text(&path), times, 0) != 0)
            log_debug("a blob's age cannot be noted: %s", strerror(errno));
    }
    buffer_release(&path);
    pthread_mutex_unlock(&age_lock);
    errno = code;
    return found;
}

int blobs_remove_older(const char *folder, const struct digest *digest, int64_t cutoff_ns, uint64_t *bytes)
{
    struct buffer path = BUFFER_INIT;
    struct stat info;
    int gone = 0;

    *bytes = 0;
    blobs_path(folder, digest, &path);
    pthread_mutex_lock(&age_lock);
    if (buffer_ok(&path) && stat(buffer_text(&path), &info) == 0) {
        *bytes = (uint64_t)info.st_blocks * 512;
        gone = (int64_t)info.st_mtim.tv_sec * 1000000000 + info.st_mtim.tv_nsec < cutoff_ns &&
               trash_unlink(folder, buffer_text(&path)) == 0;
    }
    pthread_mutex_unlock(&age_lock);
    buffer_release(&path);
    return gone;
}

status blobs_read(const char *folder, const struct digest *digest, size_t limit_bytes, struct buffer *out,
                  struct error *err)
{
    struct buffer path = BUFFER_INIT;
    struct digest found;
    size_t start = out->size;
    uint64_t size;
    status s;

    if (blobs_find(folder, digest, &size) == 0)
        return error_set(err, STATUS_ERR_NOT_FOUND, "the coordinator does not have this blob");
    blobs_path(folder, digest, &path);
    NEED(buffer_ok(&path), err, "a path");
    s = file_read_kept(buffer_text(&path), limit_bytes, out, err);
    if (s == STATUS_OK && digest_of(&found, out->data + start, out->size - start) != STATUS_OK)
        s = error_set(err, STATUS_ERR_INTERNAL, "no SHA-256");
    if (s == STATUS_OK && !digest_equal(&found, digest)) {
        s = error_set(err, STATUS_ERR_CORRUPT, "%s: was damaged on disk and has been removed; send it again",
                      buffer_text(&path));
        blobs_drop_damaged(folder, digest);
    }
    buffer_release(&path);
    return s;
}

int blobs_check(const char *folder, const struct digest *digest)
{
    struct buffer path = BUFFER_INIT;
    struct digest_stream *stream = digest_stream_new();
    struct digest found = {0};
    uint8_t bytes[16384];
    ssize_t got = -1;
    int fd, good = stream != NULL, ended = 0, result = -1;

    blobs_path(folder, digest, &path);
    fd = buffer_ok(&path) ? open(buffer_text(&path), O_RDONLY | O_CLOEXEC) : -1;
    while (good && fd >= 0 && (got = read(fd, bytes, sizeof bytes)) > 0)
        good = digest_stream_add(stream, bytes, (size_t)got) == STATUS_OK;
    ended = good && got == 0;
    if (!ended)
        digest_stream_free(stream);
    else if (digest_stream_final(stream, &found) == STATUS_OK)
        result = digest_equal(&found, digest);
    if (fd >= 0)
        close(fd);
    buffer_release(&path);
    return result;
}

/* Those that blobs_take_dropped will give. */
static struct digest dropped[BLOBS_DROPPED_MAX];
static uint32_t dropped_count;
static pthread_mutex_t dropped_lock = PTHREAD_MUTEX_INITIALIZER;

static void note_dropped(const char *folder, const struct digest *digest)
{
    uint64_t size;

    if (blobs_find(folder, digest, &size) != 1)
        return;
    pthread_mutex_lock(&dropped_lock);
    if (dropped_count < BLOBS_DROPPED_MAX)
        dropped[dropped_count++] = *digest;
    pthread_mutex_unlock(&dropped_lock);
}

void blobs_drop_damaged(const char *folder, const struct digest *digest)
{
    struct buffer path = BUFFER_INIT;

    blobs_path(folder, digest, &path);
    if (buffer_ok(&path)) {
        log_error("%s: was damaged on disk and is removed; it is taken again from a worker's cache, or when its scene is submitted",
                  buffer_text(&path));
        note_dropped(folder, digest);
        (void)trash_unlink(folder, buffer_text(&path));
    }
    buffer_release(&path);
}

int blobs_take_dropped(struct digest *out)
{
    int taken;

    pthread_mutex_lock(&dropped_lock);
    taken = dropped_count > 0;
    if (taken)
        *out = dropped[--dropped_count];
    pthread_mutex_unlock(&dropped_lock);
    return taken;
}

/* Blobs that were read and found good lately, at a place by their digest; later ones displace earlier ones. */
enum { CHECKED_MAX = 1 << 14 };
static struct {
    struct digest digest;
    uint64_t at_ns; /* 0: none */
} checked[CHECKED_MAX];
static pthread_mutex_t checked_lock = PTHREAD_MUTEX_INITIALIZER;

static size_t checked_place(const struct digest *digest)
{
    return ((size_t)digest->bytes[0] << 8 | digest->bytes[1]) % CHECKED_MAX;
}

static int was_checked(const struct digest *digest, uint64_t now_ns)
{
    size_t at = checked_place(digest);
    int was;

    pthread_mutex_lock(&checked_lock);
    was = checked[at].at_ns && digest_equal(&checked[at].digest, digest) &&
          now_ns - checked[at].at_ns < BLOB_CHECKED_S * NS_PER_SECOND;
    pthread_mutex_unlock(&checked_lock);
    return was;
}

static void note_checked(const struct digest *digest, uint64_t at_ns)
{
    size_t at = checked_place(digest);

    pthread_mutex_lock(&checked_lock);
    checked[at].digest = *digest;
    checked[at].at_ns = at_ns;
    pthread_mutex_unlock(&checked_lock);
}

int blobs_vouch(const char *folder, const struct digest *digest, int64_t since_ns, uint64_t *size_bytes)
{
    int found = blobs_hold(folder, digest, since_ns, size_bytes);
    uint64_t now_ns = clock_monotonic_ns();

    if (found != 1 || was_checked(digest, now_ns))
        return found;
    switch (blobs_check(folder, digest)) {
    case 0: blobs_drop_damaged(folder, digest); return 0;
    case 1: note_checked(digest, now_ns ? now_ns : 1); return 1;
    default: return found;
    }
}

/* ---- uploads -------------------------------------------------------------------------------- */

status upload_begin(struct upload **out, const char *folder, const struct digest *digest, uint64_t total_bytes,
                    struct error *err)
{
    struct upload *upload = mem_calloc(1, sizeof *upload);
    char hex[DIGEST_HEX_SIZE];
    status s = STATUS_OK;

    *out = NULL;
    NEED(upload, err, "an upload");
    upload->fd = -1;
    upload->digest = *digest;
    upload->total = total_bytes;
    upload->folder = mem_strdup(folder);
    upload->stream = digest_stream_new();
    digest_to_hex(digest, hex);
    blobs_path(folder, digest, &upload->final);
    buffer_printf(&upload->temporary, "%s/blobs/tmp/%.16s.XXXXXX", folder, hex);
    if (!upload->folder || !upload->stream || !buffer_ok(&upload->final) || !buffer_ok(&upload->temporary)) {
        buffer_clear(&upload->temporary);
        s = error_no_memory(err, "an upload");
    } else {
        upload->fd = mkostemp((char *)upload->temporary.data, O_CLOEXEC);
        if (upload->fd < 0) {
            s = error_set(err, STATUS_ERR_IO, "%s/blobs/tmp: cannot be written: %s", folder, strerror(errno));
            buffer_clear(&upload->temporary);
        } else if (!reserve_allows(upload->fd)) {
            s = error_set(err, STATUS_ERR_IO, "%s/blobs/tmp: cannot be written: %s", folder, strerror(EMFILE));
        }
    }
    if (s != STATUS_OK) {
        upload_free(upload);
        return s;
    }
    *out = upload;
    return STATUS_OK;
}

const struct digest *upload_digest(const struct upload *upload) { return &upload->digest; }

uint64_t upload_total(const struct upload *upload) { return upload->total; }

uint64_t upload_size(const struct upload *upload) { return upload->size; }

status upload_add(struct upload *upload, const void *data, size_t size_bytes, struct error *err)
{
    const uint8_t *at = data;
    size_t left = size_bytes;

    if (size_bytes > upload->total - upload->size)
        return error_set(err, STATUS_ERR_PROTOCOL, "a blob is longer than its announced size");
    if (digest_stream_add(upload->stream, data, size_bytes) != STATUS_OK)
        return error_set(err, STATUS_ERR_INTERNAL, "no SHA-256");
    while (left > 0) {
        ssize_t put = write(upload->fd, at, left);
        if (put < 0 && errno == EINTR)
            continue;
        if (put < 0)
            return error_set(err, STATUS_ERR_IO, "%s: cannot be written: %s", buffer_text(&upload->temporary),
                             strerror(errno));
        at += put;
        left -= (size_t)put;
    }
    upload->size += size_bytes;
    return STATUS_OK;
}

status upload_finish(struct upload *upload, struct error *err)
{
    struct digest found;
    struct timespec times[2];
    char *folder;
    status s = digest_stream_final(upload->stream, &found);

    upload->stream = NULL;
    if (s != STATUS_OK)
        return error_set(err, STATUS_ERR_INTERNAL, "no SHA-256");
    if (upload->size != upload->total || !digest_equal(&found, &upload->digest))
        return error_set(err, STATUS_ERR_INPUT, "a blob's bytes do not have the SHA-256 that it was announced with");
    folder = file_dirname(buffer_text(&upload->final));
    NEED(folder, err, "a path");
    s = file_make_private_folder(folder, err);
    pthread_mutex_lock(&age_lock);
    times_now(times);
    pthread_mutex_unlock(&age_lock);
    if (futimens(upload->fd, times) != 0) /* else it has the time of its last bytes, by a coarser clock */
        log_debug("a blob's age cannot be noted: %s", strerror(errno));
    if (s == STATUS_OK &&
        (file_sync(upload->fd) != 0 || rename(buffer_text(&upload->temporary), buffer_text(&upload->final)) != 0))
        s = error_set(err, STATUS_ERR_IO, "%s: cannot be written: %s", buffer_text(&upload->final), strerror(errno));
    if (s == STATUS_OK) {
        buffer_clear(&upload->temporary);
        s = file_sync_folder_of(buffer_text(&upload->final), err);
    }
    mem_free(folder);
    return s;
}

void upload_free(struct upload *upload)
{
    if (!upload)
        return;
    if (upload->fd >= 0)
        close(upload->fd);
    if (upload->temporary.size > 0)
        (void)trash_unlink(upload->folder, buffer_text(&upload->temporary));
    digest_stream_free(upload->stream);
    buffer_release(&upload->temporary);
    buffer_release(&upload->final);
    mem_free(upload->folder);
    mem_free(upload);
}
