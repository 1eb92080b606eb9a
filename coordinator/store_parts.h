/* store_parts: the inside of the store, shared by its files; nobody else includes this.
 *
 * store.c           the folder, its lock, the lease epoch; opens and closes the others
 * store_database.c  the connection, the tables and their versions, running a statement
 * store_jobs.c      the rows: jobs that are new, kept, revised, loaded; frames that are done
 * store_saves.c     a job's counters and state, saved at once or soon, by a thread of its own
 * store_files.c     where films and outputs lie
 */
#ifndef AZULEJO_COORDINATOR_STORE_PARTS_H
#define AZULEJO_COORDINATOR_STORE_PARTS_H

#include <pthread.h>
#include <sqlite3.h>
#include <stddef.h>
#include <stdint.h>

#include "coordinator/store.h"

struct saved_job;

struct store {
    char *folder;
    int lock_fd;
    sqlite3 *db;

    /* Saves that wait for the writer thread. `order` is held from a row's leaving the list until it
     * is written, so that an older row never overwrites a newer one. */
    pthread_mutex_t lock, order;
    pthread_cond_t wake, idle;
    struct saved_job *saves;
    int busy, ending, has_writer;
    pthread_t writer;
};

/* Open queue.sqlite in the store's folder, and make its tables or bring them up to date. What
 * store->db holds is closed by store_close, also after a failure. */
status database_open(struct store *store, struct error *err) MUST_CHECK;

/* What SQLite said last, as ours. */
status sql_error(const struct store *store, const char *what, struct error *err);
status sql_prepare(const struct store *store, const char *sql, sqlite3_stmt **out,
                   struct error *err) MUST_CHECK;
/* Run a statement that yields no row, and finalize it. */
status sql_run(const struct store *store, sqlite3_stmt *statement, const char *what,
               struct error *err) MUST_CHECK;
void bind_text(sqlite3_stmt *statement, int at, const char *text);
void bind_number(sqlite3_stmt *statement, int at, uint64_t value);
void column_text(sqlite3_stmt *statement, int at, char *out, size_t size);
uint64_t column_number(sqlite3_stmt *statement, int at);

/* saves_init makes the locks, saves_start the writer thread. saves_stop, for both, ends the thread
 * once it has written what waits. */
void saves_init(struct store *store);
status saves_start(struct store *store, struct error *err) MUST_CHECK;
void saves_stop(struct store *store);

#endif
