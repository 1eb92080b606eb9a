/* store: what survives a restart. The only SQL is here.
 *
 * STORE/lock              held (flock) while a coordinator uses the store
 * STORE/hold              held (flock) while a backup is made, or something is removed (store_hold.h)
 * STORE/reserve           space kept back for queue.sqlite (reserve.h)
 * STORE/queue.sqlite      jobs, frames that are done or cut short, the history of their errors, the
 *                         workers that delivered results or left, owners' shares, the lease epoch, tokens, events that wait
 *                         (WAL, full sync)
 * STORE/audit.log, .1 ... who did what (audit.h)
 * STORE/web.token         the page's own token (coordinator/page/tokens.h)
 * STORE/blobs/ab/HEX      blobs by SHA-256 (blobs.h)
 * STORE/blobs/tmp/        unfinished uploads; emptied at the start
 * STORE/films/JOB/frame-NNNN.film   films in work (store_film.h)
 *                 frame-NNNN.kept   films of frames that are done: azulejo extend and retry go on from them
 * STORE/trash/            what was removed; its thread empties it (common/system/trash.h)
 * STORE/outputs/JOB/frame-NNNN.exr, .png, .jpg, .effects.json
 *     .picture.exr        the means in 32 bits, where frame-NNNN.exr is not that
 *     .sums               their SHA-256 (store_sums.c)
 *     .state              what tone mapping measured (develop.c): only saves time
 *
 * What is removed goes to the trash by a rename: the room of a large file is never freed on the loop's thread.
 *
 * Folders have mode 700, files 600.
 *
 * A failure of the environment (status_is_environment) changes nothing, and may be tried again at any time:
 *
 *   WORKING --a write fails: store_suspect--> store_check says whether the store itself is the cause
 *     ^                                                               |
 *     +------------------store_check: STATUS_OK------------ FAILING <-+
 *
 * A store that can be read but not written is opened as well, with read_only and without storing its epoch; store_check
 * makes up for both.
 *
 * Functions marked [any thread] may be called from any thread, the others from the one that opened the store.
 */
#pragma once

#include <stdint.h>

#include "common/base/buffer.h"
#include "common/base/status.h"
#include "coordinator/job/order.h"
#include "coordinator/job/queue.h"
#include "coordinator/film/store_film.h"

struct store;

/* ERR_REFUSED: another coordinator uses it. ERR_IO, ERR_NO_MEMORY: cannot be made or read; nothing was
 * changed. ERR_CORRUPT: not a store, damaged, or of a newer version. */
status store_open(struct store **out, const char *folder, struct error *err) MUST_CHECK;
/* Waits for the waiting saves, and for the one file whose room is being freed. */
void store_close(struct store *store);
const char *store_folder(const struct store *store);

/* Can it be used? If not, and the environment is the cause, the text says what to do. Repeats steps
 * that failed before: folders, the database, the epoch, the reserve, saves. Writes a small file,
 * and syncs nothing. ERR_IO, ERR_NO_MEMORY. */
status store_check(struct store *store, struct error *err) MUST_CHECK;
/* Did something fail since the last store_check, so that it should be called? [any thread] */
int store_suspect(const struct store *store);

/* The epoch that this run's leases start after: greater than any that an earlier run of this store
 * can have granted, and, by the wall clock, than those of another store. It must be stored before a
 * lease is granted: if that fails now, store_check does it later. */
status store_epoch_begin(struct store *store, int64_t wall_s, uint64_t *epoch, struct error *err) MUST_CHECK;
int store_epoch_stored(const struct store *store);

/* Give the job an id and store it. Fails if a stored job has its token. [any thread] */
status store_job_insert(struct store *store, struct job *job, struct error *err) MUST_CHECK;
/* The stored job that was submitted with the job's token; 0: none. ERR_REFUSED when that one is
 * another job (wire_job_same). [any thread] */
status store_job_find(struct store *store, const struct job *job, uint64_t *id, struct error *err) MUST_CHECK;
/* Undo an insert, soon; failure is logged. */
void store_job_forget(struct store *store, uint64_t id);
/* Store its state and counters soon, by the store's own thread: a sync can take seconds while films are written. A
 * save that fails is kept, and repeated when store_check finds the store usable; store_close tries
 * the waiting saves once more. The films of a job that ended with discard are removed only
 * when its state is on disk. ERR_NO_MEMORY: the save was not noted. */
status store_job_save_later(struct store *store, const struct job *job, uint64_t now_ns, struct error *err) MUST_CHECK;
/* Call done(user, ...) from store_deliver, when all that was noted before (saves, events, workers, shares) is on disk.
 * ERR_IO, ERR_NO_MEMORY: it cannot be written at present, and stays noted. */
typedef void store_done_fn(void *user, status s, const struct error *err);
status store_when_saved(struct store *store, store_done_fn *done, void *user, struct error *err) MUST_CHECK;
/* Call what is due of that. store_on_saved says what is called when something is due: wake(user), from any thread, which
 * must only note it. */
void store_deliver(struct store *store);
void store_on_saved(struct store *store, void (*wake)(void *user), void *user);
/* Wait until all that is noted was tried, and deliver. */
void store_settle(struct store *store);
/* Wait until all earlier saves of store_job_save_later are on disk. ERR_IO, ERR_NO_MEMORY: they
 * cannot be written at present. [any thread] */
status store_await_saves(struct store *store, struct error *err) MUST_CHECK;
/* Is a save of this job waiting? [any thread] */
int store_job_unsaved(struct store *store, uint64_t id);
/* Every job, ascending id, with its done frames marked. `adopt` takes ownership when it returns
 * STATUS_OK. A row that cannot be read is an error: no job is dropped silently. */
status store_jobs_load(struct store *store, status (*adopt)(void *user, struct job *job, struct error *err), void *user,
                       struct error *err) MUST_CHECK;

/* Remove a job that has ended: its rows soon, its films and pictures with store_job_clear. A
 * restart before that does it. ERR_NO_MEMORY: nothing changed. */
status store_job_remove(struct store *store, uint64_t id, struct error *err) MUST_CHECK;
/* Remove the films and pictures of a job that store_job_remove removed, when that is on disk. Failure is logged; the next
 * start tries again. While a backup is being made (store_hold.h) they stay. */
void store_job_clear(struct store *store, uint64_t id);
/* Clear the jobs that were removed before the last run ended, or during a backup. */
void store_clear_removed(struct store *store);
/* Clear those that could not be, for a backup or a sweep of blobs. */
void store_clear_held(struct store *store);

enum { JOB_EVENTS_MAX = 1000, JOB_WORKER_LINES_MAX = 64 }; /* kept of a job, the newest */
/* A line of a job's log. */
struct job_event {
    uint64_t job, seq;         /* seq ascends; the store gives it */
    int64_t at;                /* seconds since 1970, UTC */
    int from_worker;           /* a line of a worker, which is `who` */
    char who[JOB_WHO_MAX + 1]; /* user@host, or "coordinator" */
    char text[JOB_TEXT_MAX + 1];
};
/* Note the event; it is stored soon. Its seq, which is never given again, also not after a restart; 0: there is no
 * memory for it. If the store fails for long, events are lost. */
uint64_t store_event_later(struct store *store, const struct job_event *event);
enum { FARM_EVENTS_MAX = 1000 };
/* The same for all jobs: the oldest `limit` events after `after`, or the newest of them. */
status store_events_load_all(struct store *store, uint64_t after, int newest, uint32_t limit,
                             status (*visit)(void *user, const struct job_event *event, struct error *err), void *user,
                             struct error *err) MUST_CHECK;
/* Call visit for the job's stored events after `after`. visit's error ends it. ERR_IO, ERR_NO_MEMORY. */
status store_events_load(struct store *store, uint64_t job, uint64_t after,
                         status (*visit)(void *user, const struct job_event *event, struct error *err), void *user,
                         struct error *err) MUST_CHECK;

/* Store what an owner used, soon. ERR_NO_MEMORY: it was not noted. */
status store_share_save_later(struct store *store, const struct owner_share *share, struct error *err) MUST_CHECK;
/* Read the shares of all owners. ERR_IO, ERR_NO_MEMORY. */
status store_shares_load(struct store *store, struct order *order, struct error *err) MUST_CHECK;

enum { WORKER_LABEL_MAX = 127 }; /* bytes of a worker's name on its farm (protocol/worker_name.h) */

/* A worker that delivers results. Numbers start at 1 and are never reused. */
struct deliverer {
    uint32_t number, process;
    char host[64], software[64];
    int64_t first_seen;               /* seconds since 1970, UTC */
    char label[WORKER_LABEL_MAX + 1]; /* its name on the farm; of older stores as it was found, if at all */
};
/* The last stored number; 0: none. */
status store_deliverers_last(struct store *store, uint32_t *last, struct error *err) MUST_CHECK;
/* Store it later, like store_job_save_later: it is on disk before any film that is synced after store_await_saves. */
status store_deliverer_save_later(struct store *store, const struct deliverer *deliverer, struct error *err) MUST_CHECK;
/* out->number is 0 if the number is not known. [any thread] */
status store_deliverer_find(struct store *store, uint32_t number, struct deliverer *out, struct error *err) MUST_CHECK;

enum {
    WORKERS_GONE_MAX = 1000,     /* processes of workers that left, of which what they did is kept */
    WORKER_LINES_MAX = 16,       /* of its log, the newest */
    WORKER_LINE_SIZE = 208,
};
struct worker_line {
    int64_t at;                  /* seconds since 1970, UTC */
    char text[WORKER_LINE_SIZE]; /* without control characters */
};
/* What one process of a worker did. */
struct worker_row {
    char name[WORKER_LABEL_MAX + 1], host[64], address[64], software[64], why[256];
    uint64_t instance; /* of the process, not 0 */
    uint32_t process, threads, connections;
    int64_t joined_at, left_at, seen_at; /* seconds since 1970, UTC; left_at 0: it is connected */
    uint64_t units, samples, cpu_ns;
    uint32_t line_count;
    struct worker_line lines[WORKER_LINES_MAX];
};
/* Store the row soon. If that process has one, connections, units, samples and cpu_ns are added to
 * its own. Without memory, or if the store fails for long, it is lost. */
void store_worker_later(struct store *store, const struct worker_row *row);
/* At the start: workers that were connected when the last run was killed have left. ERR_IO, ERR_NO_MEMORY. */
status store_workers_begin(struct store *store, struct error *err) MUST_CHECK;
/* Call visit for those that left, the last first; `name` "": of all names. ERR_IO, ERR_NO_MEMORY. */
status store_workers_gone(struct store *store, const char *name,
                          status (*visit)(void *user, const struct worker_row *row, struct error *err), void *user,
                          struct error *err) MUST_CHECK;

/* A name that a person drained or blocked. */
struct worker_mark {
    char name[WORKER_LABEL_MAX + 1];
    int blocked;               /* until it is unblocked; else drained, as long as the process lives */
    uint64_t instance;         /* of that process; 0: blocked */
    char who[JOB_WHO_MAX + 1]; /* user@host */
    int64_t at;                /* seconds since 1970, UTC */
};
/* Stored soon. ERR_NO_MEMORY: nothing changed. */
status store_worker_mark(struct store *store, const struct worker_mark *mark, struct error *err) MUST_CHECK;
status store_worker_unmark(struct store *store, const char *name, struct error *err) MUST_CHECK;
status store_worker_marks_load(struct store *store,
                               status (*visit)(void *user, const struct worker_mark *mark, struct error *err),
                               void *user, struct error *err) MUST_CHECK;

/* Who rendered a frame. */
struct frame_makers {
    struct buffer deliverers; /* their numbers, 32 bits each, little-endian; empty: not known */
    int64_t done_at;          /* seconds since 1970, UTC */
};
/* A frame whose outputs are on disk. */
struct frame_done {
    uint64_t job, epoch_floor;
    uint32_t frame;
    int64_t revision;                /* of the job's output settings that its pictures follow; -1: there are none yet */
    enum frame_end end;              /* the reason, if it was cut */
    const struct film_coverage *cut; /* its coverage if that is less than the cap allows; NULL: it is complete */
    const struct unit_work *work;    /* of its film */
    const struct history_point *point; /* its figures, as in store_history_add; NULL: none */
    uint32_t place;
    const struct frame_makers *makers; /* NULL: not known */
};
/* Note it, in one transaction. ERR_REFUSED: the job was extended since it had this epoch_floor, and the frame is not
 * done. [any thread] */
status store_frame_done(struct store *store, const struct frame_done *done, struct error *err) MUST_CHECK;
/* ---- whose results are not believed (store_trust.c) ---- */

/* A deliverer whose results are not believed. */
struct distrusted {
    uint32_t number;
    int64_t since; /* of frames that are done, those done from then on; seconds since 1970, UTC */
};
/* Call visit for the numbers of each deliverer that worker_label_is_of that name. ERR_IO, ERR_NO_MEMORY. */
status store_deliverers_of(struct store *store, const char *label,
                           status (*visit)(void *user, uint32_t number, struct error *err), void *user,
                           struct error *err) MUST_CHECK;
/* Noted, and on disk before any later answer. ERR_NO_MEMORY: nothing changed. */
status store_distrust(struct store *store, const struct distrusted *who, struct error *err) MUST_CHECK;
status store_distrusted_load(struct store *store,
                             status (*visit)(void *user, const struct distrusted *who, struct error *err), void *user,
                             struct error *err) MUST_CHECK;
/* What a worker answered for a unit that is to be rendered again (unit_audits.h). */
struct unit_vote {
    uint64_t job, epoch_floor;
    uint32_t frame, place; /* 0: the worker that delivered it */
    uint32_t tile, group, pass;
    char label[WORKER_LABEL_MAX + 1];
    uint64_t hash; /* unit_hash() */
    struct digest digest;
    int has_digest;
};
/* Noted; store_votes_remove takes those of the unit away. ERR_NO_MEMORY: nothing changed. */
status store_vote_add(struct store *store, const struct unit_vote *vote, struct error *err) MUST_CHECK;
status store_votes_remove(struct store *store, const struct unit_vote *vote, struct error *err) MUST_CHECK;
/* Call visit for all of them, those of one unit one after the other, by place. ERR_IO, ERR_NO_MEMORY. */
status store_votes_load(struct store *store, status (*visit)(void *user, const struct unit_vote *vote, struct error *err),
                        void *user, struct error *err) MUST_CHECK;
/* Call visit for each done frame whose makers are known. ERR_IO, ERR_NO_MEMORY. */
status store_frames_made(struct store *store,
                         status (*visit)(void *user, uint64_t job, uint32_t frame, const struct frame_makers *makers,
                                         struct error *err),
                         void *user, struct error *err) MUST_CHECK;

/* Store a point of the frame's history at its place; later points are deleted. [any thread] */
status store_history_add(struct store *store, uint64_t job, uint32_t frame, uint32_t place,
                         const struct history_point *point, struct error *err) MUST_CHECK;
/* Note the figures of the frame's denoised picture with its last point. [any thread] */
status store_history_denoised(struct store *store, uint64_t job, uint32_t frame, const struct accuracy_figures *figures,
                              struct error *err) MUST_CHECK;
/* Read the frame's history. [any thread] */
status store_history_load(struct store *store, uint64_t job, uint32_t frame, struct history *out,
                          struct error *err) MUST_CHECK;
/* Call visit with the samples and core-seconds of each of the job's frames that has a history, as of its last point. ERR_IO. */
status store_history_samples(struct store *store, uint64_t job,
                             void (*visit)(void *user, uint32_t frame, uint64_t samples, double core_s), void *user,
                             struct error *err) MUST_CHECK;
/* The clock of the frame's limits, as last saved with its job; 0: not saved. */
status store_clock_load(struct store *store, uint64_t job, uint32_t frame, struct frame_clock *out,
                        struct error *err) MUST_CHECK;
/* The pictures of a frame that is done were made again. [any thread] */
status store_frame_developed(struct store *store, uint64_t job, uint32_t frame, int64_t revision,
                             struct error *err) MUST_CHECK;
/* Store the changed settings of a job that has not ended, or of one that goes on and is QUEUED then: the chosen
 * frames are deleted, and their limits count from now on. `submitted`: its new submission, NULL: as before. Stored soon;
 * of a job that goes on, store_job_save_later follows. ERR_NO_MEMORY: nothing changed. */
status store_job_extend(struct store *store, const struct job *job, const struct job_reopening *chosen,
                        const struct job *submitted, struct error *err) MUST_CHECK;
/* Sum up the work of the frames that the job has as done, and their figures, again. */
status store_job_sum(struct store *store, struct job *job, struct error *err) MUST_CHECK;
/* Store the job's changed output settings and their revision, soon. ERR_NO_MEMORY: nothing changed. */
status store_job_revise(struct store *store, const struct job *job, struct error *err) MUST_CHECK;

/* film_file_open on the frame's file. */
status store_film_open(struct store *store, uint64_t job, uint32_t frame, struct film *film,
                       uint32_t (*durable)[GROUPS], struct film_file **out, struct error *err) MUST_CHECK;
/* film_levels_load from the frame's files. */
status store_film_measure(struct store *store, uint64_t job, uint32_t frame, struct film *film,
                          struct error *err) MUST_CHECK;
/* Replace the film in work of a done frame by a compact one. The film in work must no longer be
 * written to. ERR_IO, ERR_NO_MEMORY: it remains. [any thread] */
status store_film_keep(struct store *store, uint64_t job, uint32_t frame, const struct film *film,
                       struct film_file *file, struct error *err) MUST_CHECK;
/* film_reader_open of a frame that is not open. [any thread] */
status store_film_reader(const struct store *store, uint64_t job, uint32_t frame,
                         const struct render_settings *settings, struct film_reader **out,
                         struct error *err) MUST_CHECK;
int store_film_exists(const struct store *store, uint64_t job, uint32_t frame);
/* [any thread] */
void store_film_remove(struct store *store, uint64_t job, uint32_t frame);
/* [any thread] */
void store_films_remove(struct store *store, uint64_t job);
/* Remove only the kept film of a done frame. 0: there is none. */
int store_film_kept_remove(struct store *store, uint64_t job, uint32_t frame);
/* Call visit for each job that has a folder of films. */
void store_films_list(const struct store *store, void (*visit)(void *user, uint64_t job), void *user);

/* Path of an output: append to `path`. [any thread] */
void store_output_path(const struct store *store, uint64_t job, uint32_t frame, const char *extension,
                       struct buffer *path);
/* Append an output's bytes to `out`. ERR_NOT_FOUND, ERR_IO, ERR_LIMIT, ERR_NO_MEMORY; ERR_CORRUPT as store_output_check.
 * [any thread] */
status store_output_read(const struct store *store, uint64_t job, uint32_t frame, const char *extension,
                         size_t limit_bytes, struct buffer *out, struct error *err) MUST_CHECK;
/* Write an output atomically. Its name is on disk when store_frame_done or store_frame_developed returns. [any thread] */
status store_output_write(struct store *store, uint64_t job, uint32_t frame, const char *extension,
                          const struct buffer *data, struct error *err) MUST_CHECK;
/* The digest that an output was written with. 0: none is known (older stores, a damaged list). [any thread] */
int store_output_digest(const struct store *store, uint64_t job, uint32_t frame, const char *extension,
                        struct digest *out);
/* Has a file of the frame's, read to its end, the digest that it was written with? ERR_CORRUPT: no; that is noted for
 * store_damage_take, and the text says what becomes of it. ERR_NO_MEMORY. [any thread] */
status store_output_check(const struct store *store, uint64_t job, uint32_t frame, const char *extension,
                          const struct digest *is, struct error *err) MUST_CHECK;
/* A frame with damaged files. */
struct damaged_output {
    uint64_t job;
    uint32_t frame;
    int is_display; /* only what is made of its picture */
};
/* Take one that was noted. 0: there is none. */
int store_damage_take(struct store *store, struct damaged_output *out);
