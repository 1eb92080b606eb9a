/* Operators that see one pixel at a time, against numbers computed elsewhere: by their authors'
 * formulas in double, and by OpenColorIO 2.1 for ACES. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdlib.h>

#include "common/image/color.h"
#include "common/tonemap/tonemap.h"

struct probe {
    float in[3];
    double out[3];
};

/* What the operator makes of one pixel: display light, or what it gives as code. */
static void develop(const struct tonemap_settings *s, const float in[3], int linear, float out[3])
{
    struct tonemap_context context = {.threads = 1, .linear = linear};
    struct image picture, developed;
    struct error err = {0};

    assert_int_equal(image_init(&picture, 1, 1, 3, &err), STATUS_OK);
    for (int c = 0; c < 3; c++)
        picture.pixels[c] = in[c];
    assert_int_equal(tonemap_apply(&developed, &picture, s, &context, &err), STATUS_OK);
    for (int c = 0; c < 3; c++)
        out[c] = developed.pixels[c];
    image_release(&picture);
    image_release(&developed);
}

static void check(const char *name, const char *parameter, const char *value, int linear, const struct probe *probes,
                  size_t count, double tolerance)
{
    struct tonemap_settings s;
    struct error err = {0};

    assert_int_equal(tonemap_settings_init(&s, name, &err), STATUS_OK);
    if (parameter)
        assert_int_equal(tonemap_settings_set_text(&s, parameter, value, &err), STATUS_OK);
    for (size_t i = 0; i < count; i++) {
        float out[3];

        develop(&s, probes[i].in, linear, out);
        for (int c = 0; c < 3; c++)
            if (!(fabs((double)out[c] - probes[i].out[c]) <= tolerance))
                fail_msg("%s of (%g, %g, %g): channel %d is %.7f, not %.7f", name, (double)probes[i].in[0],
                         (double)probes[i].in[1], (double)probes[i].in[2], c, (double)out[c], probes[i].out[c]);
    }
}

#define CHECK(name, parameter, value, linear, probes, tolerance)                                   \
    check(name, parameter, value, linear, probes, sizeof probes / sizeof *probes, tolerance)

#define GREY(in, out) {{in, in, in}, {out, out, out}}

/* The Academy's transform, from its published formulas. */
static void test_aces(void **state)
{
    static const struct probe probes[] = {
        GREY(0.18f, 0.10406),
        GREY(0.02f, 0.00319),
        GREY(1.0f, 0.62432),
        GREY(16.3f, 1.0),
        GREY(1e30f, 1.0),
        {{0.8f, 0.05f, 0.05f}, {0.50005, 0.01955, 0.02104}},
        {{10.0f, 0.0f, 0.0f}, {1.0, 0.51470, 0.15020}},
        {{0.1f, 4.0f, 0.1f}, {0.66494, 0.91015, 0.42258}},
        {{0.02f, 0.02f, 4.0f}, {0.12990, 0.01488, 0.98254}},
        {{0.45f, 0.25f, 0.17f}, {0.31774, 0.17124, 0.10488}},
    };
    static const struct probe black[] = {GREY(0.0f, 0.0)}; /* exactly */

    (void)state;
    CHECK("aces", NULL, NULL, 1, probes, 6e-6);
    CHECK("aces", NULL, NULL, 1, black, 0.0);
}

/* OpenColorIO's "ACES2065-1_to_CIE-XYZ-D65 - SDR-VIDEO_1.0", in float, with the Bradford matrix
 * before it. It differs from the Academy's by 8e-5 in dark reds, whose saturation it measures after
 * the glow instead of before. */
static void test_aces_by_opencolorio(void **state)
{
    static const struct probe probes[] = {
        {{0.18f, 0.18f, 0.18f}, {0.1040635, 0.1040635, 0.1040635}},
        {{0.174f, 0.287f, 0.145f}, {0.1048704, 0.1972435, 0.0824100}},
        {{0.278f, 0.0875f, 0.243f}, {0.1759561, 0.0354264, 0.1517805}},
        {{0.95f, 0.113f, 0.364f}, {0.6419659, 0.0687496, 0.2631767}},
        {{0.0161f, 0.0138f, 0.000834f}, {0.0022929, 0.0018537, 0.0000000}},
        {{16.8f, 11.4f, 10.7f}, {1.0000000, 0.9864860, 0.9831742}},
        {{0.000496f, 0.0175f, 0.00197f}, {0.0000000, 0.0026019, 0.0000014}},
        {{0.0103f, 0.00128f, 0.0197f}, {0.0008860, 0.0000000, 0.0029509}},
        {{0.239f, 0.148f, 0.182f}, {0.1481086, 0.0786623, 0.1047879}},
        {{0.295f, 0.204f, 0.124f}, {0.1985681, 0.1267439, 0.0648715}},
        {{19.5f, 16.5f, 13.9f}, {1.0000000, 1.0000000, 0.9951913}},
        {{0.0252f, 0.0317f, 0.00771f}, {0.0050004, 0.0071724, 0.0008744}},
        {{1.35f, 2.86f, 1.31f}, {0.7501919, 0.8566979, 0.7273980}},
        {{12.3f, 0.0079f, 3.04f}, {1.0000000, 0.5944018, 0.8768868}},
    };

    (void)state;
    CHECK("aces", NULL, NULL, 1, probes, 2e-6);
}

static void test_aces_hill(void **state)
{
    static const struct probe probes[] = {
        GREY(0.0f, 0.0),
        GREY(0.18f, 0.10559),
        GREY(0.02f, 0.00324),
        GREY(1.0f, 0.61912),
        {{0.8f, 0.05f, 0.05f}, {0.57134, 0.01422, 0.02183}},
        {{10.0f, 0.0f, 0.0f}, {1.0, 0.48427, 0.17261}},
        {{0.1f, 4.0f, 0.1f}, {0.66818, 0.91788, 0.41942}},
        {{0.02f, 0.02f, 4.0f}, {0.13276, 0.01539, 0.95315}},
        {{0.45f, 0.25f, 0.17f}, {0.32906, 0.17201, 0.10771}},
    };

    (void)state;
    CHECK("aces-hill", NULL, NULL, 1, probes, 2e-5);
}

static void test_pbr_neutral(void **state)
{
    static const struct probe probes[] = {
        GREY(0.0f, 0.0),
        GREY(0.02f, 0.0025),
        GREY(0.18f, 0.14),
        GREY(0.8f, 0.76), /* still as it is, less 0.04 */
        GREY(1.0f, 0.86909),
        {{10.0f, 0.0f, 0.0f}, {0.99392, 0.57114, 0.57114}},
        {{0.45f, 0.25f, 0.17f}, {0.41, 0.21, 0.13}},
    };

    (void)state;
    CHECK("pbr-neutral", NULL, NULL, 1, probes, 6e-6);
}

static void test_hable(void **state)
{
    static const struct probe probes[] = {
        GREY(0.0f, 0.0),
        GREY(0.18f, 0.12834),
        GREY(1.0f, 0.49292),
        GREY(5.6f, 1.0), /* the white point over the bias */
        GREY(16.3f, 1.0),
    };
    static const struct probe no_bias[] = {GREY(0.36f, 0.12834), GREY(2.0f, 0.49292)};

    (void)state;
    CHECK("hable", NULL, NULL, 1, probes, 6e-6);
    CHECK("hable", "bias", "1", 1, no_bias, 6e-6);
}

/* Codes. The inset's rows add up to 1 within 1.4e-4 only, so greys are grey within that. */
static void test_agx(void **state)
{
    static const struct probe probes[] = {
        GREY(0.0f, 0.0),
        GREY(0.18f, 0.5),
        GREY(1.0f, 0.78752),
        GREY(16.3f, 1.0),
    };
    /* Red is 1.0434 before it is cut off. */
    static const struct probe outset[] = {
        GREY(0.18f, 0.5),
        GREY(1.0f, 0.78752),
        {{10.0f, 0.0f, 0.0f}, {1.0, 0.6317, 0.6317}},
    };

    (void)state;
    CHECK("agx", NULL, NULL, 0, probes, 5e-5);
    CHECK("agx", "outset", "on", 0, outset, 4e-4);
}

/* AgX' sigmoid and range from the formula, on greys, in libm's double. */
static void test_agx_curve(void **state)
{
    (void)state;
    for (double stops = -14.0; stops <= 6.0; stops += 0.37) {
        double light = pow(2.0, stops), t = (stops + 12.47393) / 16.5 - 20.0 / 33.0;
        double power = t < 0.0 ? 3.0 : 3.25, scale = t < 0.0 ? 59.507875 : 69.862789;
        double code = 0.5 + 2.0 * t * pow(1.0 + scale * pow(fabs(t), power), -1.0 / power);
        struct probe probe[] = {GREY((float)light, fmin(fmax(code, 0.0), 1.0))};

        CHECK("agx", NULL, NULL, 0, probe, 5e-5);
    }
}

/* The gamma of a code is one power, whatever the light. */
static void test_gamma(void **state)
{
    static const char *const gammas[] = {"1", "1.8", "2.2", "5"};

    (void)state;
    for (int g = 0; g < 4; g++)
        for (double light = 1e-12; light < 1.0; light *= 3.7) {
            struct probe probe[] = {
                GREY((float)light, pow((double)(float)light, 1.0 / strtod(gammas[g], NULL)))};

            CHECK("gamma", "gamma", gammas[g], 0, probe, 1e-7);
        }
}

/* Display light of an operator that gives codes is what the sRGB curve makes these codes of. */
static void test_linear_of_codes(void **state)
{
    const float in[3] = {0.7f, 0.18f, 0.02f};
    struct tonemap_settings s;
    float code[3], light[3];

    (void)state;
    assert_int_equal(tonemap_settings_init(&s, "agx", NULL), STATUS_OK);
    develop(&s, in, 0, code);
    develop(&s, in, 1, light);
    for (int c = 0; c < 3; c++)
        assert_true(fabsf(srgb_encode(light[c]) - code[c]) < 2e-7f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_aces),
        cmocka_unit_test(test_aces_by_opencolorio),
        cmocka_unit_test(test_aces_hill),
        cmocka_unit_test(test_pbr_neutral),
        cmocka_unit_test(test_hable),
        cmocka_unit_test(test_agx),
        cmocka_unit_test(test_agx_curve),
        cmocka_unit_test(test_gamma),
        cmocka_unit_test(test_linear_of_codes),
    };
    return cmocka_run_group_tests_name("curves", tests, NULL, NULL);
}
