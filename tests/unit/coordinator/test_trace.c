/* The trace: limits, pages, and workers' clocks. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "common/system/clock.h"
#include "coordinator/frame/trace.h"

static void add(struct trace *trace, uint64_t job, uint32_t tile)
{
    const struct trace_event event = {.kind = TRACE_COMMIT, .tile = tile, .begin_ns = tile, .end_ns = tile + 1};

    trace_add(trace, job, &event);
}

static void pages_have_every_event_once(void **state)
{
    struct trace trace = {0};
    struct trace_event page[100];
    uint64_t first, lost, after = 0, seen[2] = {0};

    (void)state;
    for (uint32_t i = 1; i <= 1000; i++) {
        add(&trace, 7, i);
        add(&trace, 3, 1000 + i);
    }
    for (int k = 0; k < 2; k++, after = 0) {
        size_t count;
        while ((count = trace_read(&trace, k ? 3 : 7, after, page, 100, &first, &lost)) > 0) {
            assert_true(first == after + 1 && lost == 0);
            for (size_t i = 0; i < count; i++)
                assert_int_equal(page[i].tile, (k ? 1000 : 0) + ++seen[k]);
            after = first + count - 1;
        }
        assert_int_equal(seen[k], 1000);
    }
    assert_int_equal(trace_read(&trace, 5, 0, page, 100, &first, &lost), 0);
    trace_forget(&trace, 7);
    assert_int_equal(trace_read(&trace, 7, 0, page, 100, &first, &lost), 0);
    assert_int_equal(trace_read(&trace, 3, 999, page, 100, &first, &lost), 1);
    trace_release(&trace);
}

static void a_long_job_keeps_its_newest(void **state)
{
    const uint32_t kept = TRACE_JOB_CHUNKS * TRACE_CHUNK_EVENTS, more = TRACE_CHUNK_EVENTS + 3;
    struct trace trace = {0};
    struct trace_event page[4];
    uint64_t first, lost;

    (void)state;
    add(&trace, 1, 1);
    for (uint32_t i = 1; i <= kept + more; i++)
        add(&trace, 2, i);
    assert_int_equal(trace_read(&trace, 2, 0, page, 4, &first, &lost), 4);
    assert_int_equal(lost, 2 * TRACE_CHUNK_EVENTS); /* whole chunks */
    assert_int_equal(first, lost + 1);
    assert_int_equal(page[0].tile, first);
    assert_int_equal(trace_read(&trace, 2, kept + more - 1, page, 4, &first, &lost), 1);
    assert_int_equal(page[0].tile, kept + more);
    assert_int_equal(trace_read(&trace, 1, 0, page, 4, &first, &lost), 1); /* the other job's are there */
    trace_release(&trace);
}

static void the_farm_keeps_the_newest(void **state)
{
    struct trace trace = {0};
    struct trace_event page[2];
    uint64_t first, lost;

    (void)state;
    for (uint64_t job = 1; job <= 3 * TRACE_CHUNKS; job++) {
        add(&trace, job, 1);
        add(&trace, 1 + job / 2, 2);
        assert_true(trace.chunk_count <= TRACE_CHUNKS && trace.job_count <= TRACE_CHUNKS);
    }
    assert_int_equal(trace_read(&trace, 3 * TRACE_CHUNKS, 0, page, 2, &first, &lost), 1);
    assert_int_equal(trace_read(&trace, 5, 0, page, 2, &first, &lost), 0);
    trace_release(&trace);
    assert_true(trace.chunk_count == 0 && trace.job_count == 0 && !trace.oldest && !trace.newest);
}

/* A worker whose clock is `ahead` sends a unit of 50 ms that it began at `at`, with a delay. */
static void deliver(struct trace *trace, uint32_t worker, int64_t ahead, uint64_t at_ns, uint64_t delay_ns)
{
    const struct trace_unit_times times = {.began_ns = at_ns + (uint64_t)ahead, .wall_ns = 50 * NS_PER_MS,
                                           .sent_ns = at_ns + (uint64_t)ahead + 60 * NS_PER_MS, .thread = 2};
    const struct trace_event event = {.kind = TRACE_UNIT, .deliverer = worker,
                                      .then_begin_ns = at_ns + 60 * NS_PER_MS + delay_ns,
                                      .then_end_ns = at_ns + 61 * NS_PER_MS + delay_ns, .cpu_ns = 40 * NS_PER_MS};

    trace_add_unit(trace, 1, &event, &times);
}

static void clocks_are_brought_together(void **state)
{
    const uint64_t ms = NS_PER_MS, at = 1000 * NS_PER_SECOND;
    const int64_t ahead[] = {5000 * (int64_t)NS_PER_SECOND, -900 * (int64_t)NS_PER_SECOND};
    struct trace trace = {0};
    struct trace_event e[8];
    uint64_t first, lost;

    (void)state;
    /* The second result of each has the least delay, 1 ms, so no time is wrong by more. */
    for (uint32_t w = 0; w < 2; w++) {
        deliver(&trace, w + 1, ahead[w], at, 300 * ms);
        deliver(&trace, w + 1, ahead[w], at + 50 * ms, 1 * ms);
        deliver(&trace, w + 1, ahead[w], at + 100 * ms, 3600 * NS_PER_SECOND); /* the connection was lost */
    }
    assert_int_equal(trace_read(&trace, 1, 0, e, 8, &first, &lost), 6);
    for (int i = 0; i < 6; i++) {
        assert_false(e[i].estimated);
        assert_int_equal(e[i].thread, 2);
        assert_int_equal(e[i].begin_ns, at + (uint64_t)(i % 3) * 50 * ms + 1 * ms);
        assert_int_equal(e[i].end_ns - e[i].begin_ns, 50 * ms);
    }
    trace_release(&trace);
}

static void what_cannot_be_true_is_estimated(void **state)
{
    const uint64_t ms = NS_PER_MS;
    const struct trace_unit_times odd[] = {
        {0},                                             /* an older worker */
        {.began_ns = 10 * ms, .wall_ns = 5 * ms, .sent_ns = 20 * ms, .thread = 0},
        {.began_ns = 10 * ms, .wall_ns = 5 * ms, .sent_ns = 20 * ms, .thread = 5000},
        {.began_ns = 10 * ms, .wall_ns = 0, .sent_ns = 20 * ms, .thread = 1},
        {.began_ns = 30 * ms, .wall_ns = 5 * ms, .sent_ns = 20 * ms, .thread = 1},
        {.began_ns = 10 * ms, .wall_ns = 15 * ms, .sent_ns = 20 * ms, .thread = 1},
        {.began_ns = 0, .wall_ns = UINT64_MAX, .sent_ns = UINT64_MAX, .thread = 1},
        {.began_ns = 0, .wall_ns = 5 * ms, .sent_ns = 8 * 86400 * NS_PER_SECOND, .thread = 1},
    };
    const size_t count = sizeof odd / sizeof *odd;
    struct trace trace = {0};
    struct trace_event e[8];
    uint64_t first, lost;

    (void)state;
    for (size_t i = 0; i < count; i++) {
        const struct trace_event event = {.kind = TRACE_UNIT, .deliverer = 9, .cpu_ns = i ? 4 * ms : 3000 * ms,
                                          .then_begin_ns = 1000 * ms, .then_end_ns = 1001 * ms};
        trace_add_unit(&trace, 1, &event, &odd[i]);
    }
    assert_int_equal(trace_read(&trace, 1, 0, e, 8, &first, &lost), count);
    for (size_t i = 0; i < count; i++) {
        assert_true(e[i].estimated && e[i].thread == 0 && e[i].end_ns == 1000 * ms);
        assert_int_equal(e[i].begin_ns, i ? 996 * ms : 0);
    }
    trace_release(&trace);
}

/* A worker that says the impossible later on spoils its own times only, and none is out of order. */
static void a_lying_clock_spoils_its_own_worker(void **state)
{
    const uint64_t at = 30 * 86400 * NS_PER_SECOND;
    const struct trace_unit_times lie = {.began_ns = INT64_MAX - 100, .wall_ns = 10, .sent_ns = INT64_MAX - 50,
                                         .thread = 1};
    const struct trace_event event = {.kind = TRACE_UNIT, .deliverer = 2, .then_begin_ns = at, .then_end_ns = at};
    struct trace trace = {0};
    struct trace_event e[8];
    uint64_t first, lost;

    (void)state;
    deliver(&trace, 1, 0, at, NS_PER_MS);
    deliver(&trace, 2, 0, at, NS_PER_MS);
    trace_add_unit(&trace, 1, &event, &lie);
    assert_int_equal(trace_read(&trace, 1, 0, e, 8, &first, &lost), 3);
    assert_true(!e[0].estimated && e[0].begin_ns == at + NS_PER_MS);
    assert_true(e[1].estimated);
    for (int i = 0; i < 3; i++)
        assert_true(e[i].begin_ns <= e[i].end_ns && e[i].end_ns <= e[i].then_begin_ns);
    trace_release(&trace);
}

static void clocks_are_limited(void **state)
{
    struct trace trace = {0};
    struct trace_event e[1];
    uint64_t first, lost;

    (void)state;
    for (uint32_t w = 1; w <= 3 * TRACE_CLOCKS_MAX; w++) {
        deliver(&trace, w, 0, NS_PER_SECOND, NS_PER_MS);
        assert_true(trace.clock_count <= TRACE_CLOCKS_MAX);
    }
    assert_int_equal(trace_read(&trace, 1, 3 * TRACE_CLOCKS_MAX - 1, e, 1, &first, &lost), 1);
    assert_false(e[0].estimated);
    assert_int_equal(trace_read(&trace, 1, 0, e, 1, &first, &lost), 1);
    assert_true(e[0].estimated);                     /* whose clock is forgotten */
    deliver(&trace, 5, 0, NS_PER_SECOND, NS_PER_MS); /* it is still there */
    assert_int_equal(trace_read(&trace, 1, 3 * TRACE_CLOCKS_MAX, e, 1, &first, &lost), 1);
    assert_true(e[0].estimated);
    trace_release(&trace);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(pages_have_every_event_once),
        cmocka_unit_test(a_long_job_keeps_its_newest),
        cmocka_unit_test(the_farm_keeps_the_newest),
        cmocka_unit_test(clocks_are_brought_together),
        cmocka_unit_test(what_cannot_be_true_is_estimated),
        cmocka_unit_test(a_lying_clock_spoils_its_own_worker),
        cmocka_unit_test(clocks_are_limited),
    };

    return cmocka_run_group_tests_name("trace", tests, NULL, NULL);
}
