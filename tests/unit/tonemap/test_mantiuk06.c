/* Contrast processing in the gradient domain: the solver, the transducer by its effects, and
 * inputs that break naive ones. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <float.h>
#include <math.h>
#include <string.h>

#include "common/tonemap/gradient_field.h"
#include "common/tonemap/tonemap.h"
#include "tests/support/tonemap_pictures.h"

/* ---- the solver ----------------------------------------------------------------------------- */

/* Wants the differences there are, with weights that vary. */
static void map_same(const void *user, struct gradient_run *run)
{
    (void)user;
    for (size_t i = 0; i < run->count; i++) {
        run->weight_x[i] = 1.0f / (0.05f + fabsf(run->x[i]));
        run->weight_y[i] = 1.0f / (0.05f + fabsf(run->y[i]));
    }
}

static void map_half(const void *user, struct gradient_run *run)
{
    map_same(user, run);
    for (size_t i = 0; i < run->count; i++) {
        run->x[i] *= 0.5f;
        run->y[i] *= 0.5f;
    }
}

static void test_plane(float *plane, uint32_t width, uint32_t height)
{
    uint32_t random = 7;

    for (uint32_t i = 0; i < width * height; i++) {
        random = random * 1664525u + 1013904223u;
        plane[i] = (float)(random >> 8) / (1 << 24) + 3.0f * (float)(i % width) / (float)width +
                   (i / width > height / 2 ? 2.0f : 0.0f);
    }
}

/* The pyramid ends before a side is below 3 pixels; of strips it goes on. */
static void test_levels(void **state)
{
    static const uint32_t sizes[][5] = { /* width, height, levels, the last one's width, height */
        {1, 1, 1, 1, 1},   {2, 2, 1, 2, 2},      {5, 7, 1, 5, 7},     {6, 5, 1, 6, 5},
        {6, 6, 2, 3, 3},   {25, 19, 3, 6, 4},    {192, 108, 6, 6, 3}, {95, 2, 1, 95, 2},
        {96, 2, 2, 48, 1}, {1, 1000, 5, 1, 62},
    };

    (void)state;
    for (size_t k = 0; k < sizeof sizes / sizeof *sizes; k++) {
        struct gradient_field field;
        const struct gradient_level *last;
        struct error err = {0};

        assert_int_equal(gradient_field_init(&field, sizes[k][0], sizes[k][1], 1, &err), STATUS_OK);
        assert_int_equal(field.level_count, sizes[k][2]);
        last = &field.levels[field.level_count - 1];
        assert_int_equal(last->width, sizes[k][3]);
        assert_int_equal(last->height, sizes[k][4]);
        gradient_field_release(&field);
    }
}

/* From a start that has nothing to do with it, the differences of a plane give the plane back, up
 * to a constant. Odd, thin and tiny sizes too. */
static void test_solver_gives_back(void **state)
{
    static const uint32_t sizes[][2] = {{64, 64}, {61, 47}, {1, 300}, {301, 1}, {2, 99}, {2, 2},
                                        {3, 1}, {7, 3}, {600, 33}};
    static float plane[64 * 1024], x[64 * 1024];

    (void)state;
    for (size_t k = 0; k < sizeof sizes / sizeof *sizes; k++) {
        uint32_t width = sizes[k][0], height = sizes[k][1], count = width * height;
        struct gradient_field field;
        struct error err = {0};
        double shift = 0.0;
        int steps;

        test_plane(plane, width, height);
        for (uint32_t i = 0; i < count; i++)
            x[i] = (float)(i * 7 % 5);
        assert_int_equal(gradient_field_init(&field, width, height, 2, &err), STATUS_OK);
        gradient_field_want(&field, plane, map_same, NULL);
        steps = gradient_field_solve(&field, x, 1e-6, 500);
        assert_true(steps > 0 && steps < 200);
        for (uint32_t i = 0; i < count; i++)
            shift += ((double)x[i] - (double)plane[i]) / count;
        for (uint32_t i = 0; i < count; i++)
            assert_true(fabs((double)x[i] - (double)plane[i] - shift) < 1e-4);
        gradient_field_release(&field);
    }
}

/* Where the start is a multiple of the answer no step is needed. */
static void test_solver_fits_start(void **state)
{
    static float plane[40 * 30], x[40 * 30];
    struct gradient_field field;
    struct error err = {0};

    (void)state;
    test_plane(plane, 40, 30);
    memcpy(x, plane, sizeof x);
    assert_int_equal(gradient_field_init(&field, 40, 30, 1, &err), STATUS_OK);
    gradient_field_want(&field, plane, map_half, NULL);
    assert_int_equal(gradient_field_solve(&field, x, 1e-4, 500), 0);
    for (size_t i = 0; i < 40 * 30; i++)
        assert_true(fabsf(x[i] - 0.5f * plane[i]) < 1e-5f);
    gradient_field_release(&field);
}

static int solver_steps(uint32_t side)
{
    static float plane[256 * 256], x[256 * 256];
    struct gradient_field field;
    struct error err = {0};
    int steps;

    test_plane(plane, side, side);
    memset(x, 0, sizeof x);
    assert_int_equal(gradient_field_init(&field, side, side, 2, &err), STATUS_OK);
    gradient_field_want(&field, plane, map_same, NULL);
    steps = gradient_field_solve(&field, x, 1e-3, 500);
    gradient_field_release(&field);
    return steps;
}

/* The pyramid makes the steps needed independent of the size: cost is linear in pixels. */
static void test_solver_steps(void **state)
{
    (void)state;
    assert_true(solver_steps(256) <= solver_steps(32) + 10);
}

/* ---- the operator --------------------------------------------------------------------------- */

static double luminance_at(const struct image *image, size_t i)
{
    const float *p = image->pixels + 3 * i;

    return 0.212656 * (double)p[0] + 0.715158 * (double)p[1] + 0.072186 * (double)p[2];
}

/* At contrast 1 nothing is done to the differences: the display's log luminance is the picture's,
 * stretched so that the percentiles are 2.3 decades apart. */
static void test_round_trip(void **state)
{
    struct tonemap_settings s = tonemap_preset("mantiuk06");
    struct image in = picture_hard(61, 47), out;
    double low = 0.0, high = 0.0, slope = 0.0;
    size_t first = 0, last = 0, checked = 0;

    (void)state;
    picture_put(&in, 30, 15, 1.0f);
    tonemap_preset_set(&s, "contrast", 1.0);
    tonemap_preset_set(&s, "saturation", 1.0);
    s.exposure_ev = -2.0; /* below the display's white all over */
    out = picture_light(&in, &s);
    for (size_t i = 0; i < 61 * 47; i++) {
        double l = log10(luminance_at(&in, i));

        if (i == 0 || l < low) {
            low = l;
            first = i;
        }
        if (i == 0 || l > high) {
            high = l;
            last = i;
        }
    }
    slope = (log10(luminance_at(&out, last)) - log10(luminance_at(&out, first))) / (high - low);
    assert_true(slope * (high - low) > 2.3 && slope * (high - low) < 2.7);
    for (size_t i = 0; i < 61 * 47; i++) {
        double wanted = log10(luminance_at(&out, first)) + slope * (log10(luminance_at(&in, i)) - low);

        assert_true(fabs(log10(luminance_at(&out, i)) - wanted) < 2e-3);
        checked++;
    }
    assert_true(checked == 61 * 47);
    image_release(&in);
    image_release(&out);
}

/* W where the response is 0, 1, 2 ...: R counts thresholds, as in the paper; linear between. */
static void response_nodes(double nodes[200])
{
    nodes[0] = 0.0;
    nodes[1] = 0.01;
    for (int i = 2; i < 200; i++)
        nodes[i] = nodes[i - 1] + 0.0928 * pow(nodes[i - 1], 1.08) + 0.0046 * pow(nodes[i - 1], -0.18);
    assert_true(fabs(nodes[106] - 10510.0806) < 1e-3); /* the end of the published table */
}

/* What a difference g becomes, straight from the definition. */
static double mapped(double g, double contrast)
{
    double nodes[200], w = pow(10.0, g) - 1.0, r;
    int k = 0;

    response_nodes(nodes);
    while (nodes[k + 1] < w)
        k++;
    r = contrast * (k + (w - nodes[k]) / (nodes[k + 1] - nodes[k]));
    k = (int)floor(r);
    return log10(1.0 + nodes[k] + (r - k) * (nodes[k + 1] - nodes[k]));
}

/* Three pixels have two differences, and there is no other level: the answer has exactly the
 * wanted differences, times what fills the display's range. */
static void test_transducer(void **state)
{
    static const double contrasts[] = {0.05, 0.1, 0.3, 0.7, 2.0};

    (void)state;
    for (size_t i = 0; i < sizeof contrasts / sizeof *contrasts; i++) {
        struct tonemap_settings s = tonemap_preset("mantiuk06");
        struct image in = picture_grey(3, 1, 1.0f), out;
        double a, b, ratio = mapped(1.7, contrasts[i]) / mapped(0.2, contrasts[i]);

        picture_put(&in, 1, 0, (float)pow(10.0, 0.2));
        picture_put(&in, 2, 0, (float)pow(10.0, 1.9));
        tonemap_preset_set(&s, "contrast", contrasts[i]);
        tonemap_preset_set(&s, "detail", 1.0);
        out = picture_light(&in, &s);
        a = log10((double)picture_at(&out, 1, 0) / (double)picture_at(&out, 0, 0));
        b = log10((double)picture_at(&out, 2, 0) / (double)picture_at(&out, 1, 0));
        assert_true(fabs(a + b - 2.3) < 1e-4);
        assert_true(fabs(b / a / ratio - 1.0) < 2e-3);
        image_release(&in);
        image_release(&out);
    }
}

/* ---- the whole of it, straight from the definitions ------------------------------------------ */

/* A picture's grey, its pyramid as dense matrices, and the system of equations. */
enum { ORACLE_WIDTH = 25, ORACLE_HEIGHT = 19, ORACLE_PIXELS = ORACLE_WIDTH * ORACLE_HEIGHT,
       ORACLE_LEVELS = 3 };

struct oracle {
    double plane[ORACLE_PIXELS]; /* log10 luminance */
    size_t width[ORACLE_LEVELS], height[ORACLE_LEVELS];
    double mean[ORACLE_LEVELS][ORACLE_PIXELS][ORACLE_PIXELS]; /* a level's pixel of level 0's */
    double a[ORACLE_PIXELS][ORACLE_PIXELS], b[ORACLE_PIXELS]; /* a x = b */
    double lengths[2 * ORACLE_PIXELS];                        /* of all pixels' responses */
    size_t length_count;
};

/* How much of the pixel `fine` the pixel `coarse` of a side half as long covers. */
static double covered(size_t fine, size_t coarse, size_t fine_side, size_t coarse_side)
{
    double ratio = (double)fine_side / (double)coarse_side;
    double begin = fmax((double)fine, (double)coarse * ratio);
    double end = fmin((double)fine + 1.0, ((double)coarse + 1.0) * ratio);

    return fmax(end - begin, 0.0);
}

static void oracle_pyramid(struct oracle *o)
{
    static const size_t widths[] = {25, 12, 6}, heights[] = {19, 9, 4}; /* no side below 3 */

    for (size_t i = 0; i < ORACLE_PIXELS; i++)
        o->mean[0][i][i] = 1.0;
    for (int l = 0; l < ORACLE_LEVELS; l++) {
        o->width[l] = widths[l];
        o->height[l] = heights[l];
        for (size_t i = 0; l > 0 && i < widths[l] * heights[l]; i++)
            for (size_t k = 0; k < widths[l - 1] * heights[l - 1]; k++) {
                double part = covered(k % widths[l - 1], i % widths[l], widths[l - 1], widths[l]) *
                              covered(k / widths[l - 1], i / widths[l], heights[l - 1], heights[l]) *
                              (double)(widths[l] * heights[l]) / (double)(widths[l - 1] * heights[l - 1]);

                for (size_t p = 0; part > 0.0 && p < ORACLE_PIXELS; p++)
                    o->mean[l][i][p] += part * o->mean[l - 1][k][p];
            }
    }
}

/* The neighbour of a level's pixel to its right or below it; the pixel itself if there is none. */
static size_t neighbour(const struct oracle *o, int level, size_t i, int below)
{
    size_t width = o->width[level];

    if (below)
        return i / width + 1 < o->height[level] ? i + width : i;
    return i % width + 1 < width ? i + 1 : i;
}

static double difference(const struct oracle *o, int level, size_t i, int below)
{
    size_t other = neighbour(o, level, i, below);
    double sum = 0.0;

    for (size_t p = 0; p < ORACLE_PIXELS; p++)
        sum += (o->mean[level][other][p] - o->mean[level][i][p]) * o->plane[p];
    return fabs(sum) < 1e-12 ? 0.0 : sum;
}

/* R(W) and back, with the sign of its argument: thresholds counted from 0. */
static double response_to(double g)
{
    double nodes[200], w = pow(10.0, fabs(g)) - 1.0;
    int k = 0;

    response_nodes(nodes);
    while (nodes[k + 1] < w)
        k++;
    return copysign(k + (w - nodes[k]) / (nodes[k + 1] - nodes[k]), g);
}

static double difference_for(double r)
{
    double nodes[200], size = fabs(r);
    int k = (int)floor(size);

    response_nodes(nodes);
    return copysign(log10(1.0 + nodes[k] + (size - k) * (nodes[k + 1] - nodes[k])), r);
}

static double response_size(const struct oracle *o, int level, size_t i)
{
    return hypot(response_to(difference(o, level, i, 0)), response_to(difference(o, level, i, 1)));
}

/* The cumulative histogram of the sizes of all responses of all levels: the share that is smaller. */
static double rank_of(const struct oracle *o, double size)
{
    size_t smaller = 0;

    for (size_t i = 0; i < o->length_count; i++)
        smaller += o->lengths[i] < size;
    return (double)smaller / (double)o->length_count;
}

static double wanted_for(const struct oracle *o, int level, size_t i, int below, int equalize, double contrast)
{
    double response = response_to(difference(o, level, i, below)), size;

    if (!equalize)
        return difference_for(contrast * response);
    size = response_size(o, level, i);
    /* The whole response, 106 thresholds, is that to the end of the published table. */
    return size > 0.0 ? difference_for(contrast * 106.0 * rank_of(o, size) * response / size) : 0.0;
}

/* Sum over neighbours at all levels of (pixels of level 0 / pixels) weight (difference - wanted)^2:
 * where its derivative is 0. */
static void oracle_equations(struct oracle *o, int equalize, double contrast)
{
    for (int l = 0; l < ORACLE_LEVELS; l++)
        for (size_t i = 0; i < o->width[l] * o->height[l]; i++)
            o->lengths[o->length_count++] = response_size(o, l, i);
    for (int l = 0; l < ORACLE_LEVELS; l++)
        for (size_t i = 0; i < 2 * o->width[l] * o->height[l]; i++) {
            int below = i % 2;
            size_t other = neighbour(o, l, i / 2, below);
            double wanted = wanted_for(o, l, i / 2, below, equalize, contrast);
            double weight = ORACLE_PIXELS / (double)(o->width[l] * o->height[l]) /
                            (0.038737 * pow(fmax(fabs(wanted), 0.001), 0.537756));
            double row[ORACLE_PIXELS];

            for (size_t p = 0; p < ORACLE_PIXELS; p++)
                row[p] = o->mean[l][other][p] - o->mean[l][i / 2][p];
            for (size_t p = 0; p < ORACLE_PIXELS; p++) {
                o->b[p] += weight * wanted * row[p];
                for (size_t q = 0; row[p] != 0.0 && q < ORACLE_PIXELS; q++)
                    o->a[p][q] += weight * row[p] * row[q];
            }
        }
    o->a[0][0] += 1.0; /* x is known up to a constant */
}

/* Gaussian elimination of a positive definite matrix; the answer is left in b. */
static void oracle_solve(struct oracle *o)
{
    for (size_t k = 0; k < ORACLE_PIXELS; k++)
        for (size_t i = k + 1; i < ORACLE_PIXELS; i++) {
            double factor = o->a[i][k] / o->a[k][k];

            for (size_t q = k; q < ORACLE_PIXELS; q++)
                o->a[i][q] -= factor * o->a[k][q];
            o->b[i] -= factor * o->b[k];
        }
    for (size_t k = ORACLE_PIXELS; k-- > 0;) {
        for (size_t q = k + 1; q < ORACLE_PIXELS; q++)
            o->b[k] -= o->a[k][q] * o->b[q];
        o->b[k] /= o->a[k][k];
    }
}

/* A slope, two steps, noise, and a patch without any contrast. */
static struct image oracle_picture(struct oracle *o)
{
    struct image in = picture_grey(ORACLE_WIDTH, ORACLE_HEIGHT, 1.0f);
    uint32_t random = 3;

    for (size_t i = 0; i < ORACLE_PIXELS; i++) {
        size_t x = i % ORACLE_WIDTH, y = i / ORACLE_WIDTH;
        double l = 0.08 * (double)x + (y > 9 ? 1.2 : 0.0) - (x > 14 && y > 4 ? 0.9 : 0.0);

        random = random * 1664525u + 1013904223u;
        if (x < 18 || y < 12)
            l += 0.3 * (double)(random >> 8) / (1 << 24);
        else
            l = 1.0;
        picture_put(&in, x, y, (float)pow(10.0, l));
        o->plane[i] = log10((double)picture_at(&in, x, y));
    }
    return in;
}

/* Both modes against it. The percentiles of so few pixels are the darkest and the brightest. */
static void test_oracle(void **state)
{
    static const struct {
        int equalize;
        double contrast;
    } cases[] = {{0, 0.1}, {0, 0.4}, {1, 0.1}, {1, 0.5}, {1, 1.0}};

    (void)state;
    for (size_t c = 0; c < sizeof cases / sizeof *cases; c++) {
        struct oracle *o = test_calloc(1, sizeof *o);
        struct image in = oracle_picture(o), out;
        struct tonemap_settings s = tonemap_preset("mantiuk06");
        double low, high, worst = 0.0;

        tonemap_preset_set(&s, "detail", 1.0);
        tonemap_preset_set(&s, "mode", cases[c].equalize);
        tonemap_preset_set(&s, "contrast", cases[c].contrast);
        out = picture_light(&in, &s);
        oracle_pyramid(o);
        oracle_equations(o, cases[c].equalize, cases[c].contrast);
        oracle_solve(o);
        low = high = o->b[0];
        for (size_t i = 1; i < ORACLE_PIXELS; i++) {
            low = fmin(low, o->b[i]);
            high = fmax(high, o->b[i]);
        }
        for (size_t i = 0; i < ORACLE_PIXELS; i++) {
            double wanted = 2.3 * (o->b[i] - high) / (high - low);

            worst = fmax(worst, fabs(log10((double)out.pixels[3 * i]) - wanted));
        }
        assert_true(worst < 0.006); /* of the decades; the ranks' steps are 1 / 607 */
        image_release(&in);
        image_release(&out);
        test_free(o);
    }
}

/* Percentiles: 0.1 % of the pixels are cut off at either end, and white is the display's. */
static void test_range(void **state)
{
    struct tonemap_settings s = tonemap_preset("mantiuk06");
    struct image in = picture_hard(200, 100), out;
    size_t white = 0, dark = 0;

    (void)state;
    for (size_t i = 0; i < 200 * 100 * 3; i += 3) /* grey */
        in.pixels[i] = in.pixels[i + 2] = in.pixels[i + 1];
    out = picture_light(&in, &s);
    for (size_t i = 0; i < 200 * 100; i++) {
        double l = luminance_at(&out, i);

        white += l >= 0.9999;
        dark += l <= pow(10.0, -2.3) * 1.0001;
    }
    assert_true(white >= 15 && white <= 25);
    assert_true(dark >= 15 && dark <= 25); /* the black one among them */
    image_release(&in);
    image_release(&out);
}

/* Exposure multiplies the display's light, and does nothing to contrasts, however large. */
static void test_exposure(void **state)
{
    struct image in = picture_hard(40, 30), plain, darker;
    struct tonemap_settings s = tonemap_preset("mantiuk06");

    (void)state;
    for (int ev = -6; ev <= -3; ev++) {
        s.exposure_ev = -2;
        plain = picture_light(&in, &s);
        s.exposure_ev = -2 + ev;
        darker = picture_light(&in, &s);
        for (size_t i = 0; i < 40 * 30 * 3; i++)
            if (plain.pixels[i] < 0.99f)
                assert_true(fabs((double)darker.pixels[i] - ldexp((double)plain.pixels[i], ev)) <=
                            3e-5 * (double)plain.pixels[i]);
        image_release(&plain);
        image_release(&darker);
    }
    image_release(&in);
}

/* Saturation is the power of the ratio of a channel and luminance. */
static void test_saturation(void **state)
{
    struct image in = picture_hard(16, 16), grey, half, full;
    struct tonemap_settings s = tonemap_preset("mantiuk06");

    (void)state;
    in.pixels[0] = 0.0f;
    s.exposure_ev = -4;
    tonemap_preset_set(&s, "saturation", 0.0);
    grey = picture_light(&in, &s);
    tonemap_preset_set(&s, "saturation", 0.5);
    half = picture_light(&in, &s);
    tonemap_preset_set(&s, "saturation", 1.0);
    full = picture_light(&in, &s);
    assert_true(grey.pixels[0] == grey.pixels[1] && half.pixels[0] == 0.0f);
    for (size_t i = 0; i < 16 * 16; i++)
        for (size_t c = 0; c < 3; c++) {
            double ratio = luminance_at(&in, i) > 0.0 ? (double)in.pixels[3 * i + c] / luminance_at(&in, i) : 0.0;
            double level = (double)grey.pixels[3 * i];

            assert_true(fabs((double)full.pixels[3 * i + c] - ratio * level) <= 1e-5 * level);
            assert_true(fabs((double)half.pixels[3 * i + c] - sqrt(ratio) * level) <= 1e-5 * level);
        }
    image_release(&in);
    image_release(&grey);
    image_release(&half);
    image_release(&full);
}

/* Spread of neighbours' log luminance as a share of the whole's: how much is detail. */
static double detail_share(const struct image *image)
{
    double sum = 0.0;
    size_t count = 0;

    for (size_t y = 0; y < image->height; y++)
        for (size_t x = 0; x + 1 < image->width; x++) {
            double a = luminance_at(image, y * image->width + x);
            double b = luminance_at(image, y * image->width + x + 1);

            if (a > 0.0 && b > 0.0 && a < 1.0 && b < 1.0) {
                sum += fabs(log10(a / b));
                count++;
            }
        }
    return sum / (double)count;
}

/* Less contrast is a sharper picture, as the range is always filled, less detail a softer one;
 * equalization is sharper still. */
static void test_parameters_act(void **state)
{
    struct image in = picture_hard(96, 80), out;
    struct tonemap_settings s = tonemap_preset("mantiuk06");
    double share[5];
    struct error err = {0};

    (void)state;
    for (size_t i = 0; i < 5; i++) {
        s = tonemap_preset("mantiuk06");
        tonemap_preset_set(&s, "detail", i == 3 ? 0.02 : 1.0);
        tonemap_preset_set(&s, "contrast", i == 0 ? 1.0 : 0.1);
        if (i == 2)
            tonemap_preset_set(&s, "contrast", 0.02);
        if (i == 4)
            assert_int_equal(tonemap_settings_set_text(&s, "mode", "equalize", &err), STATUS_OK);
        out = picture_light(&in, &s);
        share[i] = detail_share(&out);
        image_release(&out);
    }
    assert_true(share[1] > 1.05 * share[0] && share[2] > 1.01 * share[1]);
    assert_true(share[3] < 0.95 * share[1]);
    assert_true(share[4] > 1.05 * share[1]);
    image_release(&in);
}

static void test_threads(void **state)
{
    static const uint32_t sizes[][2] = {{700, 190}, {33, 200}};

    (void)state;
    for (int mode = 0; mode < 2; mode++)
        for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
            struct tonemap_settings s = tonemap_preset("mantiuk06");
            struct image in = picture_hard(sizes[i][0], sizes[i][1]);

            tonemap_preset_set(&s, "mode", mode);
            picture_threads_agree(&in, &s);
        }
}

/* A frame's own state changes nothing; a mean over frames moves the range. */
static void test_state(void **state)
{
    struct tonemap_settings s = tonemap_preset("mantiuk06");
    struct image in = picture_hard(300, 200), plain, own, moved;
    struct tonemap_state measured, other, mean;
    const struct tonemap_state *both[] = {&measured, &other};
    struct tonemap_context context = {.linear = 1};
    double darkest = 1e9, lightest = 0;
    struct error err = {0};
    int compared = 0;

    (void)state;
    plain = picture_light(&in, &s);
    assert_int_equal(tonemap_measure(&measured, &in, &s, &context, &err), STATUS_OK);
    context.state = &measured;
    assert_int_equal(tonemap_apply(&own, &in, &s, &context, &err), STATUS_OK);
    assert_memory_equal(plain.pixels, own.pixels, 300 * 200 * 3 * sizeof(float));
    other = measured;
    other.values[0] += 0.02;
    other.values[1] += 0.02;
    tonemap_state_mean(&mean, both, 2, &s);
    context.state = &mean;
    assert_int_equal(tonemap_apply(&moved, &in, &s, &context, &err), STATUS_OK);
    assert_true(luminance_at(&moved, 20000) < 0.99 * luminance_at(&plain, 20000));
    /* Both ends moved alike: every pixel that is not white is darker by the same factor. */
    for (size_t i = 0; i < 300 * 200; i += 97)
        if (luminance_at(&plain, i) > 1e-3 && luminance_at(&plain, i) < 0.2) {
            double factor = luminance_at(&moved, i) / luminance_at(&plain, i);

            darkest = fmin(darkest, factor);
            lightest = fmax(lightest, factor);
            compared++;
        }
    assert_true(compared > 50 && lightest < darkest * 1.001);
    image_release(&in);
    image_release(&plain);
    image_release(&own);
    image_release(&moved);
}

/* Grey, not white and not noise. */
static void test_constant(void **state)
{
    (void)state;
    for (uint32_t side = 1; side < 100; side += 49) {
        struct tonemap_settings s = tonemap_preset("mantiuk06");
        struct image in = picture_grey(side, side + 1, 0.37f), out = picture_light(&in, &s);

        for (size_t i = 0; i < (size_t)side * (side + 1) * 3; i++)
            assert_true(fabs((double)out.pixels[i] - pow(10.0, -1.15)) < 1e-4);
        image_release(&in);
        image_release(&out);
    }
}

static void test_hard_inputs(void **state)
{
    static const float hard[] = {0.0f, -1.0f, NAN, INFINITY, 1e30f, FLT_MAX, 1e-40f, 1.0f};
    static const uint32_t sizes[][2] = {{1, 1}, {1, 9}, {9, 1}, {5, 3}, {20, 20}};

    (void)state;
    for (int mode = 0; mode < 2; mode++)
        for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++)
            for (size_t a = 0; a < sizeof hard / sizeof *hard; a++)
                for (size_t b = 0; b < sizeof hard / sizeof *hard; b++) {
                    struct tonemap_settings s = tonemap_preset("mantiuk06");
                    struct image in = picture_grey(sizes[i][0], sizes[i][1], hard[a]), out;

                    tonemap_preset_set(&s, "mode", mode);
                    in.pixels[1] = hard[b];       /* pure green */
                    out = picture_light(&in, &s); /* checks the range */
                    if (!(hard[a] > 0.0f) && in.width * in.height > 1)
                        assert_true(out.pixels[5] == 0.0f);
                    image_release(&in);
                    image_release(&out);
                }
}

/* Neither a firefly nor a half that is black takes the display's range. */
static void test_firefly_and_black(void **state)
{
    struct tonemap_settings s = tonemap_preset("mantiuk06");
    struct image in = picture_hard(64, 64), plain, lit;
    double sum_plain = 0.0, sum_lit = 0.0, sum_half = 0.0;

    (void)state;
    plain = picture_light(&in, &s);
    picture_put(&in, 10, 40, 1e30f);
    lit = picture_light(&in, &s);
    for (size_t i = 0; i < 64 * 64; i++) {
        sum_plain += luminance_at(&plain, i);
        sum_lit += luminance_at(&lit, i);
    }
    assert_true(sum_lit > 0.5 * sum_plain && sum_lit < 2.0 * sum_plain);
    image_release(&lit);
    picture_put(&in, 10, 40, 1.0f);
    memset(in.pixels, 0, 64 * 32 * 3 * sizeof(float));
    lit = picture_light(&in, &s);
    for (size_t i = 0; i < 64 * 32; i++) {
        assert_true(luminance_at(&lit, i) == 0.0);
        sum_half += luminance_at(&lit, i + 64 * 32);
    }
    assert_true(sum_half > 0.1 * sum_plain);
    image_release(&in);
    image_release(&plain);
    image_release(&lit);
}

/* Every allocation may fail. */
static void test_no_memory(void **state)
{
    struct tonemap_settings s = tonemap_preset("mantiuk06");
    struct image in = picture_hard(20, 10);

    (void)state;
    tonemap_preset_set(&s, "mode", 1);
    assert_true(picture_out_of_memory(&in, &s) > 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_levels),
        cmocka_unit_test(test_solver_gives_back),
        cmocka_unit_test(test_solver_fits_start),
        cmocka_unit_test(test_solver_steps),
        cmocka_unit_test(test_round_trip),
        cmocka_unit_test(test_transducer),
        cmocka_unit_test(test_oracle),
        cmocka_unit_test(test_range),
        cmocka_unit_test(test_exposure),
        cmocka_unit_test(test_saturation),
        cmocka_unit_test(test_parameters_act),
        cmocka_unit_test(test_threads),
        cmocka_unit_test(test_state),
        cmocka_unit_test(test_constant),
        cmocka_unit_test(test_hard_inputs),
        cmocka_unit_test(test_firefly_and_black),
        cmocka_unit_test(test_no_memory),
    };
    return cmocka_run_group_tests_name("mantiuk06", tests, NULL, NULL);
}
