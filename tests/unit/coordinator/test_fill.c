/* Tiles without samples are filled from those around them. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/film/tiles.h"
#include "coordinator/pictures/fill.h"
#include "coordinator/frame/spread.h"

/* A smooth picture of linear light, brighter than a display shows. */
static float radiance(uint32_t x, uint32_t y, int c)
{
    return 2 + 0.004f * (float)x + 0.006f * (float)y * (float)(c + 1);
}

/* The picture with only the first `count` tiles of the order, the others black. */
static void set_up(struct image *image, uint8_t **there, uint32_t width, uint32_t height, uint32_t count)
{
    uint32_t tiles = tile_count(width, height), *order = malloc(tiles * sizeof *order);

    assert_int_equal(image_init(image, width, height, 3, NULL), STATUS_OK);
    *there = calloc(tiles, 1);
    assert_non_null(order);
    assert_non_null(*there);
    spread_order(width, height, order);
    for (uint32_t k = 0; k < count && k < tiles; k++) {
        struct tile_rect r = tile_rect_of(width, height, order[k]);
        (*there)[order[k]] = 1;
        for (uint32_t y = r.y; y < r.y + r.height; y++)
            for (uint32_t x = r.x; x < r.x + r.width; x++)
                for (int c = 0; c < 3; c++)
                    image->pixels[((size_t)y * width + x) * 3 + (size_t)c] = radiance(x, y, c);
    }
    free(order);
}

static float largest_error(const struct image *image)
{
    float worst = 0;

    for (uint32_t y = 0; y < image->height; y++)
        for (uint32_t x = 0; x < image->width; x++)
            for (int c = 0; c < 3; c++)
                worst = fmaxf(worst, fabsf(image->pixels[((size_t)y * image->width + x) * 3 + (size_t)c] /
                                               radiance(x, y, c) - 1));
    return worst;
}

static double mean_error(const struct image *image)
{
    double sum = 0;

    for (uint32_t y = 0; y < image->height; y++)
        for (uint32_t x = 0; x < image->width; x++)
            sum += fabsf(image->pixels[((size_t)y * image->width + x) * 3] / radiance(x, y, 0) - 1);
    return sum / ((double)image->width * image->height);
}

static void a_smooth_picture_is_close_from_a_sixteenth_of_its_tiles(void **state)
{
    struct image image;
    uint8_t *there;

    (void)state;
    set_up(&image, &there, 333, 250, 21 + 1);
    assert_true(largest_error(&image) == 1); /* black tiles */
    assert_int_equal(fill_tiles(&image, there, NULL), STATUS_OK);
    assert_true(mean_error(&image) < 0.06); /* more only at the frame's edges, beyond the last tiles */
    assert_true(largest_error(&image) < 0.4f);
    free(there);
    image_release(&image);
}

static void one_tile_fills_the_frame_and_known_tiles_keep_their_bits(void **state)
{
    struct image image;
    uint8_t *there;

    (void)state;
    set_up(&image, &there, 1000, 40, 1);
    assert_int_equal(fill_tiles(&image, there, NULL), STATUS_OK);
    for (size_t i = 0; i < 1000 * 40 * 3; i++)
        assert_true(image.pixels[i] > 1.9f);
    for (uint32_t y = 0; y < TILE_SIZE; y++)
        for (uint32_t x = 0; x < TILE_SIZE; x++)
            assert_true(image.pixels[((size_t)y * 1000 + x) * 3] == radiance(x, y, 0));
    free(there);
    image_release(&image);
}

static void without_memory_the_image_is_as_it_was(void **state)
{
    struct image image;
    uint8_t *there;
    struct error err = {0};

    (void)state;
    set_up(&image, &there, 100, 100, 5);
    mem_fault_arm(3, 1);
    assert_int_equal(fill_tiles(&image, there, &err), STATUS_ERR_NO_MEMORY);
    mem_fault_arm(-1, 0);
    assert_true(largest_error(&image) == 1);
    free(there);
    image_release(&image);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_smooth_picture_is_close_from_a_sixteenth_of_its_tiles),
        cmocka_unit_test(one_tile_fills_the_frame_and_known_tiles_keep_their_bits),
        cmocka_unit_test(without_memory_the_image_is_as_it_was),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
