/* compare: the differences between two pictures. Sums are taken in double, in row order. */
#pragma once

#include <stdint.h>

#include "common/image/image.h"

struct comparison {
    int same_size; /* 0: nothing below is filled in */
    int identical; /* every float has the same bits */
    uint64_t pixels, differing_pixels;
    uint32_t worst_x, worst_y; /* the place of max_absolute */
    double max_absolute;       /* largest |a - b| of a channel */
    double max_relative;       /* largest |a - b| / max(|a|, |b|) of a channel, 0 for 0 and 0 */
    double mse;                /* mean((a - b)^2) over pixels and channels */
    double relative_mse;       /* mean((a - b)^2 / (b^2 + 0.01)), b the reference: pbrt's imgtool */
    double mean_relative[3];   /* (mean a - mean b) / mean b of a channel: the bias; NaN for 0 */
    double psnr_db;            /* of the sRGB encodings clamped to 0..1; INFINITY if equal */
};

/* Both pictures have three channels; b is the reference. */
void image_compare(const struct image *a, const struct image *b, struct comparison *out);
