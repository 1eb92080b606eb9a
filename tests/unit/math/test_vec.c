/* Directions do not depend on the length of the vector that they are taken from. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "common/math/vec.h"
#include "tests/support/statistics.h"

static void test_normalize(void **state)
{
    struct test_random random = {3};

    (void)state;
    for (int i = 0; i < 1000; i++) {
        const struct vec3 v = {test_random_float(&random) - 0.5f, test_random_float(&random) - 0.5f,
                               test_random_float(&random) - 0.5f};
        const struct vec3 unit = vec3_normalize(v);
        assert_true(fabsf(vec3_length(unit) - 1) < 1e-6f);
        for (int power = -80; power <= 126; power++) {
            const struct vec3 n = vec3_normalize(vec3_make(ldexpf(v.x, power), ldexpf(v.y, power), ldexpf(v.z, power)));
            assert_true(n.x == unit.x && n.y == unit.y && n.z == unit.z);
        }
    }
}

/* Subnormal ones have fewer digits. */
static void test_normalize_extremes(void **state)
{
    struct vec3 n = vec3_normalize(vec3_make(0x1p-149f, 0, -0x1p-149f));

    (void)state;
    assert_true(fabsf(n.x - 0.70710678f) < 1e-7f && n.y == 0 && fabsf(n.z + 0.70710678f) < 1e-7f);
    n = vec3_normalize(vec3_make(3e38f, 3e38f, 0));
    assert_true(fabsf(n.x - 0.70710678f) < 1e-7f && fabsf(n.y - 0.70710678f) < 1e-7f);
    assert_true(vec3_is_black(vec3_normalize(vec3_make(0, 0, 0))));
    assert_true(vec3_is_black(vec3_normalize(vec3_make(INFINITY, 0, 0))));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_normalize),
        cmocka_unit_test(test_normalize_extremes),
    };

    return cmocka_run_group_tests_name("vec", tests, NULL, NULL);
}
