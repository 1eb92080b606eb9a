/* The text format of Prometheus: numbers, labels with any text, histograms. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <string.h>

#include "common/system/clock.h"
#include "protocol/metric_text.h"

static struct buffer text;

static int clear(void **state)
{
    (void)state;
    buffer_release(&text);
    return 0;
}

static void numbers_are_written_as_the_format_wants(void **state)
{
    static const struct {
        double value;
        const char *words;
    } cases[] = {{0, "m 0\n"}, {-3, "m -3\n"}, {0.25, "m 0.25\n"}, {9007199254740991.0, "m 9007199254740991\n"},
                 {1e300, "m 1e+300\n"}, {NAN, "m NaN\n"}, {INFINITY, "m +Inf\n"}, {-INFINITY, "m -Inf\n"}};

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        metric_value(&text, "m", cases[i].value, NULL);
        assert_string_equal(buffer_text(&text), cases[i].words);
        buffer_clear(&text);
    }
}

static void any_text_is_a_label(void **state)
{
    char very_long[2000];

    (void)state;
    metric_value(&text, "m", 1, "a", "x \"y\" \\ \xe2\x9c\x93", "b", "", NULL);
    assert_string_equal(buffer_text(&text), "m{a=\"x \\\"y\\\" \\\\ \xe2\x9c\x93\",b=\"\"} 1\n");
    buffer_clear(&text);
    metric_value(&text, "m", 1, "a", "line\nline\t\xff", NULL);
    assert_string_equal(buffer_text(&text), "m{a=\"line?line??\"} 1\n");
    buffer_clear(&text);
    memset(very_long, '"', sizeof very_long - 1);
    very_long[sizeof very_long - 1] = 0;
    metric_value(&text, "m", 1, "a", very_long, NULL);
    assert_non_null(strstr(buffer_text(&text), "\\\"\"} 1\n")); /* cut behind a whole escape */
}

static void a_histogram_is_cumulative(void **state)
{
    struct histogram h = {0};

    (void)state;
    histogram_add(&h, 0);
    histogram_add(&h, NS_PER_MS); /* a bound belongs to its class */
    histogram_add(&h, NS_PER_MS + 1);
    histogram_add(&h, 10 * NS_PER_SECOND);
    histogram_add(&h, 3600 * NS_PER_SECOND);
    metric_histogram(&text, "m", "Words.", &h);
    assert_non_null(strstr(buffer_text(&text), "# HELP m Words.\n# TYPE m histogram\nm_bucket{le=\"0.001\"} 2\n"
                                               "m_bucket{le=\"0.0025\"} 3\n"));
    assert_non_null(strstr(buffer_text(&text), "m_bucket{le=\"5\"} 3\nm_bucket{le=\"10\"} 4\nm_bucket{le=\"+Inf\"} 5\n"
                                               "m_sum 3610.002000001\nm_count 5\n"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(numbers_are_written_as_the_format_wants, clear),
        cmocka_unit_test_teardown(any_text_is_a_label, clear),
        cmocka_unit_test_teardown(a_histogram_is_cumulative, clear),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
