/* Perlin's noise as pbrt has it. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "client/import/pbrt/pbrt_texture_parts.h"

/* In the middle of a cell all corners weigh an eighth. Those of the cell at 0 have the gradients 4, 6, 12, 0, 7, 4, 14 and 3 (x runs
 * first): 1 - 1 + 0 - 1 + 0 - 1 + 0 + 1. */
static void test_middle(void **state)
{
    (void)state;
    assert_true(pbrt_noise(0.5, 0.5, 0.5) == -0.125);
}

/* Nothing at the corners, the same after 256, continuous from cell to cell. */
static void test_lattice(void **state)
{
    (void)state;
    for (int i = -3; i < 300; i += 7)
        assert_true(pbrt_noise(i, 2 * i, 5 - i) == 0);
    assert_float_equal(pbrt_noise(-3.25, 4.5, 0.125), pbrt_noise(252.75, 260.5, -255.875), 1e-12);
    for (int i = 0; i < 20; i++)
        assert_float_equal(pbrt_noise(i - 1e-9, 0.3, 0.7), pbrt_noise(i + 1e-9, 0.3, 0.7), 1e-7);
}

/* Two more, from a program of nested interpolations. */
static void test_elsewhere(void **state)
{
    (void)state;
    assert_float_equal(pbrt_noise(0.25, 0.5, 0.75), -0.06879425048828125, 1e-12);
    assert_float_equal(pbrt_noise(-3.3, 260.2, 7.9), -0.06272739342181427, 1e-12);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_middle),
        cmocka_unit_test(test_lattice),
        cmocka_unit_test(test_elsewhere),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
