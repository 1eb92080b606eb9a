/* frames: means over frames, before they are filtered. Private to common/denoise.
 *
 * Each group is averaged by itself, along what the camera's movement does to the picture: F_A of denoise.h still knows nothing of what
 * B saw in the pixel, since other frames have other noise, and since A's weights come from A. Light is averaged as it is seen, not
 * divided by albedo, so that edges have as many samples as surfaces. */
#pragma once

#include "common/denoise/block.h"

struct frames {
    float *sums[2];  /* of each group, without direct light: [height][width][3]; means once frames_end() is through */
    float *total[2]; /* of weights, [height][width] */
};

/* Begin with the picture itself, in the inner part of the block, which is loaded. */
void frames_begin(struct frames *f, const struct denoise_input *input, const struct block *block);
/* Add another frame's block, which is loaded by what `block` shows. */
void frames_add(struct frames *f, const struct denoise_input *input, struct block *block, const struct block *other);
void frames_end(struct frames *f, const struct denoise_input *input, const struct block *block);
