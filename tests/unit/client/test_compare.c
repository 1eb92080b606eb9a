/* The figures of `azulejo compare`, against values worked out by hand. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "client/views/compare.h"
#include "common/image/color.h"

static void near(double got, double wanted, double relative)
{
    if (!(fabs(got - wanted) <= relative * fabs(wanted)))
        fail_msg("%.17g is not %.17g", got, wanted);
}

static void figures(void **state)
{
    float a_pixels[] = {1, 2, 3, 0.5f, 0, 0.25f};
    float b_pixels[] = {1, 2, 3, 0.25f, 0, 0.75f};
    struct image a = {2, 1, 3, a_pixels}, b = {2, 1, 3, b_pixels};
    struct comparison c;
    double encoded = pow((double)srgb_encode(0.5f) - (double)srgb_encode(0.25f), 2) +
                     pow((double)srgb_encode(0.25f) - (double)srgb_encode(0.75f), 2);

    (void)state;
    image_compare(&a, &b, &c);
    assert_int_equal(c.same_size, 1);
    assert_int_equal(c.identical, 0);
    assert_int_equal(c.pixels, 2);
    assert_int_equal(c.differing_pixels, 1);
    near(c.max_absolute, 0.5, 0);
    assert_int_equal(c.worst_x, 1);
    assert_int_equal(c.worst_y, 0);
    near(c.max_relative, 0.5 / 0.75, 1e-15);
    near(c.mse, (0.0625 + 0.25) / 6, 1e-15);
    near(c.relative_mse, (0.0625 / (0.0625 + 0.01) + 0.25 / (0.5625 + 0.01)) / 6, 1e-14);
    near(c.mean_relative[0], (1.5 - 1.25) / 1.25, 1e-15);
    assert_true(c.mean_relative[1] == 0);
    near(c.mean_relative[2], (3.25 - 3.75) / 3.75, 1e-15);
    near(c.psnr_db, -10 * log10(encoded / 6), 1e-12);
}

static void identical_is_about_bits(void **state)
{
    float a_pixels[] = {0.f, 1, 2}, b_pixels[] = {-0.f, 1, 2};
    struct image a = {1, 1, 3, a_pixels}, b = {1, 1, 3, b_pixels};
    struct comparison c;

    (void)state;
    image_compare(&a, &a, &c);
    assert_int_equal(c.identical, 1);
    assert_true(isinf(c.psnr_db) && c.mse == 0 && c.relative_mse == 0);
    /* Equal as numbers, not as bits. */
    image_compare(&a, &b, &c);
    assert_int_equal(c.identical, 0);
    assert_int_equal(c.differing_pixels, 1);
    assert_true(c.max_absolute == 0);
    a_pixels[2] = nextafterf(2, 3);
    b_pixels[0] = 0;
    image_compare(&a, &b, &c);
    assert_int_equal(c.identical, 0);
    assert_true(c.max_absolute > 0 && c.max_absolute < 1e-6);
}

static void sizes_must_agree(void **state)
{
    float pixels[18] = {0};
    struct image a = {2, 3, 3, pixels}, b = {3, 2, 3, pixels}, c4 = {2, 2, 4, pixels};
    struct comparison c;

    (void)state;
    image_compare(&a, &b, &c);
    assert_int_equal(c.same_size, 0);
    image_compare(&c4, &c4, &c);
    assert_int_equal(c.same_size, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(figures),
        cmocka_unit_test(identical_is_about_bits),
        cmocka_unit_test(sizes_must_agree),
    };

    return cmocka_run_group_tests_name("client/compare", tests, NULL, NULL);
}
