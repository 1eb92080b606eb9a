/* Textures are filtered by the ray's footprint: scenes/features/horizon.gltf, checks that run from
 * the camera's feet to the horizon, against the closed form of what a lookup must say.
 *
 * The picture has one sample a pixel, and nothing but lookups: what is not filtered enough shows
 * as contrast between pixels, and what is filtered too much as a lack of it, whatever the pixel's
 * own filter would have averaged away. Both are in the contrast of a band of rows: the mean of
 * |2 (v - middle) / (light - dark)|, 1 for checks without any filter.
 *
 *   A box pyramid keeps checks of n texels as they are down to the level where they are one texel,
 *   and is grey from then on. Bilinear lookup makes straight ramps, one texel wide, between them;
 *   so the contrast is (1 - 1/(2n))^2 if phases are equally likely, which the turned ground sees
 *   to. Between two levels, which agree in sign, it is the mix of the two.
 *
 * The beam is half a pixel wide (camera_cone), and t times that at distance t. Expected contrast
 * is averaged over each band; bands differ from it by their few checks' phases, by less than
 * TOLERANCE. Filters half or twice as wide are off by a multiple of it.
 *
 * Where the beam is wider than two checks, each single pixel must be the mean of the two colours'
 * radiances, but for the rounding of that grey to 8 bits: a mean of sRGB codes is darker
 * by up to a half.
 *
 * Each comparison can fail: without filtering, with a filter that is too wide, and with
 * one that averages codes, it must. The seeds are fixed. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "common/base/buffer.h"
#include "common/base/memory.h"
#include "common/image/color.h"
#include "common/image/image.h"
#include "tests/support/figure.h"
#include "tests/support/imported.h"

enum {
    WIDTH = 192,
    HEIGHT = 128,
    FRAMES = 16,
    SUBPIXELS = 4,
    FIRST_ROW = 15,         /* the horizon is in row 11, the ground ends in row 12 */
    GREY_ROWS = 2,          /* from FIRST_ROW on, all single pixels are grey */
    BAND = 8,               /* rows */
    BANDS = (HEIGHT - FIRST_ROW) / BAND,
    CHECK_TEXELS = 8,       /* as in make_features.py's checks.png */
};
#define TOLERANCE 0.012     /* of a band's contrast, which is 0 to 1 */
#define GREY_TOLERANCE 0.02 /* relative; half a step of 8 bits is 0.9 % for the darkest grey */

/* As in make_features.py's horizon_scene(). */
#define EYE_HEIGHT 1.5
#define PITCH 0.25
#define HALF_FOV 0.3
#define TEXEL (2 * 200.0 / 3600 / 16) /* metres */

static const int light_codes[3] = {230, 200, 120}, dark_codes[3] = {30, 60, 20};

static double radiance_of(int code) { return (double)srgb_decode((float)code / 255); }

/* ---- the closed form ------------------------------------------------------------------------ */

static double level_contrast(int level)
{
    double texels = CHECK_TEXELS * pow(0.5, level);

    return texels < 1 ? 0 : pow(1 - 0.5 / texels, 2);
}

/* Of lookups by a beam this many texels wide, linear between powers of two. */
static double beam_contrast(double texels_wide)
{
    int level = 0;

    if (texels_wide <= 1)
        return level_contrast(0);
    while (texels_wide >= 2) {
        texels_wide /= 2;
        level++;
    }
    return level_contrast(level) + (texels_wide - 1) * (level_contrast(level + 1) - level_contrast(level));
}

/* Distance to the ground through a point of the picture, in pixels; INFINITY: above the horizon. */
static double ground_distance(double x, double y)
{
    double side = tan(HALF_FOV) * (2 * x - WIDTH) / HEIGHT, up = tan(HALF_FOV) * (1 - 2 * y / HEIGHT);
    double down = (sin(PITCH) - up * cos(PITCH)) / sqrt(1 + side * side + up * up);

    return down > 0 ? EYE_HEIGHT / down : INFINITY;
}

static double expected_contrast(int band)
{
    double sum = 0;

    for (int y = 0; y < BAND * SUBPIXELS; y++)
        for (int x = 0; x < WIDTH; x++) {
            double row = FIRST_ROW + band * BAND + (y + 0.5) / SUBPIXELS;
            sum += beam_contrast(ground_distance(x + 0.5, row) * tan(HALF_FOV) / HEIGHT / TEXEL);
        }
    return sum / (BAND * SUBPIXELS * WIDTH);
}

/* ---- the picture ---------------------------------------------------------------------------- */

/* What was seen, over FRAMES pictures of one sample a pixel. */
struct seen {
    double contrast[BANDS]; /* mean over the channels */
    double grey_error;      /* the largest of a single pixel far away, relative */
};

static void seen_add(struct seen *s, const float *picture, int decode)
{
    for (int y = FIRST_ROW; y < FIRST_ROW + BANDS * BAND; y++)
        for (int i = 0; i < WIDTH * 3; i++) {
            double light = radiance_of(light_codes[i % 3]), dark = radiance_of(dark_codes[i % 3]);
            double middle = (light + dark) / 2, v = (double)picture[y * WIDTH * 3 + i];
            if (decode)
                v = (double)srgb_decode((float)v);
            s->contrast[(y - FIRST_ROW) / BAND] +=
                fabs(2 * (v - middle) / (light - dark)) / (BAND * WIDTH * 3 * FRAMES);
            if (y < FIRST_ROW + GREY_ROWS)
                s->grey_error = fmax(s->grey_error, fabs(v / middle - 1));
        }
}

/* `decode`: the picture holds codes. */
static struct seen look_by(struct import_result *import, enum texture_filter filter, int decode)
{
    struct render_settings settings = imported_settings(WIDTH, HEIGHT, 1);
    float *picture = calloc((size_t)WIDTH * HEIGHT * 3, sizeof *picture);
    struct seen seen = {{0}, 0};

    settings.texture_filter = filter;
    assert_non_null(picture);
    for (uint32_t frame = 0; frame < FRAMES; frame++) {
        imported_render(import, &settings, frame, picture);
        seen_add(&seen, picture, decode);
    }
    free(picture);
    return seen;
}

static struct seen look(struct import_result *import, int decode)
{
    return look_by(import, TEXTURE_FILTER_CONE, decode);
}

/* The largest difference of a band's contrast from the closed form, with its sign. */
static double contrast_error(const struct seen *seen)
{
    double worst = 0;

    for (int band = 0; band < BANDS; band++) {
        double error = seen->contrast[band] - expected_contrast(band);
        if (fabs(error) > fabs(worst))
            worst = error;
    }
    return worst;
}

/* ---- the tests ------------------------------------------------------------------------------ */

static void open_scene(struct import_result *import)
{
    imported_file("scenes/features/horizon.gltf", import);
    assert_int_equal(import->scene.texture_count, 1);
}

static void test_closed_form(void **state)
{
    struct import_result import;
    struct seen seen;

    (void)state;
    assert_true(expected_contrast(BANDS - 1) > 0.87); /* the finest level near the camera */
    assert_true(expected_contrast(0) < 0.2);          /* hardly any at the horizon */
    open_scene(&import);
    seen = look(&import, 0);
    import_result_release(&import);
    figure_within("grey far away, off by", seen.grey_error, 0, GREY_TOLERANCE, "relative, two steps of 8 bits");
    figure_within("contrast, off by", contrast_error(&seen), -TOLERANCE, TOLERANCE, "of 0 to 1");
}

/* Always the finest texel, as if nothing were filtered. */
static void test_unfiltered(void **state)
{
    struct import_result import;
    struct seen seen;

    (void)state;
    open_scene(&import);
    import.scene.textures[0].nearest = 1;
    seen = look(&import, 0);
    import_result_release(&import);
    assert_true(contrast_error(&seen) > 10 * TOLERANCE);
    assert_true(seen.grey_error > 10 * GREY_TOLERANCE);
}

/* The job's other filters look at the finest level alone: its nearest texel has full contrast at any
 * distance, interpolation loses what the ramps between checks take. */
static void test_other_filters(void **state)
{
    const double ramps = (1 - 0.5 / CHECK_TEXELS) * (1 - 0.5 / CHECK_TEXELS);
    struct import_result import;
    struct seen nearest, bilinear;

    (void)state;
    open_scene(&import);
    nearest = look_by(&import, TEXTURE_FILTER_NEAREST, 0);
    bilinear = look_by(&import, TEXTURE_FILTER_BILINEAR, 0);
    import_result_release(&import);
    for (int band = 0; band < BANDS; band++) {
        if (fabs(nearest.contrast[band] - 1) > 1e-6)
            fail_msg("nearest: band %d has contrast %.4f", band, nearest.contrast[band]);
        if (fabs(bilinear.contrast[band] - ramps) > TOLERANCE)
            fail_msg("bilinear: band %d has contrast %.4f, expected %.4f", band, bilinear.contrast[band], ramps);
    }
}

/* The same checks in an image of half the size are what a filter twice as wide makes of them. */
static void test_too_wide(void **state)
{
    enum { SIDE = CHECK_TEXELS };
    float pixels[SIDE * SIDE * 3];
    struct image image = {SIDE, SIDE, 3, pixels};
    const struct picture_options plain = {.plain = 1};
    struct buffer png = BUFFER_INIT;
    struct error err = {0};
    struct import_result import;
    struct seen seen;

    (void)state;
    for (int i = 0; i < SIDE * SIDE * 3; i++) {
        int x = i / 3 % SIDE, y = i / 3 / SIDE, half = SIDE / 2;
        const int *codes = (x / half + y / half) % 2 ? light_codes : dark_codes;
        pixels[i] = (float)codes[i % 3] / 255;
    }
    assert_int_equal(png_encode_as(&png, &image, &plain, &err), STATUS_OK);
    open_scene(&import);
    for (size_t i = 0; i < import.blob_count; i++)
        if (digest_equal(&import.blobs[i].digest, &import.scene.images[0].blob.digest)) {
            mem_free(import.blobs[i].data);
            import.blobs[i].data = png.data;
            import.blobs[i].size_bytes = png.size;
            memset(&png, 0, sizeof png);
        }
    assert_null(png.data);
    seen = look(&import, 0);
    import_result_release(&import);
    assert_true(contrast_error(&seen) < -5 * TOLERANCE);
    assert_true(seen.grey_error < GREY_TOLERANCE);
}

/* Codes taken as they are, averaged, and decoded afterwards. */
static void test_mean_of_codes(void **state)
{
    struct import_result import;
    struct seen seen;

    (void)state;
    open_scene(&import);
    import.scene.textures[0].encoding = ENCODING_LINEAR;
    seen = look(&import, 1);
    import_result_release(&import);
    assert_true(seen.grey_error > 5 * GREY_TOLERANCE);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_closed_form),
        cmocka_unit_test(test_unfiltered),
        cmocka_unit_test(test_other_filters),
        cmocka_unit_test(test_too_wide),
        cmocka_unit_test(test_mean_of_codes),
    };
    return cmocka_run_group_tests_name("texture filter", tests, NULL, NULL);
}
