/* fireflies: pixels that stand out of their neighbourhood by noise, not by content.
 *
 * Content is in both groups of samples, and a bright sample that one path in many finds is in one alone. A pixel is a
 * firefly if
 *  - the picture shows it brighter than the darker of its two groups by FIREFLY_CODES at least,
 *  - and so much brighter than the median of its neighbours, and FIREFLY_SPREADS times as much as these differ from
 *    their median in the mean: in a picture that is noisy all over, nothing stands out,
 *  - and the darker group does not stand out by half as much: then it may be content.
 * How many are found, and how many falsely: docs/ACCURACY.md.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#define FIREFLY_CODES 24.0f
#define FIREFLY_SPREADS 8.0f

/* Codes [height][width][3] of the groups as they are shown, and of their mean. marks[height][width]: 1 for each.
 * Returns their number. */
size_t fireflies_find(const float *a, const float *b, const float *mean, uint32_t width, uint32_t height,
                      uint8_t *marks);

/* How far the pixel stands out of its neighbours, in codes of its brightest channel; 0: not enough to be seen. */
float firefly_height(const float *codes, uint32_t width, uint32_t height, uint32_t x, uint32_t y);
