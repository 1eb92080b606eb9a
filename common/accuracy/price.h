/* price: what a smaller error will cost, from a frame's figures so far. The one law behind every price that is shown: the
 * line, `estimate`, the page's curve, the time left to a target.
 *
 * The curve (curve.h) is over work: the rays of the frame, or its samples where no rays were counted. Work is a function of
 * the picture, while processor time has the start of the programs in it and depends on what else the machine does. What a
 * unit of work costs is measured between the first and the last point, so the start counts once, as spent. */
#pragma once

#include "common/accuracy/target.h"

struct price_point {
    double core_s, samples, rays; /* so far */
    double uneven;                /* film_unevenness(); 0: its tiles are equally far, or it is not known */
    struct accuracy_figures figures;
};

struct prices {
    struct accuracy_curve curve; /* over work; no points: nothing is known */
    double core_s, work;         /* of the last point */
    double work_core_s;          /* core-seconds of a unit of work; 0: not known */
    int by_rays;
};

/* Points in order of increasing work. */
void prices_fit(struct prices *out, const struct price_point *points, size_t count, enum allocation_measure measure);

/* Core-seconds of the frame, from its start, at this error (target.h). */
struct accuracy_estimate prices_cost(const struct prices *prices, double error);
/* What frames that end by a target have on average, over it: a tile's samples come in doublings (docs/ACCURACY.md). */
#define PRICE_STOP 0.84
/* The same of a frame that ends by this target: it ends a little below it (PRICE_STOP). */
struct accuracy_estimate prices_target(const struct prices *prices, const struct allocation_target *target);
/* The error after so many core-seconds of the frame. */
struct accuracy_estimate prices_error(const struct prices *prices, double core_s);
/* Is it known well enough for one number? 0: the interval spans more than a factor of PRICE_WIDTH, and it is too early to say. */
#define PRICE_WIDTH 10.0
int prices_are_known(struct accuracy_estimate more);
