/* accuracy: a picture as the mean of two groups of samples, and what is said of its error. figures.h computes the figures,
 * word.h decides when not to trust them. */
#pragma once

#include <stdint.h>

#include "common/accuracy/tail.h"
#include "common/base/status.h"
#include "common/schema/choices.h"

/* Means of the groups, which are independent: linear radiance [height][width][3]. A group without
 * samples in a tile is 0 there. */
struct accuracy_picture {
    uint32_t width, height;
    const float *groups[2]; /* NULL: `lines` gives them */
    /* Lines y..y+height-1 of a group: out[height][width][3]. */
    void (*lines)(void *user, int group, uint32_t y, uint32_t height, float *out);
    void *user; /* of `lines` */
    /* Samples of a pixel, [tiles][2 groups], a tile being 16x16 pixels; NULL: both groups are everywhere. */
    const uint32_t *samples;
    /* The share of each tile's samples that see the subject (unit.h), 0..1, [tiles]; NULL: all. */
    const float *subject;
    /* Its tiles, all whole, are a sample of so many of a larger picture, and lie beside each other in any order; 0: it is the
     * whole picture. */
    uint32_t of_tiles;
};

/* What a display shows of a picture: `codes` [height][width][3] in 0..255, not rounded. It meters each picture by
 * itself, as it would be delivered: the mean, and each group. */
struct accuracy_transform {
    status (*apply)(void *user, const float *rgb, uint32_t width, uint32_t height, float *codes, struct error *err);
    void *user;
    /* Where a pixel's codes depend on no other pixel, once its picture has been measured: group 0, group 1, or the mean (2).
     * `measure` comes first, once a picture; `codes` is what `apply` makes of count pixels. NULL: they depend on others. */
    status (*measure)(void *user, int picture, const float *rgb, uint32_t width, uint32_t height, struct error *err);
    void (*codes)(void *user, int picture, const float *rgb, uint32_t count, float *codes);
    unsigned threads; /* for `codes`, as in parallel_for */
};

/* What is known besides the groups. Zero-initialise the unknown. */
struct accuracy_evidence {
    double samples;   /* of a pixel, mean over the frame */
    uint64_t effects; /* that the frame needs (common/scene/effects.h) */
    double brightest; /* radiance of the brightest light that a ray can meet by chance; 0: not known */
    const struct accuracy_tails *tails; /* NULL: not known */
};

/* Why a figure may be understated. */
enum accuracy_reason {
#define REASON(PREFIX, NAME, number, word) PREFIX##_##NAME = 1 << number,
    ACCURACY_REASONS(REASON)
#undef REASON
};

struct accuracy_figures {
    /* 95 % of the pixels that see the subject are within display_error codes of 255 of the picture of infinitely many
     * samples, by the largest of R, G, B. lo, hi: 95 % intervals. */
    double display_error, display_lo, display_hi;
    double psnr_db, psnr_lo, psnr_hi;      /* of the same codes, all channels; INFINITY: no error */
    double rmse_percent, rmse_lo, rmse_hi; /* of linear radiance, over the frame's mean */
    double mean;                           /* of the frame's channels */
    double lone, dark;                     /* of the pixels that make the display error: how far bright samples that one
                           * group alone has met make it (0: normal noise, 1: all of it), and the share
                           * of them that show no error themselves, 0..1 */
    double top_share;                      /* of the squared error, in the 0.1 % of the pixels with the largest */
    double disagreement; /* |ln| of the ratio of the squared errors where the one group is brighter and
                           * where the other is */
    double unseen;       /* squared error of one unmet path over the estimate; 0: not known */
    double tail_index;   /* k of the largest contributions; NaN: not known */
    int known;           /* 0: a tile lacks a group; all of the above is NaN */
    int reliable;        /* 0: the display error may be understated; of the RMSE: word.h */
    unsigned reasons;    /* enum accuracy_reason, of both */
    double display_all;  /* as display_error, of all pixels, the background among them */
    double worst_part;   /* of the parts of 16x16 pixels that see the subject, 99 % are within this root mean square, in codes */
    double fireflies;    /* pixels that stand out of their neighbourhood by noise (fireflies.h) */
    double subject;      /* share of the picture's samples that see the subject, 0..1 */
};
