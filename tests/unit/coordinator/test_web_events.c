/* What changed on the farm: numbers, resuming, forgetting. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/memory.h"
#include "web/base/events.h"

static void add(struct events *e, const char *json) { events_add(e, "job", json, strlen(json)); }

static void each_listener_gets_each_event_once(void **state)
{
    struct events e;
    const struct event *got;
    uint64_t early = 0, late;

    (void)state;
    events_init(&e, 7);
    assert_int_equal(events_next(&e, &early, &got), EVENTS_NONE);
    add(&e, "{\"a\":1}");
    late = e.last;
    add(&e, "{\"a\":2}");
    assert_int_equal(events_next(&e, &early, &got), EVENTS_NEXT);
    assert_memory_equal(got->json, "{\"a\":1}", got->size);
    assert_int_equal(events_next(&e, &early, &got), EVENTS_NEXT);
    assert_memory_equal(got->json, "{\"a\":2}", got->size);
    assert_int_equal(events_next(&e, &early, &got), EVENTS_NONE);
    assert_int_equal(events_next(&e, &late, &got), EVENTS_NEXT);
    assert_memory_equal(got->json, "{\"a\":2}", got->size);
    events_release(&e);
}

static void a_slow_listener_is_reset_and_memory_is_bounded(void **state)
{
    struct events e;
    const struct event *got;
    uint64_t slow = 0, oldest = 1;
    char *large = calloc(1, 1 << 20);

    (void)state;
    events_init(&e, 7);
    for (int i = 0; i < EVENTS_KEPT + 1; i++)
        add(&e, "{}");
    assert_int_equal(e.count, EVENTS_KEPT);
    assert_int_equal(events_next(&e, &slow, &got), EVENTS_RESET);
    assert_int_equal(slow, e.last);
    assert_int_equal(events_next(&e, &slow, &got), EVENTS_NONE);
    assert_int_equal(events_next(&e, &oldest, &got), EVENTS_NEXT);
    assert_int_equal(got->seq, 2);
    for (int i = 0; i < 40; i++)
        events_add(&e, "job", large, 1 << 20);
    assert_true(e.bytes <= EVENTS_BYTES);
    assert_true(e.count >= 15);
    events_release(&e);
    assert_int_equal(e.bytes, 0);
    free(large);
}

/* One event above the limit is kept: whoever listens gets it. */
static void the_newest_is_kept(void **state)
{
    struct events e;
    const struct event *got;
    uint64_t seq = 1;
    char *huge = calloc(1, EVENTS_BYTES + 1);

    (void)state;
    events_init(&e, 7);
    add(&e, "{}");
    events_add(&e, "workers", huge, EVENTS_BYTES + 1);
    assert_int_equal(e.count, 1);
    assert_int_equal(events_next(&e, &seq, &got), EVENTS_NEXT);
    assert_int_equal(got->size, EVENTS_BYTES + 1);
    events_release(&e);
    free(huge);
}

static void what_was_left_out_is_not_hidden(void **state)
{
    struct events e;
    const struct event *got;
    uint64_t seq;

    (void)state;
    events_init(&e, 7);
    add(&e, "{}");
    seq = e.last;
    events_skip(&e);
    assert_int_equal(events_next(&e, &seq, &got), EVENTS_RESET);
    add(&e, "{\"b\":1}");
    assert_int_equal(events_next(&e, &seq, &got), EVENTS_NEXT);
    assert_int_equal(got->seq, e.last);
    events_release(&e);
}

static void an_event_without_memory_counts_as_left_out(void **state)
{
    struct events e;
    const struct event *got;
    uint64_t seq;

    (void)state;
    events_init(&e, 7);
    add(&e, "{}");
    seq = e.last;
    mem_fault_arm(0, 1);
    add(&e, "{}");
    mem_fault_arm(-1, 0);
    assert_int_equal(events_next(&e, &seq, &got), EVENTS_RESET);
    events_release(&e);
}

static void ids_are_of_one_run(void **state)
{
    static const char *const strangers[] = {"", "-", "7", "7-", "7-3x", "7-03", "8-3", "07-3", "7-4", "7--3", " 7-3",
                                            "7-18446744073709551617"};
    struct events e;
    uint64_t seq;
    char id[EVENT_ID_SIZE];

    (void)state;
    events_init(&e, 7);
    for (int i = 0; i < 3; i++)
        add(&e, "{}");
    events_id(&e, 3, id);
    assert_string_equal(id, "7-3");
    assert_true(events_parse(&e, id, &seq));
    assert_int_equal(seq, 3);
    assert_true(events_parse(&e, "7-0", &seq));
    assert_false(events_parse(&e, NULL, &seq));
    for (size_t i = 0; i < sizeof strangers / sizeof *strangers; i++)
        if (events_parse(&e, strangers[i], &seq))
            fail_msg("'%s' is taken", strangers[i]);
    events_release(&e);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(each_listener_gets_each_event_once),
        cmocka_unit_test(a_slow_listener_is_reset_and_memory_is_bounded),
        cmocka_unit_test(the_newest_is_kept),
        cmocka_unit_test(what_was_left_out_is_not_hidden),
        cmocka_unit_test(an_event_without_memory_counts_as_left_out),
        cmocka_unit_test(ids_are_of_one_run),
    };
    return cmocka_run_group_tests_name("web_events", tests, NULL, NULL);
}
