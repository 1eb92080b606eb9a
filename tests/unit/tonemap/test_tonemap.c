/* The tone mapping operators: values of the papers, and inputs that break naive ones. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <float.h>
#include <math.h>
#include <string.h>

#include "common/image/color.h"
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

static struct image apply(const struct image *in, const struct tonemap_settings *s)
{
    struct image out;
    struct error err = {0};

    assert_int_equal(tonemap_apply(&out, in, s, NULL, &err), STATUS_OK);
    assert_int_equal(out.width, in->width);
    assert_int_equal(out.height, in->height);
    assert_int_equal(out.channels, 3);
    for (size_t i = 0; i < (size_t)out.width * out.height * 3; i++)
        assert_true(out.pixels[i] >= 0.0f && out.pixels[i] <= 1.0f); /* false for NaN */
    return out;
}

/* The display light of a one-pixel grey picture. A constant picture's scaled luminance is the
 * key, which makes Reinhard's curve visible. */
static double reinhard_curve(double scaled, double white)
{
    struct tonemap_settings s = settings_of("reinhard02");
    struct image in = grey_image(1, 1, 0.37f), out;
    double light;

    set(&s, "key", scaled);
    set(&s, "white", white);
    out = apply(&in, &s);
    light = (double)srgb_decode(out.pixels[0]);
    image_release(&in);
    image_release(&out);
    return light;
}

static void test_reinhard_golden(void **state)
{
    (void)state;
    /* L (1 + L / 16) / (1 + L), white point 4. */
    assert_true(fabs(reinhard_curve(0.01, 4) - 0.009907) < 1e-6);
    assert_true(fabs(reinhard_curve(0.18, 4) - 0.154258) < 1e-6);
    assert_true(fabs(reinhard_curve(1.0, 4) - 0.53125) < 1e-6);
    assert_true(fabs(reinhard_curve(2.0, 4) - 0.75) < 1e-6);
    assert_true(fabs(reinhard_curve(4.0, 4) - 1.0) < 1e-6);
    assert_true(reinhard_curve(8.0, 4) == 1.0);
    /* A white point far away leaves the basic curve L / (1 + L). */
    assert_true(fabs(reinhard_curve(1.0, 1e9) - 0.5) < 1e-6);
}

static void test_reinhard_white_is_maximum(void **state)
{
    struct tonemap_settings s = settings_of("reinhard02");
    struct image in = grey_image(3, 2, 0.5f), out;

    (void)state;
    in.pixels[6] = in.pixels[7] = in.pixels[8] = 40.0f;
    out = apply(&in, &s);
    assert_true(out.pixels[6] > 0.9999f);
    assert_true(out.pixels[0] < 0.9f);
    image_release(&in);
    image_release(&out);
}

static void test_reinhard_keeps_color(void **state)
{
    struct tonemap_settings s = settings_of("reinhard02");
    struct image in = grey_image(2, 1, 0.2f), out;
    float r, g;

    (void)state;
    set(&s, "white", 1e9); /* so that no channel is clipped */
    in.pixels[0] = 0.3f;
    in.pixels[1] = 0.1f;
    out = apply(&in, &s);
    r = srgb_decode(out.pixels[0]);
    g = srgb_decode(out.pixels[1]);
    assert_true(fabsf(r / g - 3.0f) < 1e-4f);
    image_release(&in);
    image_release(&out);
}

/* Half a black frame must not pull the key: black pixels do not count. */
static void test_black_does_not_count(void **state)
{
    struct tonemap_settings s = settings_of("reinhard02");
    struct image full = grey_image(2, 2, 0.5f), half = grey_image(2, 2, 0.5f), a, b;

    (void)state;
    memset(half.pixels, 0, 6 * sizeof(float));
    a = apply(&full, &s);
    b = apply(&half, &s);
    assert_true(a.pixels[9] == b.pixels[9]);
    assert_true(b.pixels[0] == 0.0f);
    image_release(&full);
    image_release(&half);
    image_release(&a);
    image_release(&b);
}

static void test_linear_and_gamma_golden(void **state)
{
    struct tonemap_settings linear = settings_of("linear"), gamma = settings_of("gamma");
    struct image in = grey_image(1, 1, 0.18f), out;

    (void)state;
    out = apply(&in, &linear);
    assert_true(fabsf(out.pixels[0] - 0.461356f) < 2e-6f); /* sRGB code of 18 % grey */
    image_release(&out);
    linear.exposure_ev = 1.0;
    out = apply(&in, &linear);
    assert_true(out.pixels[0] == srgb_encode(0.36f));
    image_release(&out);
    out = apply(&in, &gamma);
    assert_true(fabsf(out.pixels[0] - 0.458658f) < 2e-6f); /* 0.18^(1/2.2), once, no sRGB on top */
    image_release(&out);
    set(&gamma, "gamma", 1.0);
    set(&gamma, "gain", 2.0);
    out = apply(&in, &gamma);
    assert_true(fabsf(out.pixels[0] - 0.36f) < 1e-6f);
    image_release(&out);
    image_release(&in);
}

/* Exposure must act on every operator, also on one that normalises. */
static void test_exposure_brightens(void **state)
{
    size_t count;
    const struct tonemap_operator *const *all = tonemap_operators(&count);

    (void)state;
    for (size_t i = 0; i < count; i++) {
        struct tonemap_settings s = settings_of(all[i]->name);
        struct image in = grey_image(2, 1, 0.05f), plain, brighter;

        in.pixels[3] = in.pixels[4] = in.pixels[5] = 5.0f;
        plain = apply(&in, &s);
        s.exposure_ev = 1.5;
        brighter = apply(&in, &s);
        assert_true(brighter.pixels[0] > plain.pixels[0] * 1.2f);
        image_release(&in);
        image_release(&plain);
        image_release(&brighter);
    }
}

/* A ramp from 1e-8 to 1e8 stays a ramp. */
static void test_monotone(void **state)
{
    size_t count;
    const struct tonemap_operator *const *all = tonemap_operators(&count);

    (void)state;
    for (size_t i = 0; i < count; i++) {
        struct tonemap_settings s = settings_of(all[i]->name);
        struct image in = grey_image(1601, 1, 0.0f), out;

        for (int x = 0; x <= 1600; x++)
            for (int c = 0; c < 3; c++)
                in.pixels[3 * x + c] = (float)pow(10.0, x / 100.0 - 8.0);
        out = apply(&in, &s);
        for (int x = 1; x <= 1600; x++)
            assert_true(out.pixels[3 * x] >= out.pixels[3 * x - 3]);
        assert_true(out.pixels[3 * 1600] > out.pixels[0] + 0.9f);
        image_release(&in);
        image_release(&out);
    }
}

static void test_hard_inputs(void **state)
{
    static const float hard[] = {0.0f,  -1.0f,    NAN,   INFINITY, -INFINITY, 1e30f,
                                 FLT_MAX, 1e-40f, 1e-45f, 1.0f};
    size_t operator_count, hard_count = sizeof hard / sizeof *hard;
    const struct tonemap_operator *const *all = tonemap_operators(&operator_count);

    (void)state;
    for (size_t i = 0; i < operator_count; i++)
        for (double ev = -60; ev <= 60; ev += 30)
            for (size_t a = 0; a < hard_count; a++) {
                struct tonemap_settings s = settings_of(all[i]->name);
                struct image one = grey_image(1, 1, hard[a]), out;

                s.exposure_ev = ev;
                out = apply(&one, &s); /* checks the range */
                if (!(hard[a] > 0.0f))
                    assert_true(out.pixels[0] == 0.0f);
                image_release(&out);
                image_release(&one);
                /* The same value beside every other. */
                for (size_t b = 0; b < hard_count; b++) {
                    struct image two = grey_image(5, 3, hard[a]);

                    two.pixels[7] = hard[b]; /* one channel only: pure green */
                    out = apply(&two, &s);
                    image_release(&out);
                    image_release(&two);
                }
            }
}

/* One firefly may darken what the white point serves, never make the picture vanish. */
static void test_firefly(void **state)
{
    struct tonemap_settings s = settings_of("reinhard02");
    struct image in = grey_image(64, 64, 0.18f), out;

    (void)state;
    in.pixels[0] = in.pixels[1] = in.pixels[2] = 1e30f;
    out = apply(&in, &s);
    assert_true(out.pixels[300] > 0.3f && out.pixels[300] < 0.6f);
    image_release(&in);
    image_release(&out);
}

static void test_settings_errors(void **state)
{
    struct tonemap_settings s;
    struct error err = {0};
    struct image in = grey_image(1, 1, 1.0f), out;

    (void)state;
    assert_int_equal(tonemap_settings_init(&s, "filmic?", &err), STATUS_ERR_INPUT);
    assert_non_null(strstr(err.text, "reinhard02"));
    assert_non_null(strstr(err.text, "linear"));
    s = settings_of("reinhard02");
    assert_int_equal(tonemap_settings_set(&s, "key", -1, &err), STATUS_ERR_INPUT);
    assert_non_null(strstr(err.text, "0.001"));
    assert_int_equal(tonemap_settings_set(&s, "key", (double)NAN, &err), STATUS_ERR_INPUT);
    assert_int_equal(tonemap_settings_set(&s, "blur", 1, &err), STATUS_ERR_INPUT);
    assert_non_null(strstr(err.text, "white"));
    s.exposure_ev = (double)NAN;
    assert_int_equal(tonemap_apply(&out, &in, &s, NULL, &err), STATUS_ERR_INPUT);
    assert_null(out.pixels);
    image_release(&in);
}

/* Presets lie within their ranges, names are distinct: what a user interface relies on. */
static void test_registry(void **state)
{
    size_t count;
    const struct tonemap_operator *const *all = tonemap_operators(&count);

    (void)state;
    assert_true(count >= 3);
    for (size_t i = 0; i < count; i++) {
        assert_ptr_equal(tonemap_find(all[i]->name), all[i]);
        assert_true(all[i]->parameter_count <= TONEMAP_PARAMETERS_MAX);
        assert_true(strlen(all[i]->summary) > 10 && strlen(all[i]->source) > 10);
        for (size_t k = 0; k < all[i]->parameter_count; k++) {
            const struct tonemap_parameter *p = &all[i]->parameters[k];
            assert_true(p->preset >= p->min && p->preset <= p->max);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_reinhard_golden),
        cmocka_unit_test(test_reinhard_white_is_maximum),
        cmocka_unit_test(test_reinhard_keeps_color),
        cmocka_unit_test(test_black_does_not_count),
        cmocka_unit_test(test_linear_and_gamma_golden),
        cmocka_unit_test(test_exposure_brightens),
        cmocka_unit_test(test_monotone),
        cmocka_unit_test(test_hard_inputs),
        cmocka_unit_test(test_firefly),
        cmocka_unit_test(test_settings_errors),
        cmocka_unit_test(test_registry),
    };
    return cmocka_run_group_tests_name("tonemap", tests, NULL, NULL);
}
