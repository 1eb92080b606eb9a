/* Four floats at a time give the bits of one at a time, also of what is no number. */
#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <cmocka.h>

#include "common/math/elementary.h"
#include "common/math/lanes.h"

static const float values[] = {0, -0.0f, 1, -1, 0.3f, FLT_MAX, -FLT_MAX, INFINITY, -INFINITY, NAN, FLT_MIN, 1e-42f, 3e7f};
enum { COUNT = sizeof values / sizeof *values };

/* Each value in each lane, beside others. */
static lanes lanes_with(int value, int lane)
{
    lanes out = {2, -3, 4, 5};

    out[lane] = values[value];
    return out;
}

static void assert_same(float have, float wanted)
{
    if (isnan(wanted))
        assert_true(isnan(have));
    else
        assert_int_equal(float_bits(have), float_bits(wanted));
}

static void lanes_are_as_single_floats(void **state)
{
    static const double gains[] = {1, 0.1, 1e30, 1e-50, 1e300};

    (void)state;
    for (int i = 0; i < COUNT * COUNT * 4; i++) {
        const int lane = i % 4;
        const float a = values[i / 4 % COUNT], b = values[i / 4 / COUNT];
        const lanes as = lanes_with(i / 4 % COUNT, lane), bs = lanes_with(i / 4 / COUNT, lane);
        assert_same(lanes_larger(as, bs)[lane], a > b ? a : b);
        assert_same(lanes_smaller(as, bs)[lane], a < b ? a : b);
        assert_same(lanes_choose(as < bs, as, bs)[lane], a < b ? a : b);
        for (int g = 0; g < 5; g++)
            assert_same(lanes_times(as, gains[g])[lane], (float)((double)a * gains[g]));
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(lanes_are_as_single_floats),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
