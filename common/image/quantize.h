/* quantize: display values to the integers of files. Private to common/image. */
#pragma once

#include "common/image/image.h"

/* Row y of the image's first 3 channels (0..1; NaN is 0) to RGB bytes, out[width][3], dithered by a
 * fixed mask of less than a step, or rounded when `plain`. */
void quantize_row8(const struct image *image, uint32_t y, int plain, uint8_t *out);
/* The same to 16 bits, most significant byte first: out[width][3][2]. */
void quantize_row16(const struct image *image, uint32_t y, int plain, uint8_t *out);
