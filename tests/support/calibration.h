/* calibration: pictures of one scene by many seeds, at growing numbers of samples, and a reference:
 * what estimates of error are checked against. Rendered in process, or read from a file. */
#pragma once

#include "common/base/status.h"
#include "tests/support/recording.h"

enum {
    CALIBRATION_LEVELS_MAX = 12,
    CALIBRATION_REFERENCE_SEED = 1000000, /* its seeds begin here */
};

/* What one seed shows at one level: 4 << level samples of a pixel over both groups. */
struct calibration_view {
    float *groups[RECORD_GROUPS]; /* means [height][width][3] */
    struct record_tail *tails;    /* [tiles][groups][RECORD_TAIL_MAX], descending, then zeros */
    uint64_t rays, cpu_ns;        /* so far */
};

struct calibration {
    uint32_t width, height, seeds, levels;
    uint32_t reference_seeds, reference_spp; /* samples of a pixel of each of them */
    struct calibration_view *views;          /* [seeds][levels] */
    float **references;                      /* [reference_seeds * RECORD_GROUPS] means */
    float *subject;                          /* [height][width]: share of a pixel's samples that see the subject */
    double cpu_s;                            /* that all of it took */
    uint64_t effects;                        /* calibration_describe: that the frame calls for, */
    double brightest;                        /* and accuracy_brightest() */
};

struct calibration_size {
    uint32_t width, height, seeds, first_seed, levels, reference_seeds, reference_spp;
};

/* The samples of a pixel at a level, over both groups. */
static inline uint32_t calibration_spp(uint32_t level) { return 4u << level; }

/* `scene_path` with these sizes; `env`: an environment map or NULL. Aborts the program where the scene cannot be rendered. */
void calibration_render(struct calibration *c, const char *scene_path, const char *env, const struct calibration_size *size);
/* 0: there is no such file, or it is of other sizes. reference_seeds 0 takes any reference. */
int calibration_load(struct calibration *c, const char *path, const struct calibration_size *size);
/* Effects and the brightest light, which files do not hold. */
void calibration_describe(struct calibration *c, const char *scene_path, const char *env);
void calibration_save(const struct calibration *c, const char *path, const struct calibration_size *size);
void calibration_release(struct calibration *c);

/* The mean of everything but `seed`'s pictures: [height][width][3] into `mean`, and the expected squared
 * error of that mean, summed over the picture's values. `seed` < c->seeds. */
double calibration_truth(const struct calibration *c, uint32_t seed, double *mean);
