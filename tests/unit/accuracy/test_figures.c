/* Figures of error from replicates whose noise is known. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "common/accuracy/contrasts.h"
#include "common/accuracy/figures.h"
#include "common/accuracy/quantile.h"
#include "common/accuracy/word.h"
#include "common/base/memory.h"
#include "common/scene/effects.h"
#include "tests/support/statistics.h"

enum { SIZE = 64, PIXELS = SIZE * SIZE, VALUES = PIXELS * 3, TILES = 16 };

static uint64_t random_state;

static double uniform(void)
{
    random_state = random_state * 6364136223846793005ull + 1442695040888963407ull;
    return ((double)(random_state >> 33) + 0.5) / 2147483648.0;
}

static double normal(void)
{
    double radius = sqrt(-2 * log(uniform()));

    return radius * cos(6.283185307179586 * uniform());
}

/* Codes are the values times a factor: nothing is cut off. */
static status linear_codes(void *user, const float *rgb, uint32_t width, uint32_t height,
                           float *codes, struct error *err)
{
    (void)err;
    for (size_t i = 0; i < (size_t)width * height * 3; i++)
        codes[i] = rgb[i] * *(const float *)user;
    return STATUS_OK;
}

static status failing_codes(void *user, const float *rgb, uint32_t width, uint32_t height,
                            float *codes, struct error *err)
{
    (void)user, (void)rgb, (void)width, (void)height, (void)codes;
    return error_set(err, STATUS_ERR_INPUT, "no such operator");
}

struct noisy {
    float *replicates[ACCURACY_REPLICATES];
    struct accuracy_picture picture;
    float factor;
    struct accuracy_transform transform;
};

static void noisy_init(struct noisy *n)
{
    memset(n, 0, sizeof *n);
    n->picture.width = n->picture.height = SIZE;
    for (int r = 0; r < ACCURACY_REPLICATES; r++)
        n->picture.replicates[r] = n->replicates[r] = calloc(VALUES, sizeof(float));
    n->factor = 1;
    n->transform = (struct accuracy_transform){linear_codes, &n->factor};
}

static void noisy_release(struct noisy *n)
{
    for (int r = 0; r < ACCURACY_REPLICATES; r++)
        free(n->replicates[r]);
}

/* Grey pixels of 100 with normal noise, whose deviation in replicate r is deviations[r], twice that on the
 * right half. */
static void noisy_fill(struct noisy *n, uint64_t seed, const double deviations[ACCURACY_REPLICATES])
{
    random_state = seed;
    for (int r = 0; r < ACCURACY_REPLICATES; r++)
        for (size_t p = 0; p < PIXELS; p++) {
            double value = 100 + normal() * deviations[r] * (p % SIZE < SIZE / 2 ? 1 : 2);
            for (int c = 0; c < 3; c++)
                n->replicates[r][p * 3 + (size_t)c] = (float)value;
        }
}

static struct accuracy_figures figures_of(const struct noisy *n, const struct accuracy_evidence *e)
{
    struct accuracy_figures out;
    struct error err = {0};

    assert_int_equal(accuracy_figures_of(&out, &n->picture, &n->transform, e, NULL, &err), STATUS_OK);
    return out;
}

static void assert_near(double value, double expected, double share)
{
    if (!(fabs(value - expected) <= share * fabs(expected)))
        fail_msg("%.9g instead of %.9g", value, expected);
}

/* The root mean square of the picture's real error, and the 95th percentile of its size. */
static void real_errors(const struct noisy *n, double *rms, double *percentile)
{
    static float sizes[PIXELS];
    double sum = 0;

    for (size_t p = 0; p < PIXELS; p++) {
        double mean = 0;
        for (int r = 0; r < ACCURACY_REPLICATES; r++)
            mean += (double)n->replicates[r][p * 3] / 4;
        sizes[p] = (float)fabs(mean - 100);
        sum += (mean - 100) * (mean - 100);
    }
    *rms = sqrt(sum / PIXELS);
    *percentile = (double)quantile_select(sizes, PIXELS, (size_t)(0.95 * (PIXELS - 1)));
}

static void test_known_noise(void **state)
{
    static const double equal[4] = {2, 2, 2, 2}, unequal[4] = {1, 1, 4, 4};
    uint32_t samples[TILES * 2];
    struct noisy n;
    double rms, percentile;

    (void)state;
    noisy_init(&n);
    for (int i = 0; i < TILES * 2; i++)
        samples[i] = i % 2 ? 4 : 64;
    for (int i = 0; i < 2; i++) { /* the groups may hold different numbers of samples */
        struct accuracy_figures f;
        n.picture.samples = i ? samples : NULL;
        noisy_fill(&n, 7, i ? unequal : equal);
        real_errors(&n, &rms, &percentile);
        f = figures_of(&n, NULL);
        assert_true(f.known && f.reliable);
        assert_near(f.rmse_percent, rms, 0.04);
        assert_near(f.display_error, percentile, 0.06);
        assert_near(f.psnr_db, 20 * log10(255 / rms), 0.02);
        assert_true(f.display_lo < percentile && percentile < f.display_hi);
    }
    noisy_release(&n);
}

/* Of 400 pictures 95 % lie in the interval; fewer than 361 or more than 394 would have a chance below 1e-3. */
static void test_intervals_hold(void **state)
{
    static const double deviations[4] = {2, 2, 1, 1};
    struct noisy n;
    int held = 0;

    (void)state;
    noisy_init(&n);
    for (uint64_t seed = 0; seed < 400; seed++) {
        struct accuracy_figures f;
        double rms, percentile;
        noisy_fill(&n, seed * 977 + 1, deviations);
        real_errors(&n, &rms, &percentile);
        f = figures_of(&n, NULL);
        held += f.rmse_lo <= rms && rms <= f.rmse_hi;
    }
    assert_in_range(held, 361, 394);
    noisy_release(&n);
}

static void test_light_level_does_not_count(void **state)
{
    static const double deviations[4] = {2, 2, 2, 2};
    struct noisy n;
    struct accuracy_figures bright, dark;

    (void)state;
    noisy_init(&n);
    noisy_fill(&n, 3, deviations);
    bright = figures_of(&n, NULL);
    for (int r = 0; r < ACCURACY_REPLICATES; r++)
        for (size_t i = 0; i < VALUES; i++)
            n.replicates[r][i] *= 1e-4f;
    n.factor = 1e4f;
    dark = figures_of(&n, NULL);
    assert_near(dark.rmse_percent, bright.rmse_percent, 1e-5);
    assert_near(dark.rmse_hi, bright.rmse_hi, 1e-5);
    assert_near(dark.display_error, bright.display_error, 1e-2); /* bins of deviations */
    assert_near(dark.psnr_db, bright.psnr_db, 1e-5);
    assert_near(dark.top_share, bright.top_share, 1e-4);
    noisy_release(&n);
}

/* One sample that is as bright as all the rest counts in full, and is reported. */
static void test_firefly_counts(void **state)
{
    static const double deviations[4] = {0.01, 0.01, 0.01, 0.01};
    struct noisy n;
    struct accuracy_figures f;
    char text[ACCURACY_WORDS_SIZE];

    (void)state;
    noisy_init(&n);
    noisy_fill(&n, 5, deviations);
    for (int c = 0; c < 3; c++)
        n.replicates[2][(20 * SIZE + 20) * 3 + c] = 100 + 4e6f;
    f = figures_of(&n, NULL);
    /* The contrasts hold 1e6 in one of 4096 pixels, the mean is 100 + 1e6 / 4096. */
    assert_near(f.rmse_percent, 100 * 1e6 / 64 / (100 + 1e6 / 4096), 1e-3);
    assert_near(f.top_share, 1, 1e-6);
    assert_false(f.reliable);
    assert_true(f.reasons & ACCURACY_TOP);
    assert_string_equal(accuracy_word(&f), "may be understated");
    assert_non_null(strstr(accuracy_reason_text(&f, EFFECT_CAUSTICS, text), "100 % of the squared error"));
    assert_non_null(strstr(text, "caustics"));
    noisy_release(&n);
}

/* The brightest light could be met through glass, and was not: 1e5 / 16 in one pixel is more than all. */
static void test_unmet_light_warns(void **state)
{
    static const double deviations[4] = {2, 2, 2, 2};
    struct accuracy_evidence evidence = {.samples = 16, .effects = EFFECT_CAUSTICS, .brightest = 1e5};
    struct accuracy_figures f;
    struct noisy n;

    (void)state;
    noisy_init(&n);
    noisy_fill(&n, 5, deviations);
    f = figures_of(&n, &evidence);
    assert_true(f.reasons & ACCURACY_UNSEEN);
    assert_false(f.reliable);
    evidence.brightest = 10; /* 1.2 of 30720: (5/2)^2 a pixel */
    assert_true(figures_of(&n, &evidence).reliable);
    evidence.brightest = 1e5;
    evidence.effects = EFFECT_GLOSSY; /* such a light is asked for directly */
    assert_true(figures_of(&n, &evidence).reliable);
    noisy_release(&n);
}

static void test_nothing_and_too_little(void **state)
{
    uint32_t samples[TILES * 2];
    struct accuracy_figures f;
    struct noisy n;

    (void)state;
    noisy_init(&n);
    f = figures_of(&n, NULL); /* black */
    assert_true(f.known && f.reliable && f.display_error == 0 && f.rmse_percent == 0);
    assert_true(isinf(f.psnr_db));
    for (int i = 0; i < TILES * 2; i++)
        samples[i] = 4;
    samples[9] = 1;
    n.picture.samples = samples;
    f = figures_of(&n, NULL);
    assert_true(!f.known && !f.reliable && isnan(f.display_error));
    noisy_release(&n);
}

/* Tiles that hold samples of one group only: the error is that of the group's mean. */
static void test_missing_group(void **state)
{
    static const double deviations[4] = {2, 2, 2, 2};
    uint32_t samples[TILES * 2];
    struct accuracy_figures f;
    struct noisy n;
    double sum = 0;

    (void)state;
    noisy_init(&n);
    noisy_fill(&n, 11, deviations);
    for (int i = 0; i < TILES * 2; i++)
        samples[i] = i % 2 ? 0 : 8;
    for (int r = 2; r < 4; r++)
        memset(n.replicates[r], 0, VALUES * sizeof(float));
    n.picture.samples = samples;
    for (size_t p = 0; p < PIXELS; p++) {
        double d = ((double)n.replicates[0][p * 3] + (double)n.replicates[1][p * 3]) / 2 - 100;
        sum += d * d;
    }
    f = figures_of(&n, NULL);
    assert_near(f.mean, 100, 0.01);
    assert_near(f.rmse_percent, sqrt(sum / PIXELS), 0.06);
    noisy_release(&n);
}

static void test_map(void **state)
{
    static const double deviations[4] = {2, 2, 2, 2};
    float display[TILES], linear[TILES];
    struct accuracy_map map = {display, linear};
    struct accuracy_figures f;
    struct error err = {0};
    struct noisy n;

    (void)state;
    noisy_init(&n);
    noisy_fill(&n, 31, deviations);
    assert_int_equal(accuracy_figures_of(&f, &n.picture, &n.transform, NULL, &map, &err), STATUS_OK);
    for (int t = 0; t < TILES; t++) {
        assert_near((double)linear[t], t % 4 < 2 ? 1 : 2, 0.12);
        assert_near((double)display[t], t % 4 < 2 ? 1 : 2, 0.12);
    }
    noisy_release(&n);
}

static void test_errors_come_back(void **state)
{
    static const double deviations[4] = {2, 2, 2, 2};
    struct accuracy_figures f;
    struct error err = {0};
    struct noisy n;
    status s = STATUS_ERR_NO_MEMORY;

    (void)state;
    noisy_init(&n);
    noisy_fill(&n, 41, deviations);
    for (long i = 0; s != STATUS_OK; i++) {
        mem_fault_arm(i, 1);
        s = accuracy_figures_of(&f, &n.picture, &n.transform, NULL, NULL, &err);
        assert_true(s == STATUS_OK || s == STATUS_ERR_NO_MEMORY);
        assert_true(i < 100);
    }
    mem_fault_arm(-1, 0);
    n.transform.apply = failing_codes;
    assert_int_equal(accuracy_figures_of(&f, &n.picture, &n.transform, NULL, NULL, &err), STATUS_ERR_INPUT);
    assert_string_equal(err.text, "no such operator");
    noisy_release(&n);
}

static int ascending(const void *a, const void *b)
{
    float x = *(const float *)a, y = *(const float *)b;

    return x < y ? -1 : x > y;
}

static void test_quantiles(void **state)
{
    static struct spreads spreads;
    static float values[1000], sorted[1000];

    (void)state;
    random_state = 1;
    for (size_t i = 0; i < 1000; i++)
        sorted[i] = values[i] = i % 7 ? (float)exp(20 * uniform() - 10) : 0;
    qsort(sorted, 1000, sizeof *sorted, ascending);
    for (size_t i = 0; i < 1000; i++)
        assert_true(quantile_select(values, 1000, i) == sorted[i]);
    for (double x = 0; x < 20; x += 0.01)
        assert_near(complement_erf(x), erfc(x), 1e-10);
    for (int i = 0; i < 100; i++) /* deviations below and beyond 2, and 0 */
        spreads_add(&spreads, 300, 1);
    assert_near(spreads_quantile(&spreads, 0.05), 1.959964 * 300, 0.012);
    for (int i = 0; i < 100; i++)
        spreads_add(&spreads, 0, 1);
    assert_near(spreads_quantile(&spreads, 0.05), 1.644854 * 300, 0.012);
}

/* The mean of three contrasts as an estimate of a fourth draw of the same kind, the real error: the variance of
 * that difference. Contrasts of independent numbers, normal-like and rare; two t-tests at 0.005 each. */
static void test_contrasts_variance(void **state)
{
    enum { N = 200000 };

    (void)state;
    for (int rare = 0; rare < 2; rare++) {
        struct test_random random = {17};
        struct running_stats excess = {0}, square = {0};

        for (int i = 0; i < N; i++) {
            double x[4], d;

            for (int k = 0; k < 4; k++) {
                x[k] = rare ? test_random_double(&random) < 0.05 : 0;
                for (int j = 0; j < 4 && !rare; j++)
                    x[k] += test_random_double(&random) - 0.5;
            }
            d = (x[0] + x[1] + x[2]) / 3 - x[3];
            running_stats_add(&square, d * d);
            running_stats_add(&excess, d * d - contrasts_variance(x));
        }
        if (mean_test_p_value(&excess, 0) < 0.005)
            fail_msg("off by %g of %g", excess.mean, square.mean);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_contrasts_variance), cmocka_unit_test(test_known_noise),     cmocka_unit_test(test_intervals_hold),
        cmocka_unit_test(test_light_level_does_not_count), cmocka_unit_test(test_firefly_counts),
        cmocka_unit_test(test_unmet_light_warns), cmocka_unit_test(test_nothing_and_too_little),
        cmocka_unit_test(test_missing_group),
        cmocka_unit_test(test_map),             cmocka_unit_test(test_errors_come_back),
        cmocka_unit_test(test_quantiles),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
