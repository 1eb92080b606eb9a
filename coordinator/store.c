#include "coordinator/store.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <math.h>
#include <pthread.h>
#include <sqlite3.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/base/file.h"
#include "common/base/log.h"
#include "common/base/memory.h"
#include "coordinator/wire.h"

/* Version of the tables, kept in SQLite's user_version. */
enum { STORE_VERSION = 2, BUSY_MS = 5000 };

/* Epochs that one run may grant. At a million leases a second they last 12 days; the wall clock's
 * part outgrows them. */
#define EPOCHS_A_RUN ((uint64_t)1 << 40)

/* A job's row as it stood when it was to be saved. */
struct saved_job {
    struct saved_job *next;
    uint64_t id;
    enum job_state state;
    char state_text[JOB_TEXT_MAX + 1], kernel[KERNEL_NAME_MAX + 1];
    int64_t finished_at;
    uint64_t active_ns, conflicts;
    struct work_stats stats;
};

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

static const char schema[] =
    "CREATE TABLE meta (name TEXT PRIMARY KEY, value INTEGER NOT NULL) WITHOUT ROWID;"
    "CREATE TABLE jobs ("
    " id INTEGER PRIMARY KEY AUTOINCREMENT, name TEXT NOT NULL, state INTEGER NOT NULL,"
    " state_text TEXT NOT NULL, scene_name TEXT NOT NULL, kernel TEXT NOT NULL,"
    " epoch_floor INTEGER NOT NULL, submitted_at INTEGER NOT NULL, finished_at INTEGER NOT NULL,"
    " active_ns INTEGER NOT NULL, conflicts INTEGER NOT NULL, samples INTEGER NOT NULL,"
    " rays INTEGER NOT NULL, vertices INTEGER NOT NULL, dropped INTEGER NOT NULL,"
    " cpu_ns INTEGER NOT NULL, trace_ns INTEGER NOT NULL,"
    " request BLOB NOT NULL);" /* the wire's JobSubmit */
    "CREATE TABLE frames (job INTEGER NOT NULL REFERENCES jobs(id), frame INTEGER NOT NULL,"
    " relative_mse REAL, PRIMARY KEY (job, frame)) WITHOUT ROWID;";

/* Version 2: which frames' pictures follow the job's present output settings. */
static const char schema_2[] =
    "ALTER TABLE jobs ADD COLUMN revision INTEGER NOT NULL DEFAULT 0;"
    "ALTER TABLE frames ADD COLUMN revision INTEGER NOT NULL DEFAULT 0;";

/* ---- SQL ------------------------------------------------------------------------------------ */

static status sql_error(const struct store *store, const char *what, struct error *err)
{
    int code = sqlite3_errcode(store->db);

    return error_set(err,
                     code == SQLITE_NOMEM ? STATUS_ERR_NO_MEMORY
                     : code == SQLITE_CORRUPT || code == SQLITE_NOTADB ? STATUS_ERR_CORRUPT
                                                                       : STATUS_ERR_IO,
                     "%s/queue.sqlite: %s: %s", store->folder, what, sqlite3_errmsg(store->db));
}

static status sql_exec(const struct store *store, const char *sql, const char *what,
                       struct error *err)
{
    if (sqlite3_exec(store->db, sql, NULL, NULL, NULL) != SQLITE_OK)
        return sql_error(store, what, err);
    return STATUS_OK;
}

static status sql_prepare(const struct store *store, const char *sql, sqlite3_stmt **out,
                          struct error *err)
{
    if (sqlite3_prepare_v2(store->db, sql, -1, out, NULL) != SQLITE_OK)
        return sql_error(store, "prepare", err);
    return STATUS_OK;
}

/* Run a statement that yields no row, and finalize it. */
static status sql_run(const struct store *store, sqlite3_stmt *statement, const char *what,
                      struct error *err)
{
    status s = STATUS_OK;

    if (sqlite3_step(statement) != SQLITE_DONE)
        s = sql_error(store, what, err);
    sqlite3_finalize(statement);
    return s;
}

static void bind_text(sqlite3_stmt *statement, int at, const char *text)
{
    sqlite3_bind_text(statement, at, text, -1, SQLITE_TRANSIENT);
}

static void bind_number(sqlite3_stmt *statement, int at, uint64_t value)
{
    sqlite3_bind_int64(statement, at, (sqlite3_int64)value);
}

static void column_text(sqlite3_stmt *statement, int at, char *out, size_t size)
{
    const unsigned char *text = sqlite3_column_text(statement, at);

    snprintf(out, size, "%s", text ? (const char *)text : "");
}

static uint64_t column_number(sqlite3_stmt *statement, int at)
{
    return (uint64_t)sqlite3_column_int64(statement, at);
}

/* ---- saving jobs --------------------------------------------------------------------------- */

static void row_take(struct saved_job *row, const struct job *job, uint64_t now_ns)
{
    row->next = NULL;
    row->id = job->id;
    row->state = job->state;
    memcpy(row->state_text, job->state_text, sizeof row->state_text);
    memcpy(row->kernel, job->kernel, sizeof row->kernel);
    row->finished_at = job->finished_at;
    row->active_ns = (uint64_t)(job_active_seconds(job, now_ns) * 1e9);
    row->conflicts = job->conflicts;
    row->stats = job->stats;
}

static status row_write(struct store *store, const struct saved_job *row, struct error *err)
{
    sqlite3_stmt *statement = NULL;
    status s = sql_prepare(store,
                           "UPDATE jobs SET state=?, state_text=?, kernel=?, finished_at=?, "
                           "active_ns=?, conflicts=?, samples=?, rays=?, vertices=?, dropped=?, "
                           "cpu_ns=?, trace_ns=? WHERE id=?",
                           &statement, err);

    if (s != STATUS_OK)
        return s;
    sqlite3_bind_int(statement, 1, (int)row->state);
    bind_text(statement, 2, row->state_text);
    bind_text(statement, 3, row->kernel);
    sqlite3_bind_int64(statement, 4, row->finished_at);
    bind_number(statement, 5, row->active_ns);
    bind_number(statement, 6, row->conflicts);
    bind_number(statement, 7, row->stats.samples);
    bind_number(statement, 8, row->stats.rays);
    bind_number(statement, 9, row->stats.vertices);
    bind_number(statement, 10, row->stats.dropped_samples);
    bind_number(statement, 11, row->stats.cpu_ns);
    bind_number(statement, 12, row->stats.trace_ns);
    bind_number(statement, 13, row->id);
    return sql_run(store, statement, "the job's state cannot be stored", err);
}

/* The writer thread: one row after another, until the store closes and none is left. */
static void *write_saves(void *user)
{
    struct store *store = user;

    for (;;) {
        struct error err = {0};
        struct saved_job *row;

        pthread_mutex_lock(&store->lock);
        while (!store->saves && !store->ending)
            pthread_cond_wait(&store->wake, &store->lock);
        row = store->saves;
        store->busy = row != NULL;
        pthread_mutex_unlock(&store->lock);
        if (!row)
            return NULL;
        pthread_mutex_lock(&store->order);
        pthread_mutex_lock(&store->lock);
        row = store->saves; /* what was there may have been overtaken */
        if (row)
            store->saves = row->next;
        pthread_mutex_unlock(&store->lock);
        if (row && row_write(store, row, &err) != STATUS_OK)
            log_error("%s", err.text);
        pthread_mutex_unlock(&store->order);
        mem_free(row);
        pthread_mutex_lock(&store->lock);
        store->busy = 0;
        if (!store->saves)
            pthread_cond_broadcast(&store->idle);
        pthread_mutex_unlock(&store->lock);
    }
}

/* ---- opening -------------------------------------------------------------------------------- */

static status take_lock(struct store *store, struct error *err)
{
    char *path = file_join(store->folder, "lock");
    char text[32];
    status s = STATUS_OK;
    ssize_t got;

    if (!path)
        return error_no_memory(err, "the store");
    store->lock_fd = open(path, O_RDWR | O_CREAT | O_CLOEXEC, 0666);
    if (store->lock_fd < 0) {
        s = error_set(err, STATUS_ERR_IO,
                      "%s: cannot be opened: %s (choose a --store that can be written to)", path,
                      strerror(errno));
    } else if (flock(store->lock_fd, LOCK_EX | LOCK_NB) != 0) {
        got = read(store->lock_fd, text, sizeof text - 1);
        text[got > 0 ? got : 0] = 0;
        s = error_set(err, STATUS_ERR_REFUSED,
                      "%s: another coordinator (process %d) uses this store; end it, or choose "
                      "another --store",
                      store->folder, atoi(text));
    } else {
        int length = snprintf(text, sizeof text, "%d\n", (int)getpid());
        if (ftruncate(store->lock_fd, 0) != 0 || write(store->lock_fd, text, (size_t)length) < 0)
            log_debug("%s: the process number could not be noted", path);
    }
    mem_free(path);
    return s;
}

static status open_database(struct store *store, struct error *err)
{
    char *path = file_join(store->folder, "queue.sqlite");
    sqlite3_stmt *statement = NULL;
    int version = 0;
    status s;

    if (!path)
        return error_no_memory(err, "the store");
    if (sqlite3_open_v2(path, &store->db,
                        SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_FULLMUTEX,
                        NULL) != SQLITE_OK) {
        s = store->db ? sql_error(store, "cannot be opened", err) : error_no_memory(err, path);
        mem_free(path);
        return s;
    }
    mem_free(path);
    sqlite3_extended_result_codes(store->db, 0);
    sqlite3_busy_timeout(store->db, BUSY_MS);
    s = sql_exec(store, "PRAGMA journal_mode=WAL; PRAGMA synchronous=FULL; PRAGMA foreign_keys=ON",
                 "cannot be read", err);
    if (s == STATUS_OK)
        s = sql_prepare(store, "PRAGMA user_version", &statement, err);
    if (s != STATUS_OK)
        return s;
    if (sqlite3_step(statement) == SQLITE_ROW)
        version = sqlite3_column_int(statement, 0);
    sqlite3_finalize(statement);
    if (version > STORE_VERSION)
        return error_set(err, STATUS_ERR_CORRUPT,
                         "%s: was written by a newer azulejo (store version %d; this one reads %d)",
                         store->folder, version, STORE_VERSION);
    if (version == STORE_VERSION)
        return STATUS_OK;
    s = sql_exec(store, "BEGIN IMMEDIATE", "cannot be written", err);
    if (s == STATUS_OK && version < 1)
        s = sql_exec(store, schema, "cannot be set up", err);
    if (s == STATUS_OK)
        s = sql_exec(store, schema_2, "cannot be brought up to date", err);
    if (s == STATUS_OK)
        s = sql_exec(store, "PRAGMA user_version=2; COMMIT", "cannot be set up", err);
    return s;
}

static status make_folder(const struct store *store, const char *name, struct error *err)
{
    char *path = file_join(store->folder, name);
    status s = path ? file_make_folder(path, err) : error_no_memory(err, "the store");

    mem_free(path);
    return s;
}

status store_open(struct store **out, const char *folder, struct error *err)
{
    struct store *store = mem_calloc(1, sizeof *store);
    status s;

    *out = NULL;
    if (!store)
        return error_no_memory(err, "the store");
    store->lock_fd = -1;
    pthread_mutex_init(&store->lock, NULL);
    pthread_mutex_init(&store->order, NULL);
    pthread_cond_init(&store->wake, NULL);
    pthread_cond_init(&store->idle, NULL);
    store->folder = mem_strdup(folder);
    s = store->folder ? file_make_folder(folder, err) : error_no_memory(err, "the store");
    if (s == STATUS_OK)
        s = take_lock(store, err);
    if (s == STATUS_OK)
        s = make_folder(store, "blobs/tmp", err);
    if (s == STATUS_OK)
        s = make_folder(store, "films", err);
    if (s == STATUS_OK)
        s = make_folder(store, "outputs", err);
    if (s == STATUS_OK)
        s = open_database(store, err);
    if (s == STATUS_OK) {
        if (pthread_create(&store->writer, NULL, write_saves, store) == 0)
            store->has_writer = 1;
        else
            s = error_set(err, STATUS_ERR_NO_MEMORY, "%s: no thread for the store", folder);
    }
    if (s != STATUS_OK) {
        store_close(store);
        return s;
    }
    *out = store;
    return STATUS_OK;
}

void store_close(struct store *store)
{
    if (!store)
        return;
    if (store->has_writer) {
        pthread_mutex_lock(&store->lock);
        store->ending = 1;
        pthread_cond_signal(&store->wake);
        pthread_mutex_unlock(&store->lock);
        pthread_join(store->writer, NULL);
    }
    pthread_cond_destroy(&store->wake);
    pthread_cond_destroy(&store->idle);
    pthread_mutex_destroy(&store->lock);
    pthread_mutex_destroy(&store->order);
    sqlite3_close(store->db);
    if (store->lock_fd >= 0)
        close(store->lock_fd);
    mem_free(store->folder);
    mem_free(store);
}

const char *store_folder(const struct store *store)
{
    return store->folder;
}

status store_epoch_begin(struct store *store, int64_t wall_s, uint64_t *epoch, struct error *err)
{
    sqlite3_stmt *statement = NULL;
    uint64_t wall = wall_s > 0 ? (uint64_t)wall_s << 24 : 1;
    status s = sql_prepare(store, "SELECT value FROM meta WHERE name='epoch_limit'", &statement,
                           err);

    if (s != STATUS_OK)
        return s;
    *epoch = wall;
    if (sqlite3_step(statement) == SQLITE_ROW && column_number(statement, 0) > wall)
        *epoch = column_number(statement, 0);
    sqlite3_finalize(statement);
    s = sql_prepare(store, "INSERT OR REPLACE INTO meta (name, value) VALUES ('epoch_limit', ?)",
                    &statement, err);
    if (s != STATUS_OK)
        return s;
    bind_number(statement, 1, *epoch + EPOCHS_A_RUN);
    return sql_run(store, statement, "the lease epoch cannot be stored", err);
}

/* ---- jobs ----------------------------------------------------------------------------------- */

status store_job_insert(struct store *store, struct job *job, struct error *err)
{
    sqlite3_stmt *statement = NULL;
    struct buffer request = BUFFER_INIT;
    status s = wire_job_pack(job, &request, err);

    pthread_mutex_lock(&store->order);
    if (s == STATUS_OK)
        s = sql_prepare(store,
                        "INSERT INTO jobs (name, state, state_text, scene_name, kernel, "
                        "epoch_floor, submitted_at, finished_at, active_ns, conflicts, samples, "
                        "rays, vertices, dropped, cpu_ns, trace_ns, request) "
                        "VALUES (?, ?, '', ?, '', ?, ?, 0, 0, 0, 0, 0, 0, 0, 0, 0, ?)",
                        &statement, err);
    if (s == STATUS_OK) {
        bind_text(statement, 1, job->name);
        sqlite3_bind_int(statement, 2, (int)job->state);
        bind_text(statement, 3, job->scene_name);
        bind_number(statement, 4, job->epoch_floor);
        sqlite3_bind_int64(statement, 5, job->submitted_at);
        sqlite3_bind_blob(statement, 6, request.data, (int)request.size, SQLITE_TRANSIENT);
        s = sql_run(store, statement, "the job cannot be stored", err);
    }
    if (s == STATUS_OK)
        job->id = (uint64_t)sqlite3_last_insert_rowid(store->db);
    pthread_mutex_unlock(&store->order); /* between the insert and its id nobody else inserts */
    buffer_release(&request);
    return s;
}

void store_job_forget(struct store *store, uint64_t id)
{
    sqlite3_stmt *statement = NULL;
    struct error err = {0};
    status s = sql_prepare(store, "DELETE FROM jobs WHERE id=?", &statement, &err);

    if (s == STATUS_OK) {
        bind_number(statement, 1, id);
        s = sql_run(store, statement, "a job cannot be removed", &err);
    }
    if (s != STATUS_OK)
        log_error("%s", err.text);
}

/* Take the job's waiting row out of the list: a newer one follows. */
static void saves_drop(struct store *store, uint64_t id)
{
    for (struct saved_job **at = &store->saves; *at; at = &(*at)->next) {
        struct saved_job *row = *at;
        if (row->id != id)
            continue;
        *at = row->next;
        mem_free(row);
        return;
    }
}

status store_job_save(struct store *store, const struct job *job, uint64_t now_ns,
                      struct error *err)
{
    struct saved_job row;
    status s;

    row_take(&row, job, now_ns);
    pthread_mutex_lock(&store->order);
    pthread_mutex_lock(&store->lock);
    saves_drop(store, job->id);
    pthread_mutex_unlock(&store->lock);
    s = row_write(store, &row, err);
    pthread_mutex_unlock(&store->order);
    return s;
}

void store_job_save_later(struct store *store, const struct job *job, uint64_t now_ns)
{
    struct saved_job *row = mem_alloc(sizeof *row);
    struct saved_job **at = &store->saves;
    struct error err = {0};

    if (!row) { /* no memory for speed: write it now */
        if (store_job_save(store, job, now_ns, &err) != STATUS_OK)
            log_error("%s", err.text);
        return;
    }
    row_take(row, job, now_ns);
    pthread_mutex_lock(&store->lock);
    saves_drop(store, job->id);
    while (*at)
        at = &(*at)->next;
    *at = row;
    pthread_cond_signal(&store->wake);
    pthread_mutex_unlock(&store->lock);
}

void store_await_saves(struct store *store)
{
    pthread_mutex_lock(&store->lock);
    while (store->saves || store->busy)
        pthread_cond_wait(&store->idle, &store->lock);
    pthread_mutex_unlock(&store->lock);
}

static status load_frames(struct store *store, struct job *job, struct error *err)
{
    sqlite3_stmt *statement = NULL;
    int code;
    status s = sql_prepare(store, "SELECT frame, relative_mse, revision FROM frames WHERE job=? "
                                  "ORDER BY frame", &statement, err);

    if (s != STATUS_OK)
        return s;
    bind_number(statement, 1, job->id);
    while ((code = sqlite3_step(statement)) == SQLITE_ROW) {
        sqlite3_int64 frame = sqlite3_column_int64(statement, 0);
        if (frame < job->first_frame || frame > job->last_frame)
            continue;
        job_frame_set_done(job, (uint32_t)frame);
        if (sqlite3_column_int64(statement, 2) == (sqlite3_int64)job->revision)
            job_frame_set_developed(job, (uint32_t)frame);
        job->relative_mse = sqlite3_column_type(statement, 1) == SQLITE_NULL
                                ? NAN
                                : sqlite3_column_double(statement, 1);
    }
    if (code != SQLITE_DONE)
        s = sql_error(store, "the frames cannot be read", err);
    sqlite3_finalize(statement);
    return s;
}

static status load_job(struct store *store, sqlite3_stmt *row, struct job **out, struct error *err)
{
    struct job *job = NULL;
    uint64_t id = column_number(row, 0);
    int state = sqlite3_column_int(row, 1);
    status s = wire_job_unpack(&job, sqlite3_column_blob(row, 15),
                               (size_t)sqlite3_column_bytes(row, 15), err);

    if (s == STATUS_OK && (state < 0 || state >= JOB_STATE_COUNT))
        s = error_set(err, STATUS_ERR_CORRUPT, "unknown state %d", state);
    if (s != STATUS_OK) {
        error_prefix(err, "%s/queue.sqlite: job %" PRIu64, store->folder, id);
        job_free(job);
        return s;
    }
    job->id = id;
    job->state = (enum job_state)state;
    column_text(row, 2, job->state_text, sizeof job->state_text);
    column_text(row, 3, job->scene_name, sizeof job->scene_name);
    column_text(row, 4, job->kernel, sizeof job->kernel);
    job->epoch_floor = column_number(row, 5);
    job->submitted_at = sqlite3_column_int64(row, 6);
    job->finished_at = sqlite3_column_int64(row, 7);
    job->active_ns = column_number(row, 8);
    job->conflicts = column_number(row, 9);
    job->stats.samples = column_number(row, 10);
    job->stats.rays = column_number(row, 11);
    job->stats.vertices = column_number(row, 12);
    job->stats.dropped_samples = column_number(row, 13);
    job->stats.cpu_ns = column_number(row, 14);
    job->stats.trace_ns = column_number(row, 16);
    job->revision = (uint32_t)column_number(row, 17);
    s = load_frames(store, job, err);
    if (s != STATUS_OK) {
        job_free(job);
        return s;
    }
    *out = job;
    return STATUS_OK;
}

status store_jobs_load(struct store *store,
                       status (*adopt)(void *user, struct job *job, struct error *err), void *user,
                       struct error *err)
{
    sqlite3_stmt *statement = NULL;
    int code = SQLITE_DONE;
    status s = sql_prepare(store,
                           "SELECT id, state, state_text, scene_name, kernel, epoch_floor, "
                           "submitted_at, finished_at, active_ns, conflicts, samples, rays, "
                           "vertices, dropped, cpu_ns, request, trace_ns, revision FROM jobs ORDER BY id",
                           &statement, err);

    if (s != STATUS_OK)
        return s;
    while (s == STATUS_OK && (code = sqlite3_step(statement)) == SQLITE_ROW) {
        struct job *job = NULL;
        s = load_job(store, statement, &job, err);
        if (s != STATUS_OK)
            break;
        s = adopt(user, job, err);
        if (s != STATUS_OK)
            job_free(job);
    }
    if (s == STATUS_OK && code != SQLITE_DONE)
        s = sql_error(store, "the jobs cannot be read", err);
    sqlite3_finalize(statement);
    return s;
}

status store_frame_done(struct store *store, uint64_t job, uint32_t frame, double relative_mse,
                        int64_t revision, struct error *err)
{
    sqlite3_stmt *statement = NULL;
    status s = sql_prepare(store,
                           "INSERT OR REPLACE INTO frames (job, frame, relative_mse, revision) "
                           "VALUES (?, ?, ?, ?)",
                           &statement, err);

    if (s != STATUS_OK)
        return s;
    bind_number(statement, 1, job);
    sqlite3_bind_int64(statement, 2, frame);
    sqlite3_bind_double(statement, 3, relative_mse); /* NaN becomes NULL */
    sqlite3_bind_int64(statement, 4, revision);
    return sql_run(store, statement, "the frame cannot be noted as done", err);
}

status store_frame_developed(struct store *store, uint64_t job, uint32_t frame, int64_t revision,
                             struct error *err)
{
    sqlite3_stmt *statement = NULL;
    status s = sql_prepare(store, "UPDATE frames SET revision=? WHERE job=? AND frame=?",
                           &statement, err);

    if (s != STATUS_OK)
        return s;
    sqlite3_bind_int64(statement, 1, revision);
    bind_number(statement, 2, job);
    sqlite3_bind_int64(statement, 3, frame);
    return sql_run(store, statement, "the frame's pictures cannot be noted", err);
}

status store_job_revise(struct store *store, const struct job *job, struct error *err)
{
    sqlite3_stmt *statement = NULL;
    struct buffer request = BUFFER_INIT;
    status s = wire_job_pack(job, &request, err);

    if (s == STATUS_OK)
        s = sql_prepare(store, "UPDATE jobs SET request=?, revision=? WHERE id=?", &statement, err);
    if (s == STATUS_OK) {
        sqlite3_bind_blob(statement, 1, request.data, (int)request.size, SQLITE_TRANSIENT);
        sqlite3_bind_int64(statement, 2, job->revision);
        bind_number(statement, 3, job->id);
        s = sql_run(store, statement, "the job's output settings cannot be stored", err);
    }
    buffer_release(&request);
    return s;
}

/* ---- films and outputs ---------------------------------------------------------------------- */

static void film_path(const struct store *store, uint64_t job, uint32_t frame, struct buffer *path)
{
    buffer_printf(path, "%s/films/%" PRIu64 "/frame-%04u.film", store->folder, job, frame);
}

status store_film_open(struct store *store, uint64_t job, uint32_t frame, struct film *film,
                       uint32_t *durable, uint8_t *slot, struct film_file **out, struct error *err)
{
    struct buffer path = BUFFER_INIT;
    status s;

    *out = NULL;
    buffer_printf(&path, "%s/films/%" PRIu64, store->folder, job);
    s = buffer_ok(&path) ? file_make_folder(buffer_text(&path), err)
                         : error_no_memory(err, "a path");
    buffer_clear(&path);
    film_path(store, job, frame, &path);
    if (s == STATUS_OK && !buffer_ok(&path))
        s = error_no_memory(err, "a path");
    if (s == STATUS_OK)
        s = film_file_open(out, buffer_text(&path), job, frame, film, durable, slot, err);
    buffer_release(&path);
    return s;
}

int store_film_exists(const struct store *store, uint64_t job, uint32_t frame)
{
    struct buffer path = BUFFER_INIT;
    int exists;

    film_path(store, job, frame, &path);
    exists = buffer_ok(&path) && file_exists(buffer_text(&path));
    buffer_release(&path);
    return exists;
}

void store_film_remove(struct store *store, uint64_t job, uint32_t frame)
{
    struct buffer path = BUFFER_INIT;

    film_path(store, job, frame, &path);
    if (buffer_ok(&path) && unlink(buffer_text(&path)) != 0 && errno != ENOENT)
        log_warn("%s: cannot be removed: %s", buffer_text(&path), strerror(errno));
    buffer_release(&path);
}

void store_films_remove(struct store *store, uint64_t job)
{
    struct buffer path = BUFFER_INIT;
    DIR *folder;
    const struct dirent *entry;

    buffer_printf(&path, "%s/films/%" PRIu64, store->folder, job);
    folder = buffer_ok(&path) ? opendir(buffer_text(&path)) : NULL;
    if (folder) {
        while ((entry = readdir(folder)))
            if (entry->d_name[0] != '.')
                unlinkat(dirfd(folder), entry->d_name, 0);
        closedir(folder);
        rmdir(buffer_text(&path));
    }
    buffer_release(&path);
}

void store_output_path(const struct store *store, uint64_t job, uint32_t frame,
                       const char *extension, struct buffer *path)
{
    buffer_printf(path, "%s/outputs/%" PRIu64 "/frame-%04u.%s", store->folder, job, frame,
                  extension);
}

status store_output_read(const struct store *store, uint64_t job, uint32_t frame,
                         const char *extension, size_t limit_bytes, struct buffer *out,
                         struct error *err)
{
    struct buffer path = BUFFER_INIT;
    status s;

    store_output_path(store, job, frame, extension, &path);
    s = buffer_ok(&path) ? file_read(buffer_text(&path), limit_bytes, out, err)
                         : error_no_memory(err, "a path");
    buffer_release(&path);
    return s;
}

status store_output_write(struct store *store, uint64_t job, uint32_t frame, const char *extension,
                          const struct buffer *data, struct error *err)
{
    struct buffer path = BUFFER_INIT;
    status s;

    buffer_printf(&path, "%s/outputs/%" PRIu64, store->folder, job);
    s = buffer_ok(&path) ? file_make_folder(buffer_text(&path), err)
                         : error_no_memory(err, "a path");
    buffer_clear(&path);
    store_output_path(store, job, frame, extension, &path);
    if (s == STATUS_OK && !buffer_ok(&path))
        s = error_no_memory(err, "a path");
    if (s == STATUS_OK)
        s = file_write_atomic(buffer_text(&path), data->data, data->size, err);
    buffer_release(&path);
    return s;
}
