/* sample: what is known of a picture of which only some tiles were looked at.
 *
 * Noise differs from tile to tile by far more than chance within a tile, so a figure of n of N tiles is as uncertain as the
 * tiles differ (Cochran, Sampling Techniques, 1977, section 9: clusters, and 6.3: ratios). All functions give 0 for a whole
 * picture. Private to common/accuracy.
 */
#pragma once

#include "common/accuracy/contrast.h"

/* Of so many of the picture's tiles this is one; 1 for a whole picture. */
double sample_scale(const struct accuracy_picture *picture);

/* The variance of the ratio of two sums over the tiles, each given tile by tile. */
double sample_ratio_variance(const struct accuracy_picture *picture, const double *above, const double *below,
                             size_t tiles);

/* Widen what `g` knows of the variances of its sums. ERR_NO_MEMORY. */
status sample_widen(struct gathered *g, struct error *err) MUST_CHECK;
