/* Do the figures of error say what the pictures' errors are? A small part of `make accuracy`, with seeds that
 * never change: every bound below either holds or not, on every machine. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>

#include "client/options/tonemap_options.h"
#include "common/accuracy/word.h"
#include "tests/support/judge.h"

enum { SIZE = 32, SEEDS = 32, LEVELS = 4, REFERENCE_SPP = 1024 };

struct tally {
    int pictures, warned, covered_rmse, covered_display;
    double display, true_display, rmse, true_rmse;
};

/* The pictures of every seed with calibration_spp(level) samples. */
static struct tally tally_level(const struct calibration *c, uint32_t level)
{
    struct tally t = {0};
    struct tonemap_settings look;

    assert_int_equal(tonemap_settings_init(&look, TONEMAP_DEFAULT, NULL), STATUS_OK);
    for (uint32_t seed = 0; seed < c->seeds; seed++) {
        struct judgement j;
        judge(&j, c, seed, level, &look);
        t.pictures++;
        t.warned += !j.figures.reliable || !accuracy_rmse_is_reliable(&j.figures);
        t.covered_rmse += j.figures.rmse_lo <= j.true_rmse && j.true_rmse <= j.figures.rmse_hi;
        t.covered_display += j.figures.display_lo <= j.true_display && j.true_display <= j.figures.display_hi;
        t.display += j.figures.display_error;
        t.true_display += j.true_display;
        t.rmse += j.figures.rmse_percent;
        t.true_rmse += j.true_rmse;
    }
    return t;
}

static void render(struct calibration *c, const char *scene)
{
    static const struct calibration_size size = {SIZE, SIZE, SEEDS, 1, LEVELS, 1, REFERENCE_SPP};

    calibration_render(c, scene, NULL, &size);
    calibration_describe(c, scene, NULL);
}

static void assert_ratio(const char *what, double printed, double truth)
{
    if (!(printed / truth > 0.85 && printed / truth < 1.15))
        fail_msg("%s: printed / true is %.3f", what, printed / truth);
}

/* 128 pictures a scene: of intervals that hold in 95 % at least 113 do but in one of 1,000 cases. The RMSE of a
 * small Cornell box differs from picture to picture by a third: sixteen seeds were too few for a mean within 15 %. */
static void check_reliable(const char *scene, uint32_t first_level)
{
    struct calibration c;
    int covered[2] = {0, 0}, pictures = 0, warned = 0;

    render(&c, scene);
    for (uint32_t level = 0; level < LEVELS; level++) {
        struct tally t = tally_level(&c, level);
        covered[0] += t.covered_rmse;
        pictures += t.pictures;
        if (level < first_level)
            continue;
        assert_ratio("RMSE", t.rmse, t.true_rmse);
        assert_ratio("display error", t.display, t.true_display);
        covered[1] += t.covered_display;
        warned += t.warned;
    }
    calibration_release(&c);
    if (covered[0] < pictures - 15)
        fail_msg("%d of %d intervals of the RMSE hold", covered[0], pictures);
    if (covered[1] < (int)(LEVELS - first_level) * SEEDS - 15)
        fail_msg("%d intervals of the display error hold", covered[1]);
    if (warned > pictures / 5)
        fail_msg("%d of %d pictures were warned of", warned, pictures);
}

static void test_soft_sky(void **state)
{
    (void)state;
    check_reliable("tests/accuracy/scenes/soft-sky.pbrt", 0);
}

static void test_cornell(void **state)
{
    (void)state;
    check_reliable("scenes/cornell/cornell-area.gltf", 0);
}

/* The caustic of a small lamp is met by no sample of most pictures: all carry the warning, and without it they
 * would be wrong. */
static void test_small_caustic(void **state)
{
    struct calibration c;
    struct tally t;

    (void)state;
    render(&c, "tests/accuracy/scenes/small-caustic.pbrt");
    for (uint32_t level = 0; level < 3; level++) {
        t = tally_level(&c, level);
        assert_int_equal(t.warned, t.pictures);
    }
    t = tally_level(&c, 0);
    assert_true(t.rmse < 0.67 * t.true_rmse);
    assert_true(t.display > 0.8 * t.true_display); /* its exposure is not that of the few pixels that are lit */
    calibration_release(&c);
}

/* The display error of the first passes, where few samples find light: at most `most` times too large. */
static void check_first_passes(const char *scene, double most)
{
    struct calibration c;

    render(&c, scene);
    for (uint32_t level = 0; level < 2; level++) {
        struct tally t = tally_level(&c, level);
        assert_ratio("display error", fmin(t.display, t.display / most * 1.15), t.true_display);
        assert_ratio("RMSE", t.rmse, t.true_rmse);
    }
    calibration_release(&c);
}

/* Glass that most samples leave dark: by the groups alone, the display error is half of the truth. */
static void test_sparse_glass(void **state)
{
    (void)state;
    check_first_passes("scenes/features/nested.gltf", 1.15);
}

/* Lamps of which a sample meets one, on surfaces that all are lit: here grain is content, too, and must not raise it. Pictures
 * as small as these are wrong by 1.16; by 1.2 where it does, and those of 64x64 pixels by 1.09. */
static void test_many_lamps(void **state)
{
    (void)state;
    check_first_passes("scenes/features/many-lights.gltf", 1.18);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_soft_sky),
        cmocka_unit_test(test_cornell),
        cmocka_unit_test(test_small_caustic),
        cmocka_unit_test(test_sparse_glass),
        cmocka_unit_test(test_many_lamps),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
