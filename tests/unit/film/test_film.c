/* The film: folding order, what is wanted, duplicates, conflicts, means by hand. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/film/film.h"
#include "tests/support/film_data.h"

enum { ORDERS = 500 };

static uint64_t random_state = 1;

static uint32_t random_below(uint32_t limit)
{
    random_state = random_state * 6364136223846793005ull + 1442695040888963407ull;
    return (uint32_t)((random_state >> 33) % limit);
}

/* Every unit that the cap allows: made once, since that takes longer than to merge it. */
struct units {
    struct unit_result made[1000];
    const struct unit_result *order[1000];
    float *sums;
    uint32_t count;
};

static void units_make(struct units *u, const struct film *film)
{
    u->sums = malloc(sizeof u->made / sizeof *u->made * TILE_FLOATS_MAX * sizeof(float));
    assert_non_null(u->sums);
    u->count = 0;
    for (uint32_t t = 0; t < film_tile_count(film); t++)
        for (uint32_t g = 0; g < GROUPS; g++)
            for (uint32_t p = 0; p < film_pass_count(film, g); p++) {
                u->made[u->count] = film_data_unit(film, t, g, p, u->sums + u->count * TILE_FLOATS_MAX);
                u->order[u->count] = &u->made[u->count];
                u->count++;
            }
}

static void shuffle(struct units *u)
{
    for (uint32_t i = u->count; i-- > 1;) {
        uint32_t j = random_below(i + 1);
        const struct unit_result *swap = u->order[i];
        u->order[i] = u->order[j];
        u->order[j] = swap;
    }
}

static void shuffled_orders_give_the_same_bits(void **state)
{
    enum { WIDTH = 37, HEIGHT = 19, SPP = 101 }; /* edge tiles on two sides; both groups end short */
    const uint32_t aovs = 1u << AOV_DEPTH | 1u << AOV_CRYPTO_OBJECT | 1u << AOV_NORMAL;
    struct film *reference = film_data_whole(WIDTH, HEIGHT, SPP, aovs);
    static struct units units;

    (void)state;
    units_make(&units, reference);
    for (int round = 0; round < ORDERS; round++) {
        struct film *film = film_new_aovs(WIDTH, HEIGHT, SPP, aovs);
        uint32_t at[GROUPS + 1];
        assert_non_null(film);
        shuffle(&units);
        /* What is wanted, and what is known of the display, may come at any time as well. */
        for (uint32_t i = 0; i <= GROUPS; i++)
            at[i] = random_below(units.count + 1);
        for (uint32_t i = 0; i <= units.count; i++) {
            const struct unit_result *unit, *earlier = units.order[i < units.count ? random_below(i + 1) : 0];
            enum film_merge_result r;
            if (at[GROUPS] == i)
                film_want_all(film);
            for (uint32_t g = 0; g < GROUPS; g++)
                if (at[g] == i)
                    film_freeze(film, g, &(struct film_codes){film_codes_plain, NULL});
            if (i == units.count)
                break;
            unit = units.order[i];
            r = film_data_give(film, unit);
            assert_true(r == FILM_MERGED || r == FILM_WAITING);
            assert_true(film_has(film, unit->tile, unit->group, unit->pass));
            /* Repeat an earlier one: it changes nothing. */
            assert_int_equal(film_data_give(film, earlier), FILM_DUPLICATE);
            assert_int_equal(film_deliverer(film, earlier->tile, earlier->group, earlier->pass), 100 + earlier->pass);
        }
        assert_true(film_complete(film));
        assert_int_equal(film_samples(film), (uint64_t)WIDTH * HEIGHT * SPP);
        film_data_assert_same(reference, film);
        film_free(film);
    }
    film_free(reference);
    free(units.sums);
}

/* The test above could not fail if the order of additions did not matter for this data. */
static void the_order_of_additions_matters_for_this_data(void **state)
{
    struct film *film = film_data_new(16, 16, 64, 0);
    float pass[3][TILE_FLOATS_MAX];
    size_t count = 0, differ = 0;

    (void)state;
    for (uint32_t p = 0; p < 3; p++)
        count = film_data_unit(film, 0, 0, p, pass[p]).count;
    for (size_t i = 0; i < count; i++) {
        double forward = ((double)pass[0][i] + pass[1][i]) + pass[2][i];
        double backward = ((double)pass[2][i] + pass[1][i]) + pass[0][i];
        differ += forward != backward;
    }
    assert_true(differ > 0);
    film_free(film);
}

/* The example is the least of all folded units, and no longer one of a tile that went back. */
static void examples_are_the_least_of_what_is_folded(void **state)
{
    enum { WIDTH = 37, HEIGHT = 19, SPP = 20 };
    struct film *film = film_data_whole(WIDTH, HEIGHT, SPP, 0);
    struct film *empty = film_data_new(WIDTH, HEIGHT, SPP, 0);
    float sums[TILE_FLOATS_MAX];

    (void)state;
    for (uint32_t gone = 0; gone < film_tile_count(film); gone++) {
        size_t size = film_tile_state_size(empty, gone);
        uint8_t *bytes = malloc(size);
        struct health want = {{0}, {0}, {0}};
        struct unit_work work;
        film_tile_save(empty, gone, bytes);
        assert_int_equal(film_tile_load(film, gone, bytes, size, NULL), STATUS_OK);
        free(bytes);
        for (uint32_t t = gone + 1; t < film_tile_count(film); t++)
            for (uint32_t g = 0; g < GROUPS; g++)
                for (uint32_t p = 0; p < film_pass_count(film, g); p++) {
                    struct unit_result unit = film_data_unit(film, t, g, p, sums);
                    for (int k = 0; k < HEALTH_KINDS; k++) {
                        uint64_t first = unit.work.health.first[k];
                        want.count[k] += unit.work.health.count[k];
                        if (first && (!want.first[k] || first < want.first[k]))
                            want.first[k] = first;
                    }
                }
        work = film_work(film);
        assert_memory_equal(&work.health, &want, sizeof want);
    }
    film_free(film);
    film_free(empty);
}

static enum film_merge_result merge_changed(struct film *film, uint32_t pass,
                                            void (*change)(struct unit_result *, float *))
{
    float sums[TILE_FLOATS_MAX];
    struct unit_result unit = film_data_unit(film, 0, 1, pass, sums);
    enum film_merge_result result;

    change(&unit, sums);
    assert_int_equal(film_merge(film, &unit, 7, &result, NULL), STATUS_OK);
    return result;
}

static void change_sum(struct unit_result *unit, float *sums)
{
    sums[unit->count - 1] = nextafterf(sums[unit->count - 1], 0);
}

static void change_rays(struct unit_result *unit, float *sums)
{
    (void)sums;
    unit->work.rays++;
}

static void change_health(struct unit_result *unit, float *sums)
{
    (void)sums;
    unit->work.dropped_samples++;
}

static void change_example(struct unit_result *unit, float *sums)
{
    (void)sums;
    unit->work.health.first[HEALTH_BAD_BASES]++; /* a later sample's */
}

static void change_depth(struct unit_result *unit, float *sums)
{
    (void)sums;
    unit->work.depth.sum[DEPTH_ENDED] = nextafter(unit->work.depth.sum[DEPTH_ENDED], 0);
}

static void change_tail(struct unit_result *unit, float *sums)
{
    (void)sums;
    unit->tail.entries[0].value = nextafterf(unit->tail.entries[0].value, 1e9f);
}

static void change_tail_length(struct unit_result *unit, float *sums)
{
    (void)sums;
    unit->tail.count--;
}

static void conflicts_are_told_and_change_nothing(void **state)
{
    void (*const changes[])(struct unit_result *, float *) = {
        change_sum, change_rays, change_health, change_example, change_depth, change_tail, change_tail_length};
    struct film *film = film_data_new(16, 16, 56, 0), *same = film_data_new(16, 16, 56, 0);

    (void)state;
    for (int i = 0; i < 2; i++) {
        assert_int_equal(film_data_merge(i ? same : film, 0, 1, 0), FILM_MERGED);
        assert_int_equal(film_data_merge(i ? same : film, 0, 1, 2), FILM_WAITING);
    }
    for (size_t i = 0; i < sizeof changes / sizeof *changes; i++) {
        assert_int_equal(merge_changed(film, 0, changes[i]), FILM_CONFLICT); /* folded */
        assert_int_equal(merge_changed(film, 2, changes[i]), FILM_CONFLICT); /* waiting */
    }
    assert_int_equal(film_deliverer(film, 0, 1, 0), 100);
    assert_int_equal(film_deliverer(film, 0, 1, 2), 102);
    assert_int_equal(film_deliverer(film, 0, 1, 1), 0);
    assert_int_equal(film_data_merge(film, 0, 1, 1), FILM_MERGED);
    assert_int_equal(film_data_merge(same, 0, 1, 1), FILM_MERGED);
    assert_int_equal(film_tile_passes(film, 0, 1), 3);
    film_data_assert_same(film, same);
    film_free(film);
    film_free(same);
}

static void bad_results_are_refused(void **state)
{
    struct film *film = film_data_new(20, 16, 8, 0);
    float sums[TILE_FLOATS_MAX + 6];
    struct unit_result good = film_data_unit(film, 1, 0, 0, sums), bad;
    enum film_merge_result result;
    struct error err = {0};

    (void)state;
    assert_int_equal(good.count, 4 * 16 * 3);
#define REFUSED(change)                                                                   \
    do {                                                                                  \
        bad = good;                                                                       \
        change;                                                                           \
        assert_int_equal(film_merge(film, &bad, 1, &result, &err), STATUS_ERR_INPUT);     \
    } while (0)
    REFUSED(bad.tile = 2);
    REFUSED(bad.tile = UINT32_MAX);
    REFUSED(bad.tile = 0); /* which is larger */
    REFUSED(bad.group = GROUPS);
    REFUSED(bad.group = UINT32_MAX);
    REFUSED(bad.pass = 2);
    REFUSED(bad.pass = UINT32_MAX);
    REFUSED(bad.count--);
    REFUSED(bad.count++);
    REFUSED(bad.count = 0);
    REFUSED(bad.tail.count = TAIL_MAX + 1);
    REFUSED(bad.tail.entries[0].pixel = 4 * 16);
    REFUSED(bad.tail.entries[0].spare = 1);
    REFUSED(bad.tail.entries[1].value = bad.tail.entries[0].value + 1);
    REFUSED(bad.tail.entries[bad.tail.count - 1].value = 0);
    sums[7] = NAN;
    REFUSED((void)0);
    sums[7] = -INFINITY;
    REFUSED((void)0);
#undef REFUSED
    assert_non_null(strstr(err.text, "number 7"));
    assert_int_equal(film_samples(film), 0);
    assert_false(film_has(film, 1, 0, 0));
    film_free(film);
}

static void merge_values(struct film *film, uint32_t group, uint32_t pass, const float *sums, size_t count)
{
    struct unit_result unit = {.group = group, .pass = pass, .sums = sums, .count = count};
    enum film_merge_result result;

    assert_int_equal(film_merge(film, &unit, 1, &result, NULL), STATUS_OK);
    assert_int_equal(result, FILM_MERGED);
}

/* Two pixels of one tile, worked out by hand. */
static void means_and_errors_follow_the_formula(void **state)
{
    /* spp 7: group 0 has 4 samples, in passes [0,2) and [2,4), group 1 has 3, in [0,2) and [2,3). */
    struct film *film = film_data_new(2, 1, 7, 0);
    /* [pixel][rgb] */
    const float a0[6] = {6, 0, 6, 2, 2, 2}, a1[6] = {0, 0, 4, 1, 0, 0};
    const float b0[6] = {3, 0, 0, 0.75f, 0, 0}, b1[6] = {3, 0, 0, 1, 0, 0};
    float rgb[6], one[6], error[6], samples[2];

    (void)state;
    assert_false(film_has_groups(film));
    film_develop(film, rgb);
    for (int i = 0; i < 6; i++)
        assert_true(rgb[i] == 0);
    merge_values(film, 0, 0, a0, 6);
    assert_true(film_covered(film));
    assert_false(film_complete(film));
    film_develop(film, rgb); /* one group: its mean */
    assert_true(rgb[0] == 3 && rgb[1] == 0 && rgb[2] == 3 && rgb[3] == 1);
    film_develop_aov(film, AOV_ERROR, 0, 1, error); /* one group: not known */
    assert_true(error[0] == 0 && error[1] == 0);
    assert_false(film_has_groups(film));
    merge_values(film, 0, 1, a1, 6);
    assert_false(film_has_groups(film));
    merge_values(film, 1, 0, b0, 6);
    assert_true(film_has_groups(film));
    film_develop(film, rgb); /* (6 / 4 + 3 / 2) / 2: whatever the counts are */
    assert_true(rgb[0] == 1.5f && rgb[2] == 10.f / 4 / 2 && rgb[3] == (3.f / 4 + 0.75f / 2) / 2);
    merge_values(film, 1, 1, b1, 6);
    assert_true(film_complete(film));
    assert_int_equal(film_tile_samples(film, 0), 7);
    film_develop(film, rgb);
    assert_true(rgb[0] == (6.f / 4 + 6.f / 3) / 2);
    film_develop_group(film, 1, one);
    assert_true(one[0] == 2 && one[3] == (float)(1.75 / 3));
    film_develop_aov(film, AOV_SAMPLES, 0, 1, samples);
    assert_true(samples[0] == 7 && samples[1] == 7);
    film_develop_aov(film, AOV_ERROR, 0, 1, error); /* |6 / 4 - 6 / 3| / 2 */
    assert_true(error[0] == 0.25f);
    film_free(film);
}

/* Any lines of a group are those of its whole picture. */
static void lines_are_those_of_the_picture(void **state)
{
    enum { WIDTH = 37, HEIGHT = 50, LINE = WIDTH * 3 };
    struct film *film = film_data_whole(WIDTH, HEIGHT, 4, 0);
    static float whole[HEIGHT * LINE], lines[HEIGHT * LINE];

    (void)state;
    for (uint32_t g = 0; g < GROUPS; g++)
        for (uint32_t y = 0; y < HEIGHT; y++)
            for (uint32_t height = 1; height <= HEIGHT - y; height += 7) {
                film_develop_group(film, g, whole);
                memset(lines, 0xff, sizeof lines);
                film_group_rows(film, g, y, height, lines);
                assert_memory_equal(lines, whole + (size_t)y * LINE, (size_t)height * LINE * sizeof *lines);
                assert_true(isnan(lines[(HEIGHT - y > height ? height : 0) * LINE]) || HEIGHT - y == height);
            }
    film_free(film);
}

static void one_sample_has_one_group(void **state)
{
    struct film *film = film_data_whole(17, 16, 1, 0);

    (void)state;
    assert_int_equal(film_pass_count(film, 0), 1);
    assert_int_equal(film_pass_count(film, 1), 0);
    assert_false(film_has_groups(film));
    film_free(film);
    film = film_data_whole(17, 16, 2, 0);
    assert_true(film_has_groups(film));
    film_free(film);
}

static void counts_follow_the_tiles(void **state)
{
    struct film *film = film_data_new(33, 17, 16, 0); /* 3 passes of either group */
    uint64_t rays = 0;

    (void)state;
    assert_int_equal(film_tile_count(film), 6);
    assert_int_equal(film_wanted(film), 6 * 2 * 3);
    assert_int_equal(film_samples_total(film), 33 * 17 * 16);
    for (uint32_t t = 0; t < 6; t++) {
        assert_false(film_covered(film));
        film_data_merge(film, t, t % 2, 0);
    }
    assert_true(film_covered(film));
    assert_int_equal(film_samples(film), 33 * 17 * 2);
    film_data_merge(film, 5, 1, 2);
    assert_int_equal(film_tile_passes(film, 5, 1), 1);
    assert_int_equal(film_tile_waiting(film, 5), 1);
    film_data_merge(film, 5, 1, 1);
    assert_int_equal(film_tile_passes(film, 5, 1), 3);
    assert_int_equal(film_tile_waiting(film, 5), 0);
    assert_int_equal(film_samples(film), 33 * 17 * 2 + 1 * 1 * 6); /* the corner tile is 1x1 */
    assert_int_equal(film_tile_rays(film, 5, 1), 2 * 3 + 2 * 3 + 1 + 4 * 3 + 2);
    assert_int_equal(film_tile_rays(film, 5, 0), 0);
    for (uint32_t t = 0; t < 6; t++)
        rays += film_tile_rays(film, t, 0) + film_tile_rays(film, t, 1);
    assert_int_equal(film_rays(film), rays);
    film_free(film);
}

/* Nothing beyond level 0 is folded before the group is frozen, nor anything beyond what is wanted. */
static void folding_waits_to_be_wanted(void **state)
{
    struct film *film = film_new(32, 16, 100);

    (void)state;
    assert_int_equal(film_wanted(film), 2 * GROUPS);
    for (uint32_t p = 0; p < 4; p++) {
        assert_int_equal(film_data_merge(film, 0, 0, p), p ? FILM_WAITING : FILM_MERGED);
        assert_int_equal(film_data_merge(film, 0, 0, p), FILM_DUPLICATE);
    }
    film_want(film, 0, 0, 3);
    assert_int_equal(film_tile_passes(film, 0, 0), 1);
    assert_false(film_wants_freeze(film, 0));
    film_data_merge(film, 1, 0, 0);
    assert_true(film_wants_freeze(film, 0));
    assert_false(film_wants_freeze(film, 1));
    film_freeze(film, 1, NULL);
    assert_int_equal(film_tile_passes(film, 0, 0), 1); /* that was the other group */
    film_freeze(film, 0, NULL);
    assert_false(film_wants_freeze(film, 0));
    assert_int_equal(film_tile_passes(film, 0, 0), 3);
    assert_int_equal(film_tile_wanted(film, 0, 0), 3);
    film_want(film, 0, 0, 2); /* never less */
    assert_int_equal(film_tile_wanted(film, 0, 0), 3);
    film_want(film, 0, 0, 1000);
    assert_int_equal(film_tile_wanted(film, 0, 0), film_pass_count(film, 0));
    assert_int_equal(film_tile_passes(film, 0, 0), 4);
    assert_false(film_complete(film));
    film_free(film);
    film = film_new(16, 16, 4); /* level 0 alone: nothing waits for it */
    film_data_merge(film, 0, 0, 0);
    assert_false(film_wants_freeze(film, 0));
    film_data_merge(film, 0, 1, 0);
    assert_true(film_complete(film));
    film_free(film);
}

/* A group that has ended keeps its picture, and tells the levels that it would have had. */
static void a_group_that_has_ended_is_watched(void **state)
{
    struct film *film = film_new(32, 16, 200), *whole = film_data_whole(32, 16, 200, 0);
    struct film *only = film_new(32, 16, 200);
    struct film_level a, b;
    uint32_t passes[2] = {3, 5};

    (void)state;
    for (uint32_t g = 0; g < GROUPS; g++) {
        film_freeze(film, g, &(struct film_codes){film_codes_plain, NULL});
        film_freeze(only, g, &(struct film_codes){film_codes_plain, NULL});
    }
    for (uint32_t t = 0; t < 2; t++) {
        film_want(film, t, 0, passes[t]);
        film_want(only, t, 0, passes[t]);
        for (uint32_t p = 0; p < 6; p++) /* one came early */
            film_data_merge(film, t, 0, p);
        for (uint32_t p = 0; p < passes[t]; p++)
            film_data_merge(only, t, 0, p);
    }
    film_end_group(film, 0);
    for (uint32_t t = 0; t < 2; t++)
        film_want(film, t, 0, level_passes(5));
    for (uint32_t p = 6; p < level_passes(5); p++)
        for (uint32_t t = 0; t < 2; t++) {
            assert_false(film_level_is_complete(film, 0, 5));
            assert_int_equal(film_data_merge(film, t, 0, p), FILM_MERGED);
            assert_int_equal(film_data_merge(film, t, 0, p), FILM_DUPLICATE);
        }
    for (uint32_t k = 0; k <= 5; k++) {
        assert_true(film_level_is_complete(film, 0, k));
        for (uint32_t t = 0; t < 2; t++) {
            assert_true(film_level(film, t, 0, k, &a) && film_level(whole, t, 0, k, &b));
            assert_memory_equal(&a, &b, sizeof a);
        }
    }
    for (uint32_t t = 0; t < 2; t++) {
        assert_int_equal(film_tile_passes(film, t, 0), passes[t]);
        assert_int_equal(film_tile_seen(film, t, 0), level_passes(5));
    }
    film_data_assert_same(film, only); /* the picture, and what is kept of it */
    film_free(film);
    film_free(whole);
    film_free(only);
}

static void the_largest_contributions_are_kept(void **state)
{
    struct film *film = film_data_whole(16, 16, 37, 0); /* with short passes */
    struct tail all = {.count = 0}, got;
    uint32_t passes = film_pass_count(film, 1);
    float sums[TILE_FLOATS_MAX];

    (void)state;
    for (uint32_t p = passes; p-- > 0;) { /* the other way round */
        struct unit_result unit = film_data_unit(film, 0, 1, p, sums);
        tail_merge(&all, &unit.tail);
    }
    film_tail(film, 0, 1, &got);
    assert_int_equal(got.count, TAIL_MAX);
    assert_true(tail_is_valid(&got, 256));
    assert_memory_equal(got.entries, all.entries, sizeof got.entries);
    film_free(film);
}

/* Fail every allocation in turn: each failure is reported, and what succeeds later is right. */
static void memory_faults_lose_nothing(void **state)
{
    enum { WIDTH = 20, HEIGHT = 16, SPP = 40 };
    struct film *reference = film_data_whole(WIDTH, HEIGHT, SPP, 0);
    long successes = 0, failures;

    (void)state;
    do {
        struct film *film;
        mem_fault_arm(successes++, 1);
        film = film_new(WIDTH, HEIGHT, SPP);
        if (!film)
            film = film_new(WIDTH, HEIGHT, SPP);
        assert_non_null(film);
        film_want_all(film);
        for (uint32_t i = 0; i < film_tile_count(film) * GROUPS; i++) {
            uint32_t t = i / GROUPS, g = i % GROUPS, passes = film_pass_count(film, g);
            for (uint32_t k = 0; k < passes; k++) { /* 5 passes: some come early */
                float sums[TILE_FLOATS_MAX];
                struct unit_result unit = film_data_unit(film, t, g, (k * 2 + 1) % passes, sums);
                enum film_merge_result result;
                struct error err = {0};
                if (film_merge(film, &unit, 100 + unit.pass, &result, &err) == STATUS_OK)
                    continue;
                assert_int_equal(err.code, STATUS_ERR_NO_MEMORY);
                assert_false(film_has(film, t, g, unit.pass));
                assert_int_equal(film_merge(film, &unit, 100 + unit.pass, &result, &err), STATUS_OK);
            }
        }
        for (uint32_t g = 0; g < GROUPS; g++) /* which cannot fail */
            film_freeze(film, g, &(struct film_codes){film_codes_plain, NULL});
        failures = mem_fault_count();
        mem_fault_arm(-1, 0);
        assert_true(film_complete(film));
        film_data_assert_same(reference, film);
        film_free(film);
    } while (failures > 0);
    assert_true(successes > 5);
    film_free(reference);
}

/* ---- AOVs ----------------------------------------------------------------------------------- */

static void aovs_are_means_or_first_samples(void **state)
{
    enum { WIDTH = 37, HEIGHT = 19, SPP = 13 };
    const uint32_t masks[] = {(1u << AOV_COUNT) - 1, 1u << AOV_UV | 1u << AOV_ALBEDO,
                              1u << AOV_NORMAL};

    (void)state;
    for (size_t m = 0; m < sizeof masks / sizeof *masks; m++) {
        struct film *film = film_data_whole(WIDTH, HEIGHT, SPP, masks[m]);
        for (int aov = 0; aov < AOV_COUNT; aov++) {
            uint32_t channels = aov_channels((enum aov)aov);
            static float out[4 * WIDTH * HEIGHT];
            if (!(masks[m] >> aov & 1) || channels == 0 || AOV_MATTES >> aov & 1)
                continue;
            /* In runs of tile rows, as files are written. */
            for (uint32_t y = 0; y < HEIGHT; y += TILE_SIZE) {
                uint32_t height = HEIGHT - y < TILE_SIZE ? HEIGHT - y : TILE_SIZE;
                film_develop_aov(film, (enum aov)aov, y, height, out);
                for (uint32_t i = 0; i < channels * height * WIDTH; i++) {
                    uint32_t c = i / (height * WIDTH), row = i / WIDTH % height, x = i % WIDTH;
                    uint32_t tile = (y + row) / TILE_SIZE * tiles_across(WIDTH) + x / TILE_SIZE;
                    struct tile_rect rect = tile_rect_of(WIDTH, HEIGHT, tile);
                    size_t pixel = (size_t)(y + row - rect.y) * rect.width + (x - rect.x);
                    double value = 0;
                    for (uint32_t g = 0; g < GROUPS; g++) {
                        double sum = 0, cut = 0;
                        for (uint32_t p = 0; p < film_pass_count(film, g); p++) {
                            uint32_t sent = unit_aovs(masks[m], g, p);
                            static float sums[TILE_FLOATS_MAX];
                            size_t at =
                                tile_aov_offset(rect.width * rect.height, sent, (enum aov)aov) + pixel * channels + c;
                            if (!(sent >> aov & 1))
                                continue;
                            if (x % 7 || row % 5)
                                continue; /* some of them: this is slow */
                            film_data_unit(film, tile, g, p, sums);
                            *(pass_is_short(SPP, g, p) ? &cut : &sum) += (double)sums[at];
                        }
                        value += aov_is_point((enum aov)aov) ? sum + cut : (sum + cut) / group_samples(SPP, g) * 0.5;
                    }
                    if (!(x % 7) && !(row % 5))
                        assert_true(out[i] == (float)value);
                }
            }
        }
        film_free(film);
    }
}

/* The radiance does not depend on what else is asked for. */
static void aovs_change_nothing_else(void **state)
{
    enum { WIDTH = 21, HEIGHT = 17, SPP = 28 };
    const uint32_t mask = 1u << AOV_POSITION | 1u << AOV_ALBEDO | 1u << AOV_ERROR;
    struct film *film = film_data_whole(WIDTH, HEIGHT, SPP, mask);
    struct film *plain = film_data_whole(WIDTH, HEIGHT, SPP, 0);
    struct film *other = film_data_new(WIDTH, HEIGHT, SPP, 1u << AOV_POSITION | 1u << AOV_NORMAL);
    static float one[3 * WIDTH * HEIGHT], two[3 * WIDTH * HEIGHT];
    float sums[TILE_FLOATS_MAX];
    struct unit_result unit = film_data_unit(plain, 0, 0, 0, sums);
    enum film_merge_result result;

    (void)state;
    film_develop(film, one);
    film_develop(plain, two);
    assert_memory_equal(one, two, sizeof one);
    /* A result without the variables that are asked for is refused. */
    assert_int_equal(film_merge(other, &unit, 1, &result, NULL), STATUS_ERR_INPUT);
    film_free(film);
    film_free(plain);
    film_free(other);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(shuffled_orders_give_the_same_bits),
        cmocka_unit_test(the_order_of_additions_matters_for_this_data),
        cmocka_unit_test(examples_are_the_least_of_what_is_folded),
        cmocka_unit_test(conflicts_are_told_and_change_nothing),
        cmocka_unit_test(bad_results_are_refused),
        cmocka_unit_test(means_and_errors_follow_the_formula),
        cmocka_unit_test(lines_are_those_of_the_picture), cmocka_unit_test(one_sample_has_one_group),
        cmocka_unit_test(counts_follow_the_tiles),
        cmocka_unit_test(folding_waits_to_be_wanted),
        cmocka_unit_test(the_largest_contributions_are_kept),
        cmocka_unit_test(a_group_that_has_ended_is_watched),
        cmocka_unit_test(memory_faults_lose_nothing),
        cmocka_unit_test(aovs_are_means_or_first_samples),
        cmocka_unit_test(aovs_change_nothing_else),
    };
    return cmocka_run_group_tests_name("film", tests, NULL, NULL);
}
