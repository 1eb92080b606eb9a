/* replay: the rounds of an adaptive frame, run on units that are all there instead of on a farm.
 *
 * A replay holds one seed: after every pass what each group's statistics say, how far a picture of
 * any counts is from the truth, as told by another seed's samples, and the groups' means. To
 * judge how well samples are given out, let one seed decide and another judge, so that no choice
 * is judged by the samples that made it.
 * Every function aborts the program when something goes wrong. */
#pragma once

#include "common/accuracy/allocate.h"
#include "common/accuracy/figures.h"
#include "tests/support/recording.h"

enum replay_keep { REPLAY_ERRORS = 1, REPLAY_MEANS = 2 };
enum { REPLAY_OTHER = 2 }; /* with REPLAY_ERRORS, seed + REPLAY_OTHER is read, too */

struct replay {
    uint32_t width, height, tiles;
    uint32_t passes;                /* of each group */
    double exposure[RECORD_GROUPS]; /* of the statistics */
    double shown;                   /* exposure at which errors are judged and reported */
    /* All that follows is indexed by the passes that are in, 1 .. passes. */
    struct film_level *statistics[RECORD_GROUPS][RECORD_PASSES_MAX + 1]; /* [tiles] */
    /* The difference from the other seed's mean in codes, over sqrt(2): the error of the group's
     * mean, in distribution. [height][width][3]; with REPLAY_ERRORS. */
    float *error[RECORD_GROUPS][RECORD_PASSES_MAX + 1];
    float *picture[RECORD_GROUPS][RECORD_PASSES_MAX + 1]; /* means, as `error` */
    double *mean[RECORD_GROUPS][RECORD_PASSES_MAX + 1];   /* [tiles]: of R, G, B and the pixels; REPLAY_MEANS */
    double *cpu_ns;                                       /* [tiles], of one sample of every pixel of the tile */
};

/* A seed of a recording, at the exposure at which the logarithmic mean of the seed's whole picture
 * is 0.18: as a job at an exposure of its own. */
void replay_read(struct replay *out, const char *path, uint32_t seed, unsigned keep);

/* The same of a seed that is rendered here, with `samples` samples a group, each group at the exposure
 * of its level 0; no errors. */
void replay_render(struct replay *out, const struct render_scene *scene, const struct render_settings *settings,
                   uint32_t seed, uint32_t samples);
void replay_release(struct replay *replay);

/* Ways to go wrong: what the test of unbiasedness must notice. */
enum replay_fault {
    REPLAY_RIGHT,
    REPLAY_OWN_SAMPLES,       /* a group is decided by its own floor */
    REPLAY_OTHERS_ALL_SAMPLES, /* by all that the other group has by then, not its floor alone */
    REPLAY_ENDED_GROWS        /* a group that ended takes the floor that the other still asks for */
};

/* Run the rounds 0 .. last_level; target: NULL or where each group ends. passes[g][tile], cut at
 * the seed's own. Returns whether both groups met the target, and nothing was cut. */
int replay_rounds(const struct replay *decides, const struct allocation_rules *rules,
                  const struct allocation_target *target, uint32_t last_level, enum replay_fault fault,
                  uint32_t *const passes[RECORD_GROUPS]);

struct replay_errors {
    double square;  /* mean over pixels and channels of the squared error in codes */
    double display; /* 95 % of the pixels' largest channel are within so many codes */
};
/* Of the joined picture whose group g has passes[g][tile] passes. */
struct replay_errors replay_errors(const struct replay *replay, uint32_t *const passes[RECORD_GROUPS]);

/* What such a picture reports of itself. */
void replay_reported(const struct replay *replay, uint32_t *const passes[RECORD_GROUPS], struct accuracy_figures *out);

/* CPU seconds of such a picture. */
double replay_cost(const struct replay *replay, uint32_t *const passes[RECORD_GROUPS]);
