/* store_film: a frame's film on disk, so that nothing acknowledged is lost.
 *
 * File: a header of FILM_FILE_HEADER bytes (magic, geometry, job, frame, check; a note for each group:
 * length, hash, bytes), then two slots for each tile: a serial number, its hash, film_tile_save's bytes. A slot's place follows from
 * film_tile_state_bound; only what there is is written, and the rest is a hole. A tile's new state goes to
 * the slot that does not hold its newest durable one, with the next serial number; a slot that was
 * torn by a crash is refused by its checksum, and the other one, which is older, counts. A file whose
 * header is not the frame's (damaged, or of another version) is kept beside it as FILE.unusable until
 * the job ends.
 *
 * The film of a frame that is done is kept in another file, closed up: one state a tile (store_film_kept.c).
 * When the frame goes on, that is loaded first, and a film in work beside it has what is newer.
 *
 * film_file_write, film_file_sync and the notes' functions may be called from any thread; each waits for
 * the others.
 */
#ifndef AZULEJO_COORDINATOR_STORE_FILM_H
#define AZULEJO_COORDINATOR_STORE_FILM_H

#include <stdint.h>

#include "common/base/buffer.h"
#include "common/base/status.h"
#include "common/film/film.h"

enum { FILM_FILE_HEADER = 4096, FILM_SLOTS = 2 };

struct film_file;

/* Open or make the file and load what it holds into the film, where that is more than the film has; durable[tile]
 * (0 or what was loaded before) and slot[tile] tell what was found. Damaged slots are logged, and rendered again. Where the file may
 * only be read, that is enough; it is opened again when it is written to. ERR_IO, ERR_NO_MEMORY: what
 * there was is there still. */
status film_file_open(struct film_file **out, const char *path, uint64_t job, uint32_t frame,
                      struct film *film, uint32_t (*durable)[GROUPS], uint8_t *slot, struct error *err)
    MUST_CHECK;
void film_file_close(struct film_file *file); /* NULL is fine */

status film_file_write(struct film_file *file, uint32_t tile, uint8_t slot, const uint8_t *state,
                       size_t size_bytes, struct error *err) MUST_CHECK;
status film_file_sync(struct film_file *file, struct error *err) MUST_CHECK;

/* A few bytes that belong to a group of the film as a whole; film_file_sync makes them durable. Reading
 * appends nothing where there is no note, or one that was not written to the end. ERR_LIMIT: too long. */
enum { FILM_NOTE_MAX = 1520 };
status film_file_note_write(struct film_file *file, uint32_t group, const struct buffer *note,
                            struct error *err) MUST_CHECK;
status film_file_note_read(struct film_file *file, uint32_t group, struct buffer *out,
                           struct error *err) MUST_CHECK;

/* The film is not needed any more: free its room now, so that closing takes no time. */
void film_file_discard(struct film_file *file);

/* Write a film that is complete, atomically, with the notes of the one in work (`file`; NULL: none). Any
 * thread. ERR_IO, ERR_NO_MEMORY. */
status film_kept_write(const char *path, uint64_t job, uint32_t frame, const struct film *film,
                       struct film_file *file, struct error *err) MUST_CHECK;
/* Load it into a new, empty film, and append its notes; nothing where there is none. What is damaged is logged,
 * and rendered again. ERR_IO, ERR_NO_MEMORY. */
status film_kept_load(const char *path, uint64_t job, uint32_t frame, struct film *film,
                      uint32_t (*durable)[GROUPS], struct buffer *notes, struct error *err) MUST_CHECK;
/* Put the notes of a kept film into a film in work that has none, and onto the disk. */
status film_file_notes_restore(struct film_file *file, const struct buffer *notes,
                               struct error *err) MUST_CHECK;

/* Tests: let so many more writes succeed, then fail as if the disk were full; negative: never. */
void film_file_fault(long successes);

#endif
