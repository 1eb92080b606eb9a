/* spread: the order in which a frame's tiles get their first samples.
 *
 * Every beginning of the order is spread over the frame: its first 4^k tiles lie on a regular lattice, like the
 * thresholds of ordered dithering (Bayer 1973). So a preview shows the whole picture coarsely, long before every tile
 * has samples. The order depends on the frame's size alone.
 */
#pragma once

#include <stdint.h>

/* The tiles of a frame of this size in pixels, each once, into order[tile_count()]. */
void spread_order(uint32_t width, uint32_t height, uint32_t *order);
/* Of two tiles, the one with the smaller rank is earlier. Ranks have gaps. */
uint32_t spread_rank(uint32_t width, uint32_t height, uint32_t tile);
