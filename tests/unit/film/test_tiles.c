/* Tile geometry and the pass schedule. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <stdlib.h>
#include <string.h>

#include "common/film/tiles.h"

/* Every pixel lies in exactly one tile. */
static void tiles_cover_the_frame_once(void **state)
{
    static const uint32_t sizes[][2] = {{1, 1},   {15, 16}, {16, 16}, {17, 16},
                                        {31, 33}, {100, 1}, {1, 100}, {257, 129}};

    (void)state;
    for (size_t s = 0; s < sizeof sizes / sizeof *sizes; s++) {
        uint32_t width = sizes[s][0], height = sizes[s][1];
        uint8_t *hits = calloc(width, height);
        assert_non_null(hits);
        for (uint32_t t = 0; t < tile_count(width, height); t++) {
            struct tile_rect r = tile_rect_of(width, height, t);
            assert_in_range(r.width, 1, TILE_SIZE);
            assert_in_range(r.height, 1, TILE_SIZE);
            assert_true(r.x + r.width <= width && r.y + r.height <= height);
            for (uint32_t y = 0; y < r.height; y++)
                for (uint32_t x = 0; x < r.width; x++)
                    hits[(r.y + y) * width + r.x + x]++;
        }
        for (uint32_t i = 0; i < width * height; i++)
            assert_int_equal(hits[i], 1);
        free(hits);
    }
}

/* Passes follow one another without a gap, none is empty, none is longer than it may be; and both
 * groups together have all samples. */
static void passes_cut_the_samples(void **state)
{
    (void)state;
    for (uint32_t spp = 1; spp <= 3000; spp++) {
        uint32_t all = 0;
        for (uint32_t g = 0; g < GROUPS; g++) {
            uint32_t at = 0;
            for (uint32_t p = 0; p < pass_count(spp, g); p++) {
                uint32_t begin, end;
                pass_range(spp, g, p, &begin, &end);
                assert_int_equal(begin, at);
                assert_true(end > begin && end - begin <= PASS_LENGTH_MAX);
                assert_int_equal(pass_is_short(spp, g, p), end != pass_boundary(p));
                assert_true(!pass_is_short(spp, g, p) || p + 1 == pass_count(spp, g));
                at = end;
            }
            assert_int_equal(at, group_samples(spp, g));
            all += at;
        }
        assert_int_equal(all, spp);
    }
}

/* The boundaries depend on nothing. */
static void boundaries_are_what_they_are(void **state)
{
    static const uint32_t ends[] = {2, 4, 8, 16, 24, 32, 48, 64, 96, 128, 192, 256};

    (void)state;
    for (uint32_t p = 0; p < sizeof ends / sizeof *ends; p++)
        assert_int_equal(pass_boundary(p), ends[p]);
    assert_int_equal(pass_boundary(20), 6144);
    assert_int_equal(pass_boundary(21), 8192);
    assert_int_equal(pass_boundary(22), 12288);
    for (uint32_t p = 1; p < PASSES_MAX; p++)
        assert_in_range(pass_boundary(p) - pass_boundary(p - 1), 2, PASS_LENGTH_MAX);
    assert_int_equal(pass_boundary(PASSES_MAX - 1), SETTINGS_SPP_MAX / GROUPS);
    assert_int_equal(pass_count(SETTINGS_SPP_MAX, 0), PASSES_MAX);
    assert_int_equal(pass_count(256, 0), 10);
    assert_int_equal(pass_count(1, 0), 1);
    assert_int_equal(pass_count(1, 1), 0);
}

/* Every level is the end of a pass. */
static void levels_are_passes(void **state)
{
    uint32_t found = 0;

    (void)state;
    for (uint32_t k = 0; k < LEVELS_MAX; k++) {
        uint32_t passes = level_passes(k);
        assert_int_equal(pass_boundary(passes - 1), level_samples(k));
        assert_int_equal(level_at(passes), k);
        assert_int_equal(level_count(passes), k + 1);
        assert_int_equal(level_count(passes - 1), k);
    }
    assert_int_equal(level_samples(LEVELS_MAX - 1), SETTINGS_SPP_MAX / GROUPS);
    for (uint32_t p = 0; p <= PASSES_MAX; p++)
        found += level_at(p) >= 0;
    assert_int_equal(found, LEVELS_MAX);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(tiles_cover_the_frame_once),
        cmocka_unit_test(passes_cut_the_samples),
        cmocka_unit_test(boundaries_are_what_they_are),
        cmocka_unit_test(levels_are_passes),
    };
    return cmocka_run_group_tests_name("tiles", tests, NULL, NULL);
}
