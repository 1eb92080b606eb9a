/* Points of time as people type and read them, in a zone with summer time. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "client/terminal/moment.h"

/* 2026-03-28 12:30:00 in Berlin, a day before summer time begins. */
#define NOW INT64_C(1774697400)

static int set_zone(void **state)
{
    (void)state;
    setenv("TZ", "CET-1CEST,M3.5.0,M10.5.0/3", 1);
    tzset();
    return 0;
}

static void what_people_type(void **state)
{
    static const struct { const char *text; int64_t when; } good[] = {
        {"12:31", NOW + 60},
        {"12:30", NOW + 23 * 3600},            /* tomorrow: the night has an hour less */
        {"23:59:59", NOW + 11 * 3600 + 29 * 60 + 59},
        {"2026-03-28 13:00", NOW + 1800},
        {"2026-03-28T13:00:01", NOW + 1801},
        {"2026-03-29", NOW + 11 * 3600 + 1800},
        {"2026-03-30 12:30", NOW + 47 * 3600},
        {"2026-03-28T11:30:00Z", NOW},         /* the past may be named by its date */
        {"2026-03-28 12:30+01:00", NOW},
        {"2026-03-28 12:30+0100", NOW},
        {"2026-03-28 06:30-05", NOW},
        {"2024-02-29", 1709161200},
        {"90s", NOW + 90}, {"10m", NOW + 600}, {"1.5h", NOW + 5400},
    };
    static const char *const bad[] = {
        "", "noon", "25:00", "12:60", "12:00:60", "1:00", "12", "12:5", "12:00x", "12:00 Z",
        "2026-02-29", "2026-13-01", "2026-00-10", "2026-03-32", "26-03-28", "2026-3-28", "2026-03-28 ",
        "2026-03-28X10:00", "2026-03-28 10:00Y", "2026-03-28 10:00+1", "1960-01-01", "-5m", "0s", "5 m", "5d5",
    };
    struct error err;
    int64_t when;

    (void)state;
    for (size_t i = 0; i < sizeof good / sizeof good[0]; i++) {
        if (moment_parse("--x", good[i].text, NOW, &when, &err) != STATUS_OK || when != good[i].when)
            fail_msg("'%s': %lld, not %lld", good[i].text, (long long)when, (long long)good[i].when);
    }
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        if (moment_parse("--x", bad[i], NOW, &when, &err) != STATUS_ERR_USAGE)
            fail_msg("'%s' was taken for %lld", bad[i], (long long)when);
        assert_non_null(strstr(err.text, "--x"));
    }
}

static void what_people_read(void **state)
{
    char out[FORMAT_SIZE];

    (void)state;
    assert_string_equal(moment_text(out, NOW + 1800, NOW), "13:00");
    assert_string_equal(moment_text(out, NOW + 24 * 3600 - 1, NOW), "13:29");
    assert_string_equal(moment_text(out, NOW + 24 * 3600, NOW), "2026-03-29 13:30");
    assert_string_equal(moment_text(out, NOW - 3600, NOW), "2026-03-28 11:30");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_people_type),
        cmocka_unit_test(what_people_read),
    };

    return cmocka_run_group_tests(tests, set_zone, NULL);
}
