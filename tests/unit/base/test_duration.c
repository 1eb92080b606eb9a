#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <string.h>

#include "common/base/duration.h"

static void lengths_of_time(void **state)
{
    static const struct {
        const char *text;
        int64_t seconds;
    } good[] = {{"90s", 90},     {"10m", 600}, {"1.5h", 5400}, {"30d", 2592000},
                {"2w", 1209600}, {"0s", 0},    {"0d", 0}};
    static const char *const bad[] = {"",    "30",    "d",   "30 d", "-1d", "1y",
                                      "1dd", "nan d", "inf", "infd", "1e9w"};
    struct error err = {0};
    int64_t seconds;

    (void)state;
    for (size_t i = 0; i < sizeof good / sizeof *good; i++) {
        assert_int_equal(duration_parse("--keep", good[i].text, &seconds, &err), STATUS_OK);
        assert_true(seconds == good[i].seconds);
    }
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        assert_int_equal(duration_parse("--keep", bad[i], &seconds, &err), STATUS_ERR_USAGE);
        assert_non_null(strstr(err.text, "--keep"));
    }
}

static void as_text(void **state)
{
    char text[DURATION_TEXT_SIZE];

    (void)state;
    assert_string_equal(duration_text(text, 0), "0s");
    assert_string_equal(duration_text(text, 90), "90s");
    assert_string_equal(duration_text(text, 7200), "2h");
    assert_string_equal(duration_text(text, 14 * 86400), "14d");
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(lengths_of_time),
                                       cmocka_unit_test(as_text)};

    return cmocka_run_group_tests(tests, NULL, NULL);
}
