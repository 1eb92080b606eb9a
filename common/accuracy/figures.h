/* figures: how wrong a picture may be, from the four replicates whose mean it is.
 *
 * The picture is M = (R0 + R1 + R2 + R3) / 4; R0, R1 are group 0's replicates, R2, R3 group 1's.
 * With e the error of M, the three orthogonal contrasts
 *     (R0 - R1 + R2 - R3) / 4,  (R0 - R1 - R2 + R3) / 4,  (R0 + R1 - R2 - R3) / 4
 * have the second moments of e, for any numbers of samples in the groups, and are exchangeable with
 * it apart from skewness. So every figure is computed from the contrasts, and its interval from how
 * far the three differ, pixel by pixel: the variance of (mean of three) - (the real one) is 4/3 of
 * what they show. Nothing is clipped, and no constant is added to a denominator.
 *
 * What no sample has met cannot be seen this way. docs/ACCURACY.md shows how often the figures
 * hold, and `word.h` decides when not to trust them.
 *
 * Pure functions, no I/O, the same bits on every machine.
 */
#ifndef AZULEJO_ACCURACY_FIGURES_H
#define AZULEJO_ACCURACY_FIGURES_H

#include <stdint.h>

#include "common/accuracy/tail.h"
#include "common/base/status.h"

enum { ACCURACY_REPLICATES = 4 };

/* Means of the replicates, linear radiance [height][width][3]. All four hold samples of every
 * pixel; a group without samples in a tile is 0 there. */
struct accuracy_picture {
    uint32_t width, height;
    const float *replicates[ACCURACY_REPLICATES];
    /* Samples of a pixel, [tiles][2 groups], a tile being 16x16 pixels; NULL: both groups are
     * everywhere. */
    const uint32_t *samples;
};

/* What a display shows of a picture: `codes` [height][width][3] in 0..255, not rounded. The
 * parameters are measured once, on the mean, and are the same in every call. */
struct accuracy_transform {
    status (*apply)(void *user, const float *rgb, uint32_t width, uint32_t height, float *codes,
                    struct error *err);
    void *user;
};

/* What is known besides the replicates. Zero-initialise the unknown. */
struct accuracy_evidence {
    double samples;        /* of a pixel, mean over the frame */
    uint64_t effects;      /* that the frame needs (common/scene/effects.h) */
    double brightest;      /* radiance of the brightest light that a ray can meet by chance; 0: not known */
    const struct accuracy_tails *tails; /* NULL: not known */
};

/* Why a figure may be understated. */
enum accuracy_reason {
    ACCURACY_UNSEEN = 1,   /* one path not met yet would outweigh all of the error */
    ACCURACY_DISAGREE = 2, /* the groups' own figures differ by more than chance allows */
    ACCURACY_TOP = 4,      /* few pixels hold most of the squared error */
    ACCURACY_SPARSE = 16,  /* many noisy pixels were lit in one replicate, or in none */
    ACCURACY_TAIL = 8,     /* the largest contributions fall off too slowly for a mean */
};

struct accuracy_figures {
    /* 95 % of the pixels are within display_error codes of 255 of the picture of infinitely many
     * samples, by the largest of R, G, B. lo, hi: 95 % intervals. */
    double display_error, display_lo, display_hi;
    double psnr_db, psnr_lo, psnr_hi;          /* of the same codes, all channels; INFINITY: no error */
    double rmse_percent, rmse_lo, rmse_hi;     /* of linear radiance, over the frame's mean */
    double mean;                               /* of the frame's channels */
    double lone, dark;    /* of the pixels that make the display error: how far one replicate makes
                           * it, and the share of them that show no error themselves; 0..1 */
    double top_share;     /* of the squared error, in the 0.1 % of the pixels with the largest */
    double disagreement;  /* |ln| of the ratio of the groups' own squared errors, for equal samples */
    double unseen;        /* squared error of one unmet path over the estimate; 0: not known */
    double tail_index;    /* k of the largest contributions; NaN: not known */
    int known;            /* 0: a tile lacks a replicate; all of the above is NaN */
    int reliable;         /* 0: may be understated */
    unsigned reasons;     /* enum accuracy_reason */
};

/* A tile's errors, 16x16 pixels, row-major; either may be NULL. */
struct accuracy_map {
    float *display; /* root mean square over the pixels of the largest channel's error, in codes */
    float *linear;  /* root mean square over pixels and channels, radiance */
};

/* ERR_NO_MEMORY, or what the transform returns. `evidence` and `map` may be NULL. */
status accuracy_figures_of(struct accuracy_figures *out, const struct accuracy_picture *picture,
                           const struct accuracy_transform *transform,
                           const struct accuracy_evidence *evidence, struct accuracy_map *map,
                           struct error *err) MUST_CHECK;

#endif
