/* The time left of a whole job, and the curves that forecasts are read from: coordinator/farm/figures.h. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "common/system/clock.h"
#include "coordinator/farm/figures.h"
#include "coordinator/farm/forecast.h"
#include "coordinator/farm/rate.h"
#include "coordinator/steering/report.h"
#include "tests/support/sim_farm.h"

enum { SIDE = 64, TILES = 16, SPP = 32, FRAMES = 6, THREADS = 4, COST_NS = 100000 };
#define FRAME_S ((double)SIDE * SIDE * SPP * COST_NS / 1e9)

/* Send a unit; the worker's threads were busy with it, at half speed. */
static void send_one(struct sim *sim, struct sim_worker *worker)
{
    uint64_t samples = sim_result(sim, &worker->units[0], (float[TILE_FLOATS_MAX]){0}).unit.work.samples;

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
        left_s = forecast_seconds_left(job);
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
    assert_true(fabs(forecast_whole_s(frame) - (before_s + limit_s)) < 1e-9);
    job->stop.core_limit_ms = 0;
    frame->spent.rays = 1000;
    job->stop.max_rays = 3000;
    assert_true(frame->spent.core_s > 0 && fabs(forecast_whole_s(frame) - 3 * frame->spent.core_s) < 1e-9);
    job->stop.max_rays = 0;
    frame->clock.active_ns += (uint64_t)(before_s * 1e9); /* of earlier runs */
    frame->clock.from_active_ns = (uint64_t)(before_s * 1e9);
    farm_tick(&sim->farm, sim->now_ns);
    job->stop.time_limit_ms = (uint64_t)(limit_s * 1e3);
    assert_true(fabs(forecast_seconds_left(job) - (limit_s - (double)(sim->now_ns - from_ns) / 1e9)) < 1e-6);
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
        struct price_point points[5] = {0};
        struct prices prices, expected;

        memset(&frame.history, 0, sizeof frame.history);
        history_of(&frame.history, count);
        for (uint32_t i = 0; i < count; i++) {
            double growth = pow(4, i), error = 16 / sqrt(growth);
            points[i].core_s = 3 * growth;
            points[i].samples = 1000 * growth;
            points[i].figures = (struct accuracy_figures){
                .known = 1, .display_error = error, .display_lo = error * 0.9, .display_hi = error * 1.1};
        }
        forecast_prices(&frame.history, ALLOCATION_DISPLAY, &prices);
        prices_fit(&expected, points, count, ALLOCATION_DISPLAY);
        assert_int_equal(prices.curve.points, count);
        assert_memory_equal(&prices, &expected, sizeof prices);
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
    assert_true(fabs(forecast_whole_s(frame) - 4 * FRAME_S) < 1e-6 * FRAME_S);
    history_of(&frame->history, 2); /* 8 codes after 12 s: 2 of them after some 192 s */
    assert_true(fabs(forecast_whole_s(frame) - 4 * FRAME_S) < 1e-6 * FRAME_S); /* which is later */
    job->stop.target.value = 12;
    assert_true(forecast_whole_s(frame) > 3 && forecast_whole_s(frame) < 12); /* sooner */
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

    while (!job->frames || !film_has_groups(job->frames->film)) {
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
    /* And when enough was rendered since the last ones, for what they cost. */
    for (int more = 0; more < 2; more++) {
        measurements = 0;
        frame->measuring = 1;
        sim->farm.events.measure = count_measurement;
        job->measurements++;
        frame->measure_tiles = 0;
        figures_measured(&sim->farm, job, frame->number, &(struct figures_result){.evidence.known = 1, .cost_ns = 1000},
                         sim->now_ns);
        sim->now_ns += 1000 * FIGURES_INTERVAL_MS * NS_PER_MS;
        frame->measure_cost_ns = (uint64_t)frame->stats.cpu_ns / FIGURES_COST_SHARE;
        frame->stats.cpu_ns += (uint64_t)(FIGURES_COST_SHARE * frame->measure_tile_ns * (more ? 1.1 : 0.9) * TILES);
        figures_tick(&sim->farm, frame, sim->now_ns);
        assert_int_equal(measurements, more);
    }
    sim->farm.events.measure = NULL;
}

/* ---- the time left of a job's life ---------------------------------------------------------------- */

enum { LIFE_SPP = 32768, LIFE_COST_NS = 2000 };

/* All workers send what they have done by `now`: each thread is busy with its units, at half speed. */
struct crew {
    struct sim_worker *workers[4];
    uint32_t count;
    double owed[4]; /* samples that they have rendered and not sent */
};

static void crew_work(struct sim *sim, struct crew *crew, double seconds)
{
    sim->now_ns += (uint64_t)(seconds * 1e9);
    for (uint32_t w = 0; w < crew->count; w++) {
        struct sim_worker *worker = crew->workers[w];
        crew->owed[w] += seconds * 1e9 * THREADS / 2 / LIFE_COST_NS;
        for (;;) {
            double samples;
            if (worker->unit_count == 0)
                sim_grant(sim, worker, 2 * TILES);
            if (worker->unit_count == 0)
                break;
            samples = (double)sim_result(sim, &worker->units[0], (float[TILE_FLOATS_MAX]){0}).unit.work.samples;
            if (samples > crew->owed[w])
                break;
            crew->owed[w] -= samples;
            sim_send(sim, worker, 0, LIFE_COST_NS);
            sim_forget(worker, 0);
        }
    }
    sim_commit(sim);
    farm_tick(&sim->farm, sim->now_ns);
}

/* What the line said of the time left, and when. */
struct told_left {
    double at_s, left_s;
};
enum { TOLD_MAX = 4096 };

static double share_right(const struct told_left *told, size_t count, double end_s, double changed_s)
{
    size_t right = 0, known = 0;

    for (size_t i = 0; i < count; i++) {
        double truth_s = end_s - told[i].at_s;
        if (told[i].at_s < changed_s)
            continue;
        known++;
        right += told[i].left_s >= 0 && fabs(told[i].left_s - truth_s) <= fmax(0.2 * truth_s, 1);
    }
    return known ? (double)right / (double)known : 0;
}

/* Without more workers for all of it, the time left is within a fifth for four fifths of the time: also after a pause, after
 * an extension, and from when more workers came. Times in which nobody works do not count. */
static void the_time_left_holds_through_a_jobs_life(void **state)
{
    static struct told_left told[TOLD_MAX];
    struct sim *sim = *state;
    struct job *job = sim_submit(sim, SIDE, SIDE, LIFE_SPP, 1, 1, 0);
    struct crew crew = {.workers = {sim_connect(sim, 0, THREADS)}, .count = 1};
    const double step_s = (double)SIDE * SIDE * LIFE_SPP * LIFE_COST_NS / 1e9 / 4000;
    double passed_s = 0, grown_s = 0, before, share;
    int paused = 0;
    size_t count = 0;

    while (!job->frames || job->frames->state == FRAME_RENDERING) {
        double done;

        crew_work(sim, &crew, step_s);
        passed_s += step_s;
        if (!job->frames || job->frames->state != FRAME_RENDERING)
            break;
        done = forecast_share(job);
        assert_true(count < TOLD_MAX);
        told[count++] = (struct told_left){passed_s, forecast_seconds_left(job)};
        if (done > 0.25 && !paused) { /* as a pause looks to the rate: no lease for a long time */
            sim->now_ns += 10000 * NS_PER_SECOND;
            throughput_idle(&job->throughput, sim->now_ns);
            paused = 1;
        }
        if (done > 0.5 && crew.count == 1) {
            for (unsigned w = 1; w < 4; w++)
                crew.workers[crew.count++] = sim_connect(sim, w, THREADS);
            grown_s = passed_s;
        }
    }
    /* Until they came, the truth is what it would have been without them. */
    before = grown_s + 4 * (passed_s - grown_s);
    for (size_t i = 0; i < count && told[i].at_s < grown_s; i++)
        told[i].left_s -= before - passed_s;
    share = share_right(told, count, passed_s, grown_s);
    printf("# before: right for %.0f %% of the time\n", 100 * share_right(told, count, passed_s, 5));
    printf("# four times the workers from %.0f of %.0f s on: right for %.0f %% of the time since\n", grown_s, passed_s, 100 * share);
    assert_true(grown_s > 0 && share > 0.8);
}

/* ---- freshness --------------------------------------------------------------------------------- */

enum { LARGE = 1024, LARGE_SPP = 256, LARGE_COST_NS = 1200, TILE_COST_NS = 256 * 400 };

/* Figures are computed in another thread: what was asked for, until it ends. */
struct measuring {
    struct job_frame *frame;
    uint64_t end_ns;
    struct history_point point;
    uint32_t asked, of_all;
};
static struct measuring measuring;

static status begin_measuring(void *user, struct job_frame *frame)
{
    (void)user;
    measuring.frame = frame;
    measuring.point = frame->spent;
    measuring.point.figures = (struct accuracy_figures){.known = 1, .display_error = 5, .display_lo = 4, .display_hi = 6};
    measuring.asked++;
    measuring.of_all += frame->measure_tiles == 0;
    return STATUS_OK;
}

static void end_measuring(struct sim *sim, struct job *job)
{
    struct job_frame *frame = measuring.frame;
    uint64_t tiles = frame && frame->measure_tiles ? frame->measure_tiles : LARGE / 16 * LARGE / 16;
    struct figures_result result = {&measuring.point, {1, 0, 0}, tiles * TILE_COST_NS};

    if (!frame || sim->now_ns < measuring.end_ns)
        return;
    measuring.frame = NULL;
    figures_measured(&sim->farm, job, frame->number, &result, sim->now_ns);
}

/* While a large frame renders, its figures are never older than 5 s or a tenth of its time, for 1/400 of the processor time.
 * `slow`: samples take longer, so that much may be spent when each pixel has some, and one core renders. */
static void check_large_frame(struct sim *sim, int slow)
{
    struct job *job = sim_submit(sim, LARGE, LARGE, LARGE_SPP, 1, 1, 0);
    struct sim_worker *worker = sim_connect(sim, (unsigned)slow, THREADS);
    double oldest_s = 0, wall_s = 0, first_s = -1, groups_s = -1;
    uint64_t cost_ns = 0, cpu_ns = 0, cost_of_sample = slow ? 8 * LARGE_COST_NS : LARGE_COST_NS;

    memset(&measuring, 0, sizeof measuring);
    sim->farm.events.measure = begin_measuring;
    while (!job->frames || job->frames->state == FRAME_RENDERING) {
        const struct history_point *last;
        struct job_frame *frame;

        sim_grant(sim, worker, 64);
        for (int i = 0; i < 64 && worker->unit_count > 0; i++) {
            uint64_t samples = sim_result(sim, &worker->units[0], (float[TILE_FLOATS_MAX]){0}).unit.work.samples;
            sim->now_ns += samples * cost_of_sample * (slow ? 4 : 2) / THREADS;
            sim_send(sim, worker, 0, cost_of_sample);
            sim_forget(worker, 0);
        }
        sim_commit(sim);
        if (measuring.frame && measuring.end_ns < sim->now_ns)
            measuring.end_ns = sim->now_ns + NS_PER_SECOND / 10;
        farm_tick(&sim->farm, sim->now_ns);
        end_measuring(sim, job);
        frame = job->frames;
        if (frame->state != FRAME_RENDERING)
            break;
        cost_ns = frame->measure_cost_ns;
        cpu_ns = frame->stats.cpu_ns;
        wall_s = frame->spent.wall_s;
        groups_s = groups_s < 0 && film_has_groups(frame->film) ? wall_s : groups_s;
        last = history_last(&frame->history);
        first_s = first_s < 0 && last ? wall_s : first_s;
        if (last && wall_s - last->wall_s > fmax(5, 0.1 * wall_s))
            fail_msg("at %.1f s the figures are of %.1f s", wall_s, last->wall_s);
        oldest_s = last ? fmax(oldest_s, wall_s - last->wall_s) : 0;
    }
    printf("# %.0f s: figures at first after %.1f s (of all tiles: %.1f s), %u times, %u of them of all tiles, at most %.1f s old; 1/%.0f of the CPU\n",
           wall_s, first_s, groups_s, measuring.asked, measuring.of_all, oldest_s, (double)cpu_ns / (double)cost_ns);
    assert_true(wall_s > 100 && oldest_s > 3 && first_s < groups_s + 5);
    assert_true(cost_ns * FIGURES_COST_SHARE <= cpu_ns * 11 / 10);
    sim->farm.events.measure = NULL;
}

static void figures_of_large_frames_are_fresh(void **state)
{
    for (int slow = 0; slow < 2; slow++)
        check_large_frame(*state, slow);
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
        struct prices prices;

        forecast_prices(&job->frames->history, ALLOCATION_DISPLAY, &prices);
        core_s = prices_cost(&prices, f->display);
        assert_true(fabs(f->seconds - fmax(core_s.value - spent_s, 0) / cores) < 1e-9);
        assert_true(fabs(f->seconds_low - fmax(core_s.lo - spent_s, 0) / cores) < 1e-9);
        assert_true(fabs(f->seconds_high - fmax(core_s.hi - spent_s, 0) / cores) < 1e-9);
        assert_true(f->seconds > 0 && f->seconds_high > f->seconds);
    }
}

static const Azulejo__Wire__Forecast *end_of(const Azulejo__Wire__JobInfo *info)
{
    for (size_t i = 0; i < info->n_forecasts; i++)
        if (info->forecasts[i]->at_end)
            return info->forecasts[i];
    return NULL;
}

/* With a time limit the end is the limit, or the other rules' end if that is sooner; its error comes from the prices, and is not
 * told where they say next to nothing. */
static void a_time_limit_has_an_end(void **state)
{
    static struct job_report report;
    struct sim *sim = *state;
    struct job *job = sim_submit(sim, SIDE, SIDE, 4 * SPP, 1, 1, 0);
    struct sim_worker *worker = sim_connect(sim, 0, THREADS);
    const Azulejo__Wire__Forecast *end;
    struct prices prices;
    double core_s, left_s = 1;

    for (int i = 0; i < 30; i++) {
        sim_grant(sim, worker, 3 * TILES);
        send_one(sim, worker);
    }
    sim_grant(sim, worker, 3 * TILES);
    job->stop.adaptive = 1;
    history_of(&job->frames->history, 2);
    job->stop.time_limit_ms = (uint64_t)((job->frames->spent.wall_s + left_s) * 1e3);
    job_report_make(&report, &sim->farm, job, sim->now_ns);
    end = end_of(&report.message);
    assert_non_null(end);
    core_s = job->frames->spent.core_s + left_s * report.message.cores;
    forecast_prices(&job->frames->history, ALLOCATION_DISPLAY, &prices);
    assert_true(fabs(end->seconds - left_s) < 2e-3 && fabs(end->seconds_high - end->seconds_low) < 2e-3);
    assert_true(fabs(end->display - prices_error(&prices, core_s).value) < 1e-2);
    job->stop.time_limit_ms = 1000 * 1000; /* the samples end it */
    job_report_make(&report, &sim->farm, job, sim->now_ns);
    end = end_of(&report.message);
    assert_true(end && fabs(end->core_seconds - 4 * FRAME_S) < 1e-6 * FRAME_S);
    for (uint32_t i = 0; i < job->frames->history.count; i++) {
        job->frames->history.points[i].figures.display_lo /= 100;
        job->frames->history.points[i].figures.display_hi *= 100;
    }
    job_report_make(&report, &sim->farm, job, sim->now_ns);
    assert_null(end_of(&report.message));
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
        cmocka_unit_test_setup_teardown(the_time_left_holds_through_a_jobs_life, sim_set_up, sim_tear_down),
        cmocka_unit_test_setup_teardown(figures_of_large_frames_are_fresh, sim_set_up, sim_tear_down),
        cmocka_unit_test_setup_teardown(forecasts_are_from_now, sim_set_up, sim_tear_down),
        cmocka_unit_test_setup_teardown(a_time_limit_has_an_end, sim_set_up, sim_tear_down),
        cmocka_unit_test(rates_begin_with_the_first),
        cmocka_unit_test(the_curve_has_each_point_once),
    };
    return cmocka_run_group_tests_name("time left", tests, NULL, NULL);
}
