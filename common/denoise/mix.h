/* mix: what is shown at a pixel: a mean of what the filters made of it and of the raw picture. Private to common/denoise. */
#pragma once

#include "common/denoise/picture.h"

enum {
    DENOISE_TILE = 16,
    MIX_CELL = 8, /* pixels of a side that are judged together, with those around them */
};

enum mix_way {
    MIX_JOINT,
    MIX_FITTED,
    MIX_RAW,
    MIX_WAYS,
};

/* Sums over a cell of products of two ways' errors (product_of), weighted; [a][b] with b <= a. */
struct mix_products {
    double of[MIX_WAYS][MIX_WAYS];
};

/* What the filters made of the groups. */
struct filtered {
    const struct denoise_input *input;
    float *pictures[2];            /* of each group by the joint filter, with direct light */
    float *fitted[2];              /* the same by the fitted models; NULL: there are none */
    uint32_t across, down;         /* cells */
    float mean;                    /* of the picture; 0 or more */
    struct mix_products *products; /* [cells] */
    float (*shares)[MIX_WAYS];     /* [cells]: of each way in what is shown, 0..1, of sum 1 */
};

/* The mean over noise of (F - I) (G - I), times 4, where I is the truth, and F and G are means of what two functions
 * make of each group: functions that know nothing of the other group in their pixel. Unbiased, and often
 * negative in a single pixel. */
static inline float product_of(float a, float b, const float f[2], const float g[2])
{
    const float d = a - b;

    return 2 * ((f[0] - b) * (g[0] - b) + (f[1] - a) * (g[1] - a) - d * d) - (f[0] - f[1]) * (g[0] - g[1]);
}

/* The squared error of F. */
static inline float error_of(float a, float b, float filtered_a, float filtered_b)
{
    const float f[2] = {filtered_a, filtered_b};

    return product_of(a, b, f, f);
}

/* The products of the cells of the line of cells `row`. */
void mix_compare(struct filtered *f, uint32_t row);
/* Their shares, when all are compared. */
void mix_choose(struct filtered *f, uint32_t row);
/* The two groups as they are shown, at a pixel: each a mean of what the filters made of it and of its raw
 * colours. */
void mix_pixel(const struct filtered *f, uint32_t x, uint32_t y, float out[2][3]);
int mix_tile_is_known(const struct denoise_input *input, size_t tile);
uint32_t mix_tiles_across(const struct denoise_input *input);
uint32_t mix_tiles(const struct denoise_input *input);
/* Of a tile: whether it lacks a group, or shows more of the raw picture than of the filters. */
int mix_tile_is_raw(const struct filtered *f, uint32_t tile);
