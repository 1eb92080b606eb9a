/* The order in which tiles get their first samples. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <stdlib.h>
#include <string.h>

#include "common/film/tiles.h"
#include "coordinator/frame/spread.h"

static void every_tile_is_there_once_and_ranks_ascend(void **state)
{
    static const uint32_t sizes[][2] = {{1, 1},     {16, 16},    {17, 1},    {1, 4000},
                                        {640, 360}, {1920, 1080}, {4096, 17}, {33, 1031}};

    (void)state;
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        uint32_t width = sizes[i][0], height = sizes[i][1], tiles = tile_count(width, height);
        uint32_t *order = malloc(tiles * sizeof *order);
        uint8_t *seen = calloc(tiles, 1);
        assert_non_null(order);
        assert_non_null(seen);
        spread_order(width, height, order);
        for (uint32_t k = 0; k < tiles; k++) {
            assert_true(order[k] < tiles);
            assert_int_equal(seen[order[k]]++, 0);
            if (k > 0)
                assert_true(spread_rank(width, height, order[k - 1]) < spread_rank(width, height, order[k]));
        }
        free(seen);
        free(order);
    }
}

/* The largest distance, in tiles along the longer axis, from any tile to one of the first `count`. */
static uint32_t largest_gap(uint32_t across, uint32_t down, const uint32_t *order, uint32_t count)
{
    uint32_t worst = 0;

    for (uint32_t y = 0; y < down; y++)
        for (uint32_t x = 0; x < across; x++) {
            uint32_t best = UINT32_MAX;
            for (uint32_t k = 0; k < count; k++) {
                uint32_t dx = (uint32_t)abs((int)(order[k] % across) - (int)x);
                uint32_t dy = (uint32_t)abs((int)(order[k] / across) - (int)y);
                uint32_t d = dx > dy ? dx : dy;
                best = d < best ? d : best;
            }
            worst = best > worst ? best : worst;
        }
    return worst;
}

/* 1920x1080 has 120 x 68 tiles: after a 64th of them no tile is more than 7 tiles away from one that
 * has samples, after a 16th 3. In rows from the top it would be 66 and 63. */
static void every_beginning_is_spread_over_the_frame(void **state)
{
    uint32_t order[120 * 68];

    (void)state;
    spread_order(1920, 1080, order);
    assert_true(largest_gap(120, 68, order, 8160 / 64 + 1) <= 8);
    assert_true(largest_gap(120, 68, order, 8160 / 16 + 1) <= 4);
    assert_true(largest_gap(120, 68, order, 8160 / 4 + 1) <= 2);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_tile_is_there_once_and_ranks_ascend),
        cmocka_unit_test(every_beginning_is_spread_over_the_frame),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
