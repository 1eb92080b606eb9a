/* The SHA-256 of a frame's outputs, in a small file beside them, and which of them were found damaged.
 *
 * outputs/JOB/frame-NNNN.sums: a line "HEX EXTENSION\n" for each output, and last "HEX\n" of the lines before it.
 *
 * Outputs are written first, then the lines of all of them, by one file a frame; until then these wait in memory. A crash
 * between the two harms nothing: the frame is noted as done, or as developed, after both, so the next start writes it again. Outputs of older stores have no line, and are not checked. */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/system/file.h"
#include "common/system/log.h"
#include "common/base/memory.h"
#include "coordinator/store/store_parts.h"

enum { SUMS_BYTES_MAX = 4096 };

/* Of an output that was written, until its frame's digests are. */
struct output_sum {
    uint64_t job;
    uint32_t frame;
    char extension[16];
    struct digest digest;
};

struct damage {
    pthread_mutex_t writing; /* of the files; held while the disk may hang */
    pthread_mutex_t lock; /* of what follows; taken after `writing`, and never held while a file is read or written */
    struct output_sum *waiting;
    size_t waiting_count, waiting_capacity;
    struct damaged_output *items;
    size_t count, capacity;
};

struct damage *damage_new(void)
{
    struct damage *d = mem_calloc(1, sizeof *d);

    if (d) {
        pthread_mutex_init(&d->writing, NULL);
        pthread_mutex_init(&d->lock, NULL);
    }
    return d;
}

void damage_free(struct damage *d)
{
    if (!d)
        return;
    pthread_mutex_destroy(&d->lock);
    pthread_mutex_destroy(&d->writing);
    mem_free(d->items);
    mem_free(d->waiting);
    mem_free(d);
}

/* ---- sums ------------------------------------------------------------------------------------ */

/* Do the lines end with their own digest? Without it they are shortened by it. */
static int take_seal(struct buffer *lines)
{
    size_t seal = DIGEST_HEX_SIZE; /* with its newline */
    struct digest is;
    char hex[DIGEST_HEX_SIZE];

    if (lines->size < seal || digest_of(&is, lines->data, lines->size - seal) != STATUS_OK)
        return 0;
    digest_to_hex(&is, hex);
    if (memcmp(hex, lines->data + lines->size - seal, seal - 1) != 0 || lines->data[lines->size - 1] != '\n')
        return 0;
    lines->size -= seal;
    return 1;
}

enum sums_state sums_read(const char *path, struct buffer *lines)
{
    struct error err = {0};
    status s = file_exists(path) ? file_read(path, SUMS_BYTES_MAX, lines, &err) : STATUS_ERR_NOT_FOUND;

    if (s == STATUS_ERR_NOT_FOUND)
        return SUMS_NONE;
    if (s != STATUS_OK)
        return s == STATUS_ERR_LIMIT ? SUMS_DAMAGED : SUMS_UNREADABLE;
    return take_seal(lines) ? SUMS_GOOD : SUMS_DAMAGED;
}

/* The line of that extension, with its newline; 0: there is none. */
static size_t find_line(const struct buffer *lines, const char *extension, size_t *at)
{
    size_t length = strlen(extension);

    for (size_t i = 0; i < lines->size;) {
        const uint8_t *end = memchr(lines->data + i, '\n', lines->size - i);
        size_t size = end ? (size_t)(end - lines->data) + 1 - i : lines->size - i;
        if (size == DIGEST_HEX_SIZE + length + 1 && memcmp(lines->data + i + DIGEST_HEX_SIZE, extension, length) == 0) {
            *at = i;
            return size;
        }
        i += size;
    }
    return 0;
}

int sums_next(const struct buffer *lines, size_t *at, struct digest *digest, char *extension, size_t size)
{
    char hex[DIGEST_HEX_SIZE] = {0};
    const uint8_t *end = *at < lines->size ? memchr(lines->data + *at, '\n', lines->size - *at) : NULL;
    size_t length = end ? (size_t)(end - lines->data) - *at : 0;

    if (length <= DIGEST_HEX_SIZE || length - DIGEST_HEX_SIZE >= size)
        return 0;
    memcpy(hex, lines->data + *at, DIGEST_HEX_SIZE - 1);
    memcpy(extension, lines->data + *at + DIGEST_HEX_SIZE, length - DIGEST_HEX_SIZE);
    extension[length - DIGEST_HEX_SIZE] = 0;
    *at += length + 1;
    return digest_from_hex(digest, hex) == STATUS_OK;
}

static void sums_path(const struct store *store, uint64_t job, uint32_t frame, struct buffer *path)
{
    store_output_path(store, job, frame, SUMS_EXTENSION, path);
}

static void set_line(struct buffer *lines, const struct output_sum *sum)
{
    char hex[DIGEST_HEX_SIZE];
    size_t at = 0, size = find_line(lines, sum->extension, &at);

    if (size > 0) {
        memmove(lines->data + at, lines->data + at + size, lines->size - at - size);
        lines->size -= size;
    }
    digest_to_hex(&sum->digest, hex);
    buffer_printf(lines, "%s %s\n", hex, sum->extension);
}

/* What of a job waited, as it was taken to be written. */
struct taken {
    struct output_sum *sums;
    size_t count, capacity;
};

/* Write a frame's digests. `writing` is held. Lines that are damaged are forgotten: their outputs count as damaged until
 * they are written again. */
static status write_sums(const struct store *store, uint64_t job, uint32_t frame, const struct taken *taken,
                         struct error *err)
{
    struct buffer path = BUFFER_INIT, lines = BUFFER_INIT;
    struct digest seal;
    char hex[DIGEST_HEX_SIZE];
    status s = STATUS_OK;

    sums_path(store, job, frame, &path);
    if (buffer_ok(&path) && sums_read(buffer_text(&path), &lines) != SUMS_GOOD)
        buffer_clear(&lines);
    for (size_t i = 0; i < taken->count; i++)
        if (taken->sums[i].frame == frame)
            set_line(&lines, &taken->sums[i]);
    if (!buffer_ok(&path) || !buffer_ok(&lines) || digest_of(&seal, lines.data, lines.size) != STATUS_OK)
        s = error_no_memory(err, "a digest");
    if (s == STATUS_OK) {
        digest_to_hex(&seal, hex);
        buffer_printf(&lines, "%s\n", hex);
        s = buffer_ok(&lines) ? file_write_one_of_many(buffer_text(&path), lines.data, lines.size, err)
                              : error_no_memory(err, "a digest");
    }
    buffer_release(&lines);
    buffer_release(&path);
    return s;
}

/* The waiting digest of an output; NULL: there is none. `lock` is held. */
static struct output_sum *find_waiting(const struct damage *d, uint64_t job, uint32_t frame, const char *extension)
{
    for (size_t i = 0; i < d->waiting_count; i++)
        if (d->waiting[i].job == job && d->waiting[i].frame == frame && strcmp(d->waiting[i].extension, extension) == 0)
            return &d->waiting[i];
    return NULL;
}

static status take(struct damage *d, uint64_t job, struct taken *taken, struct error *err)
{
    int good = 1;

    pthread_mutex_lock(&d->lock);
    for (size_t i = 0; i < d->waiting_count && good; i++) {
        if (d->waiting[i].job != job)
            continue;
        good = MEM_GROW(taken->sums, taken->capacity, taken->count + 1);
        if (good)
            taken->sums[taken->count++] = d->waiting[i];
    }
    pthread_mutex_unlock(&d->lock);
    return good ? STATUS_OK : error_no_memory(err, "a digest");
}

/* The frame's digests are on disk. One that came meanwhile goes on waiting. */
static void settle(struct damage *d, uint32_t frame, const struct taken *taken)
{
    pthread_mutex_lock(&d->lock);
    for (size_t i = 0; i < taken->count; i++) {
        const struct output_sum *sum = &taken->sums[i];
        struct output_sum *is = sum->frame == frame ? find_waiting(d, sum->job, frame, sum->extension) : NULL;
        if (is && digest_equal(&is->digest, &sum->digest))
            *is = d->waiting[--d->waiting_count];
    }
    pthread_mutex_unlock(&d->lock);
}

status sums_note(const struct store *store, uint64_t job, uint32_t frame, const char *extension,
                 const struct buffer *data, struct error *err)
{
    struct damage *d = store->damage;
    struct output_sum sum = {.job = job, .frame = frame}, *was;
    status s = digest_of(&sum.digest, data->data, data->size);

    NEED(s == STATUS_OK, err, "a digest");
    snprintf(sum.extension, sizeof sum.extension, "%s", extension);
    pthread_mutex_lock(&d->lock);
    was = find_waiting(d, job, frame, extension);
    if (was)
        *was = sum;
    else if (MEM_GROW(d->waiting, d->waiting_capacity, d->waiting_count + 1))
        d->waiting[d->waiting_count++] = sum;
    else
        s = error_no_memory(err, "a digest");
    pthread_mutex_unlock(&d->lock);
    return s;
}

status sums_write(const struct store *store, uint64_t job, struct error *err)
{
    struct damage *d = store->damage;
    struct taken taken = {0};
    status s;

    pthread_mutex_lock(&d->writing);
    s = take(d, job, &taken, err);
    for (size_t i = 0; i < taken.count && s == STATUS_OK; i++) {
        const uint32_t frame = taken.sums[i].frame;
        size_t first = 0;

        while (taken.sums[first].frame != frame)
            first++;
        if (first < i)
            continue; /* written with that one */
        s = write_sums(store, job, frame, &taken, err);
        if (s == STATUS_OK)
            settle(d, frame, &taken);
    }
    pthread_mutex_unlock(&d->writing);
    mem_free(taken.sums);
    return s;
}

/* ---- what is damaged ------------------------------------------------------------------------- */

static void damage_note(struct damage *d, const struct damaged_output *found)
{
    pthread_mutex_lock(&d->lock);
    for (size_t i = 0; i < d->count; i++) {
        if (d->items[i].job != found->job || d->items[i].frame != found->frame)
            continue;
        d->items[i].is_display &= found->is_display;
        pthread_mutex_unlock(&d->lock);
        return;
    }
    if (MEM_GROW(d->items, d->capacity, d->count + 1)) /* else it is found again */
        d->items[d->count++] = *found;
    pthread_mutex_unlock(&d->lock);
}

int store_damage_take(struct store *store, struct damaged_output *out)
{
    struct damage *d = store->damage;
    int there;

    pthread_mutex_lock(&d->lock);
    there = d->count > 0;
    if (there)
        *out = d->items[--d->count];
    pthread_mutex_unlock(&d->lock);
    return there;
}

/* What becomes of it (coordinator/steering/remake.h), in words. */
static status say_damaged(const struct store *store, uint64_t job, uint32_t frame, const char *extension,
                          int is_display, struct error *err)
{
    if (store_film_exists(store, job, frame))
        return error_set(err, STATUS_ERR_CORRUPT,
                         "job %" PRIu64 ", frame %u: its %s file was damaged on the coordinator's disk and is made again "
                         "from its film, with the same bits: ask again in a moment",
                         job, frame, extension);
    if (is_display)
        return error_set(err, STATUS_ERR_CORRUPT,
                         "job %" PRIu64 ", frame %u: its %s file was damaged on the coordinator's disk and is developed "
                         "again: ask again in a moment",
                         job, frame, extension);
    return error_set(err, STATUS_ERR_CORRUPT,
                     "job %" PRIu64 ", frame %u: its %s file was damaged on the coordinator's disk, and its film is not "
                     "kept: 'azulejo retry %" PRIu64 " --frames %u' renders it again, with the same bits",
                     job, frame, extension, job, frame);
}

/* What is known of the bytes that an output should have. */
struct known_sum {
    int waits, is_listed;
    struct digest waiting, listed;
    enum sums_state state; /* of the list */
};

static status find_sum(const struct store *store, uint64_t job, uint32_t frame, const char *extension,
                       struct known_sum *out, struct error *err)
{
    struct buffer path = BUFFER_INIT, lines = BUFFER_INIT;
    char found[sizeof((struct output_sum *)0)->extension];
    const struct output_sum *waiting;
    size_t at = 0;

    *out = (struct known_sum){0};
    sums_path(store, job, frame, &path);
    if (!buffer_ok(&path)) {
        buffer_release(&path);
        return error_no_memory(err, "a path");
    }
    /* In this order: what waits no longer is in the file. */
    pthread_mutex_lock(&store->damage->lock);
    waiting = find_waiting(store->damage, job, frame, extension);
    out->waits = waiting != NULL;
    if (waiting)
        out->waiting = waiting->digest;
    pthread_mutex_unlock(&store->damage->lock);
    out->state = sums_read(buffer_text(&path), &lines);
    while (out->state == SUMS_GOOD && !out->is_listed && sums_next(&lines, &at, &out->listed, found, sizeof found))
        out->is_listed = strcmp(found, extension) == 0;
    buffer_release(&lines);
    buffer_release(&path);
    return STATUS_OK;
}

int store_output_digest(const struct store *store, uint64_t job, uint32_t frame, const char *extension,
                        struct digest *out)
{
    struct known_sum known;

    if (find_sum(store, job, frame, extension, &known, NULL) != STATUS_OK || !(known.waits || known.is_listed))
        return 0;
    *out = known.waits ? known.waiting : known.listed;
    return 1;
}

status store_output_check(const struct store *store, uint64_t job, uint32_t frame, const char *extension,
                          const struct digest *is, struct error *err)
{
    struct damaged_output found = {job, frame, strcmp(extension, "png") == 0 || strcmp(extension, "jpg") == 0};
    struct known_sum known;

    TRY(find_sum(store, job, frame, extension, &known, err));
    if ((known.waits && digest_equal(&known.waiting, is)) || known.state == SUMS_NONE || known.state == SUMS_UNREADABLE ||
        (known.state == SUMS_GOOD && (!known.is_listed || digest_equal(&known.listed, is))))
        return STATUS_OK;
    if (known.state == SUMS_DAMAGED)
        found.is_display = 0;
    if (strcmp(extension, "state") != 0) { /* that is only measured again */
        log_error("job %" PRIu64 ", frame %u: its %s file is damaged", job, frame, extension);
        damage_note(store->damage, &found);
    }
    return say_damaged(store, job, frame, extension, found.is_display, err);
}
