/* statistics: measured over a whole picture, before any operator. Private to common/tonemap. */
#pragma once

#include "common/tonemap/operator.h"

/* The side of the log-mean's windows, in pixels. */
enum { STATISTICS_WINDOW = 9 };

/* Of `in` (3 channels) after the matrix; negative channels count as 0. `apart`: 0, or the side of the tiles of which the
 * picture is a sample, at most 128: those beside each other are not neighbours. ERR_NO_MEMORY. */
status statistics_measure(struct tonemap_statistics *out, const struct image *in, const double matrix[3][3],
                          uint32_t apart, unsigned threads, struct error *err) MUST_CHECK;

/* The luminance after the matrix below which `percent` (0..100) of the pixels that count lie, as a
 * float, exactly (nearest rank); 0 if none counts. ERR_NO_MEMORY. */
status statistics_percentile(double *out, const struct image *in, const double matrix[3][3], double percent,
                             unsigned threads, struct error *err) MUST_CHECK;
