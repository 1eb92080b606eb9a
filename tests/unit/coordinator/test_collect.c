/* Collecting with limits that allow nothing, in every state of a job: what it needs stays. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/system/clock.h"
#include "common/system/file.h"
#include "common/base/memory.h"
#include "coordinator/farm/closing.h"
#include "coordinator/steering/collect.h"
#include "coordinator/store/store_hold.h"
#include "tests/support/sim_farm.h"
#include "tests/support/steering.h"

static uint64_t read_job; /* somebody fetches its pictures; 0: nobody does */

static int is_read(void *user, uint64_t job)
{
    (void)user;
    return job == read_job;
}

/* Carry out a plan by what the store's folders hold now; how much was done. */
static size_t collect(struct sim_stored *f, const struct retention_policy *policy)
{
    struct farm *farm = &f->sim->farm;
    struct retention_plan plan = {0};
    struct footprint footprint = {0};
    struct error err = {0};
    size_t done = 0;

    assert_int_equal(store_await_saves(f->store, &err), STATUS_OK);
    assert_int_equal(footprint_measure(&footprint, f->folder, &err), STATUS_OK);
    assert_int_equal(collect_plan(&plan, farm, policy, &footprint, NULL, 0, is_read, NULL, &err), STATUS_OK);
    for (size_t i = 0; i < plan.count; i++) {
        enum collect_result result;
        status s = collect_step(farm, &plan, &plan.steps[i], policy, is_read, NULL, f->sim->now_ns, &result, &err);
        assert_true(s == STATUS_OK || s == STATUS_ERR_REFUSED);
        done += result != COLLECT_NOTHING;
    }
    footprint_release(&footprint);
    retention_plan_release(&plan);
    return done;
}

static struct retention_policy nothing_is_allowed(void)
{
    struct retention_policy policy = RETENTION_POLICY_DEFAULT;

    policy.keep_s = 0;
    policy.store.bytes = policy.owner_limit = 1;
    return policy;
}

static void tick(struct sim_stored *f)
{
    f->sim->now_ns += NS_PER_SECOND;
    sim_freeze(f->sim);
    sim_commit(f->sim);
    farm_tick(&f->sim->farm, f->sim->now_ns);
}

/* Render what is lent, so many rounds. */
static void render(struct sim_stored *f, int rounds)
{
    struct sim_worker *worker = sim_connect(f->sim, f->workers++, 16);

    for (int i = 0; i < rounds; i++) {
        while (sim_grant(f->sim, worker, 64) > 0)
            for (size_t k = 0; k < worker->unit_count; k++)
                if (!worker->units[k].sent)
                    (void)sim_send(f->sim, worker, k, 100);
        tick(f);
        sim_develop(f->sim);
        while (sim_make_picture(f->sim))
            ;
    }
    sim_disconnect(f->sim, f->workers - 1);
}

/* Two frames of 4 tiles; a part of frame 1 is on disk. */
static struct job *make(struct sim_stored *f, enum job_state state)
{
    struct farm *farm = &f->sim->farm;
    struct job *job = sim_submit(f->sim, 32, 32, 32, 1, 2, 0);
    struct sim_worker *worker = sim_connect(f->sim, f->workers++, 4);
    uint64_t now_ns = f->sim->now_ns;

    assert_true(sim_grant(f->sim, worker, 8) == 8);
    for (size_t i = 0; i < 2; i++)
        assert_int_equal(sim_send(f->sim, worker, i, 100), MERGE_PENDING);
    sim_commit(f->sim);
    switch (state) {
    case JOB_STATE_QUEUED:
    case JOB_STATE_PAUSED:
        assert_int_equal(do_verb(farm, job, VERB_PAUSE, "ana@desk", now_ns, NULL), STATUS_OK);
        tick(f);
        if (state == JOB_STATE_QUEUED)
            assert_int_equal(do_verb(farm, job, VERB_RESUME, "ana@desk", now_ns, NULL), STATUS_OK);
        break;
    case JOB_STATE_PARKED:
        for (uint64_t i = 1; i < SUSPICION_DEATHS; i++)
            suspicion_add(&job->suspicion, i, now_ns, now_ns);
        closing_note_death(farm, job, &sim_connect(f->sim, f->workers++, 1)->worker, now_ns, now_ns);
        break;
    case JOB_STATE_FINISHING:
        assert_int_equal(do_verb(farm, job, VERB_FINISH, "ana@desk", now_ns, NULL), STATUS_OK);
        break;
    case JOB_STATE_CANCELLING: farm_cancel(farm, job, 0, now_ns); break;
    case JOB_STATE_CANCELLED: farm_cancel(farm, job, 1, now_ns); break;
    case JOB_STATE_FAILED: farm_fail(farm, job, now_ns, "a broken scene"); break;
    case JOB_STATE_DONE: render(f, 20); break;
    default: break;
    }
    assert_int_equal(job->state, state);
    return job;
}

static int has_folder(const struct sim_stored *f, const char *name)
{
    char path[128];
    struct stat info;

    snprintf(path, sizeof path, "%s/%s/1", f->folder, name);
    return stat(path, &info) == 0;
}

/* Go on to the end, from any state, collecting all the time. */
static void go_on(struct sim_stored *f, enum job_state from, const struct retention_policy *policy)
{
    struct job *job = f->sim->farm.queue.all[0];

    if (job->state == JOB_STATE_PAUSED || job->state == JOB_STATE_PARKED)
        assert_int_equal(do_verb(&f->sim->farm, job, VERB_RESUME, "ana@desk", f->sim->now_ns, NULL), STATUS_OK);
    for (int i = 0; i < 20 && f->sim->farm.queue.active_count > 0; i++) {
        collect(f, policy);
        render(f, 1);
    }
    job = f->sim->farm.queue.all[0];
    assert_int_equal(f->sim->wrong_frames, 0); /* the same bits */
    if (from == JOB_STATE_CANCELLING) {
        assert_int_equal(job->state, JOB_STATE_CANCELLED);
        assert_int_equal(job->frames_done_count, 1);
    } else {
        assert_int_equal(job->state, JOB_STATE_DONE);
        assert_int_equal(job->frames_done_count, from == JOB_STATE_FINISHING ? 1 : 2);
        assert_int_equal(job->cut_count, from == JOB_STATE_FINISHING ? 1 : 0);
    }
}

static void in_every_state(void **state)
{
    const struct retention_policy policy = nothing_is_allowed();
    struct sim_stored *f = *state;

    for (int from = 0; from < JOB_STATE_COUNT; from++)
        for (int killed = 0; killed < 2; killed++) {
            int has_films;

            (void)make(f, (enum job_state)from);
            has_films = has_folder(f, "films");
            collect(f, &policy);
            if (job_state_ended((enum job_state)from)) {
                assert_int_equal(f->sim->farm.queue.count, 0);
                store_settle(f->store);
                assert_false(has_folder(f, "films") || has_folder(f, "outputs"));
            } else {
                assert_int_equal(f->sim->farm.queue.all[0]->state, from);
                assert_true(has_films && has_folder(f, "films"));
                if (killed)
                    sim_stored_restart(f);
                go_on(f, (enum job_state)from, &policy);
                assert_int_equal(collect(f, &policy) > 0, 1);
                assert_int_equal(f->sim->farm.queue.count, 0);
            }
            if (killed) {
                sim_stored_restart(f);
                assert_int_equal(f->sim->farm.queue.count, 0);
            }
            sim_stored_tear_down(state);
            sim_stored_set_up(state);
            f = *state;
        }
}

/* Of a job in work only the kept films of done frames go, and it is done all the same. */
static void done_frames_of_a_running_job(void **state)
{
    const struct retention_policy policy = nothing_is_allowed();
    struct sim_stored *f = *state;
    struct job *job = sim_submit(f->sim, 32, 32, 32, 1, 2, 0);
    struct sim_worker *worker = sim_connect(f->sim, f->workers++, 1);
    char path[128];

    for (int i = 0; i < 1000 && job->frames_done_count == 0; i++) {
        if (sim_grant(f->sim, worker, 1) > 0)
            (void)sim_send(f->sim, worker, worker->unit_count - 1, 100);
        tick(f);
        collect(f, &policy);
        sim_develop(f->sim);
    }
    assert_int_equal(job->frames_done_count, 1);
    snprintf(path, sizeof path, "%s/films/1/frame-%04d.kept", f->folder, job_frame_is_done(job, 1) ? 1 : 2);
    fclose(fopen(path, "wb")); /* only its name matters */
    assert_int_equal(collect(f, &policy), 1);
    assert_int_not_equal(access(path, F_OK), 0);
    sim_stored_restart(f);
    go_on(f, JOB_STATE_RUNNING, &policy);
}

static void what_is_read_or_copied_stays(void **state)
{
    const struct retention_policy policy = nothing_is_allowed();
    struct sim_stored *f = *state;
    struct buffer picture = BUFFER_INIT;
    struct error err = {0};
    int hold;

    (void)make(f, JOB_STATE_DONE);
    buffer_append(&picture, "picture", 7);
    assert_int_equal(store_output_write(f->store, 1, 1, "png", &picture, &err), STATUS_OK);
    buffer_release(&picture);
    read_job = 1;
    assert_int_equal(collect(f, &policy), 0);
    read_job = 0;
    assert_int_equal(store_hold_begin(f->folder, &hold, &err), STATUS_OK);
    assert_int_equal(collect(f, &policy), 0);
    assert_int_equal(f->sim->farm.queue.count, 1);
    /* A person may remove it: its files wait for the end of the back-up, over a restart, too. */
    assert_int_equal(do_verb(&f->sim->farm, f->sim->farm.queue.all[0], VERB_REMOVE, "ana@desk", f->sim->now_ns, &err),
                     STATUS_OK);
    store_settle(f->store);
    assert_true(has_folder(f, "outputs"));
    sim_stored_restart(f);
    store_settle(f->store);
    assert_true(has_folder(f, "outputs"));
    store_hold_end(hold);
    store_clear_held(f->store);
    store_settle(f->store);
    assert_false(has_folder(f, "outputs") || has_folder(f, "films"));
}

/* A program that is being started has a copy of every descriptor until it runs. */
static void copies_hold_nothing(void **state)
{
    struct sim_stored *f = *state;
    struct error err = {0};
    int first, copy, second;

    assert_int_equal(store_hold_exclude(f->folder, &first, &err), STATUS_OK);
    copy = dup(first);
    store_hold_end(first);
    assert_int_equal(store_hold_exclude(f->folder, &second, &err), STATUS_OK);
    store_hold_end(second);
    close(copy);
}

/* One job's files are being removed when the next one is to go: neither takes the other for a backup, which waits for both. */
static void removals_share_the_store(void **state)
{
    struct sim_stored *f = *state;
    char *path = file_join(f->folder, "hold");
    struct error err = {0};
    int first, second, other, backup;

    assert_int_equal(store_hold_exclude(f->folder, &first, &err), STATUS_OK);
    assert_int_equal(store_hold_exclude(f->folder, &second, &err), STATUS_OK);
    other = open(path, O_RDWR | O_CLOEXEC);
    assert_true(other >= 0);
    store_hold_end(first);
    assert_int_equal(flock(other, LOCK_SH | LOCK_NB), -1);
    store_hold_end(second);
    assert_int_equal(flock(other, LOCK_SH | LOCK_NB), 0);
    close(other);
    assert_int_equal(store_hold_begin(f->folder, &backup, &err), STATUS_OK);
    assert_int_equal(store_hold_exclude(f->folder, &first, &err), STATUS_ERR_REFUSED);
    store_hold_end(first);
    store_hold_end(backup);
    assert_int_equal(store_hold_exclude(f->folder, &first, &err), STATUS_OK);
    store_hold_end(first);
    mem_free(path);
}

/* What a big job needs, and what is said to those who submit it. */
static void jobs_that_do_not_fit(void **state)
{
    struct sim_stored *f = *state;
    struct retention_policy policy = RETENTION_POLICY_DEFAULT;
    const struct footprint none = {0};
    struct job *job = sim_job(2000, 1000, 64, 1, 10, 0);
    struct error err = {0};
    uint64_t films = 10ull * 2000 * 1000 * 72, all = retention_job_bytes(job, 1);

    assert_in_range(all, films / 2, 2 * films);
    assert_true(retention_job_bytes(job, 0) < all - films / 4);
    assert_int_equal(collect_check_room(&f->sim->farm, &policy, &none, job, 0, &err), STATUS_OK);
    policy.store.bytes = retention_job_bytes(job, 0);
    assert_int_equal(collect_check_room(&f->sim->farm, &policy, &none, job, 0, &err), STATUS_OK);
    policy.store.bytes--;
    assert_int_equal(collect_check_room(&f->sim->farm, &policy, &none, job, 0, &err), STATUS_ERR_LIMIT);
    assert_non_null(strstr(err.text, "--force"));
    assert_int_equal(collect_check_room(&f->sim->farm, &policy, &none, job, 1, &err), STATUS_OK);
    policy.owner_limit = retention_job_bytes(job, 0) - 1;
    assert_int_equal(collect_check_room(&f->sim->farm, &policy, &none, job, 1, &err), STATUS_ERR_LIMIT);
    assert_non_null(strstr(err.text, "--owner-limit"));
    job_free(job);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(in_every_state, sim_stored_set_up, sim_stored_tear_down),
        cmocka_unit_test_setup_teardown(done_frames_of_a_running_job, sim_stored_set_up,
                                        sim_stored_tear_down),
        cmocka_unit_test_setup_teardown(what_is_read_or_copied_stays, sim_stored_set_up,
                                        sim_stored_tear_down),
        cmocka_unit_test_setup_teardown(copies_hold_nothing, sim_stored_set_up, sim_stored_tear_down),
        cmocka_unit_test_setup_teardown(removals_share_the_store, sim_stored_set_up, sim_stored_tear_down),
        cmocka_unit_test_setup_teardown(jobs_that_do_not_fit, sim_stored_set_up,
                                        sim_stored_tear_down),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
