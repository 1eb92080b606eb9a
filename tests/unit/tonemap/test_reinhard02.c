/* Dodging and burning: which scale a pixel takes, and what that does at edges. The global
 * operator's numbers are in test_tonemap.c. */
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

static struct tonemap_settings local_settings(void)
{
    struct tonemap_settings s = tonemap_preset("reinhard02");
    struct error err = {0};

    assert_int_equal(tonemap_settings_set_text(&s, "scale", "local", &err), STATUS_OK);
    tonemap_preset_set(&s, "white", 1e9); /* out of the way */
    return s;
}

/* V1 of a constant is the constant up to the borders, of small pictures too: the kernels sum to 1
 * and the borders are mirrored. */
static void test_constant_is_global(void **state)
{
    static const uint32_t sizes[][2] = {{1, 1}, {1, 7}, {7, 1}, {2, 3}, {40, 50}, {600, 5}};

    (void)state;
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++)
        for (double key = 0.01; key < 100.0; key *= 9.0) {
            struct tonemap_settings s = local_settings();
            struct image in = picture_grey(sizes[i][0], sizes[i][1], 0.37f), out;

            tonemap_preset_set(&s, "key", key);
            out = picture_light(&in, &s);
            for (size_t k = 0; k < (size_t)in.width * in.height * 3; k++)
                assert_true(fabs((double)out.pixels[k] - key / (1.0 + key)) < 2e-6);
            image_release(&in);
            image_release(&out);
        }
}

/* With the white point at hand the constant is equation 4. */
static void test_constant_with_white(void **state)
{
    struct tonemap_settings s = local_settings();
    struct image in = picture_grey(9, 9, 5.0f), out;

    (void)state;
    tonemap_preset_set(&s, "white", 4.0);
    tonemap_preset_set(&s, "key", 2.0);
    out = picture_light(&in, &s);
    assert_true(fabs((double)picture_at(&out, 4, 4) - 0.75) < 2e-6);
    image_release(&in);
    image_release(&out);
}

/* The scale of a colour follows from its luminance, globally and locally: red is compressed less than green. */
static void test_colours_by_luminance(void **state)
{
    static const double weights[3] = {0.212656, 0.715158, 0.072186};

    (void)state;
    for (int local = 0; local < 2; local++)
        for (int c = 0; c < 3; c++) {
            struct tonemap_settings s = local ? local_settings() : tonemap_preset("reinhard02");
            struct image in = picture_grey(9, 9, 0), out;
            double key = 0.5, expected = key / weights[c] / (1 + key);

            tonemap_preset_set(&s, "white", 1e9);
            tonemap_preset_set(&s, "key", key);
            for (size_t i = 0; i < 81; i++)
                in.pixels[3 * i + (size_t)c] = 2;
            out = picture_light(&in, &s); /* the log-mean is the luminance: it becomes the key */
            assert_true(fabs((double)out.pixels[3 * 40 + c] - fmin(expected, 1)) < 1e-4);
            assert_true(fabs((double)out.pixels[3 * 40 + (c + 1) % 3]) < 1e-6);
            image_release(&in);
            image_release(&out);
        }
}

/* A bright spot on grey. Threshold 0: every pixel keeps the smallest scale, which is hardly more
 * than the pixel itself. An endless one: every pixel has the largest, under which the spot is
 * spread over a disk. */
static void test_threshold_chooses_scale(void **state)
{
    struct tonemap_settings s = local_settings();
    struct image in = picture_grey(101, 101, 1.0f), out;
    double scaled, spot, alpha_s = 0.35355339059327376 * 26.843545600000001; /* 1.6^7 */
    double peak = 0.0;

    (void)state;
    picture_put(&in, 50, 50, 50.0f);
    scaled = 0.18 / picture_log_mean(&in);
    spot = 50.0 * scaled;
    tonemap_preset_set(&s, "threshold", 0.0);
    out = picture_light(&in, &s);
    /* exp(-8) of the spot's neighbours is the smallest kernel's only side lobe. */
    assert_true(fabs((double)picture_at(&out, 50, 50) - spot / (1.0 + spot)) < 2e-3);
    assert_true(fabs((double)picture_at(&out, 53, 50) - scaled / (1.0 + scaled)) < 1e-6);
    image_release(&out);
    tonemap_preset_set(&s, "threshold", 1e6);
    out = picture_light(&in, &s);
    for (int y = -28; y <= 28; y++)
        for (int x = -28; x <= 28; x++)
            peak += exp(-(x * x + y * y) / (alpha_s * alpha_s));
    for (int x = 0; x <= 20; x += 10) {
        double v = scaled * (1.0 + 49.0 * exp(-x * x / (alpha_s * alpha_s)) / peak);
        double l = x == 0 ? spot : scaled, wanted = fmin(l / (1.0 + v), 1.0);

        assert_true(fabs((double)picture_at(&out, 50 + (size_t)x, 50) - wanted) < 1e-5);
    }
    image_release(&in);
    image_release(&out);
}

/* A scale is taken only if all smaller ones pass too, and it is the last that passes, not the first
 * that fails: far from an edge the largest, beside it a small one. */
static void test_scale_ends_at_edges(void **state)
{
    struct tonemap_settings s = local_settings();
    struct image in = picture_grey(256, 8, 1.0f), out;
    double scaled, dark, bright;

    (void)state;
    for (size_t y = 0; y < 8; y++)
        for (size_t x = 128; x < 256; x++)
            picture_put(&in, x, y, 1000.0f);
    scaled = 0.18 / picture_log_mean(&in);
    dark = scaled / (1.0 + scaled);
    bright = 1000.0 * scaled / (1.0 + 1000.0 * scaled);
    out = picture_light(&in, &s);
    assert_true(fabs((double)picture_at(&out, 2, 3) - dark) < 1e-6);
    assert_true(fabs((double)picture_at(&out, 253, 3) - bright) < 1e-5);
    /* No halo: no pixel is brighter or darker than its half by more than a bound. The dark pixel
     * at the edge sees across it by exp(-8) even at the smallest scale. */
    for (size_t x = 0; x < 127; x++)
        assert_true(fabs((double)picture_at(&out, x, 3) / dark - 1.0) < 0.06);
    assert_true((double)picture_at(&out, 127, 3) / dark > 0.8);
    for (size_t x = 128; x < 256; x++)
        assert_true(fabs((double)picture_at(&out, x, 3) / bright - 1.0) < 0.06);
    /* With the largest scale everywhere there is one, so that the above can fail. */
    image_release(&out);
    tonemap_preset_set(&s, "threshold", 1e6);
    out = picture_light(&in, &s);
    assert_true((double)picture_at(&out, 124, 3) / dark < 0.5);
    image_release(&in);
    image_release(&out);
}

/* Local contrast is what the operator is for: a small dark spot in bright surroundings becomes
 * darker against them than under the global curve. */
static void test_local_contrast(void **state)
{
    struct tonemap_settings local = local_settings(), global = tonemap_preset("reinhard02");
    struct image in = picture_grey(64, 64, 8.0f), a, b;

    (void)state;
    tonemap_preset_set(&global, "white", 1e9);
    tonemap_preset_set(&local, "key", 1.0);
    tonemap_preset_set(&global, "key", 1.0);
    for (size_t i = 0; i < 4; i++)
        picture_put(&in, 30 + i % 2, 30 + i / 2, 7.0f);
    a = picture_light(&in, &local);
    b = picture_light(&in, &global);
    assert_true(picture_at(&a, 30, 30) / picture_at(&a, 0, 0) < 0.97f * picture_at(&b, 30, 30) / picture_at(&b, 0, 0));
    image_release(&in);
    image_release(&a);
    image_release(&b);
}

static void test_threads(void **state)
{
    static const uint32_t sizes[][2] = {{700, 90}, {33, 200}};

    (void)state;
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        struct tonemap_settings s = local_settings();
        struct image in = picture_hard(sizes[i][0], sizes[i][1]);

        picture_threads_agree(&in, &s);
    }
}

static void test_hard_inputs(void **state)
{
    static const float hard[] = {0.0f, -1.0f, NAN, INFINITY, 1e30f, FLT_MAX, 1e-40f, 1.0f};
    static const uint32_t sizes[][2] = {{1, 1}, {1, 9}, {9, 1}, {5, 3}};

    (void)state;
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++)
        for (size_t a = 0; a < sizeof hard / sizeof *hard; a++)
            for (size_t b = 0; b < sizeof hard / sizeof *hard; b++) {
                struct tonemap_settings s = local_settings();
                struct image in = picture_grey(sizes[i][0], sizes[i][1], hard[a]), out;

                in.pixels[1] = hard[b];       /* pure green */
                out = picture_light(&in, &s); /* checks the range */
                if (!(hard[a] > 0.0f) && in.width * in.height > 1)
                    assert_true(out.pixels[5] == 0.0f);
                image_release(&in);
                image_release(&out);
            }
}

/* A firefly darkens what touches it and nothing else. */
static void test_firefly(void **state)
{
    struct tonemap_settings s = local_settings();
    struct image in = picture_grey(64, 64, 0.18f), out;

    (void)state;
    picture_put(&in, 32, 32, 1e30f);
    out = picture_light(&in, &s);
    for (size_t y = 0; y < 64; y++)
        for (size_t x = 0; x < 64; x++)
            if (x < 31 || x > 33 || y < 31 || y > 33)
                assert_true(picture_at(&out, x, y) > 0.1f && picture_at(&out, x, y) < 0.2f);
    image_release(&in);
    image_release(&out);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_constant_is_global),
        cmocka_unit_test(test_colours_by_luminance),
        cmocka_unit_test(test_constant_with_white),
        cmocka_unit_test(test_threshold_chooses_scale),
        cmocka_unit_test(test_scale_ends_at_edges),
        cmocka_unit_test(test_local_contrast),
        cmocka_unit_test(test_threads),
        cmocka_unit_test(test_hard_inputs),
        cmocka_unit_test(test_firefly),
    };
    return cmocka_run_group_tests_name("reinhard02", tests, NULL, NULL);
}
