/* picture: what is to be denoised, and what comes of it. denoise.h does it. */
#pragma once

#include <stdint.h>

#include "common/accuracy/accuracy.h"

struct denoise_input;

/* A frame before or after, whose noise is independent of this one's. */
struct denoise_other {
    const struct denoise_input *picture; /* of the same size, with the same variables; its own others do not count */
    const int32_t *source; /* [height][width]: which of its pixels (row-major) shows what this one's pixel shows; less than
                            * 0: none. NULL: the same pixel */
};

/* All pictures are [height][width][3], linear. NULL: not there. */
struct denoise_input {
    uint32_t width, height;
    const float *groups[2];  /* means of the groups; must be there, and finite */
    const float *albedo[2];  /* of each group: mean albedo at the first rough hit, exactly 0 where nothing is hit */
    const float *normal[2];  /* of each group: mean normal at the first rough hit, 0 where nothing is hit */
    const float *direct[2];  /* of each group: radiance of emitters and of the background seen directly, also through
                             * smooth glass and off mirrors; part of `groups`, and stays untouched */
    const uint32_t *samples; /* of a pixel, [tiles of 16x16, row-major][2 groups]; NULL: both are everywhere. A tile
                              * that lacks a group stays raw, and no other looks at it. */
    /* Other frames that take part, one at a time: each stays until the next call, or until denoise() returns. */
    uint32_t other_count;
    status (*other)(void *user, uint32_t k, struct denoise_other *out, struct error *err);
    void *other_user;
};

enum denoise_method {
    DENOISE_FAST, /* for previews */
    DENOISE_FULL,
};

struct denoise_options {
    enum denoise_method method;
    unsigned threads; /* 0: one for each processor */
    /* What a display shows. NULL: display error and PSNR of the result are NaN. It is applied to variants of the
     * result, so all of them should be shown with the same exposure if it is metered. */
    const struct accuracy_transform *transform;
    const struct accuracy_evidence *evidence; /* NULL: nothing is known */
    /* Called by whichever thread finishes a part, never by two at a time; share 0..1, ascending. NULL: not called. */
    void (*progress)(void *user, double share);
    void *progress_user;
};

struct denoise_counts {
    uint32_t tiles;     /* of the picture */
    uint32_t raw;       /* of them that show more of the raw picture than of the filters, or lack a group */
    uint64_t fireflies; /* values of pixels (one of R, G, B in one group) that were reduced before filtering */
    double removed;     /* share of the picture's light that this took away, 0..1 */
};

struct denoise_result {
    float *image; /* [height][width][3], owned */
    struct denoise_counts counts;
    /* Of `image`, by the same definitions as those of the raw picture. `known` is 0 (and all is NaN) if a tile lacks a
     * group; `reliable` is 0 where the figures may be understated. */
    struct accuracy_figures figures;
};
