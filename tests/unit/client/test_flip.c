/* FLIP: what follows from its paper's definitions, and that each of its parts is there. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "client/study/flip.h"

enum { SIDE = 64 };

/* A picture of one colour, with a square of another in its middle. */
static void paint(struct image *out, const float *ground, const float *square, int half)
{
    struct error err = {0};

    assert_int_equal(image_init(out, SIDE, SIDE, 3, &err), STATUS_OK);
    for (int y = 0; y < SIDE; y++)
        for (int x = 0; x < SIDE; x++)
            for (int c = 0; c < 3; c++)
                out->pixels[(y * SIDE + x) * 3 + c] =
                    x >= SIDE / 2 - half && x < SIDE / 2 + half && y >= SIDE / 2 - half && y < SIDE / 2 + half ? square[c]
                                                                                                            : ground[c];
}

static double between(const struct image *a, const struct image *b)
{
    struct error err = {0};
    double out;

    assert_int_equal(flip_mean(&out, a, b, &err), STATUS_OK);
    return out;
}

static double of_colours(const float *a, const float *b)
{
    struct image x, y;
    double out;

    paint(&x, a, a, 0);
    paint(&y, b, b, 0);
    out = between(&x, &y);
    image_release(&x);
    image_release(&y);
    return out;
}

static const float black[3] = {0, 0, 0}, white[3] = {255, 255, 255}, green[3] = {0, 255, 0}, blue[3] = {0, 0, 255},
                   grey[3] = {128, 128, 128}, near_grey[3] = {129, 129, 129};

static void test_colours(void **state)
{
    (void)state;
    assert_float_equal(of_colours(grey, grey), 0, 1e-9);
    /* The largest difference is that of green and blue. Black and white are 100 apart, of 203.4 after the Hunt effect:
     * 100^.7 = 25.12 is above .4 * 203.4^.7 = 16.53. */
    assert_float_equal(of_colours(green, blue), 1, 1e-5);
    assert_float_equal(of_colours(black, white), 0.9673, 2e-4);
    assert_float_equal(of_colours(white, black), of_colours(black, white), 1e-9);
    /* L* of 128 and 129 of 255 are 53.585 and 53.97: .385^.7 / 16.53 * .95 */
    assert_float_equal(of_colours(grey, near_grey), 0.0295, 4e-4);
}

/* The same grain is worse where it has edges that the eye resolves than pixel by pixel. */
static void test_features(void **state)
{
    struct image flat, coarse, fine;

    (void)state;
    paint(&flat, grey, grey, 0);
    paint(&coarse, grey, grey, 0);
    paint(&fine, grey, grey, 0);
    for (int i = 0; i < SIDE * SIDE; i++)
        for (int c = 0; c < 3; c++) {
            coarse.pixels[i * 3 + c] += (i / SIDE / 16 + i % SIDE / 16) % 2 ? 20 : -20;
            fine.pixels[i * 3 + c] += (i / SIDE + i) % 2 ? 20 : -20;
        }
    assert_true(between(&flat, &coarse) > 0.2);
    assert_true(between(&flat, &fine) < 0.05);
    image_release(&flat);
    image_release(&coarse);
    image_release(&fine);
}

static void test_small_squares(void **state)
{
    struct image flat, small, large;

    (void)state;
    paint(&flat, grey, grey, 0);
    paint(&small, grey, white, 1);
    paint(&large, grey, white, 8);
    assert_true(between(&flat, &small) > 0);
    assert_true(between(&flat, &large) > 4 * between(&flat, &small));
    assert_float_equal(between(&flat, &large), between(&large, &flat), 1e-6);
    image_release(&flat);
    image_release(&small);
    image_release(&large);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_colours),
        cmocka_unit_test(test_features),
        cmocka_unit_test(test_small_squares),
    };

    return cmocka_run_group_tests_name("client/flip", tests, NULL, NULL);
}
