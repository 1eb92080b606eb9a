/* The program of --on-event: what it may be, what it gets, and the queue over restarts. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>

#include "common/system/log.h"
#include "coordinator/events/event_program.h"
#include "coordinator/events/event_run.h"
#include "coordinator/events/events.h"
#include "coordinator/store/store_web.h"
#include "tests/support/scratch.h"
#include "tests/support/sim_farm.h"

/* A script in the scratch folder; its path until the next call of path_of. */
static char *script(const char *text)
{
    char *path = path_of("on-event");
    FILE *file = fopen(path, "w");

    assert_non_null(file);
    fprintf(file, "#!/bin/sh\ncd %s\n%s\n", folder, text);
    fclose(file);
    assert_int_equal(chmod(path, 0700), 0);
    return path;
}

static void only_what_can_be_executed(void **state)
{
    struct error err = {0};
    char *path = script("exit 0");

    (void)state;
    assert_int_equal(event_program_check(path, &err), STATUS_OK);
    assert_int_equal(chmod(path, 0600), 0);
    assert_int_equal(event_program_check(path, &err), STATUS_ERR_INPUT);
    assert_non_null(strstr(err.text, path));
    assert_int_equal(event_program_check(folder, &err), STATUS_ERR_INPUT);
    assert_int_equal(event_program_check(path_of("none"), &err), STATUS_ERR_INPUT);
}

static void the_end_of_a_run_says_what_becomes_of_its_event(void **state)
{
    static const struct {
        const char *text, *how;
        enum event_fate fate;
    } runs[] = {
        {"exit 0", "exit status 0", EVENT_FATE_TAKEN},
        {"exit 75", "exit status 75", EVENT_FATE_AGAIN},
        {"exit 1", "exit status 1", EVENT_FATE_REFUSED},
        {"kill -SEGV $$", "ended by signal 11", EVENT_FATE_AGAIN},
        {"[ \"$(cat)\" = '{\"a\": 1}' ]", "exit status 0", EVENT_FATE_TAKEN},
        {"printf 'one\\n\\ttwo\\n\\n' >&2", "exit status 0:  two", EVENT_FATE_TAKEN},
        {"printf two >&2; exit 2", "exit status 2: two", EVENT_FATE_REFUSED},
        {"exec 2>&-; sleep 0.1; exit 3", "exit status 3", EVENT_FATE_REFUSED},
        {"sleep 5 & exit 4", "exit status 4", EVENT_FATE_REFUSED}, /* which holds its standard error */
        {"head -c 100000 /dev/zero >&2; echo >&2; echo last >&2", "exit status 0: last", EVENT_FATE_TAKEN},
    };
    char how[EVENT_HOW_SIZE];
    atomic_int ending = 0;

    (void)state;
    for (size_t i = 0; i < sizeof runs / sizeof *runs; i++) {
        assert_int_equal(event_run(script(runs[i].text), "{\"a\": 1}\n", &ending, how), runs[i].fate);
        assert_string_equal(how, runs[i].how);
    }
    assert_int_equal(event_run(path_of("none"), "{}\n", &ending, how), EVENT_FATE_AGAIN);
    assert_non_null(strstr(how, "cannot be run"));
    ending = 1;
    assert_int_equal(event_run(script("sleep 100"), "{}\n", &ending, how), EVENT_FATE_AGAIN);
    assert_string_equal(how, "ended by signal 15");
}

static struct event_counts await(struct event_program *program, uint64_t runs)
{
    const struct timespec pause = {0, 2000000};
    struct event_counts counts;

    do {
        nanosleep(&pause, NULL);
        counts = event_program_counts(program);
    } while (counts.taken + counts.failed + counts.again < runs);
    return counts;
}

/* The lines that the script kept, as JSON. */
static json_t *said(const char *name)
{
    json_t *all = json_array(), *one;
    FILE *file = fopen(path_of(name), "r");

    assert_non_null(file);
    while ((one = json_loadf(file, JSON_DISABLE_EOF_CHECK, NULL)))
        json_array_append_new(all, one);
    fclose(file);
    return all;
}

static const char *text_at(const json_t *all, size_t at, const char *name)
{
    return json_string_value(json_object_get(json_array_get(all, at), name));
}

static void events_are_json_in_their_order(void **state)
{
    struct store *store = sim_store(folder);
    struct job *job = sim_job(16, 16, 1, 1, 3, 0);
    struct trouble trouble = {.text = "no \"room\"", .since_ns = 1};
    struct event_program *program;
    char long_text[EVENT_JSON_MAX + 1];
    struct error err = {0};
    int told = 0;
    json_t *all;

    (void)state;
    assert_int_equal(event_program_open(&program, store, script("cat >>said"), &err), STATUS_OK);
    snprintf(job->name, sizeof job->name, "a \"b\"\xff");
    job->id = 7;
    job->state = JOB_STATE_RUNNING;
    events_job_state(program, job, "http://page");
    job->state = JOB_STATE_CANCELLED;
    events_job_state(program, job, "http://page");
    job->state = JOB_STATE_DONE;
    events_job_state(program, job, "http://page");
    job->state = JOB_STATE_PARKED;
    events_job_state(program, job, "");
    events_store(program, &trouble, &told, 1 + EVENT_STORE_S * UINT64_C(1000000000));
    events_store(program, &trouble, &told, 2 + EVENT_STORE_S * UINT64_C(1000000000));
    events_store(program, &trouble, &told, 3 + EVENT_STORE_S * UINT64_C(1000000000));
    trouble.text[0] = 0;
    events_store(program, &trouble, &told, 4 + EVENT_STORE_S * UINT64_C(1000000000));
    memset(long_text, ' ', sizeof long_text - 1);
    long_text[sizeof long_text - 1] = 0;
    event_program_send(program, "job-done", long_text);
    assert_int_equal(await(program, 4).taken, 4);
    assert_int_equal(event_program_counts(program).dropped, 1);
    all = said("said");
    assert_int_equal(json_array_size(all), 4);
    assert_string_equal(text_at(all, 0, "event"), "job-done");
    assert_string_equal(text_at(all, 0, "name"), "a \"b\"\xef\xbf\xbd");
    assert_string_equal(text_at(all, 0, "url"), "http://page/#/job/7");
    assert_string_equal(text_at(all, 1, "event"), "job-parked");
    assert_null(text_at(all, 1, "url"));
    assert_string_equal(text_at(all, 2, "event"), "store-unusable");
    assert_string_equal(text_at(all, 2, "text"), "no \"room\"");
    assert_string_equal(text_at(all, 3, "event"), "store-usable");
    assert_int_equal(strlen(text_at(all, 0, "delivery")), 16);
    assert_string_not_equal(text_at(all, 0, "delivery"), text_at(all, 1, "delivery"));
    json_decref(all);
    event_program_close(program);
    job_free(job);
    store_close(store);
}

static status expect_job(void *user, uint64_t id, const char *json, struct error *err)
{
    uint64_t *next = user;
    json_t *event = json_loads(json, 0, NULL);

    (void)id;
    (void)err;
    assert_int_equal(json_integer_value(json_object_get(event, "job")), *next);
    json_decref(event);
    ++*next;
    return STATUS_OK;
}

/* Events wait, survive, are bounded, and go when they are taken. */
static void events_wait_are_bounded_and_survive(void **state)
{
    struct store *store = sim_store(folder);
    struct event_program *program;
    struct event_counts counts;
    struct error err = {0};
    char trouble[64], fields[32];
    uint64_t next_job = 6;

    (void)state;
    assert_int_equal(event_program_open(&program, store, script("echo busy >&2; exit 75"), &err), STATUS_OK);
    event_program_send(program, "job-done", "\"job\": 1");
    event_program_send(program, "job-done", "\"job\": 2");
    counts = await(program, 1);
    assert_int_equal(counts.waiting, 2);
    assert_int_equal(counts.again, 1);
    event_program_trouble(program, trouble, sizeof trouble);
    assert_string_equal(trouble, "exit status 75: busy");
    event_program_close(program);
    store_settle(store);

    assert_int_equal(event_program_open(&program, store, script("exit 75"), &err), STATUS_OK);
    assert_int_equal(event_program_counts(program).waiting, 2);
    (void)await(program, 1); /* and now it waits 2 s */
    for (int i = 0; i < EVENTS_WAITING_MAX + 3; i++) {
        snprintf(fields, sizeof fields, "\"job\": %d", i + 3);
        event_program_send(program, "job-done", fields);
    }
    counts = event_program_counts(program);
    assert_int_equal(counts.waiting, EVENTS_WAITING_MAX);
    assert_int_equal(counts.dropped, 5);
    event_program_close(program);
    store_settle(store);

    assert_int_equal(store_waiting_events_load(store, expect_job, &next_job, &err), STATUS_OK);
    assert_int_equal(next_job, 6 + EVENTS_WAITING_MAX);
    for (uint64_t id = 0; id < EVENTS_WAITING_MAX + 6; id++)
        if (id != 7)
            assert_int_equal(store_waiting_event_remove(store, id, &err), STATUS_OK);
    store_settle(store);

    assert_int_equal(event_program_open(&program, store, script("exit 0"), &err), STATUS_OK);
    assert_int_equal(await(program, 1).taken, 1);
    assert_int_equal(event_program_counts(program).waiting, 0);
    event_program_close(program);
    store_settle(store);

    assert_int_equal(event_program_open(&program, store, script("exit 75"), &err), STATUS_OK);
    assert_int_equal(event_program_counts(program).waiting, 0);
    event_program_close(program);
    store_close(store);
}

#define EVENT_TEST(name) cmocka_unit_test_setup_teardown(name, folder_set_up, folder_tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        EVENT_TEST(only_what_can_be_executed),
        EVENT_TEST(the_end_of_a_run_says_what_becomes_of_its_event),
        EVENT_TEST(events_are_json_in_their_order),
        EVENT_TEST(events_wait_are_bounded_and_survive),
    };
    log_setup("test", LOG_LEVEL_ERROR);
    return cmocka_run_group_tests(tests, NULL, NULL);
}
