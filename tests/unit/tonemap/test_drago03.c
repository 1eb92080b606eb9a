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
#include "tests/support/tonemap_pictures.h"

/* The curve at luminance `l` (over the log-mean) of a picture with the maximum `max`, and what makes the log-mean 1. */
static double curve(double l, double max, double bias, double display)
{
    struct tonemap_settings s = tonemap_preset("drago03");
    struct image in = picture_stripes((const float[]){(float)l, (float)max, (float)(1.0 / (l * max))}, 3), out;
    double light;

    assert_true(1.0 / (l * max) <= max);
    tonemap_preset_set(&s, "bias", bias);
    tonemap_preset_set(&s, "display", display);
    out = picture_light(&in, &s);
    light = (double)picture_at(&out, 0, 0);
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
            double wanted = log1p(l * growth) / log10(max + 1.0) / log(2.0 + 8.0 * pow(l / 300, log(bias) / log(0.5)));

            assert_true(fabs(curve(l, 300, bias, 100) / fmin(wanted, 1.0) - 1.0) < 3e-6);
        }
}

/* With the state of other frames there are pixels beyond its luminances: the same formula. */
static void test_state_of_others(void **state)
{
    struct tonemap_settings s = tonemap_preset("drago03");
    struct tonemap_context context = {.linear = 1};
    struct tonemap_state measured;
    struct image known = picture_stripes((const float[]){1.0f / 5.015f, 5.015f}, 2), in, out; /* the log-mean is 1 */
    struct error err = {0};

    (void)state;
    assert_int_equal(tonemap_measure(&measured, &known, &s, &context, &err), STATUS_OK);
    context.state = &measured;
    in = picture_grey(600, 1, 1.0f);
    for (size_t x = 0; x < 600; x++)
        picture_put(&in, x, 0, (float)pow(10.0, (double)x / 100.0 - 4.0));
    assert_int_equal(tonemap_apply(&out, &in, &s, &context, &err), STATUS_OK);
    for (size_t x = 0; x < 600; x++) {
        double l = (double)picture_at(&in, x, 0);
        double power = pow(fmin(l / 5.015, 1.0), log(0.85) / log(0.5));
        double wanted = log1p(l) / log10(6.015) / log(2.0 + 8.0 * power);

        assert_true(fabs((double)picture_at(&out, x, 0) / fmin(wanted, 1.0) - 1.0) < 1e-6);
    }
    image_release(&known);
    image_release(&in);
    image_release(&out);
}

/* Every allocation may fail. */
static void test_no_memory(void **state)
{
    struct tonemap_settings s = tonemap_preset("drago03");
    struct image in = picture_grey(5, 4, 0.3f);

    (void)state;
    assert_true(picture_out_of_memory(&in, &s) > 0);
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
    struct tonemap_settings s = tonemap_preset("drago03");
    struct image in = picture_grey(4, 1, 0.0f), out;

    (void)state;
    picture_put(&in, 0, 0, 1e-20f);
    picture_put(&in, 1, 0, 2e-20f);
    picture_put(&in, 2, 0, 1e20f);
    picture_put(&in, 3, 0, 1e20f);
    s.exposure_ev = 40;
    out = picture_light(&in, &s);
    assert_true(picture_at(&out, 0, 0) > 0.0f);
    assert_true(fabsf(picture_at(&out, 1, 0) / picture_at(&out, 0, 0) - 2.0f) < 1e-3f);
    image_release(&in);
    image_release(&out);
}

static void test_monotone(void **state)
{
    (void)state;
    for (double bias = 0.5; bias <= 1.0; bias += 0.25) {
        struct tonemap_settings s = tonemap_preset("drago03");
        struct image in = picture_grey(1601, 1, 0.0f), out;

        tonemap_preset_set(&s, "bias", bias);
        for (size_t x = 0; x <= 1600; x++)
            picture_put(&in, x, 0, (float)pow(10.0, (double)x / 100.0 - 8.0));
        out = picture_light(&in, &s);
        for (size_t x = 1; x <= 1600; x++)
            assert_true(picture_at(&out, x, 0) >= picture_at(&out, x - 1, 0));
        assert_true(picture_at(&out, 1600, 0) > 0.9999f);
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
                struct tonemap_settings s = tonemap_preset("drago03");
                struct image in = picture_grey(4, 2, hard[a]), out;

                tonemap_preset_set(&s, "bias", bias);
                in.pixels[2] = hard[b];       /* pure blue */
                out = picture_light(&in, &s); /* checks the range */
                if (!(hard[a] > 0.0f))
                    assert_true(picture_at(&out, 1, 1) == 0.0f);
                image_release(&in);
                image_release(&out);
            }
}

/* The maximum stands in a logarithm only: thirty decades dim the picture by thirty, not by 1e30. */
static void test_firefly(void **state)
{
    struct tonemap_settings s = tonemap_preset("drago03");
    struct image in = picture_grey(64, 64, 0.18f), plain, lit;

    (void)state;
    picture_put(&in, 5, 5, 10.0f);
    plain = picture_light(&in, &s);
    picture_put(&in, 5, 5, 1e30f);
    lit = picture_light(&in, &s);
    assert_true(picture_at(&lit, 40, 40) > 0.02f);
    assert_true(picture_at(&lit, 40, 40) > picture_at(&plain, 40, 40) / 20.0f);
    image_release(&in);
    image_release(&plain);
    image_release(&lit);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_golden),
        cmocka_unit_test(test_formula),
        cmocka_unit_test(test_state_of_others),
        cmocka_unit_test(test_no_memory),
        cmocka_unit_test(test_bias_keeps_brightness),
        cmocka_unit_test(test_faint),
        cmocka_unit_test(test_monotone),
        cmocka_unit_test(test_hard_inputs),
        cmocka_unit_test(test_firefly),
    };
    return cmocka_run_group_tests_name("drago03", tests, NULL, NULL);
}
