/* unbiased: is the mean of adaptive pictures that of uniform ones?
 *
 * Each seed is rendered once, uniformly; the rounds and the stop by a target are replayed on its
 * units, and the adaptive picture is compared with the seed's uniform one, tile by tile and as a
 * whole. Their difference has mean 0 over the seeds if the procedure is unbiased (paired t-tests).
 */
#pragma once

#include "tests/support/replay.h"
#include "tests/support/statistics.h"

/* The faults of replay_rounds(), and groups joined by their counts instead of by halves. */
enum { UNBIASED_BY_COUNTS = REPLAY_ENDED_GROWS + 1, UNBIASED_WAYS };
extern const char *const unbiased_names[UNBIASED_WAYS];

enum { UNBIASED_TILES_MAX = 16 };

struct unbiased_study {
    const char *path; /* of the scene file */
    uint32_t width, height;
    uint32_t samples;    /* of a group, at most */
    uint32_t last_level; /* the last round */
    struct allocation_target target;
    uint32_t first_seed, seeds;
};

struct unbiased_way {
    struct running_stats frame, tiles[UNBIASED_TILES_MAX]; /* differences of means, in radiance */
    struct running_stats samples;                          /* of a group, mean over tiles */
};

struct unbiased_result {
    uint32_t tests;               /* the frame, and tiles if there are several */
    struct running_stats uniform; /* the frame's mean of uniform samples */
    struct unbiased_way ways[UNBIASED_WAYS];
};

void unbiased_measure(const struct unbiased_study *study, struct unbiased_result *out);

/* The least p-value of a way's tests, to be held against sidak_alpha(level, tests). */
double unbiased_p_value(const struct unbiased_result *result, int way);
