/* A job that has not ended gets other rules: what happens to frames whose pictures are just being made, and over
 * restarts. tests/farm/test_new_rules.py has the bits. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <string.h>

#include "common/system/clock.h"
#include "coordinator/steering/report.h"
#include "coordinator/steering/retarget.h"
#include "tests/support/sim_farm.h"
#include "tests/support/steering.h"

static struct job *the_job(const struct sim_stored *f) { return f->sim->farm.queue.all[0]; }

static void tick(struct sim_stored *f)
{
    f->sim->now_ns += NS_PER_SECOND;
    sim_freeze(f->sim);
    sim_commit(f->sim);
    farm_tick(&f->sim->farm, f->sim->now_ns);
}

/* Send all that is lent, until nothing more is; pictures are not made. */
static void render(struct sim_stored *f)
{
    struct sim_worker *worker = sim_connect(f->sim, f->workers++, 16);

    for (int i = 0; i < 10; i++) {
        while (sim_grant(f->sim, worker, 64) > 0)
            for (size_t k = 0; k < worker->unit_count; k++)
                if (!worker->units[k].sent)
                    (void)sim_send(f->sim, worker, k, 100);
        tick(f);
    }
    sim_disconnect(f->sim, f->workers - 1);
}

static void extend(struct sim_stored *f, uint32_t spp)
{
    assert_int_equal(do_verb_with(&f->sim->farm, the_job(f), VERB_EXTEND, spp, "ana@desk", f->sim->now_ns, NULL),
                     STATUS_OK);
}

/* The job ends with 64 samples of every pixel, and its films are right. */
static void check_whole(struct sim_stored *f)
{
    for (int i = 0; i < 3 && the_job(f)->state != JOB_STATE_DONE; i++) {
        render(f);
        sim_develop(f->sim);
        tick(f);
    }
    assert_int_equal(the_job(f)->state, JOB_STATE_DONE);
    assert_int_equal(the_job(f)->cut_count, 0);
    assert_int_equal(the_job(f)->samples_done, (uint64_t)32 * 32 * 64 * job_frame_count(the_job(f)));
    assert_int_equal(f->sim->wrong_frames, 0);
}

/* A frame of a job of 32 samples is complete, and its pictures are being made. */
static struct job_frame *begin_pictures(struct sim_stored *f)
{
    (void)sim_submit(f->sim, 32, 32, 32, 1, 1, 0);
    render(f);
    assert_int_equal(f->sim->developing_count, 1);
    return the_job(f)->frames;
}

/* The pictures are noted after the change: the store refuses that. */
static void pictures_of_the_old_rules_do_not_count(void **state)
{
    struct sim_stored *f = *state;

    (void)begin_pictures(f);
    extend(f, 64);
    assert_int_equal(the_job(f)->frames->state, FRAME_DEVELOPING);
    sim_develop(f->sim);
    assert_int_equal(the_job(f)->frames_done_count, 0);
    assert_int_equal(the_job(f)->frames->state, FRAME_RENDERING); /* it is open again */
    sim_stored_restart(f);
    assert_int_equal(the_job(f)->frames_done_count, 0);
    assert_int_equal(the_job(f)->settings.spp, 64);
    check_whole(f);
}

/* The job's note while its last pictures are being made, and no lease holds work of it. */
static void pictures_in_the_making_are_no_wait(void **state)
{
    struct sim_stored *f = *state;
    static struct job_report report;
    struct job *first = sim_submit(f->sim, 32, 32, 32, 1, 1, 9);

    (void)sim_submit(f->sim, 32, 32, 32, 1, 1, 0);
    render(f);
    assert_int_equal(f->sim->developing_count, 2);
    (void)sim_connect(f->sim, f->workers++, 4);
    for (size_t i = 0; i < 2; i++) {
        job_report_make(&report, &f->sim->farm, f->sim->farm.queue.all[i], f->sim->now_ns);
        assert_string_equal(report.message.state_text, "its last pictures are being made");
    }
    sim_develop(f->sim);
    assert_int_equal(first->state, JOB_STATE_DONE);
}

/* They were noted just before it: the change deletes that, also if the coordinator is killed then. */
static void pictures_that_were_just_noted_do_not_count(void **state)
{
    for (int killed = 0; killed < 2; killed++) {
        struct sim_stored *f = *state;
        struct job_frame *frame = begin_pictures(f);
        struct unit_work work = film_work(frame->film);

        assert_int_equal(store_frame_done(f->store, &(struct frame_done){.job = 1, .epoch_floor = the_job(f)->epoch_floor, .frame = 1, .end = FRAME_END_CAP, .work = &work}, NULL),
                         STATUS_OK);
        extend(f, 64);
        if (killed)
            sim_stored_restart(f);
        else
            sim_develop(f->sim);
        assert_int_equal(the_job(f)->frames_done_count, 0);
        check_whole(f);
        sim_stored_restart(f);
        assert_int_equal(the_job(f)->state, JOB_STATE_DONE);
        sim_stored_tear_down(state);
        sim_stored_set_up(state);
    }
}

/* Of two frames one is done. Results of the old rules are not taken, and the done frame goes on. */
static void done_frames_and_late_results(void **state)
{
    struct sim_stored *f = *state;
    struct sim_worker *worker;
    size_t late = 0;

    (void)sim_submit(f->sim, 32, 32, 29, 1, 2, 0); /* its last pass is short */
    worker = sim_connect(f->sim, f->workers++, 16);
    for (int i = 0; i < 40 && the_job(f)->frames_done_count == 0; i++) {
        (void)sim_grant(f->sim, worker, 8);
        for (size_t k = 0; k < worker->unit_count; k++)
            if (!worker->units[k].sent)
                (void)sim_send(f->sim, worker, k, 100);
        tick(f);
        sim_develop(f->sim);
    }
    assert_int_equal(the_job(f)->frames_done_count, 1);
    (void)sim_grant(f->sim, worker, 8);
    extend(f, 64);
    assert_int_equal(the_job(f)->frames_done_count, 0);
    for (size_t k = 0; k < worker->unit_count; k++)
        if (!worker->units[k].sent) {
            assert_int_equal(sim_send(f->sim, worker, k, 100), MERGE_UNWANTED);
            late++;
        }
    assert_true(late > 0 || worker->unit_count == 0); /* revoked ones are forgotten */
    check_whole(f);
}

/* The films of done frames are gone: they keep their pictures, and count as cut short by the old cap. */
static void frames_without_films_stay(void **state)
{
    struct sim_stored *f = *state;
    struct sim_worker *worker = sim_connect(f->sim, f->workers++, 16);

    (void)sim_submit(f->sim, 32, 32, 32, 1, 2, 0);
    f->sim->farm.discards_films = 1;
    for (int i = 0; i < 40 && the_job(f)->frames_done_count == 0; i++) {
        (void)sim_grant(f->sim, worker, 8);
        for (size_t k = 0; k < worker->unit_count; k++)
            if (!worker->units[k].sent)
                (void)sim_send(f->sim, worker, k, 100);
        tick(f);
        sim_develop(f->sim);
    }
    store_film_remove(f->store, 1, 1);
    extend(f, 64);
    for (int restarted = 0; restarted < 2; restarted++) {
        assert_int_equal(the_job(f)->frames_done_count, 1);
        assert_int_equal(the_job(f)->cut_count, 1);
        assert_int_equal(the_job(f)->cuts[0].coverage.most, 32);
        assert_int_equal(the_job(f)->samples_done, 32 * 32 * 32);
        if (!restarted)
            sim_stored_restart(f);
    }
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, sim_stored_set_up, sim_stored_tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        TEST(pictures_of_the_old_rules_do_not_count),
        TEST(pictures_in_the_making_are_no_wait),
        TEST(pictures_that_were_just_noted_do_not_count),
        TEST(done_frames_and_late_results),
        TEST(frames_without_films_stay),
    };
    return cmocka_run_group_tests_name("retarget", tests, NULL, NULL);
}
