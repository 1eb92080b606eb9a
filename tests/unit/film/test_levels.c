/* Statistics of levels: by hand, kept for ever, and the same from whatever passes they were made. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "common/film/film.h"
#include "tests/support/film_data.h"

/* Codes that are the radiance itself. */
static void identity(void *user, const float *rgb, uint32_t count, float *codes)
{
    (void)user;
    memcpy(codes, rgb, (size_t)count * 3 * sizeof *codes);
}

static const struct film_codes plain = {identity, NULL};

/* From the sums of both halves. */
static void measure(struct film_level *level, const double *first, const double *second, uint32_t width,
                    uint32_t height, uint32_t samples, const struct film_codes *codes)
{
    double sums[9 * 3];
    float later[9 * 3];

    for (uint32_t i = 0; i < width * height * 3; i++) {
        sums[i] = first[i] + second[i];
        later[i] = (float)second[i];
    }
    film_level_measure(level, sums, later, width, height, samples, codes);
}

static void statistics_follow_the_formula(void **state)
{
    /* Two pixels, 4 samples: the halves' means are half of the sums. */
    const double first[6] = {8, 2, 4, 1, 1, 1}, second[6] = {4, 4, 4, 1, 1, 1 + 1.0 / 32};
    struct film_level level = {.rays = 9};

    (void)state;
    measure(&level, first, second, 2, 1, 4, &plain);
    assert_int_equal(level.rays, 9);
    assert_true(level.linear == (4 + 1 + 0 + 1.0 / 64 / 64) / 4);
    /* All channels of both pixels, of the mean: their sums over 4 samples. */
    assert_true(fabs(level.radiance - (8 + 2 + 4 + 4 + 4 + 4 + 6 + 1.0 / 32) / 4) < 1e-9);
    assert_true(level.has_codes);
    /* Pixel 0: |4 - 2| / 2 = 1 code; pixel 1: 1/128, below the first bin. */
    assert_true(level.display == 1 + 1.0f / 128 / 128);
    assert_int_equal(level.bins[10], 1);
    assert_int_equal(level.bins[0], 1);
    measure(&level, first, second, 2, 1, 4, &(struct film_codes){NULL, NULL});
    assert_false(level.has_codes);
    assert_true(level.linear > 1 && level.display == 0 && level.bins[10] == 0);
    film_level_measure(&level, first, NULL, 2, 1, 4, &plain); /* no halves: no errors */
    assert_true(!level.has_codes && level.linear == 0 && level.display == 0 && level.radiance == 17.0 / 4);
}

/* Half-octave bins: each holds its lower edge and not its upper one. */
static void bins_are_half_octaves(void **state)
{
    (void)state;
    for (int bin = 0; bin < LEVEL_BINS; bin++) {
        double edge = exp2(bin / 2.0 - 5);
        double sums[6] = {0, 0, 0, 2 * edge * 1.0001, 0, 0};
        struct film_level level = {0};
        measure(&level, sums, sums + 3, 1, 1, 2, &plain);
        assert_int_equal(level.bins[bin], 1);
        sums[3] = 2 * edge * 0.9999;
        measure(&level, sums, sums + 3, 1, 1, 2, &plain);
        assert_int_equal(level.bins[bin ? bin - 1 : 0], 1);
    }
    for (int i = 0; i < 2; i++) {
        const double sums[6] = {0, 0, 0, i ? 1e9 : 0, 0, 0};
        struct film_level level = {0};
        measure(&level, sums, sums + 3, 1, 1, 2, &plain);
        assert_int_equal(level.bins[i ? LEVEL_BINS - 1 : 0], 1);
    }
}

static void square_roots(void *user, const float *rgb, uint32_t count, float *codes)
{
    (void)user;
    for (uint32_t i = 0; i < count * 3; i++)
        codes[i] = sqrtf(rgb[i]);
}

/* Where codes bend, both sides of the mean count: sqrt(16) - sqrt(8), and sqrt(8). */
static void bent_codes_count_on_both_sides(void **state)
{
    const double sums[6] = {16, 16, 16, 0, 0, 0}, root = sqrt(8);
    struct film_level level = {0};

    (void)state;
    measure(&level, sums, sums + 3, 1, 1, 2, &(struct film_codes){square_roots, NULL});
    assert_true(fabs((double)level.channels - 3 * ((4 - root) * (4 - root) + 8) / 2) < 1e-4);
}

/* Codes of the mean with half of the difference added and taken away; a pixel shares its error with its neighbours. */
static void spreads_are_shared(void **state)
{
    double sums[2][9 * 3] = {{0}};
    struct film_level level = {0};
    uint32_t all = 0;

    (void)state;
    for (int i = 0; i < 27; i++)
        sums[0][i] = 12; /* 12 - 6 and 6 - 0 codes: 6 of each */
    measure(&level, sums[0], sums[1], 3, 3, 2, &plain);
    assert_true(level.channels == 27 * 36);
    /* 6 lies between 2^2.5 = 5.66 and 2^2.75 = 6.73 codes. */
    assert_true(level_spread(30) < 6 && level_spread(31) > 6);
    assert_int_equal(level.spreads[30], 9 * 11);
    assert_int_equal(level.spreads[31], 9 * 5);
    memset(sums, 0, sizeof sums);
    sums[0][4 * 3] = 12; /* the middle pixel alone: seen among 4 pixels, 6 and 9 */
    measure(&level, sums[0], sums[1], 3, 3, 2, &plain);
    for (int i = 0; i < LEVEL_SPREADS; i++)
        all += level.spreads[i];
    assert_int_equal(all, 9 * LEVEL_SPREAD_ONE);
    assert_int_equal(level.spreads[24], LEVEL_SPREAD_ONE); /* 36 / 9: 2 codes, exactly */
    assert_int_equal(level.spreads[25] + level.spreads[26] + level.spreads[27], 8 * LEVEL_SPREAD_ONE);
}

static double next_random(uint64_t *seed)
{
    *seed ^= *seed << 13;
    *seed ^= *seed >> 7;
    *seed ^= *seed << 17;
    return (double)(*seed >> 11) * 0x1p-53;
}

/* Statistics decide which samples a picture gets, so their bits are part of the contract. These are of a plain
 * loop with branches, over tiles of all sizes, dark, bright, noisy, with black and with extreme pixels. */
static void bits_are_those_of_the_release(void **state)
{
    static double sums[TILE_PIXELS_MAX * 3];
    static float second[TILE_PIXELS_MAX * 3];
    uint64_t seed = 88172645463325252u, hash = 0;

    (void)state;
    for (uint32_t t = 0; t < 256; t++) {
        double light = ldexp(1, (int)(next_random(&seed) * 16) - 10), noise = ldexp(1, (int)(next_random(&seed) * 5) - 4);
        struct film_level level = {.rays = t};
        for (int i = 0; i < TILE_PIXELS_MAX * 3; i++) {
            double a = light * (1 + noise * next_random(&seed)), b = light * (1 + noise * next_random(&seed));
            double odd = next_random(&seed);
            second[i] = (float)(t % 7 == 0 && odd < 0.3 ? 0 : t % 11 == 0 && odd < 0.02 ? b * 1e30 : b);
            sums[i] = (t % 13 == 0 ? b : a) + (double)second[i];
        }
        film_level_measure(&level, sums, second, 1 + t % TILE_SIZE, 1 + t / TILE_SIZE, 16,
                           &(struct film_codes){film_codes_plain, NULL});
        /* The subject's samples came after the release. */
        uint8_t bytes[sizeof level - sizeof level.subject];
        memcpy(bytes, &level.rays, sizeof level.rays);
        memcpy(bytes + sizeof level.rays, &level.radiance, sizeof bytes - sizeof level.rays);
        hash = hash * 31 + hash_bytes(bytes, sizeof bytes);
    }
    assert_int_equal(hash, 0x280443de9a6c8aa5);
}

static struct film_level level_of(const struct film *film, uint32_t tile, uint32_t group, uint32_t k)
{
    struct film_level out;

    assert_true(film_level(film, tile, group, k, &out));
    return out;
}

static void a_film_keeps_every_level(void **state)
{
    struct film *film = film_data_whole(20, 16, 2 * 33, 0), *late = film_new(20, 16, 2 * 33);
    struct film_level level;

    (void)state;
    assert_false(film_level(film, 0, 0, 5, &level)); /* 33 samples: level 4 is 32 */
    for (uint32_t k = 0; k < 5; k++) {
        struct film *only = film_data_whole(20, 16, 2 * level_samples(k), 0);
        struct film_level a = level_of(film, 1, 1, k), b = level_of(only, 1, 1, k);
        assert_memory_equal(&a, &b, sizeof a);
        assert_true(k == 0 ? !a.has_codes && a.linear == 0 : a.has_codes && a.linear > 0);
        assert_int_equal(a.rays, film_tile_rays(only, 1, 1));
        film_free(only);
    }
    /* The display becomes known when all the rest waits. */
    film_want_all(late);
    for (uint32_t p = 0; p < film_pass_count(late, 0); p++)
        for (uint32_t t = 0; t < 2; t++)
            film_data_merge(late, t, 0, p);
    assert_false(film_level(late, 1, 0, 1, &level));
    film_freeze(late, 0, &(struct film_codes){film_codes_plain, NULL});
    for (uint32_t k = 0; k < 5; k++) {
        struct film_level a = level_of(film, 1, 0, k), b = level_of(late, 1, 0, k);
        assert_memory_equal(&a, &b, sizeof a);
    }
    film_free(film);
    film_free(late);
}

/* What a level says is V(k-1) - V(k), all of which is V(k) where samples are independent. Where the last doubling
 * left a share of 0.3, the next is taken to leave 0.4; no ratio of noisy sums makes it less than a third. */
static void halves_are_corrected(void **state)
{
    (void)state;
    assert_true(fabs(level_correction(0.3, 1) - 0.4 / 0.6) < 1e-12);
    assert_true(level_correction(1, 2) == 1);
    assert_true(level_correction(1, 1.5) == 1);
    assert_true(level_correction(1, 0) == 1);
    assert_true(fabs(level_correction(0, 1) - 1 / 3.0) < 1e-12);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(statistics_follow_the_formula),
        cmocka_unit_test(bins_are_half_octaves), cmocka_unit_test(bent_codes_count_on_both_sides), cmocka_unit_test(spreads_are_shared),
        cmocka_unit_test(bits_are_those_of_the_release),
        cmocka_unit_test(a_film_keeps_every_level), cmocka_unit_test(halves_are_corrected),
    };
    return cmocka_run_group_tests_name("levels", tests, NULL, NULL);
}
