/* store_film: a frame's film on disk, so that nothing acknowledged is lost.
 *
 * File: a header (magic, geometry, job, frame, check), then records, which are only appended: a unit as it was folded
 * (film_unit_save), a tile's whole state (film_tile_save, compressed), a note, or that a tile is empty from here on. A
 * record has a header of its own, with a check of itself and one of what follows it. A tile is its states and units in
 * the order of the file, after the last record that empties it; a unit that the tile has already, or that follows a
 * missing one, counts for nothing, and so does a state with fewer passes.
 *
 *   results, folded --film_record_unit--> journal --film_file_commit: one write, one sync--> on disk
 *
 * What a crash leaves of a commit is cut off when the file is opened for writing; what is damaged before that is
 * logged, and rendered again. A commit that fails leaves the file as it was.
 *
 * Room: when the file takes more than film_file_limit, the frame is asked for the states of an eighth of its tiles (film_stale),
 * which come with the next commits. When they are on disk, what the file has of these tiles from before is
 * given back to the file system as holes (store_film_room.c). Nothing is moved, so a kill loses nothing at any step. A file
 * system without holes keeps it all.
 *
 * A file with another header (damaged, or of another version) is kept beside it as FILE.unusable until the job ends.
 *
 * The film of a done frame is kept in another file, with another magic, its notes and the state of each tile
 * (store_film_kept.c). A small film in work takes that file's name instead (film_kept_limit). When the frame continues, that file is loaded first, and a film in work beside it has
 * what came later.
 *
 * Functions of a film_file may be called from any thread. A commit excludes other commits, and none of the other functions: they
 * do not wait for the disk.
 */
#pragma once

#include <stdint.h>

#include "common/base/buffer.h"
#include "common/base/status.h"
#include "common/film/film.h"

struct film_file;

/* Open or create the file, and load what the film lacks of it; durable[tile] (0 or what was loaded before) is set to
 * the tile's passes. Damage is logged, and rendered again. A read-only file is accepted, and opened again when it is
 * written to. ERR_IO, ERR_NO_MEMORY: the file is unchanged. */
status film_file_open(struct film_file **out, const char *path, uint64_t job, uint32_t frame, struct film *film,
                      uint32_t (*durable)[GROUPS], struct error *err) MUST_CHECK;
void film_file_close(struct film_file *file); /* NULL is fine */

/* Append a record of a folded unit, or of a tile's state. 0: out of memory, and nothing is appended. */
int film_record_unit(struct buffer *out, const struct film_fold *fold);
int film_record_state(struct buffer *out, const struct film *film, uint32_t tile);
/* Take the cost of the unit whose record is at `at` from the film, which has it by now. */
void film_record_cost(struct buffer *records, size_t at, const struct film *film);

/* Tiles: [first, first + count). */
enum { FILM_STALE_MAX = 256 };
struct film_stale {
    uint32_t first, count;
};
struct film_commit {
    struct buffer units, states; /* records */
    /* In: tiles whose states are among these, or that have no samples. Out: those whose states should come next. */
    struct film_stale stale;
    uint64_t written_ns; /* out: when syncing began; 0: it did not */
};
/* Write the records: all of it is durable. ERR_IO, ERR_NO_MEMORY: nothing is, and the file is as before, as is `stale`. */
status film_file_commit(struct film_file *file, struct film_commit *commit, struct error *err) MUST_CHECK;

/* A few bytes that belong to a group of the film as a whole. The next commit, or film_file_sync, makes them durable,
 * before its units. Reading appends nothing if there is no note or a damaged one. ERR_LIMIT: too long. */
enum { FILM_NOTE_MAX = 1520 };
status film_file_note_write(struct film_file *file, uint32_t group, const struct buffer *note,
                            struct error *err) MUST_CHECK;
status film_file_note_read(struct film_file *file, uint32_t group, struct buffer *out, struct error *err) MUST_CHECK;
status film_file_sync(struct film_file *file, struct error *err) MUST_CHECK;

/* The tile has nothing any more: the film in memory at once, the file with the next commit, before its units. Until then
 * a crash brings the tile back. No result of it may be waiting for a commit. ERR_NO_MEMORY: nothing changed. */
status film_file_empty_tile(struct film_file *file, struct film *film, uint32_t tile, struct error *err) MUST_CHECK;

/* What a film of this geometry may take before room is made: 87 bytes a pixel, and as much more for each AOV. */
uint64_t film_file_limit(const struct film *film);
/* Bytes that the file's records take now. */
uint64_t film_file_bytes(struct film_file *file);

/* A film in work that takes no more when its frame is done is kept as it is: 60 bytes a pixel, and as much more for
 * each AOV. */
uint64_t film_kept_limit(const struct film *film);

/* Write a film that is complete, atomically, with the notes of the one in work (`file`; NULL: none). Any
 * thread. ERR_IO, ERR_NO_MEMORY. */
status film_kept_write(const char *path, uint64_t job, uint32_t frame, const struct film *film, struct film_file *file,
                       struct error *err) MUST_CHECK;
/* Load it into a new, empty film, and take its notes, notes[GROUPS]; nothing happens without a file. Damaged
 * tiles are logged, and rendered again. ERR_IO, ERR_NO_MEMORY. */
status film_kept_load(const char *path, uint64_t job, uint32_t frame, struct film *film, uint32_t (*durable)[GROUPS],
                      struct buffer *notes, struct error *err) MUST_CHECK;
/* Measure the levels that the film left out (film_measure_from), as far as the units of its two files are still there:
 * of a tile whose state was written in their place they stay left out. `film` has everything of the files, and is frozen.
 * ERR_IO, ERR_NO_MEMORY: nothing changed. */
status film_levels_load(const char *kept_path, const char *work_path, uint64_t job, uint32_t frame, struct film *film,
                        struct error *err) MUST_CHECK;
/* Read a film's file, and count the tiles that are damaged; `kept`: which kind it is. ERR_NOT_FOUND: all of it is, or it is of another version or frame. ERR_IO,
 * ERR_NO_MEMORY. */
status film_file_check(const char *path, int kept, uint64_t job, uint32_t frame, uint32_t *lost,
                       struct error *err) MUST_CHECK;
/* The film in work takes the notes that it has not, with its next commit. ERR_NO_MEMORY. */
status film_file_notes_restore(struct film_file *file, const struct buffer *notes, struct error *err) MUST_CHECK;

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

/* For tests: let this many writes succeed, then fail as if the disk were full; negative: never fail. */
void film_file_fault(long successes);
