/* Which tile a client gets next, and what a tile looks like on its way. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/bytes.h"
#include "common/image/half.h"
#include "coordinator/pictures/linear.h"
#include "coordinator/page/picture.h"
#include "tests/support/film_data.h"

enum { WIDTH = 120, HEIGHT = 100, TILES = 8 * 7 };

/* ---- the order ------------------------------------------------------------------------------ */

static void a_new_client_gets_tiles_spread_over_the_picture(void **state)
{
    struct picture p = {0};
    uint32_t shown[TILES], quarters[4] = {0};
    int first;

    (void)state;
    assert_true(picture_begin(&p, WIDTH, HEIGHT));
    assert_int_equal(p.tiles, TILES);
    for (uint32_t i = 0; i < TILES; i++)
        shown[i] = 4;
    picture_turn(&p, 1);
    for (int i = 0; i < 4; i++) {
        int64_t tile = picture_next(&p, shown, &first);
        assert_true(tile >= 0 && first);
        quarters[tile / 8 >= 4 ? tile % 8 >= 4 ? 3 : 2 : tile % 8 >= 4 ? 1 : 0]++;
    }
    for (int i = 0; i < 4; i++)
        assert_int_equal(quarters[i], 1);
    for (uint32_t i = 4; i < TILES; i++)
        assert_true(picture_next(&p, shown, &first) >= 0);
    assert_int_equal(picture_next(&p, shown, &first), PICTURE_NO_TILE);
    assert_int_equal(p.unseen, 0);
    picture_end(&p);
}

static void only_changes_are_sent_and_the_newest(void **state)
{
    struct picture p = {0};
    uint32_t shown[TILES] = {0};
    int first;

    (void)state;
    assert_true(picture_begin(&p, WIDTH, HEIGHT));
    picture_turn(&p, 1);
    assert_int_equal(picture_next(&p, shown, &first), PICTURE_NO_TILE); /* nothing is rendered */
    shown[13] = 2;
    picture_turn(&p, 1);
    assert_int_equal(picture_next(&p, shown, &first), 13);
    assert_true(first);
    assert_int_equal(picture_next(&p, shown, &first), PICTURE_NO_TILE);
    shown[13] = 4;
    shown[13] = 8; /* the client was slow: it gets one of the two */
    picture_turn(&p, 1);
    assert_int_equal(picture_next(&p, shown, &first), 13);
    assert_false(first);
    assert_int_equal(picture_next(&p, shown, &first), PICTURE_NO_TILE);
    picture_turn(&p, 1);
    assert_int_equal(picture_next(&p, shown, &first), PICTURE_NO_TILE);
    picture_end(&p);
}

/* A client that takes one tile a turn, of tiles that all change all the time, gets each before any a second time. */
static void each_tile_gets_its_turn(void **state)
{
    struct picture p = {0};
    uint32_t shown[TILES], got[TILES] = {0};
    int first;

    (void)state;
    assert_true(picture_begin(&p, WIDTH, HEIGHT));
    for (uint32_t i = 0; i < TILES; i++)
        shown[i] = 1;
    for (uint32_t turn = 0; turn < 3 * TILES; turn++) {
        int64_t tile;
        picture_turn(&p, 1);
        tile = picture_next(&p, shown, &first);
        assert_true(tile >= 0);
        got[tile]++;
        assert_int_equal(got[tile], turn / TILES + 1);
        for (uint32_t i = 0; i < TILES; i++)
            shown[i]++;
    }
    picture_end(&p);
}

/* While results keep coming, a tile is sent again with half as many samples again; then as it is. */
static void few_new_samples_wait(void **state)
{
    static const uint32_t counts[] = {2, 3, 4, 5, 6, 8, 9, 12, 13, 4};
    static const int sent[] = {1, 1, 0, 1, 0, 1, 0, 1, 0, 1}; /* the last: it began again */
    struct picture p = {0};
    uint32_t shown[TILES] = {0};
    int first;

    (void)state;
    assert_true(picture_begin(&p, WIDTH, HEIGHT));
    for (size_t i = 0; i < sizeof counts / sizeof *counts; i++) {
        shown[9] = counts[i];
        picture_turn(&p, 0);
        assert_int_equal(picture_next(&p, shown, &first), sent[i] ? 9 : PICTURE_NO_TILE);
    }
    shown[9]++;
    picture_turn(&p, 0);
    assert_int_equal(picture_next(&p, shown, &first), PICTURE_NO_TILE);
    picture_turn(&p, 1);
    assert_int_equal(picture_next(&p, shown, &first), 9);
    assert_int_equal(picture_next(&p, shown, &first), PICTURE_NO_TILE);
    picture_end(&p);
}

/* Tiles that the client never saw come before those that changed. */
static void unseen_tiles_come_first(void **state)
{
    struct picture p = {0};
    uint32_t shown[TILES] = {0};
    int first;

    (void)state;
    assert_true(picture_begin(&p, WIDTH, HEIGHT));
    for (uint32_t i = 0; i < 20; i++)
        shown[i] = 2;
    picture_turn(&p, 1);
    for (int i = 0; i < 20; i++)
        assert_true(picture_next(&p, shown, &first) >= 0);
    for (uint32_t i = 0; i < 20; i++)
        shown[i] = 4;
    for (uint32_t i = 20; i < TILES; i++)
        shown[i] = 2;
    picture_turn(&p, 1);
    for (uint32_t i = 20; i < TILES; i++) {
        assert_true(picture_next(&p, shown, &first) >= 20);
        assert_true(first);
    }
    assert_in_range(picture_next(&p, shown, &first), 0, 19);
    assert_false(first);
    picture_end(&p);
}

/* A turn that did not come to its end, as the client takes little, does not hold up tiles that were just rendered. */
static void unseen_tiles_do_not_wait_for_the_turns_end(void **state)
{
    struct picture p = {0};
    uint32_t shown[TILES] = {0};
    int first;

    (void)state;
    assert_true(picture_begin(&p, WIDTH, HEIGHT));
    shown[3] = shown[4] = 2;
    picture_turn(&p, 1);
    assert_true(picture_next(&p, shown, &first) >= 0);
    assert_true(picture_next(&p, shown, &first) >= 0);
    shown[3] = shown[4] = 4;
    assert_in_range(picture_next(&p, shown, &first), 3, 4); /* changed ones: the search for unseen ones is over */
    shown[20] = 2;
    picture_turn_on(&p);
    assert_int_equal(picture_next(&p, shown, &first), 20);
    assert_true(first);
    assert_in_range(picture_next(&p, shown, &first), 3, 4);
    assert_int_equal(picture_next(&p, shown, &first), PICTURE_NO_TILE);
    picture_end(&p);
}

/* ---- the pixels ----------------------------------------------------------------------------- */

/* Luminance of a replicate's mean, from the whole picture of it. */
static double luminance(const float *rgb, size_t pixel)
{
    return 0.212656 * (double)rgb[3 * pixel] + 0.715158 * (double)rgb[3 * pixel + 1] +
           0.072186 * (double)rgb[3 * pixel + 2];
}

static void check_pixels(const struct film *film)
{
    uint32_t width = film_width(film), height = film_height(film);
    size_t values = (size_t)width * height * 3;
    float *rgb = calloc(values, sizeof *rgb), *of[GROUPS];
    uint8_t record[LINEAR_RECORD_MAX];
    uint32_t errors = 0;

    film_develop(film, rgb);
    for (uint32_t g = 0; g < GROUPS; g++) {
        of[g] = calloc(values, sizeof *of[g]);
        film_develop_group(film, g, of[g]);
    }
    for (uint32_t t = 0; t < film_tile_count(film); t++) {
        struct tile_rect rect = tile_rect_of(width, height, t);
        int both = film_group_samples(film, t, 0) > 0 && film_group_samples(film, t, 1) > 0;
        size_t size = linear_tile(film, t, LINEAR_PICTURE, record);
        if (film_tile_samples(film, t) == 0) {
            assert_int_equal(size, 0);
            continue;
        }
        assert_int_equal(size, LINEAR_HEADER_BYTES + rect.width * rect.height * LINEAR_PIXEL_BYTES);
        assert_int_equal(bytes_get32(record), t);
        assert_int_equal(bytes_get16(record + 4), rect.width);
        assert_int_equal(bytes_get16(record + 6), rect.height);
        assert_int_equal(bytes_get32(record + 8), film_tile_samples(film, t) * LINEAR_SAMPLES_ONE);
        for (uint32_t p = 0; p < rect.width * rect.height; p++) {
            size_t at = (size_t)(rect.y + p / rect.width) * width + rect.x + p % rect.width;
            const uint8_t *halves = record + LINEAR_HEADER_BYTES + p * LINEAR_PIXEL_BYTES;
            double expected = fabs(luminance(of[0], at) - luminance(of[1], at)) / 2;
            double error = (double)half_to_float(bytes_get16(halves + 6));
            for (uint32_t c = 0; c < 3; c++) {
                float value = rgb[at * 3 + c];
                value = value > HALF_MAX ? HALF_MAX : value < -HALF_MAX ? -HALF_MAX : value;
                assert_int_equal(bytes_get16(halves + 2 * c), half_from_float(value));
            }
            if (!both)
                assert_true(isnan(error));
            else if (expected < 60000) /* the groups' means are floats here */
                assert_true(fabs(error - expected) <= expected * 0x1p-10 + 0x1p-22);
            errors += error > 0;
        }
    }
    if (film_tile_samples(film, 0) > 3)
        assert_true(errors > 100);
    for (uint32_t g = 0; g < GROUPS; g++)
        free(of[g]);
    free(rgb);
}

static void pixels_are_the_means_and_their_errors(void **state)
{
    static const uint32_t caps[] = {1, 2, 3, 9, 70};

    (void)state;
    for (size_t i = 0; i < sizeof caps / sizeof *caps; i++) {
        struct film *film = film_data_whole(40, 37, caps[i], 0);
        check_pixels(film);
        film_free(film);
    }
}

/* Tiles with nothing, with one group, with whole passes and with a short one. */
static void a_film_in_work_has_them_too(void **state)
{
    struct film *film = film_data_new(70, 37, 9, 0);

    (void)state;
    film_data_merge(film, 0, 0, 0);
    film_data_merge(film, 1, 1, 0);
    for (uint32_t g = 0; g < GROUPS; g++)
        for (uint32_t p = 0; p < film_pass_count(film, g); p++)
            film_data_merge(film, 2, g, p);
    check_pixels(film);
    film_free(film);
}

static void light_that_a_half_cannot_hold_is_the_largest_half(void **state)
{
    const float pixels[1][4] = {{1e9f, -1e9f, 65504, NAN}};
    uint8_t record[LINEAR_RECORD_MAX];

    (void)state;
    assert_int_equal(linear_record(3, 1, 1, 2.5, pixels, record), LINEAR_HEADER_BYTES + 8);
    assert_int_equal(bytes_get32(record + 8), 640);
    assert_true(half_to_float(bytes_get16(record + 12)) == HALF_MAX);
    assert_true(half_to_float(bytes_get16(record + 14)) == -HALF_MAX);
    assert_true(half_to_float(bytes_get16(record + 16)) == HALF_MAX);
    assert_true(isnan(half_to_float(bytes_get16(record + 18))));
}

/* Every 1,000th float, and every one beside a border: where halves become smaller, and where they end. */
static void every_float_becomes_the_nearest_half(void **state)
{
    static const uint32_t borders[] = {0, 0x33000000u, 0x33800000u, 0x38000000u, 0x38800000u, 0x477fe000u, 0x477ff000u, 0x7f800000u};
    uint8_t record[LINEAR_RECORD_MAX];

    (void)state;
    for (uint64_t i = 0; i < (uint64_t)1 << 32; i += i % 1000 < 8 ? 1 : 992) {
        uint32_t at = i % 1000 < 8 ? borders[i % 1000] + (uint32_t)(i / 1000 % 0x4000) - 0x2000u : (uint32_t)i;
        float value = float_from_bits(at), kept = value > HALF_MAX ? HALF_MAX : value < -HALF_MAX ? -HALF_MAX : value;
        const float pixels[1][4] = {{value, 0, 0, 0}};
        uint16_t half;
        linear_record(0, 1, 1, 1, pixels, record);
        half = bytes_get16(record + LINEAR_HEADER_BYTES);
        if (isnan(value))
            assert_true(isnan(half_to_float(half)));
        else
            assert_int_equal(half, half_from_float(kept));
    }
}

static void layers_have_names(void **state)
{
    (void)state;
    assert_int_equal(linear_layer_parse("color"), LINEAR_PICTURE);
    assert_int_equal(linear_layer_parse("normal"), AOV_NORMAL);
    assert_true(linear_layer_parse("") < LINEAR_PICTURE);
    assert_string_equal(linear_layer_name(LINEAR_PICTURE), "color");
    assert_string_equal(linear_layer_name(AOV_DEPTH), "depth");
    assert_true(linear_has_layer(0, LINEAR_PICTURE));
    assert_true(linear_has_layer(0, AOV_ERROR));
    assert_false(linear_has_layer(0, AOV_DEPTH));
    assert_true(linear_has_layer(1u << AOV_DEPTH, AOV_DEPTH));
    assert_false(linear_has_layer(~0u, AOV_COUNT));
    assert_false(linear_has_layer(~0u, AOV_CRYPTO_OBJECT)); /* it is no picture */
    assert_false(linear_has_layer(~0u, -2));
}

static void aovs_are_those_of_the_exr(void **state)
{
    const uint32_t aovs = 1u << AOV_NORMAL | 1u << AOV_DEPTH | 1u << AOV_UV;
    static const enum aov each[] = {AOV_NORMAL, AOV_DEPTH, AOV_UV, AOV_SAMPLES, AOV_ERROR};
    enum { W = 20, H = 18 };
    struct film *film = film_data_whole(W, H, 9, aovs);
    uint8_t record[LINEAR_RECORD_MAX];
    float *planes = calloc((size_t)W * H * 3, sizeof *planes);

    (void)state;
    for (size_t i = 0; i < sizeof each / sizeof *each; i++) {
        uint32_t channels = film_aov_channels(each[i]);
        film_develop_aov(film, each[i], 0, H, planes);
        assert_true(linear_tile(film, 3, (int)each[i], record) > 0); /* 4 x 2 pixels at 16, 16 */
        for (uint32_t p = 0; p < 4 * 2; p++)
            for (uint32_t c = 0; c < 4; c++) {
                float value = c < channels ? planes[c * W * H + (16 + p / 4) * W + 16 + p % 4] : 0;
                uint16_t have = bytes_get16(record + LINEAR_HEADER_BYTES + p * LINEAR_PIXEL_BYTES + 2 * c);
                value = value > HALF_MAX ? HALF_MAX : value < -HALF_MAX ? -HALF_MAX : value;
                if (c == 3)
                    assert_true(isnan(half_to_float(have)));
                else
                    assert_int_equal(have, half_from_float(value));
            }
    }
    free(planes);
    film_free(film);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_new_client_gets_tiles_spread_over_the_picture),
        cmocka_unit_test(only_changes_are_sent_and_the_newest),
        cmocka_unit_test(each_tile_gets_its_turn),
        cmocka_unit_test(few_new_samples_wait),
        cmocka_unit_test(unseen_tiles_come_first),
        cmocka_unit_test(unseen_tiles_do_not_wait_for_the_turns_end),
        cmocka_unit_test(pixels_are_the_means_and_their_errors),
        cmocka_unit_test(a_film_in_work_has_them_too),
        cmocka_unit_test(light_that_a_half_cannot_hold_is_the_largest_half),
        cmocka_unit_test(every_float_becomes_the_nearest_half),
        cmocka_unit_test(layers_have_names),
        cmocka_unit_test(aovs_are_those_of_the_exr),
    };
    return cmocka_run_group_tests_name("web_picture", tests, NULL, NULL);
}
