/* One line a period and subject, and what was left out is counted. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "common/system/clock.h"
#include "common/system/log_limit.h"

static const uint64_t PERIOD_NS = LOG_LIMIT_PERIOD_MS * NS_PER_MS;

static void test_one_line_a_period(void **state)
{
    struct log_limit limit = {0};
    uint64_t left_out = 99, now_ns = 5;

    (void)state;
    assert_true(log_limit_pass(&limit, "10.0.0.1", now_ns, &left_out));
    assert_int_equal(left_out, 0);
    for (int i = 0; i < 1000; i++)
        assert_false(log_limit_pass(&limit, "10.0.0.1", now_ns + (uint64_t)i, &left_out));
    assert_false(log_limit_pass(&limit, "10.0.0.1", now_ns + PERIOD_NS - 1, &left_out));
    assert_true(log_limit_pass(&limit, "10.0.0.2", now_ns, &left_out)); /* another subject */
    assert_int_equal(left_out, 0);
    now_ns += PERIOD_NS;
    assert_true(log_limit_pass(&limit, "10.0.0.1", now_ns, &left_out));
    assert_int_equal(left_out, 1001);
    assert_false(log_limit_pass(&limit, "10.0.0.1", now_ns + 1, &left_out));
    assert_true(log_limit_pass(&limit, "10.0.0.1", now_ns + PERIOD_NS, &left_out));
    assert_int_equal(left_out, 1);
}

/* A scan from very many addresses: as many lines as there are subjects, and one for the rest. */
static void test_many_subjects(void **state)
{
    struct log_limit limit = {0};
    uint64_t left_out, total = 0;
    int lines = 0;
    char name[200];

    (void)state;
    for (int i = 0; i < 10000; i++) {
        snprintf(name, sizeof name, "10.0.%d.%d", i / 256, i % 256);
        lines += log_limit_pass(&limit, name, 7 + (uint64_t)i, &left_out);
    }
    assert_int_equal(lines, LOG_LIMIT_SUBJECTS + 1);
    /* After the period entries are used again, and no count is lost. */
    for (int i = 0; i < 1000; i++) {
        snprintf(name, sizeof name, "10.1.0.%d", i);
        if (log_limit_pass(&limit, name, 7 + 10000 + 2 * PERIOD_NS, &left_out)) {
            lines++;
            total += left_out;
        }
    }
    assert_int_equal(lines, 2 * (LOG_LIMIT_SUBJECTS + 1));
    assert_int_equal(total, 10000 - LOG_LIMIT_SUBJECTS - 1);
}

static void test_long_subjects(void **state)
{
    struct log_limit limit = {0};
    uint64_t left_out;
    char name[300];

    (void)state;
    memset(name, 'x', sizeof name);
    name[sizeof name - 1] = 0;
    assert_true(log_limit_pass(&limit, name, 1, &left_out));
    assert_false(log_limit_pass(&limit, name, 2, &left_out));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_one_line_a_period),
        cmocka_unit_test(test_many_subjects),
        cmocka_unit_test(test_long_subjects),
    };
    return cmocka_run_group_tests_name("log_limit", tests, NULL, NULL);
}
