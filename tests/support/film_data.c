#include "tests/support/film_data.h"

#include <setjmp.h>
#include <stdarg.h>

#include <cmocka.h>
#include <stdlib.h>
#include <string.h>

#include "common/film/matte.h"
#include "common/math/elementary.h"

float film_data_spread(uint32_t h)
{
    h ^= h >> 15;
    h *= 2246822519u;
    h ^= h >> 13;
    return (float)(h | 1u << 31) * float_from_bits((((h * 2654435761u) >> 26) + 67) << 23);
}

static float number_of(uint32_t tile, uint32_t group, uint32_t pass, size_t i)
{
    return film_data_spread((uint32_t)i * 2654435761u ^ tile * 40503u ^ (pass * GROUPS + group + 1) * 2246822519u);
}

/* A few samples of each pixel met things, of which there are more than a pixel keeps apart. */
static void put_mattes(const struct film *film, const struct unit_result *unit, uint32_t pixels, uint32_t samples,
                       float *sums)
{
    const uint32_t sent = unit_aovs(film_aovs(film), unit->group, unit->pass);

    for (int aov = 0; aov < AOV_COUNT; aov++)
        for (uint32_t p = 0; (sent & AOV_MATTES) >> aov & 1 && p < pixels; p++) {
            float *out = sums + tile_aov_offset(pixels, sent, (enum aov)aov) + (size_t)p * MATTE_FLOATS;
            struct matte_tally tally = {.count = 0};
            double counts[MATTE_FLOATS];
            for (uint32_t i = 0; i < samples && i < 16; i++)
                matte_tally_add(&tally, 1 + float_bits(number_of(unit->tile, unit->group, unit->pass, p * 16 + i)) / 64 % 11);
            matte_tally_get(&tally, counts);
            for (int i = 0; i < MATTE_FLOATS; i++)
                out[i] = (float)counts[i];
        }
}

struct unit_result film_data_unit(const struct film *film, uint32_t tile, uint32_t group, uint32_t pass, float *sums)
{
    struct tile_rect rect = tile_rect_of(film_width(film), film_height(film), tile);
    struct unit_result unit = {.tile = tile, .group = group, .pass = pass, .sums = sums};
    uint32_t pixels = rect.width * rect.height, begin, end;

    unit.count = tile_floats(film_width(film), film_height(film), tile, unit_aovs(film_aovs(film), group, pass));
    for (size_t i = 0; i < unit.count; i++)
        sums[i] = number_of(tile, group, pass, i);
    pass_range(film_spp(film), group, pass, &begin, &end);
    put_mattes(film, &unit, pixels, end - begin, sums);
    unit.work.samples = (uint64_t)pixels * (end - begin);
    unit.work.rays = unit.work.samples * 3 + pass;
    unit.work.vertices = unit.work.rays / 2;
    unit.work.subject_samples = unit.work.samples / (1 + tile % 3);
    unit.work.leaked_rays = tile;
    for (uint32_t i = WORK_COUNTERS_FIRST; i < WORK_COUNTER_COUNT; i++)
        unit.work.count[i] = 1 + tile + pass + i;
    for (uint32_t k = 0; k < HEALTH_KINDS; k++) { /* some tiles have none, some passes come first later */
        unit.work.health.count[k] = (tile + pass + k) % 3;
        if (unit.work.health.count[k])
            unit.work.health.first[k] =
                health_key((struct health_place){pass, tile, k % pixels, begin * GROUPS + group});
    }
    unit.work.clamped_samples = tile;
    unit.work.clamped_luminance = 1e-3 * (tile + 0.1 * pass); /* sums that depend on their order */
    unit.work.kept_luminance = 1e3 / (1 + tile + pass);
    for (uint32_t i = 0; i < DEPTH_SUMS; i++)
        unit.work.depth.sum[i] = 1e2 / (1 + i + tile + 0.1 * pass + 0.01 * group);
    for (uint32_t i = 0; i < 10; i++)
        tail_add(&unit.tail, 1 + (float)((tile * 7 + group * 5 + pass * 3 + i * 11) % 13), i % pixels);
    return unit;
}

enum film_merge_result film_data_give(struct film *film, const struct unit_result *unit)
{
    enum film_merge_result result;
    struct error err = {0};

    if (film_merge(film, unit, 100 + unit->pass, &result, &err) != STATUS_OK)
        fail_msg("%s", err.text);
    return result;
}

enum film_merge_result film_data_merge(struct film *film, uint32_t tile, uint32_t group, uint32_t pass)
{
    float sums[TILE_FLOATS_MAX];
    struct unit_result unit = film_data_unit(film, tile, group, pass, sums);

    return film_data_give(film, &unit);
}

struct film *film_data_new(uint32_t width, uint32_t height, uint32_t spp, uint32_t aovs)
{
    struct film *film = film_new_aovs(width, height, spp, aovs);

    assert_non_null(film);
    film_want_all(film);
    for (uint32_t g = 0; g < GROUPS; g++)
        film_freeze(film, g, &(struct film_codes){film_codes_plain, NULL});
    return film;
}

struct film *film_data_whole(uint32_t width, uint32_t height, uint32_t spp, uint32_t aovs)
{
    struct film *film = film_data_new(width, height, spp, aovs);

    for (uint32_t t = 0; t < film_tile_count(film); t++)
        for (uint32_t g = 0; g < GROUPS; g++)
            for (uint32_t p = 0; p < film_pass_count(film, g); p++)
                assert_int_equal(film_data_merge(film, t, g, p), FILM_MERGED);
    assert_true(film_complete(film));
    return film;
}

void film_data_assert_same(const struct film *a, const struct film *b)
{
    size_t count = (size_t)film_width(a) * film_height(a) * 3;
    float *one = malloc(count * sizeof *one), *two = malloc(count * sizeof *two);
    struct unit_work works[2];

    assert_non_null(one);
    assert_non_null(two);
    film_develop(a, one);
    film_develop(b, two);
    assert_memory_equal(one, two, count * sizeof *one);
    works[0] = film_work(a);
    works[1] = film_work(b);
    assert_memory_equal(&works[0], &works[1], sizeof works[0]);
    assert_int_equal(film_samples(a), film_samples(b));
    for (uint32_t t = 0; t < film_tile_count(a); t++) {
        size_t size = film_tile_state_size(a, t);
        uint8_t *first = malloc(size), *second = malloc(size);
        assert_true(size <= film_tile_state_bound(a, t));
        assert_int_equal(film_tile_state_size(b, t), size);
        film_tile_save(a, t, first);
        film_tile_save(b, t, second);
        assert_memory_equal(first, second, size);
        free(first);
        free(second);
    }
    free(one);
    free(two);
}
