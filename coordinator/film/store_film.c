#include "coordinator/film/store_film_parts.h"

#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/system/clock.h"
#include "common/system/file.h"
#include "common/system/log.h"
#include "common/base/memory.h"
#include "common/system/trash.h"

struct film_file {
    pthread_mutex_t writing; /* held by a commit, while the disk may hang: of the file and its room */
    int fd;
    int read_only;
    int fresh;                        /* nothing was written yet: the first commit begins with the header, */
    uint8_t header[FILM_HEADER_SIZE]; /* this one, so that opening a film waits for no disk */
    uint64_t end;                     /* behind the last record that is on disk */
    struct film_room room;
    pthread_mutex_t lock; /* of what follows; taken after `writing`, and never held while something is written */
    struct buffer notes[GROUPS];
    unsigned note_waits[GROUPS]; /* for the next commit: how often it was set since one; 0: it does not */
    struct buffer emptied;       /* records that wait for it */
    uint64_t used;               /* room.used */
    char *path;
};

/* Version 2: the film may hold AOVs. 3: it has two groups of samples, and is of no cap. 7: records are appended. */
const char film_work_magic[8] = "AZFILM7\n";
enum {
    HEADER_VERSION_AT = 6,
    LIMIT_FLOAT_BYTES = 29, /* film_file_limit, a float of a pixel */
    KEPT_FLOAT_BYTES = 20,  /* film_kept_limit */
    LIMIT_MIN_BYTES = 1 << 20,
    PARTS = 4, /* of a commit: emptied tiles, notes, units, states */
};

static int all_zero(const uint8_t *data, size_t size)
{
    for (size_t i = 0; i < size; i++)
        if (data[i])
            return 0;
    return 1;
}

uint64_t film_kept_limit(const struct film *film)
{
    uint64_t pixel_floats = tile_floats(TILE_SIZE, TILE_SIZE, 0, film_aovs(film)) / TILE_PIXELS_MAX;

    return (uint64_t)film_width(film) * film_height(film) * pixel_floats * KEPT_FLOAT_BYTES;
}

uint64_t film_file_limit(const struct film *film)
{
    uint64_t tile_floats_max = tile_floats(TILE_SIZE, TILE_SIZE, 0, film_aovs(film));
    uint64_t limit = film_tile_count(film) * tile_floats_max * LIMIT_FLOAT_BYTES;

    return limit > LIMIT_MIN_BYTES ? limit : LIMIT_MIN_BYTES;
}

/* ---- opening ---------------------------------------------------------------------------------- */

static int printable(uint8_t byte) { return byte > 0x20 && byte < 0x7f ? byte : '?'; }

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
    else if (got > HEADER_VERSION_AT && memcmp(found, film_work_magic, HEADER_VERSION_AT) == 0 &&
             found[HEADER_VERSION_AT] != (uint8_t)film_work_magic[HEADER_VERSION_AT])
        log_warn("%s: was written by another version of azulejo (film format %c, this one reads "
                 "%c); the frame will be rendered from its beginning, and the file is kept as %s",
                 file->path, printable(found[HEADER_VERSION_AT]), film_work_magic[HEADER_VERSION_AT], buffer_text(&aside));
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
    return error_set(err, errno == ENOENT ? STATUS_ERR_NOT_FOUND : STATUS_ERR_IO, "%s: cannot be opened: %s",
                     file->path, strerror(errno));
}

static status make_file(struct film_file *file, const uint8_t wanted[FILM_HEADER_SIZE], struct error *err)
{
    int code;

    file->fd = open(file->path, O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
    if (file->fd < 0)
        return error_set(err, STATUS_ERR_IO, "%s: cannot be made: %s", file->path, strerror(errno));
    memcpy(file->header, wanted, FILM_HEADER_SIZE);
    file->fresh = 1;
    code = posix_fallocate(file->fd, 0, FILM_HEADER_SIZE); /* a disk that is full says so now */
    if (code == ENOSPC || code == EDQUOT || code == EROFS || code == EIO) {
        unlink(file->path); /* nothing was in it */
        return error_set(err, STATUS_ERR_IO, "%s: cannot be written: %s", file->path, strerror(code));
    }
    return STATUS_OK;
}

struct opening {
    struct film_loader loader;
    struct film_room *room;
};

static status take_record(void *user, const struct film_record *record, struct error *err)
{
    struct opening *o = user;

    if (record->data)
        film_room_add(o->room, record);
    return film_loader_take(&o->loader, record, err);
}

static status load(struct film_file *file, struct film *film, uint32_t (*durable)[GROUPS], struct error *err)
{
    struct opening o = {.room = &file->room};
    uint32_t lost = 0;
    status s = film_loader_init(&o.loader, film, err);

    o.loader.durable = durable;
    o.loader.notes = file->notes;
    THEN(s, film_log_scan(file->fd, file->path, film, take_record, &o, &file->end, err));
    if (s == STATUS_OK)
        lost = film_loader_lost(&o.loader);
    if (lost > 0)
        log_warn("%s: records of %u tiles are damaged or were not written to the end; their last passes will be "
                 "rendered again", file->path, lost);
    film_loader_release(&o.loader);
    return s;
}

/* What stands behind the last record was not written to the end. */
static status cut_tail(struct film_file *file, struct error *err)
{
    struct stat info;

    if (fstat(file->fd, &info) != 0 || ((uint64_t)info.st_size > file->end && ftruncate(file->fd, (off_t)file->end) != 0))
        return error_set(err, STATUS_ERR_IO, "%s: cannot be written: %s", file->path, strerror(errno));
    return STATUS_OK;
}

static status open_and_load(struct film_file *file, struct film *film, const uint8_t wanted[FILM_HEADER_SIZE],
                            uint32_t (*durable)[GROUPS], struct error *err)
{
    uint8_t found[FILM_HEADER_SIZE];
    size_t got = 0;
    status s = open_there(file, err);

    if (s == STATUS_ERR_NOT_FOUND)
        return make_file(file, wanted, err);
    THEN(s, film_read_at(file->fd, file->path, found, sizeof found, 0, &got, err));
    if (s != STATUS_OK)
        return s;
    if (got == sizeof found && memcmp(found, wanted, sizeof found) == 0) {
        s = load(file, film, durable, err);
        return s == STATUS_OK && !file->read_only ? cut_tail(file, err) : s;
    }
    if (!all_zero(found, got))
        s = set_aside(file, found, got, err);
    close(file->fd);
    file->fd = -1;
    return s == STATUS_OK ? make_file(file, wanted, err) : s;
}

status film_file_open(struct film_file **out, const char *path, uint64_t job, uint32_t frame, struct film *film,
                      uint32_t (*durable)[GROUPS], struct error *err)
{
    struct film_file *file = mem_calloc(1, sizeof *file);
    uint8_t wanted[FILM_HEADER_SIZE];
    status s;

    *out = NULL;
    NEED(file, err, "a film file");
    file->fd = -1;
    file->end = FILM_HEADER_SIZE;
    file->room = (struct film_room){.tiles = film_tile_count(film), .limit = film_file_limit(film)};
    pthread_mutex_init(&file->writing, NULL);
    pthread_mutex_init(&file->lock, NULL);
    file->path = mem_strdup(path);
    s = file->path ? film_header_make(wanted, film_work_magic, film, job, frame, err)
                   : error_no_memory(err, "a film file");
    THEN(s, open_and_load(file, film, wanted, durable, err));
    file->used = file->room.used;
    if (s == STATUS_OK)
        *out = file;
    else
        film_file_close(file);
    return s;
}

/* Nothing is in it. Another film may have taken its place. */
static void remove_empty(const struct film_file *file)
{
    struct stat own, named;

    if (fstat(file->fd, &own) == 0 && own.st_size <= FILM_HEADER_SIZE && stat(file->path, &named) == 0 &&
        own.st_ino == named.st_ino && own.st_dev == named.st_dev)
        unlink(file->path);
}

void film_file_close(struct film_file *file)
{
    if (!file)
        return;
    if (file->fd >= 0 && file->fresh)
        remove_empty(file);
    if (file->fd >= 0)
        trash_close_file(file->fd);
    pthread_mutex_destroy(&file->lock);
    pthread_mutex_destroy(&file->writing);
    for (uint32_t g = 0; g < GROUPS; g++)
        buffer_release(&file->notes[g]);
    buffer_release(&file->emptied);
    mem_free(file->room.runs);
    mem_free(file->path);
    mem_free(file);
}

/* ---- committing ------------------------------------------------------------------------------- */

/* Reopen a file that was opened for reading: the disk may be writable by now. `writing` is held. */
static status become_writable(struct film_file *file, struct error *err)
{
    int fd;

    if (!file->read_only)
        return STATUS_OK;
    fd = open(file->path, O_RDWR | O_CLOEXEC);
    if (fd < 0)
        return error_set(err, STATUS_ERR_IO, "%s: cannot be written: %s", file->path, strerror(errno));
    close(file->fd);
    file->fd = fd;
    file->read_only = 0;
    return cut_tail(file, err);
}

static status pack_notes(const struct film_file *file, struct buffer *out, struct error *err)
{
    for (uint32_t g = 0; g < GROUPS; g++) {
        uint8_t *at;
        if (!file->note_waits[g])
            continue;
        at = film_record_add(out, FILM_RECORD_NOTE, g, file->notes[g].size);
        if (!at)
            return error_no_memory(err, "a note");
        memcpy(at, file->notes[g].data, file->notes[g].size);
    }
    return STATUS_OK;
}

/* The names of the file and its folder must be as durable as the acknowledged results. */
static status sync_names(const char *path, struct error *err)
{
    char *folder = mem_strdup(path), *end = folder ? strrchr(folder, '/') : NULL;
    status s = file_sync_folder_of(path, err);

    NEED(folder, err, "a path");
    if (end && end != folder) {
        *end = 0;
        THEN(s, file_sync_folder_of(folder, err));
    }
    mem_free(folder);
    return s;
}

/* Append the records and sync them. `writing` is held. */
static status append(struct film_file *file, struct buffer *const parts[PARTS], uint64_t *written_ns, struct error *err)
{
    uint64_t end = file->end;
    status s = STATUS_OK;

    if (file->fresh)
        s = film_write_at(file->fd, file->path, file->header, FILM_HEADER_SIZE, 0, err);
    for (int i = 0; i < PARTS && s == STATUS_OK; i++) {
        s = film_write_at(file->fd, file->path, parts[i]->data, parts[i]->size, end, err);
        end += parts[i]->size;
    }
    if (s == STATUS_OK)
        *written_ns = clock_monotonic_ns();
    if (s == STATUS_OK && file_sync_data(file->fd) != 0)
        s = error_set(err, STATUS_ERR_IO, "%s: cannot be written to disk: %s", file->path, strerror(errno));
    if (file->fresh)
        THEN(s, sync_names(file->path, err));
    if (s == STATUS_OK)
        file->fresh = 0;
    if (s != STATUS_OK) {
        /* If it cannot be cut now, the next commit overwrites it. */
        if (ftruncate(file->fd, (off_t)file->end) != 0)
            log_debug("%s: cannot be cut: %s", file->path, strerror(errno));
        return s;
    }
    for (int i = 0; i < PARTS; i++) {
        struct film_record r;
        for (size_t at = 0, next = 0; film_records_next(parts[i], &next, &r); at = next) {
            r.at = file->end + at;
            film_room_add(&file->room, &r);
        }
        file->end += parts[i]->size;
    }
    return STATUS_OK;
}

/* What waits for a commit, as it was taken for one. */
struct taken {
    unsigned notes[GROUPS];
    size_t emptied;
};

static status take(struct film_file *file, struct taken *taken, struct buffer *emptied, struct buffer *notes, struct error *err)
{
    status s;

    pthread_mutex_lock(&file->lock);
    memcpy(taken->notes, file->note_waits, sizeof taken->notes);
    taken->emptied = file->emptied.size;
    buffer_append(emptied, file->emptied.data, file->emptied.size);
    s = pack_notes(file, notes, err);
    pthread_mutex_unlock(&file->lock);
    return s != STATUS_OK || buffer_ok(emptied) ? s : error_no_memory(err, "a film's tiles");
}

/* It is on disk. What came meanwhile waits for the next commit. */
static void settle(struct film_file *file, const struct taken *taken)
{
    struct buffer *emptied = &file->emptied;

    pthread_mutex_lock(&file->lock);
    for (uint32_t g = 0; g < GROUPS; g++)
        if (file->note_waits[g] == taken->notes[g])
            file->note_waits[g] = 0;
    if (taken->emptied > 0) {
        memmove(emptied->data, emptied->data + taken->emptied, emptied->size - taken->emptied);
        emptied->size -= taken->emptied;
    }
    file->used = file->room.used;
    pthread_mutex_unlock(&file->lock);
}

status film_file_commit(struct film_file *file, struct film_commit *commit, struct error *err)
{
    struct buffer emptied = BUFFER_INIT, notes = BUFFER_INIT, packed = BUFFER_INIT;
    struct buffer *const parts[] = {&emptied, &notes, &commit->units, &packed};
    status s = film_records_pack(&packed, &commit->states, err);
    struct taken taken = {0};

    pthread_mutex_lock(&file->writing);
    THEN(s, become_writable(file, err));
    THEN(s, take(file, &taken, &emptied, &notes, err));
    for (int i = 0; i < PARTS; i++)
        film_records_seal(parts[i]);
    THEN(s, append(file, parts, &commit->written_ns, err));
    if (s == STATUS_OK) {
        film_room_step(&file->room, file->fd, file->end, &commit->stale);
        settle(file, &taken);
    }
    pthread_mutex_unlock(&file->writing);
    buffer_release(&packed);
    buffer_release(&notes);
    buffer_release(&emptied);
    return s;
}

status film_file_sync(struct film_file *file, struct error *err)
{
    struct film_commit nothing = {0};

    return film_file_commit(file, &nothing, err);
}

uint64_t film_file_bytes(struct film_file *file)
{
    uint64_t bytes;

    pthread_mutex_lock(&file->lock);
    bytes = file->used;
    pthread_mutex_unlock(&file->lock);
    return bytes;
}

status film_file_empty_tile(struct film_file *file, struct film *film, uint32_t tile, struct error *err)
{
    int fits;

    pthread_mutex_lock(&file->lock);
    fits = film_record_add(&file->emptied, FILM_RECORD_EMPTY, tile, 0) != NULL;
    pthread_mutex_unlock(&file->lock);
    NEED(fits, err, "a film's tiles");
    film_tile_unload(film, tile);
    return STATUS_OK;
}

/* ---- notes ------------------------------------------------------------------------------------ */

/* The lock is held. */
static status set_note(struct film_file *file, uint32_t group, const struct buffer *note, struct error *err)
{
    struct buffer *own = &file->notes[group];

    buffer_clear(own);
    buffer_append(own, note->data, note->size);
    if (!buffer_ok(own)) {
        buffer_clear(own);
        return error_no_memory(err, "a note");
    }
    file->note_waits[group]++;
    return STATUS_OK;
}

status film_file_note_write(struct film_file *file, uint32_t group, const struct buffer *note, struct error *err)
{
    status s;

    if (note->size > FILM_NOTE_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "%s: a note of %zu bytes", file->path, note->size);
    pthread_mutex_lock(&file->lock);
    s = set_note(file, group, note, err);
    pthread_mutex_unlock(&file->lock);
    return s;
}

status film_file_note_read(struct film_file *file, uint32_t group, struct buffer *out, struct error *err)
{
    pthread_mutex_lock(&file->lock);
    buffer_append(out, file->notes[group].data, file->notes[group].size);
    pthread_mutex_unlock(&file->lock);
    return buffer_ok(out) ? STATUS_OK : error_no_memory(err, "a note");
}

status film_file_notes_restore(struct film_file *file, const struct buffer *notes, struct error *err)
{
    status s = STATUS_OK;

    pthread_mutex_lock(&file->lock);
    for (uint32_t g = 0; g < GROUPS && s == STATUS_OK; g++)
        if (file->notes[g].size == 0 && notes[g].size > 0)
            s = set_note(file, g, &notes[g], err);
    pthread_mutex_unlock(&file->lock);
    return s;
}
