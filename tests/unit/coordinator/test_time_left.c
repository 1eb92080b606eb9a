/* The time left of a whole job, and the curves that forecasts are read from: coordinator/farm/figures.h. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "common/base/clock.h"
#include "coordinator/farm/figures.h"
#include "coordinator/farm/rate.h"
#include "coordinator/farm/report.h"
#include "tests/support/sim_farm.h"

enum { SIDE = 64, TILES = 16, SPP = 32, FRAMES = 6, THREADS = 4, COST_NS = 100000 };
#define FRAME_S ((double)SIDE * SIDE * SPP * COST_NS / 1e9)

/* Send a unit; the worker's threads were busy with it, at half speed. */
static void send_one(struct sim *sim, struct sim_worker *worker)
{
    uint64_t samples = sim_result(sim, &worker->units[0], (uint8_t[TILE_FLOATS_MAX * 4]){0}).work.samples;

    sim->now_ns += samples * COST_NS * 2 / THREADS;
    assert_int_equal(sim_send(sim, worker, 0, COST_NS), MERGE_PENDING);
    sim_forget(worker, 0);
    sim_commit(sim);
    sim_develop(sim);
    farm_tick(&sim->farm, sim->now_ns);
}

/* What the developer of a frame reports of it. */
static void report_done(struct sim *sim, struct job *job, uint32_t frame)
{
    const struct history_point point = {.core_s = FRAME_S, .samples = (uint64_t)SIDE * SIDE * SPP};

    figures_finished(&sim->farm, job, frame, &point);
}

/* Frames of equal cost: what is left is the cost of the samples that have not come, over the processors that
 * the job gets; while frames are done, open and not begun. */
static void time_left_counts_each_frame_once(void **state)
{
    struct sim *sim = *state;
    struct job *job = sim_submit(sim, SIDE, SIDE, SPP, 1, FRAMES, 0);
    struct sim_worker *worker = sim_connect(sim, 0, THREADS);
    double samples = 0, all = (double)SIDE * SIDE * SPP * FRAMES;
    uint32_t compared = 0, most_open = 0, done = 0;

    while (job->state != JOB_STATE_DONE) {
        uint64_t before_ns = sim->now_ns;
        uint32_t open = 0;
        double left_s, truth_s;

        sim_grant(sim, worker, 3 * TILES); /* a frame's end and the next one's beginning are lent together */
        assert_true(worker->unit_count > 0);
        send_one(sim, worker);
        samples += (double)(sim->now_ns - before_ns) * THREADS / 2 / COST_NS;
        for (; done < job->frames_done_count; done++)
            report_done(sim, job, job->first_frame + done);
        for (const struct job_frame *frame = job->frames; frame; frame = frame->next)
            open++;
        most_open = open > most_open ? open : most_open;
        left_s = figures_seconds_left(job);
        if (left_s < 0 || samples < all / FRAMES / 4)
            continue; /* at first it is not known */
        truth_s = (all - samples) * COST_NS / 1e9 * 2 / THREADS;
        if (fabs(left_s - truth_s) > 0.02 * truth_s + 0.02 * FRAME_S)
            fail_msg("%u frames done, %u open: %.3f s left instead of %.3f", job->frames_done_count, open, left_s,
                     truth_s);
        compared++;
    }
    assert_true(most_open >= 2 && compared > 100);
}

/* A frame that goes on after its end has its limits again, from where it goes on: what was spent before does
 * not count against them. */
static void limits_count_from_the_extension(void **state)
{
    const double limit_s = 2, before_s = 3;
    struct sim *sim = *state;
    struct job *job = sim_submit(sim, SIDE, SIDE, 4 * SPP, 1, 1, 0);
    struct sim_worker *worker = sim_connect(sim, 0, THREADS);
    struct job_frame *frame;
    uint64_t from_ns = 0;

    for (int i = 0; i < 20; i++) {
        sim_grant(sim, worker, 3 * TILES);
        if (i == 0)
            from_ns = sim->now_ns;
        send_one(sim, worker);
    }
    sim_grant(sim, worker, 3 * TILES);
    frame = job->frames;
    assert_non_null(frame);
    frame->clock.from_cpu_ns = (uint64_t)(before_s * 1e9);
    job->stop.core_limit_ms = (uint64_t)(limit_s * 1e3);
    assert_true(fabs(figures_whole_s(frame) - (before_s + limit_s)) < 1e-9);
    job->stop.core_limit_ms = 0;
    frame->clock.active_ns += (uint64_t)(before_s * 1e9); /* of earlier runs */
    frame->clock.from_active_ns = (uint64_t)(before_s * 1e9);
    farm_tick(&sim->farm, sim->now_ns);
    job->stop.time_limit_ms = (uint64_t)(limit_s * 1e3);
    assert_true(fabs(figures_seconds_left(job) - (limit_s - (double)(sim->now_ns - from_ns) / 1e9)) < 1e-6);
}

/* A frame whose error fell as the square root of its cost. */
static void history_of(struct history *history, uint32_t count)
{
    for (uint32_t i = 0; i < count; i++) {
        double growth = pow(4, i);
        struct history_point point = {.core_s = 3 * growth, .samples = (uint64_t)(1000 * growth),
                                      .figures = {.known = 1, .display_error = 16 / sqrt(growth)}};

        point.figures.display_lo = point.figures.display_error * 0.9;
        point.figures.display_hi = point.figures.display_error * 1.1;
        assert_int_equal(history_add(history, &point), i);
    }
}

/* Every point of a frame's history counts once: the last one twice would narrow the forecasts' intervals. */
static void the_curve_has_each_point_once(void **state)
{
    struct job_frame frame = {0};

    (void)state;
    for (uint32_t count = 0; count < 5; count++) {
        struct accuracy_point points[5];
        struct accuracy_curve curve, expected;

        memset(&frame.history, 0, sizeof frame.history);
        history_of(&frame.history, count);
        for (uint32_t i = 0; i < count; i++) {
            double growth = pow(4, i), error = 16 / sqrt(growth);
            points[i] = (struct accuracy_point){3 * growth, error, error * 0.9, error * 1.1};
        }
        figures_curve(&frame, ALLOCATION_DISPLAY, &curve);
        accuracy_curve_fit(&expected, points, count);
        assert_int_equal(curve.points, count);
        assert_memory_equal(&curve, &expected, sizeof curve);
    }
}

/* With rounds the wanted samples are not all: until a target's curve is known, the cap is the frame's end;
 * then the sooner of cap and target. */
static void the_cap_ends_what_no_curve_ends(void **state)
{
    struct sim *sim = *state;
    struct job *job = sim_submit(sim, SIDE, SIDE, 4 * SPP, 1, 1, 0);
    struct sim_worker *worker = sim_connect(sim, 0, THREADS);
    struct job_frame *frame;

    job->stop.adaptive = job->stop.has_target = 1;
    job->stop.target = (struct allocation_target){ALLOCATION_DISPLAY, 2};
    for (int i = 0; i < 8; i++) {
        sim_grant(sim, worker, 3 * TILES);
        send_one(sim, worker);
    }
    frame = job->frames;
    assert_non_null(frame);
    assert_true(fabs(figures_whole_s(frame) - 4 * FRAME_S) < 1e-6 * FRAME_S);
    history_of(&frame->history, 2); /* 8 codes after 12 s: 2 of them after some 192 s */
    assert_true(fabs(figures_whole_s(frame) - 4 * FRAME_S) < 1e-6 * FRAME_S); /* which is later */
    job->stop.target.value = 9;
    assert_true(figures_whole_s(frame) > 3 && figures_whole_s(frame) < 12); /* sooner */
}

static int measurements;

static status count_measurement(void *user, struct job_frame *frame)
{
    (void)user, (void)frame;
    measurements++;
    return STATUS_ERR_LIMIT; /* none begins */
}

/* Figures are computed again when the samples have grown by FIGURES_GROWTH. */
static void figures_wait_for_samples(void **state)
{
    struct sim *sim = *state;
    struct job *job = sim_submit(sim, SIDE, SIDE, 4 * SPP, 1, 1, 0);
    struct sim_worker *worker = sim_connect(sim, 0, THREADS);
    struct job_frame *frame;

    while (!job->frames || !film_has_replicates(job->frames->film)) {
        sim_grant(sim, worker, 2);
        while (worker->unit_count > 0)
            send_one(sim, worker);
    }
    frame = job->frames;
    sim->farm.events.measure = count_measurement;
    history_of(&frame->history, 1);
    for (int more = 0; more < 2; more++) {
        double growth = FIGURES_GROWTH + (more ? 0.01 : -0.01);

        measurements = 0;
        frame->measure_next_ns = 0;
        frame->history.points[0].samples = (uint64_t)((double)film_samples(frame->film) / growth);
        figures_tick(&sim->farm, frame, sim->now_ns);
        assert_int_equal(measurements, more);
    }
    sim->farm.events.measure = NULL;
}

/* A forecast is the time from now, with all the processors that the job gets: of its value as of its ends. */
static void forecasts_are_from_now(void **state)
{
    static struct job_report report;
    struct sim *sim = *state;
    struct job *job = sim_submit(sim, SIDE, SIDE, 4 * SPP, 1, 1, 0);
    struct sim_worker *worker = sim_connect(sim, 0, THREADS);
    double cores, spent_s;

    for (int i = 0; i < 30; i++) {
        sim_grant(sim, worker, 3 * TILES);
        send_one(sim, worker);
    }
    sim_grant(sim, worker, 3 * TILES);
    history_of(&job->frames->history, 1); /* 16 codes */
    spent_s = job->frames->spent.core_s;
    cores = throughput_of(&job->throughput);
    assert_true(spent_s > 0.5 && fabs(cores - THREADS / 2.0) < 0.2);
    job_report_make(&report, &sim->farm, job, sim->now_ns);
    assert_true(report.message.n_forecasts >= 2);
    for (size_t i = 0; i < 2; i++) {
        const Azulejo__Wire__Forecast *f = report.message.forecasts[i];
        struct accuracy_estimate core_s;
        struct accuracy_curve curve;

        figures_curve(job->frames, ALLOCATION_DISPLAY, &curve);
        core_s = accuracy_curve_cost(&curve, f->display);
        assert_true(fabs(f->seconds - fmax(core_s.value - spent_s, 0) / cores) < 1e-9);
        assert_true(fabs(f->seconds_low - fmax(core_s.lo - spent_s, 0) / cores) < 1e-9);
        assert_true(fabs(f->seconds_high - fmax(core_s.hi - spent_s, 0) / cores) < 1e-9);
        assert_true(f->seconds > 0 && f->seconds_high > f->seconds);
    }
}

/* Samples a second count from the first one on, not from before. */
static void rates_begin_with_the_first(void **state)
{
    struct rate rate = {{0}, 0, 0};
    uint64_t now_ns = 1000 * NS_PER_SECOND;

    (void)state;
    assert_true(rate_per_second(&rate, now_ns) == 0);
    for (int i = 0; i < 30; i++) {
        rate_add(&rate, 50, now_ns);
        now_ns += NS_PER_SECOND / 2;
        if (i >= 2)
            assert_true(fabs(rate_per_second(&rate, now_ns) - 100) < (i < 2 * RATE_SECONDS ? 1 : 10));
    }
    assert_true(rate_per_second(&rate, now_ns + 2 * RATE_SECONDS * NS_PER_SECOND) == 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(time_left_counts_each_frame_once, sim_set_up, sim_tear_down),
        cmocka_unit_test_setup_teardown(limits_count_from_the_extension, sim_set_up, sim_tear_down),
        cmocka_unit_test_setup_teardown(the_cap_ends_what_no_curve_ends, sim_set_up, sim_tear_down),
        cmocka_unit_test_setup_teardown(figures_wait_for_samples, sim_set_up, sim_tear_down),
        cmocka_unit_test_setup_teardown(forecasts_are_from_now, sim_set_up, sim_tear_down),
        cmocka_unit_test(rates_begin_with_the_first),
        cmocka_unit_test(the_curve_has_each_point_once),
    };
    return cmocka_run_group_tests_name("time left", tests, NULL, NULL);
}
