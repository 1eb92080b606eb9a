/* Every two things that end a frame, in both orders: the first ends it, where it would alone, with the picture that it would
 * make alone; what may not end a frame before each tile has samples does not, whatever comes with it; and over a restart. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <stdio.h>

#include "common/system/clock.h"
#include "coordinator/farm/closing.h"
#include "coordinator/farm/merge.h"
#include "tests/support/sim_states.h"
#include "tests/support/steering.h"

/* 4 tiles, 2 groups, 4 passes; whole passes are done after 8, 16, 24 and 32 units. */
enum { SIDE = 32, SPP = 32, UNITS = 32, PASS_UNITS = 8, NEVER = 0 };
enum { UNIT_NS = 10000000, SAMPLE_NS = 20000, SAMPLE_RAYS = 3 };

static const struct ender {
    enum frame_end end;
    const char *name;
} enders[] = {{FRAME_END_TIME, "time"}, {FRAME_END_CORES, "cores"},   {FRAME_END_RAYS, "rays"},
              {FRAME_END_CAP, "cap"},   {FRAME_END_FINISH, "finish"}, {FRAME_END_CANCEL, "cancel"}};
enum { ENDERS = sizeof enders / sizeof *enders };

/* After which unit each ends the frame, by enum frame_end; NEVER: it does not. */
struct plan {
    uint32_t after[FRAME_END_COUNT];
    uint32_t restart_after;
};
struct outcome {
    enum frame_end end; /* CAP: nothing is cut */
    uint32_t units;
    struct film_coverage coverage;
    enum job_state state;
    int is_early; /* so the job says: it was finished before it had all */
};

static uint64_t samples_after[UNITS + 1]; /* of the frame, as units come */
static uint32_t covered_after;

static void send(struct sim *sim, struct sim_worker *worker, size_t i)
{
    static float sums[TILE_FLOATS_MAX];
    struct delivery result = sim_result(sim, &worker->units[i], sums);
    enum merge_outcome outcome;
    struct error err = {0};

    result.unit.work.rays = result.unit.work.samples * SAMPLE_RAYS;
    result.stats.cpu_ns = result.unit.work.samples * SAMPLE_NS;
    if (merge_result(&sim->farm, &worker->worker, &result, sim->now_ns, &outcome, NULL, &err) != STATUS_OK)
        fail_msg("%s", err.text);
    sim_forget(worker, i);
}

/* The worker's earliest unit: passes come in order, of either group. */
static size_t earliest(const struct sim_worker *worker)
{
    size_t best = 0;

    for (size_t i = 1; i < worker->unit_count; i++) {
        const struct unit_name a = worker->units[i].name, b = worker->units[best].name;
        const uint32_t left = (a.pass * GROUPS + a.group) * 4 + a.tile, right = (b.pass * GROUPS + b.group) * 4 + b.tile;
        if (left < right)
            best = i;
    }
    return best;
}

static void tick(struct sim *sim)
{
    sim_freeze(sim);
    sim_commit(sim);
    farm_tick(&sim->farm, sim->now_ns);
    sim_develop(sim);
    farm_tick(&sim->farm, sim->now_ns);
}

static struct job *submit(struct sim *sim, const struct plan *plan)
{
    const uint32_t cap = plan->after[FRAME_END_CAP], *after = plan->after;
    struct job *job = sim_job(SIDE, SIDE, cap ? 4u << (cap / PASS_UNITS - 1) : SPP, 1, 1, 0);
    struct error err = {0};

    assert_int_equal(tonemap_settings_init(&job->output.tonemap, "linear", NULL), STATUS_OK);
    job->stop.time_limit_ms = after[FRAME_END_TIME] * (UNIT_NS / 1000000);
    job->stop.core_limit_ms = samples_after[after[FRAME_END_CORES]] * SAMPLE_NS / 1000000;
    job->stop.max_rays = samples_after[after[FRAME_END_RAYS]] * SAMPLE_RAYS;
    if (farm_submit(&sim->farm, job, &err) != STATUS_OK)
        fail_msg("%s", err.text);
    return job;
}

static struct outcome run(const struct plan *plan)
{
    struct outcome out = {0};
    struct sim_stored *f;
    struct sim_worker *worker;
    struct job *job;
    void *state;

    sim_stored_set_up(&state);
    f = state;
    job = submit(f->sim, plan);
    worker = sim_stored_connect(f, 16);
    while (!job_state_ended(job->state) && out.units < UNITS) {
        if (worker->unit_count == 0 && sim_grant(f->sim, worker, 64) == 0)
            break;
        f->sim->now_ns += UNIT_NS;
        send(f->sim, worker, earliest(worker));
        out.units++;
        if (plan->after[FRAME_END_NONE] == 0 && !covered_after && film_covered(job->frames->film))
            covered_after = out.units;
        if (!plan->after[FRAME_END_NONE])
            samples_after[out.units] = film_samples(job->frames->film);
        if (out.units == plan->after[FRAME_END_FINISH])
            assert_int_equal(do_verb(&f->sim->farm, job, VERB_FINISH, "ana@desk", f->sim->now_ns, NULL), STATUS_OK);
        if (out.units == plan->after[FRAME_END_CANCEL])
            farm_cancel(&f->sim->farm, job, 0, f->sim->now_ns);
        tick(f->sim);
        if (out.units == plan->restart_after && !job_state_ended(job->state)) {
            sim_stored_restart(f);
            job = sim_stored_job(f);
            worker->unit_count = 0;
            worker = sim_stored_connect(f, 16);
        }
    }
    for (int i = 0; i < 3; i++)
        tick(f->sim);
    out.state = job->state;
    out.is_early = (job->marks & JOB_MARK_EARLY) != 0;
    out.end = job->cut_count ? job->cuts[0].end : FRAME_END_CAP;
    out.coverage = job->cut_count ? job->cuts[0].coverage : (struct film_coverage){.samples = job_frame_samples(job)};
    sim_stored_tear_down(&state);
    return out;
}

/* ---- pairs ------------------------------------------------------------------------------------- */

static void expect_end(const struct outcome *is, enum frame_end end, uint32_t units, const char *what)
{
    const uint64_t samples = samples_after[units];

    if (is->end != end || is->units != units || is->coverage.samples != samples ||
        (end != FRAME_END_CANCEL && is->coverage.tiles_empty > 0) || is->is_early != (end == FRAME_END_FINISH) ||
        is->state != (end == FRAME_END_CANCEL ? JOB_STATE_CANCELLED : JOB_STATE_DONE))
        fail_msg("%s: %s after %u units, %llu samples, %u tiles empty, state %d, early %d; expected: %s after %u units, %llu samples", what,
                 frame_end_text(is->end), is->units, (unsigned long long)is->coverage.samples, is->coverage.tiles_empty,
                 (int)is->state, is->is_early, frame_end_text(end), units, (unsigned long long)samples);
}

static void measure(void)
{
    const struct plan nothing = {{0}, 0};
    struct outcome whole = run(&nothing);

    assert_int_equal(whole.units, UNITS);
    assert_int_equal(whole.end, FRAME_END_CAP);
    assert_in_range(covered_after, 2, PASS_UNITS);
}

/* A plan with one or two of them; 0: the cap cannot be there. `b` may be NULL. */
static int plan_pair(struct plan *plan, const struct ender *a, uint32_t first, const struct ender *b, uint32_t second)
{
    *plan = (struct plan){{0}, 0};
    plan->after[FRAME_END_NONE] = 1;
    if ((a->end == FRAME_END_CAP && first % PASS_UNITS) || (b && b->end == FRAME_END_CAP && second % PASS_UNITS))
        return 0;
    plan->after[a->end] = first;
    if (b)
        plan->after[b->end] = second;
    return 1;
}

static void first_of_two(uint32_t first, uint32_t second, uint32_t restart_after)
{
    for (size_t a = 0; a < ENDERS; a++)
        for (size_t b = 0; b < ENDERS; b++) {
            char what[96];
            struct plan plan;
            struct outcome is;
            if (a == b || !plan_pair(&plan, &enders[a], first, &enders[b], second))
                continue;
            plan.restart_after = restart_after;
            snprintf(what, sizeof what, "%s after %u, %s after %u, restart after %u", enders[a].name, first,
                     enders[b].name, second, restart_after);
            is = run(&plan);
            expect_end(&is, enders[a].end, first, what);
        }
}

static void each_alone(void **state)
{
    (void)state;
    for (size_t a = 0; a < ENDERS; a++) {
        struct plan plan;
        struct outcome is;
        assert_true(plan_pair(&plan, &enders[a], 16, NULL, 0));
        is = run(&plan);
        expect_end(&is, enders[a].end, 16, enders[a].name);
    }
}

static void the_first_ends_it(void **state)
{
    (void)state;
    first_of_two(16, 24, NEVER);
    first_of_two(15, 16, NEVER);
    first_of_two(16, 17, NEVER);
    first_of_two(16, 24, 11);
}

/* Before each tile has samples nothing but a cancel ends a frame. */
static void not_before_each_tile_has_samples(void **state)
{
    (void)state;
    for (size_t a = 0; a < ENDERS; a++)
        for (size_t b = 0; b < ENDERS; b++) {
            const int cancels = enders[b].end == FRAME_END_CANCEL;
            char what[96];
            struct plan plan;
            struct outcome is;
            if (a == b || enders[a].end == FRAME_END_CANCEL || !plan_pair(&plan, &enders[a], 1, &enders[b], cancels ? 2 : 1))
                continue;
            snprintf(what, sizeof what, "%s and %s too soon", enders[a].name, enders[b].name);
            is = run(&plan);
            expect_end(&is, is.end == enders[a].end || cancels ? (cancels ? FRAME_END_CANCEL : is.end) : enders[b].end,
                       cancels ? 2 : covered_after, what);
        }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(each_alone),
        cmocka_unit_test(the_first_ends_it),
        cmocka_unit_test(not_before_each_tile_has_samples),
    };

    measure();
    return cmocka_run_group_tests(tests, NULL, NULL);
}
