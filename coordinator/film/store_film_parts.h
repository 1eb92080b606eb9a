/* store_film_parts: shared by both kinds of film files; private to them.
 *
 * store_film.c         a film in work
 * store_film_kept.c    a film that is kept
 * store_film_reader.c  both, tile by tile
 * store_film_log.c     records: reading and writing them
 * store_film_room.c    which records are not needed any more
 */
#pragma once

#include <stddef.h>

#include "common/base/digest.h"
#include "coordinator/film/store_film.h"

enum { FILM_HEADER_FIELDS = 48, FILM_HEADER_SIZE = FILM_HEADER_FIELDS + DIGEST_BYTES };
extern const char film_work_magic[8], film_kept_magic[8];

/* magic, width, height, AOVs, job, frame, the SHA-256 of these. */
status film_header_make(uint8_t header[FILM_HEADER_SIZE], const char magic[8], const struct film *film, uint64_t job,
                        uint32_t frame, struct error *err) MUST_CHECK;

/* ---- records (store_film_log.c) --------------------------------------------------------------- */

/* Little-endian: magic, kind, tile (of a note: its group), bytes of the payload (32 bits each), check of the payload, check of
 * all this (64 bits each). The payload is filled up with zeros to whole 8 bytes. */
enum { FILM_RECORD_HEADER = 32 };
enum film_record_kind { FILM_RECORD_UNIT = 1, FILM_RECORD_TILE, FILM_RECORD_NOTE, FILM_RECORD_EMPTY };
struct film_record {
    enum film_record_kind kind;
    uint32_t tile, size;
    uint64_t at;         /* of its header in the file */
    const uint8_t *data; /* the payload */
};

static inline size_t film_record_length(size_t payload_bytes)
{
    return FILM_RECORD_HEADER + (payload_bytes + 7) / 8 * 8;
}
/* Append a record without checks, and return the place of its payload; NULL: out of memory. */
uint8_t *film_record_add(struct buffer *out, enum film_record_kind kind, uint32_t tile, size_t size);
/* Set the checks of all records. */
void film_records_seal(struct buffer *records);
/* Go to the next of records in memory, from 0 bytes on. 0: there is none. */
int film_records_next(const struct buffer *records, size_t *at, struct film_record *out);
/* The records of states, compressed and appended. ERR_NO_MEMORY. */
status film_records_pack(struct buffer *out, const struct buffer *states, struct error *err) MUST_CHECK;

/* Open the film of this frame to read it. ERR_NOT_FOUND: there is none, or (*fd FILM_LOG_OTHER) it is damaged or of
 * another version or frame. ERR_IO. *fd is negative on failure. */
enum { FILM_LOG_OTHER = -2 };
status film_log_open(int *fd, const char *path, const char magic[8], const struct film *film, uint64_t job,
                     uint32_t frame, struct error *err) MUST_CHECK;
/* Visit the good records of a file, in its order. *end: behind the last of them. `data` NULL: the payload is damaged,
 * but something good stands behind it. visit's error ends it. ERR_IO, ERR_NO_MEMORY. */
status film_log_scan(int fd, const char *path, const struct film *film,
                     status (*visit)(void *user, const struct film_record *record, struct error *err), void *user,
                     uint64_t *end, struct error *err) MUST_CHECK;

/* Brings records into a film. */
struct film_loader {
    struct film *film;
    uint8_t *bytes[2]; /* a state, and the same in another order */
    uint8_t *lost;     /* [tiles] something of the tile is damaged or missing */
    uint32_t (*durable)[GROUPS];
    struct buffer *notes; /* [GROUPS] the last ones; may be NULL, as may durable */
};
/* ERR_NO_MEMORY. */
status film_loader_init(struct film_loader *loader, struct film *film, struct error *err) MUST_CHECK;
void film_loader_release(struct film_loader *loader);
/* As film_log_scan calls it. ERR_NO_MEMORY. */
status film_loader_take(void *loader, const struct film_record *record, struct error *err) MUST_CHECK;
uint32_t film_loader_lost(const struct film_loader *loader); /* tiles */

/* Write at an offset, all of it. ERR_IO. */
status film_write_at(int fd, const char *path, const uint8_t *data, size_t size, uint64_t offset,
                     struct error *err) MUST_CHECK;
/* How many bytes there were, short only at the file's end. ERR_IO. */
status film_read_at(int fd, const char *path, uint8_t *data, size_t size, uint64_t offset, size_t *got,
                    struct error *err) MUST_CHECK;

/* ---- room (store_film_room.c) ----------------------------------------------------------------- */

enum { FILM_BANDS = 8 };
/* Records that follow each other and are of one band of tiles. */
struct film_run {
    uint64_t begin, end;
    uint32_t band; /* FILM_BANDS: none of it is needed */
};
struct film_room {
    uint32_t tiles;
    struct film_run *runs; /* ascending */
    size_t count, capacity;
    uint64_t used, limit; /* bytes */
    int cleaning;         /* the states of `band` are being written, since `begun`, up to `next` */
    int has_no_holes;     /* the file system cannot make any */
    uint32_t band, next;
    uint64_t begun;
};
/* A record was appended. Without memory it is never given back. */
void film_room_add(struct film_room *room, const struct film_record *record);
/* The states of *stale are on disk, and `end` is the file's: say which should come next. Room is given back through
 * `fd`, open for writing. */
void film_room_step(struct film_room *room, int fd, uint64_t end, struct film_stale *stale);
