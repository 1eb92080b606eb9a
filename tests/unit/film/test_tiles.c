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

/* Passes follow one another without a gap, none is empty, none is longer than it may be. */
static void passes_cut_the_samples(void **state)
{
    (void)state;
    for (uint32_t spp = 1; spp <= 3000; spp++) {
        uint32_t at = 0;
        for (uint32_t p = 0; p < pass_count(spp); p++) {
            uint32_t begin, end;
            pass_range(spp, p, &begin, &end);
            assert_int_equal(begin, at);
            assert_true(end > begin && end - begin <= PASS_LENGTH_MAX);
            at = end;
        }
        assert_int_equal(at, spp);
    }
}

static void passes_double_to_the_cap(void **state)
{
    static const uint32_t ends[] = {4, 8, 16, 32, 64, 128, 192, 256};

    (void)state;
    assert_int_equal(pass_count(256), 8);
    for (uint32_t p = 0; p < 8; p++) {
        uint32_t begin, end;
        pass_range(256, p, &begin, &end);
        assert_int_equal(end, ends[p]);
    }
    /* A larger number of samples has the same passes, and then more. */
    for (uint32_t p = 0; p < 8; p++) {
        uint32_t begin, end, long_begin, long_end;
        pass_range(256, p, &begin, &end);
        pass_range(1 << 20, p, &long_begin, &long_end);
        assert_true(begin == long_begin && end == long_end);
    }
    assert_int_equal(pass_count(1 << 20), 4 + (1 << 20) / PASS_LENGTH_MAX);
}

static void replicates_share_the_samples(void **state)
{
    (void)state;
    for (uint32_t end = 0; end < 100; end++) {
        uint32_t count[REPLICATES] = {0};
        for (uint32_t i = 0; i < end; i++)
            count[i % REPLICATES]++;
        assert_int_equal(replicate_samples(end, 0), count[0]);
        assert_int_equal(replicate_samples(end, 1), count[1]);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(tiles_cover_the_frame_once),
        cmocka_unit_test(passes_cut_the_samples),
        cmocka_unit_test(passes_double_to_the_cap),
        cmocka_unit_test(replicates_share_the_samples),
    };
    return cmocka_run_group_tests_name("tiles", tests, NULL, NULL);
}
