/* denoise_toys: pictures whose truth is known, and groups of noisy samples of them. A failure (out of memory) aborts. */
#pragma once

#include "common/denoise/denoise.h"

enum toy_noise {
    TOY_EXPONENTIAL,  /* each sample is exponential */
    TOY_SPIKY_TENTH,  /* half of the light is in a tenth of the samples */
    TOY_SPIKY_HUNDREDTH,
};

struct toy {
    uint32_t width, height;
    float *truth, *albedo, *normal; /* [height][width][3] */
};

/* Edges, a texture and a disc, with features if asked: albedo of the texture, normals of the disc. */
void toy_make(struct toy *toy, uint32_t width, uint32_t height, int features);
void toy_release(struct toy *toy);

struct toy_groups {
    struct denoise_input input; /* groups, and features (the same in both) if the toy has them */
    float *groups[2];
};
/* Means of so many samples a group. */
void toy_sample(struct toy_groups *groups, const struct toy *toy, enum toy_noise noise, uint32_t samples, uint64_t seed);
void toy_groups_release(struct toy_groups *groups);

/* Mean squared differences over pixels and channels. */
double toy_error(const struct toy *toy, const float *picture);
