/* Counters of what went wrong: places as numbers, examples in any order, sentences. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <string.h>

#include "common/film/health.h"
#include "common/film/tiles.h"

static uint64_t random_state = 7;

static uint32_t random_below(uint32_t limit)
{
    random_state = random_state * 6364136223846793005ull + 1442695040888963407ull;
    return (uint32_t)((random_state >> 33) % limit);
}

static int compare(struct health_place a, struct health_place b)
{
    const uint32_t x[] = {a.pass, a.tile, a.pixel, a.sample}, y[] = {b.pass, b.tile, b.pixel, b.sample};

    for (int i = 0; i < 4; i++)
        if (x[i] != y[i])
            return x[i] < y[i] ? -1 : 1;
    return 0;
}

/* Parts are often 0 or the largest, so that each decides now and then. */
static uint32_t part(uint32_t limit)
{
    switch (random_below(4)) {
    case 0: return 0;
    case 1: return limit - 1;
    default: return random_below(limit);
    }
}

static struct health_place any_place(void)
{
    struct health_place p = {part(PASSES_MAX), part(1u << HEALTH_TILE_BITS), part(TILE_PIXELS_MAX),
                             part(SETTINGS_SPP_MAX)};
    return p;
}

static void keys_are_in_the_order_of_their_places(void **state)
{
    struct health_place back;

    (void)state;
    for (int i = 0; i < 100000; i++) {
        struct health_place a = any_place(), b = any_place();
        uint64_t x = health_key(a), y = health_key(b);
        assert_true(x != 0);
        assert_int_equal(x < y ? -1 : x > y, compare(a, b));
        assert_true(health_place_of(x, &back) && compare(a, back) == 0);
    }
    assert_false(health_place_of(0, &back));
    assert_false(health_place_of(UINT64_MAX, &back));
    assert_false(health_place_of(health_key((struct health_place){.pass = PASSES_MAX}), &back));
    /* The largest frame there can be: one pixel more than whole tiles along both sides. */
    for (uint32_t side = 1; side <= 65536; side *= 2) {
        uint32_t other =
            SETTINGS_PIXELS_MAX / side < SETTINGS_SIZE_MAX ? SETTINGS_PIXELS_MAX / side : SETTINGS_SIZE_MAX;
        assert_true(tile_count(side, other) <= 1u << HEALTH_TILE_BITS);
    }
}

/* Random counters in random orders: sums, and by kind the least (frame, place). */
static void sums_are_the_same_in_any_order(void **state)
{
    enum { PARTS = 12 };
    struct health parts[PARTS], one, sum;

    (void)state;
    for (int round = 0; round < 2000; round++) {
        memset(&one, 0, sizeof one);
        memset(parts, 0, sizeof parts);
        for (int i = 0; i < PARTS; i++)
            for (int k = 0; k < HEALTH_KINDS; k++) {
                parts[i].count[k] = random_below(3);
                if (parts[i].count[k] && random_below(5)) { /* older stores know no example */
                    parts[i].first[k] = health_key(any_place());
                    parts[i].frame[k] = random_below(3);
                }
                one.count[k] += parts[i].count[k];
                if (parts[i].first[k] &&
                    (!one.first[k] || parts[i].frame[k] < one.frame[k] ||
                     (parts[i].frame[k] == one.frame[k] && parts[i].first[k] < one.first[k]))) {
                    one.first[k] = parts[i].first[k];
                    one.frame[k] = parts[i].frame[k];
                }
            }
        for (int order = 0; order < 5; order++) {
            for (uint32_t i = PARTS; i-- > 1;) {
                uint32_t j = random_below(i + 1);
                struct health swap = parts[i];
                parts[i] = parts[j];
                parts[j] = swap;
            }
            memset(&sum, 0, sizeof sum);
            for (int i = 0; i < PARTS; i++)
                health_add(&sum, &parts[i]);
            assert_memory_equal(&sum, &one, sizeof one);
        }
        assert_true(health_is_ill(&sum));
        for (int i = 0; i < PARTS; i++)
            health_subtract(&sum, &parts[i]);
        assert_false(health_is_ill(&sum));
    }
}

static void rows_have_names_of_their_own(void **state)
{
    (void)state;
    for (int k = 0; k < HEALTH_KINDS; k++) {
        const struct health_row *row = &health_rows[k];
        struct health one = {{0}, {0}, {0}};
        char text[HEALTH_TEXT_SIZE];
        for (int i = 0; i < k; i++)
            assert_true(strcmp(row->name, health_rows[i].name) != 0 &&
                        strcmp(row->attribute, health_rows[i].attribute) != 0);
        assert_true(strncmp(row->attribute, "azulejo:", 8) == 0);
        /* The longest text has room. */
        one.count[k] = UINT64_MAX;
        one.frame[k] = UINT32_MAX;
        one.first[k] = health_key((struct health_place){PASSES_MAX - 1, 1048575, 255, 1048575});
        health_text(text, &one, (enum health_kind)k, (struct tile_rect){0, 0, 65536, 4096}, 1);
        assert_true(strlen(text) < HEALTH_TEXT_SIZE - 1);
        assert_non_null(strstr(text, "sample 1048575"));
    }
}

static void sentences_name_the_first_example(void **state)
{
    struct health h = {{0}, {0}, {0}};
    char text[HEALTH_TEXT_SIZE];

    (void)state;
    /* 37x19 has three tiles a row; the last is 5 wide. */
    h.count[HEALTH_DROPPED_SAMPLES] = 3;
    h.first[HEALTH_DROPPED_SAMPLES] = health_key((struct health_place){0, 2, 11, 5});
    h.frame[HEALTH_DROPPED_SAMPLES] = 9;
    assert_string_equal(health_text(text, &h, HEALTH_DROPPED_SAMPLES, (struct tile_rect){0, 0, 37, 19}, 0),
                        "3 samples were not finite and count as black; first: pass 0, tile 2, "
                        "pixel 33,2, sample 5");
    assert_string_equal(health_text(text, &h, HEALTH_DROPPED_SAMPLES, (struct tile_rect){0, 0, 37, 19}, 1),
                        "3 samples were not finite and count as black; first: frame 9, pass 0, "
                        "tile 2, pixel 33,2, sample 5");
    h.count[HEALTH_DROPPED_SAMPLES] = 1;
    h.first[HEALTH_DROPPED_SAMPLES] = 0;
    assert_string_equal(health_text(text, &h, HEALTH_DROPPED_SAMPLES, (struct tile_rect){0, 0, 37, 19}, 1),
                        "1 sample was not finite and counts as black");
    /* Of a region, the pixel of the whole picture; the last tile of both ways. */
    assert_string_equal(health_first_text(text, health_key((struct health_place){1, 5, 9, 7}), (struct tile_rect){100, 40, 37, 19}),
                        "pass 1, tile 5, pixel 136,57, sample 7");
    /* A tile that the picture has not. */
    assert_string_equal(health_first_text(text, health_key((struct health_place){0, 6, 0, 0}), (struct tile_rect){0, 0, 37, 19}), "");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(keys_are_in_the_order_of_their_places),
        cmocka_unit_test(sums_are_the_same_in_any_order),
        cmocka_unit_test(rows_have_names_of_their_own),
        cmocka_unit_test(sentences_name_the_first_example),
    };
    return cmocka_run_group_tests_name("health", tests, NULL, NULL);
}
