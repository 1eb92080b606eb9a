/* Jobs that kill their workers, and workers that die of something else. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <stdlib.h>
#include <string.h>

#include "common/system/clock.h"
#include "coordinator/farm/closing.h"
#include "coordinator/farm/waiting.h"
#include "coordinator/farm/scheduler.h"
#include "tests/support/sim_farm.h"
#include "tests/support/steering.h"

static void a_machine_is_its_name_and_address(void **state)
{
    (void)state;
    assert_true(machine_identity("a", "10.0.0.1:5") == machine_identity("a", "10.0.0.1:6"));
    assert_true(machine_identity("a", "10.0.0.1:5") != machine_identity("b", "10.0.0.1:5"));
    assert_true(machine_identity("a", "10.0.0.1:5") != machine_identity("a", "10.0.0.2:5"));
    assert_true(machine_identity("a", "[::1]:5") == machine_identity("a", "[::1]:77"));
    assert_true(machine_identity("a", "[::1]:5") != machine_identity("a", "[::2]:5"));
}

/* Workers 0..count-1 join, are lent units of whatever is first, and those lent some die. */
static unsigned join_and_die(struct sim *sim, unsigned count, uint64_t job)
{
    unsigned lent = 0;

    for (unsigned i = 0; i < count; i++) {
        struct sim_worker *worker = sim_connect(sim, i, 2);
        sim_grant(sim, worker, 2);
        if (worker->unit_count > 0 && worker->units[0].job == job)
            lent++;
    }
    sim->now_ns += NS_PER_SECOND;
    for (unsigned i = 0; i < count; i++) {
        if (sim->workers[i].unit_count > 0 && sim->workers[i].units[0].job == job)
            sim_die(sim, i);
        else
            sim_disconnect(sim, i);
        sim->workers[i].unit_count = 0;
    }
    sim->now_ns += NS_PER_SECOND;
    return lent;
}

static void a_poisonous_job_is_parked_and_the_next_one_runs(void **state)
{
    struct sim *sim = *state;
    struct job *poison = sim_submit(sim, 64, 64, 1, 1, 1, 0);
    struct job *next = sim_submit(sim, 64, 64, 1, 1, 1, 0);
    struct sim_worker *worker;
    struct error err = {0};

    assert_int_equal(join_and_die(sim, 6, poison->id), 6); /* nobody knows yet */
    assert_int_equal(poison->suspicion.deaths, 1);         /* all at once: one death */
    for (int i = 1; i < SUSPICION_DEATHS; i++) {
        assert_int_equal(poison->state, JOB_STATE_RUNNING);
        sim_connect(sim, 7, 1); /* another machine takes its turn as the probe */
        assert_int_equal(sim_grant(sim, &sim->workers[7], 1), 1);
        assert_int_equal(sim->workers[7].units[0].job, poison->id);
        assert_int_equal(join_and_die(sim, 6, poison->id), 0); /* the others are spared */
        sim_die(sim, 7);
        sim->now_ns += NS_PER_SECOND;
    }
    assert_int_equal(poison->state, JOB_STATE_PARKED);
    assert_non_null(strstr(poison->state_text, "several machines"));
    assert_int_equal(poison->leases, 0);
    assert_null(poison->frames); /* its film is on disk only */

    worker = sim_connect(sim, 0, 4);
    assert_int_equal(sim_grant(sim, worker, 4), 4);
    assert_int_equal(worker->units[0].job, next->id);
    (void)waiting_order(&sim->farm, sim->now_ns);
    assert_int_equal(next->place.before, 0); /* it waits behind nothing */

    assert_int_equal(do_verb(&sim->farm, next, VERB_RESUME, "ana@desk", sim->now_ns, &err), STATUS_ERR_REFUSED);
    assert_int_equal(do_verb(&sim->farm, poison, VERB_RESUME, "ana@desk", sim->now_ns, &err), STATUS_OK);
    assert_int_equal(poison->state, JOB_STATE_QUEUED);
    assert_int_equal(poison->suspicion.deaths, 0);
    worker = sim_connect(sim, 1, 4);
    assert_int_equal(sim_grant(sim, worker, 4), 4);
    assert_int_equal(worker->units[0].job, poison->id);
}

static void one_machine_alone_must_die_more_often(void **state)
{
    struct sim *sim = *state;
    struct job *job = sim_submit(sim, 64, 64, 1, 1, 1, 0);

    for (int i = 1; i < SUSPICION_DEATHS_ALONE; i++) {
        join_and_die(sim, 1, job->id);
        assert_int_equal(job->state, JOB_STATE_RUNNING);
    }
    join_and_die(sim, 1, job->id);
    assert_int_equal(job->state, JOB_STATE_PARKED);
    assert_non_null(strstr(job->state_text, "one machine"));
    farm_cancel(&sim->farm, job, 0, sim->now_ns); /* it holds nothing: at once */
    assert_int_equal(job->state, JOB_STATE_CANCELLED);
}

/* A farm of four whose workers deliver every other second: each second one of them is killed, and
 * now and then all of them at once. */
static void kill_storms_park_nothing(void **state)
{
    struct sim *sim = *state;
    struct job *job = sim_submit(sim, 640, 640, 32, 1, 1, 0); /* 1600 tiles, 4 passes */
    unsigned counted = 0;

    for (unsigned i = 0; i < 4; i++)
        sim_connect(sim, i, 2);
    for (int round = 0; round < 1000; round++) {
        unsigned victim = sim_random(sim, 4);

        for (unsigned i = 0; i < 4; i++) {
            struct sim_worker *worker = &sim->workers[i];
            sim_grant(sim, worker, 2);
            if (worker->unit_count > 0 && sim_random(sim, 2)) {
                sim_send(sim, worker, 0, 100);
                sim_forget(worker, 0);
            }
        }
        for (unsigned i = 0; i < 4; i++) {
            if (i != victim && round % 10 != 0)
                continue;
            sim_die(sim, i);
            sim_connect(sim, i, 2);
        }
        counted += job->suspicion.deaths > 0;
        sim->now_ns += NS_PER_SECOND;
        assert_true(job_state_is_open(job->state));
    }
    assert_true(counted > 10); /* there was something to suspect */
}

static void a_worker_that_rendered_the_job_or_says_goodbye_does_not_count(void **state)
{
    struct sim *sim = *state;
    struct job *job = sim_submit(sim, 64, 64, 1, 1, 1, 0);
    struct sim_worker *worker;

    for (int i = 0; i < 2 * SUSPICION_DEATHS_ALONE; i++) {
        worker = sim_connect(sim, 0, 2);
        assert_true(sim_grant(sim, worker, 2) > 0);
        sim->now_ns += NS_PER_SECOND;
        sim_disconnect(sim, 0); /* a drain */
        worker->unit_count = 0;
    }
    assert_int_equal(job->suspicion.deaths, 0);
    worker = sim_connect(sim, 0, 2);
    assert_int_equal(sim_grant(sim, worker, 2), 2);
    sim_send(sim, worker, 0, 100);
    sim_grant(sim, worker, 2);
    sim->now_ns += NS_PER_SECOND;
    sim_die(sim, 0);
    assert_int_equal(job->suspicion.deaths, 0);
}

static void a_probe_that_stands_still_gives_way(void **state)
{
    struct sim *sim = *state;
    struct job *job = sim_submit(sim, 64, 64, 1, 1, 1, 0);
    struct sim_worker *probe, *other;

    join_and_die(sim, 1, job->id);
    probe = sim_connect(sim, 0, 1);
    other = sim_connect(sim, 1, 2);
    assert_int_equal(sim_grant(sim, probe, 1), 1);
    assert_int_equal(sim_grant(sim, other, 2), 0);
    sim->now_ns += 11 * NS_PER_SECOND; /* the simulated farm's leases last 10 s */
    farm_tick(&sim->farm, sim->now_ns);
    assert_int_equal(sim_grant(sim, other, 2), 2);
    sim_send(sim, other, 0, 100);
    assert_int_equal(sim_grant(sim, probe, 1), 1); /* it lives: everyone may */
}

#define SIM_TEST(name) cmocka_unit_test_setup_teardown(name, sim_set_up, sim_tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_machine_is_its_name_and_address),
        SIM_TEST(a_poisonous_job_is_parked_and_the_next_one_runs),
        SIM_TEST(one_machine_alone_must_die_more_often),
        SIM_TEST(kill_storms_park_nothing),
        SIM_TEST(a_worker_that_rendered_the_job_or_says_goodbye_does_not_count),
        SIM_TEST(a_probe_that_stands_still_gives_way),
    };
    return cmocka_run_group_tests_name("suspicion", tests, NULL, NULL);
}
