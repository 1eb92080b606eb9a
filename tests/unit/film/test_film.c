/* The film: folding order, duplicates, conflicts, error estimate, state on disk. */
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

enum { ORDERS = 1000 };

static uint64_t random_state = 1;

static uint32_t random_below(uint32_t limit)
{
    random_state = random_state * 6364136223846793005ull + 1442695040888963407ull;
    return (uint32_t)((random_state >> 33) % limit);
}

static size_t floats_of(uint32_t width, uint32_t height, uint32_t tile)
{
    struct tile_rect rect = tile_rect_of(width, height, tile);

    return (size_t)REPLICATES * rect.width * rect.height * 3;
}

/* A result that is a pure function of its unit, with magnitudes far apart so that the order of
 * additions shows in the sums' last bits. */
static size_t make_sums(uint32_t width, uint32_t height, uint32_t tile, uint32_t pass, float *out)
{
    size_t count = floats_of(width, height, tile);

    for (size_t i = 0; i < count; i++) {
        uint32_t h = (uint32_t)i * 2654435761u ^ tile * 40503u ^ (pass + 1) * 2246822519u;
        h ^= h >> 15;
        h *= 2246822519u;
        h ^= h >> 13;
        out[i] = ldexpf((float)(h | 1u << 31), (int)((h * 2654435761u) >> 26) - 60);
    }
    return count;
}

static enum film_merge_result merge(struct film *film, uint32_t tile, uint32_t pass)
{
    float sums[TILE_FLOATS_MAX];
    enum film_merge_result result;
    struct error err = {0};
    size_t count = make_sums(film_width(film), film_height(film), tile, pass, sums);

    if (film_merge(film, tile, pass, sums, count, &result, &err) != STATUS_OK)
        fail_msg("%s", err.text);
    return result;
}

static struct film *film_in_order(uint32_t width, uint32_t height, uint32_t spp)
{
    struct film *film = film_new(width, height, spp);

    assert_non_null(film);
    for (uint32_t t = 0; t < film_tile_count(film); t++)
        for (uint32_t p = 0; p < film_pass_count(film); p++)
            assert_int_equal(merge(film, t, p), FILM_MERGED);
    assert_true(film_complete(film));
    return film;
}

static void assert_same_bits(const struct film *a, const struct film *b)
{
    size_t count = (size_t)film_width(a) * film_height(a) * 3;
    float *one = malloc(count * sizeof *one), *two = malloc(count * sizeof *two);
    double mse_a = film_relative_mse(a), mse_b = film_relative_mse(b);

    assert_non_null(one);
    assert_non_null(two);
    film_develop(a, one);
    film_develop(b, two);
    assert_memory_equal(one, two, count * sizeof *one);
    assert_memory_equal(&mse_a, &mse_b, sizeof mse_a);
    for (uint32_t t = 0; t < film_tile_count(a); t++) {
        size_t size = film_tile_state_size(a, t);
        uint8_t *first = malloc(size), *second = malloc(size);
        film_tile_save(a, t, first);
        film_tile_save(b, t, second);
        assert_memory_equal(first, second, size);
        free(first);
        free(second);
    }
    free(one);
    free(two);
}

static void shuffled_orders_give_the_same_bits(void **state)
{
    enum { WIDTH = 37, HEIGHT = 19, SPP = 100 }; /* edge tiles on two sides, 6 passes */
    struct film *reference = film_in_order(WIDTH, HEIGHT, SPP);
    uint32_t tiles = film_tile_count(reference), passes = film_pass_count(reference);
    uint32_t units = tiles * passes;
    uint32_t *order = malloc(units * sizeof *order);

    (void)state;
    assert_non_null(order);
    for (int round = 0; round < ORDERS; round++) {
        struct film *film = film_new(WIDTH, HEIGHT, SPP);
        uint32_t merged = 0;
        assert_non_null(film);
        for (uint32_t i = 0; i < units; i++)
            order[i] = i;
        for (uint32_t i = units; i-- > 1;) {
            uint32_t j = random_below(i + 1), swap = order[i];
            order[i] = order[j];
            order[j] = swap;
        }
        for (uint32_t i = 0; i < units; i++) {
            enum film_merge_result r = merge(film, order[i] / passes, order[i] % passes);
            assert_true(r == FILM_MERGED || r == FILM_WAITING);
            merged++;
            assert_true(film_has(film, order[i] / passes, order[i] % passes));
            /* Repeat an earlier one: it changes nothing. */
            uint32_t again = order[random_below(i + 1)];
            assert_int_equal(merge(film, again / passes, again % passes), FILM_DUPLICATE);
        }
        assert_int_equal(merged, units);
        assert_true(film_complete(film));
        assert_int_equal(film_samples(film), (uint64_t)WIDTH * HEIGHT * SPP);
        if (round % 50 == 0)
            assert_same_bits(reference, film);
        else { /* the developed picture of every order */
            static float one[WIDTH * HEIGHT * 3], two[WIDTH * HEIGHT * 3];
            film_develop(reference, one);
            film_develop(film, two);
            assert_memory_equal(one, two, sizeof one);
        }
        film_free(film);
    }
    free(order);
    film_free(reference);
}

/* The test above could not fail if the order of additions did not matter for this data. */
static void the_order_of_additions_matters_for_this_data(void **state)
{
    float pass[3][TILE_FLOATS_MAX];
    size_t count = 0, differ = 0;

    (void)state;
    for (uint32_t p = 0; p < 3; p++)
        count = make_sums(16, 16, 0, p, pass[p]);
    for (size_t i = 0; i < count; i++) {
        double forward = ((double)pass[0][i] + pass[1][i]) + pass[2][i];
        double backward = ((double)pass[2][i] + pass[1][i]) + pass[0][i];
        differ += forward != backward;
    }
    assert_true(differ > 0);
}

static void conflicts_are_told_and_change_nothing(void **state)
{
    struct film *film = film_new(16, 16, 28), *same = film_new(16, 16, 28);
    float sums[TILE_FLOATS_MAX];
    enum film_merge_result result;
    size_t count = make_sums(16, 16, 0, 0, sums);

    (void)state;
    assert_int_equal(merge(film, 0, 0), FILM_MERGED);
    assert_int_equal(merge(film, 0, 2), FILM_WAITING);
    assert_int_equal(merge(same, 0, 0), FILM_MERGED);
    assert_int_equal(merge(same, 0, 2), FILM_WAITING);

    sums[count - 1] = nextafterf(sums[count - 1], 0); /* one bit of one number, folded in */
    assert_int_equal(film_merge(film, 0, 0, sums, count, &result, NULL), STATUS_OK);
    assert_int_equal(result, FILM_CONFLICT);
    make_sums(16, 16, 0, 2, sums); /* and of one that waits */
    sums[0] = nextafterf(sums[0], 0);
    assert_int_equal(film_merge(film, 0, 2, sums, count, &result, NULL), STATUS_OK);
    assert_int_equal(result, FILM_CONFLICT);
    assert_int_equal(merge(film, 0, 1), FILM_MERGED);
    assert_int_equal(merge(same, 0, 1), FILM_MERGED);
    assert_int_equal(film_tile_passes(film, 0), 3);
    assert_same_bits(film, same);
    film_free(film);
    film_free(same);
}

static void bad_results_are_refused(void **state)
{
    struct film *film = film_new(20, 16, 8);
    float sums[TILE_FLOATS_MAX + 6] = {0};
    enum film_merge_result result;
    struct error err = {0};
    size_t full = floats_of(20, 16, 0), edge = floats_of(20, 16, 1);

    (void)state;
    assert_int_equal(edge, 2 * 4 * 16 * 3);
    assert_int_equal(film_merge(film, 2, 0, sums, full, &result, &err), STATUS_ERR_INPUT);
    assert_int_equal(film_merge(film, UINT32_MAX, 0, sums, full, &result, &err), STATUS_ERR_INPUT);
    assert_int_equal(film_merge(film, 0, 2, sums, full, &result, &err), STATUS_ERR_INPUT);
    assert_int_equal(film_merge(film, 0, UINT32_MAX, sums, full, &result, &err), STATUS_ERR_INPUT);
    assert_int_equal(film_merge(film, 0, 0, sums, full - 1, &result, &err), STATUS_ERR_INPUT);
    assert_int_equal(film_merge(film, 0, 0, sums, full + 1, &result, &err), STATUS_ERR_INPUT);
    assert_int_equal(film_merge(film, 0, 0, sums, 0, &result, &err), STATUS_ERR_INPUT);
    assert_int_equal(film_merge(film, 1, 0, sums, full, &result, &err), STATUS_ERR_INPUT);
    sums[7] = NAN;
    assert_int_equal(film_merge(film, 0, 0, sums, full, &result, &err), STATUS_ERR_INPUT);
    sums[7] = -INFINITY;
    assert_int_equal(film_merge(film, 0, 0, sums, full, &result, &err), STATUS_ERR_INPUT);
    assert_non_null(strstr(err.text, "number 7"));
    assert_int_equal(film_samples(film), 0);
    assert_false(film_has(film, 0, 0));
    film_free(film);
}

/* Two pixels of one tile, worked out by hand. */
static void means_and_error_follow_the_formula(void **state)
{
    /* spp 5: passes [0,4) and [4,5): replicate 0 has 3 samples, replicate 1 has 2. */
    struct film *film = film_new(2, 1, 5);
    /* [replicate][pixel][rgb] */
    const float first[12] = {2, 0, 4, 1, 1, 1, 4, 0, 2, 1, 1, 1};
    const float second[12] = {1, 0, 2, 0.5f, 0.5f, 0.5f, 0, 0, 0, 0, 0, 0};
    enum film_merge_result result;
    float rgb[6];
    double expected = 0;

    (void)state;
    assert_int_equal(film_pass_count(film), 2);
    assert_true(isnan(film_relative_mse(film)));
    film_develop(film, rgb);
    for (int i = 0; i < 6; i++)
        assert_true(rgb[i] == 0);
    assert_int_equal(film_merge(film, 0, 0, first, 12, &result, NULL), STATUS_OK);
    assert_true(film_covered(film));
    assert_false(film_complete(film));
    film_develop(film, rgb); /* before it is complete: the mean of what is there, 4 samples */
    assert_true(rgb[0] == 1.5f && rgb[1] == 0 && rgb[2] == 1.5f && rgb[3] == 0.5f);
    for (int i = 0; i < 6; i++) {
        double a = first[i] / 2.0, b = first[6 + i] / 2.0, mean = (a + b) / 2;
        expected += (a - b) * (a - b) / 4 / (mean * mean + 0.01);
    }
    assert_true(fabs(film_relative_mse(film) - expected / 6) < 1e-15);
    /* By hand: red and blue of pixel 0 are (0.5)^2 / (1.5^2 + 0.01), all else is 0. */
    assert_true(fabs(film_relative_mse(film) - 2 * 0.25 / 2.26 / 6) < 1e-15);

    assert_int_equal(film_merge(film, 0, 1, second, 12, &result, NULL), STATUS_OK);
    assert_true(film_complete(film));
    assert_int_equal(film_tile_samples(film, 0), 5);
    film_develop(film, rgb);
    assert_true(rgb[0] == 7.0f / 5 && rgb[2] == 8.0f / 5 && rgb[3] == 2.5f / 5);
    expected = 0;
    for (int i = 0; i < 6; i++) {
        double sum_a = (double)first[i] + second[i], sum_b = first[6 + i];
        double a = sum_a / 3, b = sum_b / 2, mean = (sum_a + sum_b) / 5;
        expected += (a - b) * (a - b) / 4 / (mean * mean + 0.01);
    }
    assert_true(fabs(film_relative_mse(film) - expected / 6) < 1e-15);
    film_free(film);
}

static void one_sample_has_no_error_estimate(void **state)
{
    struct film *film = film_in_order(17, 16, 1);

    (void)state;
    assert_int_equal(film_pass_count(film), 1);
    assert_true(isnan(film_relative_mse(film)));
    film_free(film);
    film = film_in_order(17, 16, 2);
    assert_true(isfinite(film_relative_mse(film)));
    film_free(film);
}

static void counts_follow_the_tiles(void **state)
{
    struct film *film = film_new(33, 17, 12);

    (void)state;
    assert_int_equal(film_tile_count(film), 6);
    assert_int_equal(film_pass_count(film), 3);
    assert_int_equal(film_samples_total(film), 33 * 17 * 12);
    for (uint32_t t = 0; t < 6; t++) {
        assert_false(film_covered(film));
        merge(film, t, 0);
    }
    assert_true(film_covered(film));
    assert_int_equal(film_samples(film), 33 * 17 * 4);
    merge(film, 5, 2);
    assert_int_equal(film_tile_passes(film, 5), 1);
    assert_int_equal(film_tile_waiting(film, 5), 1);
    merge(film, 5, 1);
    assert_int_equal(film_tile_passes(film, 5), 3);
    assert_int_equal(film_tile_waiting(film, 5), 0);
    assert_int_equal(film_samples(film), 33 * 17 * 4 + 1 * 1 * 8); /* the corner tile is 1x1 */
    film_free(film);
}

static void state_goes_to_disk_and_back(void **state)
{
    enum { WIDTH = 24, HEIGHT = 20, SPP = 140 };
    struct film *whole = film_in_order(WIDTH, HEIGHT, SPP);
    struct film *half = film_new(WIDTH, HEIGHT, SPP), *resumed = film_new(WIDTH, HEIGHT, SPP);
    uint32_t passes = film_pass_count(whole);
    struct error err = {0};

    (void)state;
    for (uint32_t t = 0; t < film_tile_count(half); t++) {
        size_t size = film_tile_state_size(half, t);
        uint8_t *bytes = malloc(size);
        uint32_t peeked;
        for (uint32_t p = 0; p < t + 1 && p < passes; p++)
            merge(half, t, p);
        film_tile_save(half, t, bytes);
        assert_int_equal(film_tile_peek(resumed, t, bytes, size, &peeked, &err), STATUS_OK);
        assert_int_equal(peeked, film_tile_passes(half, t));
        assert_int_equal(film_tile_load(resumed, t, bytes, size, &err), STATUS_OK);
        free(bytes);
    }
    assert_same_bits(half, resumed);
    assert_int_equal(film_samples(half), film_samples(resumed));
    /* What was folded in before the state was saved is still compared. */
    assert_int_equal(merge(resumed, 1, 1), FILM_DUPLICATE);
    for (uint32_t t = 0; t < film_tile_count(whole); t++)
        for (uint32_t p = passes; p-- > 0;)
            merge(resumed, t, p);
    assert_same_bits(whole, resumed);
    film_free(whole);
    film_free(half);
    film_free(resumed);
}

static void damaged_state_is_refused(void **state)
{
    struct film *film = film_in_order(5, 3, 12), *target = film_new(5, 3, 12);
    struct film *other = film_new(5, 3, 16), *two = film_new(21, 3, 12);
    size_t size = film_tile_state_size(film, 0);
    uint8_t *bytes = malloc(size);
    struct error err = {0};

    (void)state;
    film_tile_save(film, 0, bytes);
    for (size_t i = 0; i < size; i++) {
        bytes[i] ^= (uint8_t)(1 << i % 8);
        assert_int_equal(film_tile_load(target, 0, bytes, size, &err), STATUS_ERR_CORRUPT);
        bytes[i] ^= (uint8_t)(1 << i % 8);
    }
    for (size_t cut = 0; cut < size; cut += 7)
        assert_int_equal(film_tile_load(target, 0, bytes, cut, &err), STATUS_ERR_CORRUPT);
    assert_int_equal(film_tile_load(target, 1, bytes, size, &err), STATUS_ERR_CORRUPT);
    assert_int_equal(film_tile_load(other, 0, bytes, size, &err), STATUS_ERR_CORRUPT);
    assert_int_equal(film_tile_load(two, 1, bytes, size, &err), STATUS_ERR_CORRUPT);
    assert_int_equal(film_samples(target), 0);
    assert_int_equal(film_tile_load(target, 0, bytes, size, &err), STATUS_OK);
    assert_same_bits(film, target);
    free(bytes);
    film_free(film);
    film_free(target);
    film_free(other);
    film_free(two);
}

/* Fail every allocation in turn: each failure is told, and what succeeds later is right. */
static void memory_faults_lose_nothing(void **state)
{
    enum { WIDTH = 20, HEIGHT = 16, SPP = 60 };
    struct film *reference = film_in_order(WIDTH, HEIGHT, SPP);
    uint32_t passes = film_pass_count(reference);
    long successes = 0, failures;

    (void)state;
    do {
        struct film *film;
        mem_fault_arm(successes++, 1);
        film = film_new(WIDTH, HEIGHT, SPP);
        if (!film)
            film = film_new(WIDTH, HEIGHT, SPP);
        assert_non_null(film);
        for (uint32_t t = 0; t < film_tile_count(film); t++) {
            for (uint32_t i = 0; i < passes; i++) {
                uint32_t p = (i * 2 + 1) % passes; /* 5 passes: some come early */
                float sums[TILE_FLOATS_MAX];
                size_t count = make_sums(WIDTH, HEIGHT, t, p, sums);
                enum film_merge_result result;
                struct error err = {0};
                if (film_merge(film, t, p, sums, count, &result, &err) == STATUS_OK)
                    continue;
                assert_int_equal(err.code, STATUS_ERR_NO_MEMORY);
                assert_false(film_has(film, t, p));
                assert_int_equal(film_merge(film, t, p, sums, count, &result, &err), STATUS_OK);
            }
        }
        failures = mem_fault_count();
        mem_fault_arm(-1, 0);
        assert_true(film_complete(film));
        assert_same_bits(reference, film);
        film_free(film);
    } while (failures > 0);
    assert_true(successes > 5);
    film_free(reference);
}

/* ---- AOVs ----------------------------------------------------------------------------------- */

/* What a renderer sends for pixel `pixel` of a tile and AOV channel `k` (of all that are sent). */
static float aov_sent(enum aov aov, uint32_t tile, uint32_t pass, size_t pixel, uint32_t k)
{
    if (aov_is_point(aov))
        return pass ? 0 : (float)(1 + k) + 0.001f * (float)pixel - (float)tile;
    return (float)(pass + 1) * (float)(k + 1) + (float)pixel;
}

static size_t make_aovs(const struct film *film, uint32_t tile, uint32_t pass, float *out)
{
    struct tile_rect rect = tile_rect_of(film_width(film), film_height(film), tile);
    size_t pixels = (size_t)rect.width * rect.height;
    size_t count = make_sums(film_width(film), film_height(film), tile, pass, out);
    uint32_t k = 0;

    for (int aov = 0; aov < AOV_COUNT; aov++) {
        uint32_t channels = film_aovs(film) >> aov & 1 ? aov_channels((enum aov)aov) : 0;
        assert_true(!channels ||
                    count == tile_aov_offset((uint32_t)pixels, film_aovs(film), (enum aov)aov));
        for (size_t i = 0; i < pixels * channels; i++)
            out[count++] = aov_sent((enum aov)aov, tile, pass, i / channels,
                                    k + (uint32_t)(i % channels));
        k += channels;
    }
    assert_int_equal(count, tile_floats(film_width(film), film_height(film), tile, film_aovs(film)));
    return count;
}

static struct film *film_with_aovs(uint32_t width, uint32_t height, uint32_t spp, uint32_t aovs,
                                   int backwards)
{
    struct film *film = film_new_aovs(width, height, spp, aovs);
    uint32_t passes;

    assert_non_null(film);
    passes = film_pass_count(film);
    for (uint32_t t = 0; t < film_tile_count(film); t++)
        for (uint32_t i = 0; i < passes; i++) {
            uint32_t p = backwards ? passes - 1 - i : i;
            float sums[TILE_FLOATS_MAX];
            enum film_merge_result result;
            size_t count = make_aovs(film, t, p, sums);
            assert_int_equal(film_merge(film, t, p, sums, count, &result, NULL), STATUS_OK);
        }
    assert_true(film_complete(film));
    return film;
}

static void aovs_are_means_or_first_samples(void **state)
{
    enum { WIDTH = 37, HEIGHT = 19, SPP = 13 }; /* passes of 4, 4 and 5 samples */
    const uint32_t masks[] = {(1u << AOV_COUNT) - 1, 1u << AOV_UV | 1u << AOV_ALBEDO,
                              1u << AOV_NORMAL};

    (void)state;
    for (size_t m = 0; m < sizeof masks / sizeof *masks; m++) {
        struct film *film = film_with_aovs(WIDTH, HEIGHT, SPP, masks[m], 1);
        uint32_t k = 0;
        for (int aov = 0; aov < AOV_COUNT; aov++) {
            uint32_t channels = aov_channels((enum aov)aov);
            static float out[4 * WIDTH * HEIGHT];
            if (!(masks[m] >> aov & 1) || channels == 0)
                continue;
            assert_int_equal(film_aov_channels((enum aov)aov), channels);
            /* In runs of tile rows, as files are written. */
            for (uint32_t y = 0; y < HEIGHT; y += TILE_SIZE) {
                uint32_t height = HEIGHT - y < TILE_SIZE ? HEIGHT - y : TILE_SIZE;
                film_develop_aov(film, (enum aov)aov, y, height, out);
                for (uint32_t i = 0; i < channels * height * WIDTH; i++) {
                    uint32_t c = i / (height * WIDTH), row = i / WIDTH % height, x = i % WIDTH;
                    uint32_t tile = (y + row) / TILE_SIZE * tiles_across(WIDTH) + x / TILE_SIZE;
                    struct tile_rect rect = tile_rect_of(WIDTH, HEIGHT, tile);
                    size_t pixel = (size_t)(y + row - rect.y) * rect.width + (x - rect.x);
                    double sum = 0;
                    for (uint32_t p = 0; p < film_pass_count(film); p++)
                        sum += (double)aov_sent((enum aov)aov, tile, p, pixel, k + c);
                    if (!aov_is_point((enum aov)aov))
                        sum /= SPP;
                    assert_true(out[i] == (float)sum);
                }
            }
            k += channels;
        }
        film_free(film);
    }
}

static void samples_and_error_are_the_films(void **state)
{
    struct film *film = film_new_aovs(20, 2, 5, 1u << AOV_DEPTH); /* 2 tiles; passes of 4 and 1 */
    float sums[TILE_FLOATS_MAX] = {0}, samples[40], error[120];
    enum film_merge_result result;

    (void)state;
    /* Tile 0: the first replicate's sums are 8, the second's 2 (of 2 samples each). */
    for (size_t i = 0; i < 16 * 2 * 3; i++)
        sums[i] = 8, sums[16 * 2 * 3 + i] = 2;
    assert_int_equal(film_merge(film, 0, 0, sums, 32 * 7, &result, NULL), STATUS_OK);
    film_develop_aov(film, AOV_SAMPLES, 0, 2, samples);
    film_develop_aov(film, AOV_ERROR, 0, 2, error);
    for (size_t i = 0; i < 40; i++)
        for (size_t c = 0; c < 3; c++) {
            assert_true(samples[i] == (i % 20 < 16 ? 4 : 0));
            /* Means 4 and 1: |4 - 1| / 2. */
            assert_true(error[40 * c + i] == (i % 20 < 16 ? 1.5f : 0));
        }
    /* The fifth sample is the first replicate's. */
    for (size_t i = 0; i < 16 * 2 * 3; i++)
        sums[i] = 1, sums[16 * 2 * 3 + i] = 0;
    assert_int_equal(film_merge(film, 0, 1, sums, 32 * 7, &result, NULL), STATUS_OK);
    film_develop_aov(film, AOV_ERROR, 0, 2, error);
    assert_true(error[0] == 1 && error[119] == 0);
    film_free(film);
    film = film_new(2, 1, 1); /* one sample tells no error */
    for (size_t i = 0; i < 6; i++)
        sums[i] = 7, sums[6 + i] = 0;
    assert_int_equal(film_merge(film, 0, 0, sums, 12, &result, NULL), STATUS_OK);
    film_develop_aov(film, AOV_ERROR, 0, 1, error);
    assert_true(error[0] == 0);
    film_free(film);
}

/* The radiance does not depend on what else is asked for; the state of a tile with AOVs comes
 * back, and is refused by a film that has others. */
static void aovs_are_kept_and_change_nothing_else(void **state)
{
    enum { WIDTH = 21, HEIGHT = 17, SPP = 28 };
    const uint32_t mask = 1u << AOV_POSITION | 1u << AOV_ALBEDO | 1u << AOV_ERROR;
    struct film *film = film_with_aovs(WIDTH, HEIGHT, SPP, mask, 0);
    struct film *shuffled = film_with_aovs(WIDTH, HEIGHT, SPP, mask, 1);
    struct film *plain = film_in_order(WIDTH, HEIGHT, SPP);
    struct film *back = film_new_aovs(WIDTH, HEIGHT, SPP, mask);
    struct film *other = film_new_aovs(WIDTH, HEIGHT, SPP, 1u << AOV_POSITION | 1u << AOV_NORMAL);
    static float one[3 * WIDTH * HEIGHT], two[3 * WIDTH * HEIGHT];
    float sums[TILE_FLOATS_MAX] = {0};
    enum film_merge_result result;
    struct error err = {0};

    (void)state;
    assert_same_bits(film, shuffled);
    film_develop(film, one);
    film_develop(plain, two);
    assert_memory_equal(one, two, sizeof one);
    assert_true(film_relative_mse(film) == film_relative_mse(plain));
    for (uint32_t t = 0; t < film_tile_count(film); t++) {
        size_t size = film_tile_state_size(film, t);
        uint8_t *bytes = malloc(size);
        assert_non_null(bytes);
        film_tile_save(film, t, bytes);
        assert_int_equal(film_tile_load(back, t, bytes, size, &err), STATUS_OK);
        /* The same size, other variables. */
        assert_int_equal(film_tile_state_size(other, t), size);
        assert_int_equal(film_tile_load(other, t, bytes, size, &err), STATUS_ERR_CORRUPT);
        assert_int_equal(film_tile_load(plain, t, bytes, size, &err), STATUS_ERR_CORRUPT);
        free(bytes);
    }
    assert_same_bits(film, back);
    film_develop_aov(film, AOV_POSITION, 0, HEIGHT, one);
    film_develop_aov(back, AOV_POSITION, 0, HEIGHT, two);
    assert_memory_equal(one, two, sizeof one);
    /* A result without the variables that are asked for is refused. */
    assert_int_equal(film_merge(other, 0, 0, sums, 256 * 6, &result, &err), STATUS_ERR_INPUT);
    film_free(film);
    film_free(shuffled);
    film_free(plain);
    film_free(back);
    film_free(other);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(shuffled_orders_give_the_same_bits),
        cmocka_unit_test(the_order_of_additions_matters_for_this_data),
        cmocka_unit_test(conflicts_are_told_and_change_nothing),
        cmocka_unit_test(bad_results_are_refused),
        cmocka_unit_test(means_and_error_follow_the_formula),
        cmocka_unit_test(one_sample_has_no_error_estimate),
        cmocka_unit_test(counts_follow_the_tiles),
        cmocka_unit_test(state_goes_to_disk_and_back),
        cmocka_unit_test(damaged_state_is_refused),
        cmocka_unit_test(memory_faults_lose_nothing),
        cmocka_unit_test(aovs_are_means_or_first_samples),
        cmocka_unit_test(samples_and_error_are_the_films),
        cmocka_unit_test(aovs_are_kept_and_change_nothing_else),
    };
    return cmocka_run_group_tests_name("film", tests, NULL, NULL);
}
