/* The rows of the history: a frame's errors and the work spent on it by then. */
#include <math.h>
#include <string.h>

#include "common/base/bytes.h"
#include "coordinator/store/store_parts.h"

#define HISTORY_COLUMNS                                                                       \
    "core_s, wall_s, samples, rays, known, reliable, reasons, display, display_lo, display_hi, " \
    "psnr, psnr_lo, psnr_hi, rmse, rmse_lo, rmse_hi, mean, top_share, disagreement, unseen, tail, " \
    "lone, dark, display_all, worst_part, fireflies, subject, uneven, denoised"

/* Pointers to the real-valued figures, in the order of the columns from `display` on. */
enum { REALS = 20 };
static void reals_of(struct accuracy_figures *f, double *reals[REALS])
{
    double *const all[REALS] = {&f->display_error, &f->display_lo, &f->display_hi, &f->psnr_db,
                                &f->psnr_lo, &f->psnr_hi, &f->rmse_percent, &f->rmse_lo,
                                &f->rmse_hi, &f->mean, &f->top_share, &f->disagreement,
                                &f->unseen, &f->tail_index, &f->lone, &f->dark,
                                &f->display_all, &f->worst_part, &f->fireflies, &f->subject};

    memcpy(reals, all, sizeof all);
}

/* Figures as bytes: the reals, known, reliable, reasons, each a double of 64 bits, little-endian. */
enum { FIGURES_BYTES = (REALS + 3) * 8 };

static struct buffer write_figures(const struct accuracy_figures *figures, uint8_t bytes[FIGURES_BYTES])
{
    struct accuracy_figures copy = *figures;
    const double rest[3] = {figures->known, figures->reliable, figures->reasons};
    double *reals[REALS];

    reals_of(&copy, reals);
    for (int i = 0; i < REALS + 3; i++) {
        const double value = i < REALS ? *reals[i] : rest[i - REALS];
        uint64_t bits;
        memcpy(&bits, &value, sizeof bits);
        bytes_put64(bytes + 8 * i, bits);
    }
    return (struct buffer){.data = bytes, .size = figures->known ? FIGURES_BYTES : 0};
}

static void read_figures(sqlite3_stmt *row, int at, struct accuracy_figures *out)
{
    const uint8_t *data = sqlite3_column_blob(row, at);
    double *reals[REALS], values[REALS + 3];

    *out = (struct accuracy_figures){0};
    if (!data || sqlite3_column_bytes(row, at) != FIGURES_BYTES)
        return;
    for (int i = 0; i < REALS + 3; i++) {
        const uint64_t bits = bytes_get64(data + 8 * i);
        memcpy(&values[i], &bits, sizeof bits);
    }
    reals_of(out, reals);
    for (int i = 0; i < REALS; i++)
        *reals[i] = values[i];
    out->known = values[REALS] == 1;
    out->reliable = values[REALS + 1] == 1;
    out->reasons = values[REALS + 2] >= 0 && values[REALS + 2] < 1 << 16 ? (unsigned)values[REALS + 2] : 0;
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
    out->uneven = sqlite3_column_double(row, at + 7 + REALS); /* NULL is 0 */
    read_figures(row, at + 8 + REALS, &out->denoised);
}

static status insert_point(struct store *store, uint64_t job, uint32_t frame, uint32_t place,
                           const struct history_point *point, struct error *err)
{
    enum { OTHERS = 10, ALL = OTHERS + REALS + 2 };
    struct history_point copy = *point;
    uint8_t bytes[FIGURES_BYTES];
    const struct buffer denoised = write_figures(&point->denoised, bytes);
    double *reals[REALS];
    struct sql_value values[ALL] = {
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
    values[ALL - 2] = sql_real(point->uneven);
    values[ALL - 1] = sql_bytes(&denoised);
    return sql_change_reserved(store,
                               "INSERT OR REPLACE INTO history (job, frame, place, " HISTORY_COLUMNS
                               ") VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, "
                               "?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
                               values, ALL, "the frame's figures cannot be kept", err);
}

status history_write(struct store *store, uint64_t job, uint32_t frame, uint32_t place,
                     const struct history_point *point, struct error *err)
{
    TRY(sql_change_reserved(store, "DELETE FROM history WHERE job=? AND frame=? AND place>?",
                            SQL_VALUES(sql_number(job), sql_number(frame), sql_number(place)),
                            "the frame's figures cannot be kept", err));
    TRY(insert_point(store, job, frame, place, point, err));
    return clock_write(store, job, frame, (uint64_t)llround(point->wall_s * 1e9),
                       (uint64_t)llround(point->core_s * 1e9), err);
}

struct added_point {
    uint64_t job;
    uint32_t frame, place;
    const struct history_point *point;
};

static status add_point(struct store *store, const void *user, struct error *err)
{
    const struct added_point *a = user;

    return history_write(store, a->job, a->frame, a->place, a->point, err);
}

status store_history_add(struct store *store, uint64_t job, uint32_t frame, uint32_t place,
                         const struct history_point *point, struct error *err)
{
    status s = changes_await(store, err);

    if (s != STATUS_OK)
        return s;
    pthread_mutex_lock(&store->order);
    s = sql_transaction(store, add_point, &(struct added_point){job, frame, place, point}, err);
    pthread_mutex_unlock(&store->order);
    return s;
}

status store_history_denoised(struct store *store, uint64_t job, uint32_t frame, const struct accuracy_figures *figures,
                              struct error *err)
{
    uint8_t bytes[FIGURES_BYTES];
    const struct buffer denoised = write_figures(figures, bytes);

    return sql_write(store,
                     "UPDATE history SET denoised=?1 WHERE job=?2 AND frame=?3 AND place="
                     "(SELECT max(place) FROM history WHERE job=?2 AND frame=?3)",
                     SQL_VALUES(sql_bytes(&denoised), sql_number((int64_t)job), sql_number(frame)),
                     "the frame's figures cannot be kept", NULL, err);
}

status store_history_load(struct store *store, uint64_t job, uint32_t frame, struct history *out, struct error *err)
{
    struct sql_rows rows =
        sql_read(store, "SELECT " HISTORY_COLUMNS " FROM history WHERE job=? AND frame=? ORDER BY place",
                 SQL_VALUES(sql_number(job), sql_number(frame)), "the frame's figures cannot be read", err);

    out->count = 0;
    while (out->count < HISTORY_MAX && sql_next(&rows))
        read_point(rows.row, 0, &out->points[out->count++]);
    return sql_end(&rows);
}

status history_load_last(struct store *store, sqlite3 *db, struct job *job, struct error *err)
{
    /* SQLite takes the other columns from the row that has the maximum. */
    struct sql_rows rows = sql_ask(store, db,
                                   "SELECT frame, max(place), " HISTORY_COLUMNS " FROM history "
                                   "WHERE job=? GROUP BY frame ORDER BY frame",
                                   SQL_VALUES(sql_number(job->id)), "the frames' figures cannot be read", err);

    while (sql_next(&rows)) {
        uint64_t frame = column_number(rows.row, 0);
        struct history_point point;
        if (frame < job->first_frame || frame > job->last_frame)
            continue;
        read_point(rows.row, 2, &point);
        if (!job_frame_is_done(job, (uint32_t)frame)) {
            if (job_state_ended(job->state) || store_film_exists(store, job->id, (uint32_t)frame))
                job_note_last(job, (uint32_t)frame, &point);
        } else if (!job_figures_note(&job->figures, (uint32_t)frame - job->first_frame, job_frame_count(job), &point))
            rows.result = error_no_memory(err, "frames' figures");
    }
    return sql_end(&rows);
}

status store_history_samples(struct store *store, uint64_t job,
                             void (*visit)(void *user, uint32_t frame, uint64_t samples, double core_s), void *user, struct error *err)
{
    struct sql_rows rows = sql_read(store, "SELECT frame, max(place), samples, core_s FROM history WHERE job=? GROUP BY frame",
                                    SQL_VALUES(sql_number(job)), "frames' histories cannot be read", err);

    while (sql_next(&rows))
        visit(user, (uint32_t)column_number(rows.row, 0), column_number(rows.row, 2),
              sqlite3_column_double(rows.row, 3));
    return sql_end(&rows);
}
