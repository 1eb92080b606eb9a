/* The compact film of a done frame: a header like that of a film in work, with a magic of its own, then its notes and
 * the state of each tile, as records. The file is written once and never changed: a frame that continues writes to a
 * film in work beside it. */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "common/base/bytes.h"
#include "common/system/file.h"
#include "common/system/log.h"
#include "common/base/memory.h"
#include "common/system/parallel.h"
#include "coordinator/film/store_film_parts.h"

/* Version 3: records, compressed. */
const char film_kept_magic[8] = "AZKEPT3\n";

enum { TILES_AT_ONCE = 64, PACKS_AT_ONCE = 8 };

static status io_error(const char *path, const char *what, struct error *err)
{
    return error_set(err, STATUS_ERR_IO, "%s: cannot be %s: %s", path, what, strerror(errno));
}

/* Write the records at *offset, and forget them. */
static status put_records(int fd, const char *path, struct buffer *records, uint64_t *offset, struct error *err)
{
    status s;

    film_records_seal(records);
    s = film_write_at(fd, path, records->data, records->size, *offset, err);
    *offset += records->size;
    buffer_clear(records);
    return s;
}

/* Records that are made at once, by all threads, and written in their order. */
struct pack {
    struct buffer states, packed;
    status result;
    struct error error;
};
struct packs {
    const struct film *film;
    uint32_t first; /* tile */
    struct pack items[PACKS_AT_ONCE];
};

static void make_packs(void *user, size_t begin, size_t end)
{
    struct packs *packs = user;

    for (size_t i = begin; i < end; i++) {
        struct pack *p = &packs->items[i];
        uint32_t first = packs->first + (uint32_t)i * TILES_AT_ONCE, count = film_tile_count(packs->film);

        buffer_clear(&p->states);
        p->result = STATUS_OK;
        for (uint32_t t = first; t < first + TILES_AT_ONCE && t < count && p->result == STATUS_OK; t++)
            if (!film_record_state(&p->states, packs->film, t))
                p->result = error_no_memory(&p->error, "a film to keep");
        THEN(p->result, film_records_pack(&p->packed, &p->states, &p->error));
    }
}

static status write_states(int fd, const char *path, const struct film *film, uint64_t offset, struct error *err)
{
    struct packs packs = {.film = film};
    const uint32_t count = (film_tile_count(film) + TILES_AT_ONCE - 1) / TILES_AT_ONCE;
    status s = STATUS_OK;

    for (uint32_t done = 0; done < count && s == STATUS_OK; done += PACKS_AT_ONCE) {
        const uint32_t now = count - done < PACKS_AT_ONCE ? count - done : PACKS_AT_ONCE;

        packs.first = done * TILES_AT_ONCE;
        parallel_for(0, now, 1, make_packs, &packs);
        for (uint32_t i = 0; i < now && s == STATUS_OK; i++) {
            s = packs.items[i].result;
            if (s != STATUS_OK && err)
                *err = packs.items[i].error;
            THEN(s, put_records(fd, path, &packs.items[i].packed, &offset, err));
        }
    }
    for (int i = 0; i < PACKS_AT_ONCE; i++) {
        buffer_release(&packs.items[i].packed);
        buffer_release(&packs.items[i].states);
    }
    return s;
}

static status write_notes(int fd, const char *path, struct film_file *file, uint64_t *offset, struct error *err)
{
    struct buffer note = BUFFER_INIT, records = BUFFER_INIT;
    status s = STATUS_OK;

    for (uint32_t g = 0; g < GROUPS && s == STATUS_OK; g++) {
        uint8_t *at;
        buffer_clear(&note);
        s = film_file_note_read(file, g, &note, err);
        if (s != STATUS_OK || note.size == 0)
            continue;
        at = film_record_add(&records, FILM_RECORD_NOTE, g, note.size);
        if (at)
            memcpy(at, note.data, note.size);
        else
            s = error_no_memory(err, "a note");
    }
    THEN(s, put_records(fd, path, &records, offset, err));
    buffer_release(&records);
    buffer_release(&note);
    return s;
}

static status write_file(const char *path, const struct film *film, const uint8_t header[FILM_HEADER_SIZE],
                         struct film_file *file, struct error *err)
{
    int fd = open(path, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
    uint64_t offset = FILM_HEADER_SIZE;
    status s;

    if (fd < 0)
        return io_error(path, "made", err);
    s = film_write_at(fd, path, header, FILM_HEADER_SIZE, 0, err);
    if (file)
        THEN(s, write_notes(fd, path, file, &offset, err));
    THEN(s, write_states(fd, path, film, offset, err));
    if (s == STATUS_OK && file_sync(fd) != 0)
        s = io_error(path, "written to disk", err);
    if (close(fd) != 0 && s == STATUS_OK)
        s = io_error(path, "written", err);
    return s;
}

status film_kept_write(const char *path, uint64_t job, uint32_t frame, const struct film *film, struct film_file *file,
                       struct error *err)
{
    uint8_t header[FILM_HEADER_SIZE];
    struct buffer fresh = BUFFER_INIT;
    status s;

    buffer_printf(&fresh, "%s.new", path);
    if (!buffer_ok(&fresh))
        return error_no_memory(err, "a path");
    s = film_header_make(header, film_kept_magic, film, job, frame, err);
    THEN(s, write_file(buffer_text(&fresh), film, header, file, err));
    if (s == STATUS_OK && rename(buffer_text(&fresh), path) != 0)
        s = io_error(path, "made", err);
    if (s == STATUS_OK)
        s = file_sync_folder_of(path, err);
    else
        unlink(buffer_text(&fresh));
    buffer_release(&fresh);
    return s;
}

status film_kept_load(const char *path, uint64_t job, uint32_t frame, struct film *film, uint32_t (*durable)[GROUPS],
                      struct buffer *notes, struct error *err)
{
    struct film_loader loader = {0};
    uint32_t lost = 0;
    uint64_t end;
    int fd;
    status s = film_log_open(&fd, path, film_kept_magic, film, job, frame, err);

    if (s == STATUS_ERR_NOT_FOUND && fd == FILM_LOG_OTHER)
        log_warn("%s: is damaged, or of another version; the frame will be rendered from its beginning", path);
    if (s == STATUS_ERR_NOT_FOUND)
        return STATUS_OK;
    THEN(s, film_loader_init(&loader, film, err));
    loader.durable = durable;
    loader.notes = notes;
    THEN(s, film_log_scan(fd, path, film, film_loader_take, &loader, &end, err));
    for (uint32_t t = 0; t < film_tile_count(film); t++)
        lost += film_tile_samples(film, t) == 0;
    if (s == STATUS_OK && lost > 0)
        log_warn("%s: %u tiles are damaged and will be rendered again", path, lost);
    film_loader_release(&loader);
    if (fd >= 0)
        close(fd);
    return s;
}

static status load_into(struct film_loader *loader, const char *path, const char magic[8], uint64_t job, uint32_t frame,
                        struct error *err)
{
    uint64_t end;
    int fd;
    status s = film_log_open(&fd, path, magic, loader->film, job, frame, err);

    if (s == STATUS_ERR_NOT_FOUND)
        return STATUS_OK;
    THEN(s, film_log_scan(fd, path, loader->film, film_loader_take, loader, &end, err));
    if (fd >= 0)
        close(fd);
    return s;
}

status film_levels_load(const char *kept_path, const char *work_path, uint64_t job, uint32_t frame, struct film *film,
                        struct error *err)
{
    struct film *again = film_new_aovs(film_width(film), film_height(film), film_spp(film), film_aovs(film));
    struct film_loader loader = {0};
    status s = again ? film_loader_init(&loader, again, err) : error_no_memory(err, "a film's levels");

    for (uint32_t g = 0; g < GROUPS && again; g++)
        if (film_codes_of(film, g))
            film_freeze(again, g, film_codes_of(film, g));
    THEN(s, load_into(&loader, kept_path, film_kept_magic, job, frame, err));
    THEN(s, load_into(&loader, work_path, film_work_magic, job, frame, err));
    if (s == STATUS_OK)
        film_take_levels(film, again);
    film_loader_release(&loader);
    film_free(again);
    return s;
}

/* The film that the header is of, empty. Its sides are bounded, for the header has a digest. */
static struct film *film_of_header(const char *path)
{
    uint8_t header[FILM_HEADER_SIZE];
    struct digest is;
    size_t got = 0;
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    status s = fd >= 0 ? film_read_at(fd, path, header, sizeof header, 0, &got, NULL) : STATUS_ERR_IO;

    if (fd >= 0)
        close(fd);
    if (s != STATUS_OK || got < sizeof header || digest_of(&is, header, FILM_HEADER_FIELDS) != STATUS_OK ||
        memcmp(is.bytes, header + FILM_HEADER_FIELDS, DIGEST_BYTES) != 0)
        return NULL;
    return film_new_aovs((uint32_t)bytes_get64(header + 8), (uint32_t)bytes_get64(header + 16), SETTINGS_SPP_MAX,
                         (uint32_t)bytes_get64(header + 24));
}

/* Only zeros, at most a header's. */
static int is_empty(const char *path)
{
    uint8_t header[FILM_HEADER_SIZE + 1] = {0};
    size_t got = 0;
    int fd = open(path, O_RDONLY | O_CLOEXEC), empty = 0;

    if (fd < 0)
        return 0;
    if (film_read_at(fd, path, header, sizeof header, 0, &got, NULL) == STATUS_OK && got <= FILM_HEADER_SIZE)
        empty = header[0] == 0 && memcmp(header, header + 1, FILM_HEADER_SIZE) == 0;
    close(fd);
    return empty;
}

status film_file_check(const char *path, int kept, uint64_t job, uint32_t frame, uint32_t *lost, struct error *err)
{
    struct film_loader loader = {0};
    struct film *film = film_of_header(path);
    uint64_t end;
    int fd = -1;
    status s;

    *lost = 0;
    if (!film && !kept && is_empty(path))
        return STATUS_OK; /* nothing was written yet */
    if (!film)
        return error_set(err, STATUS_ERR_NOT_FOUND, "%s: is no film", path);
    s = film_log_open(&fd, path, kept ? film_kept_magic : film_work_magic, film, job, frame, err);
    THEN(s, film_loader_init(&loader, film, err));
    THEN(s, film_log_scan(fd, path, film, film_loader_take, &loader, &end, err));
    if (s == STATUS_OK)
        *lost = film_loader_lost(&loader);
    for (uint32_t t = 0; s == STATUS_OK && kept && t < film_tile_count(film); t++)
        *lost += !loader.lost[t] && film_tile_samples(film, t) == 0;
    film_loader_release(&loader);
    if (fd >= 0)
        close(fd);
    film_free(film);
    return s;
}
