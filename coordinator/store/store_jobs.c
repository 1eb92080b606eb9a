/* The rows of the database: jobs, and the frames of each that are done. */
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "common/base/bytes.h"
#include "common/system/log.h"
#include "coordinator/store/store_parts.h"
#include "coordinator/job/wire.h"

status store_job_insert(struct store *store, struct job *job, struct error *err)
{
    struct buffer request = BUFFER_INIT;
    status s = wire_job_pack(job, &request, err);

    THEN(s, changes_await(store, err));
    pthread_mutex_lock(&store->order);
    THEN(s, sql_change(store,
                       "INSERT INTO jobs (id, name, state, state_text, scene_name, kernel, epoch_floor, "
                       "submitted_at, finished_at, active_ns, conflicts, samples, rays, vertices, dropped, "
                       "cpu_ns, trace_ns, request, token, priority, owner) "
                       "VALUES (1 + max(coalesce((SELECT seq FROM sqlite_sequence WHERE name='jobs'), 0),"
                       " coalesce((SELECT value FROM meta WHERE name='last_job'), 0), coalesce((SELECT max(id) FROM jobs), 0)),"
                       " ?, ?, '', ?, '', ?, ?, 0, 0, 0, 0, 0, 0, 0, 0, 0, ?, ?, ?, ?)",
                       SQL_VALUES(sql_text(job->name), sql_number(job->state), sql_text(job->scene_name),
                                  sql_number(job->epoch_floor), sql_number(job->submitted_at), sql_bytes(&request),
                                  sql_text(job->token[0] ? job->token : NULL), sql_number(job->priority),
                                  sql_text(job->owner)),
                       "the job cannot be stored", err));
    if (s == STATUS_OK)
        job->id = (uint64_t)sqlite3_last_insert_rowid(store->db);
    pthread_mutex_unlock(&store->order); /* no other insert may come before its id is read */
    buffer_release(&request);
    return s;
}

status store_job_find(struct store *store, const struct job *job, uint64_t *id, struct error *err)
{
    struct job *there = NULL;
    struct sql_rows rows;
    int same = 0;

    *id = 0;
    if (!job->token[0])
        return STATUS_OK;
    TRY(changes_await(store, err));
    /* The original submission: an extension changes `request`. */
    rows = sql_read(store, "SELECT id, coalesce(submitted, request) FROM jobs WHERE token=?",
                    SQL_VALUES(sql_text(job->token)), "the jobs cannot be read", err);
    if (sql_next(&rows)) {
        *id = column_number(rows.row, 0);
        rows.result =
            wire_job_unpack(&there, sqlite3_column_blob(rows.row, 1), (size_t)sqlite3_column_bytes(rows.row, 1), err);
        THEN(rows.result, wire_job_same(job, there, &same, err));
        if (rows.result == STATUS_OK && !same)
            rows.result = error_set(err, STATUS_ERR_REFUSED,
                                    "the token '%s' was used for job %" PRIu64 ", which has another scene, "
                                    "name, frames or settings; choose another token",
                                    job->token, *id);
    }
    job_free(there);
    return sql_end(&rows);
}

void store_job_forget(struct store *store, uint64_t id)
{
    struct error err = {0};

    if (sql_note(store, "DELETE FROM jobs WHERE id=?", SQL_VALUES(sql_number(id)), "a job cannot be removed", &err) !=
        STATUS_OK)
        log_error("%s", err.text);
}

/* A row is three numbers: a kind of the health's, its count and example; or COUNTER_KIND more than the number of one of WORK_COUNTERS that
 * has no column, its count and 0. Programs skip the kinds that they do not know. */
enum { COUNT_ROW_BYTES = 3 * 8, COUNT_ROWS = HEALTH_KINDS + WORK_COUNTER_COUNT - WORK_COUNTERS_FIRST, COUNTER_KIND = 1 << 16 };

static void write_count(struct buffer *out, uint64_t kind, uint64_t count, uint64_t first)
{
    if (count > 0) {
        bytes_add64(bytes_add64(bytes_add64(out->data + out->size, kind), count), first);
        out->size += COUNT_ROW_BYTES;
    }
}

/* What occurred; `rows` has room for COUNT_ROWS. */
static struct buffer write_counts(const struct unit_work *work, uint8_t *rows)
{
    struct buffer out = {.data = rows};

    for (int k = 0; k < HEALTH_KINDS; k++)
        write_count(&out, (uint64_t)k, work->health.count[k], work->health.first[k]);
    for (int i = WORK_COUNTERS_FIRST; i < WORK_COUNTER_COUNT; i++)
        write_count(&out, COUNTER_KIND + (uint64_t)i, work->count[i], 0);
    return out;
}

static void read_counts(sqlite3_stmt *row, int at, struct unit_work *out)
{
    const uint8_t *data = sqlite3_column_blob(row, at);
    int bytes = sqlite3_column_bytes(row, at);

    for (int i = 0; data && i + COUNT_ROW_BYTES <= bytes; i += COUNT_ROW_BYTES) {
        uint64_t kind = bytes_get64(data + i), count = bytes_get64(data + i + 8);
        if (kind < HEALTH_KINDS) {
            out->health.count[kind] = count;
            out->health.first[kind] = bytes_get64(data + i + 16);
        } else if (kind - COUNTER_KIND < WORK_COUNTER_COUNT) {
            out->count[kind - COUNTER_KIND] = count;
        }
    }
}

enum { DEPTH_BYTES = DEPTH_SUMS * 8 };

/* Nothing where nothing is known. */
static struct buffer write_depth(const struct depth_light *light, uint8_t *bytes)
{
    struct buffer out = {.data = bytes};

    for (; out.size < DEPTH_BYTES && depth_light_is_known(light); out.size += 8)
        bytes_add_double(bytes + out.size, light->sum[out.size / 8]);
    return out;
}

static void read_depth(sqlite3_stmt *row, int at, struct depth_light *out)
{
    const uint8_t *data = sqlite3_column_blob(row, at);

    if (!data || sqlite3_column_bytes(row, at) != DEPTH_BYTES)
        return;
    for (int i = 0; i < DEPTH_SUMS; i++)
        out->sum[i] = bytes_take_double(&data);
    if (!depth_light_is_valid(out))
        memset(out, 0, sizeof *out);
}

static struct unit_work read_work(sqlite3_stmt *row, int at)
{
    struct unit_work work = {.samples = column_number(row, at),
                             .rays = column_number(row, at + 1),
                             .vertices = column_number(row, at + 2),
                             .dropped_samples = column_number(row, at + 3),
                             .leaked_rays = column_number(row, at + 4),
                             .clamped_values = column_number(row, at + 5),
                             .clamped_samples = column_number(row, at + 6),
                             .clamped_luminance = sqlite3_column_double(row, at + 7),
                             .kept_luminance = sqlite3_column_double(row, at + 8)};

    read_counts(row, at + 9, &work);
    read_depth(row, at + 10, &work.depth);
    return work;
}

/* only_work: what those took that the job has as done; it knows better, because changes of rows may wait. */
static status load_frames(struct store *store, sqlite3 *db, struct job *job, int only_work, struct error *err)
{
    struct unit_work work;
    struct sql_rows rows = sql_ask(store, db,
                                   "SELECT frame, revision, samples, rays, vertices, dropped, leaked, "
                                   "clamped_values, clamped, clamped_luminance, kept_luminance, health, depth "
                                   "FROM frames WHERE job=? ORDER BY frame",
                                   SQL_VALUES(sql_number(job->id)), "the frames cannot be read", err);

    while (sql_next(&rows)) {
        sqlite3_int64 frame = sqlite3_column_int64(rows.row, 0);
        if (frame < job->first_frame || frame > job->last_frame ||
            (only_work && !job_frame_is_done(job, (uint32_t)frame)))
            continue;
        job_frame_set_done(job, (uint32_t)frame);
        work = read_work(rows.row, 2);
        health_of_frame(&work.health, (uint32_t)frame);
        unit_work_add(&job->work, &work);
        if (!only_work && sqlite3_column_int64(rows.row, 1) == (sqlite3_int64)job->revision)
            job_frame_set_developed(job, (uint32_t)frame);
    }
    return sql_end(&rows);
}

static status load_cuts(struct store *store, struct job *job, struct error *err)
{
    struct sql_rows rows = sql_select(store,
                                      "SELECT frame, samples, least, most, tiles, tiles_empty, ended, "
                                      "group_most FROM cut_frames WHERE job=? ORDER BY frame",
                                      SQL_VALUES(sql_number(job->id)), "the frames cannot be read", err);

    while (sql_next(&rows)) {
        uint64_t frame = column_number(rows.row, 0);
        struct film_coverage cut = {.samples = column_number(rows.row, 1),
                                    .least = (uint32_t)column_number(rows.row, 2),
                                    .most = (uint32_t)column_number(rows.row, 3),
                                    .tiles = (uint32_t)column_number(rows.row, 4),
                                    .tiles_empty = (uint32_t)column_number(rows.row, 5),
                                    .group_most = (uint32_t)column_number(rows.row, 7)};
        enum frame_end end = (enum frame_end)column_number(rows.row, 6);
        if (frame >= job->first_frame && frame <= job->last_frame && job_frame_is_done(job, (uint32_t)frame) &&
            cut.samples <= job_frame_samples(job))
            rows.result = job_frame_set_cut(job, (uint32_t)frame, end, &cut, err);
    }
    return sql_end(&rows);
}

status store_job_sum(struct store *store, struct job *job, struct error *err)
{
    sqlite3 *db = reader_take(store);
    status s;

    memset(&job->work, 0, sizeof job->work);
    job_figures_release(&job->figures);
    s = load_frames(store, db, job, 1, err);
    THEN(s, history_load_last(store, db, job, err));
    reader_leave(store, db);
    return s;
}

/* A job in the place of one whose row cannot be read: parked with the reason, so that the others go on. It is never
 * rendered, and its row stays as it is but for the state that people give it. */
static status load_damaged(const struct store *store, sqlite3_stmt *row, const struct error *why, struct job **out)
{
    int state = sqlite3_column_int(row, 1);
    struct job *job = job_new(1, 1);
    status s = job ? wire_output_get(&job->output, NULL, NULL) : STATUS_ERR_NO_MEMORY;

    if (s != STATUS_OK) {
        job_free(job);
        return s;
    }
    job->id = column_number(row, 0);
    job->is_damaged = 1;
    job->state = state >= 0 && state < JOB_STATE_COUNT && job_state_ended((enum job_state)state) ? (enum job_state)state
                                                                                                 : JOB_STATE_PARKED;
    render_settings_default(&job->settings);
    snprintf(job->name, sizeof job->name, "damaged");
    snprintf(job->state_text, sizeof job->state_text,
             "its row in queue.sqlite is damaged: %.200s; submit it again, then cancel and remove this one", why->text);
    job->submitted_at = sqlite3_column_int64(row, 6);
    job->finished_at = sqlite3_column_int64(row, 7);
    column_text(row, 17, job->owner, sizeof job->owner);
    log_error("%s/queue.sqlite: job %" PRIu64 " is parked: %s", store->folder, job->id, job->state_text);
    *out = job;
    return STATUS_OK;
}

/* Has a row of the job's another digest than it was written with? */
static status check_rows(struct store *store, uint64_t id, struct error *err)
{
    struct sql_rows rows = sql_select(store, "SELECT tab, key FROM temp.bad WHERE job=?", SQL_VALUES(sql_number(id)),
                                      "the jobs cannot be read", err);
    char tab[32], key[64];
    int found = sql_next(&rows);

    if (found) {
        column_text(rows.row, 0, tab, sizeof tab);
        column_text(rows.row, 1, key, sizeof key);
    }
    TRY(sql_end(&rows));
    return found ? error_set(err, STATUS_ERR_CORRUPT, "table %s, row %s has another digest", tab, key) : STATUS_OK;
}

/* ---- accounts -------------------------------------------------------------------------------- */

static void put_number(uint8_t *out, uint64_t value)
{
    for (int i = 0; i < 8; i++)
        out[i] = (uint8_t)(value >> 8 * i);
}

static uint64_t get_number(const uint8_t *in)
{
    uint64_t value = 0;

    for (int i = 7; i >= 0; i--)
        value = value << 8 | in[i];
    return value;
}

void stats_pack(const struct work_stats *stats, uint8_t out[STATS_BYTES])
{
    put_number(out, stats->effects);
    for (size_t i = 0; i < EFFECT_ACCOUNTS; i++)
        put_number(out + 8 * (i + 1), stats->accounts[i]);
}

void stats_unpack(struct work_stats *stats, const uint8_t *in, size_t size)
{
    if (size != STATS_BYTES)
        return; /* an older release's job, or with other effects */
    stats->effects = get_number(in);
    for (size_t i = 0; i < EFFECT_ACCOUNTS; i++)
        stats->accounts[i] = get_number(in + 8 * (i + 1));
}

static status load_job(struct store *store, sqlite3_stmt *row, struct job **out, struct error *err)
{
    struct job *job = NULL;
    uint64_t id = column_number(row, 0);
    int state = sqlite3_column_int(row, 1);
    status s = check_rows(store, id, err);

    THEN(s, wire_job_unpack(&job, sqlite3_column_blob(row, 11), (size_t)sqlite3_column_bytes(row, 11), err));
    if (s == STATUS_OK && (state < 0 || state >= JOB_STATE_COUNT))
        s = error_set(err, STATUS_ERR_CORRUPT, "unknown state %d", state);
    if (s != STATUS_OK) {
        job_free(job);
        if (!status_is_environment(s) && load_damaged(store, row, err, out) == STATUS_OK)
            return STATUS_OK;
        error_prefix(err, "%s/queue.sqlite: job %" PRIu64, store->folder, id);
        return s;
    }
    job->id = id;
    job->state = (enum job_state)state;
    column_text(row, 2, job->state_text, sizeof job->state_text);
    column_text(row, 3, job->scene_name, sizeof job->scene_name);
    column_text(row, 4, job->ray_tracer, sizeof job->ray_tracer);
    job->epoch_floor = column_number(row, 5);
    job->submitted_at = sqlite3_column_int64(row, 6);
    job->finished_at = sqlite3_column_int64(row, 7);
    job->active_ns = column_number(row, 8);
    job->conflicts = column_number(row, 9);
    job->stats.cpu_ns = column_number(row, 10);
    job->stats.trace_ns = column_number(row, 12);
    job->revision = (uint32_t)column_number(row, 13);
    column_text(row, 14, job->release, sizeof job->release);
    job->marks = (unsigned)sqlite3_column_int(row, 15);
    if (sqlite3_column_type(row, 16) == SQLITE_INTEGER)
        job->priority = sqlite3_column_int(row, 16);
    column_text(row, 17, job->owner, sizeof job->owner);
    if (sqlite3_column_type(row, 18) == SQLITE_TEXT)
        needs_after_parse(&job->needs, (const char *)sqlite3_column_text(row, 18));
    if (sqlite3_column_type(row, 19) == SQLITE_INTEGER)
        job->needs.not_before = sqlite3_column_int64(row, 19);
    column_text(row, 20, job->comment, sizeof job->comment);
    stats_unpack(&job->stats, sqlite3_column_blob(row, 21), (size_t)sqlite3_column_bytes(row, 21));
    s = load_frames(store, store->db, job, 0, err);
    if (s == STATUS_OK && job->frames_done_count > 0)
        s = load_cuts(store, job, err);
    if (s == STATUS_OK)
        s = history_load_last(store, store->db, job, err);
    if (s != STATUS_OK) {
        job_free(job);
        return s;
    }
    *out = job;
    return STATUS_OK;
}

status store_jobs_load(struct store *store, status (*adopt)(void *user, struct job *job, struct error *err), void *user,
                       struct error *err)
{
    struct sql_rows rows = sql_select(store,
                          "SELECT id, state, state_text, scene_name, kernel, epoch_floor, "
                          "submitted_at, finished_at, active_ns, conflicts, cpu_ns, request, "
                          "trace_ns, revision, release, marks, priority, owner, waits_for, not_before, comment, accounts FROM jobs ORDER BY id",
                          NULL, 0, "the jobs cannot be read", err);

    while (sql_next(&rows)) {
        struct job *job = NULL;
        rows.result = load_job(store, rows.row, &job, err);
        THEN(rows.result, adopt(user, job, err));
        if (rows.result != STATUS_OK)
            job_free(job);
    }
    return sql_end(&rows);
}

static const char cut_insertion[] =
    "INSERT OR REPLACE INTO cut_frames (job, frame, samples, least, most, tiles, tiles_empty, "
    "ended, group_most) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)";
#define CUT_VALUES                                                                                                  \
    SQL_VALUES(sql_number(job), sql_number(frame), sql_number(cut->samples), sql_number(cut->least),                \
               sql_number(cut->most), sql_number(cut->tiles), sql_number(cut->tiles_empty), sql_number(end),        \
               sql_number(cut->group_most))

static status cut_insert(struct store *store, uint64_t job, uint32_t frame, enum frame_end end,
                         const struct film_coverage *cut, struct error *err)
{
    return sql_change_reserved(store, cut_insertion, CUT_VALUES, "the frame's samples cannot be noted", err);
}

status cut_note(struct noted_list *list, uint64_t job, uint32_t frame, enum frame_end end,
                const struct film_coverage *cut, struct error *err)
{
    return changes_add(list, cut_insertion, CUT_VALUES, "the frame's samples cannot be noted", err);
}

/* Does the job still have the rules of this epoch? */
static status check_rules(struct store *store, uint64_t job, uint64_t epoch_floor, struct error *err)
{
    struct sql_rows rows = sql_select(store, "SELECT epoch_floor FROM jobs WHERE id=?", SQL_VALUES(sql_number(job)),
                                      "the job cannot be read", err);
    const int same = sql_next(&rows) && column_number(rows.row, 0) == epoch_floor;

    TRY(sql_end(&rows));
    return same ? STATUS_OK
                : error_set(err, STATUS_ERR_REFUSED, "job %llu got other rules while its picture was made",
                            (unsigned long long)job);
}

static status write_done(struct store *store, const void *user, struct error *err)
{
    const struct frame_done *d = user;
    const struct unit_work *work = d->work;
    const struct frame_makers unknown = {0}, *makers = d->makers ? d->makers : &unknown;
    uint8_t rows[COUNT_ROWS * COUNT_ROW_BYTES], sums[DEPTH_BYTES];
    const struct buffer health = write_counts(work, rows), depth = write_depth(&work->depth, sums);

    TRY(check_rules(store, d->job, d->epoch_floor, err));
    if (d->point)
        TRY(history_write(store, d->job, d->frame, d->place, d->point, err));
    if (d->cut)
        TRY(cut_insert(store, d->job, d->frame, d->end, d->cut, err));
    return sql_change_reserved(
        store,
        "INSERT OR REPLACE INTO frames (job, frame, revision, samples, rays, vertices, dropped, "
        "leaked, clamped_values, clamped, clamped_luminance, kept_luminance, health, depth, "
        "deliverers, done_at) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
        SQL_VALUES(sql_number(d->job), sql_number(d->frame), sql_number(d->revision), sql_number(work->samples),
                   sql_number(work->rays), sql_number(work->vertices), sql_number(work->dropped_samples),
                   sql_number(work->leaked_rays), sql_number(work->clamped_values), sql_number(work->clamped_samples),
                   sql_real(work->clamped_luminance), sql_real(work->kept_luminance), sql_bytes(&health),
                   sql_bytes(&depth), sql_bytes(&makers->deliverers), sql_number(makers->done_at)),
        "the frame cannot be noted as done", err);
}

status store_frame_done(struct store *store, const struct frame_done *done, struct error *err)
{
    status s = store_outputs_sync(store, done->job, err);

    THEN(s, changes_await(store, err));
    pthread_mutex_lock(&store->order);
    THEN(s, sql_transaction(store, write_done, done, err));
    pthread_mutex_unlock(&store->order);
    return s;
}

status store_frame_developed(struct store *store, uint64_t job, uint32_t frame, int64_t revision, struct error *err)
{
    TRY(store_outputs_sync(store, job, err));
    return sql_write(store, "UPDATE frames SET revision=? WHERE job=? AND frame=?",
                     SQL_VALUES(sql_number(revision), sql_number(job), sql_number(frame)),
                     "the frame's pictures cannot be noted", NULL, err);
}

status store_job_revise(struct store *store, const struct job *job, struct error *err)
{
    struct buffer request = BUFFER_INIT;
    status s = wire_job_pack(job, &request, err);

    THEN(s, sql_note(store, "UPDATE jobs SET request=?, revision=? WHERE id=?",
                     SQL_VALUES(sql_bytes(&request), sql_number(job->revision), sql_number(job->id)),
                     "the job's output settings cannot be stored", err));
    buffer_release(&request);
    return s;
}

status store_clock_load(struct store *store, uint64_t job, uint32_t frame, struct frame_clock *out, struct error *err)
{
    const int begins = changes_have_clock(store, job, frame); /* asked first: it may be written any moment */
    struct sql_rows rows =
        sql_read(store,
                 "SELECT active_ns, cpu_ns, from_active_ns, from_cpu_ns FROM clocks "
                 "WHERE job=? AND frame=?",
                 SQL_VALUES(sql_number(job), sql_number(frame)), "a frame's time cannot be read", err);

    memset(out, 0, sizeof *out);
    if (sql_next(&rows))
        *out = (struct frame_clock){.active_ns = column_number(rows.row, 0), .cpu_ns = column_number(rows.row, 1),
                                    .from_active_ns = column_number(rows.row, 2),
                                    .from_cpu_ns = column_number(rows.row, 3)};
    if (begins) {
        out->from_active_ns = out->active_ns;
        out->from_cpu_ns = out->cpu_ns;
    }
    return sql_end(&rows);
}

status clock_write(struct store *store, uint64_t job, uint32_t frame, uint64_t active_ns, uint64_t cpu_ns,
                   struct error *err)
{
    return sql_change_reserved(store,
                               "INSERT INTO clocks (job, frame, active_ns, cpu_ns) VALUES (?, ?, ?, ?) "
                               "ON CONFLICT (job, frame) DO UPDATE SET active_ns=max(active_ns, excluded.active_ns), "
                               "cpu_ns=max(cpu_ns, excluded.cpu_ns)",
                               SQL_VALUES(sql_number(job), sql_number(frame), sql_number(active_ns),
                                          sql_number(cpu_ns)),
                               "a frame's time cannot be stored", err);
}
