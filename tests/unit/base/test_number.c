/* The shortest text that reads back as the same number. */
#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "common/base/number.h"

static void test_texts(void **state)
{
    static const struct { double value; const char *text; } cases[] = {
        {0.1, "0.1"}, {0.1 + 0.2, "0.30000000000000004"}, {5, "5.0"}, {-0.0, "-0.0"},
        {1e20, "1e+20"}, {1.0 / 3, "0.3333333333333333"}, {123456789, "123456789.0"},
        {2.5e-9, "2.5e-09"}, {DBL_MAX, "1.7976931348623157e+308"}, {0x1p-1074, "4.94065645841247e-324"},
    };
    char text[NUMBER_TEXT_SIZE];

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++)
        assert_string_equal(number_text(text, cases[i].value), cases[i].text);
}

static void test_floats(void **state)
{
    static const struct { float value; const char *text; } cases[] = {
        {0.1f, "0.1"}, {0.7f, "0.7"}, {24, "24.0"}, {1.0f / 3, "0.33333334"}, {16777216, "16777216.0"},
        {-180.5f, "-180.5"}, {FLT_MAX, "3.4028235e+38"},
    };
    char text[NUMBER_TEXT_SIZE];

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++)
        assert_string_equal(number_text(text, number_of_float(cases[i].value)), cases[i].text);
    assert_true(isnan(number_of_float(NAN)));
    assert_true(isinf(number_of_float(INFINITY)));
}

/* Any bits come back, and no shorter text would have brought them. */
static void test_way_back(void **state)
{
    uint64_t bits = 88172645463325252u;

    (void)state;
    for (int i = 0; i < 20000; i++) {
        char text[NUMBER_TEXT_SIZE];
        uint32_t half;
        double value;
        float single;

        bits ^= bits << 13; /* xorshift64 */
        bits ^= bits >> 7;
        bits ^= bits << 17;
        half = (uint32_t)(bits >> 32);
        memcpy(&value, &bits, sizeof value);
        memcpy(&single, &half, sizeof single);
        if (isfinite(value))
            assert_true(strtod(number_text(text, value), NULL) == value);
        if (isfinite(single))
            assert_true(strtof(number_text(text, number_of_float(single)), NULL) == single);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_texts),
        cmocka_unit_test(test_floats),
        cmocka_unit_test(test_way_back),
    };

    return cmocka_run_group_tests_name("base/number", tests, NULL, NULL);
}
