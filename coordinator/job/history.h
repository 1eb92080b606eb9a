/* history: a frame's error, how it decreased, and what that cost.
 *
 * A frame has few points, however long it is rendered: a new one replaces the last, unless the
 * samples have grown by HISTORY_RATIO between the last and the one before it.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/accuracy/target.h"

enum { HISTORY_MAX = 48 };
#define HISTORY_GROWN 1.3        /* a trend is over so many times the samples */
#define HISTORY_RATIO 1.41421356 /* 4 to 2^20 samples a pixel are 37 points */

struct history_point {
    double core_s, wall_s;            /* spent on the frame so far */
    uint64_t samples, rays;           /* of all its pixels */
    double uneven;                    /* film_unevenness(); 0: not known */
    struct accuracy_figures figures;  /* of these samples */
    struct accuracy_figures denoised; /* of the picture without their noise; not known: it was not made */
};

/* How long a frame has been rendered, over all runs: the one clock that its limits and its history go by. */
struct frame_clock {
    uint64_t active_ns;                   /* since the first lease */
    uint64_t cpu_ns;                      /* of results */
    uint64_t from_active_ns, from_cpu_ns; /* at its last extension: limits count from there */
};

struct history {
    uint32_t count;
    struct history_point points[HISTORY_MAX]; /* ascending samples */
};

/* Returns the point's place. */
uint32_t history_add(struct history *history, const struct history_point *point);
const struct history_point *history_last(const struct history *history); /* NULL: none */

/* d ln display error / d ln samples between the last point and the newest one whose samples it has HISTORY_GROWN times;
 * NaN: not known. */
double history_slope(const struct history *history);

/* The frames of a job, as far as they are known. */
struct job_figures {
    /* Of each frame, from the job's first on, by enum allocation_measure (target.h); NaN: not known. NULL: none is. */
    float (*errors)[ALLOCATION_MEASURES];
    uint32_t known;            /* how many are known */
    double core_s;             /* spent on the frames that are done */
    struct history_point last; /* of the first frame that rests, or else the newest that is done; unknown: of none */
    uint32_t last_frame;       /* its index */
};

/* Note a finished frame's last point, once. 0: out of memory, and its figures are not noted. */
int job_figures_note(struct job_figures *job, uint32_t index, uint32_t count, const struct history_point *point);
void job_figures_set_last(struct job_figures *job, uint32_t index, const struct history_point *point); /* NULL: none */
void job_figures_release(struct job_figures *job);
/* The largest display error, and its frame's index; NaN: none is known. */
double job_figures_worst(const struct job_figures *job, uint32_t count, uint32_t *index);
/* The largest error of the difference between a frame and the next (flicker), and the first one's
 * index. Their samples are independent, so the squares of their errors add (docs/ACCURACY.md, Flicker). */
double job_figures_flicker(const struct job_figures *job, uint32_t count, uint32_t *index);
/* Does the frame miss the target? 0 if its error is not known. */
int job_figures_misses(const struct job_figures *job, uint32_t index, const struct allocation_target *target);
/* The largest error (target.h) of the frames that miss the target, and its frame's index; NaN: none does. */
double job_figures_missed(const struct job_figures *job, uint32_t count, const struct allocation_target *target,
                          uint32_t *index);
/* Root mean square of the frames' display errors; NaN: none is known. */
double job_figures_mean(const struct job_figures *job, uint32_t count);
