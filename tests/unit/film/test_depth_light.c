/* The light that --max-depth takes: what sums say, and how a film adds them. Pictures:
 * statistics/test_depth_light.c. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "common/film/depth_light.h"
#include "common/scene/settings.h"
#include "tests/support/film_data.h"

/* `samples` samples whose throughput at depth d is decay(d), and which find `found` of light for each unit that
 * ends. */
static struct depth_light sums(double (*decay)(double), double found, double samples, uint32_t max_depth)
{
    const double quarter = decay(max_depth / 4), half = decay(max_depth / 2), ended = decay(max_depth);

    return (struct depth_light){{[DEPTH_SEEN] = samples * found * (1 - ended), [DEPTH_QUARTER] = samples * quarter,
                                 [DEPTH_HALF] = samples * half, [DEPTH_ENDED] = samples * ended,
                                 [DEPTH_GATHERED] = samples * found * (half - ended)}};
}

static double geometric(double depth) { return pow(0.8, depth); }

static double power(double depth) { return depth > 1 ? 1 / sqrt(depth) : 1; }

static double endless(double depth)
{
    (void)depth;
    return 1;
}

static void assert_near(double value, double expected, double within)
{
    if (!(fabs(value - expected) <= within))
        fail_msg("%g instead of %g +- %g", value, expected, within);
}

static void what_ends_is_extrapolated(void **state)
{
    static const uint32_t depths[] = {4, 8, 13, 16, 64};

    (void)state;
    for (size_t i = 0; i < sizeof depths / sizeof *depths; i++) {
        const uint32_t n = depths[i];
        struct depth_light light = sums(geometric, 3, 1e9, n);
        struct depth_report report = depth_light_report(&light, 1000000000, n);
        assert_near(report.share, geometric(n), 1e-6);
        if (report.share <= DEPTH_SHARE_TOLD) {
            assert_int_equal(report.deeper, 0);
        } else {
            assert_true(report.deeper % n == 0 && report.deeper > n);
            assert_near(report.deeper_share, geometric(report.deeper), 1e-6);
            assert_true(report.deeper_share <= DEPTH_SHARE_ENOUGH);
            assert_true(report.deeper == 2 * n || geometric(report.deeper / 2.0) > DEPTH_SHARE_ENOUGH);
        }
        light = sums(power, 0.5, 1e9, n);
        report = depth_light_report(&light, 1000000000, n);
        assert_near(report.share, power(n), 1e-6);
        assert_true(report.deeper >= 8 * n && report.deeper_share < report.share);
    }
}

static void ends_of_the_range(void **state)
{
    struct depth_light light = sums(endless, 1, 1000, 12), nothing = {{0}};
    struct depth_report report;

    (void)state;
    light.sum[DEPTH_SEEN] = 13000; /* of a mirror box */
    light.sum[DEPTH_GATHERED] = 6000;
    report = depth_light_report(&light, 1000, 12);
    assert_true(report.share > 0.99 && report.deeper == SETTINGS_DEPTH_MAX && report.deeper_share > 0.9);
    report = depth_light_report(&light, 1000, SETTINGS_DEPTH_MAX);
    assert_true(report.deeper == 0);
    report = depth_light_report(&light, 1000, 0); /* emission only */
    assert_true(report.share > 0.5 && report.deeper > 0);
    report = depth_light_report(&nothing, 1000, 12);
    assert_true(report.share == 0 && report.deeper == 0);
    report = depth_light_report(&nothing, 0, 0);
    assert_true(report.share == 0 && report.deeper == 0);
    nothing.sum[DEPTH_QUARTER] = nothing.sum[DEPTH_HALF] = 500;
    nothing.sum[DEPTH_ENDED] = 1; /* a dark room without a lamp */
    report = depth_light_report(&nothing, 1000, 12);
    assert_true(report.share < 1e-4);
    nothing.sum[DEPTH_ENDED] = 500; /* half of the picture is behind something */
    report = depth_light_report(&nothing, 1000, 12);
    assert_near(report.share, 0.5, 1e-6);
}

static void no_sum_gives_what_is_no_share(void **state)
{
    static const double values[] = {0, 1e-300, 1e-9, 1, 1e9, 1e300};
    enum { VALUES = sizeof values / sizeof *values };
    static const uint32_t depths[] = {0, 1, 2, 3, 12, SETTINGS_DEPTH_MAX};
    struct depth_light light;

    (void)state;
    for (int at = 0; at < VALUES * VALUES * VALUES * VALUES * VALUES; at++) {
        int left = at;
        for (int i = 0; i < DEPTH_SUMS; i++, left /= VALUES)
            light.sum[i] = values[left % VALUES];
        for (size_t d = 0; d < sizeof depths / sizeof *depths; d++) {
            struct depth_report r = depth_light_report(&light, 1 + (uint64_t)at % 7, depths[d]);
            assert_true(r.share >= 0 && r.share <= 1 && r.deeper_share >= 0 && r.deeper_share <= r.share);
            assert_true(r.deeper == 0 || (r.deeper > depths[d] && r.deeper <= SETTINGS_DEPTH_MAX));
        }
    }
}

static void which_sums_are_valid(void **state)
{
    static const double bad[] = {-1e-30, -1, NAN, INFINITY};
    struct depth_light light = {{1, 2, 3, 4, 5}};

    (void)state;
    assert_true(depth_light_is_valid(&light) && depth_light_is_known(&light));
    for (int i = 0; i < DEPTH_SUMS; i++)
        for (size_t k = 0; k < sizeof bad / sizeof *bad; k++) {
            struct depth_light other = light;
            other.sum[i] = bad[k];
            assert_false(depth_light_is_valid(&other));
        }
    memset(&light, 0, sizeof light);
    assert_true(depth_light_is_valid(&light) && !depth_light_is_known(&light));
}

static void words(void **state)
{
    static const struct { struct depth_report report; const char *text; } rows[] = {
        {{0.1234, 32, 0.0098}, "light ended by depth: 12 % of the picture (--max-depth 8; 32 would leave 1 %)"},
        {{0.00512, 16, 0.000012}, "light ended by depth: 0.51 % of the picture (--max-depth 8; 16 would leave 0.001 %)"},
        {{0.996, 1024, 0.5304}, "light ended by depth: 100 % of the picture (--max-depth 8; 1024 would leave 53 %)"},
        {{0.0949, 16, 0}, "light ended by depth: 9.5 % of the picture (--max-depth 8; 16 would leave 0 %)"},
        {{0.3, 0, 0}, "light ended by depth: 30 % of the picture (--max-depth 8)"},
    };
    char out[DEPTH_TEXT_SIZE];

    (void)state;
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++)
        assert_string_equal(depth_report_text(out, &rows[i].report, 8), rows[i].text);
}

/* ---- films --------------------------------------------------------------------------------------- */

enum { WIDTH = 37, HEIGHT = 19, SPP = 20 };

static void merge_all(struct film *film, uint64_t order)
{
    uint32_t tiles = film_tile_count(film), passes = film_pass_count(film, 0), all = tiles * passes * GROUPS;

    for (uint32_t i = 0; i < all; i++) {
        uint32_t unit = (uint32_t)((i * (2 * order + 1) + order) % all); /* a permutation if they share no factor */
        uint32_t pass = unit / tiles / GROUPS, group = unit / tiles % GROUPS;
        if (pass < film_pass_count(film, group))
            (void)film_data_merge(film, unit % tiles, group, pass);
    }
}

/* The same sums to the last bit, whatever the order of arrival; summed as they come they would differ. */
static void order_of_arrival(void **state)
{
    static const uint64_t orders[] = {0, 3, 6, 21};
    struct unit_work first, work;
    struct depth_light came[2] = {{{0}}, {{0}}};
    int differ = 0;

    (void)state;
    for (size_t i = 0; i < sizeof orders / sizeof *orders; i++) {
        struct film *film = film_data_new(WIDTH, HEIGHT, SPP, 0);
        merge_all(film, orders[i]);
        assert_true(film_complete(film));
        work = film_work(film);
        first = i ? first : work;
        assert_memory_equal(&work.depth, &first.depth, sizeof work.depth);
        film_free(film);
    }
    for (uint32_t i = 0; i < 12; i++) {
        struct film *film = film_data_new(WIDTH, HEIGHT, SPP, 0);
        float values[TILE_FLOATS_MAX];
        struct unit_result unit = film_data_unit(film, i % 6, 0, i / 6, values);
        depth_light_add(&came[0], &unit.work.depth);
        unit = film_data_unit(film, (11 - i) % 6, 0, (11 - i) / 6, values);
        depth_light_add(&came[1], &unit.work.depth);
        film_free(film);
    }
    for (int i = 0; i < DEPTH_SUMS; i++)
        differ += came[0].sum[i] != came[1].sum[i];
    assert_true(differ > 0);
}

/* A tile with more samples than the others counts no more than they: the share is of the picture. */
static void pixels_count_alike(void **state)
{
    struct film *film = film_data_new(2 * TILE_SIZE, TILE_SIZE, 64, 0);
    const double bright = 3, dark = 1; /* of the tiles' samples */
    double expected;
    struct unit_work work;

    (void)state;
    for (uint32_t tile = 0; tile < 2; tile++)
        for (uint32_t g = 0; g < GROUPS; g++)
            for (uint32_t pass = 0; pass < (tile ? film_pass_count(film, g) : 1); pass++) {
                float values[TILE_FLOATS_MAX];
                struct unit_result unit = film_data_unit(film, tile, g, pass, values);
                enum film_merge_result merged;
                for (int i = 0; i < DEPTH_SUMS; i++)
                    unit.work.depth.sum[i] = (double)unit.work.samples * (tile ? dark : bright);
                assert_int_equal(film_merge(film, &unit, 1, &merged, NULL), STATUS_OK);
            }
    assert_int_equal(film_tile_samples(film, 0), 4);
    assert_int_equal(film_tile_samples(film, 1), 64);
    work = film_work(film);
    expected = (double)work.samples * (bright + dark) / 2;
    for (int i = 0; i < DEPTH_SUMS; i++)
        assert_near(work.depth.sum[i] / expected, 1, 1e-12);
    film_free(film);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_ends_is_extrapolated),
        cmocka_unit_test(ends_of_the_range),
        cmocka_unit_test(no_sum_gives_what_is_no_share),
        cmocka_unit_test(which_sums_are_valid),
        cmocka_unit_test(words),
        cmocka_unit_test(order_of_arrival),
        cmocka_unit_test(pixels_count_alike),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
