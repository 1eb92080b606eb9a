/* Statistics of levels: by hand, kept for ever, and completed when the display is known. */
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

static void statistics_follow_the_formula(void **state)
{
    /* Two pixels, 4 samples: the replicates' means are half of the sums. */
    const double sums[12] = {8, 2, 4, 1, 1, 1, 4, 4, 4, 1, 1, 1 + 1.0 / 32};
    struct film_level level = {.rays = 9};

    (void)state;
    film_level_measure(&level, sums, 2, 1, 4, &plain);
    assert_int_equal(level.rays, 9);
    assert_true(level.linear == (4 + 1 + 0 + 1.0 / 64 / 64) / 4);
    /* All channels of both pixels, of the mean of the replicates: their sums over 4 samples. */
    assert_true(fabs(level.radiance - (8 + 2 + 4 + 4 + 4 + 4 + 6 + 1.0 / 32) / 4) < 1e-9);
    assert_true(level.has_codes);
    /* Pixel 0: |4 - 2| / 2 = 1 code; pixel 1: 1/128, below the first bin. */
    assert_true(level.display == 1 + 1.0f / 128 / 128);
    assert_int_equal(level.bins[10], 1);
    assert_int_equal(level.bins[0], 1);
    film_level_measure(&level, sums, 2, 1, 4, &(struct film_codes){NULL, NULL});
    assert_false(level.has_codes);
    assert_true(level.linear > 1 && level.display == 0 && level.bins[10] == 0);
}

/* Half-octave bins: each holds its lower edge and not its upper one. */
static void bins_are_half_octaves(void **state)
{
    (void)state;
    for (int bin = 0; bin < LEVEL_BINS; bin++) {
        double edge = exp2(bin / 2.0 - 5);
        double sums[6] = {0, 0, 0, 2 * edge * 1.0001, 0, 0};
        struct film_level level = {0};
        film_level_measure(&level, sums, 1, 1, 2, &plain);
        assert_int_equal(level.bins[bin], 1);
        sums[3] = 2 * edge * 0.9999;
        film_level_measure(&level, sums, 1, 1, 2, &plain);
        assert_int_equal(level.bins[bin ? bin - 1 : 0], 1);
    }
    for (int i = 0; i < 2; i++) {
        const double sums[6] = {0, 0, 0, i ? 1e9 : 0, 0, 0};
        struct film_level level = {0};
        film_level_measure(&level, sums, 1, 1, 2, &plain);
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
    film_level_measure(&level, sums, 1, 1, 2, &(struct film_codes){square_roots, NULL});
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
    film_level_measure(&level, sums[0], 3, 3, 2, &plain);
    assert_true(level.channels == 27 * 36);
    /* 6 lies between 2^2.5 = 5.66 and 2^2.75 = 6.73 codes. */
    assert_true(level_spread(30) < 6 && level_spread(31) > 6);
    assert_int_equal(level.spreads[30], 9 * 11);
    assert_int_equal(level.spreads[31], 9 * 5);
    memset(sums, 0, sizeof sums);
    sums[0][4 * 3] = 12; /* the middle pixel alone: seen among 4 pixels, 6 and 9 */
    film_level_measure(&level, sums[0], 3, 3, 2, &plain);
    for (int i = 0; i < LEVEL_SPREADS; i++)
        all += level.spreads[i];
    assert_int_equal(all, 9 * LEVEL_SPREAD_ONE);
    assert_int_equal(level.spreads[24], LEVEL_SPREAD_ONE); /* 36 / 9: 2 codes, exactly */
    assert_int_equal(level.spreads[25] + level.spreads[26] + level.spreads[27], 8 * LEVEL_SPREAD_ONE);
}

static struct film_level level_of(const struct film *film, uint32_t tile, uint32_t group,
                                  uint32_t k)
{
    struct film_level out;

    assert_true(film_level(film, tile, group, k, &out));
    return out;
}

static void a_film_keeps_every_level(void **state)
{
    struct film *film = film_data_whole(20, 16, 2 * 33, 0), *late = film_new(20, 16, 2 * 33);
    struct film_level level;
    double before;

    (void)state;
    assert_false(film_level(film, 0, 0, 5, &level)); /* 33 samples: level 4 is 32 */
    for (uint32_t k = 0; k < 5; k++) {
        struct film *only = film_data_whole(20, 16, 2 * level_samples(k), 0);
        struct film_level a = level_of(film, 1, 1, k), b = level_of(only, 1, 1, k);
        assert_memory_equal(&a, &b, sizeof a);
        assert_true(a.has_codes && a.linear > 0);
        assert_int_equal(a.rays, film_tile_rays(only, 1, 1));
        film_free(only);
    }
    /* The display becomes known later than level 0. */
    film_want_all(late);
    for (uint32_t p = 0; p < film_pass_count(late, 0); p++)
        for (uint32_t t = 0; t < 2; t++)
            film_data_merge(late, t, 0, p);
    level = level_of(late, 1, 0, 0);
    assert_false(level.has_codes);
    before = level.linear;
    film_freeze(late, 0, &(struct film_codes){film_codes_plain, NULL});
    level = level_of(late, 1, 0, 0);
    assert_true(level.linear == before);
    for (uint32_t k = 0; k < 5; k++) {
        struct film_level a = level_of(film, 1, 0, k), b = level_of(late, 1, 0, k);
        assert_memory_equal(&a, &b, sizeof a);
    }
    film_free(film);
    film_free(late);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(statistics_follow_the_formula),
        cmocka_unit_test(bins_are_half_octaves), cmocka_unit_test(bent_codes_count_on_both_sides), cmocka_unit_test(spreads_are_shared),
        cmocka_unit_test(a_film_keeps_every_level),
    };
    return cmocka_run_group_tests_name("levels", tests, NULL, NULL);
}
