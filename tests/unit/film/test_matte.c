/* Counts of things: what a tally keeps, how units add up, and the shares that a film gives. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <string.h>

#include "common/film/film.h"
#include "common/film/matte.h"
#include "tests/support/film_data.h"

enum { SPP = 8, GROUP_SPP = SPP / GROUPS };

static void tally(const uint32_t *numbers, uint32_t count, float out[MATTE_FLOATS])
{
    struct matte_tally tally = {.count = 0};
    double counts[MATTE_FLOATS];

    for (uint32_t i = 0; i < count; i++)
        matte_tally_add(&tally, numbers[i]);
    matte_tally_get(&tally, counts);
    for (int i = 0; i < MATTE_FLOATS; i++)
        out[i] = (float)counts[i];
    assert_true(matte_is_valid(out, count));
}

static void the_largest_counts_are_kept(void **state)
{
    static const uint32_t few[] = {7, 3, 7, 9, 3, 7}, tied[] = {8, 6, 4, 2, 9, 3, 1, 7, 7};
    static const float few_counts[MATTE_FLOATS] = {0, 7, 3, 3, 2, 9, 1};
    static const float tied_counts[MATTE_FLOATS] = {2, 7, 2, 1, 1, 2, 1, 3, 1, 4, 1, 6, 1}; /* 8 and 9 are lost */
    uint32_t many[MATTE_TALLY_MAX + 5];
    float got[MATTE_FLOATS];

    (void)state;
    tally(few, 6, got);
    assert_memory_equal(got, few_counts, sizeof got);
    tally(tied, 9, got);
    assert_memory_equal(got, tied_counts, sizeof got);
    for (uint32_t i = 0; i < MATTE_TALLY_MAX + 5; i++)
        many[i] = 1 + i;
    tally(many, MATTE_TALLY_MAX + 5, got);
    assert_true(got[0] == MATTE_TALLY_MAX + 5 - MATTE_SLOTS && got[1] == 1 && got[2 * MATTE_SLOTS - 1] == MATTE_SLOTS);
}

static void units_add_up(void **state)
{
    static const uint32_t first[] = {1, 2, 2, 3}, second[] = {4, 5, 5, 6, 7, 3, 3, 3};
    static const double sums[MATTE_FLOATS] = {1, 3, 4, 2, 2, 5, 2, 1, 1, 4, 1, 6, 1}; /* 7 is lost */
    double sum[MATTE_FLOATS] = {0};
    float unit[MATTE_FLOATS];

    (void)state;
    tally(first, 4, unit);
    matte_add(sum, unit);
    tally(second, 8, unit);
    matte_add(sum, unit);
    assert_memory_equal(sum, sums, sizeof sum);
}

static void impossible_counts_are_refused(void **state)
{
    static const float bad[][MATTE_FLOATS] = {
        {0, 1, 5},          {5},             {4, 1, 1},       {-1},           {0.5f},      {0, 1.5f, 1}, {0, 1, -1},
        {0, 0, 1},          {0, 1, 0},       {0, 1, 1, 2, 2}, {0, 2, 1, 1, 1}, {0, 1, 1, 1, 1},
        {0, 0, 0, 1, 1},    {0, 33554432, 1}, {0, 1, 1, 2, 0.5f},
    };
    static const float good[][MATTE_FLOATS] = {{0}, {4}, {0, 16777216, 4}, {1, 2, 2, 1, 1}, {0, 1, 2, 2, 2}};

    (void)state;
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        if (matte_is_valid(bad[i], 4))
            fail_msg("%zu is taken", i);
    for (size_t i = 0; i < sizeof good / sizeof *good; i++)
        if (!matte_is_valid(good[i], 4))
            fail_msg("%zu is refused", i);
}

/* A film's only pixel. */
static enum film_merge_result merge(struct film *film, uint32_t group, uint32_t pass, const uint32_t *numbers,
                                    uint32_t count, status wanted)
{
    float sums[PIXEL_FLOATS + MATTE_FLOATS] = {0};
    struct unit_result unit = {.group = group, .pass = pass, .sums = sums, .count = PIXEL_FLOATS + MATTE_FLOATS};
    enum film_merge_result result;

    tally(numbers, count, sums + PIXEL_FLOATS);
    assert_int_equal(film_merge(film, &unit, 1, &result, NULL), wanted);
    return result;
}

/* Both groups count alike, as in the picture; what met nothing is missing in the sum. */
static void shares_are_weighted_as_the_picture(void **state)
{
    static const uint32_t one[] = {5, 5}, two[] = {5, 4}, three[] = {9};
    struct film *film = film_data_new(1, 1, SPP, 1u << AOV_CRYPTO_MATERIAL);
    struct film_thing things[FILM_THINGS_MAX];

    (void)state;
    assert_int_equal(film_things(film, 0, AOV_CRYPTO_MATERIAL, 0, things), 0);
    merge(film, 0, 0, one, 2, STATUS_OK);
    assert_int_equal(film_things(film, 0, AOV_CRYPTO_MATERIAL, 0, things), 1);
    assert_true(things[0].number == 5 && things[0].share == 1);
    merge(film, 0, 1, three, 1, STATUS_OK); /* of 2: one met nothing */
    merge(film, 1, 0, two, 2, STATUS_OK);
    assert_int_equal(film_things(film, 0, AOV_CRYPTO_MATERIAL, 0, things), 3);
    assert_true(things[0].number == 4 && things[0].share == 0.25);
    assert_true(things[1].number == 5 && things[1].share == 0.5);
    assert_true(things[2].number == 9 && things[2].share == 0.125);
    assert_true(film_things_lost(film, AOV_CRYPTO_MATERIAL) == 0);
    merge(film, 1, 1, (const uint32_t[]){1, 2, 3}, 3, STATUS_ERR_INPUT); /* more than the pass has */
    film_free(film);
}

/* More things than slots, some in a short pass: every sample is in a list or lost, and the larger shares are listed. */
static void what_is_lost_is_told(void **state)
{
    enum { CAP = 24 };
    static const uint32_t passes[3][8] = {{1, 2}, {3, 4}, {8, 5, 6, 7}}, cut[4] = {10, 10, 9, 8};
    struct film *film = film_data_new(1, 1, CAP, 1u << AOV_CRYPTO_OBJECT);
    struct film_thing things[FILM_THINGS_MAX];
    double sum = 0;
    uint32_t count;

    (void)state;
    for (uint32_t p = 0; p < 3; p++)
        merge(film, 0, p, passes[p], p < 2 ? 2 : 4, STATUS_OK);
    merge(film, 0, 3, cut, 4, STATUS_OK); /* 12 samples: 2, 4, 8, 12 */
    count = film_things(film, 0, AOV_CRYPTO_OBJECT, 0, things);
    for (uint32_t i = 0; i < count; i++)
        sum += things[i].share * 12;
    assert_float_equal(sum + (double)film_things_lost(film, AOV_CRYPTO_OBJECT), 12, 1e-9);
    assert_true(film_things_lost(film, AOV_CRYPTO_OBJECT) == 2); /* 7 and 8 of the whole passes */
    assert_true(count == 9 && things[8].number == 10);
    film_free(film);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_largest_counts_are_kept),
        cmocka_unit_test(units_add_up),
        cmocka_unit_test(impossible_counts_are_refused),
        cmocka_unit_test(shares_are_weighted_as_the_picture),
        cmocka_unit_test(what_is_lost_is_told),
    };
    return cmocka_run_group_tests_name("matte", tests, NULL, NULL);
}
