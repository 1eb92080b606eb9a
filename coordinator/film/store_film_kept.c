/* The compact film of a done frame: a header like that of a film in work, with a magic of its own,
 * then the notes, then the states of all tiles in order, each as written by film_tile_save. The
 * file is written once and never changed: a frame that continues writes to a film in work beside
 * it. */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "common/base/file.h"
#include "common/base/log.h"
#include "common/base/memory.h"
#include "coordinator/film/store_film_parts.h"

static const char kept_magic[8] = "AZKEPT2\n";

static status io_error(const char *path, const char *what, struct error *err)
{
    return error_set(err, STATUS_ERR_IO, "%s: cannot be %s: %s", path, what, strerror(errno));
}

static status write_states(FILE *file, const char *path, const struct film *film, struct error *err)
{
    uint8_t *bytes = mem_alloc(film_tile_state_bound(film, 0)); /* no tile is larger */
    status s = bytes ? STATUS_OK : error_no_memory(err, "a film to keep");

    for (uint32_t t = 0; t < film_tile_count(film) && s == STATUS_OK; t++) {
        size_t size = film_tile_state_size(film, t);
        film_tile_save(film, t, bytes);
        if (fwrite(bytes, 1, size, file) != size)
            s = io_error(path, "written", err);
    }
    mem_free(bytes);
    return s;
}

static status write_file(const char *path, const struct film *film,
                         const uint8_t header[FILM_HEADER_SIZE],
                         const uint8_t notes[FILM_NOTES_SIZE], struct error *err)
{
    int fd = open(path, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
    FILE *file = fd >= 0 ? fdopen(fd, "wb") : NULL;
    status s = STATUS_OK;

    if (!file) {
        s = io_error(path, "made", err);
        if (fd >= 0)
            close(fd);
        return s;
    }
    if (fwrite(header, 1, FILM_HEADER_SIZE, file) != FILM_HEADER_SIZE)
        s = io_error(path, "written", err);
    if (s == STATUS_OK && fwrite(notes, 1, FILM_NOTES_SIZE, file) != FILM_NOTES_SIZE)
        s = io_error(path, "written", err);
    if (s == STATUS_OK)
        s = write_states(file, path, film, err);
    if (s == STATUS_OK && (fflush(file) != 0 || fsync(fd) != 0))
        s = io_error(path, "written to disk", err);
    if (fclose(file) != 0 && s == STATUS_OK)
        s = io_error(path, "written", err);
    return s;
}

status film_kept_write(const char *path, uint64_t job, uint32_t frame, const struct film *film,
                       struct film_file *file, struct error *err)
{
    uint8_t header[FILM_HEADER_SIZE], notes[FILM_NOTES_SIZE] = {0};
    struct buffer fresh = BUFFER_INIT;
    status s;

    buffer_printf(&fresh, "%s.new", path);
    if (!buffer_ok(&fresh))
        return error_no_memory(err, "a path");
    s = film_header_make(header, kept_magic, film, job, frame, err);
    if (s == STATUS_OK && file)
        s = film_file_notes_get(file, notes, err);
    if (s == STATUS_OK)
        s = write_file(buffer_text(&fresh), film, header, notes, err);
    if (s == STATUS_OK && rename(buffer_text(&fresh), path) != 0)
        s = io_error(path, "made", err);
    if (s == STATUS_OK)
        s = file_sync_folder_of(path, err);
    else
        unlink(buffer_text(&fresh));
    buffer_release(&fresh);
    return s;
}

int film_kept_read_tile(FILE *file, struct film *film, uint32_t tile, uint8_t *bytes, uint32_t durable[GROUPS],
                        status *s, struct error *err)
{
    size_t size;

    if (fread(bytes, 1, FILM_STATE_PREFIX, file) != FILM_STATE_PREFIX)
        return 0;
    size = film_tile_length(bytes);
    if (size < FILM_STATE_PREFIX || size > film_tile_state_bound(film, tile) ||
        fread(bytes + FILM_STATE_PREFIX, 1, size - FILM_STATE_PREFIX, file) !=
            size - FILM_STATE_PREFIX)
        return 0;
    if (film_tile_peek(film, tile, bytes, size, durable, NULL) != STATUS_OK)
        return 1; /* this tile is lost; the next one may be good */
    *s = film_tile_load(film, tile, bytes, size, err);
    return *s == STATUS_OK;
}

status film_kept_open(FILE **out, const char *path, uint64_t job, uint32_t frame, const struct film *film,
                      struct error *err)
{
    uint8_t wanted[FILM_HEADER_SIZE], found[FILM_HEADER_SIZE];
    status s = film_header_make(wanted, kept_magic, film, job, frame, err);
    FILE *file = s == STATUS_OK ? fopen(path, "rbe") : NULL;

    *out = NULL;
    if (s != STATUS_OK)
        return s;
    if (!file && errno != ENOENT)
        return io_error(path, "opened", err);
    if (!file || fread(found, 1, sizeof found, file) != sizeof found ||
        memcmp(found, wanted, sizeof found) != 0 || fseek(file, FILM_NOTES_SIZE, SEEK_CUR) != 0) {
        if (file)
            fclose(file);
        return error_set(err, STATUS_ERR_NOT_FOUND, "%s: there is no kept film of this frame", path);
    }
    *out = file;
    return STATUS_OK;
}

status film_kept_load(const char *path, uint64_t job, uint32_t frame, struct film *film,
                      uint32_t (*durable)[GROUPS], struct buffer *notes, struct error *err)
{
    uint8_t noted[FILM_NOTES_SIZE];
    uint8_t wanted[FILM_HEADER_SIZE], found[FILM_HEADER_SIZE];
    FILE *file = fopen(path, "rbe");
    uint8_t *bytes = NULL;
    uint32_t lost = 0;
    status s;

    if (!file)
        return errno == ENOENT ? STATUS_OK : io_error(path, "opened", err);
    s = film_header_make(wanted, kept_magic, film, job, frame, err);
    if (s == STATUS_OK && (fread(found, 1, sizeof found, file) != sizeof found ||
                           memcmp(found, wanted, sizeof found) != 0 ||
                           fread(noted, 1, sizeof noted, file) != sizeof noted)) {
        log_warn("%s: is damaged, or of another version; the frame will be rendered from its "
                 "beginning", path);
        fclose(file);
        return STATUS_OK;
    }
    if (s == STATUS_OK)
        buffer_append(notes, noted, sizeof noted);
    bytes = mem_alloc(film_tile_state_bound(film, 0));
    if (s == STATUS_OK && !(bytes && buffer_ok(notes)))
        s = error_no_memory(err, "a kept film");
    for (uint32_t t = 0; t < film_tile_count(film) && s == STATUS_OK; t++) {
        if (!film_kept_read_tile(file, film, t, bytes, durable[t], &s, err))
            t = film_tile_count(film) - 1;
    }
    for (uint32_t t = 0; t < film_tile_count(film); t++)
        lost += film_tile_samples(film, t) == 0;
    if (s == STATUS_OK && ferror(file))
        s = io_error(path, "read", err);
    else if (s == STATUS_OK && lost > 0)
        log_warn("%s: %u tiles are damaged and will be rendered again", path, lost);
    mem_free(bytes);
    fclose(file);
    return s;
}
