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
 * store_deliverers.c workers that delivered results
 * store_workers.c   what workers did, and the names that people drained or blocked
 * store_web.c       tokens and webhooks of the page (store_web.h)
 * store_files.c     the places of films and outputs
 */
#ifndef AZULEJO_COORDINATOR_STORE_PARTS_H
#define AZULEJO_COORDINATOR_STORE_PARTS_H

#include <pthread.h>
#include <sqlite3.h>
#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>

#include "coordinator/store/store.h"

struct saved_job;
struct saved_event;
struct saved_worker;
struct saved_share;
struct saved_wait;
struct trash;

struct store {
    char *folder;
    int lock_fd;
    sqlite3 *db;                   /* what is written goes through it */
    sqlite3 *reader;               /* questions: it waits for no writer. NULL: it could not be opened */
    pthread_mutex_t reading;       /* held while `reader` is used or exchanged; taken after `order`, before `lock` */
    int read_only;                 /* `db` was opened for reading; store_check opens it again */
    uint64_t epoch_limit;          /* to be stored; 0: it is */
    atomic_int suspect;
    struct trash *trash;           /* its thread empties STORE/trash */
    int clear_held;                /* files of removed jobs are still there: a backup was being made */

    /* Saves that wait for the writer thread. `order` is held by a thread that writes to the
     * database: from a row's leaving the list until it is written or back, so that an older row never
     * overwrites a newer one, and while the connection is exchanged. `lock` protects the members
     * below; it is taken last. */
    pthread_mutex_t lock, order;
    pthread_cond_t work, idle;
    struct saved_job *saves, *saves_taken; /* _taken: those being written now, also of what follows */
    struct saved_event *events, **events_end, *events_taken; /* events_end: only if there are any */
    size_t events_waiting;
    uint64_t event_next;           /* the seq of the next event */
    struct saved_worker *workers, **workers_end, *workers_taken; /* the same */
    size_t workers_waiting;
    struct saved_share *shares, *shares_taken;
    struct saved_wait *waits, **waits_end, *waits_over; /* who waits for all that was noted before; their end */
    void (*wake)(void *user);      /* somebody should call store_deliver */
    void *wake_user;
    int busy, ending, has_writer;
    int failing;                   /* the last save failed with `save_error`; */
    int retry;                     /* the next one may be tried */
    struct error save_error;
    pthread_t writer;
};

/* Open queue.sqlite in the store's folder, and make its tables or bring them up to date. A database
 * that can only be read is accepted: see read_only. store_close closes store->db, also after a
 * failure. */
status database_open(struct store *store, struct error *err) MUST_CHECK;
/* Open a database again for writing that was opened read_only. */
status database_reopen(struct store *store, struct error *err) MUST_CHECK;
/* Store `epoch_limit`, if it is not 0. */
status epoch_store(struct store *store, struct error *err) MUST_CHECK;

/* Numbers of events go on where they ended, with a gap. Call it once, before any is noted. ERR_IO, ERR_NO_MEMORY. */
status events_begin(struct store *store, struct error *err) MUST_CHECK;

/* SQLite's last error as ours: always a failure of the environment, ERR_NO_MEMORY or ERR_IO, since
 * no job causes it. Makes the store suspect. */
status sql_error(struct store *store, const char *what, struct error *err);
status sql_exec(struct store *store, const char *sql, const char *what,
                struct error *err) MUST_CHECK;

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
/* The last error of that connection, as ours, and a statement on it. */
status sql_failed(struct store *store, sqlite3 *db, const char *what, struct error *err);
status sql_ask(struct store *store, sqlite3 *db, const char *sql, const struct sql_value *values, size_t count,
               sqlite3_stmt **out, struct error *err) MUST_CHECK;

/* A statement whose rows the caller steps through, and which it finalizes. */
status sql_select(struct store *store, const char *sql, const struct sql_value *values,
                  size_t count, sqlite3_stmt **out, struct error *err) MUST_CHECK;
/* Run a statement that yields no row; `what` is the error's text. */
status sql_change(struct store *store, const char *sql, const struct sql_value *values,
                  size_t count, const char *what, struct error *err) MUST_CHECK;
/* The same for what must not wait for others to free space: on a full disk it gets the reserve. */
status sql_change_reserved(struct store *store, const char *sql, const struct sql_value *values,
                           size_t count, const char *what, struct error *err) MUST_CHECK;
/* Did the last statement fail for lack of space, and is the reserve free for it now? Then it may be repeated. */
int sql_give_reserve(struct store *store);
void column_text(sqlite3_stmt *statement, int at, char *out, size_t size);
uint64_t column_number(sqlite3_stmt *statement, int at);

/* Bring the frame's clock forward; it never goes back. */
status clock_write(struct store *store, uint64_t job, uint32_t frame, uint64_t active_ns,
                   uint64_t cpu_ns, struct error *err) MUST_CHECK;
/* Note the coverage of a frame that is done with fewer samples than the cap allows. */
status cut_insert(struct store *store, uint64_t job, uint32_t frame, enum frame_end end,
                  const struct film_coverage *cut, struct error *err) MUST_CHECK;
/* Note the newest figures of the job's finished frames in job->figures. */
status history_load_last(struct store *store, sqlite3 *db, struct job *job, struct error *err) MUST_CHECK;
/* The table of deliverers, and a row of it. */
extern const char deliverers_schema[];
status deliverer_write(struct store *store, const struct deliverer *deliverer,
                       struct error *err) MUST_CHECK;

/* The table of events. events_take sets aside what is noted, events_write writes that in the transaction of its
 * caller, who holds `order`; events_settle forgets it, or notes it again. `lock` is held for take and settle.
 * events_drop forgets what is noted. */
extern const char events_schema[];
void events_take(struct store *store);
status events_write(struct store *store, struct error *err) MUST_CHECK;
void events_settle(struct store *store, int written);
void events_drop(struct store *store);

/* The same of workers. */
void workers_take(struct store *store);
void workers_settle(struct store *store, int written);
status workers_write(struct store *store, struct error *err) MUST_CHECK;
void workers_drop(struct store *store);

/* The same of the owners' shares. */
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
status store_make_folder(const struct store *store, const char *name, struct error *err)
    MUST_CHECK;

#endif
