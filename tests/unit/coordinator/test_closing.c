/* Jobs that are cancelled keep their picture: in any order of events, and over a restart. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "common/system/clock.h"
#include "common/system/file.h"
#include "coordinator/farm/scheduler.h"
#include "coordinator/store/store.h"
#include "coordinator/film/store_film.h"
#include "tests/support/sim_farm.h"

/* A job of two frames of 4 tiles and 4 passes of either group, of which tile 0 of frame 1 has one pass of
 * both groups merged, tile 1 one, and tile 2 one that waits for the pass before it. */
static struct job *begin_job(struct sim_stored *f, struct sim_worker *worker)
{
    struct job *job = sim_submit(f->sim, 32, 32, 32, 1, 2, 0);
    static const struct unit_name done[] = {{0, 0, 0}, {0, 1, 0}, {1, 0, 0}, {2, 0, 1}};

    assert_true(sim_grant(f->sim, worker, 16) == 16);
    for (size_t i = 0; i < sizeof done / sizeof done[0]; i++)
        for (size_t u = 0; u < worker->unit_count; u++)
            if (worker->units[u].name.tile == done[i].tile && worker->units[u].name.group == done[i].group &&
                worker->units[u].name.pass == done[i].pass && worker->units[u].frame == 1)
                assert_int_equal(sim_send(f->sim, worker, u, 100), MERGE_PENDING);
    return job;
}

static void check_cut(const struct job *job)
{
    assert_int_equal(job->state, JOB_STATE_CANCELLED);
    assert_true(job_frame_is_done(job, 1));
    assert_false(job_frame_is_done(job, 2));
    assert_int_equal(job->cut_count, 1);
    assert_int_equal(job->cuts[0].frame, 1);
    assert_int_equal(job->cuts[0].coverage.samples, 256 * (4 + 2));
    assert_int_equal(job->cuts[0].coverage.least, 0);
    assert_int_equal(job->cuts[0].coverage.most, 4);
    assert_int_equal(job->cuts[0].coverage.tiles, 4);
    assert_int_equal(job->cuts[0].coverage.tiles_empty, 2);
    assert_int_equal(job->samples_done, 256 * (4 + 2));
}

static void a_cancelled_job_makes_its_picture(void **state)
{
    struct sim_stored *f = *state;
    struct sim *sim = f->sim;
    struct sim_worker *worker = sim_connect(sim, 0, 16);
    struct job *job = begin_job(f, worker);
    struct sim_unit late = worker->units[worker->unit_count - 1];

    farm_cancel(&sim->farm, job, 0, sim->now_ns);
    assert_int_equal(job->state, JOB_STATE_CANCELLING);
    assert_int_equal(worker->worker.held.units, 0);
    assert_int_equal(sim->developing_count, 0); /* its tiles are not on disk yet */
    /* Nothing is lent and no result taken any more. */
    assert_int_equal(sim_grant(sim, worker, 16), 0);
    worker->units[worker->unit_count++] = late;
    assert_int_equal(sim_send(sim, worker, worker->unit_count - 1, 100), MERGE_UNWANTED);
    worker->unit_count--;
    farm_cancel(&sim->farm, job, 0, sim->now_ns); /* twice is once */

    sim_commit(sim);
    farm_tick(&sim->farm, sim->now_ns);
    assert_int_equal(sim->developing_count, 1);
    assert_int_equal(job->state, JOB_STATE_CANCELLING);
    sim_develop(sim);
    check_cut(job);
    assert_int_equal(sim->wrong_frames, 0);
    assert_int_equal(worker->unit_count, 0);    /* what waited is disowned as well */
    worker->units[worker->unit_count++] = late; /* it is not in the picture: not acknowledged */
    assert_int_equal(sim_send(sim, worker, 0, 100), MERGE_UNWANTED);
    assert_false(store_film_exists(f->store, job->id, 2));

    sim_stored_restart(f);
    check_cut(sim->farm.queue.all[0]);
}

static void closing_survives_restarts(void **state)
{
    struct sim_stored *f = *state;
    struct sim *sim = f->sim;
    struct job *job = begin_job(f, sim_connect(sim, 0, 16));

    sim_commit(sim);
    farm_cancel(&sim->farm, job, 0, sim->now_ns);
    for (int i = 0; i < 3; i++) {
        job = sim->farm.queue.all[0];
        assert_int_equal(job->state, JOB_STATE_CANCELLING);
        assert_int_equal(sim->developing_count, 1); /* killed in the middle of it */
        sim_stored_restart(f);
    }
    sim_develop(sim);
    check_cut(sim->farm.queue.all[0]);
}

static void nothing_is_made_of_nothing(void **state)
{
    struct sim_stored *f = *state;
    struct sim *sim = f->sim;
    struct job *queued = sim_submit(sim, 32, 32, 32, 1, 2, 0);
    struct job *begun = sim_submit(sim, 32, 32, 32, 1, 2, 1);

    sim_grant(sim, sim_connect(sim, 0, 4), 4);
    assert_int_equal(begun->state, JOB_STATE_RUNNING);
    farm_cancel(&sim->farm, queued, 0, sim->now_ns);
    farm_cancel(&sim->farm, begun, 0, sim->now_ns);
    assert_int_equal(queued->state, JOB_STATE_CANCELLED);
    assert_int_equal(begun->state, JOB_STATE_CANCELLED);
    assert_int_equal(begun->cut_count, 0);
    assert_int_equal(sim->farm.open_frames, 0);
}

/* The cancel came when its last picture was being made: also after a kill at that moment. */
static void a_job_with_all_frames_is_done(void **state)
{
    struct sim_stored *f = *state;
    struct sim *sim = f->sim;
    struct job *job = sim_submit(sim, 16, 16, 4, 1, 1, 0);
    struct sim_worker *worker = sim_connect(sim, 0, 16);

    while (sim_grant(sim, worker, 16) > 0) {
        for (size_t u = 0; u < worker->unit_count; u++)
            sim_send(sim, worker, u, 100);
        sim_commit(sim);
    }
    farm_tick(&sim->farm, sim->now_ns);
    assert_int_equal(sim->developing_count, 1);
    farm_cancel(&sim->farm, job, 0, sim->now_ns);
    assert_int_equal(job->state, JOB_STATE_CANCELLING);
    sim_stored_restart(f);
    farm_tick(&sim->farm, sim->now_ns);
    sim_develop(sim);
    job = sim->farm.queue.all[0];
    assert_int_equal(job->frames_done_count, 1);
    assert_int_equal(job->cut_count, 0);
    assert_int_equal(job->state, JOB_STATE_DONE);
}

static void discarding_makes_no_picture(void **state)
{
    struct sim_stored *f = *state;
    struct sim *sim = f->sim;
    struct job *job = begin_job(f, sim_connect(sim, 0, 16));

    sim_commit(sim);
    farm_cancel(&sim->farm, job, 0, sim->now_ns);
    assert_int_equal(job->state, JOB_STATE_CANCELLING);
    farm_cancel(&sim->farm, job, 1, sim->now_ns); /* second thoughts */
    assert_int_equal(job->state, JOB_STATE_CANCELLED);
    sim_develop(sim);
    assert_int_equal(job->frames_done_count, 0);
    store_settle(f->store);
    assert_false(store_film_exists(f->store, job->id, 1));
}

static void a_full_disk_delays_the_end(void **state)
{
    struct sim_stored *f = *state;
    struct sim *sim = f->sim;
    struct job *job = begin_job(f, sim_connect(sim, 0, 16));

    film_file_fault(0);
    farm_cancel(&sim->farm, job, 0, sim->now_ns);
    for (int i = 0; i < 3; i++) {
        sim_commit(sim);
        sim->now_ns += TROUBLE_LAST_MS * NS_PER_MS;
        farm_tick(&sim->farm, sim->now_ns);
        assert_int_equal(job->state, JOB_STATE_CANCELLING);
        assert_int_equal(sim->developing_count, 0);
    }
    film_file_fault(-1);
    sim_commit(sim);
    farm_tick(&sim->farm, sim->now_ns);
    sim_develop(sim);
    check_cut(job);
}

static void a_parked_job_keeps_its_film(void **state)
{
    struct sim_stored *f = *state;
    struct sim *sim = f->sim;
    struct job *job = begin_job(f, sim_connect(sim, 0, 16));

    for (uint64_t i = 1; i < SUSPICION_DEATHS; i++)
        suspicion_add(&job->suspicion, i, sim->now_ns, sim->now_ns);
    /* The parking death is of one that never delivered. */
    sim_connect(sim, 1, 1);
    assert_int_equal(sim_grant(sim, &sim->workers[1], 1), 1);
    sim->now_ns += NS_PER_SECOND;
    sim_die(sim, 1);
    assert_int_equal(job->state, JOB_STATE_PARKED);
    assert_non_null(job->frames); /* until what is merged is on disk */
    sim_commit(sim);
    farm_tick(&sim->farm, sim->now_ns);
    assert_null(job->frames);
    sim_stored_restart(f);
    job = sim->farm.queue.all[0];
    assert_int_equal(job->state, JOB_STATE_PARKED);
    assert_non_null(strstr(job->state_text, "died"));
    assert_null(job->frames);
    farm_cancel(&sim->farm, job, 0, sim->now_ns);
    assert_int_equal(sim->developing_count, 1); /* its film came from the disk */
    sim_develop(sim);
    check_cut(job);
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, sim_stored_set_up, sim_stored_tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        TEST(a_cancelled_job_makes_its_picture),
        TEST(closing_survives_restarts),
        TEST(nothing_is_made_of_nothing),
        TEST(a_job_with_all_frames_is_done),
        TEST(discarding_makes_no_picture),
        TEST(a_full_disk_delays_the_end),
        TEST(a_parked_job_keeps_its_film),
    };
    return cmocka_run_group_tests_name("closing", tests, NULL, NULL);
}
