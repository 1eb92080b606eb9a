/* Pictures in and out in hard cases: what a display or a file shows of light whose code is known. */
#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "common/base/buffer.h"
#include "common/image/image.h"
#include "tests/support/figure.h"
#include "tests/support/statistics.h"
#include "tests/support/tonemap_pictures.h"

/* ---- tone mapping --------------------------------------------------------------------------- */

/* Reinhard's global operator without a white point shows grey of any brightness as KEY / (1 + KEY). */
#define KEY 0.18
#define GREY (KEY / (1 + KEY))

static struct tonemap_settings reinhard(void)
{
    struct tonemap_settings s = tonemap_preset("reinhard02");

    tonemap_preset_set(&s, "white", 1e9);
    return s;
}

/* The display light of pixel (x, y); `in` is released. Not picture_light, which refuses what is out of range. */
static double light_at(struct image *in, const struct tonemap_settings *s, size_t x, size_t y)
{
    struct tonemap_context context = {.threads = 1, .linear = 1};
    struct error err = {0};
    struct image out;
    double light;

    assert_int_equal(tonemap_apply(&out, in, s, &context, &err), STATUS_OK);
    light = (double)picture_at(&out, x, y);
    image_release(in);
    image_release(&out);
    return light;
}

static void figure_grey(const char *what, double light)
{
    figure_within(what, light, GREY * (1 - 1e-5), GREY * (1 + 1e-5), "closed form, tolerance 1e-5");
}

/* The operator divides infinity by infinity where it does not end at the largest float. */
static void infinite_light_is_white(void **state)
{
    struct tonemap_settings s = tonemap_preset("pbr-neutral");
    struct image in = picture_grey(8, 8, INFINITY);

    (void)state;
    figure_within("light of infinity", light_at(&in, &s, 4, 4), 1, 1, "exact");
}

static void dark_pictures_have_a_mean(void **state)
{
    struct tonemap_settings s = reinhard();
    struct image in = picture_grey(9, 9, 1e-6f); /* 1e-6^81 is no double */
    double logs = 0, scaled, right;

    (void)state;
    picture_put(&in, 4, 4, 5e-5f);
    for (int y = -4; y <= 4; y++) /* all windows see it, of 5x5 to 9x9 pixels */
        for (int x = -4; x <= 4; x++)
            logs += log(1 + 49.0 / ((9 - abs(x)) * (9 - abs(y))));
    scaled = KEY / exp(logs / 81);
    right = scaled / (1 + scaled);
    figure_within("light of dark grey beside a brighter pixel", light_at(&in, &s, 0, 0), right * (1 - 1e-5),
                  right * (1 + 1e-5), "closed form, tolerance 1e-5");
}

static void black_pixels_do_not_brighten(void **state)
{
    struct tonemap_settings s = reinhard();
    struct image in = picture_grey(24, 1, 0.3f);
    const double scaled = KEY / pow(5.0 / 9 * 6 / 9 * 7 / 9 * 8 / 9, 1.0 / 16); /* four windows see black */
    const double right = scaled / (1 + scaled);

    (void)state;
    for (size_t x = 0; x < 8; x++)
        picture_put(&in, x, 0, 0);
    figure_within("light of grey beside black", light_at(&in, &s, 20, 0), right * (1 - 1e-5), right * (1 + 1e-5),
                  "closed form, tolerance 1e-5");
}

static void infinite_pixels_do_not_darken(void **state)
{
    struct tonemap_settings s = reinhard();
    struct image in = picture_grey(16, 16, 0.3f);

    (void)state;
    picture_put(&in, 3, 3, INFINITY);
    figure_grey("light of grey beside one infinite pixel", light_at(&in, &s, 9, 9));
}

static void black_stays_black(void **state)
{
    struct tonemap_settings s = tonemap_preset("reinhard02");
    struct image in = picture_grey(8, 8, 0);

    (void)state;
    tonemap_preset_set(&s, "white", 0); /* the paper's: the brightest pixel */
    figure_within("light of a black picture", light_at(&in, &s, 4, 4), 0, 0, "exact");
}

/* Light that is infinite as a float, in a dark room. */
static void the_sun_is_white(void **state)
{
    struct tonemap_settings s = tonemap_preset("reinhard02");
    struct image in = picture_grey(64, 64, 0.001f);

    (void)state;
    tonemap_preset_set(&s, "scale", 1);
    for (size_t i = 0; i < 20 * 20; i++)
        picture_put(&in, 20 + i % 20, 20 + i / 20, INFINITY);
    figure_within("light of the middle of a sun, local operator", light_at(&in, &s, 30, 30), 1, 1, "exact");
}

static void faint_light_is_black(void **state)
{
    struct tonemap_settings s = tonemap_preset("drago03");
    struct image in = picture_grey(8, 8, 1);

    (void)state;
    picture_put(&in, 3, 3, 1e-20f);
    figure_within("light of a pixel of 1e-20 beside 1", light_at(&in, &s, 3, 3), 0, 1e-6, "tolerance 1e-6");
}

/* The contrasts of a picture of one colour are 0, and so is their range. */
static void one_colour_is_grey(void **state)
{
    struct tonemap_settings s = tonemap_preset("mantiuk06");
    struct image in = picture_grey(50, 51, 0.37f), out = picture_light(&in, &s);
    double most = 0;

    (void)state;
    for (size_t i = 0; i < 50 * 51; i++)
        most = fmax(most, (double)out.pixels[3 * i]);
    figure_within("brightest pixel of a picture of one colour", most, 0.07079 * 0.999, 0.07079 * 1.001,
                  "closed form 10^-1.15, tolerance 1e-3");
    image_release(&in);
    image_release(&out);
}

/* Of a background without visible contrast nothing is known, and the display is free to show it as white. */
static void grey_stays_grey(void **state)
{
    struct tonemap_settings s = tonemap_preset("mantiuk08");
    struct image in = picture_grey(64, 64, 0.37f);

    (void)state;
    figure_within("light of a picture that is 0.37 everywhere", light_at(&in, &s, 32, 32), 0.37 / 2, 0.37 * 2,
                  "within a stop");
}

static void bright_light_is_white(void **state)
{
    struct tonemap_settings s = tonemap_preset("aces-hill");
    struct image in = picture_grey(8, 8, 1e25f);

    (void)state;
    figure_within("light of 1e25", light_at(&in, &s, 4, 4), 1, 1, "exact");
}

/* A table whose entries are codes of 2. */
static void a_table_stays_within_the_display(void **state)
{
    static const char cube[] = "LUT_1D_SIZE 2\n2 2 2\n2 2 2\n";
    struct tonemap_context context = {
        .threads = 1, .file_data = (const uint8_t *)cube, .file_size = sizeof cube - 1};
    struct tonemap_settings s = tonemap_preset("lut");
    struct image in = picture_grey(2, 2, 0.5f), out;
    struct error err = {0};

    (void)state;
    s.has_file = 1;
    assert_int_equal(tonemap_apply(&out, &in, &s, &context, &err), STATUS_OK);
    figure_within("display code where a table says 2", (double)picture_at(&out, 0, 0), 0, 1, "the display's range");
    image_release(&in);
    image_release(&out);
}

/* ---- half floats ---------------------------------------------------------------------------- */

/* The picture as a half-float EXR has it. `in` is released. */
static struct image through_half(struct image *in)
{
    struct exr_options options = {.half = 1};
    struct buffer file = BUFFER_INIT;
    struct error err = {0};
    struct image out;

    assert_int_equal(exr_encode(&file, in, &options, &err), STATUS_OK);
    assert_int_equal(exr_decode(&out, file.data, file.size, "half.exr", &err), STATUS_OK);
    buffer_release(&file);
    image_release(in);
    return out;
}

static double half_of(float value)
{
    struct image in = picture_grey(2, 2, value), out = through_half(&in);
    double half = (double)picture_at(&out, 1, 1);

    image_release(&out);
    return half;
}

static void bright_halves_are_finite(void **state)
{
    (void)state;
    figure_within("1e6 in a half-float EXR", half_of(1e6f), 65504, 65504, "exact");
}

static void dark_halves_are_not_black(void **state)
{
    (void)state;
    figure_within("1e-5 in a half-float EXR", half_of(1e-5f), 1e-5 - 0x1p-25, 1e-5 + 0x1p-25, "half a step");
}

static void halves_keep_the_mean(void **state)
{
    struct image in = picture_grey(128, 128, 0), out;
    size_t count = (size_t)128 * 128 * 3;
    struct running_stats error = {0};
    struct test_random random = {7};
    static double wanted[128 * 128 * 3];

    (void)state;
    for (size_t i = 0; i < count; i++)
        wanted[i] = (double)(in.pixels[i] = 1 + test_random_float(&random));
    out = through_half(&in);
    for (size_t i = 0; i < count; i++)
        running_stats_add(&error, ((double)out.pixels[i] - wanted[i]) / wanted[i]);
    figure_z("mean relative error of a half-float EXR", error.mean, running_stats_error(&error), 0, 1e-4, 1);
    image_release(&out);
}

/* ---- pictures that come in ------------------------------------------------------------------ */

/* The mean of all values of a map of eight ones, the first of which is replaced. */
static double mean_with(float hard)
{
    struct image in = picture_grey(4, 2, 1), out;
    struct buffer file = BUFFER_INIT;
    struct error err = {0};
    double sum = 0;

    in.pixels[0] = hard;
    assert_int_equal(exr_encode(&file, &in, &(struct exr_options){0}, &err), STATUS_OK);
    assert_int_equal(image_decode_hdr(&out, file.data, file.size, "map.exr", NULL, &err), STATUS_OK);
    for (size_t i = 0; i < 24; i++)
        sum += (double)out.pixels[i];
    buffer_release(&file);
    image_release(&in);
    image_release(&out);
    return sum / 24;
}

static void maps_are_light(void **state)
{
    (void)state;
    figure_within("mean of a map of 23 ones and a NaN", mean_with(NAN), 23.0 / 24, 23.0 / 24, "exact");
    figure_within("mean of a map of 23 ones and -1000", mean_with(-1000), 23.0 / 24, 23.0 / 24, "exact");
    figure_within("mean of a map of 23 ones and infinity", mean_with(INFINITY), 1, 1, "exact");
}

static void clear_texels_keep_their_colour(void **state)
{
    struct buffer file = BUFFER_INIT;
    struct error err = {0};
    struct image in, out;

    (void)state;
    assert_int_equal(image_init(&in, 2, 1, 4, &err), STATUS_OK);
    memcpy(in.pixels, (const float[8]){0, 0, 0, 0, 0.25f, 0.25f, 0.25f, 0.5f}, 8 * sizeof(float));
    assert_int_equal(exr_encode(&file, &in, &(struct exr_options){0}, &err), STATUS_OK);
    assert_int_equal(image_decode_float(&out, file.data, file.size, "leaf.exr", NULL, &err), STATUS_OK);
    assert_true(out.pixels[4] == 0.5f); /* colour times alpha, undone */
    figure_within("colour of a black texel of alpha 0", (double)out.pixels[0], 0, 0, "exact");
    buffer_release(&file);
    image_release(&in);
    image_release(&out);
}

static void pfm_is_light(void **state)
{
    static const char header[] = "Pf\n2 1\n-1\n";
    static const float texels[2] = {1, NAN};
    uint8_t file[sizeof header - 1 + sizeof texels];
    struct error err = {0};
    struct image map;

    (void)state;
    memcpy(file, header, sizeof header - 1);
    memcpy(file + sizeof header - 1, texels, sizeof texels); /* little-endian, as -1 says */
    assert_int_equal(pfm_decode(&map, file, sizeof file, "map.pfm", &err), STATUS_OK);
    figure_within("sum of a PFM map of 1 and a NaN", (double)map.pixels[0] + (double)map.pixels[3], 1, 1, "exact");
    image_release(&map);
}

/* What is lit by a map of one texel of 1 whose header divides it by `exposure`. */
static double light_of_exposure(const char *exposure)
{
    char file[128];
    int length = snprintf(file, sizeof file - 4, "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=%s\n\n-Y 1 +X 1\n", exposure);
    struct error err = {0};
    struct image map;
    double light = 0;

    memcpy(file + length, "\x80\x80\x80\x81", 4);
    if (image_decode_hdr(&map, (const uint8_t *)file, (size_t)length + 4, "sky.hdr", NULL, &err) == STATUS_OK)
        light = (double)map.pixels[0];
    image_release(&map);
    return light;
}

static void exposures_are_factors(void **state)
{
    (void)state;
    assert_true(light_of_exposure("2") == 0.5);
    figure_within("light of a map of EXPOSURE=0", light_of_exposure("0"), 1, 1, "exact");
    figure_within("light of a map of EXPOSURE=nan", light_of_exposure("nan"), 1, 1, "exact");
}

/* ---- codes ---------------------------------------------------------------------------------- */

static void codes_keep_the_mean(void **state)
{
    struct image in = picture_grey(128, 128, 0);
    struct buffer file = BUFFER_INIT;
    struct error err = {0};
    struct image8 out;
    double sum = 0;

    (void)state;
    for (size_t i = 0; i < (size_t)128 * 128 * 3; i++)
        in.pixels[i] = (float)(0.1 + 0.8 * (double)i / (128 * 128 * 3));
    assert_int_equal(png_encode(&file, &in, &err), STATUS_OK);
    assert_int_equal(png_decode(&out, file.data, file.size, "ramp.png", &err), STATUS_OK);
    for (size_t i = 0; i < (size_t)128 * 128 * 3; i++)
        sum += out.pixels[i] - 255 * (double)in.pixels[i];
    figure_within("mean error of a PNG in codes", sum / (128 * 128 * 3), -0.02, 0.02, "tolerance 0.02 codes");
    buffer_release(&file);
    image_release(&in);
    image8_release(&out);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(infinite_light_is_white),
        cmocka_unit_test(dark_pictures_have_a_mean),
        cmocka_unit_test(black_pixels_do_not_brighten),
        cmocka_unit_test(infinite_pixels_do_not_darken),
        cmocka_unit_test(black_stays_black),
        cmocka_unit_test(the_sun_is_white),
        cmocka_unit_test(faint_light_is_black),
        cmocka_unit_test(one_colour_is_grey),
        cmocka_unit_test(grey_stays_grey),
        cmocka_unit_test(bright_light_is_white),
        cmocka_unit_test(a_table_stays_within_the_display),
        cmocka_unit_test(bright_halves_are_finite),
        cmocka_unit_test(dark_halves_are_not_black),
        cmocka_unit_test(halves_keep_the_mean),
        cmocka_unit_test(maps_are_light),
        cmocka_unit_test(clear_texels_keep_their_colour),
        cmocka_unit_test(pfm_is_light),
        cmocka_unit_test(exposures_are_factors),
        cmocka_unit_test(codes_keep_the_mean),
    };
    return cmocka_run_group_tests_name("output", tests, NULL, NULL);
}
