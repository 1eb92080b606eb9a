/* A tile's state: to the disk and back, damaged, under another cap. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/bytes.h"
#include "common/film/film.h"
#include "tests/support/film_data.h"

/* Copy every tile's state of one film into the other. */
static void copy_states(const struct film *from, struct film *to)
{
    struct error err = {0};

    for (uint32_t t = 0; t < film_tile_count(from); t++) {
        size_t size = film_tile_state_size(from, t);
        uint8_t *bytes = malloc(size);
        assert_non_null(bytes);
        assert_true(size <= film_tile_state_bound(from, t));
        film_tile_save(from, t, bytes);
        assert_int_equal(film_tile_length(bytes), size);
        if (film_tile_load(to, t, bytes, size, &err) != STATUS_OK)
            fail_msg("%s", err.text);
        free(bytes);
    }
}

static void state_goes_to_disk_and_back(void **state)
{
    enum { WIDTH = 24, HEIGHT = 20, SPP = 141 };
    const uint32_t aovs = 1u << AOV_POSITION | 1u << AOV_ALBEDO | 1u << AOV_CRYPTO_MATERIAL;
    struct film *whole = film_data_whole(WIDTH, HEIGHT, SPP, aovs);
    struct film *half = film_data_new(WIDTH, HEIGHT, SPP, aovs);
    struct film *resumed = film_data_new(WIDTH, HEIGHT, SPP, aovs);

    (void)state;
    for (uint32_t t = 0; t < film_tile_count(half); t++)
        for (uint32_t g = 0; g < GROUPS; g++)
            for (uint32_t p = 0; p < t * 3 + g && p < film_pass_count(half, g); p++)
                film_data_merge(half, t, g, p);
    copy_states(half, resumed);
    film_data_assert_same(half, resumed);
    /* What was folded in before the state was saved is still compared, and its deliverer known. */
    assert_int_equal(film_data_merge(resumed, 1, 1, 1), FILM_DUPLICATE);
    assert_int_equal(film_deliverer(resumed, 1, 1, 1), 101);
    for (uint32_t t = 0; t < film_tile_count(whole); t++)
        for (uint32_t g = 0; g < GROUPS; g++)
            for (uint32_t p = film_pass_count(whole, g); p-- > 0;)
                film_data_merge(resumed, t, g, p);
    film_data_assert_same(whole, resumed);
    film_free(whole);
    film_free(half);
    film_free(resumed);
}

/* Who rendered a tile, and for how long, is known after a restart; pictures do not depend on it. */
static void origins_go_to_disk_and_back(void **state)
{
    struct film *film = film_data_new(24, 20, 60, 0), *plain = film_data_new(24, 20, 60, 0);
    struct film *loaded = film_data_new(24, 20, 60, 0);
    struct film_origin o;
    float rgb[2][24 * 20 * 3];

    (void)state;
    assert_int_equal(film_tile_origin(film, 1).units, 0);
    film_note_cost(film, 1, 0, 0, 3, 1000); /* it is not there: no effect */
    for (uint32_t p = 0; p < 3; p++) {
        film_data_merge(film, 1, 0, p);
        film_note_cost(film, 1, 0, p, 7 + p, 1000000 * (p + 1));
    }
    film_data_merge(film, 1, 1, 1); /* waits for pass 0 */
    film_note_cost(film, 1, 1, 1, 4000, 5000000);
    assert_int_equal(film_tile_origin(film, 1).units, 3);
    assert_int_equal(film_tile_origin(film, 1).thread, 9);
    film_data_merge(film, 1, 1, 0);
    film_data_merge(film, 1, 1, 2);
    film_note_cost(film, 1, 1, 2, 4096, UINT64_MAX);
    copy_states(film, loaded);
    o = film_tile_origin(loaded, 1);
    assert_int_equal(o.units, 6);
    assert_int_equal(o.thread, 4096); /* of two last passes, group 1's is newer */
    assert_int_equal(o.deliverer, film_deliverer(film, 1, 1, 2));
    assert_true(o.cpu_ns > (1ull << 45) - (1ull << 32));
    film_note_cost(loaded, 1, 1, 2, 4096, 0);
    o = film_tile_origin(loaded, 1);
    assert_in_range(o.cpu_ns, 11000000 - 11000000 / 4096, 11000000);
    film_note_cost(loaded, 1, 1, 2, 100000, 0);
    assert_int_equal(film_tile_origin(loaded, 1).thread, 0);
    for (uint32_t p = 0; p < 3; p++)
        for (uint32_t g = 0; g < GROUPS; g++)
            film_data_merge(plain, 1, g, p);
    film_develop(film, rgb[0]);
    film_develop(plain, rgb[1]);
    assert_memory_equal(rgb[0], rgb[1], sizeof rgb[0]);
    film_free(film);
    film_free(plain);
    film_free(loaded);
}

/* The bytes without the counters that came after film format 7. Both groups of the one tile have one pass. */
static size_t as_format_7(uint8_t *out, const uint8_t *in, size_t size)
{
    enum { HEADER = 24, CHECK = 8, GROUP = 16, FIRST = WORK_COUNTERS_FIRST * 8, ALL = WORK_COUNTER_COUNT * 8 };
    size_t group = (size - HEADER - CHECK) / GROUPS, less = size - GROUPS * (ALL - FIRST), rest = group - GROUP - ALL;
    uint8_t *at = out;

    memcpy(at, in, HEADER);
    bytes_put32(out + 4, (uint32_t)less);
    at += HEADER;
    for (const uint8_t *from = in + HEADER; from < in + size - CHECK; from += group) {
        memcpy(at, from, GROUP + FIRST);
        bytes_put32(at + GROUP - 4, 0);
        memcpy(at + GROUP + FIRST, from + GROUP + ALL, rest);
        at += GROUP + FIRST + rest;
    }
    bytes_put64(at, hash_bytes(out, (size_t)(at - out)));
    assert_int_equal(at + CHECK - out, less);
    return less;
}

/* Films that are kept have the counters of their time, and the hashes of results are the same. */
static void films_of_before_are_read(void **state)
{
    static float sums[TILE_FLOATS_MAX];
    struct film *film = film_data_whole(16, 16, 2, 0), *back = film_data_new(16, 16, 2, 0);
    struct film *large = film_data_new(80, 40, 16, 0);
    struct unit_result unit = film_data_unit(large, 7, 1, 0, sums);
    size_t size = film_tile_state_size(film, 0);
    uint8_t *now = malloc(size), *before = malloc(size);
    struct unit_work work = film_work(film), had;
    struct error err = {0};

    (void)state;
    assert_true(now && before);
    assert_int_equal(unit_hash(&unit), 0x36cf722695d04c5e);
    film_tile_save(film, 0, now);
    size = as_format_7(before, now, size);
    assert_int_equal(size, 13216);
    assert_int_equal(bytes_get64(before + size - 8), 0x36f335af07698629); /* of that program's film */
    if (film_tile_load(back, 0, before, size, &err) != STATUS_OK)
        fail_msg("%s", err.text);
    had = film_work(back);
    for (int i = 0; i < WORK_COUNTER_COUNT; i++)
        assert_int_equal(had.count[i], i < WORK_COUNTERS_FIRST ? work.count[i] : 0);
    assert_true(had.kept_luminance == work.kept_luminance);
    free(now);
    free(before);
    film_free(film);
    film_free(back);
    film_free(large);
}

/* The bound does not depend on the cap, and the largest film keeps to it. */
static void the_bound_is_fixed(void **state)
{
    struct film *few = film_data_new(16, 16, 1, 0);
    struct film *most = film_data_whole(16, 16, SETTINGS_SPP_MAX - 1, 0);

    (void)state;
    assert_int_equal(film_tile_state_bound(few, 0), film_tile_state_bound(most, 0));
    assert_true(film_tile_state_size(most, 0) <= film_tile_state_bound(most, 0));
    assert_true(film_tile_state_size(few, 0) <= 64);
    film_free(few);
    film_free(most);
}

/* What a film had under a smaller cap goes on under a larger one, to the same bits; its short passes are
 * dropped. */
static void a_larger_cap_goes_on(void **state)
{
    static const uint32_t caps[][2] = {{1, 3}, {1, 100}, {5, 7}, {9, 60}, {16, 100}, {70, 71}};

    (void)state;
    for (size_t i = 0; i < sizeof caps / sizeof *caps; i++) {
        struct film *small = film_data_whole(20, 16, caps[i][0], 1u << AOV_NORMAL);
        struct film *large = film_data_whole(20, 16, caps[i][1], 1u << AOV_NORMAL);
        struct film *on = film_data_new(20, 16, caps[i][1], 1u << AOV_NORMAL);

        copy_states(small, on);
        for (uint32_t t = 0; t < film_tile_count(on); t++)
            for (uint32_t g = 0; g < GROUPS; g++) {
                uint32_t passes = film_pass_count(small, g);
                int cut = passes > 0 && pass_is_short(caps[i][0], g, passes - 1);
                int same = group_samples(caps[i][0], g) == group_samples(caps[i][1], g);
                assert_int_equal(film_tile_passes(on, t, g), passes - (uint32_t)(cut && !same));
                for (uint32_t p = film_tile_passes(on, t, g); p < film_pass_count(on, g); p++)
                    assert_int_equal(film_data_merge(on, t, g, p), FILM_MERGED);
            }
        film_data_assert_same(large, on);
        film_free(small);
        film_free(large);
        film_free(on);
    }
}

static void damaged_state_is_refused(void **state)
{
    struct film *film = film_data_whole(5, 3, 13, 0), *target = film_data_new(5, 3, 13, 0);
    struct film *fewer = film_data_new(5, 3, 4, 0), *two = film_data_new(21, 3, 13, 0);
    struct film *more = film_data_new(5, 3, 13, 1u << AOV_DEPTH);
    size_t size = film_tile_state_size(film, 0);
    uint8_t *bytes = malloc(size + 8);
    uint32_t passes[GROUPS];
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
    assert_int_equal(film_tile_load(target, 0, bytes, size + 8, &err), STATUS_ERR_CORRUPT);
    assert_int_equal(film_tile_load(target, 1, bytes, size, &err), STATUS_ERR_CORRUPT);
    assert_int_equal(film_tile_load(fewer, 0, bytes, size, &err), STATUS_ERR_CORRUPT);
    assert_int_equal(film_tile_load(two, 1, bytes, size, &err), STATUS_ERR_CORRUPT);
    assert_int_equal(film_tile_load(more, 0, bytes, size, &err), STATUS_ERR_CORRUPT);
    assert_int_equal(film_samples(target), 0);
    assert_int_equal(film_tile_peek(target, 0, bytes, size, passes, &err), STATUS_OK);
    assert_int_equal(passes[0], film_pass_count(film, 0));
    assert_int_equal(film_tile_load(target, 0, bytes, size, &err), STATUS_OK);
    film_data_assert_same(film, target);
    assert_int_equal(film_tile_load(target, 0, bytes, size, &err), STATUS_OK); /* again */
    film_data_assert_same(film, target);
    free(bytes);
    film_free(film);
    film_free(target);
    film_free(fewer);
    film_free(more);
    film_free(two);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(state_goes_to_disk_and_back),
        cmocka_unit_test(origins_go_to_disk_and_back),
        cmocka_unit_test(the_bound_is_fixed),
        cmocka_unit_test(a_larger_cap_goes_on),
        cmocka_unit_test(damaged_state_is_refused),
        cmocka_unit_test(films_of_before_are_read),
    };
    return cmocka_run_group_tests_name("film state", tests, NULL, NULL);
}
