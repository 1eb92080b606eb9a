/* What jobs wait for, and the order in a whole farm: several at once, shares over a restart, room for the
 * first job. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/system/clock.h"
#include "coordinator/steering/report.h"
#include "coordinator/farm/scheduler.h"
#include "coordinator/farm/waiting.h"
#include "tests/support/sim_farm.h"
#include "tests/support/steering.h"

static struct job *submit_as(struct sim *sim, const char *owner, uint32_t size, uint32_t last_frame)
{
    struct job *job = sim_submit(sim, size, size, 2, 1, last_frame, 0);

    snprintf(job->owner, sizeof job->owner, "%s", owner);
    return job;
}

static const char *note(struct sim *sim, struct job *job)
{
    static struct job_report report;

    job_report_make(&report, &sim->farm, job, sim->now_ns);
    return report.message.state_text;
}

/* Deliver the worker's units. */
static void deliver(struct sim *sim, struct sim_worker *worker, uint64_t cost_ns)
{
    for (size_t i = worker->unit_count; i-- > 0;) {
        (void)sim_send(sim, worker, i, cost_ns);
        sim_forget(worker, i);
    }
    sim_commit(sim);
    sim_develop(sim);
}

static void later_jobs_get_what_the_first_cannot_use(void **state)
{
    struct sim *sim = *state;
    struct job *first = submit_as(sim, "ana", 16, 1), *second = submit_as(sim, "ana", 64, 1);
    struct job *third = submit_as(sim, "ben", 64, 1);
    struct sim_worker *a = sim_connect(sim, 0, 8), *b = sim_connect(sim, 1, 8);

    assert_int_equal(sim_grant(sim, a, 8), 8);
    assert_int_equal(a->units[0].job, first->id); /* its two units */
    assert_int_equal(a->units[1].job, first->id);
    assert_int_equal(a->units[2].job, second->id);
    sim_grant(sim, b, 8);
    assert_int_equal(b->units[0].job, second->id);
    assert_true(first->leases > 0 && second->leases > 0);
    assert_string_equal(note(sim, third), "waits behind 2 jobs");
}

static void the_owner_who_used_less_is_first(void **state)
{
    struct sim *sim = *state;
    struct job *ana = submit_as(sim, "ana", 64, 9), *ben;
    struct sim_worker *worker = sim_connect(sim, 0, 4);

    sim_grant(sim, worker, 4);
    deliver(sim, worker, 1000000);
    ben = submit_as(sim, "ben", 64, 9);
    sim_grant(sim, worker, 4);
    assert_int_equal(worker->units[0].job, ben->id); /* he used nothing yet */
    deliver(sim, worker, 9000000);
    sim_grant(sim, worker, 4);
    assert_int_equal(worker->units[0].job, ben->id); /* until the round ends */
    deliver(sim, worker, 9000000);
    sim->now_ns += ORDER_ROUND_MS * NS_PER_MS;
    sim_grant(sim, worker, 4);
    assert_int_equal(worker->units[0].job, ana->id);
    /* What a worker claims is limited to what a processor can do. */
    assert_true(order_share(&sim->farm.order, "ben")->core_s < 100);
}

static void shares_survive_a_restart(void **state)
{
    struct sim_stored *f = *state;
    struct sim_worker *worker;
    struct job *ana = submit_as(f->sim, "ana", 64, 9);
    double used;

    worker = sim_connect(f->sim, 0, 4);
    sim_grant(f->sim, worker, 4);
    deliver(f->sim, worker, 1000000);
    used = order_share(&f->sim->farm.order, "ana")->core_s;
    assert_true(used > 1);
    (void)ana;
    sim_stored_restart(f);
    assert_true(order_share(&f->sim->farm.order, "ana")->core_s == used);
    assert_int_equal(order_share(&f->sim->farm.order, "ana")->at_s, f->sim->farm.wall_s);
}

static void a_moment_is_waited_for_once(void **state)
{
    struct sim *sim = *state;
    struct job *job = sim_job(16, 16, 1, 1, 1, 0);
    struct sim_worker *worker = sim_connect(sim, 0, 4);

    job->needs.not_before = sim->farm.wall_s + 100;
    assert_int_equal(farm_submit(&sim->farm, job, NULL), STATUS_OK);
    assert_int_equal(sim_grant(sim, worker, 4), 0);
    assert_non_null(strstr(note(sim, job), "waits until 1970-01-01 00:18 UTC"));
    sim->farm.wall_s += 99;
    assert_int_equal(sim_grant(sim, worker, 4), 0);
    sim->farm.wall_s += 1;
    farm_tick(&sim->farm, sim->now_ns);
    sim->farm.wall_s -= 50; /* the clock is set back */
    farm_tick(&sim->farm, sim->now_ns);
    assert_true(sim_grant(sim, worker, 4) > 0);
}

/* A job that was done and is removed in the same turn of the loop is waited for no longer, nor after a crash. */
static void what_was_done_may_be_removed(void **state)
{
    struct sim_stored *f = *state;
    struct sim *sim = f->sim;
    struct job *first = sim_submit(sim, 16, 16, 1, 1, 1, 0), *job = sim_job(16, 16, 1, 1, 1, 0);
    uint64_t id = first->id;

    job->needs = (struct job_needs){.after = {id}, .after_count = 1};
    assert_int_equal(farm_submit(&sim->farm, job, NULL), STATUS_OK);
    (void)waiting_order(&sim->farm, sim->now_ns);
    assert_int_equal(job->needs.after_count, 1);
    job_set_state(&sim->farm.queue, first, JOB_STATE_RUNNING, NULL, sim->now_ns, sim->farm.wall_s);
    job_set_state(&sim->farm.queue, first, JOB_STATE_DONE, NULL, sim->now_ns, sim->farm.wall_s);
    assert_int_equal(do_verb(&sim->farm, first, VERB_REMOVE, "ana@desk", sim->now_ns, NULL), STATUS_OK);
    assert_int_equal(job->needs.after_count, 0);
    store_settle(f->store);                             /* as the answer waits for it */
    assert_false(store_job_unsaved(f->store, job->id)); /* a kill now does not bring the need back */
    id = job->id;
    sim_stored_restart(f);
    assert_int_equal(queue_find(&f->sim->farm.queue, id)->needs.after_count, 0);
}

static void what_is_waited_for_survives_a_restart(void **state)
{
    struct sim_stored *f = *state;
    struct job *first = sim_submit(f->sim, 16, 16, 1, 1, 1, 0);
    struct job *job = sim_job(16, 16, 1, 1, 1, 0);
    const int64_t tomorrow = f->sim->farm.wall_s + 86400;

    job->needs = (struct job_needs){.after = {first->id}, .after_count = 1, .not_before = tomorrow,
                                    .require = "big,gpu", .memory = 12345, .memory_said = 1};
    assert_int_equal(farm_submit(&f->sim->farm, job, NULL), STATUS_OK);
    sim_stored_restart(f);
    job = queue_find(&f->sim->farm.queue, 2);
    /* Its row is written again for another reason. */
    assert_int_equal(do_verb_with(&f->sim->farm, job, VERB_PRIORITY, 5, "ana@desk", f->sim->now_ns, NULL), STATUS_OK);
    sim_stored_restart(f);
    job = queue_find(&f->sim->farm.queue, 2);
    assert_true(job->needs.after_count == 1 && job->needs.after[0] == 1 && job->needs.not_before == tomorrow);
    assert_string_equal(job->needs.require, "big,gpu");
    assert_true(job->needs.memory == 12345 && job->needs.memory_said);

    farm_cancel(&f->sim->farm, queue_find(&f->sim->farm.queue, 1), 1, f->sim->now_ns);
    (void)waiting_order(&f->sim->farm, f->sim->now_ns);
    assert_int_equal(job->needs.after_count, 1); /* a retry may still finish it */
    assert_non_null(strstr(note(f->sim, job), "waits for job 1; 1 was cancelled"));
}

/* A job that is lent something now and then does not wait. */
static void what_is_served_needs_no_turn(void **state)
{
    struct sim *sim = *state;
    struct job *job = submit_as(sim, "ana", 64, 9);
    struct sim_worker *worker = sim_connect(sim, 0, 4);

    for (int i = 0; i < 5; i++) {
        assert_true(sim_grant(sim, worker, 4) > 0);
        deliver(sim, worker, 100);
        sim->now_ns += (ORDER_LONGEST_WAIT_S - 1) * NS_PER_SECOND;
    }
    assert_int_equal(job->place.turn_end_ns, 0);
    sim->now_ns += 2 * NS_PER_SECOND;
    (void)waiting_order(&sim->farm, sim->now_ns);
    assert_true(job->place.turn_end_ns > sim->now_ns);
}

static void room_is_made_for_the_first_job(void **state)
{
    struct sim_stored *f = *state;
    struct sim *sim = f->sim;
    struct job *jobs[8], *urgent;
    struct sim_worker *worker = sim_connect(sim, 0, 64), *other = sim_connect(sim, 1, 4);
    unsigned open = 0;

    for (unsigned i = 0; i < 8; i++)
        jobs[i] = submit_as(sim, (const char *[]){"a", "b", "c", "d", "e", "f", "g", "h"}[i], 32, 9);
    sim_grant(sim, worker, 4000);
    assert_int_equal(sim->farm.open_frames, FRAMES_OPEN_MAX);
    sim_send(sim, worker, 0, 100);
    urgent = sim_submit(sim, 32, 32, 2, 1, 1, 1);
    assert_int_equal(sim_grant(sim, other, 4), 0); /* all units are lent, and there is no room */
    assert_int_equal(sim->farm.leaving, 1);
    assert_int_equal(sim_grant(sim, other, 4), 0);
    assert_int_equal(sim->farm.leaving, 1); /* one at a time */
    sim_commit(sim);
    farm_tick(&sim->farm, sim->now_ns);
    assert_int_equal(sim->farm.leaving, 0);
    assert_int_equal(sim_grant(sim, other, 4), 4);
    assert_int_equal(other->units[0].job, urgent->id);
    for (const struct job_frame *frame = jobs[0]->frames; frame; frame = frame->next)
        open++;
    assert_int_equal(open, FRAMES_OPEN_PER_JOB - 1); /* its owner used something: it is the last now */
    assert_int_equal(sim->farm.open_frames, FRAMES_OPEN_MAX);

    /* Everything is rendered, to the bit. */
    for (int i = 0; i < 10000 && sim->farm.queue.active_count > 0; i++) {
        sim_freeze(sim);
        sim_grant(sim, worker, 64);
        deliver(sim, worker, 100);
        deliver(sim, other, 100);
        sim->now_ns += NS_PER_SECOND / 10;
        farm_tick(&sim->farm, sim->now_ns);
    }
    assert_int_equal(sim->farm.queue.active_count, 0);
    assert_int_equal(sim->wrong_frames, 0);
    assert_int_equal(urgent->state, JOB_STATE_DONE);
}

/* A graph of jobs in any order of ends: none begins before those that it waits for are done. */
static void jobs_wait_for_jobs(void **state)
{
    struct sim_stored *f = *state;
    struct sim_worker *worker;
    unsigned connected = 0;

    for (uint64_t i = 1; i <= 12; i++) {
        struct job *job = sim_job(16, 16, 1, 1, 1, (int32_t)sim_random(f->sim, 3));
        for (uint64_t k = 1; k < i; k++)
            if (sim_random(f->sim, 3) == 0)
                job->needs.after[job->needs.after_count++] = k;
        assert_int_equal(farm_submit(&f->sim->farm, job, NULL), STATUS_OK);
    }
    worker = sim_connect(f->sim, 0, 1);
    for (int step = 0; step < 200; step++) {
        struct queue *queue = &f->sim->farm.queue;
        sim_grant(f->sim, worker, 1);
        for (size_t i = 0; i < queue->count; i++) {
            const struct job *job = queue->all[i];
            for (uint32_t k = 0; k < job->needs.after_count; k++)
                assert_true(job->state == JOB_STATE_QUEUED &&
                            queue_find(queue, job->needs.after[k])->state != JOB_STATE_DONE);
        }
        deliver(f->sim, worker, 100);
        if (queue->active_count == 0)
            return;
        if (step % 5 == 4) {
            sim_disconnect(f->sim, connected);
            worker->unit_count = 0;
            sim_stored_restart(f);
            connected = (connected + 1) % SIM_WORKERS_MAX;
            worker = sim_connect(f->sim, connected, 1);
        }
    }
    fail_msg("some jobs wait for ever");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(later_jobs_get_what_the_first_cannot_use, sim_set_up, sim_tear_down),
        cmocka_unit_test_setup_teardown(the_owner_who_used_less_is_first, sim_set_up, sim_tear_down),
        cmocka_unit_test_setup_teardown(shares_survive_a_restart, sim_stored_set_up, sim_stored_tear_down),
        cmocka_unit_test_setup_teardown(a_moment_is_waited_for_once, sim_set_up, sim_tear_down),
        cmocka_unit_test_setup_teardown(what_is_waited_for_survives_a_restart, sim_stored_set_up, sim_stored_tear_down),
        cmocka_unit_test_setup_teardown(what_was_done_may_be_removed, sim_stored_set_up, sim_stored_tear_down),
        cmocka_unit_test_setup_teardown(what_is_served_needs_no_turn, sim_set_up, sim_tear_down),
        cmocka_unit_test_setup_teardown(room_is_made_for_the_first_job, sim_stored_set_up, sim_stored_tear_down),
        cmocka_unit_test_setup_teardown(jobs_wait_for_jobs, sim_stored_set_up, sim_stored_tear_down),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
