/* linear: a tile's picture as bytes for the live picture: linear radiance in half floats.
 *
 * A record, little-endian:
 *
 *   u32 tile, u16 width, u16 height   pixels of the tile
 *   u32 samples                       of a pixel, times LINEAR_SAMPLES_ONE, rounded; the most that fits
 *   u16 halves[height][width][4]      rows from top to bottom
 *
 * Of the picture, RGB are the mean radiance, to the nearest half, at most HALF_MAX in magnitude, and A is the
 * standard error of its luminance; NaN: not known. Of an AOV, RGB are its first channels, and A is NaN.
 *
 * Pure functions; any thread.
 */
#pragma once

#include <stdint.h>

#include "common/film/film.h"

enum {
    LINEAR_HEADER_BYTES = 12,
    LINEAR_PIXEL_BYTES = 8,
    LINEAR_RECORD_MAX = LINEAR_HEADER_BYTES + TILE_PIXELS_MAX * LINEAR_PIXEL_BYTES,
    LINEAR_SAMPLES_ONE = 256,
    LINEAR_PICTURE = -1, /* the layer that is the picture; the others are AOVs */
};

/* May the layer be asked of the film? */
int linear_has_layer(uint32_t aovs, int layer);
/* "color" or the AOV's name. -2: there is none of that name. */
const char *linear_layer_name(int layer);
int linear_layer_parse(const char *name);

/* Write the tile's record to `out`; returns its size. 0: the tile has no samples. */
size_t linear_tile(const struct film *film, uint32_t tile, int layer, uint8_t out[LINEAR_RECORD_MAX]);
/* The same of pixels[height][width][4]. */
size_t linear_record(uint32_t tile, uint32_t width, uint32_t height, double samples, const float (*pixels)[4],
                     uint8_t out[LINEAR_RECORD_MAX]);
