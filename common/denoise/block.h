/* block: a part of the picture with a margin, as planes: what one thread filters at a time. Private to common/denoise.
 *
 * In a block, "group g" has the colours that F_g averages: direct light taken away, fireflies reduced, divided by the
 * group's own albedo. Pixels of the margin that are outside of the picture repeat its edge and weigh nothing. */
#pragma once

#include "common/denoise/picture.h"

enum {
    BLOCK_INNER = 64,  /* pixels of a side that are filtered: whole tiles */
    BLOCK_MARGIN = 12, /* around them: window and patch */
    BLOCK_SIDE = BLOCK_INNER + 2 * BLOCK_MARGIN,
    BLOCK_PIXELS = BLOCK_SIDE * BLOCK_SIDE,
    BLOCK_FEATURES = 6, /* albedo, normal */
    BLOCK_LINES = 16,   /* that are filtered at a time */
    BLOCK_STRIP = BLOCK_LINES * BLOCK_INNER,
    BLOCK_SUMS = 39, /* of a pixel, for fits */
};

typedef float block_plane[BLOCK_PIXELS];

struct block {
    uint32_t x, y, width, height; /* the inner part, in pixels of the picture */
    block_plane colour[2][3];     /* divided by `albedo` */
    block_plane albedo[2][3];     /* what a result is to be multiplied by */
    block_plane feature[2][6];    /* albedo, normal */
    block_plane loose[2];         /* 1 / (squared distance of albedo, of normal, that counts as 1) */
    block_plane noise;        /* variance of a group's colours, summed over channels, pooled over pixels and groups */
    block_plane weight;       /* 0: outside of the picture, or not known in both groups; else 1 */
    block_plane result[2][3]; /* of a filter, multiplied by albedo: without direct light */
    block_plane fitted[2][3]; /* the same of fits */
    block_plane scratch[8];
    float sums[2][BLOCK_SUMS * BLOCK_STRIP]; /* for fits (fit.h) */
    uint64_t fireflies;                      /* values that were reduced */
    double removed, light;                   /* by how much; all light, of the inner part */
};

static inline uint32_t block_index(uint32_t x, uint32_t y)
{
    return (y + BLOCK_MARGIN) * BLOCK_SIDE + x + BLOCK_MARGIN;
}

/* Everything but results of the block whose inner part begins at (x, y). `means`: colours to take instead of the input's, without
 * direct light, of each group [height][width][3]; NULL: those of the input. */
void block_load(struct block *block, const struct denoise_input *input, float *const means[2], uint32_t x, uint32_t y);
/* The same place of another frame. */
void block_load_other(struct block *block, const struct denoise_other *other, uint32_t x, uint32_t y);

enum joint_colours {
    JOINT_FEATURES, /* weights from features alone */
    JOINT_COLOURS,
    JOINT_KNOWING, /* with what the other group has in the pixel: wrong, for the test that shows why */
};
/* Joint filter: means over a window of (2 radius + 1)^2 pixels, weighted by the group's own features and by how like
 * the other group's colours are around the two pixels, without what the other group has in the pixel itself. */
void block_filter_joint(struct block *block, int radius, enum joint_colours colours);
/* The same, and in `fitted` the values of models fitted with about these weights (fit.h). */
void block_filter_fitted(struct block *block, int radius);

/* e^-d for d >= 0, within .03; 0 from 8 on. */
static inline float weight_of(float distance)
{
    float t = 1 - distance * 0.125f;

    t = t > 0 ? t : 0;
    t *= t;
    t *= t;
    return t * t;
}
