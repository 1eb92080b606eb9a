/* Noise and bias of synthetic pictures whose truth is known. The operator is linear + sRGB. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "client/study/data/study_words.h"
#include "client/study/run.h"
#include "common/image/color.h"
#include "tests/support/statistics.h"

enum { SIDE = 64, REPEATS = 60 };
#define GREY 0.4f

struct lab {
    struct test_random random;
    struct tonemap_settings settings;
    struct shown shown;
    struct image usual, a, a2, b, b2;
};

static double gaussian(struct test_random *r)
{
    const double u = 1 - test_random_double(r), v = test_random_double(r);

    return sqrt(-2 * log(u)) * cos(2 * M_PI * v);
}

/* A grey picture with noise of that standard deviation. */
static void paint(struct lab *lab, struct image *out, float grey, double sigma)
{
    struct error err = {0};

    image_release(out);
    assert_int_equal(image_init(out, SIDE, SIDE, 3, &err), STATUS_OK);
    for (int i = 0; i < SIDE * SIDE * 3; i++)
        out->pixels[i] = fmaxf(0, grey + (float)(sigma > 0 ? sigma * gaussian(&lab->random) : 0));
}

static void lab_init(struct lab *lab)
{
    struct error err = {0};

    memset(lab, 0, sizeof *lab);
    lab->random = (struct test_random){.state = 5};
    assert_int_equal(tonemap_settings_init(&lab->settings, "linear", &err), STATUS_OK);
    paint(lab, &lab->usual, GREY, 0);
    assert_int_equal(shown_meter(&lab->shown, &lab->usual, &lab->settings, NULL, &err), STATUS_OK);
}

static void lab_release(struct lab *lab)
{
    struct image *all[] = {&lab->usual, &lab->a, &lab->a2, &lab->b, &lab->b2};

    for (size_t i = 0; i < sizeof all / sizeof *all; i++)
        image_release(all[i]);
}

static double code(float radiance) { return 255 * (double)srgb_encode(radiance); }

/* Radiance of one code at the grey. */
static double radiance_of_code(void) { return 0.001 / (code(GREY + 0.0005f) - code(GREY - 0.0005f)); }

static int holds(const struct study_interval *v, double truth) { return v->low <= truth && truth <= v->high; }

/* The largest of three Gaussian errors is below 2.388 standard deviations in 95 % of the pixels. */
static void noise_is_one_pictures(void **state)
{
    const double sigma = 3, truth = 2.388 * sigma;
    double mean = 0, rms = 0;
    int held = 0;
    struct lab lab;

    (void)state;
    lab_init(&lab);
    for (int i = 0; i < REPEATS; i++) {
        struct error err = {0};
        struct pair_error e;
        paint(&lab, &lab.a, GREY, sigma * radiance_of_code());
        paint(&lab, &lab.b, GREY, sigma * radiance_of_code());
        assert_int_equal(pair_error_of(&e, &lab.shown, &lab.a, &lab.b, NULL, &err), STATUS_OK);
        mean += e.codes.value / REPEATS;
        rms += e.rms_codes / REPEATS;
        held += holds(&e.codes, truth);
        assert_true(holds(&e.rmse, sigma * radiance_of_code() / (double)GREY) || e.rmse.high > 0);
    }
    assert_float_equal(mean, truth, 0.02 * truth);
    assert_float_equal(rms, sigma, 0.02 * sigma);
    assert_true(held >= REPEATS * 85 / 100);
    lab_release(&lab);
}

/* Two pictures are trusted as far as the one that is trusted less, whichever of them that is. */
static void the_word_is_the_worse_pictures(void **state)
{
    const struct accuracy_figures good = {.known = 1, .reliable = 1, .top_share = 0.3};
    const struct accuracy_figures better = {.known = 1, .reliable = 1, .top_share = 0.1};
    const struct accuracy_figures sparse = {.known = 1, .reasons = ACCURACY_SPARSE, .top_share = 0.05};
    const struct accuracy_figures top = {.known = 1, .reasons = ACCURACY_TOP, .top_share = 0.9};

    (void)state;
    assert_ptr_equal(pair_judge(&good, &better), &good);
    assert_ptr_equal(pair_judge(&better, &good), &good);
    assert_ptr_equal(pair_judge(&good, &sparse), &sparse);
    assert_ptr_equal(pair_judge(&sparse, &good), &sparse);
    assert_ptr_equal(pair_judge(&sparse, &top), &top);
}

struct bias_tally {
    double square, rms_square;
    int held, rms_held;
    double narrowest, rms_narrowest; /* lowest upper ends */
};

/* Biases of a picture that is `changed` in place of GREY, with noises of so many codes. */
static struct bias_tally tally(double truth, float changed, double noise, double noise2)
{
    struct bias_tally t = {0};
    struct lab lab;

    lab_init(&lab);
    for (int i = 0; i < REPEATS; i++) {
        struct error err = {0};
        struct pair_bias bias;
        paint(&lab, &lab.a, GREY, noise * radiance_of_code());
        paint(&lab, &lab.b, GREY, noise * radiance_of_code());
        paint(&lab, &lab.a2, changed, noise2 * radiance_of_code());
        paint(&lab, &lab.b2, changed, noise2 * radiance_of_code());
        assert_int_equal(pair_bias_of(&bias, &lab.shown, &lab.usual, &lab.a, &lab.a2, &lab.b, &lab.b2, &err),
                         STATUS_OK);
        assert_false(bias.same);
        t.square += bias.codes.value * bias.codes.value / REPEATS;
        t.rms_square += bias.rms_codes.value * bias.rms_codes.value / REPEATS;
        t.held += holds(&bias.codes, truth);
        t.rms_held += holds(&bias.rms_codes, truth);
        t.narrowest = i == 0 ? bias.codes.high : fmin(t.narrowest, bias.codes.high);
        t.rms_narrowest = i == 0 ? bias.rms_codes.high : fmin(t.rms_narrowest, bias.rms_codes.high);
    }
    lab_release(&lab);
    return t;
}

/* Twelve codes of noise, and other noise without the effect, are no bias. */
static void noise_is_no_bias(void **state)
{
    const struct bias_tally t = tally(0, GREY, 12, 6);

    (void)state;
    assert_true(t.held >= REPEATS * 90 / 100);
    assert_true(t.rms_held >= REPEATS * 85 / 100); /* the largest of three channels */
    assert_true(t.square < 50);                    /* of 500 that the noise has */
    /* However low chance puts the estimate: what the noise may hide is not 0. */
    assert_true(t.narrowest > 2 && t.rms_narrowest > 0.5);
    assert_true(t.rms_square < 4); /* of 180 that the noise has: 2.4 by chance */
}

/* In the dark a step of radiance is many codes. Where noise makes A and B dark together it is most, but that is no
 * bias. The noise is skewed, as light that few paths find is. */
static void noise_in_the_dark_is_no_bias(void **state)
{
    enum { DARK_REPEATS = 20, PATHS = 16, FINDS = 4 };
    const float mean = 0.02f;
    double square = 0;
    int held = 0;
    struct lab lab;

    (void)state;
    lab_init(&lab);
    for (int i = 0; i < DARK_REPEATS; i++) {
        struct image *const noisy[] = {&lab.a, &lab.b};
        struct error err = {0};
        struct pair_bias bias;
        struct image usual = {0};
        for (int k = 0; k < 2; k++) {
            paint(&lab, noisy[k], mean, 0);
            for (int j = 0; j < SIDE * SIDE * 3; j++) {
                int found = 0;
                for (int path = 0; path < PATHS; path++)
                    found += test_random_double(&lab.random) < 1.0 / FINDS;
                noisy[k]->pixels[j] = mean * FINDS / PATHS * (float)found;
            }
        }
        paint(&lab, &lab.a2, mean, 0);
        paint(&lab, &lab.b2, mean, 0);
        assert_int_equal(pair_mean(&usual, &lab.a, &lab.b, &err), STATUS_OK);
        assert_int_equal(pair_bias_of(&bias, &lab.shown, &usual, &lab.a, &lab.a2, &lab.b, &lab.b2, &err), STATUS_OK);
        square += bias.rms_codes.value * bias.rms_codes.value / DARK_REPEATS;
        held += holds(&bias.rms_codes, 0) && holds(&bias.codes, 0);
        image_release(&usual);
    }
    assert_true(held >= DARK_REPEATS * 85 / 100);
    assert_true(sqrt(square) < 1); /* the noise is 15 codes and more */
    lab_release(&lab);
}

/* Three codes of bias under twelve of noise are found. */
static void bias_is_found_under_noise(void **state)
{
    const float changed = (float)((double)GREY - 3 * radiance_of_code());
    const double truth = code(GREY) - code(changed);
    const struct bias_tally t = tally(truth, changed, 6, 6);

    (void)state;
    assert_float_equal(sqrt(t.rms_square), truth, 0.1 * truth);
    assert_true(t.rms_held >= REPEATS * 80 / 100);
    /* Noise of several channels makes the percentile's square a little more than the bias's. */
    assert_true(t.square > truth * truth / 4 && t.square < 36 * 4);
}

/* Without noise the bias is the difference of the codes, however large: no tangent would do. */
static void gross_bias_is_a_difference_of_codes(void **state)
{
    const float changed[] = {0, 0.05f, 0.38f, 0.8f};
    struct lab lab;

    (void)state;
    lab_init(&lab);
    paint(&lab, &lab.a, GREY, 0);
    paint(&lab, &lab.b, GREY, 0);
    for (size_t i = 0; i < sizeof changed / sizeof *changed; i++) {
        const double truth = fabs(code(GREY) - code(changed[i]));
        struct error err = {0};
        struct pair_bias bias;
        paint(&lab, &lab.a2, changed[i], 0);
        paint(&lab, &lab.b2, changed[i], 0);
        assert_int_equal(pair_bias_of(&bias, &lab.shown, &lab.usual, &lab.a, &lab.a2, &lab.b, &lab.b2, &err),
                         STATUS_OK);
        assert_float_equal(bias.codes.value, truth, 0.001 * truth);
        assert_float_equal(bias.codes.low, truth, 0.001 * truth);
        assert_float_equal(bias.rms_codes.value, truth, 0.001 * truth);
        assert_float_equal(bias.mean_change, (double)(changed[i] / GREY - 1), 1e-5);
    }
    lab_release(&lab);
}

/* A bright column between dark ones changes by its own codes per radiance, not by theirs. */
static void edges_keep_their_slopes(void **state)
{
    const double truth = code(0.8f) - code(0.99f * 0.8f);
    struct error err = {0};
    struct pair_bias bias;
    struct lab lab;

    (void)state;
    lab_init(&lab);
    paint(&lab, &lab.a, 0.01f, 0);
    for (size_t i = 0; i < SIDE * SIDE; i++)
        for (size_t c = 0; c < 3 && i % 4 == 0; c++)
            lab.a.pixels[3 * i + c] = 0.8f;
    paint(&lab, &lab.a2, 0, 0);
    for (size_t i = 0; i < SIDE * SIDE * 3; i++)
        lab.a2.pixels[i] = 0.99f * lab.a.pixels[i];
    assert_int_equal(pair_bias_of(&bias, &lab.shown, &lab.a, &lab.a, &lab.a2, &lab.a, &lab.a2, &err), STATUS_OK);
    assert_float_equal(bias.codes.value, truth, 0.05 * truth);
    lab_release(&lab);
}

/* What three of a hundred pixels show is no less wrong for it. */
static void few_pixels_count(void **state)
{
    enum { FEW = 11 };
    const double truth = code(GREY) * FEW / SIDE;
    struct error err = {0};
    struct pair_bias bias;
    struct lab lab;

    (void)state;
    lab_init(&lab);
    paint(&lab, &lab.a, GREY, 0);
    paint(&lab, &lab.a2, GREY, 0);
    for (size_t y = 0; y < FEW; y++)
        memset(lab.a2.pixels + 3 * SIDE * (y + 20), 0, FEW * 12);
    assert_int_equal(pair_bias_of(&bias, &lab.shown, &lab.usual, &lab.a, &lab.a2, &lab.a, &lab.a2, &err), STATUS_OK);
    assert_true(bias.codes.value < 1);
    assert_float_equal(pair_bias_worse(&bias).value, truth, 0.1 * truth);
    lab_release(&lab);
}

static void the_same_is_the_same(void **state)
{
    struct error err = {0};
    struct pair_bias bias;
    struct lab lab;

    (void)state;
    lab_init(&lab);
    paint(&lab, &lab.a, GREY, 0.05);
    paint(&lab, &lab.b, GREY, 0.05);
    assert_int_equal(pair_bias_of(&bias, &lab.shown, &lab.usual, &lab.a, &lab.a, &lab.b, &lab.b, &err), STATUS_OK);
    assert_true(bias.same);
    assert_true(bias.codes.value <= 0 && bias.codes.high <= 0);
    lab_release(&lab);
}

static void sizes_must_agree(void **state)
{
    struct error err = {0};
    struct pair_error e;
    struct lab lab;

    (void)state;
    lab_init(&lab);
    assert_int_equal(image_init(&lab.a, 3, 2, 3, &err), STATUS_OK);
    assert_int_equal(pair_error_of(&e, &lab.shown, &lab.usual, &lab.a, NULL, &err), STATUS_ERR_INPUT);
    lab_release(&lab);
}

/* ---- the law through points ----------------------------------------------------------------- */

static void fill_points(struct study_point *points, size_t count, struct test_random *r, double spread)
{
    for (size_t i = 0; i < count; i++) {
        const double t = pow(2, (double)i), codes = 40 * pow(t, -0.5) * exp(spread * gaussian(r));
        points[i].core_s = t;
        points[i].codes = (struct study_interval){codes, codes * (1 - 1.96 * spread),
                                                  codes * (1 + 1.96 * spread)};
    }
}

static void fit_finds_the_law(void **state)
{
    struct test_random r = {.state = 9};
    struct study_point points[8] = {0};
    struct study_fit fit;
    double width = 0;
    int held = 0;

    (void)state;
    fill_points(points, 8, &r, 0);
    study_fit_points(&fit, points, 8);
    assert_float_equal(fit.exponent.value, 0.5, 1e-9);
    assert_float_equal(fit.codes_at_pivot.value, 40 * pow(fit.pivot_core_s, -0.5), 1e-6);
    for (int i = 0; i < REPEATS; i++) {
        fill_points(points, 8, &r, 0.05);
        study_fit_points(&fit, points, 8);
        held += holds(&fit.exponent, 0.5);
        width += (fit.exponent.high - fit.exponent.low) / REPEATS;
    }
    assert_true(held >= REPEATS * 85 / 100);
    /* Only the last doublings count, and they say less than eight points of one law would: 0.044. */
    assert_true(width > 0.1 && width < 0.6);
    study_fit_points(&fit, points, 2);
    assert_true(isnan(fit.exponent.value));
    points[1].codes.value = 0; /* a black picture's error is in no power law */
    study_fit_points(&fit, points, 3);
    assert_true(isnan(fit.exponent.value));
}

/* The start of programs is no work: half the error takes four times what is left. */
static void fit_keeps_the_start_apart(void **state)
{
    struct study_point points[6] = {0};
    struct study study = {.target_codes = 3};

    (void)state;
    for (int i = 0; i < 6; i++) {
        const double work_s = ldexp(1, i) / 8;
        points[i].core_s = 3 + work_s;
        points[i].samples = points[i].rays = 1e6 * work_s;
        points[i].codes = (struct study_interval){20 / sqrt(work_s), 19 / sqrt(work_s), 21 / sqrt(work_s)};
    }
    study_fit_points(&study.fit, points, 6);
    assert_float_equal(study.fit.start_core_s, 3, 1e-6);
    assert_float_equal(study.fit.exponent.value, 0.5, 1e-6);
    study.clock_noise = NAN;
    assert_float_equal(study_cost_of(&study, points[5].codes.value / 2).value, 3 + 4 * 4, 0.1);
}

/* What short jobs show: start-up in every time, errors that hardly fall at first. It once gave an exponent of 0.106, "every
 * halving costs 687 times as much", and a price of 44,900 core-hours. */
static void fit_of_a_bad_start_stays_plausible(void **state)
{
    static const double shapes[2][6][2] = {
        {{1.0, 14.2}, {1.4, 13.1}, {2.4, 12.6}, {5.1, 11.4}, {11.7, 10.6}, {25.5, 10.1}},
        {{3.1, 9.0}, {3.2, 7.7}, {3.3, 6.6}, {3.5, 5.6}, {3.9, 4.9}, {4.6, 4.1}}, /* start-up alone: far too steep */
    };
    struct study study = {.target_codes = 3};
    struct study_interval cost;

    (void)state;
    for (size_t k = 0; k < 2; k++) {
        struct study_point points[6] = {0};
        for (size_t i = 0; i < 6; i++) {
            points[i].core_s = shapes[k][i][0];
            points[i].codes = (struct study_interval){shapes[k][i][1], shapes[k][i][1] * 0.97, shapes[k][i][1] * 1.03};
        }
        study_fit_points(&study.fit, points, 6);
        assert_true(study.fit.exponent.value >= 0.25 && study.fit.exponent.value <= 1);
        cost = study_cost_of(&study, points[5].codes.value / 2);
        if (!(cost.value > 2 * points[5].core_s && cost.value < 16 * points[5].core_s) || !(cost.low < cost.value) ||
            !(cost.high > cost.value))
            fail_msg("shape %zu: half the error costs %g (%g to %g) after %g", k, cost.value, cost.low, cost.high,
                     points[5].core_s);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(noise_is_one_pictures),
        cmocka_unit_test(the_word_is_the_worse_pictures),
        cmocka_unit_test(noise_is_no_bias),
        cmocka_unit_test(noise_in_the_dark_is_no_bias),
        cmocka_unit_test(bias_is_found_under_noise),
        cmocka_unit_test(gross_bias_is_a_difference_of_codes),
        cmocka_unit_test(edges_keep_their_slopes),
        cmocka_unit_test(few_pixels_count),
        cmocka_unit_test(the_same_is_the_same),
        cmocka_unit_test(sizes_must_agree),
        cmocka_unit_test(fit_finds_the_law), cmocka_unit_test(fit_keeps_the_start_apart), cmocka_unit_test(fit_of_a_bad_start_stays_plausible),
    };

    return cmocka_run_group_tests_name("client/pair", tests, NULL, NULL);
}
