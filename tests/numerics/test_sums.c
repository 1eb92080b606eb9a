/* Sums and statistics in hard cases: what a film says of samples whose mean is known, and what the
 * figures say of pictures without light, without noise, or too large for float. */
#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "common/accuracy/curve.h"
#include "common/accuracy/figures.h"
#include "common/accuracy/quantile.h"
#include "common/math/vec.h"
#include "tests/support/figure.h"
#include "tests/support/film_data.h"

enum { VALUES = PIXEL_FLOATS }; /* of a film of one pixel */

/* ---- films of one pixel --------------------------------------------------------------------- */

/* The unit's sums, of samples that `sample` gives by their indices in the group. */
static struct unit_result unit_of(const struct film *film, uint32_t group, uint32_t pass,
                                  double (*sample)(uint32_t index), float sums[VALUES])
{
    double exact = 0;
    uint32_t begin, end;

    pass_range(film_spp(film), group, pass, &begin, &end);
    for (uint32_t i = begin; i < end; i++)
        exact += sample(i);
    for (int i = 0; i < VALUES; i++)
        sums[i] = (float)exact;
    return (struct unit_result){
        .group = group, .pass = pass, .sums = sums, .count = VALUES, .work = {.samples = end - begin}};
}

static status merge(struct film *film, const struct unit_result *unit)
{
    enum film_merge_result result;
    struct error err = {0};

    return film_merge(film, unit, 1, &result, &err);
}

static void merge_pass(struct film *film, uint32_t group, uint32_t pass, double (*sample)(uint32_t index))
{
    float sums[VALUES];
    struct unit_result unit = unit_of(film, group, pass, sample, sums);

    assert_int_equal(merge(film, &unit), STATUS_OK);
}

static double mean_of(const struct film *film)
{
    float rgb[3];

    film_develop(film, rgb);
    return (double)rgb[0];
}

/* A float: so are its sums over passes, whose numbers of samples are powers of two, but not those of passes. */
static double odd_number(uint32_t index)
{
    (void)index;
    return (double)0.3f;
}

static double tenth(uint32_t index)
{
    (void)index;
    return 0.1;
}

static double its_index(uint32_t index) { return index; }

static void a_million_samples_keep_their_mean(void **state)
{
    struct film *film = film_data_new(1, 1, 1 << 20, 0);

    (void)state;
    for (uint32_t g = 0; g < GROUPS; g++)
        for (uint32_t p = 0; p < film_pass_count(film, g); p++)
            merge_pass(film, g, p, odd_number);
    assert_true(film_complete(film));
    figure_within("relative error of the mean of 2^20 equal samples", mean_of(film) / odd_number(0) - 1, 0, 0, "exact");
    film_free(film);
}

static void early_results_keep_their_place(void **state)
{
    static const uint32_t order[4] = {2, 3, 0, 1}; /* passes of 2, 2, 4 and 8 samples */
    struct film *film = film_data_new(1, 1, 32, 0);

    (void)state;
    for (uint32_t g = 0; g < GROUPS; g++)
        for (uint32_t i = 0; i < 4; i++)
            merge_pass(film, g, order[i], its_index);
    figure_within("mean of samples 0 to 15 whose second half came first", mean_of(film), 7.5, 7.5, "exact");
    film_free(film);
}

static void a_result_counts_once(void **state)
{
    struct film *film = film_data_new(1, 1, 16, 0);

    (void)state;
    merge_pass(film, 0, 0, its_index);
    merge_pass(film, 0, 0, its_index); /* a worker that had no answer sends again */
    merge_pass(film, 0, 1, its_index);
    figure_within("mean of samples 0 to 3, the first two sent twice", mean_of(film), 1.5, 1.5, "exact");
    film_free(film);
}

static void what_is_not_finite_stays_outside(void **state)
{
    struct film *film = film_data_new(1, 1, 4, 0);
    float sums[VALUES];
    struct unit_result unit = unit_of(film, 0, 0, tenth, sums);

    (void)state;
    sums[0] = INFINITY;
    (void)merge(film, &unit); /* refused; another worker renders the unit */
    merge_pass(film, 0, 0, tenth);
    figure_within("mean of samples of 0.1 after a result of infinity", mean_of(film), 0.1 - 1e-7, 0.1 + 1e-7,
                  "closed form, tolerance 1e-7");
    film_free(film);
}

/* The weights of luminance add up to less than 1: no finite sample makes a tail that is refused. */
static void the_brightest_sample_is_taken(void **state)
{
    struct film *film = film_data_new(1, 1, 4, 0);
    float sums[VALUES];
    struct unit_result unit = unit_of(film, 0, 0, tenth, sums);

    (void)state;
    tail_add(&unit.tail, vec3_luminance(vec3_splat(FLT_MAX)), 0);
    assert_int_equal(merge(film, &unit), STATUS_OK);
    film_free(film);
}

/* ---- figures -------------------------------------------------------------------------------- */

/* Codes are the values: nothing is cut off. */
static status same_codes(void *user, const float *rgb, uint32_t width, uint32_t height, float *codes, struct error *err)
{
    (void)user, (void)err;
    memcpy(codes, rgb, (size_t)width * height * 3 * sizeof *codes);
    return STATUS_OK;
}

static struct accuracy_figures figures_of(const float *a, const float *b, uint32_t side)
{
    struct accuracy_picture picture = {.width = side, .height = side, .groups = {a, b}};
    struct accuracy_transform transform = {.apply = same_codes, .user = NULL};
    struct accuracy_figures out;
    struct error err = {0};

    assert_int_equal(accuracy_figures_of(&out, &picture, &transform, NULL, NULL, &err), STATUS_OK);
    return out;
}

static struct accuracy_figures figures_of_equal(uint32_t side, float value)
{
    size_t count = (size_t)side * side * 3;
    float *picture = malloc(count * sizeof *picture);
    struct accuracy_figures figures;

    assert_non_null(picture);
    for (size_t i = 0; i < count; i++)
        picture[i] = value;
    figures = figures_of(picture, picture, side);
    free(picture);
    return figures;
}

static void black_has_no_relative_error(void **state)
{
    (void)state;
    figure_within("relative error of a black picture", figures_of_equal(32, 0).rmse_percent, 0, 0, "exact");
}

static void equal_pictures_have_no_error(void **state)
{
    struct accuracy_figures f = figures_of_equal(32, 0.5f);

    (void)state;
    assert_true(f.display_error == 0 && isinf(f.psnr_db));
    figure_within("upper end of the PSNR of a picture without noise", f.psnr_hi, INFINITY, INFINITY, "exact");
}

static void equal_pictures_have_no_display_error(void **state)
{
    (void)state;
    figure_within("upper end of the display error of a picture without noise", figures_of_equal(32, 0.5f).display_hi, 0,
                  0, "exact");
}

static void a_large_frame_keeps_its_mean(void **state)
{
    (void)state;
    figure_within("mean of 2^20 pixels of 0.1", figures_of_equal(1024, 0.1f).mean, 0.1 - 1e-7, 0.1 + 1e-7,
                  "closed form, tolerance 1e-7");
}

/* Every 25th pixel was lit, once, and all others never: the error may be understated. */
static void chance_is_seen_beside_black(void **state)
{
    enum { SIDE = 60, COUNT = SIDE * SIDE * 3 };
    static float lit[GROUPS][COUNT];
    struct accuracy_figures f;

    (void)state;
    for (int y = 2; y < SIDE; y += 5)
        for (int x = 2; x < SIDE; x += 5)
            lit[(x + y) % GROUPS][(y * SIDE + x) * 3] = 100;
    f = figures_of(lit[0], lit[1], SIDE);
    figure_within("share of the error that one group alone makes", f.lone, 8.0 / 9 - 1e-6, 8.0 / 9 + 1e-6,
                  "closed form: 3x3 pixels, one lit");
    assert_true(f.reasons & ACCURACY_SPARSE);
    assert_false(f.reliable);
}

/* Half of the pixels have a tenth of the noise of the others: 95 % of all are what 90 % of the noisy are. */
static void quiet_pixels_do_not_count(void **state)
{
    static struct spreads spreads;

    (void)state;
    spreads_add(&spreads, 2, 1000);
    spreads_add(&spreads, 0.45f, 1000);
    figure_within("display error of pixels of noise 2 and of noise 0.45", spreads_quantile(&spreads, 0.05),
                  2 * 1.644854 * 0.988, 2 * 1.644854 * 1.012, "closed form, tolerance of the bins 1.2 %");
}

/* One frame of an animation is black, or its figures are not known. */
static void a_point_without_error_is_left_out(void **state)
{
    struct accuracy_point points[] = {{10, 8, 7, 9}, {20, 0, 0, 0}, {40, 4, 3.5, 4.5}, {80, NAN, NAN, NAN}};
    struct accuracy_curve curve;

    (void)state;
    accuracy_curve_fit(&curve, points, sizeof points / sizeof *points);
    figure_within("cost of half the error of cost 40", accuracy_curve_cost(&curve, 2).value, 160 * 0.999, 160 * 1.001,
                  "closed form, tolerance 1e-3");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_million_samples_keep_their_mean),
        cmocka_unit_test(early_results_keep_their_place),
        cmocka_unit_test(a_result_counts_once),
        cmocka_unit_test(what_is_not_finite_stays_outside),
        cmocka_unit_test(the_brightest_sample_is_taken),
        cmocka_unit_test(black_has_no_relative_error),
        cmocka_unit_test(equal_pictures_have_no_error),
        cmocka_unit_test(equal_pictures_have_no_display_error),
        cmocka_unit_test(a_large_frame_keeps_its_mean),
        cmocka_unit_test(chance_is_seen_beside_black),
        cmocka_unit_test(quiet_pixels_do_not_count),
        cmocka_unit_test(a_point_without_error_is_left_out),
    };
    return cmocka_run_group_tests_name("sums", tests, NULL, NULL);
}
