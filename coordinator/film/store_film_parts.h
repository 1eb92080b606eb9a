/* store_film_parts: shared by both kinds of film files; private to them. */
#ifndef AZULEJO_COORDINATOR_STORE_FILM_PARTS_H
#define AZULEJO_COORDINATOR_STORE_FILM_PARTS_H

#include <stdio.h>

#include "common/base/digest.h"
#include "coordinator/film/store_film.h"

enum { FILM_NOTE_HEADER = 16, FILM_NOTES_SIZE = GROUPS * (FILM_NOTE_HEADER + FILM_NOTE_MAX) };
enum { FILM_HEADER_FIELDS = 48, FILM_HEADER_SIZE = FILM_HEADER_FIELDS + DIGEST_BYTES };

/* magic, width, height, AOVs, job, frame, the SHA-256 of these. */
status film_header_make(uint8_t header[FILM_HEADER_SIZE], const char magic[8],
                        const struct film *film, uint64_t job, uint32_t frame,
                        struct error *err) MUST_CHECK;

/* A kept film, behind its header and notes. ERR_NOT_FOUND: there is none of this frame. */
status film_kept_open(FILE **out, const char *path, uint64_t job, uint32_t frame, const struct film *film,
                      struct error *err) MUST_CHECK;
/* Load the next tile's state; `bytes` has room for the largest. 0: the file ends, or is damaged here. */
int film_kept_read_tile(FILE *file, struct film *film, uint32_t tile, uint8_t *bytes, uint32_t durable[GROUPS],
                        status *s, struct error *err);

/* Open an existing film in work only to read it; nothing is loaded. ERR_NOT_FOUND: there is none of this frame. */
status film_file_look(struct film_file **out, const char *path, uint64_t job, uint32_t frame,
                      const struct film *film, struct error *err) MUST_CHECK;
/* Load one tile's newest good state, if it has the film's passes and more. `bytes` has room for
 * film_file_tile_bytes. */
size_t film_file_tile_bytes(const struct film_file *file);
status film_file_load_tile(struct film_file *file, struct film *film, uint32_t tile, uint8_t *bytes,
                           struct error *err) MUST_CHECK;

/* All notes as they are in the file, zeros for missing ones. */
status film_file_notes_get(struct film_file *file, uint8_t notes[FILM_NOTES_SIZE],
                           struct error *err) MUST_CHECK;

#endif
