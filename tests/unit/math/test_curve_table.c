/* Curves as tables: how near they come, and that they never turn back. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>

#include "common/math/curve_table.h"

static double power_at(double x, const void *user) { return det_pow_d(x, *(const double *)user); }

static double stairs(double x, const void *user)
{
    (void)user;
    return x < 3.0 ? 0.0 : 1.0;
}

static void test_powers(void **state)
{
    static const double exponents[] = {0.2, 0.454545, 0.9811, 1.0, 2.0};
    static float pieces[12 * CURVE_PIECES][4];

    (void)state;
    for (size_t e = 0; e < sizeof exponents / sizeof *exponents; e++) {
        struct curve_table table;

        curve_table_build(&table, pieces, -8, 12, power_at, &exponents[e]);
        for (uint32_t bits = float_bits(0x1p-8f); bits < float_bits(0x1p+4f); bits += 1013) {
            double x = (double)float_from_bits(bits), exact = pow(x, exponents[e]);

            assert_true(fabs((double)curve_table_at(&table, (float)x) - exact) < 1.5e-7 * exact);
        }
    }
}

/* Over all the floats of two octaves, which begin and end at joints of 256 pieces. */
static void test_never_decreases(void **state)
{
    static const double exponent = 1.0 / 2.2;
    static float pieces[4 * CURVE_PIECES][4];
    struct curve_table table;
    float before = 0.0f;

    (void)state;
    curve_table_build(&table, pieces, -1, 4, power_at, &exponent);
    for (uint32_t bits = float_bits(0.99f); bits <= float_bits(4.01f); bits++) {
        float value = curve_table_at(&table, float_from_bits(bits));

        assert_true(value >= before);
        before = value;
    }
}

static void test_ends(void **state)
{
    static const double exponent = 1.0;
    static float pieces[2 * CURVE_PIECES][4];
    struct curve_table table;

    (void)state;
    curve_table_build(&table, pieces, 0, 2, power_at, &exponent);
    assert_true(curve_table_at(&table, 0.0f) == 1.0f);
    assert_true(curve_table_at(&table, -INFINITY) == 1.0f);
    assert_true(curve_table_at(&table, NAN) == 1.0f);
    assert_true(curve_table_at(&table, 1.0f) == 1.0f);
    assert_true(fabsf(curve_table_at(&table, 4.0f) - 4.0f) < 1e-6f);
    assert_true(fabsf(curve_table_at(&table, INFINITY) - 4.0f) < 1e-6f);
}

/* A jump makes its piece's parabola overshoot; what comes out does not. */
static void test_no_overshoot(void **state)
{
    static float pieces[2 * CURVE_PIECES][4];
    struct curve_table table;

    (void)state;
    curve_table_build(&table, pieces, 1, 2, stairs, NULL);
    for (float x = 2.0f; x < 8.0f; x += 0x1p-10f) {
        float value = curve_table_at(&table, x);

        assert_true(value >= 0.0f && value <= 1.0f);
        if (x < 2.98f || x >= 3.0f)
            assert_true(value == (x < 3.0f ? 0.0f : 1.0f));
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_powers),
        cmocka_unit_test(test_never_decreases),
        cmocka_unit_test(test_ends),
        cmocka_unit_test(test_no_overshoot),
    };
    return cmocka_run_group_tests_name("curve_table", tests, NULL, NULL);
}
