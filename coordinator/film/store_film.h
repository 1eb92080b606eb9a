/* store_film: a frame's film on disk, so that nothing acknowledged is lost.
 *
 * File: a header of FILM_FILE_HEADER bytes (magic, geometry, job, frame, check; a note for each
 * group: length, hash, bytes), then two slots for each tile: a serial number, its hash,
 * film_tile_save's bytes. A slot's place follows from film_tile_state_bound; only existing states
 * are written, and the rest is a hole. A tile's new state goes to the slot that does not hold its
 * newest durable one, with the next serial number. A slot torn by a crash is refused by its
 * checksum, and the older one counts. A file with another header (damaged, or of another version)
 * is kept beside it as FILE.unusable until the job ends.
 *
 * The film of a done frame is kept in another, compact file: one state per tile
 * (store_film_kept.c). When the frame continues, that file is loaded first, and a film in work
 * beside it has the newer states.
 *
 * film_file_write, film_file_sync and the notes' functions may be called from any thread; they
 * exclude each other.
 */
#ifndef AZULEJO_COORDINATOR_STORE_FILM_H
#define AZULEJO_COORDINATOR_STORE_FILM_H

#include <stdint.h>

#include "common/base/buffer.h"
#include "common/base/status.h"
#include "common/film/film.h"

enum { FILM_FILE_HEADER = 4096, FILM_SLOTS = 2 };

struct film_file;

/* Open or create the file and load its states into the film if they have more passes than the film;
 * durable[tile] (0 or what was loaded before) and slot[tile] are set accordingly. Damaged slots are
 * logged, and rendered again. A read-only file is accepted, and opened again when it is written to.
 * ERR_IO, ERR_NO_MEMORY: the file is unchanged. */
status film_file_open(struct film_file **out, const char *path, uint64_t job, uint32_t frame,
                      struct film *film, uint32_t (*durable)[GROUPS], uint8_t *slot, struct error *err)
    MUST_CHECK;
void film_file_close(struct film_file *file); /* NULL is fine */

status film_file_write(struct film_file *file, uint32_t tile, uint8_t slot, const uint8_t *state,
                       size_t size_bytes, struct error *err) MUST_CHECK;
status film_file_sync(struct film_file *file, struct error *err) MUST_CHECK;

/* A few bytes that belong to a group of the film as a whole; film_file_sync makes them durable.
 * Reading appends nothing if there is no note or an incomplete one. ERR_LIMIT: too long. */
enum { FILM_NOTE_MAX = 1520 };
status film_file_note_write(struct film_file *file, uint32_t group, const struct buffer *note,
                            struct error *err) MUST_CHECK;
status film_file_note_read(struct film_file *file, uint32_t group, struct buffer *out,
                           struct error *err) MUST_CHECK;

/* Write a film that is complete, atomically, with the notes of the one in work (`file`; NULL: none). Any
 * thread. ERR_IO, ERR_NO_MEMORY. */
status film_kept_write(const char *path, uint64_t job, uint32_t frame, const struct film *film,
                       struct film_file *file, struct error *err) MUST_CHECK;
/* Load it into a new, empty film, and append its notes; nothing happens without a file. Damaged
 * tiles are logged, and rendered again. ERR_IO, ERR_NO_MEMORY. */
status film_kept_load(const char *path, uint64_t job, uint32_t frame, struct film *film,
                      uint32_t (*durable)[GROUPS], struct buffer *notes, struct error *err) MUST_CHECK;
/* Read a film tile by tile, in the memory of one: what was kept of it, and what is newer of a film in work that is
 * not open. Any thread, one at a time. */
struct film_reader;
/* The two files, either of which may be missing, of a job with these settings. ERR_NOT_FOUND: there is neither, or
 * they are damaged; ERR_IO, ERR_NO_MEMORY. */
status film_reader_open(struct film_reader **out, const char *kept_path, const char *work_path, uint64_t job,
                        uint32_t frame, const struct render_settings *settings, struct error *err) MUST_CHECK;
/* Load the next tile, row-major, from 0 on, and forget the one before. A damaged one has no samples.
 * ERR_NOT_FOUND: there is no other. ERR_IO, ERR_NO_MEMORY. */
status film_reader_next(struct film_reader *reader, uint32_t *tile, struct error *err) MUST_CHECK;
/* It holds the loaded tile alone. */
const struct film *film_reader_film(const struct film_reader *reader);
void film_reader_close(struct film_reader *reader); /* NULL is fine */

/* Copy the notes of a kept film into a film in work that has none, and sync it. */
status film_file_notes_restore(struct film_file *file, const struct buffer *notes,
                               struct error *err) MUST_CHECK;

/* For tests: let this many writes succeed, then fail as if the disk were full; negative: never
 * fail. */
void film_file_fault(long successes);

#endif
