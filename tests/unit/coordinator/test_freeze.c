/* Freezing: how a display shows a frame is measured on level 0 alone, kept, and the same after a crash
 * at any moment. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "common/system/clock.h"
#include "common/system/file.h"
#include "common/tonemap/tonemap.h"
#include "coordinator/farm/freeze.h"
#include "coordinator/farm/scheduler.h"
#include "coordinator/store/store.h"
#include "tests/support/scratch.h"
#include "tests/support/sim_farm.h"

enum { WIDTH = 40, HEIGHT = 24, SPP = 16, TILES = 6, LEVEL_0 = TILES * GROUPS };

static int tear_down(void **state)
{
    film_file_fault(-1);
    return folder_tear_down(state);
}

/* Send the worker's results of these passes. */
static void send_passes(struct sim *sim, struct sim_worker *worker, uint32_t first, uint32_t last)
{
    for (size_t i = worker->unit_count; i-- > 0;)
        if (!worker->units[i].sent && worker->units[i].name.pass >= first && worker->units[i].name.pass <= last)
            assert_int_equal(sim_send(sim, worker, i, 100), MERGE_PENDING);
}

static void finish(struct sim *sim, struct sim_worker *worker, const struct job *job)
{
    for (int i = 0; job->state != JOB_STATE_DONE; i++) {
        assert_true(i < 1000);
        sim->now_ns += TROUBLE_LAST_MS * NS_PER_MS;
        farm_tick(&sim->farm, sim->now_ns);
        sim_grant(sim, worker, 36);
        for (size_t u = worker->unit_count; u-- > 0;)
            if (!worker->units[u].sent)
                sim_send(sim, worker, u, 100);
        sim_commit(sim);
        sim_freeze(sim);
        sim_commit(sim);
        sim_develop(sim);
    }
    assert_int_equal(sim->wrong_frames, 0); /* with the statistics of every level */
}

static struct sim *begin(struct store *store, const char *tonemap, struct sim_worker **worker, struct job **job)
{
    struct sim *sim = sim_new(store, 1);

    sim->tonemap = tonemap;
    *job = sim_submit(sim, WIDTH, HEIGHT, SPP, 1, 1, 0);
    *worker = sim_connect(sim, 0, 1000);
    sim_grant(sim, *worker, 2 * LEVEL_0);
    return sim;
}

static void what_comes_early_waits_for_the_measurement(void **state)
{
    struct sim_worker *worker;
    struct job *job;
    struct sim *sim = begin(NULL, "reinhard02", &worker, &job);
    const struct film *film = job->frames->film;
    struct film_level level;

    (void)state;
    send_passes(sim, worker, 1, 1);
    send_passes(sim, worker, 0, 0);
    assert_int_equal(sim->freezing_count, GROUPS);
    sim_commit(sim);
    assert_int_equal(sim->acks, LEVEL_0);
    assert_int_equal(film_tile_passes(film, 0, 0), 1);
    assert_int_equal(film_tile_waiting(film, 0), GROUPS);
    assert_int_equal(film_level(film, 0, 0, 1, &level), 0);
    sim_freeze(sim);
    assert_int_equal(film_tile_passes(film, 0, 0), 2);
    assert_int_equal(film_level(film, 0, 0, 1, &level), 1);
    assert_int_equal(level.has_codes, 1);
    sim_commit(sim);
    assert_int_equal(sim->acks, 2 * LEVEL_0);
    finish(sim, worker, job);
    sim_free(sim);
}

/* A frame that ended meanwhile keeps the samples that its header tells: what waited stays out. */
static void the_measurement_of_an_ended_frame_comes_too_late(void **state)
{
    struct sim_worker *worker;
    struct job *job;
    struct sim *sim = begin(NULL, "reinhard02", &worker, &job);
    struct job_frame *frame = job->frames;
    uint64_t samples;

    (void)state;
    send_passes(sim, worker, 0, 1);
    sim_commit(sim);
    assert_int_equal(sim->freezing_count, GROUPS);
    assert_int_equal(film_tile_waiting(frame->film, 0), GROUPS);
    samples = film_samples(frame->film);
    assert_true(samples > 0);
    farm_cancel(&sim->farm, job, 0, sim->now_ns);
    assert_true(frame->end == FRAME_END_CANCEL);
    sim_freeze(sim);
    assert_int_equal(film_samples(frame->film), samples);
    sim_develop(sim);
    assert_int_equal(job->state, JOB_STATE_CANCELLED);
    sim_free(sim);
}

/* Nothing is to be measured: nothing waits. */
static void a_fixed_display_is_known_at_the_start(void **state)
{
    struct sim_worker *worker;
    struct job *job;
    struct sim *sim = begin(NULL, "aces-hill", &worker, &job);

    (void)state;
    assert_true(film_is_frozen(job->frames->film, 0) && film_is_frozen(job->frames->film, 1));
    finish(sim, worker, job);
    assert_int_equal(sim->freezing_count, 0);
    sim_free(sim);
}

/* Results that cannot be folded yet must not fill the memory. */
static void fewer_passes_are_lent_before_the_measurement(void **state)
{
    struct sim *sim = sim_new(NULL, 1);
    struct sim_worker *worker = sim_connect(sim, 0, 1000);

    (void)state;
    sim->tonemap = "reinhard02";
    sim_submit(sim, 16, 16, 1000000, 1, 1, 0);
    assert_int_equal(sim_grant(sim, worker, 4000), GROUPS * FRAME_PASSES_UNFROZEN);
    send_passes(sim, worker, 0, 0);
    sim_freeze(sim);
    assert_true(sim_grant(sim, worker, 4000) > GROUPS * FRAME_PASSES_UNFROZEN);
    sim_free(sim);
}

/* kill -9 at every moment between level 0 and what follows it. */
static void a_crash_changes_no_measurement(void **state)
{
    static const char *const operators[] = {"reinhard02", "normalize", "linear", "mantiuk06"};

    (void)state;
    for (int moment = 0; moment < 24; moment++) {
        struct store *store = sim_store(folder);
        struct sim_worker *worker;
        struct job *job;
        struct sim *sim = begin(store, operators[moment % 4], &worker, &job);
        uint64_t id = job->id;

        send_passes(sim, worker, 0, 0);
        if (moment / 4 == 1)
            sim_commit(sim);
        if (moment / 4 == 2 && sim->freezing_count) /* noted, not frozen */
            freezing_run(sim->freezing[0]);
        if (moment / 4 >= 3)
            sim_freeze(sim);
        if (moment / 4 >= 4)
            send_passes(sim, worker, 1, 1);
        if (moment / 4 >= 5)
            sim_commit(sim);
        sim_release(sim);
        store_close(store);
        store = sim_store(folder);
        worker->unit_count = 0;
        sim_init(sim, store, 2);
        job = queue_find(&sim->farm.queue, id);
        finish(sim, sim_connect(sim, 0, 1000), job);
        sim_free(sim);
        store_close(store);
    }
}

/* How the group's level 0 shows a light, measured here of the whole picture. */
static void codes_of_level_0(const struct job *job, const float *level_0, const float light[3], float codes[3])
{
    struct image image;
    struct tonemap_state measured;
    struct tonemap_pixels *pixels;
    struct error err = {0};

    assert_int_equal(image_init(&image, WIDTH, HEIGHT, 3, &err), STATUS_OK);
    memcpy(image.pixels, level_0, (size_t)WIDTH * HEIGHT * 3 * sizeof *level_0);
    assert_int_equal(image_smooth(&image, FREEZE_RADIUS, &err), STATUS_OK);
    assert_int_equal(tonemap_measure(&measured, &image, &job->output.tonemap, NULL, &err), STATUS_OK);
    assert_int_equal(tonemap_pixels_new(&pixels, &job->output.tonemap, &measured, NULL, &err), STATUS_OK);
    tonemap_pixels_codes(pixels, light, 1, codes);
    tonemap_pixels_free(pixels);
    image_release(&image);
}

/* The column of tiles with the largest value of the smoothed picture. */
static size_t brightest_column(const float *level_0)
{
    struct image image;
    size_t at = 0;

    assert_int_equal(image_init(&image, WIDTH, HEIGHT, 3, NULL), STATUS_OK);
    memcpy(image.pixels, level_0, (size_t)WIDTH * HEIGHT * 3 * sizeof *level_0);
    assert_int_equal(image_smooth(&image, FREEZE_RADIUS, NULL), STATUS_OK);
    for (size_t i = 0; i < (size_t)WIDTH * HEIGHT * 3; i++)
        at = image.pixels[i] > image.pixels[at] ? i : at;
    image_release(&image);
    return at / 3 % WIDTH / TILE_SIZE;
}

/* Each group's display is measured of all its pixels: none of its tiles can stand for the others. */
static void every_tile_is_measured(void **state)
{
    static float level_0[GROUPS][WIDTH * HEIGHT * 3];
    static const char *const operators[] = {"reinhard02", "normalize", "drago03"};

    (void)state;
    for (size_t k = 0; k < sizeof operators / sizeof *operators; k++) {
        struct sim_worker *worker;
        struct job *job;
        struct sim *sim = begin(NULL, operators[k], &worker, &job);

        send_passes(sim, worker, 0, 0);
        for (uint32_t g = 0; g < GROUPS; g++)
            film_develop_group(job->frames->film, g, level_0[g]);
        sim_freeze(sim);
        for (uint32_t g = 0; g < GROUPS; g++) {
            const float *p = level_0[g] + 3 * (WIDTH * (HEIGHT - 1)); /* some light of the picture */
            float light[3];
            float codes[3], expected[3], others[3];
            size_t column;

            while (p[0] < 1) /* no display shows the darkest of these */
                p += 3;
            for (int c = 0; c < 3; c++)
                light[c] = p[c] * 1e-3f;
            codes_of_level_0(job, level_0[g], light, expected);
            assert_non_null(job->frames->display[g]);
            tonemap_pixels_codes(job->frames->display[g], light, 1, codes);
            assert_memory_equal(codes, expected, sizeof codes);
            /* Without those that hold the brightest part it would be another display. */
            column = brightest_column(level_0[g]);
            for (size_t i = 0; i < WIDTH * HEIGHT; i++)
                if (i % WIDTH / TILE_SIZE == column)
                    memset(level_0[g] + 3 * i, 0, 3 * sizeof(float));
            codes_of_level_0(job, level_0[g], light, others);
            assert_true(memcmp(others, expected, sizeof others) != 0);
        }
        finish(sim, worker, job);
        sim_free(sim);
    }
}

/* Other output settings change the pictures, not what the statistics are measured in. */
static void other_settings_come_too_late(void **state)
{
    struct store *store = sim_store(folder);
    struct sim_worker *worker;
    struct job *job;
    struct sim *sim = begin(store, "reinhard02", &worker, &job);
    struct output_settings output = job->output;
    struct error err = {0};
    uint64_t id = job->id;

    (void)state;
    send_passes(sim, worker, 0, 0);
    assert_int_equal(sim->freezing_count, 2);
    sim->freezing_count--;
    freezing_abandon(&sim->farm, sim->freezing[1]);
    sim_freeze(sim);
    assert_int_equal(tonemap_settings_init(&output.tonemap, "aces", &err), STATUS_OK);
    assert_int_equal(farm_develop(&sim->farm, job, &output, &err), STATUS_OK);
    for (int run = 0; run < 2; run++) {
        farm_tick(&sim->farm, sim->now_ns);
        sim_freeze(sim);
        for (uint32_t g = 0; g < GROUPS; g++)
            assert_string_equal(tonemap_pixels_settings(job->frames->display[g])->op->name, "reinhard02");
        if (run == 1)
            break;
        sim_commit(sim);
        sim_release(sim);
        store_close(store);
        store = sim_store(folder);
        sim_init(sim, store, 2);
        job = queue_find(&sim->farm.queue, id);
        assert_true(film_is_frozen(job->frames->film, 0)); /* by what was noted */
    }
    sim_free(sim);
    store_close(store);
}

static void a_full_disk_is_waited_for(void **state)
{
    struct store *store = sim_store(folder);
    struct sim_worker *worker;
    struct job *job;
    struct sim *sim = begin(store, "reinhard02", &worker, &job);

    (void)state;
    send_passes(sim, worker, 0, 1);
    film_file_fault(0);
    sim_freeze(sim);
    assert_false(film_is_frozen(job->frames->film, 0));
    assert_non_null(strstr(job->frames->trouble.text, "No space left on device"));
    film_file_fault(-1);
    finish(sim, worker, job);
    sim_free(sim);
    store_close(store);
}

/* A note that was torn or damaged is made again, and the film with it loses nothing. */
static void a_damaged_note_is_made_again(void **state)
{
    struct store *store = sim_store(folder);
    struct sim_worker *worker;
    struct job *job;
    struct sim *sim = begin(store, "reinhard02", &worker, &job);
    uint64_t id = job->id;
    static uint8_t bytes[1 << 16];
    const uint8_t *note;
    char path[128];
    ssize_t size;
    int file;

    (void)state;
    send_passes(sim, worker, 0, 0);
    sim_commit(sim);
    sim_freeze(sim);
    sim_release(sim);
    store_close(store);
    snprintf(path, sizeof path, "%s/films/%u/frame-0001.film", folder, (unsigned)id);
    file = open(path, O_RDWR);
    size = pread(file, bytes, sizeof bytes, 0);
    assert_true(size > 0);
    note = memmem(bytes, (size_t)size, "reinhard02", 10); /* of group 0, which is frozen first */
    assert_non_null(note);
    assert_int_equal(pwrite(file, "?", 1, note - bytes), 1);
    close(file);
    store = sim_store(folder);
    worker->unit_count = 0;
    sim_init(sim, store, 2);
    job = queue_find(&sim->farm.queue, id);
    assert_false(film_is_frozen(job->frames->film, 0));
    assert_true(film_is_frozen(job->frames->film, 1));
    finish(sim, sim_connect(sim, 0, 1000), job);
    sim_free(sim);
    store_close(store);
}

/* An operator that cannot be used fails its pictures, not the samples. */
static void a_missing_table_does_not_hold_samples_back(void **state)
{
    struct store *store = sim_store(folder);
    struct sim_worker *worker;
    struct job *job = sim_job(WIDTH, HEIGHT, SPP, 1, 1, 0);
    struct sim *sim = sim_new(store, 1);
    struct error err = {0};

    (void)state;
    assert_int_equal(tonemap_settings_init(&job->output.tonemap, "lut", &err), STATUS_OK);
    job->output.tonemap.has_file = 1;
    snprintf(job->output.tonemap.file_name, sizeof job->output.tonemap.file_name, "gone.cube");
    assert_int_equal(farm_submit(&sim->farm, job, &err), STATUS_OK);
    worker = sim_connect(sim, 0, 1000);
    sim_grant(sim, worker, 2 * LEVEL_0);
    send_passes(sim, worker, 0, 0);
    sim_freeze(sim);
    assert_string_equal(tonemap_pixels_settings(job->frames->display[0])->op->name, "linear");
    sim_free(sim);
    store_close(store);
}

#define FREEZE_TEST(name) cmocka_unit_test_setup_teardown(name, folder_set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        FREEZE_TEST(what_comes_early_waits_for_the_measurement),
        FREEZE_TEST(the_measurement_of_an_ended_frame_comes_too_late),
        FREEZE_TEST(every_tile_is_measured),
        FREEZE_TEST(a_fixed_display_is_known_at_the_start),
        FREEZE_TEST(fewer_passes_are_lent_before_the_measurement),
        FREEZE_TEST(a_crash_changes_no_measurement),
        FREEZE_TEST(other_settings_come_too_late),
        FREEZE_TEST(a_full_disk_is_waited_for),
        FREEZE_TEST(a_damaged_note_is_made_again),
        FREEZE_TEST(a_missing_table_does_not_hold_samples_back),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
