/* Units that hang: what is too long, and who gets them. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <string.h>

#include "common/system/clock.h"
#include "coordinator/farm/roster.h"
#include "tests/support/sim_farm.h"
#include "tests/support/steering.h"

enum { LEAST_S = 10 };

static void the_limit_is_of_its_kind(void **state)
{
    struct hangs h = {0};

    (void)state;
    assert_int_equal(hangs_limit_ns(&h, 512, NS_PER_SECOND), 0); /* nothing is known */
    hangs_learn(&h, 0, 5);
    assert_int_equal(hangs_limit_ns(&h, 512, NS_PER_SECOND), 0);
    hangs_learn(&h, 1000, 3000);
    hangs_learn(&h, 1000, 2000);
    assert_int_equal(hangs_limit_ns(&h, 100, NS_PER_SECOND), NS_PER_SECOND + HANG_FACTOR * 300);
    hangs_learn(&h, 1, UINT64_MAX); /* a claim that cannot be */
    assert_int_equal(hangs_limit_ns(&h, 1, 0), HANG_FACTOR * NS_PER_SECOND);
}

static void notes_are_bounded(void **state)
{
    struct hangs h = {0};
    struct hang_unit unit = {.frame = 1, .tile = 2, .group = 1, .pass = 3}, other = unit;

    (void)state;
    assert_int_equal(hangs_note(&h, unit, 5)->session_count, 1);
    assert_null(hangs_note(&h, unit, 5));
    assert_true(hangs_has(&h, unit, 5));
    assert_false(hangs_has(&h, unit, 6));
    assert_int_equal(hangs_note(&h, unit, 6)->session_count, 2);
    assert_int_equal(hangs_note(&h, unit, 7)->session_count, HANG_SESSIONS_MAX);
    assert_null(hangs_note(&h, unit, 8));
    other.pass = 4;
    assert_false(hangs_has(&h, other, 5));
    for (uint32_t i = 1; i < HANG_UNITS_MAX; i++) {
        other.tile = 100 + i;
        assert_non_null(hangs_note(&h, other, 5));
    }
    other.tile = 1000;
    assert_null(hangs_note(&h, other, 5));
    hangs_settle(&h, unit);
    assert_false(hangs_has(&h, unit, 5));
    assert_non_null(hangs_note(&h, other, 5));
    hangs_clear(&h);
    assert_false(hangs_has(&h, other, 5));
}

/* What the worker's thread tells about its first unit. */
static int renders(struct sim *sim, struct sim_worker *worker, struct unit_name name, double seconds)
{
    return farm_worker_renders_long(&sim->farm, &worker->worker, 1, 1, name, (uint64_t)(seconds * 1e9), sim->now_ns);
}

static int holds(const struct sim_worker *worker, struct unit_name name)
{
    for (size_t i = 0; i < worker->unit_count; i++)
        if (memcmp(&worker->units[i].name, &name, sizeof name) == 0)
            return 1;
    return 0;
}

static void others_get_it(void **state)
{
    struct sim *sim = *state;
    struct job *job = sim_submit(sim, 64, 64, 64, 1, 1, 0);
    struct sim_worker *workers[4];
    struct unit_name name;

    sim->farm.hang_ns = LEAST_S * NS_PER_SECOND;
    for (unsigned i = 0; i < 4; i++)
        workers[i] = sim_connect(sim, i, 2);
    sim_grant(sim, workers[0], 2);
    name = workers[0]->units[0].name;
    assert_false(renders(sim, workers[0], name, 1000)); /* nothing is known of its kind */
    sim_send(sim, workers[0], 1, 1000);
    assert_false(renders(sim, workers[0], name, LEAST_S));
    assert_true(renders(sim, workers[0], name, LEAST_S + 1));
    assert_non_null(strstr(workers[0]->worker.hang_note, "job 1 (frame 1, tile 0"));
    assert_true(renders(sim, workers[0], name, LEAST_S + 2)); /* it is known */
    assert_int_equal(job->hangs.count, 1);
    /* The first one asks first, and gets other units. */
    workers[0]->unit_count = 0;
    assert_true(sim_grant(sim, workers[0], 100) > 0);
    assert_false(holds(workers[0], name));
    sim_grant(sim, workers[1], 1);
    assert_true(holds(workers[1], name));
    /* Its result ends the matter, whoever sends it. */
    sim_send(sim, workers[1], 0, 1000);
    assert_int_equal(job->hangs.count, 0);
    /* But the first one's thread is lost, and it stays noted. */
    assert_true(renders(sim, workers[0], name, 1000));
    assert_false(renders(sim, workers[1], name, 1000));
    assert_false(renders(sim, workers[0], (struct unit_name){9999, 0, 0}, 1000)); /* no such unit */
    assert_false(farm_worker_renders_long(&sim->farm, &workers[0]->worker, 99, 1, name, UINT64_MAX, 0));
}

static void the_only_worker_gets_it_again(void **state)
{
    struct sim *sim = *state;
    struct sim_worker *worker = sim_connect(sim, 0, 2), *drained = sim_connect(sim, 1, 2);
    struct unit_name name;

    sim_submit(sim, 64, 64, 64, 1, 1, 0);
    drained->worker.hold = WORKER_DRAINED;
    sim_grant(sim, worker, 2);
    name = worker->units[0].name;
    sim_send(sim, worker, 1, 1000);
    assert_true(renders(sim, worker, name, 10 * HANG_LEAST_S));
    worker->unit_count = 0;
    sim_grant(sim, worker, 100);
    assert_true(holds(worker, name));
    assert_int_equal(sim_grant(sim, drained, 100), 0);
}

static void three_park_the_job(void **state)
{
    struct sim *sim = *state;
    struct job *job = sim_submit(sim, 64, 64, 64, 1, 1, 0);
    struct sim_worker *workers[3];
    struct unit_name name = {0};
    struct error err = {0};

    for (unsigned i = 0; i < 3; i++)
        workers[i] = sim_connect(sim, i, 2);
    sim_grant(sim, workers[0], 2);
    name = workers[0]->units[0].name;
    sim_send(sim, workers[0], 1, 1000);
    for (unsigned i = 0; i < 3; i++) {
        assert_int_equal(job->state, JOB_STATE_RUNNING);
        if (i > 0)
            sim_grant(sim, workers[i], 1);
        assert_true(holds(workers[i], name));
        assert_true(renders(sim, workers[i], name, 10 * HANG_LEAST_S));
    }
    assert_int_equal(job->state, JOB_STATE_PARKED);
    assert_non_null(strstr(job->state_text, "3 workers hung on one work unit"));
    assert_int_equal(do_verb(&sim->farm, job, VERB_RESUME, "ada", sim->now_ns, &err), STATUS_OK);
    assert_int_equal(job->hangs.count, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_limit_is_of_its_kind),
        cmocka_unit_test(notes_are_bounded),
        cmocka_unit_test_setup_teardown(others_get_it, sim_set_up, sim_tear_down),
        cmocka_unit_test_setup_teardown(the_only_worker_gets_it_again, sim_set_up, sim_tear_down),
        cmocka_unit_test_setup_teardown(three_park_the_job, sim_set_up, sim_tear_down),
    };
    return cmocka_run_group_tests_name("hang", tests, NULL, NULL);
}
