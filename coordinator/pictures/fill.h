/* fill: tiles without samples, from the tiles around them. For previews only.
 *
 * The tiles that are there are boundary values of a membrane (Laplace's equation in linear light),
 * solved on cells of FILL_CELL pixels by a cascade of grids from coarse to fine, then interpolated.
 */
#pragma once

#include <stdint.h>

#include "common/base/status.h"
#include "common/image/image.h"

enum { FILL_CELL = 4 }; /* pixels; divides TILE_SIZE */

/* `there`: of each tile (row-major), whether its pixels are known. At least one is. The other
 * tiles' pixels are replaced. ERR_NO_MEMORY: the image is as it was. */
status fill_tiles(struct image *image, const uint8_t *there, struct error *err) MUST_CHECK;
