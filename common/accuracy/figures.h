/* figures: how wrong a picture may be, from the two independent groups of samples whose mean it is.
 *
 * The picture is M = (A + B) / 2. With e the error of M, half the difference of the groups
 *     C = (A - B) / 2
 * has the second moments of e, for any numbers of samples in the groups. So every figure is computed from
 * C, summed over pixels, whose samples are independent. With X and Y the errors of A and B, C^2 - e^2 is
 * -X Y: its variance, and with it the interval of a sum, follows from the sum of C^4. Nothing is clipped,
 * and no constant is added to a denominator.
 *
 * People look at the subject: what is before the background, and not a lamp seen directly. Of each tile the share of
 * the samples that see it is known, not which pixels they are in: as many pixels count as that share says, the
 * noisiest first. The background is calm, so these are the subject's, and where it is not, the figure is too large
 * rather than too small. A picture of nothing but background counts as a whole.
 *
 * What no sample has met cannot be seen this way. docs/ACCURACY.md shows how often the figures
 * hold, and `word.h` decides when not to trust them.
 *
 * Pure functions, no I/O, the same bits on every machine.
 */
#pragma once

#include "common/accuracy/accuracy.h"
#include "common/base/status.h"

/* A tile's errors, 16x16 pixels, row-major; any may be NULL. */
struct accuracy_map {
    float *display;      /* root mean square over the pixels of the largest channel's error, in codes */
    float *linear;       /* root mean square over pixels and channels, radiance */
    uint16_t *fireflies; /* how many of its pixels are */
};

/* ERR_NO_MEMORY, or what the transform returns. `evidence` and `map` may be NULL. */
status accuracy_figures_of(struct accuracy_figures *out, const struct accuracy_picture *picture,
                           const struct accuracy_transform *transform, const struct accuracy_evidence *evidence,
                           struct accuracy_map *map, struct error *err) MUST_CHECK;
