/* curve: what accuracy costs, as a power law through a frame's own figures.
 *
 *     ln error = a - b ln cost
 *
 * fitted by least squares with two kinds of knowledge beside the points: b is about 1/2 (that of independent samples; a
 * Sobol' sequence may do better, a scene of rare paths does worse), and the law is only locally one,
 * so that a point counts less the further it lies from the last.
 * Costs are of any unit that is proportional to the work, core-seconds say; errors of any unit too. */
#ifndef AZULEJO_ACCURACY_CURVE_H
#define AZULEJO_ACCURACY_CURVE_H

#include <stddef.h>

enum { ACCURACY_POINTS_MAX = 64 };

struct accuracy_point {
    double cost, error;    /* both > 0, or the point is left out */
    double lo, hi;         /* 95 % interval of the error; 0, 0: not known */
};

struct accuracy_curve {
    size_t points;         /* that count; 0: nothing is known */
    double pivot;          /* ln of the last point's cost */
    double level, slope;   /* ln error at the pivot; b */
    double variance[3];    /* of level, of slope, and their covariance */
};

/* Points in the order of growing cost; more than ACCURACY_POINTS_MAX: the last ones. */
void accuracy_curve_fit(struct accuracy_curve *out, const struct accuracy_point *points,
                        size_t count);

struct accuracy_estimate {
    double value, lo, hi;  /* 95 % interval; NaN: not known */
};

/* b and its interval. */
struct accuracy_estimate accuracy_curve_exponent(const struct accuracy_curve *curve);
/* The error after this cost. */
struct accuracy_estimate accuracy_curve_error(const struct accuracy_curve *curve, double cost);
/* The cost, from nothing, of this error. `hi` may be INFINITY. */
struct accuracy_estimate accuracy_curve_cost(const struct accuracy_curve *curve, double error);

#endif
