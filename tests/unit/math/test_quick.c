/* Logarithm and power by tables: how far off they are, and where they end. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <float.h>
#include <math.h>

#include "common/math/elementary.h"
#include "common/math/quick.h"

/* Numbers of all magnitudes, ends of the tables' pieces, and what lies beside them. */
static void test_log2(void **state)
{
    struct quick q;

    (void)state;
    quick_init(&q);
    for (int e = -1022; e < 1024; e++)
        for (int i = 0; i < 4 * QUICK_PIECES; i++) {
            double x = ldexp(1.0 + i / (4.0 * QUICK_PIECES), e), below = nextafter(x, 2.0 * x);

            assert_true(fabsl(quick_log2(&q, x) - log2l((long double)x)) < 1e-12L);
            assert_true(fabsl(quick_log2(&q, below) - log2l((long double)below)) < 1e-12L);
        }
    assert_true(fabs(quick_log2(&q, DBL_MAX) - 1024.0) < 1e-12);
    assert_true(fabs(quick_log2(&q, 1.0)) < 1e-12);
}

static void test_exp2(void **state)
{
    struct quick q;

    (void)state;
    quick_init(&q);
    for (double y = -1000.0; y <= 1000.0; y += 0.00137) {
        long double exact = exp2l((long double)y);

        assert_true(fabsl(quick_exp2(&q, y) - exact) < 1e-12L * exact);
    }
    for (int k = -1000; k <= 1000; k++)
        assert_true(quick_exp2(&q, k) == ldexp(1.0, k));
}

static void test_ends(void **state)
{
    struct quick q;

    (void)state;
    quick_init(&q);
    assert_true(quick_exp2(&q, -INFINITY) == ldexp(1.0, -1000));
    assert_true(quick_exp2(&q, (double)NAN) == ldexp(1.0, -1000));
    assert_true(quick_exp2(&q, INFINITY) == ldexp(1.0, 1000));
}

/* The bits are the same on every machine: a hash over results, written down. */
static void test_bits(void **state)
{
    uint64_t hash = 14695981039346656037ull, bits;
    struct quick q;

    (void)state;
    quick_init(&q);
    for (int i = 1; i <= 2000; i++) {
        double results[2] = {quick_log2(&q, i * 0.0137), quick_exp2(&q, i * 0.0137 - 9.0)};

        for (int k = 0; k < 2; k++) {
            memcpy(&bits, &results[k], sizeof bits);
            hash = (hash ^ bits) * 1099511628211ull;
        }
    }
    assert_int_equal(hash, 0x682ec62f68986266ull);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_log2),
        cmocka_unit_test(test_exp2),
        cmocka_unit_test(test_ends),
        cmocka_unit_test(test_bits),
    };
    return cmocka_run_group_tests_name("quick", tests, NULL, NULL);
}
