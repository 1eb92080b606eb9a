/* The rows of the history: a frame's errors and the work spent on it by then. */
#include <math.h>
#include <string.h>

#include "coordinator/store/store_parts.h"

#define HISTORY_COLUMNS                                                                       \
    "core_s, wall_s, samples, rays, known, reliable, reasons, display, display_lo, display_hi, " \
    "psnr, psnr_lo, psnr_hi, rmse, rmse_lo, rmse_hi, mean, top_share, disagreement, unseen, tail, " \
    "lone, dark"

/* Pointers to the real-valued figures, in the order of the columns from `display` on. */
enum { REALS = 16 };
static void reals_of(struct accuracy_figures *f, double *reals[REALS])
{
    double *const all[REALS] = {&f->display_error, &f->display_lo, &f->display_hi, &f->psnr_db,
                                &f->psnr_lo, &f->psnr_hi, &f->rmse_percent, &f->rmse_lo,
                                &f->rmse_hi, &f->mean, &f->top_share, &f->disagreement,
                                &f->unseen, &f->tail_index, &f->lone, &f->dark};

    memcpy(reals, all, sizeof all);
}

/* NULL means "not known"; SQLite stores NaN as NULL. */
static double column_real(sqlite3_stmt *row, int at)
{
    return sqlite3_column_type(row, at) == SQLITE_NULL ? NAN : sqlite3_column_double(row, at);
}

/* The columns of HISTORY_COLUMNS from `at` on. */
static void read_point(sqlite3_stmt *row, int at, struct history_point *out)
{
    double *reals[REALS];

    out->core_s = sqlite3_column_double(row, at);
    out->wall_s = sqlite3_column_double(row, at + 1);
    out->samples = column_number(row, at + 2);
    out->rays = column_number(row, at + 3);
    out->figures.known = sqlite3_column_int(row, at + 4);
    out->figures.reliable = sqlite3_column_int(row, at + 5);
    out->figures.reasons = (unsigned)sqlite3_column_int(row, at + 6);
    reals_of(&out->figures, reals);
    for (int i = 0; i < REALS; i++)
        *reals[i] = column_real(row, at + 7 + i);
}

static status delete_behind(struct store *store, uint64_t job, uint32_t frame, uint32_t place,
                            struct error *err)
{
    return sql_change_reserved(store, "DELETE FROM history WHERE job=? AND frame=? AND place>?",
                               SQL_VALUES(sql_number(job), sql_number(frame), sql_number(place)),
                               "the frame's figures cannot be kept", err);
}

static status insert_point(struct store *store, uint64_t job, uint32_t frame, uint32_t place,
                           const struct history_point *point, struct error *err)
{
    enum { OTHERS = 10 };
    struct history_point copy = *point;
    double *reals[REALS];
    struct sql_value values[OTHERS + REALS] = {
        sql_number(job),
        sql_number(frame),
        sql_number(place),
        sql_real(point->core_s),
        sql_real(point->wall_s),
        sql_number(point->samples),
        sql_number(point->rays),
        sql_number(point->figures.known),
        sql_number(point->figures.reliable),
        sql_number(point->figures.reasons),
    };

    reals_of(&copy.figures, reals);
    for (int i = 0; i < REALS; i++)
        values[OTHERS + i] = sql_real(*reals[i]);
    return sql_change_reserved(store,
                               "INSERT OR REPLACE INTO history (job, frame, place, " HISTORY_COLUMNS
                               ") VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, "
                               "?, ?, ?, ?, ?, ?, ?)",
                               values, OTHERS + REALS, "the frame's figures cannot be kept", err);
}

status store_history_add(struct store *store, uint64_t job, uint32_t frame, uint32_t place,
                         const struct history_point *point, struct error *err)
{
    status s;

    pthread_mutex_lock(&store->order);
    s = delete_behind(store, job, frame, place, err);
    if (s == STATUS_OK)
        s = insert_point(store, job, frame, place, point, err);
    if (s == STATUS_OK)
        s = clock_write(store, job, frame, (uint64_t)llround(point->wall_s * 1e9),
                        (uint64_t)llround(point->core_s * 1e9), err);
    pthread_mutex_unlock(&store->order);
    return s;
}

status store_history_load(struct store *store, uint64_t job, uint32_t frame, struct history *out,
                          struct error *err)
{
    sqlite3_stmt *statement = NULL;
    sqlite3 *db;
    int code = SQLITE_DONE;
    status s;

    out->count = 0;
    db = reader_take(store);
    s = sql_ask(store, db,
                "SELECT " HISTORY_COLUMNS " FROM history WHERE job=? AND frame=? "
                "ORDER BY place",
                SQL_VALUES(sql_number(job), sql_number(frame)), &statement, err);
    if (s == STATUS_OK) {
        while (out->count < HISTORY_MAX && (code = sqlite3_step(statement)) == SQLITE_ROW)
            read_point(statement, 0, &out->points[out->count++]);
        if (code != SQLITE_DONE && code != SQLITE_ROW)
            s = sql_failed(store, db, "the frame's figures cannot be read", err);
        sqlite3_finalize(statement);
    }
    reader_leave(store, db);
    return s;
}

status history_load_last(struct store *store, sqlite3 *db, struct job *job, struct error *err)
{
    sqlite3_stmt *statement = NULL;
    int code = SQLITE_DONE;
    /* SQLite takes the other columns from the row that has the maximum. */
    status s = sql_ask(store, db,
                       "SELECT frame, max(place), " HISTORY_COLUMNS " FROM history "
                       "WHERE job=? GROUP BY frame ORDER BY frame",
                       SQL_VALUES(sql_number(job->id)), &statement, err);

    if (s != STATUS_OK)
        return s;
    while (s == STATUS_OK && (code = sqlite3_step(statement)) == SQLITE_ROW) {
        uint64_t frame = column_number(statement, 0);
        struct history_point point;
        if (frame < job->first_frame || frame > job->last_frame ||
            !job_frame_is_done(job, (uint32_t)frame))
            continue;
        read_point(statement, 2, &point);
        if (!job_figures_note(&job->figures, (uint32_t)frame - job->first_frame,
                              job_frame_count(job), &point))
            s = error_no_memory(err, "frames' figures");
    }
    if (s == STATUS_OK && code != SQLITE_DONE)
        s = sql_failed(store, db, "the frames' figures cannot be read", err);
    sqlite3_finalize(statement);
    return s;
}

status store_history_samples(struct store *store, uint64_t job,
                             void (*visit)(void *user, uint32_t frame, uint64_t samples), void *user,
                             struct error *err)
{
    sqlite3_stmt *statement = NULL;
    sqlite3 *db = reader_take(store);
    int code = SQLITE_DONE;
    status s;

    s = sql_ask(store, db, "SELECT frame, max(place), samples FROM history WHERE job=? GROUP BY frame",
                   SQL_VALUES(sql_number(job)), &statement, err);
    while (s == STATUS_OK && (code = sqlite3_step(statement)) == SQLITE_ROW)
        visit(user, (uint32_t)column_number(statement, 0), column_number(statement, 2));
    if (s == STATUS_OK && code != SQLITE_DONE)
        s = sql_failed(store, db, "frames' histories cannot be read", err);
    sqlite3_finalize(statement);
    reader_leave(store, db);
    return s;
}
