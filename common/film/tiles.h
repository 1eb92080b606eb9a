/* tiles: the geometry of a frame, and the schedule of its passes.
 *
 * Both are pure functions of the job's settings; every program computes the same ones.
 */
#ifndef AZULEJO_FILM_TILES_H
#define AZULEJO_FILM_TILES_H

#include <stddef.h>
#include <stdint.h>

#include "common/scene/settings.h"

enum {
    TILE_SIZE = 16,
    TILE_PIXELS_MAX = TILE_SIZE * TILE_SIZE,
    REPLICATES = 2,
    PASS_FIRST = 4,      /* samples a pixel in pass 0 */
    PASS_LENGTH_MAX = 64, /* samples a pixel in one pass */
    /* floats of a pixel that is a sum of radiance: [replicate][RGB] */
    PIXEL_FLOATS = REPLICATES * 3,
    TILE_FLOATS_MAX = TILE_PIXELS_MAX * (PIXEL_FLOATS + AOV_FLOATS_MAX),
};

struct tile_rect {
    uint32_t x, y, width, height; /* pixels */
};

static inline uint32_t tiles_across(uint32_t pixels)
{
    return (pixels + TILE_SIZE - 1) / TILE_SIZE;
}
uint32_t tile_count(uint32_t width, uint32_t height);

/* Tile `index` (row-major, < tile_count) of a frame. */
struct tile_rect tile_rect_of(uint32_t width, uint32_t height, uint32_t index);

/* Floats in a result of tile `index`: [replicate][pixel, row-major][RGB], then for each AOV of the
 * mask, in the order of enum aov, [pixel][its channels]. */
size_t tile_floats(uint32_t width, uint32_t height, uint32_t index, uint32_t aovs);
/* Where the values of `aov`, which is in the mask, begin. `pixels` is that of the tile. */
size_t tile_aov_offset(uint32_t pixels, uint32_t aovs, enum aov aov);

/* How many passes `spp` samples are cut into. Boundaries: 4, 8, 16, 32, 64, 128, 192, ... */
uint32_t pass_count(uint32_t spp);

/* Pass `index` renders samples [*begin, *end) of each pixel; index < pass_count(spp). */
void pass_range(uint32_t spp, uint32_t index, uint32_t *begin, uint32_t *end);

/* How many of the samples [0, end) belong to replicate r: sample i belongs to i mod 2. */
static inline uint32_t replicate_samples(uint32_t end, uint32_t r)
{
    return (end + (r == 0)) / 2;
}

#endif
