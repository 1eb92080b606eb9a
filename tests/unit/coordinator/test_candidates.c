/* The lists of candidates, and the threads of workers that deliver, against plain walks. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <stdio.h>
#include <string.h>

#include "common/system/clock.h"
#include "coordinator/farm/roster.h"
#include "coordinator/farm/scheduler.h"
#include "tests/support/sim_farm.h"

/* The job's place in the order of service: ready ones as the order says, then the others of queue->active. */
static size_t rank_of(const struct queue *queue, size_t i)
{
    const struct job_place *place = &queue->active[i]->place;

    return place->ready ? place->before : queue->active_count + i;
}

/* The next job of the lists after that rank (SIZE_MAX: the first), by a walk over all active jobs. */
static struct job *walk_next(const struct queue *queue, unsigned lists, size_t *rank)
{
    struct job *next = NULL;
    size_t best = SIZE_MAX;

    for (size_t i = 0; i < queue->active_count; i++) {
        size_t mine = rank_of(queue, i);
        int belongs = 0;
        for (unsigned list = 0; list < CANDIDATES_LISTS; list++)
            belongs |= (lists >> list & 1) && candidates_belongs(queue->active[i], list);
        if (belongs && mine < best && (*rank == SIZE_MAX || mine > *rank)) {
            next = queue->active[i];
            best = mine;
        }
    }
    *rank = best;
    return next;
}

static void lists_are_right(const struct queue *queue)
{
    const unsigned sets[] = {
        CANDIDATES_BIT(CANDIDATES_WORKING), CANDIDATES_BIT(CANDIDATES_CLOSING),
        CANDIDATES_BIT(CANDIDATES_TROUBLED), CANDIDATES_ALL_LANES,
        CANDIDATES_BIT(CANDIDATES_WORKING) | CANDIDATES_ALL_LANES,
        CANDIDATES_BIT(CANDIDATES_LANES + 2) | CANDIDATES_BIT(CANDIDATES_WORKING),
    };

    for (size_t i = 0; i < sizeof sets / sizeof *sets; i++) {
        const struct job *job = NULL;
        size_t rank = SIZE_MAX;
        do {
            job = queue_next(queue, sets[i], job);
            assert_ptr_equal(job, walk_next(queue, sets[i], &rank));
        } while (job);
    }
}

/* No job outside its lane has a frame that could be begun. */
static void lanes_are_complete(const struct queue *queue)
{
    for (size_t i = 0; i < queue->active_count; i++) {
        const struct job *job = queue->active[i];
        if (!job->all_begun)
            continue;
        for (uint32_t n = job->first_frame; n <= job->last_frame; n++)
            assert_true(job_frame_is_done(job, n) || job_frame_is_resting(job, n) || farm_frame_find(job, n));
    }
}

static void threads_are_right(struct sim *sim)
{
    for (unsigned i = 0; i < SIM_WORKERS_MAX; i++) {
        const struct farm_worker *worker = &sim->workers[i].worker;
        uint64_t threads = 0;
        if (!sim->workers[i].connected)
            continue;
        for (uint32_t k = 0; k < sim->farm.worker_count; k++) {
            const struct farm_worker *other = sim->farm.workers[k];
            assert_int_equal(other->place.index, k);
            if (other == worker || (worker_takes_work(other) && credit_is_proven(&other->credit, sim->now_ns)))
                threads += other->credit.threads;
        }
        assert_int_equal(workforce_threads(&sim->farm, worker, sim->now_ns), threads);
    }
}

static void holders_are_right(const struct sim *sim)
{
    for (unsigned i = 0; i < SIM_WORKERS_MAX; i++) {
        const struct lease_holder *holder = &sim->workers[i].worker.held;
        const struct lease *mine = sim->workers[i].connected ? holder->oldest : NULL;
        for (const struct lease *lease = sim->farm.leases.oldest; lease; lease = lease->newer) {
            if (lease->holder != holder)
                continue;
            assert_ptr_equal(lease, mine);
            mine = mine->holder_newer;
        }
        assert_null(mine);
    }
}

/* The lease that lapsed first by the list, or none. */
static void lapses_are_right(struct sim *sim)
{
    const struct lease *expected = sim->farm.leases.oldest;

    while (expected && expected->deadline_ns > sim->now_ns)
        expected = expected->newer;
    assert_ptr_equal(lease_lapsed(&sim->farm.leases, sim->now_ns), expected);
}

static void submit_some(struct sim *sim)
{
    struct job *job = sim_submit(sim, 16 + sim_random(sim, 3) * 16, 32, 1 + sim_random(sim, 6), 1,
                                 1 + sim_random(sim, 5), (int32_t)sim_random(sim, 3) - 1);
    assert_non_null(job);
}

static void change_some(struct sim *sim)
{
    struct queue *queue = &sim->farm.queue;
    struct job *job;

    if (queue->active_count == 0)
        return;
    job = queue->active[sim_random(sim, (uint32_t)queue->active_count)];
    switch (sim_random(sim, 6)) {
    case 0: queue_set_priority(queue, job, (int32_t)sim_random(sim, 3) - 1); break;
    case 1:
        if (job->state == JOB_STATE_QUEUED || job->state == JOB_STATE_RUNNING) {
            farm_job_revoke(&sim->farm, job, "paused");
            farm_job_change(&sim->farm, job, JOB_STATE_PAUSED, NULL, sim->now_ns);
        }
        break;
    case 2:
    case 3:
        if (job->state == JOB_STATE_PAUSED)
            farm_job_change(&sim->farm, job, JOB_STATE_QUEUED, NULL, sim->now_ns);
        break;
    case 4: farm_cancel(&sim->farm, job, (int)sim_random(sim, 2), sim->now_ns); break;
    default:
        if (job->state == JOB_STATE_RUNNING)
            farm_job_change(&sim->farm, job, JOB_STATE_FINISHING, NULL, sim->now_ns);
        break;
    }
}

static void work_some(struct sim *sim)
{
    unsigned i = sim_random(sim, SIM_WORKERS_MAX);
    struct sim_worker *worker = &sim->workers[i];

    if (!worker->connected) {
        sim_connect(sim, i, 1 + sim_random(sim, 4));
        if (sim_random(sim, 2)) /* it pins jobs to another ray tracer */
            snprintf(worker->worker.ray_tracer, sizeof worker->worker.ray_tracer, "another");
        return;
    }
    switch (sim_random(sim, 16)) {
    case 0: sim_disconnect(sim, i); break;
    case 1:
    case 2:
    case 3: sim_grant(sim, worker, 1 + sim_random(sim, 12)); break;
    default:
        if (worker->unit_count > 0) {
            size_t unit = sim_random(sim, (uint32_t)worker->unit_count);
            (void)sim_send(sim, worker, unit, 100);
            sim_forget(worker, unit);
        }
        break;
    }
}

static void lists_hold_what_a_walk_finds(void **state)
{
    (void)state;
    for (uint64_t seed = 1; seed <= 12; seed++) {
        struct sim *sim = sim_new(NULL, seed);
        for (int step = 0; step < 1500; step++) {
            switch (sim_random(sim, 10)) {
            case 0:
                if (sim->farm.queue.active_count < 24)
                    submit_some(sim);
                break;
            case 1: change_some(sim); break;
            case 2:
                sim_commit(sim);
                sim_develop(sim);
                break;
            case 3:
                sim->now_ns += (uint64_t)sim_random(sim, 20000) * NS_PER_MS;
                farm_tick(&sim->farm, sim->now_ns);
                break;
            default: work_some(sim); break;
            }
            lists_are_right(&sim->farm.queue);
            lanes_are_complete(&sim->farm.queue);
            threads_are_right(sim);
            holders_are_right(sim);
            lapses_are_right(sim);
        }
        sim_free(sim);
    }
}

/* Far more units than tiles are lent, and each is found. */
static void many_units_are_found(void **state)
{
    struct sim *sim = *state;
    struct lease lease = {0};
    struct job_frame *frame;
    struct unit_name name;

    sim_submit(sim, 32, 32, 1 << 20, 1, 1, 0); /* 4 tiles */
    frame = farm_frame_open(&sim->farm, sim->farm.queue.active[0], 1, sim->now_ns);
    assert_non_null(frame);
    for (int lent = 1; lent >= 0; lent--) {
        for (uint32_t i = 0; i < 4 * GROUPS * 100; i++) {
            name = (struct unit_name){i % 4, i / 4 % GROUPS, i / 4 / GROUPS};
            assert_int_equal(job_frame_unit_find(frame, name) != NULL, !lent);
            if (lent)
                assert_int_equal(job_frame_unit_lend(frame, name, &lease, sim->now_ns), STATUS_OK);
            else
                job_frame_unit_settle(frame, job_frame_unit_find(frame, name));
        }
    }
    assert_int_equal(frame->outstanding_count, 0);
    assert_true(frame->bucket_mask >= 4 * GROUPS * 100 / 4);
}

/* A long queue does not hide work: jobs that the worker cannot serve stand before the one it can, and it
 * is told of one of them, not of each. */
static void a_lane_is_skipped_and_told_once(void **state)
{
    struct sim *sim = *state;
    struct sim_worker *worker;
    struct job *mine;

    for (int i = 0; i < 200; i++) {
        struct job *other = sim_job(32, 32, 1, 1, 1, 1);
        struct error err = {0};
        other->settings.isa = ISA_AVX512;
        assert_int_equal(farm_submit(&sim->farm, other, &err), STATUS_OK);
    }
    mine = sim_submit(sim, 32, 32, 1, 1, 1, 0);
    worker = sim_connect(sim, 0, 4);
    worker->worker.isa_mask = 1u << ISA_SSE2 | 1u << ISA_AVX2;
    assert_true(sim_grant(sim, worker, 8) > 0);
    assert_int_equal(worker->units[0].job, mine->id);
    sim_grant(sim, worker, 8);
    sim_grant(sim, worker, 8);
    assert_int_equal(sim->notices, 1);
}

/* What made a walk useless is forgotten when something changes. */
static void a_resumed_job_ends_a_barren_time(void **state)
{
    struct sim *sim = *state;
    struct sim_worker *a = sim_connect(sim, 0, 64), *b = sim_connect(sim, 1, 64);
    struct job *paused = sim_submit(sim, 16, 16, 1, 1, 1, 0);

    assert_int_equal(sim_grant(sim, a, 1), 1);
    farm_job_revoke(&sim->farm, paused, "paused");
    farm_job_change(&sim->farm, paused, JOB_STATE_PAUSED, NULL, sim->now_ns);
    farm_tick(&sim->farm, sim->now_ns);
    assert_null(paused->frames);
    a->unit_count = 0;
    sim_submit(sim, 16, 16, 1, 1, 9, 0);
    /* As many frames as one job may have open: it waits in its lane with the others. */
    assert_int_equal(sim_grant(sim, a, 8), FRAMES_OPEN_PER_JOB);
    assert_int_equal(sim_grant(sim, b, 8), 0);
    assert_int_not_equal(sim->farm.barren.lanes, 0);
    assert_true(b->worker.place.is_hungry);
    assert_int_equal(sim->farm.workforce.hungry, 2); /* both would have taken more */
    farm_job_change(&sim->farm, paused, JOB_STATE_QUEUED, NULL, sim->now_ns);
    assert_int_equal(sim_grant(sim, b, 8), 1);
    assert_int_equal(b->units[0].job, paused->id);
}

/* Whatever gives a worker that was left without anything something to do asks for it: the loop's rule. */
static void a_result_asks_for_its_worker_and_a_job_for_all(void **state)
{
    struct sim *sim = *state;
    struct sim_worker *a = sim_connect(sim, 0, 1);

    while (workforce_next_due(&sim->farm))
        ;
    sim->farm.pump_wanted = 0;
    sim_submit(sim, 64, 64, 64, 1, 1, 0);
    assert_true(sim->farm.pump_wanted);
    sim_grant(sim, a, 2);
    sim->farm.pump_wanted = 0;
    (void)sim_send(sim, a, 0, 100);
    sim_forget(a, 0);
    assert_ptr_equal(workforce_next_due(&sim->farm), &a->worker);
    assert_null(workforce_next_due(&sim->farm));
    assert_false(sim->farm.pump_wanted);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(lists_hold_what_a_walk_finds),
        cmocka_unit_test_setup_teardown(many_units_are_found, sim_set_up, sim_tear_down),
        cmocka_unit_test_setup_teardown(a_lane_is_skipped_and_told_once, sim_set_up, sim_tear_down),
        cmocka_unit_test_setup_teardown(a_resumed_job_ends_a_barren_time, sim_set_up, sim_tear_down),
        cmocka_unit_test_setup_teardown(a_result_asks_for_its_worker_and_a_job_for_all, sim_set_up,
                                        sim_tear_down),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
