/* Adaptive logarithmic mapping: numbers of the formula, and inputs that break it. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <float.h>
#include <math.h>
#include <string.h>

#include "common/tonemap/tonemap.h"

static struct tonemap_settings settings_of(const char *name)
{
    struct tonemap_settings s;
    struct error err = {0};

    assert_int_equal(tonemap_settings_init(&s, name, &err), STATUS_OK);
    return s;
}

static void set(struct tonemap_settings *s, const char *parameter, double value)
{
    struct error err = {0};

    assert_int_equal(tonemap_settings_set(s, parameter, value, &err), STATUS_OK);
}

static struct image grey_image(uint32_t width, uint32_t height, float value)
{
    struct image image;

    assert_int_equal(image_init(&image, width, height, 3, NULL), STATUS_OK);
    for (size_t i = 0; i < (size_t)width * height * 3; i++)
        image.pixels[i] = value;
    return image;
}

static void put(struct image *image, size_t x, size_t y, float value)
{
    for (size_t c = 0; c < 3; c++)
        image->pixels[(y * image->width + x) * 3 + c] = value;
}

/* Display light. */
static struct image apply_threads(const struct image *in, const struct tonemap_settings *s,
                                  unsigned threads)
{
    struct tonemap_context context = {.threads = threads, .linear = 1};
    struct image out;
    struct error err = {0};

    assert_int_equal(tonemap_apply(&out, in, s, &context, &err), STATUS_OK);
    for (size_t i = 0; i < (size_t)out.width * out.height * 3; i++)
        assert_true(out.pixels[i] >= 0.0f && out.pixels[i] <= 1.0f); /* false for NaN */
    return out;
}

static struct image apply(const struct image *in, const struct tonemap_settings *s)
{
    return apply_threads(in, s, 1);
}

static float at(const struct image *image, size_t x, size_t y)
{
    return image->pixels[(y * image->width + x) * 3];
}

/* The curve at luminance `l` (over the log-mean) of a picture with the maximum `max`: of three
 * pixels, l, max and what makes the log-mean 1. */
static double curve(double l, double max, double bias, double display)
{
    struct tonemap_settings s = settings_of("drago03");
    struct image in = grey_image(3, 1, 0.0f), out;
    double light;

    put(&in, 0, 0, (float)l);
    put(&in, 1, 0, (float)max);
    put(&in, 2, 0, (float)(1.0 / (l * max)));
    assert_true(1.0 / (l * max) <= max);
    set(&s, "bias", bias);
    set(&s, "display", display);
    out = apply(&in, &s);
    light = (double)at(&out, 0, 0);
    image_release(&in);
    image_release(&out);
    return light;
}

static void test_golden(void **state)
{
    (void)state;
    assert_true(fabs(curve(0.01, 1000, 0.85, 100) - 0.003561) < 1e-6);
    assert_true(fabs(curve(0.1, 1000, 0.85, 100) - 0.029615) < 1e-6);
    assert_true(fabs(curve(1, 1000, 0.85, 100) - 0.180988) < 1e-6);
    assert_true(fabs(curve(10, 1000, 0.85, 100) - 0.515181) < 1e-6);
    assert_true(fabs(curve(100, 1000, 0.85, 100) - 0.811045) < 1e-6);
    assert_true(fabs(curve(1000, 1000, 0.85, 100) - 1.0) < 1e-6);
    assert_true(fabs(curve(10, 1000, 0.85, 50) - 0.515181 / 2) < 1e-6);
}

/* Equation 4 in full, with the bias in the adaptation luminance. With a small bias it passes 1
 * before the maximum. */
static void test_formula(void **state)
{
    (void)state;
    for (double bias = 0.5; bias <= 1.0; bias += 0.1)
        for (double l = 0.01; l < 300; l *= 4.7) {
            double growth = pow(1.0 + bias - 0.85, 5), max = 300 * growth;
            double wanted = log1p(l * growth) / log10(max + 1.0) /
                            log(2.0 + 8.0 * pow(l / 300, log(bias) / log(0.5)));

            assert_true(fabs(curve(l, 300, bias, 100) / fmin(wanted, 1.0) - 1.0) < 3e-6);
        }
}

/* What the rescaling of the adaptation luminance is for: the bias moves contrast more than
 * brightness. Without it mid-grey would change by a third from 0.75 to 0.95. */
static void test_bias_keeps_brightness(void **state)
{
    double low = curve(1, 1000, 0.75, 100), high = curve(1, 1000, 0.95, 100);

    (void)state;
    assert_true(fabs(low / high - 1.0) < 0.25);
}

/* Faint pixels keep their digits: log1p, not log. */
static void test_faint(void **state)
{
    struct tonemap_settings s = settings_of("drago03");
    struct image in = grey_image(4, 1, 0.0f), out;

    (void)state;
    put(&in, 0, 0, 1e-20f);
    put(&in, 1, 0, 2e-20f);
    put(&in, 2, 0, 1e20f);
    put(&in, 3, 0, 1e20f);
    s.exposure_ev = 40;
    out = apply(&in, &s);
    assert_true(at(&out, 0, 0) > 0.0f);
    assert_true(fabsf(at(&out, 1, 0) / at(&out, 0, 0) - 2.0f) < 1e-3f);
    image_release(&in);
    image_release(&out);
}

static void test_monotone(void **state)
{
    (void)state;
    for (double bias = 0.5; bias <= 1.0; bias += 0.25) {
        struct tonemap_settings s = settings_of("drago03");
        struct image in = grey_image(1601, 1, 0.0f), out;

        set(&s, "bias", bias);
        for (size_t x = 0; x <= 1600; x++)
            put(&in, x, 0, (float)pow(10.0, (double)x / 100.0 - 8.0));
        out = apply(&in, &s);
        for (size_t x = 1; x <= 1600; x++)
            assert_true(at(&out, x, 0) >= at(&out, x - 1, 0));
        assert_true(at(&out, 1600, 0) > 0.9999f);
        image_release(&in);
        image_release(&out);
    }
}

static void test_hard_inputs(void **state)
{
    static const float hard[] = {0.0f, -1.0f, NAN, INFINITY, 1e30f, FLT_MAX, 1e-40f, 1.0f};

    (void)state;
    for (double bias = 0.5; bias <= 1.0; bias += 0.5)
        for (size_t a = 0; a < sizeof hard / sizeof *hard; a++)
            for (size_t b = 0; b < sizeof hard / sizeof *hard; b++) {
                struct tonemap_settings s = settings_of("drago03");
                struct image in = grey_image(4, 2, hard[a]), out;

                set(&s, "bias", bias);
                in.pixels[2] = hard[b]; /* pure blue */
                out = apply(&in, &s);   /* checks the range */
                if (!(hard[a] > 0.0f))
                    assert_true(at(&out, 1, 1) == 0.0f);
                image_release(&in);
                image_release(&out);
            }
}

/* The maximum stands in a logarithm only: thirty decades dim the picture by thirty, not by 1e30. */
static void test_firefly(void **state)
{
    struct tonemap_settings s = settings_of("drago03");
    struct image in = grey_image(64, 64, 0.18f), plain, lit;

    (void)state;
    put(&in, 5, 5, 10.0f);
    plain = apply(&in, &s);
    put(&in, 5, 5, 1e30f);
    lit = apply(&in, &s);
    assert_true(at(&lit, 40, 40) > 0.02f);
    assert_true(at(&lit, 40, 40) > at(&plain, 40, 40) / 20.0f);
    image_release(&in);
    image_release(&plain);
    image_release(&lit);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_golden),
        cmocka_unit_test(test_formula),
        cmocka_unit_test(test_bias_keeps_brightness),
        cmocka_unit_test(test_faint),
        cmocka_unit_test(test_monotone),
        cmocka_unit_test(test_hard_inputs),
        cmocka_unit_test(test_firefly),
    };
    return cmocka_run_group_tests_name("drago03", tests, NULL, NULL);
}
