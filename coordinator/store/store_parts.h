/* store_parts: the inside of the store, shared by its files; private to its files.
 *
 * store.c           the folder, its lock, the lease epoch; opens and closes the others
 * store_database.c  the connection, the tables and their versions, running a statement
 * store_jobs.c      the rows: jobs that are new, kept, revised, loaded; frames that are done
 * store_history.c   the rows of frames' figures
 * store_saves.c     the writer thread: jobs' counters and states, and all else that is noted; who waits for it
 * store_remove.c    jobs are removed, with their rows and files
 * store_events.c    the event logs of jobs
 * store_shares.c    what owners used recently
 * store_workers.c   what workers did and delivered, and the names that people drained or blocked
 * store_trust.c     whose results are not believed, and which frames they rendered
 * store_noted.c     rows that wait for the writer thread
 * store_changes.c   statements that wait for it: what people change
 * store_web.c       tokens of the page, events that wait for their program (store_web.h)
 * store_rot.c       looks through a store that is not used, and mends it (store_rot.h)
 * store_files.c     the places of films and outputs
 * store_rows.c      the digests of rows, and which are damaged
 * store_sums.c      the digests of outputs, and which are damaged
 */
#pragma once

#include <pthread.h>
#include <sqlite3.h>
#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>

#include "coordinator/store/store.h"
#include "coordinator/store/store_hold.h"

struct saved_job;
struct saved_share;
struct damage;
struct saved_wait;
struct trash;

/* Rows that wait for the writer thread, the oldest first; each begins with its link and is mem_alloc'd. */
struct noted {
    struct noted *next;
};
struct noted_list {
    struct noted *first, **end, *taken; /* end: only if there are any; taken: being written now */
    size_t count;                       /* without those taken */
};
/* `lock` is held for each of these. Of more than `most` rows the oldest is forgotten: the store has failed for long. */
void noted_add(struct noted_list *list, void *row, size_t most);
void noted_take(struct noted_list *list);
/* The rows taken are forgotten where they were written, and noted again where not. */
void noted_settle(struct noted_list *list, int written);
void noted_drop(struct noted_list *list);

enum { STATEMENTS_READY = 16 };

struct store {
    char *folder;
    struct store_lock folder_lock;
    sqlite3 *db;                           /* what is written goes through it */
    sqlite3_stmt *ready[STATEMENTS_READY]; /* prepared for `db`, for the next time; used while `order` is held */
    unsigned ready_next;                   /* whose place the next one takes */
    sqlite3 *reader;                       /* questions: it waits for no writer. NULL: it could not be opened */
    pthread_mutex_t reading; /* held while `reader` is used or exchanged; taken after `order`, before `lock` */
    atomic_int read_only;    /* `db` was opened for reading, also by SQLite itself; store_check opens it again */
    uint64_t epoch_limit;    /* to be stored; 0: it is */
    atomic_int suspect;
    struct damage *damage;
    struct trash *trash;   /* its thread empties STORE/trash */
    atomic_int clear_held; /* files of removed jobs are still there: a backup was being made */

    /* Saves that wait for the writer thread. `order` is held by a thread that writes to the database: from a row's
     * leaving the list until it is written or back, so that an older row never overwrites a newer one, and while the
     * connection is exchanged. `lock` protects the members below; it is taken last. */
    pthread_mutex_t lock, order;
    pthread_cond_t work, idle;
    struct saved_job *saves, *saves_taken; /* _taken: those being written now, also of what follows */
    struct noted_list changes, clears;     /* statements; removed jobs whose files go when that is on disk */
    struct noted_list events, workers;
    uint64_t event_next; /* the seq of the next event */
    uint64_t last_token; /* the number that was given last; 0: not known */
    struct saved_share *shares, *shares_taken;
    struct saved_wait *waits, **waits_end, *waits_over; /* who waits for all that was noted before; their end */
    void (*wake)(void *user);                           /* somebody should call store_deliver */
    void *wake_user;
    int busy, ending, has_writer;
    int failing; /* the last save failed with `save_error`; */
    int retry;   /* the next one may be tried */
    struct error save_error;
    pthread_t writer;
};

/* Open queue.sqlite in the store's folder, and make its tables or bring them up to date. A database that can only be
 * read is accepted: see read_only. store_close closes store->db, also after a failure. */
status database_open(struct store *store, struct error *err) MUST_CHECK;
/* Open a database again for writing that was opened read_only. */
status database_reopen(struct store *store, struct error *err) MUST_CHECK;
/* A table of which a column is missing or has another name, as after damage to the schema; NULL: none. */
const char *database_other_columns(sqlite3 *db);
/* The same with any name, and whatever else is in the folder, for writing only. */
status database_make(struct store *store, const char *path, struct error *err) MUST_CHECK;
/* Close `db`, with the statements prepared for it; NULL is fine. */
void database_close(struct store *store);
/* Store `epoch_limit`, if it is not 0. */
status epoch_store(struct store *store, struct error *err) MUST_CHECK;

/* Numbers of events go on where they ended, with a gap. Call it once, before any is noted. ERR_IO, ERR_NO_MEMORY. */
status events_begin(struct store *store, struct error *err) MUST_CHECK;

/* SQLite's last error as ours: always a failure of the environment, ERR_NO_MEMORY or ERR_IO, since
 * no job causes it. Makes the store suspect. */
status sql_error(struct store *store, const char *what, struct error *err);
status sql_exec(struct store *store, const char *sql, const char *what, struct error *err) MUST_CHECK;

/* A value for a '?' of a statement. Empty bytes, a text that is NULL and NaN become NULL. */
struct sql_value {
    enum { SQL_NUMBER, SQL_REAL, SQL_TEXT, SQL_BYTES } kind;
    int64_t number;
    double real;
    const void *data;
    size_t size_bytes;
};
struct sql_value sql_number(int64_t number);
struct sql_value sql_real(double value);
struct sql_value sql_text(const char *text);
struct sql_value sql_bytes(const struct buffer *bytes);
/* Two arguments: values and their count. */
#define SQL_VALUES(...)                  \
    (const struct sql_value[]){__VA_ARGS__}, \
        sizeof((const struct sql_value[]){__VA_ARGS__}) / sizeof(struct sql_value)

/* The connection for a question, which is asked between these two. Without a reader it is `db`, and waits for its
 * writers. What it finds is on disk. [any thread] */
sqlite3 *reader_take(struct store *store);
void reader_leave(struct store *store, sqlite3 *db);
/* The last error of that connection, as ours. */
status sql_failed(struct store *store, sqlite3 *db, const char *what, struct error *err);

/* The rows of a question: while (sql_next(&rows)) read rows.row; then sql_end(&rows) is the result. A caller whose own
 * step fails sets `result`, which ends the rows. `what` is the error's text where they cannot be read. */
struct sql_rows {
    sqlite3_stmt *row;
    status result;
    struct store *store;
    sqlite3 *db;
    const char *what;
    struct error *err;
    int reading; /* sql_end gives the reader back */
};
/* Asked on a connection that the caller holds; on `db`; on the reader, which it holds until its end. */
struct sql_rows sql_ask(struct store *store, sqlite3 *db, const char *sql, const struct sql_value *values, size_t count,
                        const char *what, struct error *err);
struct sql_rows sql_select(struct store *store, const char *sql, const struct sql_value *values, size_t count,
                           const char *what, struct error *err);
struct sql_rows sql_read(struct store *store, const char *sql, const struct sql_value *values, size_t count,
                         const char *what, struct error *err);
int sql_next(struct sql_rows *rows) MUST_CHECK;
status sql_end(struct sql_rows *rows) MUST_CHECK;
/* Run a statement that yields no row; `what` is the error's text. */
status sql_change(struct store *store, const char *sql, const struct sql_value *values, size_t count, const char *what,
                  struct error *err) MUST_CHECK;
/* The same for what must not wait for others to free space: on a full disk it gets the reserve. */
status sql_change_reserved(struct store *store, const char *sql, const struct sql_value *values, size_t count,
                           const char *what, struct error *err) MUST_CHECK;
/* The same while `order` is held, so that no other thread writes. *number (may be NULL): the row that was inserted. */
status sql_write(struct store *store, const char *sql, const struct sql_value *values, size_t count, const char *what,
                 uint64_t *number, struct error *err) MUST_CHECK;
/* Did the last statement fail for lack of space, and is the reserve free for it now? Then it may be repeated. */
int sql_give_reserve(struct store *store);
void column_text(sqlite3_stmt *statement, int at, char *out, size_t size);
uint64_t column_number(sqlite3_stmt *statement, int at);

/* Changes that wait for the writer thread. A list is made first and noted as a whole, so that it is written in one
 * transaction. `what` is a constant. ERR_NO_MEMORY. */
status changes_add(struct noted_list *list, const char *sql, const struct sql_value *values, size_t count,
                   const char *what, struct error *err) MUST_CHECK;
/* The frame's limits count from now on; -1: of all frames of the job. */
status changes_add_clock(struct noted_list *list, uint64_t job, int64_t frame, struct error *err) MUST_CHECK;
void changes_note(struct store *store, struct noted_list *list);
/* Note one statement. ERR_NO_MEMORY: nothing is noted. */
status sql_note(struct store *store, const char *sql, const struct sql_value *values, size_t count, const char *what,
                struct error *err) MUST_CHECK;
/* Write those taken in the transaction of the caller, who holds `order`. */
status changes_write(struct store *store, struct error *err) MUST_CHECK;
/* Wait until those that are noted are on disk; `order` is not held. For threads whose own row comes after them.
 * ERR_IO, ERR_NO_MEMORY: they cannot be written at present. [any thread] */
status changes_await(struct store *store, struct error *err) MUST_CHECK;
/* Does a change wait by which the frame's limits count from now on? */
int changes_have_clock(struct store *store, uint64_t job, uint32_t frame);
/* Remove the files of removed jobs that were taken, which are forgotten then; `order` is held. */
void clears_run(struct store *store);

/* The names and digests of the outputs that were written for the job are on disk when this returns. [any thread] */
status store_outputs_sync(const struct store *store, uint64_t job, struct error *err) MUST_CHECK;

/* Bring the frame's clock forward; it never goes back. */
/* Which effects a job's results had and the accounts of their time, 64 bits each, little-endian. Of another size nothing is
 * taken: the effects are those of another release. */
enum { STATS_BYTES = 8 * (1 + EFFECT_ACCOUNTS) };
void stats_pack(const struct work_stats *stats, uint8_t out[STATS_BYTES]);
void stats_unpack(struct work_stats *stats, const uint8_t *in, size_t size);

status clock_write(struct store *store, uint64_t job, uint32_t frame, uint64_t active_ns, uint64_t cpu_ns,
                   struct error *err) MUST_CHECK;
/* Note the coverage of a frame that is done with fewer samples than the cap allows, in a list of changes. */
status cut_note(struct noted_list *list, uint64_t job, uint32_t frame, enum frame_end end,
                const struct film_coverage *cut, struct error *err) MUST_CHECK;
/* store_history_add in the transaction of the caller, who holds `order`. */
status history_write(struct store *store, uint64_t job, uint32_t frame, uint32_t place,
                     const struct history_point *point, struct error *err) MUST_CHECK;
/* Run `body` as one transaction, so that the disk is asked once; again if it failed for lack of space and now there is
 * some. `order` is held. */
status sql_transaction(struct store *store, status (*body)(struct store *store, const void *user, struct error *err),
                       const void *user, struct error *err) MUST_CHECK;
/* Note the newest figures of the job's frames in job->figures: of those that are done, and the last of those that rest. */
status history_load_last(struct store *store, sqlite3 *db, struct job *job, struct error *err) MUST_CHECK;
/* A row of the table of deliverers. */
status deliverer_write(struct store *store, const struct deliverer *deliverer, struct error *err) MUST_CHECK;

/* The table of events; write those taken in the transaction of the caller, who holds `order`. The same of workers. */
extern const char events_schema[];
status events_write(struct store *store, struct error *err) MUST_CHECK;
status workers_write(struct store *store, struct error *err) MUST_CHECK;

/* The same of the owners' shares, of which each has one row: see struct noted_list. */
void shares_take(struct store *store);
void shares_settle(struct store *store, int written);
status shares_write(struct store *store, struct error *err) MUST_CHECK;
void shares_drop(struct store *store);

/* saves_init makes the locks, saves_start the writer thread. saves_stop ends the thread after it
 * has tried the waiting saves, and destroys the locks. */
void saves_init(struct store *store);
status saves_start(struct store *store, struct error *err) MUST_CHECK;
void saves_stop(struct store *store);
/* The job's waiting save, if any, is not written. */
void saves_forget(struct store *store, uint64_t id);
/* Allow a failed save to be tried again. */
void saves_retry(struct store *store);
/* The result of the last save. ERR_IO, ERR_NO_MEMORY. */
status saves_state(struct store *store, struct error *err) MUST_CHECK;

/* Remove the job's pictures. 0: some remain, and this was logged. */
int store_outputs_remove(struct store *store, uint64_t job);
/* Make the folder, relative to the store's, durable. ERR_IO also if the store's folder is not the
 * one that was opened (moved or unmounted). */
status store_make_folder(const struct store *store, const char *name, struct error *err) MUST_CHECK;

/* ---- digests of outputs (store_sums.c) -------------------------------------------------------- */

#define SUMS_EXTENSION "sums"
struct damage *damage_new(void); /* NULL: out of memory */
void damage_free(struct damage *damage);
/* Note the digest of an output that was written, for sums_write. ERR_NO_MEMORY. [any thread] */
status sums_note(const struct store *store, uint64_t job, uint32_t frame, const char *extension,
                 const struct buffer *data, struct error *err) MUST_CHECK;
/* Write the digests that were noted for the job's frames. ERR_IO, ERR_NO_MEMORY: they wait on. [any thread] */
status sums_write(const struct store *store, uint64_t job, struct error *err) MUST_CHECK;
/* The lines of a file of digests. NONE: there is no file; UNREADABLE: the machine failed. */
enum sums_state { SUMS_NONE, SUMS_GOOD, SUMS_DAMAGED, SUMS_UNREADABLE };
enum sums_state sums_read(const char *path, struct buffer *lines);
/* The next of them, from 0 bytes on. 0: there is none. */
int sums_next(const struct buffer *lines, size_t *at, struct digest *digest, char *extension, size_t size);

/* ---- digests of rows (store_rows.c) ------------------------------------------------------------ */

extern const char sums_schema[];
/* A table whose rows have digests: what a row's key is, and what is said of a damaged one. */
struct guarded_table {
    const char *name, *key, *remedy;
    int of_job, stays; /* its job cannot go on; --repair does not remove it */
};
extern const struct guarded_table guarded_tables[]; /* the last has no name */
/* Results of SQLite: OK, NOMEM, CORRUPT ... */
int rows_guard(sqlite3 *db) MUST_CHECK;   /* changes of this connection keep the digests, where there are any */
int rows_sum_all(sqlite3 *db) MUST_CHECK; /* give every row its digest: the tables had none, or they do not count */
/* Note what is damaged in temp.bad (tab, key, lost, job). */
int rows_find(sqlite3 *db) MUST_CHECK;
/* Is the file's structure sound? `why` not. */
int rows_sound(sqlite3 *db, char *why, size_t size);
/* The statement that deletes the row of the key ?. */
void rows_delete_text(sqlite3 *db, const char *table, struct buffer *sql);
/* Copy what can be read of a damaged file into `db`, new and empty, with the digests that rows had there. */
int rows_salvage(sqlite3 *db, const char *damaged, uint64_t *copied) MUST_CHECK;
