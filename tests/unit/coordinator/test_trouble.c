/* Trouble: waits that grow to a limit and never end; a farm whose store fails, under a simulated clock. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/system/clock.h"
#include "common/system/file.h"
#include "common/base/memory.h"
#include "coordinator/steering/report.h"
#include "coordinator/store/files/reserve.h"
#include "tests/support/scratch.h"
#include "tests/support/sim_farm.h"

/* A folder in the place of a file that the store writes, which keeps even root from it. */
static void block(const char *name)
{
    (void)unlink(path_of(name));
    assert_int_equal(mkdir(path_of(name), 0700), 0);
}

static void unblock(const char *name) { assert_int_equal(rmdir(path_of(name)), 0); }

static void waits_grow_and_never_end(void **state)
{
    struct trouble trouble = {0};
    uint64_t now_ns = 7, lasted_ns, day_ns = 24 * 3600 * NS_PER_SECOND;
    static const uint64_t waits_ms[] = {250, 500, 1000, 2000, 4000, 5000, 5000};

    (void)state;
    assert_false(trouble_is(&trouble));
    assert_false(trouble_waits(&trouble, now_ns));
    assert_false(trouble_end(&trouble, now_ns, &lasted_ns));
    for (size_t i = 0; i < sizeof waits_ms / sizeof waits_ms[0]; i++) {
        assert_int_equal(trouble_note(&trouble, "no room", now_ns), i == 0);
        assert_int_equal(trouble.next_ns, now_ns + waits_ms[i] * NS_PER_MS);
        assert_true(trouble_waits(&trouble, trouble.next_ns - 1));
        assert_false(trouble_waits(&trouble, trouble.next_ns));
        now_ns = trouble.next_ns;
    }
    now_ns += 400 * day_ns;
    assert_false(trouble_note(&trouble, "still no room", now_ns));
    assert_string_equal(trouble.text, "still no room");
    assert_int_equal(trouble.next_ns, now_ns + 5000 * NS_PER_MS);
    assert_true(trouble_end(&trouble, now_ns, &lasted_ns));
    assert_true(lasted_ns > 400 * day_ns);
    assert_false(trouble_is(&trouble));
}

/* While the store fails: no new films, no submits, a limited number of units of open films; the reason
 * in every job's report; and all of it over by itself, however long it took. */
static void a_store_that_fails_pauses_the_farm(void **state)
{
    struct store *store = sim_store(folder);
    struct sim *sim = sim_new(store, 1);
    struct job_report *report = malloc(sizeof *report);
    struct sim_worker *worker;
    struct job *job, *behind, *refused;
    struct error err = {0};

    (void)state;
    assert_non_null(report);
    worker = sim_connect(sim, 0, 4);
    job = sim_submit(sim, 16, 16, 100, 1, 2, 0);
    behind = sim_submit(sim, 16, 16, 1, 1, 1, 0);
    assert_int_equal(sim_grant(sim, worker, 1), 1);
    block("probe");
    film_file_fault(0);
    sim_send(sim, worker, 0, 100);
    sim_commit(sim);
    film_file_fault(-1);
    assert_true(trouble_is(&sim->farm.trouble));
    assert_int_equal(sim->acks, 0);
    for (int i = 0; i < 2; i++) {
        job_report_make(report, &sim->farm, i ? behind : job, sim->now_ns);
        assert_non_null(strstr(report->state_text, "the store cannot be used"));
        assert_non_null(strstr(report->state_text, "probe: cannot be written: Is a directory"));
    }
    refused = sim_job(16, 16, 1, 1, 1, 0);
    assert_int_equal(farm_submit(&sim->farm, refused, &err), STATUS_ERR_IO);
    assert_non_null(strstr(err.text, "try again"));
    job_free(refused);
    /* Of the open film, but of no other. */
    assert_true(sim_grant(sim, worker, 4) > 0);
    assert_null(job->frames->next);
    assert_null(behind->frames);
    for (int day = 0; day < 3; day++) {
        sim->now_ns += 24 * 3600 * NS_PER_SECOND;
        farm_tick(&sim->farm, sim->now_ns);
        assert_true(trouble_is(&sim->farm.trouble));
        assert_int_equal(job->state, JOB_STATE_RUNNING);
        assert_int_equal(behind->state, JOB_STATE_QUEUED);
        assert_null(merge_commit_begin(&sim->farm, sim->now_ns));
    }
    unblock("probe");
    farm_tick(&sim->farm, sim->now_ns); /* too early */
    assert_true(trouble_is(&sim->farm.trouble));
    sim->now_ns += TROUBLE_LAST_MS * NS_PER_MS;
    farm_tick(&sim->farm, sim->now_ns);
    assert_false(trouble_is(&sim->farm.trouble));
    sim->now_ns += TROUBLE_LAST_MS * NS_PER_MS;
    sim_commit(sim);
    assert_int_equal(sim->acks, 1);
    worker->unit_count = 0;
    while (job->state != JOB_STATE_DONE || behind->state != JOB_STATE_DONE) {
        sim->now_ns += NS_PER_SECOND;
        farm_tick(&sim->farm, sim->now_ns);
        sim_grant(sim, worker, 36);
        for (size_t i = worker->unit_count; i-- > 0;)
            sim_send(sim, worker, i, 100);
        worker->unit_count = 0;
        sim_commit(sim);
        sim_develop(sim);
    }
    assert_int_equal(sim->wrong_frames, 0);
    sim_free(sim);
    free(report);
    store_close(store);
}

/* No more results of a film in trouble are on their way than the limit and one lease. */
static void results_in_trouble_are_limited(void **state)
{
    struct sim *sim = sim_new(NULL, 1);
    struct sim_worker *worker;
    struct job *job;
    size_t lent = 0, got;

    (void)state;
    worker = sim_connect(sim, 0, 4096);
    job = sim_submit(sim, 2048, 1024, 100, 1, 1, 0); /* 8192 tiles */
    assert_true(sim_grant(sim, worker, 1) == 1);
    assert_true(trouble_note(&job->frames->trouble, "no room", sim->now_ns));
    do {
        worker->unit_count = 0; /* lent, and on their way */
        got = sim_grant(sim, worker, SIM_UNITS_MAX / 2);
        worker->worker.held.units = 0; /* it could hold any number */
        lent += got;
    } while (got > 0);
    assert_true(lent >= TROUBLE_RESULTS_MAX - 1);
    assert_true(lent <= TROUBLE_RESULTS_MAX + SIM_UNITS_MAX / 2);
    assert_true(job->frames->outstanding_count >= TROUBLE_RESULTS_MAX);
    worker->worker.held.units = job->frames->outstanding_count;
    sim_free(sim);
}

/* A result whose film cannot be opened stays with its worker; it may come again when it can. */
static void results_without_a_film_are_deferred(void **state)
{
    struct store *store = sim_store(folder);
    struct sim *sim = sim_new(store, 1);
    struct sim_worker *worker;
    struct job *job;

    (void)state;
    worker = sim_connect(sim, 0, 4);
    job = sim_submit(sim, 16, 16, 1, 1, 1, 0);
    assert_int_equal(sim_grant(sim, worker, 1), 1);
    sim_release(sim); /* the worker keeps its unit */
    store_close(store);
    store = sim_store(folder);
    store_films_remove(store, 1);
    assert_int_equal(file_write_private(path_of("films/1"), "x", 1, NULL), STATUS_OK);
    sim_init(sim, store, 2);
    job = queue_find(&sim->farm.queue, 1);
    worker = sim_connect(sim, 0, 4);
    assert_int_equal(worker->unit_count, 1);
    assert_int_equal(sim_send(sim, worker, 0, 100), MERGE_DEFERRED);
    assert_int_equal(job->state, JOB_STATE_RUNNING);
    assert_false(farm_takes_again(&sim->farm, 1));
    assert_non_null(strstr(job->trouble.text, "frame 1 cannot be opened"));
    assert_int_equal(unlink(path_of("films/1")), 0);
    sim->now_ns += TROUBLE_LAST_MS * NS_PER_MS;
    farm_tick(&sim->farm, sim->now_ns);
    assert_true(farm_takes_again(&sim->farm, 1));
    assert_int_equal(sim_send(sim, worker, 0, 100), MERGE_PENDING);
    sim_commit(sim);
    sim_develop(sim);
    assert_int_equal(job->state, JOB_STATE_DONE);
    assert_int_equal(sim->wrong_frames, 0);
    sim_free(sim);
    store_close(store);
}

/* Every allocation of opening a film and of ending a job may fail: no job fails for it. */
static void no_memory_is_waited_for(void **state)
{
    struct store *store = sim_store(folder);
    struct sim *sim = sim_new(store, 1);
    struct sim_worker *worker;
    long successes = 0, failures;

    (void)state;
    worker = sim_connect(sim, 0, 4);
    do {
        struct job *job = sim_submit(sim, 16, 16, 1, 1, 1, 0);
        mem_fault_arm(successes++, 1);
        sim_grant(sim, worker, 1);
        failures = mem_fault_count();
        mem_fault_arm(-1, 0);
        if (worker->unit_count == 0) {
            sim->now_ns += TROUBLE_LAST_MS * NS_PER_MS;
            farm_tick(&sim->farm, sim->now_ns);
            assert_int_equal(sim_grant(sim, worker, 1), 1);
        }
        sim_send(sim, worker, 0, 100);
        worker->unit_count = 0;
        sim_commit(sim);
        sim_develop(sim);
        sim->now_ns += TROUBLE_LAST_MS * NS_PER_MS;
        farm_tick(&sim->farm, sim->now_ns);
        if (job->state != JOB_STATE_DONE)
            fail_msg("allocation %ld: the job is %s: %s", successes, job_state_word(job->state), job->state_text);
    } while (failures > 0);
    assert_true(successes > 10);
    assert_int_equal(sim->wrong_frames, 0);
    sim_free(sim);
    store_close(store);
}

/* Films of a job that ended are removed at the start, where a kill came between; others are not. */
static void films_that_were_left_are_removed(void **state)
{
    struct store *store = sim_store(folder);
    struct sim *sim = sim_new(store, 1);
    struct job *ended, *waiting;

    (void)state;
    ended = sim_submit(sim, 16, 16, 1, 1, 1, 0);
    waiting = sim_submit(sim, 16, 16, 1, 1, 1, 0);
    farm_cancel(&sim->farm, ended, 1, sim->now_ns);
    store_settle(store); /* it removes their films itself: the kill comes after that */
    assert_int_equal(ended->id, 1);
    assert_int_equal(waiting->id, 2);
    for (int id = 1; id <= 3; id++) {
        char name[64];
        snprintf(name, sizeof name, "films/%d", id);
        assert_int_equal(file_make_private_folder(path_of(name), NULL), STATUS_OK);
        snprintf(name, sizeof name, "films/%d/frame-0001.film", id);
        assert_int_equal(file_write_private(path_of(name), "x", 1, NULL), STATUS_OK);
    }
    sim_release(sim);
    store_close(store);
    store = sim_store(folder);
    sim_init(sim, store, 2);
    assert_false(file_exists(path_of("films/1")));
    assert_true(file_exists(path_of("films/2/frame-0001.film")));
    assert_true(file_exists(path_of("films/3/frame-0001.film"))); /* of a job that is not known */
    sim_free(sim);
    store_close(store);
}

static void a_replaced_folder_is_not_written_to(void **state)
{
    struct store *store = sim_store(folder);
    struct error err = {0};
    struct stat info;

    (void)state;
    assert_int_equal(store_check(store, &err), STATUS_OK);
    assert_int_equal(unlink(path_of("lock")), 0);
    assert_int_equal(store_check(store, &err), STATUS_ERR_IO);
    assert_int_equal(file_write_private(path_of("lock"), "1", 1, NULL), STATUS_OK);
    assert_int_equal(store_check(store, &err), STATUS_ERR_IO);
    assert_non_null(strstr(err.text, "unmounted"));
    assert_int_equal(stat(path_of("probe"), &info), -1);
    store_close(store);
}

static void the_reserve_is_held_and_given(void **state)
{
    struct error err = {0};
    struct stat info;
    struct rlimit old, few;
    int fd = open("/dev/null", O_RDONLY);

    (void)state;
    assert_int_equal(reserve_hold(folder, &err), STATUS_OK);
    assert_int_equal(stat(path_of("reserve"), &info), 0);
    assert_int_equal(info.st_size, RESERVE_BYTES);
    assert_true((uint64_t)info.st_blocks * 512 >= RESERVE_BYTES);
    assert_int_equal(reserve_hold(folder, &err), STATUS_OK);
    assert_true(reserve_release(folder));
    assert_false(reserve_release(folder));
    assert_int_equal(reserve_hold("/proc/no", &err), STATUS_ERR_IO);

    assert_true(fd >= 0 && fd < 64);
    assert_int_equal(getrlimit(RLIMIT_NOFILE, &old), 0);
    few = old;
    few.rlim_cur = 256;
    assert_int_equal(setrlimit(RLIMIT_NOFILE, &few), 0);
    assert_true(reserve_allows(191));
    assert_false(reserve_allows(192));
    assert_false(reserve_is_short());
    assert_int_equal(dup2(fd, 127), 127);
    for (int i = fd + 1; i < 127; i++)
        (void)dup2(fd, i);
    assert_true(reserve_is_short()); /* 128 is the lowest that is free */
    close(126);
    assert_false(reserve_is_short());
    for (int i = fd + 1; i <= 127; i++)
        close(i);
    close(fd);
    assert_int_equal(setrlimit(RLIMIT_NOFILE, &old), 0);
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, folder_set_up, folder_tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        TEST(waits_grow_and_never_end),
        TEST(a_store_that_fails_pauses_the_farm),
        TEST(results_in_trouble_are_limited),
        TEST(results_without_a_film_are_deferred),
        TEST(no_memory_is_waited_for),
        TEST(films_that_were_left_are_removed),
        TEST(a_replaced_folder_is_not_written_to),
        TEST(the_reserve_is_held_and_given),
    };
    return cmocka_run_group_tests_name("trouble", tests, NULL, NULL);
}
