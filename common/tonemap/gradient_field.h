/* gradient_field: the plane whose differences, at all scales, are closest to the wanted ones. Private to
 * common/tonemap.
 *
 * A pyramid of a plane: level 0 is the plane, each next one has half the pixels of each side, every one the mean of
 * what it covers (2x2 of them; for odd sides slightly more). It ends before a side is shorter than 3 pixels, as the
 * authors' does; that of a strip continues. Every two neighbours of every level have a wanted difference and a weight.
 * Conjugate gradients find the plane x that minimises
 *
 *     sum over levels l of 4^l sum over neighbours of weight (difference(x_l) - wanted)^2
 *
 * The 4^l (exactly: the ratio of the numbers of pixels) makes slow and fast changes equally stiff, so that a few dozen
 * steps are enough for any size. x is found up to a constant, which stays that of the starting plane. Sums are over
 * lines, then over lines in order: the result is the same with any number of threads.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/base/status.h"

enum {
    GRADIENT_LEVELS_MAX = 18,
    GRADIENT_RUN = 256,       /* neighbours that are processed at a time */
    GRADIENT_STRIPES = 16,    /* parts that gradient_field_visit distinguishes */
};

struct gradient_level {
    uint32_t width, height;
    float *weight_x, *weight_y; /* of a pixel and its right and lower neighbour; 0: no neighbour */
    float *value, *sum;         /* of level 0: the solver's planes */
};

struct gradient_field {
    struct gradient_level levels[GRADIENT_LEVELS_MAX];
    int level_count;
    unsigned threads;
    float *residual, *step, *product; /* of level 0's size */
    double *line_sums;
};

/* Differences of up to GRADIENT_RUN pixels to their right (x) and lower (y) neighbours, in; the
 * wanted ones and their weights (above 0), out. */
struct gradient_run {
    size_t count;
    float x[GRADIENT_RUN + 1], y[GRADIENT_RUN + 1];
    float weight_x[GRADIENT_RUN + 1], weight_y[GRADIENT_RUN + 1];
};

status gradient_field_init(struct gradient_field *f, uint32_t width, uint32_t height, unsigned threads,
                           struct error *err) MUST_CHECK;
void gradient_field_release(struct gradient_field *f);

/* Pass all differences of a plane to a callback, weights unset. Parts with different `stripe`
 * numbers are passed at the same time. */
void gradient_field_visit(struct gradient_field *f, const float *plane,
                          void (*see)(void *user, size_t stripe, const struct gradient_run *run), void *user);

/* Set the wanted differences to what `map` makes of a plane's differences. */
void gradient_field_want(struct gradient_field *f, const float *plane,
                         void (*map)(const void *user, struct gradient_run *run), const void *user);

/* Solve, once after each _want, starting from the best fitting multiple of x, until the residual is below `tolerance`
 * times the right side, or after `steps_max` steps. Returns the number of steps. */
int gradient_field_solve(struct gradient_field *f, float *x, double tolerance, int steps_max);
