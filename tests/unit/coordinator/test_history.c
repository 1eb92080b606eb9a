/* A frame's history is short whatever its length, ends with its newest point, and comes back from the store;
 * a job's frames make its worst, its flicker and its efficiency. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "coordinator/farm/figures.h"
#include "coordinator/farm/forecast.h"
#include "coordinator/job/history.h"
#include "coordinator/store/store.h"
#include "tests/support/scratch_folder.h"
#include "tests/support/sim_farm.h"

static struct history_point point_of(uint64_t samples, double display)
{
    struct history_point p = {.core_s = (double)samples / 1000, .wall_s = (double)samples / 500,
                              .samples = samples, .rays = samples * 3};

    p.figures = (struct accuracy_figures){
        .known = 1, .reliable = samples % 2, .reasons = 5, .display_error = display,
        .display_lo = display / 2, .display_hi = display * 2, .psnr_db = INFINITY, .psnr_lo = 1,
        .psnr_hi = 2, .rmse_percent = 3, .rmse_lo = 4, .rmse_hi = 5, .mean = 6, .top_share = 7,
        .disagreement = 8, .lone = 0.5, .dark = 0.25, .unseen = 9, .tail_index = NAN};
    return p;
}

static void a_history_is_short(void **state)
{
    struct history h = {.count = 0};
    uint64_t samples = 4;

    (void)state;
    assert_null(history_last(&h));
    for (int i = 0; samples < (uint64_t)1 << 20; i++, samples += samples / 10 + 1) {
        struct history_point p = point_of(samples, 1e4 / (double)samples);
        assert_true(history_add(&h, &p) == h.count - 1);
        assert_int_equal(history_last(&h)->samples, samples);
        assert_int_equal(h.points[0].samples, 4); /* the first one stays */
    }
    assert_true(h.count > 20 && h.count <= 38);
    for (uint32_t i = 1; i + 1 < h.count; i++)
        assert_true((double)h.points[i].samples >= HISTORY_RATIO * (double)h.points[i - 1].samples);
}

/* By more than a tenth, in the target's own measure; frames without figures miss nothing. */
static void frames_miss_a_target(void **state)
{
    static const double displays[4] = {10.9, 30, NAN, 46};
    struct job_figures job = {0};
    struct allocation_target target = {ALLOCATION_DISPLAY, 10};
    uint32_t index = 9;

    (void)state;
    assert_true(isnan(job_figures_missed(&job, 4, &target, &index)));
    assert_false(job_figures_misses(&job, 0, &target));
    for (uint32_t i = 0; i < 4; i++) {
        struct history_point p = point_of(1000, displays[i]);

        p.figures.known = !isnan(displays[i]);
        p.figures.psnr_db = 20;
        p.figures.rmse_percent = 1 + i;
        assert_true(job_figures_note(&job, i, 4, &p));
    }
    assert_true(job_figures_missed(&job, 4, &target, &index) == 46 && index == 3);
    assert_false(job_figures_misses(&job, 0, &target));
    assert_true(job_figures_misses(&job, 1, &target));
    assert_false(job_figures_misses(&job, 2, &target));
    target.value = 45;
    assert_true(isnan(job_figures_missed(&job, 4, &target, &index)));
    target = (struct allocation_target){ALLOCATION_RMSE, 1.9};
    assert_true(job_figures_missed(&job, 4, &target, &index) == 4 && index == 3);
    target = (struct allocation_target){ALLOCATION_PSNR, 19.5}; /* dB: more is better, and a tenth is 0.83 */
    assert_true(isnan(job_figures_missed(&job, 4, &target, &index)));
    target.value = 21;
    assert_true(fabs(target_value(&target, job_figures_missed(&job, 4, &target, &index)) - 20) < 1e-4 && index == 0);
    job_figures_release(&job);
}

static void the_last_place_is_used_again(void **state)
{
    struct history h = {.count = 0};

    (void)state;
    for (uint64_t i = 1; i < 60; i++) {
        struct history_point p = point_of((uint64_t)1 << i, 1);
        history_add(&h, &p);
    }
    assert_int_equal(h.count, HISTORY_MAX);
    assert_int_equal(history_last(&h)->samples, (uint64_t)1 << 59);
}

static void frames_make_a_job(void **state)
{
    static const double displays[] = {3, 4, 12, 5};
    struct job *job = job_new(7, 11);
    uint32_t index = 99;

    (void)state;
    assert_true(isnan(job_figures_worst(&job->figures, 5, &index)));
    assert_true(isnan(forecast_efficiency(job)));
    for (uint32_t i = 0; i < 4; i++) {
        struct history_point p = point_of(1000, displays[i]);
        assert_true(job_figures_note(&job->figures, i, 5, &p));
        job_frame_set_done(job, 7 + i);
    }
    assert_true(job_figures_worst(&job->figures, 5, &index) == 12);
    assert_int_equal(index, 2);
    assert_true(job_figures_flicker(&job->figures, 5, &index) == 13); /* 12 and 5 */
    assert_int_equal(index, 2);
    /* Mean square 194 / 4; one core-second each. */
    assert_true(fabs(forecast_efficiency(job) - 4 / 194.0) < 1e-12);
    job_free(job);
}

static void the_store_keeps_points(void **state)
{
    char folder[SCRATCH_PATH], command[64];
    struct store *store;
    struct job *job = sim_job(16, 16, 4, 1, 3, 0);
    struct history_point p[3] = {point_of(10, 9), point_of(20, 5), point_of(40, 2)};
    struct history h;
    struct error err = {0};

    (void)state;
    scratch_folder(folder);
    store = sim_store(folder);
    assert_int_equal(store_job_insert(store, job, &err), STATUS_OK);
    p[1].figures.known = 0;
    p[1].figures.display_error = NAN;
    for (uint32_t i = 0; i < 3; i++)
        assert_int_equal(store_history_add(store, job->id, 2, i, &p[i], &err), STATUS_OK);
    store_close(store);
    store = sim_store(folder);
    assert_int_equal(store_history_load(store, job->id, 1, &h, &err), STATUS_OK);
    assert_int_equal(h.count, 0);
    assert_int_equal(store_history_load(store, job->id, 2, &h, &err), STATUS_OK);
    assert_int_equal(h.count, 3);
    for (uint32_t i = 0; i < 3; i++) {
        const struct accuracy_figures *a = &h.points[i].figures, *b = &p[i].figures;
        assert_true(h.points[i].core_s == p[i].core_s && h.points[i].wall_s == p[i].wall_s);
        assert_true(h.points[i].samples == p[i].samples && h.points[i].rays == p[i].rays);
        assert_true(a->known == b->known && a->reliable == b->reliable && a->reasons == b->reasons);
        assert_true(i == 1 ? isnan(a->display_error) : a->display_error == b->display_error);
        assert_true(a->display_lo == b->display_lo && a->psnr_db == b->psnr_db);
        assert_true(a->unseen == b->unseen && a->lone == b->lone && a->dark == b->dark && isnan(a->tail_index));
    }
    /* A point takes the place of what stood there and behind it. */
    assert_int_equal(store_history_add(store, job->id, 2, 1, &p[2], &err), STATUS_OK);
    assert_int_equal(store_history_load(store, job->id, 2, &h, &err), STATUS_OK);
    assert_int_equal(h.count, 2);
    assert_int_equal(h.points[1].samples, 40);
    store_close(store);
    job_free(job);
    snprintf(command, sizeof command, "rm -r %s", folder);
    assert_int_equal(system(command), 0);
}

/* The trend is over points whose samples differ enough, and it is none before that. */
static void a_slope_is_over_enough_samples(void **state)
{
    struct history h = {0};
    struct history_point p = {.samples = 1000, .figures = {.known = 1, .display_error = 8}};

    (void)state;
    history_add(&h, &p);
    assert_true(isnan(history_slope(&h)));
    p.samples = 1100;
    p.figures.display_error = 9;
    history_add(&h, &p);
    assert_true(isnan(history_slope(&h)));
    p.samples = 4400;
    p.figures.display_error = 8 / sqrt(4.4); /* it took the place of the second */
    history_add(&h, &p);
    assert_true(fabs(history_slope(&h) + 0.5) < 1e-12);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_slope_is_over_enough_samples), cmocka_unit_test(a_history_is_short),
        cmocka_unit_test(frames_miss_a_target),
        cmocka_unit_test(the_last_place_is_used_again),
        cmocka_unit_test(frames_make_a_job),
        cmocka_unit_test(the_store_keeps_points),
    };
    return cmocka_run_group_tests_name("history", tests, NULL, NULL);
}
