/* The tone mapping operators: values of the papers, and inputs that break naive ones. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "common/image/color.h"
#include "common/math/elementary.h"
#include "common/tonemap/tonemap.h"
#include "tests/support/tonemap_pictures.h"

/* The file of operators that need one: the table of `lut` that changes nothing. */
static const char identity_cube[] = "LUT_3D_SIZE 2\n0 0 0\n1 0 0\n0 1 0\n1 1 0\n"
                                    "0 0 1\n1 0 1\n0 1 1\n1 1 1\n";

static struct tonemap_settings settings_of(const char *name)
{
    struct tonemap_settings s;
    struct error err = {0};

    assert_int_equal(tonemap_settings_init(&s, name, &err), STATUS_OK);
    s.has_file = s.op->file_required;
    return s;
}

static struct tonemap_context context_of(const struct tonemap_settings *s)
{
    struct tonemap_context context = {0};

    if (s->has_file) {
        context.file_data = (const uint8_t *)identity_cube;
        context.file_size = sizeof identity_cube - 1;
    }
    return context;
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

static struct image apply_in(const struct image *in, const struct tonemap_settings *s,
                             const struct tonemap_context *context)
{
    struct image out;
    struct error err = {0};

    assert_int_equal(tonemap_apply(&out, in, s, context, &err), STATUS_OK);
    assert_int_equal(out.width, in->width);
    assert_int_equal(out.height, in->height);
    assert_int_equal(out.channels, 3);
    for (size_t i = 0; i < (size_t)out.width * out.height * 3; i++)
        assert_true(out.pixels[i] >= 0.0f && out.pixels[i] <= 1.0f); /* false for NaN */
    return out;
}

static struct image apply(const struct image *in, const struct tonemap_settings *s)
{
    struct tonemap_context context = context_of(s);

    return apply_in(in, s, &context);
}

static struct tonemap_state measure(const struct image *in, const struct tonemap_settings *s)
{
    struct tonemap_context context = context_of(s);
    struct tonemap_state state;
    struct error err = {0};

    assert_int_equal(tonemap_measure(&state, in, s, &context, &err), STATUS_OK);
    return state;
}

static int same_pixels(const struct image *a, const struct image *b)
{
    return a->width == b->width && a->height == b->height &&
           memcmp(a->pixels, b->pixels, (size_t)a->width * a->height * 3 * sizeof(float)) == 0;
}

/* 0 to 1, the same with every run. */
static double number(uint64_t *seed)
{
    *seed = *seed * 6364136223846793005u + 1442695040888963407u;
    return (double)(*seed >> 40) / (double)(1 << 24);
}

/* Colours over six orders of magnitude, some pixels black, a few not finite or negative. */
static struct image wild_image(uint32_t width, uint32_t height, uint64_t seed)
{
    struct image image = grey_image(width, height, 0.0f);

    for (size_t i = 0; i < (size_t)width * height; i++) {
        double level = pow(10.0, 6.0 * number(&seed) - 4.0), kind = number(&seed);

        for (int c = 0; c < 3 && kind < 0.9; c++)
            image.pixels[3 * i + c] = (float)(level * number(&seed));
        if (kind > 0.99)
            image.pixels[3 * i + 1] = i % 3 == 0 ? NAN : i % 3 == 1 ? INFINITY : -1.0f;
    }
    return image;
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
    struct image in = grey_image(64, 2, 0.5f), out;

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

/* Half a black frame must not pull the key: what is black does not count. */
static void test_black_does_not_count(void **state)
{
    struct tonemap_settings s = settings_of("reinhard02");
    struct image full = grey_image(8, 16, 0.5f), half = grey_image(8, 16, 0.5f), a, b;

    (void)state;
    memset(half.pixels, 0, 8 * 8 * 3 * sizeof(float));
    assert_true(fabs(measure(&half, &s).ln_log_mean - log(picture_log_mean(&half))) < 1e-6); /* its rim is half lit */
    s.exposure_ev = log2(0.5 / picture_log_mean(&half));
    a = apply(&full, &s);
    s.exposure_ev = 0;
    b = apply(&half, &s);
    assert_true(fabsf(a.pixels[8 * 15 * 3] - b.pixels[8 * 15 * 3]) < 1e-6f);
    assert_true(b.pixels[0] == 0.0f);
    image_release(&full);
    image_release(&half);
    image_release(&a);
    image_release(&b);
}

/* What is measured is of all lines, wherever the darkest and the brightest are. */
static void test_statistics_of_all_lines(void **state)
{
    static const float greys[5] = {0.3f, 0.1f, 0.9f, 0.4f, 0.2f};
    struct tonemap_settings s = settings_of("drago03");
    double product = 1;

    (void)state;
    for (int i = 0; i < 5; i++)
        product *= (double)greys[i];
    for (size_t first = 0; first < 5; first++) {
        struct image in = grey_image(4, 5 * 18, NAN); /* windows are 9 lines high */
        struct tonemap_state measured;

        for (size_t i = 0; i < (size_t)in.height * 12; i++)
            if (i / 12 % 18 < 9)
                in.pixels[i] = greys[(first + i / (12 * 18)) % 5];
        assert_int_equal(tonemap_measure(&measured, &in, &s, NULL, NULL), STATUS_OK);
        assert_true(measured.counts && fabs(measured.ln_min - log(0.1)) < 1e-6);
        assert_true(fabs(measured.ln_max - log(0.9)) < 1e-6);
        assert_true(fabs(measured.ln_log_mean - log(product) / 5) < 1e-6);
        image_release(&in);
    }
}

/* A dim room, with a bright lamp or without, as so many samples show it: every pixel is noisy, some are unlit, and of 64
 * samples one in fifteen thousand has met a lamp by a mirror. */
static struct image noisy_room(uint32_t seed, int lamp, uint32_t paths)
{
    enum { WIDTH = 160, HEIGHT = 90 };
    struct image room = grey_image(WIDTH, HEIGHT, 0);
    uint32_t random = seed * 2654435761u + 1;

    for (size_t i = 0; i < WIDTH * HEIGHT; i++) {
        size_t x = i % WIDTH, y = i / WIDTH;
        double light = 0.02 * pow(30, (double)x / WIDTH) * (1 + 0.5 * sin((double)y / 7)), sum = 0;

        for (uint32_t k = 0; k < paths; k++) { /* of which one in 16 finds light */
            random = random * 1664525u + 1013904223u;
            sum += random >> 28 ? 0 : 16 * light * (0.5 + (double)(random >> 8 & 0xffff) / 65536);
        }
        random = random * 1664525u + 1013904223u;
        if (random >> 8 < (1u << 24) / 15000 / 64 * paths)
            sum += 64 * 40 * (double)((random >> 4 & 15) + 1);
        if (lamp && x >= 120 && x < 126 && y >= 10 && y < 14)
            sum = paths * 50.0;
        for (int c = 0; c < 3; c++)
            room.pixels[3 * i + (size_t)c] = (float)(sum / paths * (1 - 0.2 * c));
    }
    return room;
}

static double mean_code(const struct tonemap_settings *s, uint32_t seed, int lamp)
{
    struct image room = noisy_room(seed, lamp, 64), out = apply(&room, s);
    size_t count = (size_t)out.width * out.height * 3;
    double sum = 0;

    for (size_t i = 0; i < count; i++)
        sum += (double)out.pixels[i];
    image_release(&room);
    image_release(&out);
    return 255 * sum / (double)count;
}

/* How far apart the mean brightness of two seeds' pictures is, in codes; of eight pairs the worst. */
static double seeds_apart(const struct tonemap_settings *s)
{
    double worst = 0;

    for (uint32_t pair = 0; pair < 8; pair++) {
        int lamp = pair % 2;
        worst = fmax(worst, fabs(mean_code(s, 2 * pair + 1, lamp) - mean_code(s, 2 * pair + 2, lamp)));
    }
    return worst;
}

/* What an operator measures of the whole picture does not follow the noise: another seed has the same brightness. */
static void test_noise_does_not_meter(void **state)
{
    static const struct {
        const char *name, *parameter;
        double value;
    } papers[] = {{"reinhard02", "white", 0}, {"drago03", "percentile", 100}};
    struct tonemap_settings metered = settings_of("linear");

    (void)state;
    for (size_t i = 0; i < sizeof papers / sizeof *papers; i++) {
        struct tonemap_settings s = settings_of(papers[i].name);
        double apart = seeds_apart(&s);

        if (apart > 1)
            fail_msg("%s: two seeds are %.2f codes apart", papers[i].name, apart);
        set(&s, papers[i].parameter, papers[i].value);
        assert_true(seeds_apart(&s) > 1); /* one pixel decides */
    }
    metered.metering = TONEMAP_METERING_KEY;
    assert_true(seeds_apart(&metered) < 1);
}

/* ln of the log-mean of a room by few samples, over that by many. */
static double few_over_many(uint32_t few)
{
    struct tonemap_settings s = settings_of("reinhard02");
    double logs[2];

    for (uint32_t i = 0; i < 2; i++) {
        struct image room = noisy_room(7 + i, 1, i ? 2048 : few);
        logs[i] = measure(&room, &s).ln_log_mean;
        image_release(&room);
    }
    return logs[0] - logs[1];
}

/* A first picture has the exposure of the last one: of 4 samples a pixel, three pixels of four have met no light, and the
 * log-mean of the others alone would be 3 times too large. */
static void test_samples_do_not_meter(void **state)
{
    (void)state;
    for (uint32_t few = 4; few <= 64; few *= 4)
        if (fabs(few_over_many(few)) > 0.15)
            fail_msg("%u samples: the log-mean is off by %.3f (ln)", few, few_over_many(few));
}

/* By its definition: of pictures that need several patches, at their corners and edges. */
static void test_log_mean(void **state)
{
    static const uint32_t sizes[][2] = {{1, 1}, {7, 3}, {64, 64}, {517, 131}, {513, 129}, {1, 300}, {1100, 1}};
    struct tonemap_settings s = settings_of("reinhard02");

    (void)state;
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++)
        for (int wild = 0; wild < 2; wild++) {
            struct image in = wild_image(sizes[i][0], sizes[i][1], 7);
            double off;

            for (size_t k = 0; k < (size_t)in.width * in.height * 3; k++) /* tame: no pixel is limited */
                in.pixels[k] = wild || !(in.pixels[k] > 0) ? in.pixels[k] : 1 + fmodf(in.pixels[k], 7);
            in.pixels[0] = in.pixels[1] = in.pixels[2] = 0.7f;
            off = measure(&in, &s).ln_log_mean - log(picture_log_mean(&in));
            if (fabs(off) > (wild ? 0.05 : 1e-9)) /* the limit of bright pixels is rough */
                fail_msg("%ux%u: the log-mean is off by %g (ln)", sizes[i][0], sizes[i][1], off);
            image_release(&in);
        }
}

/* A bright world beside a dark one: sums of windows by differences would keep the former's rounding. */
static void test_log_mean_beside_the_sun(void **state)
{
    struct tonemap_settings s = settings_of("reinhard02");
    struct image in = grey_image(600, 140, 1e-30f);

    (void)state;
    for (size_t i = 0; i < (size_t)600 * 140; i++)
        if (i % 600 < 300)
            picture_put(&in, i % 600, i / 600, 1e30f);
    assert_true(fabs(measure(&in, &s).ln_log_mean - log(picture_log_mean(&in))) < 0.01);
    image_release(&in);
}

/* An object of many greys before black, from (x, y) on. */
static struct image before_black(size_t x, size_t y, int mirrored)
{
    struct image in = grey_image(640, 200, 0);

    for (size_t v = 0; v < 60; v++)
        for (size_t u = 0; u < 300 - v; u++)
            picture_put(&in, mirrored ? 639 - x - u : x + u, y + v, (float)((1 + (u * u + 3 * v) % 17) * (u * v % 5 ? 1 : 90)));
    return in;
}

/* What moves through the picture, or is mirrored, has the same log-mean: an animation does not flicker by it. */
static void test_log_mean_does_not_flicker(void **state)
{
    struct tonemap_settings s = settings_of("reinhard02");
    double first = 0;

    (void)state;
    for (size_t moved = 0; moved < 33; moved++) {
        struct image in = before_black(100 + 7 * moved, 20 + 3 * moved, moved == 32);
        double log_mean = measure(&in, &s).ln_log_mean;

        first = moved ? first : log_mean;
        if (fabs(log_mean - first) > 1e-9)
            fail_msg("moved by %zu and %zu pixels the log-mean changes by %.3g %%", 7 * moved, 3 * moved,
                     100 * expm1(log_mean - first));
        image_release(&in);
    }
}

/* Tiles that are a sample of a picture are not neighbours: in any order they have the same log-mean. */
static void test_tiles_that_lie_apart(void **state)
{
    enum { SIDE = 16, ACROSS = 8, DOWN = 4 };
    struct tonemap_settings s = settings_of("reinhard02");
    struct tonemap_context apart = {.apart = SIDE}, beside = {0};
    struct image in = wild_image(SIDE * ACROSS, SIDE * DOWN, 3), moved = grey_image(SIDE * ACROSS, SIDE * DOWN, 0);
    double logs[2][2];

    (void)state;
    for (size_t i = 0; i < (size_t)in.width * in.height; i++) { /* every other tile is bright; moved, they are all together */
        const size_t x = i % in.width, y = i / in.width, tile = y / SIDE * ACROSS + x / SIDE;
        const size_t to = tile % 2 * ACROSS * DOWN / 2 + tile / 2;
        const size_t at = (to / ACROSS * SIDE + y % SIDE) * in.width + to % ACROSS * SIDE + x % SIDE;

        for (size_t c = 0; c < 3; c++) {
            in.pixels[3 * i + c] *= tile % 2 ? 1000.0f : 1.0f;
            moved.pixels[3 * at + c] = in.pixels[3 * i + c];
        }
    }
    for (int k = 0; k < 2; k++) {
        struct tonemap_state state_of[2];

        assert_int_equal(tonemap_measure(&state_of[0], k ? &moved : &in, &s, &apart, NULL), STATUS_OK);
        assert_int_equal(tonemap_measure(&state_of[1], k ? &moved : &in, &s, &beside, NULL), STATUS_OK);
        logs[k][0] = state_of[0].ln_log_mean;
        logs[k][1] = state_of[1].ln_log_mean;
    }
    assert_true(fabs(logs[0][0] - logs[1][0]) < 1e-9);
    assert_true(fabs(logs[0][1] - logs[1][1]) > 0.1);
    image_release(&in);
    image_release(&moved);
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
    set(&gamma, "gain", 2.0);
    out = apply(&in, &gamma);
    assert_true(fabsf(out.pixels[0] - 2 * 0.458658f) < 4e-6f); /* of the code, not of the light */
    image_release(&out);
    set(&gamma, "gamma", 1.0);
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
        struct image in, plain, brighter;

        if (all[i]->adaptive)
            continue; /* it fits the picture to the display, however bright it is */
        in = grey_image(2, 1, 0.05f);
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

/* All black, one lit pixel, half black, primaries, and shapes of one line or column. */
static void test_hard_shapes(void **state)
{
    static const uint32_t sizes[][2] = {{1, 1}, {1, 2}, {1, 37}, {37, 1}, {3, 2}, {64, 48}};
    size_t operator_count;
    const struct tonemap_operator *const *all = tonemap_operators(&operator_count);

    (void)state;
    for (size_t i = 0; i < operator_count; i++)
        for (size_t k = 0; k < sizeof sizes / sizeof *sizes; k++) {
            struct tonemap_settings s = settings_of(all[i]->name);
            size_t count = (size_t)sizes[k][0] * sizes[k][1];
            struct image in = grey_image(sizes[k][0], sizes[k][1], 0.0f), out = apply(&in, &s);

            for (size_t p = 0; p < count * 3; p++) /* black stays black */
                assert_true(out.pixels[p] == 0.0f);
            image_release(&out);
            for (int c = 0; c < 3; c++) { /* one lit pixel, of a primary */
                in.pixels[count / 2 * 3 + (size_t)c] = 3.0f;
                out = apply(&in, &s);
                assert_true(out.pixels[count / 2 * 3 + (size_t)c] > 0.05f);
                image_release(&out);
                in.pixels[count / 2 * 3 + (size_t)c] = 0.0f;
            }
            for (size_t p = 0; p < count / 2 * 3; p++)
                in.pixels[p] = 0.18f;
            out = apply(&in, &s);
            assert_true(count == 1 || out.pixels[0] > 0.05f);
            image_release(&out);
            image_release(&in);
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

static const char *const fruit[] = {"apple", "pear", NULL};
static const struct tonemap_parameter fake_parameters[] = {
    {"count", 1.0, 9.0, 4.0, "how many", TONEMAP_INTEGER, NULL},
    {"fruit", 0.0, 1.0, 0.0, "which", TONEMAP_CHOICE, fruit},
    {"weight", 0.0, 2.5, 1.0, "how much", TONEMAP_NUMBER, NULL},
};
static const struct tonemap_operator fake = {
    .name = "fake", .parameters = fake_parameters, .parameter_count = 3};

static void refuse_text(struct tonemap_settings *s, const char *parameter, const char *text, const char *said)
{
    struct error err = {0};

    assert_int_equal(tonemap_settings_set_text(s, parameter, text, &err), STATUS_ERR_INPUT);
    assert_non_null(strstr(err.text, said));
}

static void test_settings_by_text(void **state)
{
    struct tonemap_settings s = {.op = &fake};
    struct error err = {0};

    (void)state;
    assert_int_equal(tonemap_settings_set_text(&s, "count", "7", &err), STATUS_OK);
    assert_true(s.values[0] == 7.0);
    assert_int_equal(tonemap_settings_set_text(&s, "fruit", "pear", &err), STATUS_OK);
    assert_true(s.values[1] == 1.0);
    assert_int_equal(tonemap_settings_set_text(&s, "fruit", "apple", &err), STATUS_OK);
    assert_true(s.values[1] == 0.0);
    assert_int_equal(tonemap_settings_set_text(&s, "weight", "1.5e-1", &err), STATUS_OK);
    assert_true(s.values[2] == 0.15);
    refuse_text(&s, "count", "7.5", "whole");
    refuse_text(&s, "count", "10", "9");
    refuse_text(&s, "count", "seven", "seven");
    refuse_text(&s, "fruit", "plum", "apple, pear");
    refuse_text(&s, "fruit", "1", "apple, pear");
    refuse_text(&s, "weight", "", "not a number");
    refuse_text(&s, "weight", "1x", "1x");
    refuse_text(&s, "weight", "nan", "2.5");
    refuse_text(&s, "height", "1", "weight");
    assert_int_equal(tonemap_settings_set(&s, "fruit", 0.5, &err), STATUS_ERR_INPUT);
    assert_true(s.values[0] == 7.0 && s.values[1] == 0.0 && s.values[2] == 0.15);
}

static void test_validation(void **state)
{
    struct tonemap_settings good = settings_of("reinhard02"), s = good;
    struct error err = {0};

    (void)state;
    assert_int_equal(tonemap_settings_validate(&good, &err), STATUS_OK);
    s.metering_percentile = 101.0;
    assert_int_equal(tonemap_settings_validate(&s, &err), STATUS_ERR_INPUT);
    s = good;
    s.white_kelvin = 1000.0;
    assert_int_equal(tonemap_settings_validate(&s, &err), STATUS_ERR_INPUT);
    s = good;
    s.white_kelvin = (double)NAN;
    assert_int_equal(tonemap_settings_validate(&s, &err), STATUS_ERR_INPUT);
    s = good;
    s.temporal = (uint32_t)look_rows[LOOK_temporal].most + 1;
    assert_int_equal(tonemap_settings_validate(&s, &err), STATUS_ERR_INPUT);
    s = good;
    s.has_file = 1;
    assert_int_equal(tonemap_settings_validate(&s, &err), STATUS_ERR_INPUT);
    s = settings_of("lut");
    assert_int_equal(tonemap_settings_validate(&s, &err), STATUS_OK);
    s.has_file = 0;
    assert_int_equal(tonemap_settings_validate(&s, &err), STATUS_ERR_INPUT);
    assert_non_null(strstr(err.text, ".cube"));
    for (int m = 0; m < TONEMAP_METERING_COUNT; m++)
        assert_int_equal(tonemap_metering_parse(tonemap_metering_name((enum tonemap_metering)m)), m);
    assert_int_equal(tonemap_metering_parse("guess"), -1);
}

/* ---- metering ------------------------------------------------------------------------------- */

static void test_metering_key(void **state)
{
    struct tonemap_settings s = settings_of("linear");
    struct image in = picture_stripes((const float[]){0.5f, 1.0f, 2.0f}, 3), out; /* the log-mean is 1 */

    (void)state;
    s.metering = TONEMAP_METERING_KEY;
    out = apply(&in, &s);
    assert_true(fabsf(out.pixels[PICTURE_STRIPE * 3] - srgb_encode(0.18f)) < 2e-7f);
    assert_true(fabsf(out.pixels[2 * PICTURE_STRIPE * 3] - srgb_encode(0.36f)) < 2e-7f);
    image_release(&out);
    s.exposure_ev = -1.0; /* on top of it */
    out = apply(&in, &s);
    assert_true(fabsf(out.pixels[2 * PICTURE_STRIPE * 3] - srgb_encode(0.18f)) < 2e-7f);
    image_release(&out);
    image_release(&in);
}

static int compare_floats(const void *a, const void *b)
{
    float x = *(const float *)a, y = *(const float *)b;

    return (x > y) - (x < y);
}

/* The values of the pixels that count, sorted. */
static size_t sort_values(const struct image *in, int largest, float *values)
{
    size_t count = 0;

    for (size_t i = 0; i < (size_t)in->width * in->height; i++) {
        const float *p = in->pixels + 3 * i;
        double r = fmax((double)p[0], 0), g = fmax((double)p[1], 0), b = fmax((double)p[2], 0);
        double value = largest ? fmax(r, fmax(g, b)) : 0.212656 * r + 0.715158 * g + 0.072186 * b;

        if (isfinite(p[0]) && isfinite(p[1]) && isfinite(p[2]) && value > 0.0)
            values[count++] = (float)value;
    }
    qsort(values, count, sizeof *values, compare_floats);
    return count;
}

static void test_percentile_is_exact(void **state)
{
    static const double percents[] = {1e-6, 1.0, 12.5, 50.0, 90.0, 99.0, 99.9, 100.0};
    static float values[67 * 41];
    struct image in = wild_image(67, 41, 5);
    struct tonemap_settings s = settings_of("linear"), normalize = settings_of("normalize");

    (void)state;
    s.metering = TONEMAP_METERING_PERCENTILE;
    for (size_t k = 0; k < sizeof percents / sizeof *percents; k++) {
        size_t count = sort_values(&in, 0, values);
        size_t rank = (size_t)(percents[k] / 100.0 * (double)(count - 1) + 0.5);
        struct tonemap_state found;

        s.metering_percentile = percents[k];
        found = measure(&in, &s);
        assert_true(fabs(found.metered_ev + log2((double)values[rank])) < 1e-9);
        assert_int_equal(sort_values(&in, 1, values), count); /* of normalize: the largest channel */
        set(&normalize, "percentile", percents[k]);
        /* Its pixels that are not a number are black, so they do not count either. */
        assert_true(fabs(measure(&in, &normalize).values[0] - log((double)values[rank])) < 1e-9);
    }
    image_release(&in);
}

/* The metering sees the picture after white balance. */
static void test_metering_after_balance(void **state)
{
    struct tonemap_settings s = settings_of("linear");
    struct image in = grey_image(2, 2, 0.4f), out;

    (void)state;
    for (int i = 0; i < 12; i += 3) {
        in.pixels[i] = 0.9f;
        in.pixels[i + 2] = 0.1f;
    }
    s.white_kelvin = 3000.0;
    for (int m = TONEMAP_METERING_KEY; m <= TONEMAP_METERING_PERCENTILE; m++) {
        float light[3];
        double luminance;

        s.metering = (enum tonemap_metering)m;
        s.exposure_ev = m == TONEMAP_METERING_PERCENTILE ? -2.0 : 0.0;
        out = apply(&in, &s);
        for (int c = 0; c < 3; c++)
            light[c] = srgb_decode(out.pixels[c]);
        luminance = 0.212656 * (double)light[0] + 0.715158 * (double)light[1] + 0.072186 * (double)light[2];
        assert_true(fabs(luminance - (m == TONEMAP_METERING_KEY ? 0.18 : 0.25)) < 1e-6);
        image_release(&out);
    }
    image_release(&in);
}

/* normalize: its reference becomes white, exposure acts on it, one firefly does nothing. */
static void test_normalize(void **state)
{
    struct tonemap_settings s = settings_of("normalize");
    struct image in = grey_image(50, 50, 2.0f), out;

    (void)state;
    in.pixels[0] = 1e30f;
    in.pixels[3] = 1.0f;
    out = apply(&in, &s);
    assert_true(fabsf(out.pixels[3] - srgb_encode(0.5f)) < 1e-6f);
    assert_true(out.pixels[6] > 0.999999f);
    image_release(&out);
    s.exposure_ev = -1.0;
    out = apply(&in, &s);
    assert_true(fabsf(out.pixels[3] - srgb_encode(0.25f)) < 1e-6f);
    image_release(&out);
    set(&s, "percentile", 100.0);
    in.pixels[0] = 4.0f;
    out = apply(&in, &s);
    assert_true(fabsf(out.pixels[0] - srgb_encode(0.5f)) < 1e-6f);
    assert_true(fabsf(out.pixels[3] - srgb_encode(0.125f)) < 1e-6f);
    image_release(&out);
    image_release(&in);
}

/* ---- white balance -------------------------------------------------------------------------- */

/* Linear Rec. 709 of a light by its chromaticity, Y = 1 (the usual published matrix). */
static void light_of(double x, double y, float rgb[3])
{
    const double xyz[3] = {x / y, 1.0, (1.0 - x - y) / y};
    static const double m[3][3] = {{3.2404542, -1.5371385, -0.4985314},
                                   {-0.9692660, 1.8760108, 0.0415560},
                                   {0.0556434, -0.2040259, 1.0572252}};

    for (int i = 0; i < 3; i++)
        rgb[i] = (float)(m[i][0] * xyz[0] + m[i][1] * xyz[1] + m[i][2] * xyz[2]);
}

/* The largest ratio between channels, less 1, of a grey card in that light after balancing. */
static double cast_of(double kelvin, double x, double y)
{
    struct tonemap_settings s = settings_of("linear");
    struct image in = grey_image(1, 1, 0.0f), out;
    float light[3], high, low;

    light_of(x, y, light);
    for (int c = 0; c < 3; c++)
        in.pixels[c] = 0.3f * light[c];
    s.white_kelvin = kelvin;
    out = apply(&in, &s);
    for (int c = 0; c < 3; c++)
        light[c] = srgb_decode(out.pixels[c]);
    high = fmaxf(light[0], fmaxf(light[1], light[2]));
    low = fminf(light[0], fminf(light[1], light[2]));
    assert_true(fabsf(light[1] - 0.3f) < 0.01f); /* no brighter, no darker */
    image_release(&in);
    image_release(&out);
    return (double)(high / low) - 1.0;
}

/* Planck's law under the colour matching functions of Wyman, Sloan, Shirley (JCGT 2(2), 2013, the fit
 * of several lobes), which is good for 0.002 of x and y. */
static void planck(double kelvin, double *x, double *y)
{
    static const double lobes[7][5] = {
        /* of, weight, mean, 1/width below, above */
        {0, 1.056, 599.8, 1 / 37.9, 1 / 31.0}, {0, 0.362, 442.0, 1 / 16.0, 1 / 26.7},
        {0, -0.065, 501.1, 1 / 20.4, 1 / 26.2}, {1, 0.821, 568.8, 1 / 46.9, 1 / 40.5},
        {1, 0.286, 530.9, 1 / 16.3, 1 / 31.1}, {2, 1.217, 437.0, 1 / 11.8, 1 / 36.0},
        {2, 0.681, 459.0, 1 / 26.0, 1 / 13.8}};
    double xyz[3] = {0};

    for (double nm = 360.0; nm <= 830.0; nm += 1.0) {
        double power = pow(nm / 560.0, -5.0) / (exp(1.438777e7 / (nm * kelvin)) - 1.0);

        for (int i = 0; i < 7; i++) {
            double d = (nm - lobes[i][2]) * lobes[i][nm < lobes[i][2] ? 3 : 4];
            xyz[(int)lobes[i][0]] += power * lobes[i][1] * exp(-0.5 * d * d);
        }
    }
    *x = xyz[0] / (xyz[0] + xyz[1] + xyz[2]);
    *y = xyz[1] / (xyz[0] + xyz[1] + xyz[2]);
}

static void test_white_balance(void **state)
{
    static const double hot[] = {2000.0, 2400.0, 3000.0, 3900.0};

    (void)state;
    /* The CIE's illuminants A, D50, D55, D65 and D75. */
    assert_true(cast_of(2856.0, 0.44758, 0.40745) < 0.02);
    assert_true(cast_of(5003.0, 0.34567, 0.35850) < 0.005);
    assert_true(cast_of(5503.0, 0.33242, 0.34743) < 0.005);
    assert_true(cast_of(6504.0, 0.31271, 0.32902) < 0.002);
    assert_true(cast_of(7504.0, 0.29902, 0.31485) < 0.005);
    /* Planck's radiators, as tabulated. */
    assert_true(cast_of(2000.0, 0.52669, 0.41331) < 0.02);
    assert_true(cast_of(2500.0, 0.47701, 0.41368) < 0.01);
    assert_true(cast_of(3000.0, 0.43693, 0.40407) < 0.01);
    for (size_t i = 0; i < sizeof hot / sizeof *hot; i++) {
        double x, y;

        planck(hot[i], &x, &y);
        assert_true(cast_of(hot[i], x, y) < 0.06);
    }
    /* And without it the cast is there. */
    assert_true(cast_of(6504.0, 0.34567, 0.35850) > 0.1);
}

static void test_white_balance_of_daylight_is_none(void **state)
{
    struct tonemap_settings s = settings_of("linear");
    struct image in = grey_image(1, 1, 0.2f), a, b;

    (void)state;
    in.pixels[0] = 0.6f;
    in.pixels[2] = 0.05f;
    a = apply(&in, &s);
    s.white_kelvin = 6504.0;
    b = apply(&in, &s);
    for (int c = 0; c < 3; c++)
        assert_true(fabsf(srgb_decode(a.pixels[c]) - srgb_decode(b.pixels[c])) < 1e-3f * srgb_decode(a.pixels[0]));
    image_release(&in);
    image_release(&a);
    image_release(&b);
}

/* ---- states --------------------------------------------------------------------------------- */

static void test_state_mean(void **state)
{
    struct tonemap_settings s = settings_of("normalize");
    struct image dark = grey_image(2, 2, 1.0f), bright = grey_image(2, 2, 4.0f);
    struct image black = grey_image(2, 2, 0.0f), out;
    struct tonemap_state a, b, none, mean;
    const struct tonemap_state *states[] = {&a, &none, &b};
    struct tonemap_context context = {.state = &mean};

    (void)state;
    s.metering = TONEMAP_METERING_KEY;
    s.exposure_ev = 3.0; /* no part of the state */
    a = measure(&dark, &s);
    b = measure(&bright, &s);
    none = measure(&black, &s);
    assert_true(a.counts && b.counts && !none.counts);
    tonemap_state_mean(&mean, states, 3, &s);
    assert_true(mean.counts);
    assert_true(fabs(mean.metered_ev - log2(0.18 / 2.0)) < 1e-6); /* 2: between 1 and 4 */
    assert_true(fabs(mean.ln_log_mean - log(0.18)) < 1e-6);
    assert_true(fabs(mean.ln_max - log(0.18)) < 1e-6);
    assert_true(fabs(mean.values[0] - log(0.18)) < 1e-6);
    /* Alone both are white; by the mean the dark one is half as bright, and three stops up. */
    s.exposure_ev = -1.0;
    out = apply_in(&dark, &s, &context);
    assert_true(fabsf(out.pixels[0] - srgb_encode(0.25f)) < 1e-6f);
    image_release(&out);
    tonemap_state_mean(&mean, states + 1, 1, &s); /* black frames only */
    assert_false(mean.counts);
    out = apply_in(&black, &s, &context);
    assert_true(out.pixels[0] == 0.0f);
    image_release(&out);
    image_release(&dark);
    image_release(&bright);
    image_release(&black);
}

/* Given its own state, a picture is what it is without; with any number of threads; and a black
 * frame's state serves a frame that is not black. */
static void test_states_and_threads(void **state)
{
    static const unsigned threads[] = {1, 2, 3, 7};
    struct image in = wild_image(97, 61, 9);
    size_t count;
    const struct tonemap_operator *const *all = tonemap_operators(&count);

    (void)state;
    for (size_t i = 0; i < count; i++) {
        struct tonemap_settings s = settings_of(all[i]->name);
        struct tonemap_context context = context_of(&s);
        struct tonemap_state own, none = {0};
        struct image alone, out;

        s.metering = TONEMAP_METERING_KEY;
        s.exposure_ev = 0.7;
        s.white_kelvin = 4500.0;
        alone = apply(&in, &s);
        own = measure(&in, &s);
        for (size_t t = 0; t < sizeof threads / sizeof *threads; t++) {
            context.threads = threads[t];
            context.state = t % 2 ? &own : NULL;
            out = apply_in(&in, &s, &context);
            assert_true(same_pixels(&alone, &out));
            image_release(&out);
        }
        context.state = &none;
        out = apply_in(&in, &s, &context);
        image_release(&out);
        image_release(&alone);
    }
    image_release(&in);
}

/* Exchange the 16x16 tiles of a picture of whole tiles: tile k goes to place (5 k + 3) mod count. */
static struct image shuffle_tiles(const struct image *in, int back)
{
    struct image out = grey_image(in->width, in->height, 0.0f);
    uint32_t across = in->width / 16, count = across * (in->height / 16);

    for (uint32_t k = 0; k < count; k++) {
        uint32_t to = (5 * k + 3) % count, from = k;

        if (back) {
            from = to;
            to = k;
        }
        for (uint32_t line = 0; line < 16; line++)
            memcpy(out.pixels + 3 * (((size_t)to / across * 16 + line) * in->width + (size_t)to % across * 16),
                   in->pixels + 3 * (((size_t)from / across * 16 + line) * in->width + (size_t)from % across * 16),
                   16 * 3 * sizeof(float));
    }
    return out;
}

/* Operators that look at one pixel at a time do not care where it lies, so that no tile shows:
 * their statistics are of the whole picture. */
/* A wall that never changes, beside a light that flickers: what the operators make of the wall must
 * waver less when the states of six frames are averaged. */
static void test_averaging_calms_a_sequence(void **state)
{
    static const char *const names[] = {"reinhard02", "drago03", "normalize", "mantiuk08"};
    enum { FRAMES = 24, WINDOW = 6 };

    (void)state;
    for (size_t n = 0; n < sizeof names / sizeof *names; n++) {
        struct tonemap_settings s = settings_of(names[n]);
        struct tonemap_state *states = calloc(FRAMES, sizeof *states), *mean = malloc(sizeof *mean);
        const struct tonemap_state *window[WINDOW];
        struct tonemap_context context = {.state = mean};
        double last[2] = {0}, jumps[2] = {0};
        uint32_t random = 1;

        assert_true(states && mean);
        for (int f = 0; f < FRAMES; f++) {
            struct image frame = grey_image(24, 16, 0.2f), alone, calm;

            random = random * 1664525u + 1013904223u;
            for (size_t i = 0; i < 24 * 16; i++) /* the wall has some contrast */
                for (int c = 0; c < 3; c++)
                    frame.pixels[3 * i + (size_t)c] *= 1.0f + 0.1f * (float)(i % 3);
            for (size_t i = 0; i < 24 * 2 * 3; i++)
                frame.pixels[i] = 5.0f + 100.0f * (float)(random >> 24) / 255.0f;
            assert_int_equal(tonemap_measure(&states[f], &frame, &s, NULL, NULL), STATUS_OK);
            if (f >= WINDOW - 1) {
                size_t wall = (24 * 10 + 12) * 3;
                for (int k = 0; k < WINDOW; k++)
                    window[k] = &states[f - k];
                tonemap_state_mean(mean, window, WINDOW, &s);
                alone = apply(&frame, &s);
                calm = apply_in(&frame, &s, &context);
                if (f >= WINDOW) {
                    jumps[0] += fabs((double)alone.pixels[wall] - last[0]);
                    jumps[1] += fabs((double)calm.pixels[wall] - last[1]);
                }
                last[0] = (double)alone.pixels[wall];
                last[1] = (double)calm.pixels[wall];
                image_release(&alone);
                image_release(&calm);
            }
            image_release(&frame);
        }
        assert_true(jumps[0] > 0.01);
        if (jumps[1] > 0.5 * jumps[0])
            fail_msg("%s: %g instead of %g", names[n], jumps[1], jumps[0]);
        free(states);
        free(mean);
    }
}

static void test_tiles_do_not_show(void **state)
{
    static const char *const names[] = {"aces", "aces-hill", "agx",       "pbr-neutral", "hable",
                                        "lut",  "gamma",     "normalize", "linear"};
    struct image in = wild_image(112, 64, 3), shuffled;

    (void)state;
    for (size_t i = 0; i < 112 * 64 * 3; i++) /* one tile brighter than the others */
        in.pixels[i] *= i / 3 % 112 < 16 && i / 336 < 16 ? 30.0f : 1.0f;
    shuffled = shuffle_tiles(&in, 0);
    assert_false(same_pixels(&in, &shuffled));
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        struct tonemap_settings s = settings_of(names[i]);
        struct image a, b, ordered;

        s.metering = TONEMAP_METERING_PERCENTILE;
        a = apply(&in, &s);
        b = apply(&shuffled, &s);
        ordered = shuffle_tiles(&b, 1);
        assert_true(same_pixels(&a, &ordered));
        image_release(&a);
        image_release(&b);
        image_release(&ordered);
    }
    image_release(&in);
    image_release(&shuffled);
}

/* Presets lie within their ranges, names are distinct: what a user interface relies on. */
/* Pixels alone come out as in their picture, unless the operator needs the picture; and only those that
 * are said to need a measurement change with it. */
static void test_pixels_without_their_picture(void **state)
{
    enum { W = 37, H = 21 };
    size_t count;
    const struct tonemap_operator *const *ops = tonemap_operators(&count);
    struct image in = grey_image(W, H, 0), brighter = grey_image(W, H, 0);

    (void)state;
    for (size_t i = 0; i < (size_t)W * H * 3; i++) {
        in.pixels[i] = (float)(i % 5 == 0 ? 0.0 : 0.003 * (double)(i % 97) * (double)(i % 89));
        brighter.pixels[i] = in.pixels[i] * 7;
    }
    memcpy(brighter.pixels, in.pixels, sizeof(float) * W * 3);
    in.pixels[8] = FLT_MAX; /* nor does what overflowed hurt */
    for (size_t o = 0; o < count * 2; o++) {
        struct tonemap_settings s = settings_of(ops[o / 2]->name), stand_in;
        struct tonemap_context context;
        struct tonemap_state measured, other;
        struct tonemap_pixels *pixels, *others;
        struct image shown;
        float codes[W * 3], changed[W * 3];

        s.exposure_ev = 0.5;
        s.white_kelvin = 5000;
        s.metering = o % 2 ? TONEMAP_METERING_KEY : TONEMAP_METERING_OFF;
        context = context_of(&s);
        tonemap_stand_in(&stand_in, &s);
        assert_true(tonemap_reach(&stand_in) != TONEMAP_REACH_PICTURE);
        assert_true(stand_in.exposure_ev == 0.5 && stand_in.white_kelvin == 5000);
        if (tonemap_reach(&s) == TONEMAP_REACH_PICTURE) {
            struct error err = {0};
            assert_string_equal(stand_in.op->name, "reinhard02");
            assert_int_equal(tonemap_pixels_new(&pixels, &s, NULL, &context, &err), STATUS_ERR_INPUT);
            context = (struct tonemap_context){0};
        } else {
            assert_ptr_equal(stand_in.op, s.op);
        }
        s = stand_in;
        assert_int_equal(tonemap_measure(&measured, &in, &s, &context, NULL), STATUS_OK);
        assert_int_equal(tonemap_measure(&other, &brighter, &s, &context, NULL), STATUS_OK);
        assert_int_equal(tonemap_pixels_new(&pixels, &s, &measured, &context, NULL), STATUS_OK);
        assert_int_equal(tonemap_pixels_new(&others, &s, &other, &context, NULL), STATUS_OK);
        shown = apply_in(&in, &s, &context);
        for (uint32_t y = 0; y < H; y++) {
            tonemap_pixels_codes(pixels, in.pixels + y * W * 3, W, codes);
            for (int i = 0; i < W * 3; i++)
                assert_true(codes[i] == shown.pixels[y * W * 3 + (uint32_t)i] * 255.0f);
        }
        tonemap_pixels_codes(pixels, brighter.pixels + W * 3, W, codes);
        tonemap_pixels_codes(others, brighter.pixels + W * 3, W, changed);
        assert_int_equal(memcmp(codes, changed, sizeof codes) != 0, tonemap_reach(&s) == TONEMAP_REACH_STATE);
        image_release(&shown);
        tonemap_pixels_free(pixels);
        tonemap_pixels_free(others);
    }
    image_release(&in);
    image_release(&brighter);
}

/* A black frame and one of the largest float: measured, and shown without a NaN. */
static void test_pixels_of_extreme_pictures(void **state)
{
    static const float values[] = {0, FLT_MAX, INFINITY};
    size_t count;
    const struct tonemap_operator *const *ops = tonemap_operators(&count);

    (void)state;
    for (size_t o = 0; o < count * 3; o++) {
        struct tonemap_settings s = settings_of(ops[o / 3]->name);
        struct image in = grey_image(3, 2, values[o % 3]);
        struct tonemap_context context;
        struct tonemap_state measured;
        struct tonemap_pixels *pixels;
        float codes[9], rgb[9] = {0, 0, 0, 1, 2, 3, FLT_MAX, 0, 1};

        s.metering = TONEMAP_METERING_PERCENTILE;
        tonemap_stand_in(&s, &s);
        context = context_of(&s);
        assert_int_equal(tonemap_measure(&measured, &in, &s, &context, NULL), STATUS_OK);
        assert_int_equal(tonemap_pixels_new(&pixels, &s, &measured, &context, NULL), STATUS_OK);
        tonemap_pixels_codes(pixels, rgb, 3, codes);
        for (int i = 0; i < 9; i++)
            assert_true(codes[i] >= 0 && codes[i] <= 255);
        tonemap_pixels_free(pixels);
        image_release(&in);
    }
}

static void test_registry(void **state)
{
    size_t count;
    const struct tonemap_operator *const *all = tonemap_operators(&count);

    (void)state;
    assert_true(count >= 3);
    for (size_t i = 0; i < count; i++) {
        assert_ptr_equal(tonemap_find(all[i]->name), all[i]);
        assert_true(all[i]->parameter_count <= TONEMAP_PARAMETERS_MAX);
        assert_true(all[i]->state_count <= TONEMAP_STATE_MAX);
        assert_true((all[i]->state_count > 0) == (all[i]->measure != NULL));
        assert_true((all[i]->file_load != NULL) == (all[i]->file_free != NULL));
        assert_true((all[i]->file_load != NULL) == (all[i]->file_help != NULL));
        assert_true(all[i]->file_load || !all[i]->file_required);
        assert_true(strlen(all[i]->summary) > 10 && strlen(all[i]->source) > 10);
        for (size_t k = 0; k < all[i]->parameter_count; k++) {
            const struct tonemap_parameter *p = &all[i]->parameters[k];
            assert_true(p->preset >= p->min && p->preset <= p->max);
            assert_true(strlen(p->help) > 4);
            assert_true(p->kind == TONEMAP_NUMBER || p->preset == floor(p->preset));
            assert_true((p->kind == TONEMAP_CHOICE) == (p->choices != NULL));
            if (p->kind == TONEMAP_CHOICE) {
                size_t words = 0;
                while (p->choices[words])
                    words++;
                assert_true(p->min == 0.0 && p->max == (double)(words - 1));
            }
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
        cmocka_unit_test(test_statistics_of_all_lines),
        cmocka_unit_test(test_noise_does_not_meter),
        cmocka_unit_test(test_samples_do_not_meter),
        cmocka_unit_test(test_log_mean),
        cmocka_unit_test(test_log_mean_beside_the_sun),
        cmocka_unit_test(test_log_mean_does_not_flicker),
        cmocka_unit_test(test_tiles_that_lie_apart),
        cmocka_unit_test(test_exposure_brightens),
        cmocka_unit_test(test_monotone),
        cmocka_unit_test(test_hard_inputs),
        cmocka_unit_test(test_hard_shapes),
        cmocka_unit_test(test_firefly),
        cmocka_unit_test(test_settings_errors),
        cmocka_unit_test(test_settings_by_text),
        cmocka_unit_test(test_validation),
        cmocka_unit_test(test_metering_key),
        cmocka_unit_test(test_percentile_is_exact),
        cmocka_unit_test(test_metering_after_balance),
        cmocka_unit_test(test_normalize),
        cmocka_unit_test(test_white_balance),
        cmocka_unit_test(test_white_balance_of_daylight_is_none),
        cmocka_unit_test(test_state_mean),
        cmocka_unit_test(test_averaging_calms_a_sequence),
        cmocka_unit_test(test_states_and_threads),
        cmocka_unit_test(test_tiles_do_not_show),
        cmocka_unit_test(test_pixels_without_their_picture),
        cmocka_unit_test(test_pixels_of_extreme_pictures),
        cmocka_unit_test(test_registry),
    };
    return cmocka_run_group_tests_name("tonemap", tests, NULL, NULL);
}
