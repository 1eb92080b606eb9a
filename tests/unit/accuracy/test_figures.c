/* Figures of error from groups whose noise is known. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/accuracy/contrast.h"
#include "common/accuracy/figures.h"
#include "common/accuracy/quantile.h"
#include "common/film/unit.h"
#include "common/accuracy/word.h"
#include "common/base/memory.h"
#include "common/scene/effects.h"
#include "common/scene/scene.h"
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
static status linear_codes(void *user, const float *rgb, uint32_t width, uint32_t height, float *codes,
                           struct error *err)
{
    (void)err;
    for (size_t i = 0; i < (size_t)width * height * 3; i++)
        codes[i] = rgb[i] * *(const float *)user;
    return STATUS_OK;
}

static status failing_codes(void *user, const float *rgb, uint32_t width, uint32_t height, float *codes,
                            struct error *err)
{
    (void)user, (void)rgb, (void)width, (void)height, (void)codes;
    return error_set(err, STATUS_ERR_INPUT, "no such operator");
}

struct noisy {
    float *groups[2];
    struct accuracy_picture picture;
    float factor;
    struct accuracy_transform transform;
};

static void noisy_init(struct noisy *n)
{
    memset(n, 0, sizeof *n);
    n->picture.width = n->picture.height = SIZE;
    for (int r = 0; r < 2; r++)
        n->picture.groups[r] = n->groups[r] = calloc(VALUES, sizeof(float));
    n->factor = 1;
    n->transform = (struct accuracy_transform){.apply = linear_codes, .user = &n->factor};
}

static void noisy_release(struct noisy *n)
{
    for (int r = 0; r < 2; r++)
        free(n->groups[r]);
}

/* Grey pixels of 100 with normal noise, whose deviation in group r is deviations[r], twice that on the
 * right half. */
static void noisy_fill(struct noisy *n, uint64_t seed, const double deviations[2])
{
    random_state = seed;
    for (int r = 0; r < 2; r++)
        for (size_t p = 0; p < PIXELS; p++) {
            double value = 100 + normal() * deviations[r] * (p % SIZE < SIZE / 2 ? 1 : 2);
            for (int c = 0; c < 3; c++)
                n->groups[r][p * 3 + (size_t)c] = (float)value;
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
        for (int r = 0; r < 2; r++)
            mean += (double)n->groups[r][p * 3] / 2;
        sizes[p] = (float)fabs(mean - 100);
        sum += (mean - 100) * (mean - 100);
    }
    *rms = sqrt(sum / PIXELS);
    *percentile = (double)quantile_select(sizes, PIXELS, (size_t)(0.95 * (PIXELS - 1)));
}

static void test_known_noise(void **state)
{
    static const double equal[2] = {2, 2}, unequal[2] = {1, 4};
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
    static const double deviations[2] = {2, 1};
    uint32_t samples[TILES * 2];
    struct noisy n;
    int held = 0;

    (void)state;
    noisy_init(&n);
    for (int i = 0; i < TILES * 2; i++)
        samples[i] = i % 2 ? 64 : 16;
    n.picture.samples = samples;
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
    static const double deviations[2] = {2, 2};
    struct noisy n;
    struct accuracy_figures bright, dark;

    (void)state;
    noisy_init(&n);
    noisy_fill(&n, 3, deviations);
    bright = figures_of(&n, NULL);
    for (int r = 0; r < 2; r++)
        for (size_t i = 0; i < VALUES; i++)
            n.groups[r][i] *= 1e-4f;
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
    static const double deviations[2] = {0.01, 0.01};
    struct noisy n;
    struct accuracy_figures f;
    char text[ACCURACY_WORDS_SIZE];

    (void)state;
    noisy_init(&n);
    noisy_fill(&n, 5, deviations);
    for (int c = 0; c < 3; c++)
        n.groups[1][(20 * SIZE + 20) * 3 + c] = 100 + 2e6f;
    f = figures_of(&n, NULL);
    /* The contrast holds 1e6 in one of 4096 pixels, the mean is 100 + 1e6 / 4096. */
    assert_near(f.rmse_percent, 100 * 1e6 / 64 / (100 + 1e6 / 4096), 1e-3);
    assert_near(f.top_share, 1, 1e-6);
    assert_true(f.reasons & ACCURACY_TOP);
    assert_false(accuracy_rmse_is_reliable(&f));
    assert_string_equal(accuracy_rmse_word(&f), "may be understated");
    assert_non_null(strstr(accuracy_rmse_reason_text(&f, EFFECT_CAUSTICS, text), "100 % of the squared error"));
    assert_non_null(strstr(text, "caustics"));
    /* One pixel of 4096 moves no figure of 95 %. */
    assert_true(f.reliable);
    assert_string_equal(accuracy_word(&f), "reliable");
    assert_string_equal(accuracy_reason_text(&f, EFFECT_CAUSTICS, text), "");
    noisy_release(&n);
}

/* The brightest light could be met through glass, and was not: 1e5 / 16 in one pixel is more than all. */
static void test_unmet_light_warns(void **state)
{
    static const double deviations[2] = {2, 2};
    struct accuracy_evidence evidence = {.samples = 16, .effects = EFFECT_CAUSTICS, .brightest = 1e5};
    struct accuracy_figures f;
    struct noisy n;

    (void)state;
    noisy_init(&n);
    noisy_fill(&n, 5, deviations);
    f = figures_of(&n, &evidence);
    assert_true(f.reasons & ACCURACY_UNSEEN);
    assert_true(f.reliable && !accuracy_rmse_is_reliable(&f));
    evidence.brightest = 10; /* 1.2 of 30720: (5/2)^2 a pixel */
    f = figures_of(&n, &evidence);
    assert_true(f.reliable && accuracy_rmse_is_reliable(&f));
    evidence.brightest = 1e5;
    evidence.effects = EFFECT_GLOSSY; /* such a light is asked for directly */
    f = figures_of(&n, &evidence);
    assert_true(f.reliable && accuracy_rmse_is_reliable(&f));
    noisy_release(&n);
}

/* Of a scene, without its pictures: older ones do not say how bright their map is. */
static void test_brightest_light(void **state)
{
    struct scene_material lamp;
    struct scene scene;

    (void)state;
    scene_init(&scene);
    assert_true(accuracy_brightest(&scene, 1) == 0);
    scene_material_default(&lamp);
    lamp.emission[2] = 8;
    scene.materials = &lamp;
    scene.material_count = 1;
    assert_true(accuracy_brightest(&scene, 1) == 8);
    scene.environment.present = 1;
    scene.environment.brightest = 100;
    scene.environment.radiance[1] = 3;
    assert_true(accuracy_brightest(&scene, 0.5) == 150);
    scene.environment.brightest = 2;
    assert_true(accuracy_brightest(&scene, 0.5) == 8);
    scene.environment.brightest = 0;
    assert_true(isinf(accuracy_brightest(&scene, 0.5)));
    assert_true(accuracy_brightest(&scene, 0) == 8);
    scene.environment.constant = 1;
    assert_true(accuracy_brightest(&scene, 5) == 15);
    scene.environment.present = 0;
    assert_true(accuracy_brightest(&scene, 5) == 8);
    scene.materials = NULL;
    scene.material_count = 0;
    scene_release(&scene);
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
    samples[9] = 0;
    n.picture.samples = samples;
    f = figures_of(&n, NULL);
    assert_true(!f.known && !f.reliable && isnan(f.display_error));
    noisy_release(&n);
}

static void test_map(void **state)
{
    static const double deviations[2] = {2, 2};
    float display[TILES], linear[TILES];
    struct accuracy_map map = {.display = display, .linear = linear};
    struct accuracy_figures f;
    struct error err = {0};
    struct noisy n;

    (void)state;
    noisy_init(&n);
    noisy_fill(&n, 31, deviations);
    assert_int_equal(accuracy_figures_of(&f, &n.picture, &n.transform, NULL, &map, &err), STATUS_OK);
    for (int t = 0; t < TILES; t++) {
        assert_near((double)linear[t], t % 4 < 2 ? sqrt(2) : 2 * sqrt(2), 0.25);
        assert_near((double)display[t], t % 4 < 2 ? sqrt(2) : 2 * sqrt(2), 0.25);
    }
    noisy_release(&n);
}

static void test_errors_come_back(void **state)
{
    static const double deviations[2] = {2, 2};
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
    qsort(memcpy(sorted, values, sizeof sorted), 256, sizeof *sorted, ascending);
    for (size_t i = 0; i < 256; i++) /* few values are sorted in part, not counted */
        assert_true(quantile_select(values, 256, i) == sorted[i]);
    for (double x = 0; x < 20; x += 0.01)
        assert_near(complement_erf(x), erfc(x), 1e-10);
    for (int i = 0; i < 100; i++) /* deviations below and beyond 2, and 0 */
        spreads_add(&spreads, 300, 1);
    assert_near(spreads_quantile(&spreads, 0.05), 1.959964 * 300, 0.012);
    for (int i = 0; i < 100; i++)
        spreads_add(&spreads, 0, 1);
    assert_near(spreads_quantile(&spreads, 0.05), 1.644854 * 300, 0.012);
    memset(&spreads, 0, sizeof spreads);
    for (int i = 0; i < 2000; i++)
        spreads_add(&spreads, i % 5 ? (float)exp(12 * uniform() - 8) : 0, 1 + (uint64_t)(i % 3));
    for (double beyond = 0.5; beyond > 1e-6; beyond *= 0.3) { /* by the sum over all of them */
        double q = spreads_quantile(&spreads, beyond), share[2] = {0};
        for (uint32_t i = 1; i < SPREADS_BINS; i++)
            for (int side = 0; side < 2 && spreads.bins[i] > 0; side++)
                share[side] += (double)spreads.bins[i] / (double)spreads.count *
                               erfc(q * (side ? 1.000001 : 0.999999) / (double)float_from_bits(i << 17 | 1u << 16) / sqrt(2));
        assert_true(share[0] >= beyond && share[1] <= beyond);
    }
}

/* ---- strips ---- */

/* Codes that a picture's brightest value scales, as metering does; each picture is measured before it is shown. */
static float measured[3];

static status measure_brightest(void *user, int picture, const float *rgb, uint32_t width, uint32_t height,
                                struct error *err)
{
    (void)user, (void)err;
    measured[picture] = 0;
    for (size_t i = 0; i < (size_t)width * height * 3; i++)
        measured[picture] = rgb[i] > measured[picture] ? rgb[i] : measured[picture];
    return STATUS_OK;
}

static void scaled_codes(void *user, int picture, const float *rgb, uint32_t count, float *codes)
{
    (void)user;
    for (size_t i = 0; i < (size_t)count * 3; i++)
        codes[i] = rgb[i] / measured[picture] * 255;
}

static status scaled_picture(void *user, const float *rgb, uint32_t width, uint32_t height, float *codes,
                             struct error *err)
{
    (void)measure_brightest(user, 0, rgb, width, height, err);
    scaled_codes(user, 0, rgb, width * height, codes);
    return STATUS_OK;
}

static void lines_of(void *user, int group, uint32_t y, uint32_t height, float *out)
{
    const struct noisy *n = user;

    memcpy(out, n->groups[group] + (size_t)y * n->picture.width * 3, (size_t)height * n->picture.width * 3 * sizeof *out);
}

/* Figures and maps made in strips, from groups that are there or given by lines, are to the bit those of whole pictures. */
static void test_strips(void **state)
{
    static const uint32_t sizes[][2] = {{64, 64}, {37, 97}, {4096, 1}, {1, 97}, {64, 49}, {64, 48},
                                        {512, 97}, {5003, 4}};

    (void)state;
    for (size_t i = 0; i < 2 * (sizeof sizes / sizeof *sizes); i++) {
        const uint32_t width = sizes[i / 2][0], height = sizes[i / 2][1];
        const size_t pixels = (size_t)width * height;
        struct noisy n;
        uint16_t fireflies[3][TILES * 20];
        float display[3][TILES * 20];
        struct accuracy_figures f[3];
        noisy_init(&n);
        noisy_fill(&n, i + 1, i % 2 ? (const double[]){0, 0} : (const double[]){3, 4});
        for (int r = 0; r < 2; r++) {
            n.groups[r] = realloc(n.groups[r], (pixels > PIXELS ? pixels : PIXELS) * 3 * sizeof(float));
            n.picture.groups[r] = n.groups[r];
            for (size_t k = VALUES; k < pixels * 3; k++)
                n.groups[r][k] = n.groups[r][k - VALUES];
        }
        for (size_t p = 7; p < pixels; p += i % 2 ? 17 : 331)
            n.groups[p % 2][p * 3] = 900; /* some are fireflies, or samples that have met no other pixel */
        n.picture.width = width;
        n.picture.height = height;
        memset(f, 0, sizeof f);
        for (int way = 0; way < 3; way++) {
            struct accuracy_picture picture = n.picture;
            struct accuracy_transform transform = {.apply = scaled_picture};
            struct accuracy_map map = {.display = display[way], .fireflies = fireflies[way]};
            if (way > 0) {
                transform.measure = measure_brightest;
                transform.codes = scaled_codes;
            }
            if (way == 2) {
                picture.groups[0] = picture.groups[1] = NULL;
                picture.lines = lines_of;
                picture.user = &n;
            }
            assert_int_equal(accuracy_figures_of(&f[way], &picture, &transform, NULL, &map, NULL), STATUS_OK);
        }
        for (int way = 1; way < 3; way++) {
            size_t tiles = (size_t)((width + 15) / 16) * ((height + 15) / 16);
            assert_memory_equal(&f[way], &f[0], sizeof f[0]);
            assert_memory_equal(display[way], display[0], tiles * sizeof(float));
            assert_memory_equal(fireflies[way], fireflies[0], tiles * sizeof(uint16_t));
        }
        if (i == 0)
            assert_true(f[0].fireflies > 0);
        if (i % 2 && width > 1 && height > 1)
            assert_true(f[0].lone > 0.25); /* the grain was asked, too */
        noisy_release(&n);
    }
}

/* The table that decides most bisections leaves the bits that the series gives. */
static void test_quantiles_keep_their_bits(void **state)
{
    static struct spreads spreads;
    uint64_t hash = 0;

    (void)state;
    random_state = 1;
    for (int k = 0; k < 200; k++) {
        double range = ldexp(1, k % 5);
        memset(&spreads, 0, sizeof spreads);
        for (int i = 0; i < (k % 10 ? 2000 : 3); i++)
            spreads_add(&spreads, (float)ldexp(1 + uniform(), (int)(range * uniform()) - 6), 1);
        for (int i = 0; i < 3; i++) {
            double q = spreads_quantile(&spreads, i < 2 ? 0.05 + 0.01 * i : uniform());
            hash = hash * 31 + hash_bytes((const uint8_t *)&q, sizeof q);
        }
    }
    assert_int_equal(hash, 0x5d7a50c6bfe82251);
}

/* The variance of what a sum of C^2 is off the sum of the errors' squares. It is that of normal noise; rare bright
 * samples have less, since the one that a group meets is in C as in the error. */
static void test_variance_of_the_sum(void **state)
{
    enum { PICTURES = 300 };

    (void)state;
    for (int rare = 0; rare < 2; rare++) {
        struct running_stats excess = {0}, square = {0};
        struct noisy n;

        noisy_init(&n);
        random_state = 17;
        for (int i = 0; i < PICTURES; i++) {
            struct error err = {0};
            struct gathered g;
            double off = 0;
            for (size_t p = 0; p < PIXELS; p++) {
                double x[2];
                for (int k = 0; k < 2; k++) {
                    x[k] = rare ? (uniform() < 0.05 ? 19 : -1) : normal();
                    for (int c = 0; c < 3; c++) /* of one colour */
                        n.groups[k][p * 3 + (size_t)c] = (float)(100 + x[k] * (1 + c));
                }
                off -= x[0] * x[1] * (1 + 4 + 9);
            }
            assert_int_equal(gathered_make(&g, &n.picture, &n.transform, &err), STATUS_OK);
            running_stats_add(&square, off * off);
            running_stats_add(&excess, off * off - g.linear_variance);
            gathered_release(&g);
        }
        if (rare ? excess.mean > 0 : mean_test_p_value(&excess, 0) < 0.005)
            fail_msg("off by %g of %g", excess.mean, square.mean);
        noisy_release(&n);
    }
}

/* ---- what people look at ----------------------------------------------------------------------- */

/* Noise in the middle, tiles 5, 6, 9, 10, of deviation `noise`, and in the top left half of tile 0; around it a
 * background with `calm` noise. */
static void fill_subject(struct noisy *n, uint64_t seed, double noise, double calm, float subject[TILES])
{
    random_state = seed;
    for (size_t p = 0; p < PIXELS; p++) {
        uint32_t x = (uint32_t)(p % SIZE), y = (uint32_t)(p / SIZE);
        int seen = (x >= 16 && x < 48 && y >= 16 && y < 48) || (x < 16 && y < 8);
        for (int r = 0; r < 2; r++) {
            double value = 100 + normal() * (seen ? noise : calm);
            for (int c = 0; c < 3; c++)
                n->groups[r][p * 3 + (size_t)c] = (float)value;
        }
    }
    for (int t = 0; t < TILES; t++)
        subject[t] = t == 5 || t == 6 || t == 9 || t == 10 ? 1 : t == 0 ? 0.5f : 0;
    n->picture.subject = subject;
}

/* A model has the same error before any backdrop; only what sees it counts, in part where the tile does in part. */
static void test_backdrop_does_not_count(void **state)
{
    const double calm[] = {0, 0.2, 0.6}; /* a plain backdrop, and maps with details */
    float subject[TILES];
    struct noisy n;

    (void)state;
    noisy_init(&n);
    for (int i = 0; i < 3; i++) {
        struct accuracy_figures f;
        fill_subject(&n, 11, 4, calm[i], subject);
        f = figures_of(&n, NULL);
        /* The groups' deviation is 4, the mean's 4 / sqrt(2). */
        assert_near(f.display_error, 1.96 * 4 / sqrt(2), 0.08);
        assert_near(f.subject, 4.5 / 16, 1e-6);
        assert_true(f.display_all < 0.8 * f.display_error);
        assert_near(f.worst_part, 4 / sqrt(2), 0.15);
    }
    n.picture.subject = NULL; /* not known: all counts */
    assert_near(figures_of(&n, NULL).display_error, figures_of(&n, NULL).display_all, 1e-12);
    assert_true(figures_of(&n, NULL).subject == 1);
    memset(subject, 0, sizeof subject); /* nothing but background: all counts */
    n.picture.subject = subject;
    assert_near(figures_of(&n, NULL).display_error, figures_of(&n, NULL).display_all, 1e-12);
    assert_true(figures_of(&n, NULL).subject == 0);
    noisy_release(&n);
}

/* One part that is worse than all others is the worst part, not the error of 95 % of the pixels. */
static void test_worst_part(void **state)
{
    struct noisy n;
    struct accuracy_figures f;

    (void)state;
    noisy_init(&n);
    random_state = 5;
    for (int r = 0; r < 2; r++)
        for (size_t p = 0; p < PIXELS; p++) {
            int worse = p % SIZE < 12 && p / SIZE < 12; /* 3.5 % of the picture */
            for (int c = 0; c < 3; c++)
                n.groups[r][p * 3 + (size_t)c] = 100;
            n.groups[r][p * 3] += (float)(normal() * (worse ? 20 : 1));
        }
    f = figures_of(&n, NULL);
    assert_true(f.worst_part > 7 && f.worst_part < 14 && f.display_error < 3);
    noisy_release(&n);
}

/* What one group has met and the other not is a firefly; a lamp that both see is none, nor is noise all over. */
static void test_fireflies(void **state)
{
    static const double soft[2] = {1, 1}, hard[2] = {30, 30};
    struct noisy n;
    uint16_t counts[TILES];
    struct accuracy_map map = {.fireflies = counts};
    struct accuracy_figures f;
    struct error err = {0};

    (void)state;
    noisy_init(&n);
    noisy_fill(&n, 9, soft);
    assert_true(figures_of(&n, NULL).fireflies == 0);
    for (int i = 0; i < 20; i++) {
        size_t p = ((size_t)(3 * i + 2) * SIZE + (size_t)(5 + 2 * i)) * 3;
        for (int c = 0; c < 3; c++)
            n.groups[i % 2][p + (size_t)c] += 120; /* a firefly: 60 in the mean */
        p = ((size_t)(3 * i + 2) * SIZE + (size_t)(15 + 2 * i)) * 3;
        for (int r = 0; r < 2; r++)
            for (int c = 0; c < 3; c++)
                n.groups[r][p + (size_t)c] += 60; /* a star */
    }
    assert_int_equal(accuracy_figures_of(&f, &n.picture, &n.transform, NULL, &map, &err), STATUS_OK);
    assert_true(f.fireflies == 20);
    for (int t = 1; t < TILES; t++)
        counts[0] = (uint16_t)(counts[0] + counts[t]);
    assert_int_equal(counts[0], 20);
    noisy_fill(&n, 9, hard);
    assert_true(figures_of(&n, NULL).fireflies <= 0.002 * PIXELS);
    noisy_release(&n);
}

enum { LARGE = 512, LARGE_ACROSS = LARGE / 16, LARGE_TILES = LARGE_ACROSS * LARGE_ACROSS, SOME = 64 };

/* Tiles whose noise differs by factors, each with a firefly of one group in the middle of every second tile. */
static void large_fill(float *const groups[2])
{
    static double deviations[LARGE_TILES];

    for (int t = 0; t < LARGE_TILES; t++)
        deviations[t] = exp(normal());
    for (int y = 0; y < LARGE; y++)
        for (int x = 0; x < LARGE; x++)
            for (int r = 0; r < 2; r++) {
                int tile = y / 16 * LARGE_ACROSS + x / 16, met = x % 16 == 8 && y % 16 == 8 && tile % 2 == 0 && r == 0;
                float value = (float)(100 + normal() * deviations[tile] + (met ? 400 : 0));
                for (int c = 0; c < 3; c++)
                    groups[r][((size_t)y * LARGE + (size_t)x) * 3 + (size_t)c] = value;
            }
}

/* SOME tiles of it, each as likely as every other, beside each other. */
static void sample_tiles(float *const groups[2], float *const out[2])
{
    static int tiles[LARGE_TILES];

    for (int t = 0; t < LARGE_TILES; t++)
        tiles[t] = t;
    for (int i = 0; i < SOME; i++) {
        int other = i + (int)(uniform() * (LARGE_TILES - i)), tile = tiles[other];
        tiles[other] = tiles[i];
        for (int r = 0; r < 2; r++)
            for (int y = 0; y < 16; y++)
                memcpy(out[r] + ((size_t)(i / 8 * 16 + y) * 128 + (size_t)(i % 8) * 16) * 3,
                       groups[r] + ((size_t)(tile / LARGE_ACROSS * 16 + y) * LARGE + (size_t)(tile % LARGE_ACROSS) * 16) * 3,
                       16 * 3 * sizeof(float));
    }
}

/* A sample's intervals hold the figures of the whole picture, and without `of_tiles` they do not. */
static void test_samples_of_tiles(void **state)
{
    enum { DRAWS = 200 };
    float *groups[2], *some[2], factor = 0.5f;
    struct noisy n = {.picture = {.width = LARGE, .height = LARGE}};
    struct accuracy_figures whole, f;
    int holds = 0, blind = 0, psnr = 0, rmse = 0;
    double fireflies = 0;

    (void)state;
    random_state = 31;
    for (int r = 0; r < 2; r++) {
        n.picture.groups[r] = groups[r] = calloc((size_t)LARGE * LARGE * 3, sizeof(float));
        some[r] = calloc((size_t)SOME * 256 * 3, sizeof(float));
    }
    large_fill(groups);
    n.transform = (struct accuracy_transform){.apply = linear_codes, .user = &factor};
    whole = figures_of(&n, NULL);
    n.picture = (struct accuracy_picture){.width = 128, .height = SOME * 2, .groups = {some[0], some[1]}};
    for (int i = 0; i < DRAWS; i++) {
        sample_tiles(groups, some);
        n.picture.of_tiles = 0;
        f = figures_of(&n, NULL);
        blind += f.display_lo <= whole.display_error && whole.display_error <= f.display_hi;
        n.picture.of_tiles = LARGE_TILES;
        f = figures_of(&n, NULL);
        holds += f.display_lo <= whole.display_error && whole.display_error <= f.display_hi;
        psnr += f.psnr_lo <= whole.psnr_db && whole.psnr_db <= f.psnr_hi;
        rmse += f.rmse_lo <= whole.rmse_percent && whole.rmse_percent <= f.rmse_hi;
        fireflies += f.fireflies / DRAWS;
    }
    printf("# of %d samples hold: display %d (%d blind), PSNR %d, RMSE %d; fireflies %.0f of %.0f\n", DRAWS, holds,
           blind, psnr, rmse, fireflies, whole.fireflies);
    assert_true(holds > 0.88 * DRAWS && holds < DRAWS && blind < 0.7 * DRAWS);
    assert_true(psnr > 0.85 * DRAWS && rmse > 0.85 * DRAWS);
    assert_near(fireflies, whole.fireflies, 0.1);
    for (int r = 0; r < 2; r++) {
        free(groups[r]);
        free(some[r]);
    }
}

/* As a display shows it: white is 1, and what is brighter is cut off. */
static status display_codes(void *user, const float *rgb, uint32_t width, uint32_t height, float *codes, struct error *err)
{
    (void)user, (void)err;
    for (size_t i = 0; i < (size_t)width * height * 3; i++)
        codes[i] = 255 * powf(fminf(rgb[i], 1), 1 / 2.2f);
    return STATUS_OK;
}

static int rising_floats(const void *a, const void *b)
{
    const float x = *(const float *)a, y = *(const float *)b;

    return (x > y) - (x < y);
}

/* Half of the light is in every sample and half in one of `rare`, where it is far brighter than the display's white; over
 * a board of squares of `side` pixels that differ by `contrast`. Printed over true. */
static double sparse_ratio(double rare, int samples, int side, double contrast)
{
    static float errors[PIXELS];
    struct noisy n;
    struct accuracy_figures f;
    double truth;

    noisy_init(&n);
    n.transform.apply = display_codes;
    random_state = 5;
    for (size_t p = 0; p < PIXELS; p++) {
        const double ground = 0.2 * (1 + (((int)(p / SIZE) / side + (int)(p % SIZE) / side) % 2 ? contrast : -contrast));
        double right = 255 * pow(ground, 1 / 2.2), shown;
        for (int r = 0; r < 2; r++) {
            double sum = 0;
            for (int i = 0; i < samples; i++)
                sum += ground / 2 / samples * (1 + (uniform() < 1 / rare ? rare : 0));
            for (size_t c = 0; c < 3; c++)
                n.groups[r][p * 3 + c] = (float)sum;
        }
        shown = 255 * pow(fmin(((double)n.groups[0][p * 3] + (double)n.groups[1][p * 3]) / 2, 1), 1 / 2.2);
        errors[p] = (float)fabs(shown - right);
    }
    qsort(errors, PIXELS, sizeof *errors, rising_floats);
    truth = (double)errors[PIXELS * 95 / 100];
    f = figures_of(&n, NULL);
    assert_true(f.display_lo <= f.display_error && f.display_error <= f.display_hi);
    noisy_release(&n);
    return f.display_error / truth;
}

/* Most pixels have not met half of the light: the groups alone say .61 to .63 of the error, the neighbours know better. */
static void test_few_samples_have_met_the_light(void **state)
{
    (void)state;
    for (int samples = 4; samples <= 32; samples *= 2)
        assert_near(sparse_ratio(20 * samples, samples, SIZE, 0), 1, 0.15);
    assert_near(sparse_ratio(160, 8, 8, 0.3), 1, 0.15);
    assert_near(sparse_ratio(80, 32, 4, 0.3), 1, 0.15);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_samples_of_tiles),
        cmocka_unit_test(test_variance_of_the_sum), cmocka_unit_test(test_known_noise),     cmocka_unit_test(test_intervals_hold),
        cmocka_unit_test(test_light_level_does_not_count), cmocka_unit_test(test_firefly_counts),
        cmocka_unit_test(test_unmet_light_warns), cmocka_unit_test(test_brightest_light),
        cmocka_unit_test(test_nothing_and_too_little),
        cmocka_unit_test(test_backdrop_does_not_count), cmocka_unit_test(test_worst_part),
        cmocka_unit_test(test_fireflies),
        cmocka_unit_test(test_few_samples_have_met_the_light),
        cmocka_unit_test(test_map),             cmocka_unit_test(test_errors_come_back),
        cmocka_unit_test(test_quantiles), cmocka_unit_test(test_quantiles_keep_their_bits), cmocka_unit_test(test_strips),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
