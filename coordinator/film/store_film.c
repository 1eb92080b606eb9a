#include "coordinator/film/store_film_parts.h"

#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/base/file.h"
#include "common/base/log.h"
#include "common/base/memory.h"
#include "common/base/trash.h"

struct film_file {
    pthread_mutex_t lock;        /* of fd, read_only and serials */
    int fd;
    int read_only;
    size_t slot_bytes;
    uint64_t *serials;           /* of each tile, the last one written */
    char *path;
};

/* Version 2: the film may hold AOVs. Version 3: it has two groups of samples, and is of no cap. */
static const char header_magic[8] = "AZFILM5\n";
enum {
    HEADER_VERSION_AT = 6, SLOT_HEADER = 16,
    NOTES_AT = 1024, NOTE_HEADER = 16, NOTE_SIZE = NOTE_HEADER + FILM_NOTE_MAX,
};
_Static_assert(NOTES_AT + GROUPS * NOTE_SIZE <= FILM_FILE_HEADER, "the notes fit into the header");

static atomic_long fault_successes = -1;

void film_file_fault(long successes)
{
    atomic_store(&fault_successes, successes);
}

static int fault_hits(void)
{
    long left = atomic_load(&fault_successes);

    if (left < 0)
        return 0;
    if (left > 0) {
        atomic_store(&fault_successes, left - 1);
        return 0;
    }
    errno = ENOSPC;
    return 1;
}

static status write_at(const struct film_file *file, const uint8_t *data, size_t size,
                       uint64_t offset, struct error *err)
{
    while (size > 0) {
        ssize_t put = fault_hits() ? -1 : pwrite(file->fd, data, size, (off_t)offset);
        if (put < 0 && errno == EINTR)
            continue;
        if (put < 0)
            return error_set(err, STATUS_ERR_IO, "%s: cannot be written: %s", file->path,
                             strerror(errno));
        data += put;
        offset += (uint64_t)put;
        size -= (size_t)put;
    }
    return STATUS_OK;
}

/* How many bytes there were, short only at the file's end. */
static status read_at(const struct film_file *file, uint8_t *data, size_t size, uint64_t offset,
                      size_t *got, struct error *err)
{
    *got = 0;
    while (*got < size) {
        ssize_t n = pread(file->fd, data + *got, size - *got, (off_t)(offset + *got));
        if (n < 0 && errno == EINTR)
            continue;
        if (n < 0)
            return error_set(err, STATUS_ERR_IO, "%s: cannot be read: %s", file->path,
                             strerror(errno));
        if (n == 0)
            break;
        *got += (size_t)n;
    }
    return STATUS_OK;
}

static void put_number(uint8_t *out, uint64_t value)
{
    for (int i = 0; i < 8; i++)
        out[i] = (uint8_t)(value >> 8 * i);
}

status film_header_make(uint8_t header[FILM_HEADER_SIZE], const char magic[8],
                        const struct film *film, uint64_t job, uint32_t frame, struct error *err)
{
    struct digest check;

    memcpy(header, magic, 8);
    put_number(header + 8, film_width(film));
    put_number(header + 16, film_height(film));
    put_number(header + 24, film_aovs(film));
    put_number(header + 32, job);
    put_number(header + 40, frame);
    if (digest_of(&check, header, FILM_HEADER_FIELDS) != STATUS_OK)
        return error_set(err, STATUS_ERR_INTERNAL, "a film's header: no SHA-256");
    memcpy(header + FILM_HEADER_FIELDS, check.bytes, DIGEST_BYTES);
    return STATUS_OK;
}

static uint64_t slot_offset(const struct film_file *file, uint32_t tile, uint8_t slot)
{
    return FILM_FILE_HEADER + ((uint64_t)tile * FILM_SLOTS + slot) * file->slot_bytes;
}

static int all_zero(const uint8_t *data, size_t size)
{
    for (size_t i = 0; i < size; i++)
        if (data[i])
            return 0;
    return 1;
}

static uint64_t get_number(const uint8_t *in)
{
    uint64_t value = 0;

    for (int i = 7; i >= 0; i--)
        value = value << 8 | in[i];
    return value;
}

/* One slot as it was read. */
struct slot_state {
    uint64_t serial;             /* 0: it is empty or damaged */
    size_t size;
    uint32_t passes[GROUPS];
};

/* Read a slot's state into `bytes`. */
static status read_slot(struct film_file *file, const struct film *film, uint32_t tile, uint8_t slot,
                        uint8_t *bytes, struct slot_state *out, uint32_t *damaged, struct error *err)
{
    uint8_t head[SLOT_HEADER + FILM_STATE_PREFIX];
    size_t got = 0;
    status s = read_at(file, head, sizeof head, slot_offset(file, tile, slot), &got, err);

    memset(out, 0, sizeof *out);
    memset(head + got, 0, sizeof head - got);
    if (s != STATUS_OK || all_zero(head, sizeof head))
        return s;
    out->size = film_tile_length(head + SLOT_HEADER);
    if (get_number(head + 8) == hash_bytes(head, 8) && out->size >= FILM_STATE_PREFIX &&
        out->size <= film_tile_state_bound(film, tile)) {
        s = read_at(file, bytes, out->size, slot_offset(file, tile, slot) + SLOT_HEADER, &got, err);
        if (s != STATUS_OK)
            return s;
        if (got == out->size &&
            film_tile_peek(film, tile, bytes, out->size, out->passes, NULL) == STATUS_OK)
            out->serial = get_number(head);
    }
    *damaged += out->serial == 0;
    return STATUS_OK;
}

/* Does the state have at least the passes of the film? */
static int is_more(const struct slot_state *state, const struct film *film, uint32_t tile)
{
    for (uint32_t g = 0; g < GROUPS; g++)
        if (state->passes[g] < film_tile_passes(film, tile, g))
            return 0;
    return 1;
}

/* Load the newer of a tile's two good slots. */
static status load_tile(struct film_file *file, struct film *film, uint32_t tile, uint8_t *bytes,
                        uint32_t durable[GROUPS], uint8_t *slot, uint32_t *damaged,
                        struct error *err)
{
    uint8_t *const places[FILM_SLOTS] = {bytes, bytes + file->slot_bytes};
    struct slot_state found[FILM_SLOTS];
    uint8_t best;
    status s = STATUS_OK;

    for (uint8_t i = 0; i < FILM_SLOTS && s == STATUS_OK; i++)
        s = read_slot(file, film, tile, i, places[i], &found[i], damaged, err);
    if (s != STATUS_OK)
        return s;
    best = found[1].serial > found[0].serial;
    file->serials[tile] = found[best].serial;
    *slot = found[best].serial ? best : 1;
    if (!found[best].serial || !is_more(&found[best], film, tile))
        return STATUS_OK;
    s = film_tile_load(film, tile, places[best], found[best].size, err);
    if (s == STATUS_OK)
        memcpy(durable, found[best].passes, sizeof found[best].passes);
    return s;
}

static status load_all(struct film_file *file, struct film *film, uint32_t (*durable)[GROUPS],
                       uint8_t *slot, struct error *err)
{
    uint8_t *bytes = mem_alloc_array(2, file->slot_bytes);
    uint32_t damaged = 0;
    status s = STATUS_OK;

    if (!bytes)
        return error_no_memory(err, "a film file");
    for (uint32_t i = 0; i < film_tile_count(film) && s == STATUS_OK; i++)
        s = load_tile(file, film, i, bytes, durable[i], &slot[i], &damaged, err);
    if (damaged)
        log_warn("%s: %u tile slots were not written to the end; their last passes will be rendered again",
                 file->path, damaged);
    mem_free(bytes);
    return s;
}

static int printable(uint8_t byte)
{
    return byte > 0x20 && byte < 0x7f ? byte : '?';
}

/* The file is not this frame's film. It is renamed, not removed: it may be of use to someone. */
static status set_aside(struct film_file *file, const uint8_t *found, size_t got, struct error *err)
{
    struct buffer aside = BUFFER_INIT;
    status s = STATUS_OK;

    buffer_printf(&aside, "%s.unusable", file->path);
    if (!buffer_ok(&aside))
        s = error_no_memory(err, "a path");
    else if (rename(file->path, buffer_text(&aside)) != 0)
        s = error_set(err, STATUS_ERR_IO, "%s: cannot be renamed: %s", file->path, strerror(errno));
    else if (got > HEADER_VERSION_AT && memcmp(found, header_magic, HEADER_VERSION_AT) == 0 &&
             found[HEADER_VERSION_AT] != (uint8_t)header_magic[HEADER_VERSION_AT])
        log_warn("%s: was written by another version of azulejo (film format %c, this one reads "
                 "%c); the frame will be rendered from its beginning, and the file is kept as %s",
                 file->path, printable(found[HEADER_VERSION_AT]), header_magic[HEADER_VERSION_AT],
                 buffer_text(&aside));
    else
        log_warn("%s: belongs to another frame or is damaged; the frame will be rendered from its "
                 "beginning, and the file is kept as %s",
                 file->path, buffer_text(&aside));
    buffer_release(&aside);
    return s;
}

/* Open the existing file. ERR_NOT_FOUND: there is none. */
static status open_there(struct film_file *file, struct error *err)
{
    file->fd = open(file->path, O_RDWR | O_CLOEXEC);
    if (file->fd < 0 && (errno == EROFS || errno == EACCES)) {
        file->fd = open(file->path, O_RDONLY | O_CLOEXEC);
        file->read_only = file->fd >= 0;
    }
    if (file->fd >= 0)
        return STATUS_OK;
    return error_set(err, errno == ENOENT ? STATUS_ERR_NOT_FOUND : STATUS_ERR_IO,
                     "%s: cannot be opened: %s", file->path, strerror(errno));
}

static status make_file(struct film_file *file, const uint8_t wanted[FILM_HEADER_SIZE], struct error *err)
{
    status s;

    file->fd = open(file->path, O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
    if (file->fd < 0)
        return error_set(err, STATUS_ERR_IO, "%s: cannot be made: %s", file->path, strerror(errno));
    s = write_at(file, wanted, FILM_HEADER_SIZE, 0, err);
    if (s != STATUS_OK) {
        unlink(file->path); /* nothing was in it */
        return s;
    }
    /* The file's name must be as durable as the acknowledged results. */
    return file_sync_folder_of(file->path, err);
}

static status open_and_load(struct film_file *file, struct film *film,
                            const uint8_t wanted[FILM_HEADER_SIZE], uint32_t (*durable)[GROUPS], uint8_t *slot,
                            struct error *err)
{
    uint8_t found[FILM_HEADER_SIZE];
    size_t got = 0;
    status s = open_there(file, err);

    if (s == STATUS_ERR_NOT_FOUND)
        return make_file(file, wanted, err);
    if (s == STATUS_OK)
        s = read_at(file, found, sizeof found, 0, &got, err);
    if (s != STATUS_OK)
        return s;
    if (got == sizeof found && memcmp(found, wanted, sizeof found) == 0)
        return load_all(file, film, durable, slot, err);
    if (!all_zero(found, got))
        s = set_aside(file, found, got, err);
    close(file->fd);
    file->fd = -1;
    return s == STATUS_OK ? make_file(file, wanted, err) : s;
}

status film_file_look(struct film_file **out, const char *path, uint64_t job, uint32_t frame,
                      const struct film *film, struct error *err)
{
    struct film_file *file = mem_calloc(1, sizeof *file);
    uint8_t wanted[FILM_HEADER_SIZE], found[FILM_HEADER_SIZE];
    size_t got = 0;
    status s;

    *out = NULL;
    if (!file)
        return error_no_memory(err, "a film file");
    pthread_mutex_init(&file->lock, NULL);
    file->read_only = 1;
    file->fd = open(path, O_RDONLY | O_CLOEXEC);
    file->path = mem_strdup(path);
    file->serials = mem_calloc(film_tile_count(film), sizeof *file->serials);
    file->slot_bytes = SLOT_HEADER + film_tile_state_bound(film, 0);
    if (!file->path || !file->serials)
        s = error_no_memory(err, "a film file");
    else if (file->fd < 0)
        s = error_set(err, errno == ENOENT ? STATUS_ERR_NOT_FOUND : STATUS_ERR_IO, "%s: cannot be opened: %s", path,
                      strerror(errno));
    else
        s = film_header_make(wanted, header_magic, film, job, frame, err);
    if (s == STATUS_OK)
        s = read_at(file, found, sizeof found, 0, &got, err);
    if (s == STATUS_OK && (got < sizeof found || memcmp(found, wanted, sizeof found) != 0))
        s = error_set(err, STATUS_ERR_NOT_FOUND, "%s: is not the frame's film", path);
    if (s != STATUS_OK) {
        film_file_close(file);
        return s;
    }
    *out = file;
    return STATUS_OK;
}

size_t film_file_tile_bytes(const struct film_file *file)
{
    return FILM_SLOTS * file->slot_bytes;
}

status film_file_load_tile(struct film_file *file, struct film *film, uint32_t tile, uint8_t *bytes,
                           struct error *err)
{
    uint32_t passes[GROUPS], damaged = 0;
    uint8_t slot;

    return load_tile(file, film, tile, bytes, passes, &slot, &damaged, err);
}

status film_file_open(struct film_file **out, const char *path, uint64_t job, uint32_t frame,
                      struct film *film, uint32_t (*durable)[GROUPS], uint8_t *slot, struct error *err)
{
    struct film_file *file = mem_calloc(1, sizeof *file);
    uint8_t wanted[FILM_HEADER_SIZE];
    status s;

    *out = NULL;
    if (!file)
        return error_no_memory(err, "a film file");
    file->fd = -1;
    pthread_mutex_init(&file->lock, NULL);
    file->path = mem_strdup(path);
    file->serials = mem_calloc(film_tile_count(film), sizeof *file->serials);
    if (!file->path || !file->serials) {
        s = error_no_memory(err, "a film file");
        goto fail;
    }
    file->slot_bytes = SLOT_HEADER + film_tile_state_bound(film, 0); /* no tile is larger */
    memset(slot, 1, film_tile_count(film));
    s = film_header_make(wanted, header_magic, film, job, frame, err);
    if (s != STATUS_OK)
        goto fail;
    s = open_and_load(file, film, wanted, durable, slot, err);
    if (s != STATUS_OK)
        goto fail;
    *out = file;
    return STATUS_OK;
fail:
    film_file_close(file);
    return s;
}

void film_file_close(struct film_file *file)
{
    if (!file)
        return;
    if (file->fd >= 0)
        trash_close_file(file->fd);
    pthread_mutex_destroy(&file->lock);
    mem_free(file->serials);
    mem_free(file->path);
    mem_free(file);
}

/* Reopen a file that was opened for reading: the disk may be writable by now. The lock is held. */
static status become_writable(struct film_file *file, struct error *err)
{
    int fd;

    if (!file->read_only)
        return STATUS_OK;
    fd = open(file->path, O_RDWR | O_CLOEXEC);
    if (fd < 0)
        return error_set(err, STATUS_ERR_IO, "%s: cannot be written: %s", file->path,
                         strerror(errno));
    close(file->fd);
    file->fd = fd;
    file->read_only = 0;
    return STATUS_OK;
}

status film_file_write(struct film_file *file, uint32_t tile, uint8_t slot, const uint8_t *state,
                       size_t size_bytes, struct error *err)
{
    uint8_t header[SLOT_HEADER];
    status s;

    pthread_mutex_lock(&file->lock);
    s = become_writable(file, err);
    if (s == STATUS_OK) {
        put_number(header, ++file->serials[tile]);
        put_number(header + 8, hash_bytes(header, 8));
        s = write_at(file, header, sizeof header, slot_offset(file, tile, slot), err);
    }
    if (s == STATUS_OK)
        s = write_at(file, state, size_bytes, slot_offset(file, tile, slot) + SLOT_HEADER, err);
    pthread_mutex_unlock(&file->lock);
    return s;
}

status film_file_sync(struct film_file *file, struct error *err)
{
    status s = STATUS_OK;

    pthread_mutex_lock(&file->lock);
    if (fdatasync(file->fd) != 0)
        s = error_set(err, STATUS_ERR_IO, "%s: cannot be written to disk: %s", file->path,
                      strerror(errno));
    pthread_mutex_unlock(&file->lock);
    return s;
}

static uint64_t note_offset(uint32_t group)
{
    return NOTES_AT + (uint64_t)group * NOTE_SIZE;
}

status film_file_note_write(struct film_file *file, uint32_t group, const struct buffer *note,
                            struct error *err)
{
    uint8_t header[NOTE_HEADER];
    status s;

    if (note->size > FILM_NOTE_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "%s: a note of %zu bytes", file->path, note->size);
    put_number(header, note->size);
    put_number(header + 8, hash_bytes(note->data, note->size));
    pthread_mutex_lock(&file->lock);
    s = become_writable(file, err);
    if (s == STATUS_OK)
        s = write_at(file, header, sizeof header, note_offset(group), err);
    if (s == STATUS_OK)
        s = write_at(file, note->data, note->size, note_offset(group) + NOTE_HEADER, err);
    pthread_mutex_unlock(&file->lock);
    return s;
}

status film_file_note_read(struct film_file *file, uint32_t group, struct buffer *out,
                           struct error *err)
{
    uint8_t bytes[NOTE_SIZE] = {0};
    uint64_t size;
    size_t got;
    status s;

    pthread_mutex_lock(&file->lock);
    s = read_at(file, bytes, sizeof bytes, note_offset(group), &got, err);
    pthread_mutex_unlock(&file->lock);
    if (s != STATUS_OK || all_zero(bytes, NOTE_HEADER))
        return s;
    size = get_number(bytes);
    if (size > FILM_NOTE_MAX || size + NOTE_HEADER > got ||
        get_number(bytes + 8) != hash_bytes(bytes + NOTE_HEADER, size)) {
        log_warn("%s: a note in it was not written to the end", file->path);
        return STATUS_OK;
    }
    buffer_append(out, bytes + NOTE_HEADER, size);
    return buffer_ok(out) ? STATUS_OK : error_no_memory(err, "a note");
}

status film_file_notes_get(struct film_file *file, uint8_t notes[FILM_NOTES_SIZE], struct error *err)
{
    size_t got;
    status s;

    pthread_mutex_lock(&file->lock);
    s = read_at(file, notes, FILM_NOTES_SIZE, NOTES_AT, &got, err);
    pthread_mutex_unlock(&file->lock);
    if (s == STATUS_OK)
        memset(notes + got, 0, FILM_NOTES_SIZE - got);
    return s;
}

status film_file_notes_restore(struct film_file *file, const struct buffer *notes, struct error *err)
{
    uint8_t own[FILM_NOTES_SIZE];
    status s = film_file_notes_get(file, own, err);

    if (s != STATUS_OK || notes->size != FILM_NOTES_SIZE || !all_zero(own, sizeof own))
        return s;
    pthread_mutex_lock(&file->lock);
    s = become_writable(file, err);
    if (s == STATUS_OK)
        s = write_at(file, notes->data, notes->size, NOTES_AT, err);
    pthread_mutex_unlock(&file->lock);
    return s == STATUS_OK ? film_file_sync(file, err) : s;
}
