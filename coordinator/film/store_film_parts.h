/* store_film_parts: shared by both kinds of film files; private to them. */
#ifndef AZULEJO_COORDINATOR_STORE_FILM_PARTS_H
#define AZULEJO_COORDINATOR_STORE_FILM_PARTS_H

#include "common/base/digest.h"
#include "coordinator/film/store_film.h"

enum { FILM_NOTE_HEADER = 16, FILM_NOTES_SIZE = GROUPS * (FILM_NOTE_HEADER + FILM_NOTE_MAX) };
enum { FILM_HEADER_FIELDS = 48, FILM_HEADER_SIZE = FILM_HEADER_FIELDS + DIGEST_BYTES };

/* magic, width, height, AOVs, job, frame, the SHA-256 of these. */
status film_header_make(uint8_t header[FILM_HEADER_SIZE], const char magic[8],
                        const struct film *film, uint64_t job, uint32_t frame,
                        struct error *err) MUST_CHECK;

/* All notes as they are in the file, zeros for missing ones. */
status film_file_notes_get(struct film_file *file, uint8_t notes[FILM_NOTES_SIZE],
                           struct error *err) MUST_CHECK;

#endif
