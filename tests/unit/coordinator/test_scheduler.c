/* The scheduler: who gets what, in which order and how much of it. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/system/clock.h"
#include "coordinator/farm/scheduler.h"
#include "tests/support/sim_farm.h"

/* Send all that the worker holds, and forget it. */
static void finish_all(struct sim *sim, struct sim_worker *worker, uint64_t cost_ns)
{
    for (size_t i = worker->unit_count; i-- > 0;) {
        assert_int_equal(sim_send(sim, worker, i, cost_ns), MERGE_PENDING);
        sim_forget(worker, i);
    }
}

static void passes_cover_the_frame_first_and_frames_follow(void **state)
{
    struct sim *sim = *state;
    struct job *job = sim_submit(sim, 64, 64, 28, 1, 3, 0); /* 16 tiles */
    struct sim_worker *worker = sim_connect(sim, 0, 1);
    uint32_t passes = pass_count(28, 0) + pass_count(28, 1), last_pass = 0, last_frame = 1;
    size_t units = 0;

    while (job->state != JOB_STATE_DONE) {
        size_t got = sim_grant(sim, worker, 3);
        assert_true(got > 0 && got <= 3);
        for (size_t i = 0; i < got; i++) {
            const struct sim_unit *u = &worker->units[i];
            if (u->frame != last_frame) {
                assert_int_equal(u->frame, last_frame + 1);
                assert_int_equal(units % (16 * passes), 0); /* the earlier frame is all lent */
                last_frame = u->frame;
                last_pass = 0;
            }
            assert_true(u->name.pass >= last_pass);
            last_pass = u->name.pass;
            units++;
        }
        finish_all(sim, worker, 100);
        sim_commit(sim);
        sim_develop(sim);
    }
    assert_int_equal(units, 3 * 16 * passes);
    assert_int_equal(sim->wrong_frames, 0);
    assert_int_equal(sim->developed, 3);
}

static void the_next_frame_begins_when_nothing_is_left_of_the_first(void **state)
{
    struct sim *sim = *state;
    struct sim_worker *slow, *fast;

    sim_submit(sim, 32, 32, 1, 1, 9, 0); /* 4 units a frame */
    slow = sim_connect(sim, 0, 2);
    fast = sim_connect(sim, 1, 64);
    assert_int_equal(sim_grant(sim, slow, 2), 2);
    sim_grant(sim, fast, 4);
    assert_int_equal(fast->unit_count, 4);
    assert_int_equal(fast->units[0].frame, 1);
    assert_int_equal(fast->units[2].frame, 2);
    /* No more films are opened than the limit allows. */
    sim_grant(sim, fast, 1000);
    assert_int_equal(sim->farm.open_frames, FRAMES_OPEN_PER_JOB);
    assert_int_equal(fast->unit_count, FRAMES_OPEN_PER_JOB * 4 - 2);
}

/* Units of the next frames are lent while the pictures of the last ones are being made. */
static void frames_render_while_others_are_developed(void **state)
{
    struct sim *sim = *state;
    struct sim_worker *worker;

    sim_submit(sim, 32, 32, 1, 1, 9, 0); /* 4 units a frame */
    worker = sim_connect(sim, 0, 1);
    for (uint32_t frame = 1; frame <= FRAMES_OPEN_PER_JOB; frame++) {
        assert_int_equal(sim->developing_count, frame - 1);
        for (size_t units = 0, got; units < 4; units += got) {
            got = sim_grant(sim, worker, 4 - units);
            assert_true(got > 0);
            assert_int_equal(worker->units[0].frame, frame);
            finish_all(sim, worker, 100);
        }
        sim_commit(sim);
    }
    assert_int_equal(sim->developing_count, FRAMES_OPEN_PER_JOB);
    assert_int_equal(sim_grant(sim, worker, 4), 0); /* their films are in memory */
    sim_develop(sim);
    assert_true(sim_grant(sim, worker, 4) > 0);
    assert_int_equal(sim->wrong_frames, 0);
}

static void higher_priority_goes_first(void **state)
{
    struct sim *sim = *state;
    struct job *low = sim_submit(sim, 64, 64, 1, 1, 1, 0);
    struct sim_worker *worker = sim_connect(sim, 0, 4);
    struct job *high;

    sim_grant(sim, worker, 4);
    assert_int_equal(worker->units[0].job, low->id);
    finish_all(sim, worker, 100);
    high = sim_submit(sim, 64, 64, 1, 1, 1, 1);
    sim_grant(sim, worker, 4);
    assert_int_equal(worker->units[0].job, high->id);
    assert_int_equal(low->state, JOB_STATE_RUNNING);
}

static void leases_grow_with_the_measured_speed(void **state)
{
    struct sim *sim = *state;
    struct sim_worker *worker;
    size_t first, second;

    sim_submit(sim, 1024, 1024, 64, 1, 1, 0); /* 4096 tiles */
    worker = sim_connect(sim, 0, 4);
    first = sim_grant(sim, worker, 1000);
    assert_int_equal(first, 8);     /* nothing is measured: one for each thread, and one in reserve */
    finish_all(sim, worker, 10000); /* 10 us a sample: a unit of pass 0 takes 5.12 ms of a thread */
    second = sim_grant(sim, worker, 100000);
    /* Until it holds HELD_WORK_MS of work, in leases of LEASE_WORK_FIRST_MS. */
    assert_in_range(second, HELD_WORK_MS * 4 / 5.12, (HELD_WORK_MS + LEASE_WORK_FIRST_MS) * 4 / 5.12);
    finish_all(sim, worker, 10000);
    sim_disconnect(sim, 0);
    worker = sim_connect(sim, 1, 4);
    sim_grant(sim, worker, 8);
    finish_all(sim, worker, 1000000); /* a slow one: 1 ms a sample */
    assert_in_range(sim_grant(sim, worker, 1000), 4, 12);
}

static void shares_shrink_towards_the_end(void **state)
{
    struct sim *sim = *state;
    struct job *job = sim_submit(sim, 320, 320, 1, 1, 1, 0); /* 400 units */
    struct lease *lease;
    struct sim_worker *a = sim_connect(sim, 0, 2), *b = sim_connect(sim, 1, 2);
    uint32_t last = 1000, leases = 0;

    sim_grant(sim, a, 4);
    finish_all(sim, a, 10); /* fast: time does not limit a lease */
    sim_grant(sim, b, 4);
    finish_all(sim, b, 10);
    a->worker.room = 1000;
    while ((lease = scheduler_grant(&sim->farm, &a->worker, sim->now_ns))) {
        assert_true(lease->unit_count <= last);
        assert_true(lease->unit_count <= job_frame_unleased(job->frames) + lease->unit_count);
        if (leases == 0)
            assert_in_range(lease->unit_count, 90, 100); /* a quarter of what is left: 2 workers */
        last = lease->unit_count;
        leases++;
    }
    assert_int_equal(last, 1);
    assert_true(leases > 8);
}

static void overdue_units_go_to_another_worker(void **state)
{
    struct sim *sim = *state;
    struct job *job = sim_submit(sim, 64, 64, 1, 1, 1, 0);
    struct sim_worker *stopped = sim_connect(sim, 0, 4), *other = sim_connect(sim, 1, 16);
    size_t got;

    assert_int_equal(sim_grant(sim, stopped, 4), 4);
    assert_int_equal(sim_grant(sim, other, 12), 12);
    sim->now_ns += 50 * NS_PER_MS;
    finish_all(sim, other, 1000);
    assert_int_equal(sim_grant(sim, other, 100), 0); /* not overdue yet */
    sim->now_ns += 500 * NS_PER_MS;
    assert_int_equal(sim_grant(sim, other, 100), 0);
    sim->now_ns += 600 * NS_PER_MS;
    got = sim_grant(sim, other, 100);
    assert_int_equal(got, 4);
    assert_int_equal(sim_grant(sim, other, 100), 0); /* it holds them itself now */
    finish_all(sim, other, 1000);
    assert_int_equal(stopped->unit_count, 0); /* its lease was revoked */
    sim_commit(sim);
    sim_develop(sim);
    assert_int_equal(job->state, JOB_STATE_DONE);
    assert_int_equal(sim->wrong_frames, 0);
}

static void a_stopped_worker_loses_its_lease(void **state)
{
    struct sim *sim = *state;
    struct sim_worker *stopped = sim_connect(sim, 0, 4), *other;

    sim_submit(sim, 64, 64, 1, 1, 1, 0);
    assert_int_equal(sim_grant(sim, stopped, 4), 4);
    sim->now_ns += 9 * NS_PER_SECOND;
    farm_tick(&sim->farm, sim->now_ns);
    assert_int_equal(sim->revokes, 0);
    sim->now_ns += 2 * NS_PER_SECOND;
    farm_tick(&sim->farm, sim->now_ns);
    assert_int_equal(sim->revokes, 1);
    assert_int_equal(stopped->unit_count, 0);
    other = sim_connect(sim, 1, 16);
    assert_int_equal(sim_grant(sim, other, 16), 16);
}

static void unfit_workers_are_told_and_get_nothing(void **state)
{
    struct sim *sim = *state;
    struct job *job = sim_submit(sim, 64, 64, 1, 1, 1, 0);
    struct sim_worker *first = sim_connect(sim, 0, 1), *old_cpu = sim_connect(sim, 1, 1),
                      *other_tracer = sim_connect(sim, 2, 1);
    char why[256];

    old_cpu->worker.isa_mask = 1; /* sse2 only; the job is pinned to avx2 */
    snprintf(other_tracer->worker.ray_tracer, sizeof other_tracer->worker.ray_tracer, "tracer 2");
    assert_int_equal(sim_grant(sim, old_cpu, 1), 0);
    assert_int_equal(sim->notices, 1);
    assert_non_null(strstr(sim->notice, "avx2"));
    assert_int_equal(sim_grant(sim, first, 1), 1);
    assert_string_equal(job->ray_tracer, "tracer 1");
    assert_int_equal(sim_grant(sim, other_tracer, 1), 0);
    assert_int_equal(sim->notices, 2);
    assert_int_equal(sim->notice_session, other_tracer->worker.held.session);
    assert_non_null(strstr(sim->notice, "tracer 2"));
    assert_true(other_tracer->worker.note[0] != 0);
    sim_grant(sim, other_tracer, 1); /* told once */
    assert_int_equal(sim->notices, 2);
    assert_false(farm_can_serve(job, &other_tracer->worker, why, sizeof why));
    /* A job that no one has begun pins the ray tracer of the worker that begins it. */
    sim_submit(sim, 64, 64, 1, 1, 1, 0);
    assert_int_equal(sim_grant(sim, other_tracer, 1), 1);
    assert_int_equal(other_tracer->worker.note[0], 0);
}

static void a_job_that_nobody_can_render_fails(void **state)
{
    struct sim *sim = *state;
    struct job *job = sim_submit(sim, 64, 64, 1, 1, 1, 0), *second;
    struct sim_worker *workers[5];

    for (unsigned i = 0; i < 5; i++)
        workers[i] = sim_connect(sim, i, 2);
    for (unsigned i = 0; i < 3; i++) {
        assert_int_equal(job->state, i == 0 ? JOB_STATE_QUEUED : JOB_STATE_RUNNING);
        assert_true(sim_grant(sim, workers[i], 2) > 0);
        farm_job_broken(&sim->farm, job, &workers[i]->worker, STATUS_ERR_INPUT, "the mesh is damaged", sim->now_ns);
        if (i < 2) {
            assert_int_equal(sim_grant(sim, workers[i], 2), 0);
            workers[i]->unit_count = 0;
        }
    }
    assert_int_equal(job->state, JOB_STATE_FAILED);
    assert_non_null(strstr(job->state_text, "the mesh is damaged"));
    assert_int_equal(sim->farm.leases.count, 0);
    /* The only worker that there is cannot: no need to wait for more. */
    for (unsigned i = 1; i < 5; i++)
        sim_disconnect(sim, i);
    second = sim_submit(sim, 64, 64, 1, 1, 1, 0);
    assert_true(sim_grant(sim, workers[0], 2) > 0);
    farm_job_broken(&sim->farm, second, &workers[0]->worker, STATUS_ERR_LIMIT, "too large", sim->now_ns);
    assert_int_equal(second->state, JOB_STATE_FAILED);
}

static void a_shortage_fails_no_job(void **state)
{
    struct sim *sim = *state;
    struct job *job = sim_submit(sim, 64, 64, 1, 1, 1, 0);
    struct sim_worker *only = sim_connect(sim, 0, 2);
    uint64_t waited_ns = 0, wait_ns = 0;

    /* It is asked again and again, less and less often. */
    for (int i = 0; i < 12; i++) {
        assert_true(sim_grant(sim, only, 2) > 0);
        farm_job_broken(&sim->farm, job, &only->worker, STATUS_ERR_NO_MEMORY, "out of memory", sim->now_ns);
        only->unit_count = 0;
        assert_int_equal(job->state, JOB_STATE_RUNNING);
        assert_int_equal(sim_grant(sim, only, 2), 0);
        for (wait_ns = 0; refusals_bar(&job->refusals, only->worker.machine); wait_ns += 50 * NS_PER_MS) {
            assert_true(wait_ns <= SHORTAGE_LAST_MS * NS_PER_MS);
            sim->now_ns += 50 * NS_PER_MS;
            farm_tick(&sim->farm, sim->now_ns);
        }
        assert_true(wait_ns >= waited_ns);
        waited_ns = wait_ns;
    }
    assert_true(waited_ns >= SHORTAGE_LAST_MS * NS_PER_MS);
    /* A result ends the shortage. */
    assert_true(sim_grant(sim, only, 2) > 0);
    sim_send(sim, only, 0, 100);
    assert_null(refusals_find(&job->refusals, only->worker.machine));
}

static void a_broken_job_counts_machines_that_hold_it(void **state)
{
    struct sim *sim = *state;
    struct job *job = sim_submit(sim, 64, 64, 1, 1, 1, 0);
    struct sim_worker *honest = sim_connect(sim, 0, 1), *liar = NULL;

    /* Without a lease of the job it is idle talk. */
    liar = sim_connect(sim, 1, 1);
    farm_job_broken(&sim->farm, job, &liar->worker, STATUS_ERR_INPUT, "no", sim->now_ns);
    assert_int_equal(job->refusals.damaged, 0);
    /* One machine counts once, however often its worker starts again, and gets no more of the job. */
    for (int i = 0; i < 4; i++) {
        sim_disconnect(sim, 1);
        liar = sim_connect(sim, 1, 1);
        assert_int_equal(sim_grant(sim, liar, 1), i == 0);
        farm_job_broken(&sim->farm, job, &liar->worker, STATUS_ERR_INPUT, "no", sim->now_ns);
        liar->unit_count = 0;
    }
    assert_int_equal(job->refusals.damaged, 1);
    /* With a result, machines that cannot are passed over. */
    assert_int_equal(sim_grant(sim, honest, 2), 2);
    sim_send(sim, honest, 0, 100);
    for (unsigned i = 2; i < 2 + JOB_BROKEN_MAX; i++) {
        liar = sim_connect(sim, i, 1);
        assert_true(sim_grant(sim, liar, 1) > 0);
        farm_job_broken(&sim->farm, job, &liar->worker, STATUS_ERR_INPUT, "no", sim->now_ns);
    }
    assert_int_equal(job->refusals.damaged, 1 + JOB_BROKEN_MAX);
    assert_int_equal(job->state, JOB_STATE_RUNNING);
    assert_true(sim_grant(sim, honest, 2) > 0);
}

/* A worker that claims this many threads and delivers nothing. */
static struct sim_worker *connect_claimant(struct sim *sim, unsigned index)
{
    struct sim_worker *worker = sim_connect(sim, index, 4096);

    credit_init(&worker->worker.credit, 4096);
    return worker;
}

static void claims_without_results_take_little(void **state)
{
    struct sim *sim = *state;
    struct sim_worker *claimant = connect_claimant(sim, 0), *honest = sim_connect(sim, 1, 2);
    uint64_t got, before = 2 * CREDIT_THREADS_FIRST;

    sim_submit(sim, 320, 320, 1, 1, 1, 0); /* 400 units */
    assert_int_equal(sim_grant(sim, claimant, 10000), before);
    /* The honest one's shares are as if it were alone: half of what is left. */
    sim_grant(sim, honest, 4);
    finish_all(sim, honest, 10);
    honest->worker.room = 1000;
    assert_in_range(scheduler_grant(&sim->farm, &honest->worker, sim->now_ns)->unit_count, 170, 182);
    /* Each lapse halves what it gets. */
    for (int i = 0; i < 5; i++) {
        sim->now_ns += 11 * NS_PER_SECOND;
        farm_tick(&sim->farm, sim->now_ns);
        got = sim_grant(sim, claimant, 10000);
        assert_int_equal(got, before > 2 ? before / 2 : 2); /* one thread's, in the end */
        before = got;
    }
}

static void claimants_cannot_keep_a_unit_from_others(void **state)
{
    struct sim *sim = *state;
    struct job *job = sim_submit(sim, 32, 32, 1, 1, 1, 0); /* 4 units */
    struct sim_worker *claimants[4], *honest;

    for (unsigned i = 0; i < 4; i++)
        claimants[i] = connect_claimant(sim, i);
    for (unsigned i = 0; i < 4; i++) { /* one after another takes all of it */
        assert_int_equal(sim_grant(sim, claimants[i], 10000), 4);
        for (unsigned j = 0; j <= i; j++) /* those that hold overdue units get no others */
            assert_int_equal(sim_grant(sim, claimants[j], 10000), 0);
        sim->now_ns += OVERDUE_UNKNOWN_MS * NS_PER_MS;
        assert_in_range(job->frames->oldest->holder_count, 1, UNIT_HOLDERS_UNPROVEN_MAX);
    }
    honest = sim_connect(sim, 4, 2); /* it has shown nothing yet, either */
    for (unsigned i = 0; i < 4; i++) /* those that lost their places get them back by results only */
        assert_int_equal(sim_grant(sim, claimants[i], 10000), 0);
    assert_int_equal(sim_grant(sim, honest, 2), 2);
    finish_all(sim, honest, 100);
    sim->now_ns += OVERDUE_UNKNOWN_MS * NS_PER_MS;
    assert_int_equal(sim_grant(sim, honest, 2), 2);
    finish_all(sim, honest, 100);
    sim_commit(sim);
    sim_develop(sim);
    assert_int_equal(job->state, JOB_STATE_DONE);
}

static void the_last_place_is_for_a_proven_worker(void **state)
{
    struct sim *sim = *state;
    struct job *job = sim_submit(sim, 32, 32, 1, 1, 1, 0); /* 4 units */
    struct sim_worker *a = sim_connect(sim, 0, 3), *b = sim_connect(sim, 1, 1), *c = sim_connect(sim, 2, 3),
                      *proven = sim_connect(sim, 3, 3);

    assert_int_equal(sim_grant(sim, b, 1), 1);
    finish_all(sim, b, 100);
    assert_int_equal(sim_grant(sim, a, 3), 3);
    sim->now_ns += OVERDUE_UNKNOWN_MS * NS_PER_MS;
    assert_int_equal(sim_grant(sim, c, 3), 3);
    assert_int_equal(job->frames->oldest->holder_count, 2);
    sim->now_ns += OVERDUE_UNKNOWN_MS * NS_PER_MS;
    proven->worker.credit.delivered_ns = sim->now_ns - NS_PER_SECOND;
    assert_int_equal(sim_grant(sim, proven, 3), 3);
    assert_int_equal(job->frames->oldest->holder_count, UNIT_HOLDERS_MAX); /* nobody lost its place */
    assert_int_equal(a->worker.held.units, 3);
}

static void cancelling_takes_the_work_back(void **state)
{
    struct sim *sim = *state;
    struct job *job = sim_submit(sim, 64, 64, 1, 1, 1, 0);
    struct sim_worker *worker = sim_connect(sim, 0, 4);

    sim_grant(sim, worker, 4);
    sim_send(sim, worker, 0, 100);
    farm_cancel(&sim->farm, job, 1, sim->now_ns);
    assert_int_equal(job->state, JOB_STATE_CANCELLED);
    assert_int_equal(sim->revokes, 1);
    assert_int_equal(worker->unit_count, 0);
    assert_int_equal(worker->worker.held.units, 0);
    assert_null(merge_commit_begin(&sim->farm, sim->now_ns));
    assert_int_equal(sim_grant(sim, worker, 4), 0);
}

/* A tile may not run away from its first passes: early results wait in memory. */
/* Cores that the job's units can keep busy. */
static uint32_t busy_cores(const struct sim *sim, const struct job *job)
{
    uint32_t cores = 0;

    for (unsigned i = 0; i < 4; i++) {
        const struct sim_worker *worker = &sim->workers[i];
        uint32_t units = 0;
        for (size_t k = 0; k < worker->unit_count; k++)
            units += worker->units[k].job == job->id;
        cores += units < worker->worker.threads ? units : worker->worker.threads;
    }
    return cores;
}

/* Workers that fit hold a reserve, one that is larger than what is left holds no unit more. The others are for other
 * jobs. */
static void a_job_has_no_more_cores_than_it_may(void **state)
{
    static const uint32_t threads[] = {2, 16, 2, 2};
    struct sim *sim = *state;
    struct job *few = sim_submit(sim, 256, 256, 8, 1, 2, 1), *other = sim_submit(sim, 128, 128, 8, 1, 1, 0);
    uint32_t most = 0, others = 0, reserve = 0;

    few->needs.max_cores = 5;
    for (unsigned i = 0; i < 4; i++)
        sim_connect(sim, i, threads[i]);
    for (int step = 0; step < 100000 && few->state != JOB_STATE_DONE; step++) {
        unsigned w = sim_random(sim, 4);
        struct sim_worker *worker = &sim->workers[w];

        if (worker->unit_count > 0 && sim_random(sim, 3) > 0) {
            size_t i = sim_random(sim, (uint32_t)worker->unit_count);
            sim->now_ns += NS_PER_MS;
            assert_int_equal(sim_send(sim, worker, i, 100), MERGE_PENDING);
            sim_forget(worker, i);
        } else if (step % 997 == 0) {
            sim_die(sim, w);
            worker->unit_count = 0;
            sim_connect(sim, w, threads[w]);
        } else {
            sim_grant(sim, worker, 32);
        }
        assert_true(busy_cores(sim, few) <= 5);
        most = busy_cores(sim, few) > most ? busy_cores(sim, few) : most;
        others |= busy_cores(sim, other) > 0 && busy_cores(sim, few) > 0;
        reserve |= worker->unit_count > 0 && worker->units[0].job == few->id && worker->unit_count > threads[w];
        sim_commit(sim);
        sim_develop(sim);
    }
    assert_int_equal(few->state, JOB_STATE_DONE);
    assert_int_equal(most, 5);
    assert_true(others && reserve);
    assert_int_equal(sim->wrong_frames, 0);
}

static void passes_ahead_are_limited(void **state)
{
    struct sim *sim = *state;
    struct sim_worker *worker = sim_connect(sim, 0, 1000);

    sim_submit(sim, 16, 16, 1000000, 1, 1, 0); /* one tile, 143 passes of either group */
    assert_int_equal(sim_grant(sim, worker, 4000), GROUPS * FRAME_PASSES_AHEAD);
    finish_all(sim, worker, 100);
    assert_int_equal(sim_grant(sim, worker, 10), 10);
    assert_int_equal(worker->units[0].name.pass, FRAME_PASSES_AHEAD);
}

#define SIM_TEST(name) cmocka_unit_test_setup_teardown(name, sim_set_up, sim_tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        SIM_TEST(passes_cover_the_frame_first_and_frames_follow),
        SIM_TEST(the_next_frame_begins_when_nothing_is_left_of_the_first),
        SIM_TEST(frames_render_while_others_are_developed),
        SIM_TEST(higher_priority_goes_first),
        SIM_TEST(leases_grow_with_the_measured_speed),
        SIM_TEST(shares_shrink_towards_the_end),
        SIM_TEST(overdue_units_go_to_another_worker),
        SIM_TEST(a_stopped_worker_loses_its_lease),
        SIM_TEST(unfit_workers_are_told_and_get_nothing),
        SIM_TEST(a_job_that_nobody_can_render_fails),
        SIM_TEST(a_broken_job_counts_machines_that_hold_it),
        SIM_TEST(a_shortage_fails_no_job),
        SIM_TEST(claims_without_results_take_little),
        SIM_TEST(claimants_cannot_keep_a_unit_from_others),
        SIM_TEST(the_last_place_is_for_a_proven_worker),
        SIM_TEST(cancelling_takes_the_work_back),
        SIM_TEST(a_job_has_no_more_cores_than_it_may),
        SIM_TEST(passes_ahead_are_limited),
    };
    return cmocka_run_group_tests_name("scheduler", tests, NULL, NULL);
}
