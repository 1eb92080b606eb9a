/* The store: jobs and epochs across restarts, the lock, film files torn by a crash, blobs. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <sqlite3.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "common/system/file.h"
#include "common/base/memory.h"
#include "coordinator/store/files/blobs.h"
#include "coordinator/pictures/cryptomatte.h"
#include "coordinator/pictures/develop.h"
#include "tests/support/exr_channels.h"
#include "coordinator/store/store_parts.h"
#include "tests/support/film_data.h"
#include "tests/support/scratch.h"
#include "tests/support/sim_farm.h"

enum { WIDTH = 20, HEIGHT = 16, SPP = 16 }; /* 2 tiles, 2 groups of 3 passes: 2, 4, 8 */

/* ---- jobs ----------------------------------------------------------------------------------- */

struct loaded {
    struct job *jobs[8];
    size_t count;
};

static status adopt(void *user, struct job *job, struct error *err)
{
    struct loaded *loaded = user;

    (void)err;
    loaded->jobs[loaded->count++] = job;
    return STATUS_OK;
}

static const struct unit_work no_work;

static void take_result(void *user, status s, const struct error *err)
{
    (void)err;
    *(status *)user = s;
}

/* What an answer that waits for it is told. */
static status save_job(struct store *store, const struct job *job, struct error *err)
{
    status result = STATUS_ERR_INTERNAL;

    assert_int_equal(store_job_save_later(store, job, 0, err), STATUS_OK);
    assert_int_equal(store_when_saved(store, take_result, &result, err), STATUS_OK);
    store_settle(store);
    return result;
}

static void jobs_survive_a_restart(void **state)
{
    struct store *store = sim_store(folder);
    struct job *job = sim_job(640, 480, 99, 3, 12, -5), *other = sim_job(1, 1, 1, 0, 0, 0);
    struct loaded loaded = {{NULL}, 0};
    struct error err = {0};
    struct unit_work work;
    const struct job *back;

    (void)state;
    snprintf(job->name, sizeof job->name, "a 'quoted' \"name\"; DROP TABLE jobs");
    snprintf(job->scene_name, sizeof job->scene_name, "scene");
    job->settings.seed = UINT64_MAX;
    job->settings.env_rotate_deg = 12.5f;
    job->output.exr_half = 1;
    job->output.png = 0;
    job->output.tonemap.exposure_ev = -1.25;
    job->epoch_floor = (uint64_t)1 << 56;
    memset(&job->scene, 0xab, sizeof job->scene);
    assert_int_equal(store_job_insert(store, job, &err), STATUS_OK);
    assert_int_equal(store_job_insert(store, other, &err), STATUS_OK);
    assert_true(other->id > job->id);
    job->state = JOB_STATE_RUNNING;
    snprintf(job->ray_tracer, sizeof job->ray_tracer, "embree 9");
    snprintf(job->release, sizeof job->release, "9.9");
    work = (struct unit_work){.samples = 1, .rays = 2, .vertices = 3, .dropped_samples = 4,
                              .leaked_rays = 9, .clamped_values = 10, .clamped_samples = 7,
                              .clamped_luminance = 8.5, .kept_luminance = 1e30,
                              .depth = {{0.1, 1e300, 3, 0, 5e-324}}};
    for (uint64_t i = WORK_COUNTERS_FIRST; i < WORK_COUNTER_COUNT; i++)
        work.count[i] = i << 40;
    for (uint32_t k = 0; k < HEALTH_KINDS; k++) {
        work.health.count[k] += k;
        if (k % 2)
            work.health.first[k] = health_key((struct health_place){k, 2, 3, 4});
    }
    for (uint32_t frame = 6; frame >= 5; frame--) { /* as they are told of the frames below */
        health_of_frame(&work.health, frame);
        unit_work_add(&job->work, &work);
    }
    job->stats = (struct work_stats){.cpu_ns = 5, .trace_ns = 6, .effects = 1ull << 40 | 5, .accounts = {7, 0, 1ull << 50}};
    job->active_ns = 1500000000;
    job->conflicts = 7;
    assert_int_equal(save_job(store, job, &err), STATUS_OK);
    assert_int_equal(store_frame_done(store, &(struct frame_done){.job = job->id, .epoch_floor = job->epoch_floor, .frame = 5, .end = FRAME_END_CAP, .work = &work}, &err), STATUS_OK);
    assert_int_equal(store_frame_done(store, &(struct frame_done){.job = job->id, .epoch_floor = job->epoch_floor, .frame = 6, .end = FRAME_END_CAP, .work = &work}, &err), STATUS_OK);
    assert_int_equal(store_frame_done(store, &(struct frame_done){.job = job->id, .epoch_floor = job->epoch_floor, .frame = 6, .end = FRAME_END_CAP, .work = &work}, &err), STATUS_OK);
    assert_int_equal(tonemap_settings_init(&job->output.tonemap, "linear", &err), STATUS_OK);
    job->output.tonemap.exposure_ev = -1.25;
    job->output.tonemap.white_kelvin = 5000;
    job->output.tonemap.temporal = 7;
    job->output.tonemap.metering = TONEMAP_METERING_PERCENTILE;
    job->output.jpg = 1;
    job->output.picture.bits = 16;
    job_revise(job, &job->output);
    assert_int_equal(store_job_revise(store, job, &err), STATUS_OK);
    assert_int_equal(store_frame_developed(store, job->id, 6, job->revision, &err), STATUS_OK);
    store_close(store);

    store = sim_store(folder);
    assert_int_equal(store_jobs_load(store, adopt, &loaded, &err), STATUS_OK);
    assert_int_equal(loaded.count, 2);
    back = loaded.jobs[0];
    assert_int_equal(back->id, job->id);
    assert_string_equal(back->name, job->name);
    assert_string_equal(back->scene_name, "scene");
    assert_string_equal(back->ray_tracer, "embree 9");
    assert_string_equal(back->release, "9.9");
    assert_int_equal(back->state, JOB_STATE_RUNNING);
    assert_int_equal(back->priority, -5);
    assert_memory_equal(&back->settings, &job->settings, sizeof job->settings);
    assert_memory_equal(&back->work, &job->work, sizeof job->work);
    assert_memory_equal(&back->stats, &job->stats, sizeof job->stats);
    assert_true(back->output.exr_half && back->output.exr && !back->output.png);
    assert_true(back->output.tonemap.exposure_ev == -1.25);
    assert_ptr_equal(back->output.tonemap.op, job->output.tonemap.op);
    assert_memory_equal(&back->scene, &job->scene, sizeof job->scene);
    assert_int_equal(back->epoch_floor, job->epoch_floor);
    assert_int_equal(back->active_ns, job->active_ns);
    assert_int_equal(back->conflicts, 7);
    assert_int_equal(back->frames_done_count, 2);
    assert_true(job_frame_is_done(back, 5) && job_frame_is_done(back, 6));
    assert_int_equal(back->revision, 1);
    assert_int_equal(back->frames_developed_count, 1); /* the other's pictures are of before */
    assert_true(job_frame_is_developed(back, 6));
    assert_string_equal(back->output.tonemap.op->name, "linear");
    assert_true(back->output.tonemap.white_kelvin == 5000 && back->output.tonemap.temporal == 7);
    assert_true(back->output.tonemap.metering == TONEMAP_METERING_PERCENTILE);
    assert_true(back->output.jpg && back->output.picture.bits == 16);
    job_free(loaded.jobs[0]);
    job_free(loaded.jobs[1]);
    job_free(job);
    job_free(other);
    store_close(store);
}

/* A store of version 1, which knew no revisions: its finished frames' pictures are as they should;
 * one of version 2, which knew no tokens; and one of version 3, which knew no clamping, limits, figures, deliverers. */
/* Version 12 had webhooks, and no events that wait for a program. */
#define WITHOUT_13                                                                          \
    "DROP TABLE waiting_events; CREATE TABLE webhooks (number INTEGER PRIMARY KEY AUTOINCREMENT, url TEXT);" \
    "CREATE TABLE webhook_events (id INTEGER PRIMARY KEY, webhook INTEGER NOT NULL REFERENCES webhooks(number) ON DELETE CASCADE);" \
    "INSERT INTO webhooks VALUES (1, 'http://a'); INSERT INTO webhook_events VALUES (1, 1); INSERT INTO sums VALUES ('webhooks', '1', 5);"
#define WITHOUT_11                                                                          \
    "DROP TABLE keys; ALTER TABLE history DROP COLUMN denoised; ALTER TABLE jobs DROP COLUMN accounts;" \
    "ALTER TABLE history DROP COLUMN display_all; ALTER TABLE history DROP COLUMN worst_part;" \
    "ALTER TABLE history DROP COLUMN fireflies; ALTER TABLE history DROP COLUMN subject;"   \
    "ALTER TABLE deliverers DROP COLUMN label; ALTER TABLE deliverers DROP COLUMN distrusted;" \
    "ALTER TABLE frames DROP COLUMN deliverers; ALTER TABLE frames DROP COLUMN done_at;"
#define WITHOUT_9                                                                           \
    "DROP TABLE sums; ALTER TABLE jobs DROP COLUMN comment; ALTER TABLE frames DROP COLUMN depth;" \
    WITHOUT_11 "ALTER TABLE history DROP COLUMN uneven;"
#define WITHOUT_8 WITHOUT_9 "DROP TABLE tokens;"
#define WITHOUT_7                                                                               \
    WITHOUT_8                                                                                   \
    "DROP TABLE workers; DROP TABLE worker_marks; DROP TABLE shares;"                           \
    "ALTER TABLE jobs DROP COLUMN waits_for; ALTER TABLE jobs DROP COLUMN not_before;"
#define WITHOUT_STEERING                                                                        \
    WITHOUT_7                                                                                   \
    "DROP TABLE events; DROP TABLE removed; ALTER TABLE jobs DROP COLUMN owner;"                \
    "ALTER TABLE jobs DROP COLUMN marks; ALTER TABLE jobs DROP COLUMN priority;"
#define WITHOUT_WORK_AND_RELEASE                                                                     \
    WITHOUT_STEERING                                                                            \
    "ALTER TABLE frames DROP COLUMN samples; ALTER TABLE frames DROP COLUMN rays;"              \
    "ALTER TABLE frames DROP COLUMN vertices; ALTER TABLE frames DROP COLUMN dropped;"          \
    "ALTER TABLE frames DROP COLUMN leaked; ALTER TABLE frames DROP COLUMN clamped_values;"     \
    "ALTER TABLE frames DROP COLUMN clamped; ALTER TABLE frames DROP COLUMN clamped_luminance;" \
    "ALTER TABLE frames DROP COLUMN health; ALTER TABLE frames DROP COLUMN kept_luminance; ALTER TABLE jobs DROP COLUMN release;"       \
    "ALTER TABLE jobs DROP COLUMN submitted; DROP TABLE history;"

static void an_older_store_is_brought_up_to_date(void **state)
{
#define WITHOUT_4                                                                               \
    "DROP TABLE clocks;"                                                                        \
    "ALTER TABLE cut_frames DROP COLUMN ended; ALTER TABLE cut_frames DROP COLUMN group_most;"  \
    WITHOUT_WORK_AND_RELEASE "DROP TABLE deliverers;"
    static const char *const steps_back[] = {
        WITHOUT_13 "PRAGMA user_version=12",
        WITHOUT_13 "DROP TABLE votes; PRAGMA user_version=11",
        WITHOUT_11 "PRAGMA user_version=10",
        WITHOUT_11 "DROP TABLE sums; PRAGMA user_version=9",
        WITHOUT_9 "PRAGMA user_version=8",
        WITHOUT_8 "PRAGMA user_version=7",
        WITHOUT_7 "PRAGMA user_version=6",
        WITHOUT_STEERING "PRAGMA user_version=5",
        WITHOUT_STEERING "ALTER TABLE frames DROP COLUMN health; PRAGMA user_version=4",
        WITHOUT_4 "PRAGMA user_version=3",
        WITHOUT_4
        "DROP TABLE cut_frames; DROP INDEX jobs_token; ALTER TABLE jobs DROP COLUMN token;"
        "PRAGMA user_version=2",
        WITHOUT_4
        "DROP TABLE cut_frames; DROP INDEX jobs_token; ALTER TABLE jobs DROP COLUMN token;"
        "ALTER TABLE jobs DROP COLUMN revision; ALTER TABLE frames DROP COLUMN revision;"
        "PRAGMA user_version=1",
    };
    struct store *store = sim_store(folder);
    struct job *job = sim_job(16, 16, 1, 1, 3, 0);
    struct loaded loaded = {{NULL}, 0};
    struct error err = {0};
    sqlite3 *db;
    uint64_t id;

    (void)state;
    assert_int_equal(store_job_insert(store, job, &err), STATUS_OK);
    assert_int_equal(store_frame_done(store, &(struct frame_done){.job = job->id, .epoch_floor = job->epoch_floor, .frame = 2, .end = FRAME_END_CAP, .work = &no_work}, &err), STATUS_OK);
    store_close(store);
    snprintf(job->token, sizeof job->token, "new");
    for (size_t i = 0; i < sizeof steps_back / sizeof *steps_back; i++) {
        assert_int_equal(sqlite3_open(path_of("queue.sqlite"), &db), SQLITE_OK);
        assert_int_equal(sqlite3_exec(db, steps_back[i], NULL, NULL, NULL), SQLITE_OK);
        sqlite3_close(db);
        for (int times = 0; times < 2; times++) { /* the second time it is up to date */
            store = sim_store(folder);
            loaded.count = 0;
            assert_int_equal(store_jobs_load(store, adopt, &loaded, &err), STATUS_OK);
            assert_int_equal(loaded.count, 1);
            assert_int_equal(loaded.jobs[0]->revision, 0);
            assert_string_equal(loaded.jobs[0]->token, "");
            assert_int_equal(loaded.jobs[0]->frames_done_count, 1);
            assert_int_equal(loaded.jobs[0]->frames_developed_count, 1);
            assert_false(depth_light_is_known(&loaded.jobs[0]->work.depth));
            assert_int_equal(store_job_find(store, job, &id, &err), STATUS_OK);
            assert_int_equal(id, 0);
            job_free(loaded.jobs[0]);
            store_close(store);
        }
    }
    job_free(job);
}

static int rows_of(sqlite3 *db, const char *select)
{
    sqlite3_stmt *statement = NULL;
    int count;

    assert_int_equal(sqlite3_prepare_v2(db, select, -1, &statement, NULL), SQLITE_OK);
    assert_int_equal(sqlite3_step(statement), SQLITE_ROW);
    count = sqlite3_column_int(statement, 0);
    sqlite3_finalize(statement);
    return count;
}

/* The films of 0.2.0 (version 8) have another format: what was begun begins again, and so do the clocks of its
 * limits. Of version 5, the priority is
 * the submission's. */
static void jobs_of_older_films_begin_again(void **state)
{
    static const char *const steps_back[] = {WITHOUT_9 "PRAGMA user_version=8",
                                             WITHOUT_STEERING "PRAGMA user_version=5"};

    (void)state;
    for (size_t i = 0; i < 2; i++) {
        struct store *store = sim_store(folder);
        struct job *job = sim_job(16, 16, 1, 1, 3, -3);
        struct loaded loaded = {{NULL}, 0};
        struct error err = {0};
        sqlite3 *db;
        assert_int_equal(store_job_insert(store, job, &err), STATUS_OK);
        job->state = JOB_STATE_RUNNING;
        snprintf(job->ray_tracer, sizeof job->ray_tracer, "a tracer");
        assert_int_equal(save_job(store, job, &err), STATUS_OK);
        job_free(job);
        store_close(store);
        assert_int_equal(sqlite3_open(path_of("queue.sqlite"), &db), SQLITE_OK);
        assert_int_equal(sqlite3_exec(db, "INSERT INTO clocks (job, frame, active_ns, cpu_ns) "
                                          "SELECT id, 1, 7, 8 FROM jobs", NULL, NULL, NULL), SQLITE_OK);
        assert_true(rows_of(db, "SELECT count(*) FROM clocks") > 0);
        assert_int_equal(sqlite3_exec(db, steps_back[i], NULL, NULL, NULL), SQLITE_OK);
        sqlite3_close(db);
        store = sim_store(folder);
        assert_int_equal(store_jobs_load(store, adopt, &loaded, &err), STATUS_OK);
        assert_string_equal(loaded.jobs[0]->ray_tracer, "");
        assert_int_equal(loaded.jobs[0]->priority, -3);
        assert_string_equal(loaded.jobs[0]->owner, "");
        job_free(loaded.jobs[0]);
        store_close(store);
        assert_int_equal(sqlite3_open(path_of("queue.sqlite"), &db), SQLITE_OK);
        assert_int_equal(rows_of(db, "SELECT count(*) FROM clocks"), 0);
        assert_int_equal(sqlite3_exec(db, "DELETE FROM jobs", NULL, NULL, NULL), SQLITE_OK);
        sqlite3_close(db);
    }
}

/* A store of 0.1.0 (version 2): what is finished stays; what is not loses the ray tracer it was begun with, and
 * its counters, unless a frame of it is done. */
static void unfinished_jobs_of_an_older_store_begin_again(void **state)
{
    static const enum job_state states[] = {JOB_STATE_QUEUED, JOB_STATE_RUNNING, JOB_STATE_DONE,
                                            JOB_STATE_FAILED, JOB_STATE_CANCELLED, JOB_STATE_PARKED,
                                            JOB_STATE_CANCELLING, JOB_STATE_RUNNING};
    enum { COUNT = sizeof states / sizeof *states };
    struct store *store = sim_store(folder);
    struct loaded loaded = {{NULL}, 0};
    struct error err = {0};
    sqlite3 *db;

    (void)state;
    for (size_t i = 0; i < COUNT; i++) {
        struct job *job = sim_job(16, 16, 1, 1, 3, 0);
        assert_int_equal(store_job_insert(store, job, &err), STATUS_OK);
        job->state = states[i];
        snprintf(job->ray_tracer, sizeof job->ray_tracer, "azulejo 0.1.0");
        job->conflicts = 1;
        job->stats.cpu_ns = 300;
        assert_int_equal(save_job(store, job, &err), STATUS_OK);
        if (i == COUNT - 1)
            assert_int_equal(store_frame_done(store, &(struct frame_done){.job = job->id, .epoch_floor = job->epoch_floor, .frame = 2, .end = FRAME_END_CAP, .work = &no_work}, &err), STATUS_OK);
        job_free(job);
    }
    store_close(store);
    assert_int_equal(sqlite3_open(path_of("queue.sqlite"), &db), SQLITE_OK);
    assert_int_equal(sqlite3_exec(db,
                                  "DROP TABLE clocks; DROP TABLE cut_frames; " WITHOUT_WORK_AND_RELEASE
                                  "DROP TABLE deliverers;"
                                  "UPDATE jobs SET samples=100, rays=200;"
                                  "DROP INDEX jobs_token; ALTER TABLE jobs DROP COLUMN token; "
                                  "PRAGMA user_version=2",
                                  NULL, NULL, NULL),
                     SQLITE_OK);
    sqlite3_close(db);
    store = sim_store(folder);
    assert_int_equal(store_jobs_load(store, adopt, &loaded, &err), STATUS_OK);
    assert_int_equal(loaded.count, COUNT);
    for (size_t i = 0; i < COUNT; i++) {
        const struct job *job = loaded.jobs[i];
        int keeps = job_state_ended(states[i]) || i == COUNT - 1;
        assert_int_equal(job->state, states[i]);
        assert_string_equal(job->ray_tracer, keeps ? "azulejo 0.1.0" : "");
        assert_int_equal(job->work.samples, i == COUNT - 1 ? 100 : 0); /* of its finished frame */
        assert_int_equal(job->work.rays, i == COUNT - 1 ? 200 : 0);
        assert_int_equal(job->stats.cpu_ns, keeps ? 300 : 0);
        assert_int_equal(job->conflicts, keeps);
        job_free(loaded.jobs[i]);
    }
    store_close(store);
}

/* A deliverer's number is not given to another after a restart. */
static void deliverers_keep_their_numbers(void **state)
{
    struct store *store = sim_store(folder);
    struct deliverer in = {7, 1234, "node-3", "azulejo 9", 1700000000, ""}, out;
    struct error err = {0};
    uint32_t last;

    (void)state;
    assert_int_equal(store_deliverers_last(store, &last, &err), STATUS_OK);
    assert_int_equal(last, 0);
    assert_int_equal(store_deliverer_save_later(store, &in, &err), STATUS_OK);
    assert_int_equal(store_await_saves(store, &err), STATUS_OK);
    store_close(store);
    store = sim_store(folder);
    assert_int_equal(store_deliverers_last(store, &last, &err), STATUS_OK);
    assert_int_equal(last, 7);
    assert_int_equal(store_deliverer_find(store, 7, &out, &err), STATUS_OK);
    assert_memory_equal(&in, &out, sizeof in);
    assert_int_equal(store_deliverer_find(store, 6, &out, &err), STATUS_OK);
    assert_int_equal(out.number, 0);
    store_close(store);
}

static status add_number(void *user, uint32_t number, struct error *err)
{
    (void)err;
    *(uint32_t *)user += number;
    return STATUS_OK;
}

/* A key's name means all that it has delivered by; a worker's only its own. */
static void deliverers_have_keys(void **state)
{
    static const struct {
        const char *name;
        uint32_t numbers; /* a bit each */
    } asked[] = {{"k", 1 | 2 | 4}, {"k@a", 2}, {"k@", 0}, {"k-2", 8}, {"K", 16}, {"_", 0}, {"%", 0}, {"other", 32}, {"a", 0}};
    static const char *const labels[] = {"k", "k@a", "k@b.c", "k-2", "K", "other@k"};
    struct store *store = sim_store(folder);
    struct error err = {0};

    (void)state;
    for (uint32_t i = 0; i < sizeof labels / sizeof *labels; i++) {
        struct deliverer d = {1u << i, 1, "h", "azulejo 9", 1700000000, ""};
        snprintf(d.label, sizeof d.label, "%s", labels[i]);
        assert_int_equal(store_deliverer_save_later(store, &d, &err), STATUS_OK);
    }
    assert_int_equal(store_await_saves(store, &err), STATUS_OK);
    for (size_t i = 0; i < sizeof asked / sizeof *asked; i++) {
        uint32_t sum = 0;
        assert_int_equal(store_deliverers_of(store, asked[i].name, add_number, &sum, &err), STATUS_OK);
        assert_int_equal(sum, asked[i].numbers);
    }
    store_close(store);
}

/* What another program does to the store's database. */
static void change_database(const char *sql)
{
    sqlite3 *db;

    assert_int_equal(sqlite3_open(path_of("queue.sqlite"), &db), SQLITE_OK);
    assert_int_equal(sqlite3_exec(db, sql, NULL, NULL, NULL), SQLITE_OK);
    sqlite3_close(db);
}

/* Does the store come to be in order (1) or not (0) within ten seconds? Its own thread tries the
 * failed saves. */
static int comes_to(struct store *store, int in_order)
{
    struct error err = {0};

    for (int i = 0; i < 1000; i++) {
        if ((store_check(store, &err) == STATUS_OK) == in_order)
            return 1;
        usleep(10000);
    }
    return 0;
}

/* Saves that failed are tried again, an event alone, too, and the thread that does it stays. */
static void failed_saves_are_tried_again(void **state)
{
    struct store *store = sim_store(folder);
    struct job *job = sim_job(16, 16, 1, 1, 3, 0);
    struct job_event event = {.text = "paused"};
    struct error err = {0};

    (void)state;
    assert_int_equal(store_job_insert(store, job, &err), STATUS_OK);
    change_database("ALTER TABLE events RENAME TO away");
    event.job = job->id;
    store_event_later(store, &event);
    assert_true(comes_to(store, 0));
    for (int i = 0; i < 100; i++) { /* no number of tries ends the thread */
        assert_int_not_equal(store_check(store, &err), STATUS_OK);
        usleep(1000);
    }
    change_database("ALTER TABLE away RENAME TO events");
    assert_true(comes_to(store, 1));
    change_database("ALTER TABLE jobs RENAME TO away");
    assert_int_equal(store_job_save_later(store, job, 0, &err), STATUS_OK);
    assert_int_not_equal(store_await_saves(store, &err), STATUS_OK);
    change_database("ALTER TABLE away RENAME TO jobs");
    assert_int_equal(save_job(store, job, &err), STATUS_OK); /* it takes the row's place */
    assert_true(comes_to(store, 1));
    store_close(store);
    job_free(job);
}

/* Where a file could not be opened for writing, SQLite has opened it for reading. */
static void what_is_open_for_reading_is_opened_again(void **state)
{
    struct store *store = sim_store(folder);
    struct job *job = sim_job(16, 16, 1, 1, 3, 0);
    struct error err = {0};

    (void)state;
    assert_int_equal(sqlite3_exec(store->db, "PRAGMA query_only=ON", NULL, NULL, NULL), SQLITE_OK);
    assert_int_equal(store_job_insert(store, job, &err), STATUS_ERR_IO);
    assert_true(store_suspect(store));
    assert_int_equal(store_check(store, &err), STATUS_OK);
    assert_int_equal(store_job_insert(store, job, &err), STATUS_OK);
    store_close(store);
    job_free(job);
}

static int steps_left;
static int fails_once(void *user UNUSED) { return --steps_left == 0; }

/* SQLite stops after each number of steps, once: then no row is looked through, and none is called damaged. */
static void sound_rows_stay_sound_where_reading_fails(void **state)
{
    struct store *store = sim_store(folder);
    struct job *job = sim_job(16, 16, 1, 1, 3, 0);
    struct error err = {0};
    int tried = 0, failed = 0;

    (void)state;
    assert_int_equal(store_job_insert(store, job, &err), STATUS_OK);
    for (int steps = 1; steps_left <= 0; steps += 1 + steps / 100) {
        sqlite3_stmt *bad;
        int code;
        steps_left = steps;
        sqlite3_progress_handler(store->db, 1, fails_once, NULL);
        code = rows_find(store->db);
        sqlite3_progress_handler(store->db, 0, NULL, NULL);
        tried++;
        failed += code != SQLITE_OK;
        if (code != SQLITE_OK)
            continue;
        assert_int_equal(sqlite3_prepare_v2(store->db, "SELECT count(*) FROM temp.bad", -1, &bad, NULL), SQLITE_OK);
        assert_int_equal(sqlite3_step(bad), SQLITE_ROW);
        assert_int_equal(sqlite3_column_int(bad, 0), 0);
        sqlite3_finalize(bad);
    }
    assert_in_range(failed, 100, tried - 1);
    store_close(store);
    job_free(job);
}

/* A token names one job for ever, also after its output settings have changed. */
/* A frame is done only when its outputs' names are on disk: one sync of their folder, which fails here. */
static void a_frame_whose_outputs_cannot_be_synced_is_not_done(void **state)
{
    struct store *store = sim_store(folder);
    struct job *job = sim_job(16, 16, 1, 1, 3, 0);
    struct loaded loaded = {{NULL}, 0};
    struct buffer data = BUFFER_INIT;
    struct error err = {0};
    char name[48];

    (void)state;
    assert_int_equal(store_job_insert(store, job, &err), STATUS_OK);
    snprintf(name, sizeof name, "outputs/%llu", (unsigned long long)job->id);
    assert_int_equal(file_make_private_folder(path_of("outputs"), &err), STATUS_OK);
    assert_int_equal(file_write_private(path_of(name), "x", 1, &err), STATUS_OK); /* no folder */
    assert_int_equal(store_frame_done(store, &(struct frame_done){.job = job->id, .epoch_floor = job->epoch_floor, .frame = 1, .end = FRAME_END_CAP, .work = &no_work}, &err),
                     STATUS_ERR_IO);
    assert_int_equal(store_frame_developed(store, job->id, 1, 2, &err), STATUS_ERR_IO);
    assert_int_equal(unlink(path_of(name)), 0);
    buffer_append(&data, "png", 3);
    assert_int_equal(store_output_write(store, job->id, 2, "png", &data, &err), STATUS_OK);
    assert_int_equal(store_frame_done(store, &(struct frame_done){.job = job->id, .epoch_floor = job->epoch_floor, .frame = 2, .end = FRAME_END_CAP, .work = &no_work}, &err),
                     STATUS_OK);
    store_close(store);
    store = sim_store(folder);
    assert_int_equal(store_jobs_load(store, adopt, &loaded, &err), STATUS_OK);
    assert_true(!job_frame_is_done(loaded.jobs[0], 1) && job_frame_is_done(loaded.jobs[0], 2));
    job_free(loaded.jobs[0]);
    job_free(job);
    buffer_release(&data);
    store_close(store);
}

static void tokens_name_one_job(void **state)
{
    struct store *store = sim_store(folder);
    struct job *first = sim_job(16, 16, 1, 1, 3, 0), *second = sim_job(16, 16, 1, 1, 3, 0);
    struct job *none = sim_job(16, 16, 1, 1, 3, 0), *again = sim_job(16, 16, 1, 1, 3, 0);
    struct error err = {0};
    uint64_t id;

    (void)state;
    snprintf(first->token, sizeof first->token, "one");
    snprintf(second->token, sizeof second->token, "one");
    assert_int_equal(store_job_find(store, first, &id, &err), STATUS_OK);
    assert_int_equal(id, 0);
    assert_int_equal(store_job_insert(store, first, &err), STATUS_OK);
    assert_int_equal(store_job_insert(store, none, &err), STATUS_OK);
    assert_int_equal(store_job_insert(store, again, &err), STATUS_OK); /* two without a token */
    assert_int_not_equal(store_job_insert(store, second, &err), STATUS_OK);
    first->output.tonemap.exposure_ev = 2;
    first->revision++;
    assert_int_equal(store_job_revise(store, first, &err), STATUS_OK);
    store_close(store);
    store = sim_store(folder);
    assert_int_equal(store_job_find(store, second, &id, &err), STATUS_OK);
    assert_int_equal(id, first->id);
    second->priority = 7;
    assert_int_equal(store_job_find(store, second, &id, &err), STATUS_OK);
    assert_int_equal(store_job_find(store, none, &id, &err), STATUS_OK);
    assert_int_equal(id, 0);
    second->settings.seed++;
    assert_int_equal(store_job_find(store, second, &id, &err), STATUS_ERR_REFUSED);
    assert_non_null(strstr(err.text, "'one'"));
    store_close(store);
    job_free(again);
    job_free(none);
    job_free(second);
    job_free(first);
}

static void epochs_never_repeat(void **state)
{
    uint64_t last = 0, epoch;
    struct error err = {0};

    (void)state;
    /* Also when the clock is set back between two runs. */
    static const int64_t clocks[] = {1700000000, 1700000000, 1500000000, 0, 1700000001};
    for (size_t i = 0; i < 5; i++) {
        struct store *store = sim_store(folder);
        assert_int_equal(store_epoch_begin(store, clocks[i], &epoch, &err), STATUS_OK);
        assert_true(epoch > last + 1000000 || i == 0);
        assert_true(epoch < INT64_MAX);
        last = epoch;
        store_close(store);
    }
}

static void a_store_in_use_is_refused(void **state)
{
    struct store *store = sim_store(folder), *second;
    struct error err = {0};
    int folder_fd;

    (void)state;
    assert_int_equal(store_open(&second, folder, &err), STATUS_ERR_REFUSED);
    assert_null(second);
    assert_non_null(strstr(err.text, "another coordinator (process "));
    /* A client that fetches into this folder locks it: it neither waits, nor keeps the next coordinator out. */
    folder_fd = open(folder, O_RDONLY | O_DIRECTORY);
    assert_int_equal(flock(folder_fd, LOCK_EX | LOCK_NB), 0);
    assert_int_equal(unlink(path_of("lock")), 0); /* by hand: the folder is still in use */
    assert_int_equal(store_open(&second, folder, &err), STATUS_ERR_REFUSED);
    assert_null(second);
    assert_non_null(strstr(err.text, "another coordinator"));
    store_close(store);
    store = sim_store(folder);
    store_close(store);
    close(folder_fd);
}

/* As by the child that a killed coordinator had just forked. */
static void a_lock_that_is_let_go_is_waited_for(void **state)
{
    struct store *store = sim_store(folder);
    int lock = open(path_of("lock"), O_RDWR);
    pid_t child;

    (void)state;
    store_close(store);
    assert_int_equal(flock(lock, LOCK_EX | LOCK_NB), 0);
    child = fork();
    assert_true(child >= 0);
    if (child == 0) {
        usleep(200000);
        _exit(0);
    }
    close(lock);
    store = sim_store(folder);
    store_close(store);
    assert_int_equal(waitpid(child, NULL, 0), child);
}

static void bad_stores_are_refused(void **state)
{
    struct store *store = sim_store(folder);
    struct error err = {0};
    struct buffer bytes = BUFFER_INIT;

    (void)state;
    store_close(store);
    /* A newer version, written where SQLite keeps user_version (byte 60, big-endian). */
    assert_int_equal(file_read(path_of("queue.sqlite"), 1 << 24, &bytes, &err), STATUS_OK);
    bytes.data[63] = 99;
    assert_int_equal(file_write_atomic(path_of("queue.sqlite"), bytes.data, bytes.size, &err), STATUS_OK);
    assert_int_equal(store_open(&store, folder, &err), STATUS_ERR_CORRUPT);
    assert_non_null(strstr(err.text, "newer"));
    memset(bytes.data, 'x', bytes.size);
    assert_int_equal(file_write_atomic(path_of("queue.sqlite"), bytes.data, bytes.size, &err), STATUS_OK);
    assert_int_equal(store_open(&store, folder, &err), STATUS_ERR_CORRUPT);
    assert_int_equal(file_write_atomic(path_of("plain"), "x", 1, &err), STATUS_OK);
    assert_int_equal(store_open(&store, path_of("plain"), &err), STATUS_ERR_IO);
    assert_int_equal(store_open(&store, "/proc/no/such", &err), STATUS_ERR_IO);
    buffer_release(&bytes);
}

/* ---- films ---------------------------------------------------------------------------------- */

struct film_fixture {
    struct film *film;
    struct film_file *file;
    uint32_t durable[2][GROUPS];
    struct film_commit commit;
};

static void record(void *user, const struct film_fold *fold)
{
    assert_true(film_record_unit(&((struct film_fixture *)user)->commit.units, fold));
}

static void film_begin(struct film_fixture *f, struct store *store)
{
    struct error err = {0};

    memset(f, 0, sizeof *f);
    f->film = film_data_new(WIDTH, HEIGHT, SPP, 0);
    assert_non_null(f->film);
    if (store_film_open(store, 1, 1, f->film, f->durable, &f->file, &err) != STATUS_OK)
        fail_msg("%s", err.text);
    film_on_fold(f->film, record, f);
}

static void end_film(struct film_fixture *f)
{
    film_file_close(f->file);
    film_free(f->film);
    buffer_release(&f->commit.units);
}

static void merge_pass(struct film *film, uint32_t tile, uint32_t pass)
{
    assert_int_equal(film_data_merge(film, tile, 0, pass), FILM_MERGED);
}

/* Write what was folded since, as a commit does. */
static void write_film(struct film_fixture *f)
{
    assert_int_equal(film_file_commit(f->file, &f->commit, NULL), STATUS_OK);
    buffer_clear(&f->commit.units);
}

static void films_come_back(void **state)
{
    struct store *store = sim_store(folder);
    struct film_fixture f, back;

    (void)state;
    film_begin(&f, store);
    for (uint32_t p = 0; p < 3; p++) {
        merge_pass(f.film, 0, p);
        write_film(&f);
    }
    merge_pass(f.film, 1, 0);
    write_film(&f);
    end_film(&f);
    assert_true(store_film_exists(store, 1, 1));
    film_begin(&back, store);
    assert_int_equal(back.durable[0][0], 3);
    assert_int_equal(back.durable[1][0], 1);
    assert_int_equal(film_tile_passes(back.film, 0, 0), 3);
    assert_int_equal(film_tile_passes(back.film, 1, 0), 1);
    merge_pass(back.film, 1, 1);
    write_film(&back);
    merge_pass(back.film, 1, 2);
    for (uint32_t i = 0; i < 6; i++)
        assert_int_equal(film_data_merge(back.film, i % 2, 1, i / 2), FILM_MERGED);
    assert_true(film_complete(back.film));
    end_film(&back);
    store_films_remove(store, 1);
    assert_false(store_film_exists(store, 1, 1));
    store_close(store);
}

static off_t file_size(const char *path)
{
    struct stat info;

    assert_int_equal(stat(path, &info), 0);
    return info.st_size;
}

static ino_t file_number(const char *path)
{
    struct stat info;

    return stat(path, &info) == 0 ? info.st_ino : 0;
}

/* Merge a pass of both tiles' groups. */
static void merge_round(struct film_fixture *f, uint32_t pass)
{
    for (uint32_t i = 0; i < 4; i++)
        assert_int_equal(film_data_merge(f->film, i % 2, i / 2, pass), FILM_MERGED);
    write_film(f);
}

static void keep_film(struct film_fixture *f, struct store *store)
{
    struct error err = {0};

    if (store_film_keep(store, 1, 1, f->film, f->file, &err) != STATUS_OK)
        fail_msg("%s", err.text);
    assert_int_equal(file_number(path_of("films/1/frame-0001.film")), 0);
}

/* The results of a done frame are not written twice where they take little room. It continues from them. */
static void a_small_film_is_kept_as_it_is(void **state)
{
    struct store *store = sim_store(folder);
    struct render_settings settings = {.width = WIDTH, .height = HEIGHT, .spp = SPP};
    struct film_fixture f, back, more;
    struct film_reader *reader;
    struct error err = {0};
    uint32_t tile;
    ino_t number;

    (void)state;
    film_begin(&f, store);
    merge_round(&f, 0);
    number = file_number(path_of("films/1/frame-0001.film"));
    assert_true(film_file_bytes(f.file) <= film_kept_limit(f.film));
    keep_film(&f, store);
    assert_int_equal(file_number(path_of("films/1/frame-0001.kept")), number);
    assert_int_equal(store_film_reader(store, 1, 1, &settings, &reader, &err), STATUS_OK);
    for (uint32_t t = 0; t < 2; t++) {
        assert_int_equal(film_reader_next(reader, &tile, &err), STATUS_OK);
        assert_int_equal(film_tile_samples(film_reader_film(reader), t), 4);
    }
    film_reader_close(reader);

    film_begin(&back, store);
    assert_int_equal(back.durable[0][0] + back.durable[1][1], 2);
    merge_round(&back, 1);
    assert_int_equal(file_number(path_of("films/1/frame-0001.kept")), number); /* it does not change */
    keep_film(&back, store); /* what was kept and what came later in one file */
    film_begin(&more, store);
    assert_int_equal(film_tile_samples(more.film, 1), 8);
    merge_round(&more, 2);
    assert_true(film_complete(more.film));
    end_film(&f);
    end_film(&back);
    end_film(&more);
    store_close(store);
}

/* One of many passes is compacted. */
static void a_large_film_is_compacted(void **state)
{
    struct store *store = sim_store(folder);
    struct film_fixture f, back;
    ino_t number;

    (void)state;
    film_begin(&f, store);
    for (uint32_t p = 0; p < 3; p++)
        merge_round(&f, p);
    assert_true(film_file_bytes(f.file) > film_kept_limit(f.film));
    number = file_number(path_of("films/1/frame-0001.film"));
    keep_film(&f, store);
    assert_true(file_number(path_of("films/1/frame-0001.kept")) != number);
    film_begin(&back, store);
    assert_true(film_complete(back.film));
    end_film(&f);
    end_film(&back);
    store_close(store);
}

/* A damaged header, or that of another version: the whole frame begins again, and the file is kept. */
static void an_unusable_film_is_set_aside(void **state)
{
    static const struct {
        off_t at;
        const char *byte;
    } damage[] = {{20, "x"}, {6, "6"}};
    struct store *store = sim_store(folder);

    (void)state;
    for (size_t i = 0; i < sizeof damage / sizeof *damage; i++) {
        struct film_fixture f;
        off_t size;
        int fd;
        film_begin(&f, store);
        merge_pass(f.film, 1, 0);
        write_film(&f);
        end_film(&f);
        film_begin(&f, store);
        assert_int_equal(f.durable[1][0], 1);
        end_film(&f);
        size = file_size(path_of("films/1/frame-0001.film"));
        fd = open(path_of("films/1/frame-0001.film"), O_RDWR);
        assert_int_equal(pwrite(fd, damage[i].byte, 1, damage[i].at), 1);
        close(fd);
        film_begin(&f, store);
        assert_int_equal(f.durable[1][0], 0);
        assert_int_equal(file_size(path_of("films/1/frame-0001.film.unusable")), size);
        end_film(&f);
    }
    store_close(store);
}

static void memory_faults_in_opening_are_told(void **state)
{
    struct store *store = sim_store(folder);
    long successes = 0, failures;

    (void)state;
    do {
        struct film *film = film_new(WIDTH, HEIGHT, SPP);
        struct film_file *file = NULL;
        uint32_t durable[2][GROUPS];
        struct error err = {0};
        status s;
        mem_fault_arm(successes++, 1);
        s = store_film_open(store, 1, 1, film, durable, &file, &err);
        failures = mem_fault_count();
        mem_fault_arm(-1, 0);
        assert_true(s == STATUS_OK || (failures && s == STATUS_ERR_NO_MEMORY && !file));
        film_file_close(file);
        film_free(film);
    } while (failures > 0);
    store_close(store);
}

/* ---- blobs ---------------------------------------------------------------------------------- */

static void put_blob(const struct digest *digest, const char *text, status expected)
{
    struct upload *upload;
    struct error err = {0};

    assert_int_equal(upload_begin(&upload, folder, digest, strlen(text), &err), STATUS_OK);
    for (size_t i = 0; i < strlen(text); i += 3)
        assert_int_equal(upload_add(upload, text + i, strlen(text + i) < 3 ? strlen(text + i) : 3, &err), STATUS_OK);
    assert_int_equal(upload_add(upload, "x", 1, &err), STATUS_ERR_PROTOCOL);
    assert_int_equal(upload_finish(upload, &err), expected);
    upload_free(upload);
}

static int count_files(const char *name)
{
    char command[300];
    FILE *pipe;
    int count = -1;

    snprintf(command, sizeof command, "find '%s/%s' -type f | wc -l", folder, name);
    pipe = popen(command, "r");
    assert_non_null(pipe);
    assert_int_equal(fscanf(pipe, "%d", &count), 1);
    pclose(pipe);
    return count;
}

static void blobs_are_checked(void **state)
{
    struct store *store = sim_store(folder);
    struct digest digest, other;
    struct buffer bytes = BUFFER_INIT, path = BUFFER_INIT;
    struct upload *upload;
    struct error err = {0};
    uint64_t size;

    (void)state;
    assert_int_equal(digest_of(&digest, "hello world", 11), STATUS_OK);
    assert_int_equal(digest_of(&other, "other", 5), STATUS_OK);
    assert_false(blobs_find(folder, &digest, &size));
    assert_int_equal(blobs_read(folder, &digest, 100, &bytes, &err), STATUS_ERR_NOT_FOUND);
    put_blob(&digest, "hello World", STATUS_ERR_INPUT); /* other bytes than announced */
    assert_false(blobs_find(folder, &digest, &size));
    assert_int_equal(count_files("blobs"), 0);
    put_blob(&digest, "hello world", STATUS_OK);
    put_blob(&digest, "hello world", STATUS_OK); /* twice is fine */
    assert_true(blobs_find(folder, &digest, &size));
    assert_int_equal(size, 11);
    assert_int_equal(blobs_read(folder, &digest, 100, &bytes, &err), STATUS_OK);
    assert_string_equal(buffer_text(&bytes), "hello world");
    assert_int_equal(blobs_read(folder, &digest, 10, &bytes, &err), STATUS_ERR_LIMIT);
    /* Half an upload leaves nothing, neither when it ends nor when the coordinator is killed. */
    assert_int_equal(upload_begin(&upload, folder, &other, 5, &err), STATUS_OK);
    assert_int_equal(upload_add(upload, "oth", 3, &err), STATUS_OK);
    assert_int_equal(count_files("blobs/tmp"), 1);
    assert_int_equal(upload_finish(upload, &err), STATUS_ERR_INPUT);
    upload_free(upload);
    assert_int_equal(count_files("blobs/tmp"), 0);
    assert_int_equal(file_write_atomic(path_of("blobs/tmp/left"), "x", 1, &err), STATUS_OK);
    blobs_clean(folder);
    assert_int_equal(count_files("blobs/tmp"), 0);
    /* A blob damaged on disk is removed when it is read. */
    blobs_path(folder, &digest, &path);
    assert_int_equal(file_write_atomic(buffer_text(&path), "hello wOrld", 11, &err), STATUS_OK);
    buffer_clear(&bytes);
    assert_int_equal(blobs_read(folder, &digest, 100, &bytes, &err), STATUS_ERR_CORRUPT);
    assert_false(blobs_find(folder, &digest, &size));
    buffer_release(&bytes);
    buffer_release(&path);
    store_close(store);
}

/* ---- outputs -------------------------------------------------------------------------------- */

/* Merge every unit: sums ((i mod 97) + offset) * factor + pass * step. */
/* Counts of things are not any numbers. */
static void no_things(const struct film *film, const struct unit_result *unit, float *sums)
{
    const struct tile_rect rect = tile_rect_of(WIDTH, HEIGHT, unit->tile);
    const uint32_t pixels = rect.width * rect.height, sent = unit_aovs(film_aovs(film), unit->group, unit->pass);

    for (int aov = 0; aov < AOV_COUNT; aov++)
        for (size_t k = 0; (sent & AOV_MATTES) >> aov & 1 && k < pixels * MATTE_FLOATS; k++)
            sums[tile_aov_offset(pixels, sent, (enum aov)aov) + k] = 0;
}

static void fill(struct film *film, float offset, float factor, float step)
{
    for (uint32_t g = 0; g < GROUPS; g++) {
        film_freeze(film, g, NULL);
        for (uint32_t i = 0; i < 2 * film_pass_count(film, g); i++) {
            static float sums[TILE_FLOATS_MAX];
            struct unit_result unit = {.tile = i % 2, .group = g, .pass = i / 2, .sums = sums};
            enum film_merge_result result;
            unit.count = tile_floats(WIDTH, HEIGHT, unit.tile, unit_aovs(film_aovs(film), g, unit.pass));
            for (size_t k = 0; k < unit.count; k++)
                sums[k] = ((float)(k % 97) + offset) * factor + (float)unit.pass * step;
            no_things(film, &unit, sums);
            assert_int_equal(film_merge(film, &unit, 1, &result, NULL), STATUS_OK);
        }
    }
    assert_true(film_complete(film));
}

/* Overwrite the date in a file's header. */
static void forget_date(struct buffer *exr)
{
    static const char name[] = "\"written\": \"";
    uint8_t *at = memmem(exr->data, exr->size, name, sizeof name - 1);

    assert_non_null(at);
    memset(at + sizeof name - 1, '-', strlen("2000-01-01T00:00:00Z"));
}

static void a_developed_frame_is_on_disk(void **state)
{
    struct store *store = sim_store(folder);
    struct job *job = sim_job(WIDTH, HEIGHT, SPP, 1, 1, 0);
    struct job_frame *frame = job_frame_new(job, 1, WIDTH, HEIGHT, SPP, 0, NULL);
    struct development *development;
    struct buffer exr = BUFFER_INIT, path = BUFFER_INIT, found = BUFFER_INIT;
    struct image image = {0};
    struct error err = {0};
    float expected[WIDTH * HEIGHT * 3];

    (void)state;
    assert_int_equal(store_job_insert(store, job, &err), STATUS_OK);
    fill(frame->film, 0, 1, 1);
    film_develop(frame->film, expected);
    assert_int_equal(development_new_frame(&development, frame, &err), STATUS_OK);
    if (develop_frame(development, store, &err) != STATUS_OK)
        fail_msg("%s", err.text);
    development_free(development);
    assert_int_equal(development_new_frame(&development, frame, &err), STATUS_OK);
    assert_int_equal(develop_encode(development, NULL, &exr, NULL, &err), STATUS_OK);
    development_free(development);
    store_output_path(store, job->id, 1, "exr", &path);
    assert_int_equal(file_read(buffer_text(&path), 1 << 24, &found, &err), STATUS_OK);
    assert_int_equal(found.size, exr.size);
    forget_date(&found);
    forget_date(&exr);
    assert_memory_equal(found.data, exr.data, exr.size); /* the same film gives the same file */
    assert_int_equal(exr_decode(&image, found.data, found.size, "output", &err), STATUS_OK);
    assert_int_equal(image.width, WIDTH);
    assert_memory_equal(image.pixels, expected, sizeof expected);
    assert_non_null(memmem(found.data, found.size, "azulejo:spp", 11));
    assert_non_null(memmem(found.data, found.size, "azulejo:errorDisplay", 20));
    assert_non_null(memmem(found.data, found.size, "azulejo:leakedRays", 18));
    assert_non_null(memmem(found.data, found.size, "azulejo:measured", 16));
    assert_non_null(memmem(found.data, found.size, "{\"job\": 1, \"workers\": 1, ", 25));
    assert_null(memmem(found.data, found.size, "azulejo:job\0", 12)); /* another store's would differ */
    buffer_clear(&path);
    store_output_path(store, job->id, 1, "png", &path);
    assert_true(file_exists(buffer_text(&path)));
    image_release(&image);
    buffer_release(&exr);
    buffer_release(&path);
    buffer_release(&found);
    job_frame_free(frame);
    job_free(job);
    store_close(store);
}

/* A film of one 20x16 frame whose values depend on the frame. */
static struct job_frame *filled_frame(struct job *job, uint32_t number)
{
    struct job_frame *frame = job_frame_new(job, number, WIDTH, HEIGHT, SPP, 0, NULL);

    assert_int_equal(job_frame_begin(frame, NULL), STATUS_OK);
    fill(frame->film, 1, (float)(1 + number * number), 1);
    return frame;
}

/* Develop frame by frame, as the farm does; `file` gets a frame's PNG. */
static void develop_job(struct store *store, struct job *job, uint32_t wanted, struct buffer *file)
{
    struct development *development;
    struct error err = {0};
    uint32_t number;

    for (uint32_t f = job->first_frame; f <= job->last_frame; f++) {
        struct job_frame *frame = filled_frame(job, f);
        assert_int_equal(development_new_frame(&development, frame, &err), STATUS_OK);
        if (develop_frame(development, store, &err) != STATUS_OK)
            fail_msg("%s", err.text);
        job_frame_set_done(job, f);
        if (development_revision(development) == job->revision)
            job_frame_set_developed(job, f);
        development_free(development);
        job_frame_free(frame);
    }
    while (job_frame_to_develop(job, &number)) {
        assert_int_equal(development_new_stored(&development, job, number, &err), STATUS_OK);
        if (develop_again(development, store, &err) != STATUS_OK)
            fail_msg("%s", err.text);
        assert_int_equal(development_revision(development), job->revision);
        job_frame_set_developed(job, number);
        development_free(development);
    }
    assert_int_equal(job->frames_developed_count, job_frame_count(job));
    buffer_clear(file);
    assert_int_equal(store_output_read(store, job->id, wanted, "png", 1 << 24, file, &err), STATUS_OK);
}

/* From stored pictures come the same bytes as from films: whether the EXR file is in halves, or
 * there is none, and with another operator as if it had been the first. */
static void pictures_can_be_made_anew(void **state)
{
    struct store *store = sim_store(folder);
    struct buffer first = BUFFER_INIT, again = BUFFER_INIT;
    struct error err = {0};

    (void)state;
    for (int kind = 0; kind < 3; kind++) {
        struct job *job = sim_job(WIDTH, HEIGHT, SPP, 1, 2, 0);
        struct job *other = sim_job(WIDTH, HEIGHT, SPP, 1, 2, 0);
        struct output_settings linear;

        job->output.exr = other->output.exr = kind != 1;
        job->output.exr_half = other->output.exr_half = kind == 2;
        assert_int_equal(store_job_insert(store, job, &err), STATUS_OK);
        assert_int_equal(store_job_insert(store, other, &err), STATUS_OK);
        linear = other->output;
        assert_int_equal(tonemap_settings_init(&linear.tonemap, "linear", &err), STATUS_OK);
        linear.tonemap.exposure_ev = -4;
        other->output = linear;
        develop_job(store, other, 2, &first);
        develop_job(store, job, 2, &again);
        assert_true(first.size != again.size || memcmp(first.data, again.data, again.size) != 0);
        job->output = linear;
        job_revise(job, &job->output);
        develop_job(store, job, 2, &again);
        assert_int_equal(first.size, again.size);
        assert_memory_equal(first.data, again.data, again.size);
        job_free(job);
        job_free(other);
    }
    buffer_release(&first);
    buffer_release(&again);
    store_close(store);
}

/* Averaged statistics: no picture before its window is whole, and then the same whatever the order
 * in which frames were done; the third frame differs from one that stands alone. */
static void averaged_frames_wait_for_their_window(void **state)
{
    struct store *store = sim_store(folder);
    struct job *job = sim_job(WIDTH, HEIGHT, SPP, 1, 4, 0), *alone;
    struct buffer first = BUFFER_INIT, again = BUFFER_INIT;
    struct error err = {0};
    uint32_t number;

    (void)state;
    job->output.tonemap.temporal = 3;
    assert_int_equal(store_job_insert(store, job, &err), STATUS_OK);
    job_frame_set_done(job, 2);
    assert_false(job_frame_to_develop(job, &number));
    job_frame_set_done(job, 4);
    assert_false(job_frame_to_develop(job, &number));
    job_frame_set_done(job, 1);
    assert_true(job_frame_to_develop(job, &number));
    assert_int_equal(number, 1);
    job_frame_set_developed(job, 1);
    assert_true(job_frame_to_develop(job, &number));
    assert_int_equal(number, 2);
    job_frame_set_developed(job, 2);
    assert_false(job_frame_to_develop(job, &number));
    job_frame_set_done(job, 3);
    assert_true(job_frame_to_develop(job, &number));
    assert_int_equal(number, 3);
    job_revise(job, &job->output);
    develop_job(store, job, 3, &first);
    job_revise(job, &job->output); /* with the statistics that were kept */
    develop_job(store, job, 3, &again);
    assert_int_equal(first.size, again.size);
    assert_memory_equal(first.data, again.data, again.size);
    alone = sim_job(WIDTH, HEIGHT, SPP, 1, 4, 0);
    assert_int_equal(store_job_insert(store, alone, &err), STATUS_OK);
    develop_job(store, alone, 3, &again);
    assert_true(first.size != again.size || memcmp(first.data, again.data, again.size) != 0);
    job_free(job);
    job_free(alone);
    buffer_release(&first);
    buffer_release(&again);
    store_close(store);
}

/* Synthetic results with every AOV come out of the EXR file, those that are positions in full
 * precision although the file is of halves. */
static void aovs_are_layers(void **state)
{
    static const struct {
        const char *name;
        int half;
        enum aov aov;
        uint32_t channel;
    } channels[] = {{"Z", 0, AOV_DEPTH, 0},           {"N.X", 1, AOV_NORMAL, 0},
                    {"N.Z", 1, AOV_NORMAL, 2},        {"albedo.G", 1, AOV_ALBEDO, 1},
                    {"P.Y", 0, AOV_POSITION, 1},      {"uv.U", 0, AOV_UV, 0},
                    {"uv.V", 0, AOV_UV, 1},           {"objectId.X", 0, AOV_OBJECT_ID, 0},
                    {"materialId.X", 0, AOV_MATERIAL_ID, 0}, {"motion.Y", 0, AOV_MOTION, 1},
                    {"samples.Y", 0, AOV_SAMPLES, 0}, {"error.B", 1, AOV_ERROR, 2},
                    {"Denoising Depth.Z", 0, AOV_DENOISING, 0},
                    {"Denoising Albedo.B", 1, AOV_DENOISING_ALBEDO, 2},
                    {"Denoising Normal.Y", 1, AOV_DENOISING_NORMAL, 1}, {"emission.R", 1, AOV_EMISSION, 0},
                    {"variance.G", 0, AOV_VARIANCE, 1},
                    {"A", 1, AOV_ALPHA, 0}};
    const uint32_t all = (1u << AOV_COUNT) - 1;
    struct job *job = sim_job(WIDTH, HEIGHT, SPP, 1, 1, 0);
    struct job_frame *frame = job_frame_new(job, 1, WIDTH, HEIGHT, SPP, all, NULL);
    struct development *development;
    struct buffer exr = BUFFER_INIT;
    struct error err = {0};

    (void)state;
    job->settings.aovs = all;
    job->output.exr_half = 1;
    fill(frame->film, 1.0f / 3, 1, 0);
    assert_int_equal(development_new_frame(&development, frame, &err), STATUS_OK);
    assert_int_equal(develop_encode(development, NULL, &exr, NULL, &err), STATUS_OK);
    development_free(development);
    assert_int_equal(exr_channel_count(exr.data, exr.size), 3 + 27 + 8 + 3 * CRYPTOMATTE_CHANNELS);
    for (size_t i = 0; i < sizeof channels / sizeof *channels; i++) {
        float wanted[3 * WIDTH * HEIGHT];
        int half = -1;
        float *got = exr_channel_read(exr.data, exr.size, channels[i].name, &half);
        assert_non_null(got);
        assert_int_equal(half, channels[i].half);
        film_develop_aov(frame->film, channels[i].aov, 0, HEIGHT, wanted);
        for (size_t k = 0; k < WIDTH * HEIGHT; k++) {
            float value = wanted[channels[i].channel * WIDTH * HEIGHT + k];
            assert_float_equal(got[k], value, half ? fabsf(value) * 0x1p-11f : 0);
        }
        free(got);
    }
    /* A preview has the picture alone, with its alpha. */
    buffer_clear(&exr);
    assert_int_equal(development_new_preview(&development, frame, NULL, &err), STATUS_OK);
    while (development_take(development))
        ;
    assert_int_equal(develop_encode(development, NULL, &exr, NULL, &err), STATUS_OK);
    development_free(development);
    assert_int_equal(exr_channel_count(exr.data, exr.size), 4);
    buffer_release(&exr);
    job_frame_free(frame);
    job_free(job);
}

static void merge_even(struct film *film, uint32_t tile, uint32_t pass, float value)
{
    static float sums[TILE_FLOATS_MAX];
    enum film_merge_result result;

    for (size_t k = 0; k < TILE_FLOATS_MAX; k++)
        sums[k] = value;
    for (uint32_t g = 0; g < GROUPS; g++) {
        struct unit_result unit = {.tile = tile, .group = g, .pass = pass, .sums = sums};
        unit.count = tile_floats(film_width(film), film_height(film), tile, unit_aovs(film_aovs(film), g, pass));
        assert_int_equal(film_merge(film, &unit, 1, &result, NULL), STATUS_OK);
    }
}

/* A film that goes on while it is copied: no step takes more than its tiles, and what was copied stays as it was. */
static void a_large_film_is_copied_in_steps(void **state)
{
    enum { TILES_ACROSS = DEVELOP_TAKE_TILES * 2 + 1, LONG = TILES_ACROSS * TILE_SIZE, LOW = TILE_SIZE };
    struct job *job = sim_job(LONG, LOW, SPP, 1, 1, 0);
    struct job_frame *frame = job_frame_new(job, 1, LONG, LOW, SPP, 1u << AOV_ALPHA, NULL);
    struct film *film = frame->film;
    struct development *development;
    struct buffer exr = BUFFER_INIT;
    struct error err = {0};
    float *red;
    int half;

    (void)state;
    job->settings.aovs = 1u << AOV_ALPHA;
    film_want_all(film);
    for (uint32_t g = 0; g < GROUPS; g++)
        film_freeze(film, g, NULL);
    for (uint32_t t = 0; t + 1 < TILES_ACROSS; t++)
        merge_even(film, t, 0, 2);
    assert_int_equal(development_new_preview(&development, frame, NULL, &err), STATUS_OK);
    assert_int_equal(development_take(development), 1);
    merge_even(film, 0, 1, 400);                  /* too late */
    merge_even(film, DEVELOP_TAKE_TILES, 1, 400); /* not yet copied: 402 of 4 samples */
    merge_even(film, TILES_ACROSS - 1, 0, 6);     /* the hole is none any more */
    assert_int_equal(development_take(development), 1);
    merge_even(film, DEVELOP_TAKE_TILES, 2, 4000);
    assert_int_equal(development_take(development), 0);
    job_frame_free(frame); /* it is a copy */
    assert_int_equal(develop_encode(development, NULL, &exr, NULL, &err), STATUS_OK);
    development_free(development);
    red = exr_channel_read(exr.data, exr.size, "R", &half);
    assert_non_null(red);
    for (uint32_t t = 0; t < TILES_ACROSS; t++)
        assert_true(red[t * TILE_SIZE] == (t == DEVELOP_TAKE_TILES ? 402.0f / 4 : t + 1 == TILES_ACROSS ? 3.0f : 1.0f));
    free(red);
    buffer_release(&exr);
    job_free(job);
}

#define STORE_TEST(name) cmocka_unit_test_setup_teardown(name, folder_set_up, folder_tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_large_film_is_copied_in_steps),
        STORE_TEST(jobs_survive_a_restart),
        STORE_TEST(an_older_store_is_brought_up_to_date),
        STORE_TEST(jobs_of_older_films_begin_again),
        STORE_TEST(unfinished_jobs_of_an_older_store_begin_again),
        STORE_TEST(deliverers_keep_their_numbers),
        STORE_TEST(deliverers_have_keys),
        STORE_TEST(failed_saves_are_tried_again),
        STORE_TEST(what_is_open_for_reading_is_opened_again),
        STORE_TEST(sound_rows_stay_sound_where_reading_fails),
        STORE_TEST(a_frame_whose_outputs_cannot_be_synced_is_not_done), STORE_TEST(tokens_name_one_job),
        STORE_TEST(epochs_never_repeat),
        STORE_TEST(a_store_in_use_is_refused),
        STORE_TEST(a_lock_that_is_let_go_is_waited_for),
        STORE_TEST(bad_stores_are_refused),
        STORE_TEST(films_come_back),
        STORE_TEST(a_small_film_is_kept_as_it_is),
        STORE_TEST(a_large_film_is_compacted),
        STORE_TEST(an_unusable_film_is_set_aside),
        STORE_TEST(memory_faults_in_opening_are_told),
        STORE_TEST(blobs_are_checked),
        STORE_TEST(a_developed_frame_is_on_disk),
        STORE_TEST(aovs_are_layers),
        STORE_TEST(pictures_can_be_made_anew),
        STORE_TEST(averaged_frames_wait_for_their_window),
    };
    return cmocka_run_group_tests_name("store", tests, NULL, NULL);
}
