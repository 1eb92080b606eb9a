/* curve: the cost of accuracy, as a power law through a frame's own figures.
 *
 *     ln error = a - b ln cost
 *
 * fitted by least squares with two kinds of prior knowledge: b is about 1/2 (that of independent samples; a Sobol'
 * sequence may do better, a scene of rare paths does worse), and the law holds only locally, so a point counts less the
 * further it is from the last one. For the same reason b goes back to 1/2 beyond the last point, within a few doublings.
 * Costs may be in any unit proportional to the work: samples, rays; errors in any unit. */
#pragma once

#include <stddef.h>

enum { ACCURACY_POINTS_MAX = 64 };

struct accuracy_point {
    double cost, error; /* both > 0; otherwise the point is left out */
    double lo, hi;      /* 95 % interval of the error; 0, 0: not known */
};

struct accuracy_curve {
    size_t points;       /* that are used; 0: nothing is known */
    double pivot;        /* ln of the last point's cost */
    double level, slope; /* ln error at the pivot; b */
    double variance[3];  /* of level, of slope, and their covariance */
};

/* Points in order of increasing cost; more than ACCURACY_POINTS_MAX: the last ones are used. */
void accuracy_curve_fit(struct accuracy_curve *out, const struct accuracy_point *points, size_t count);

struct accuracy_estimate {
    double value, lo, hi; /* 95 % interval; NaN: not known */
};

/* The curve that accuracy_curve_error says this of at this cost, and accuracy_curve_exponent that. */
void accuracy_curve_set(struct accuracy_curve *out, double cost, struct accuracy_estimate error,
                        struct accuracy_estimate exponent);

/* b and its interval. */
struct accuracy_estimate accuracy_curve_exponent(const struct accuracy_curve *curve);
/* The error after this cost. */
struct accuracy_estimate accuracy_curve_error(const struct accuracy_curve *curve, double cost);
/* The total cost of this error. `hi` may be INFINITY. */
struct accuracy_estimate accuracy_curve_cost(const struct accuracy_curve *curve, double error);
