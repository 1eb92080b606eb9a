#include "common/accuracy/curve.h"

#include <math.h>

#include "common/base/safeguard.h"
#include "common/math/elementary.h"

#define NORMAL_95 1.959963984540054
/* Prior of b, before any point is known: 1/2 is that of independent samples. */
#define SLOPE 0.5
#define SLOPE_SPREAD 0.25
/* Whole renders of real scenes fall with 0.3 to 0.9 (docs/ACCURACY.md). Points taken half way through a frame, when its
 * tiles differ in samples, can look far steeper and would promise too much. */
#define SLOPE_MIN 0.25
#define SLOPE_MAX 1.0
/* All in ln error: the smallest deviation of a point from the law; what is added to it for a point a factor e of cost
 * before the last one, growing with the square of that distance; and how far the law may be off a factor e of cost
 * further on. Chosen on `make accuracy`: the slope changes from scene to scene and within a scene, and the last
 * doublings predict the next ones better than the first do. */
#define POINT_SPREAD 0.01
#define MEMORY 0.2
#define DRIFT 0.07
/* Beyond the last point the slope goes back to SLOPE: by 1 - 1/e after so much of ln cost, 16 times the cost. */
#define RETURN 2.8
/* Of a deviation that the points' own intervals give: they are mostly off alike, as the next ones will be. */
#define COMMON 0.65
/* Of ln cost on both sides of the last point, and how often that is halved to find an error's. */
#define FARTHEST 64.0
enum { HALVINGS = 60 };
/* Of a point's own without an interval. */
#define UNKNOWN_SPREAD 0.05

static double spread_of(const struct accuracy_point *p, double distance)
{
    double own =
        p->lo > 0 && p->hi > p->lo && isfinite(p->hi) ? det_log_d(p->hi / p->lo) / (2 * NORMAL_95) : UNKNOWN_SPREAD;
    double drift = MEMORY * distance * distance;

    return sqrt(own * own + POINT_SPREAD * POINT_SPREAD + drift * drift);
}

static int counts(const struct accuracy_point *p)
{
    return (p->cost > 0 && p->error > 0 && isfinite(p->cost) && isfinite(p->error)) || !SAFEGUARD(CURVE_POINT);
}

void accuracy_curve_fit(struct accuracy_curve *out, const struct accuracy_point *points, size_t count)
{
    /* Normal equations of (level, slope), x = pivot - ln cost. */
    double ww = 0, wx = 0, wxx = 1 / (SLOPE_SPREAD * SLOPE_SPREAD), wy = 0, wxy = wxx * SLOPE;
    double determinant;

    *out = (struct accuracy_curve){.points = 0};
    if (count > ACCURACY_POINTS_MAX) {
        points += count - ACCURACY_POINTS_MAX;
        count = ACCURACY_POINTS_MAX;
    }
    for (size_t i = 0; i < count; i++)
        if (counts(&points[i]))
            out->pivot = det_log_d(points[i].cost);
    for (size_t i = 0; i < count; i++)
        if (counts(&points[i])) {
            double x = out->pivot - det_log_d(points[i].cost), y = det_log_d(points[i].error);
            double s = spread_of(&points[i], x), w = 1 / (s * s);
            ww += w;
            wx += w * x;
            wxx += w * x * x;
            wy += w * y;
            wxy += w * x * y;
            out->points++;
        }
    if (out->points == 0)
        return;
    determinant = ww * wxx - wx * wx;
    out->slope = (ww * wxy - wx * wy) / determinant;
    out->slope = out->slope < SLOPE_MIN ? SLOPE_MIN : out->slope > SLOPE_MAX ? SLOPE_MAX : out->slope;
    out->level = (wy - out->slope * wx) / ww; /* the best level for that slope */
    out->variance[0] = wxx / determinant;
    out->variance[1] = ww / determinant;
    out->variance[2] = -wx / determinant;
}

static double square(double x) { return x * x; }

void accuracy_curve_set(struct accuracy_curve *out, double cost, struct accuracy_estimate error,
                        struct accuracy_estimate exponent)
{
    *out = (struct accuracy_curve){
        .points = 1, .pivot = det_log_d(cost), .level = det_log_d(error.value), .slope = exponent.value,
        .variance = {square(det_log_d(error.hi / error.lo) / (2 * NORMAL_95 * COMMON)),
                     square((exponent.hi - exponent.lo) / (2 * NORMAL_95)), 0}};
}

static struct accuracy_estimate nothing(void) { return (struct accuracy_estimate){NAN, NAN, NAN}; }

struct accuracy_estimate accuracy_curve_exponent(const struct accuracy_curve *curve)
{
    double spread = NORMAL_95 * sqrt(curve->variance[1]);

    if (curve->points == 0)
        return nothing();
    return (struct accuracy_estimate){curve->slope, curve->slope - spread, curve->slope + spread};
}

/* `distance` = ln cost - pivot, as far as the last points' slope reaches. */
static double reach(double distance) { return distance > 0 ? RETURN * (1 - det_exp_d(-distance / RETURN)) : distance; }

/* By how much ln error falls from the last point on. */
static double fall_at(const struct accuracy_curve *curve, double distance)
{
    double near = reach(distance);

    return curve->slope * near + SLOPE * (distance - near);
}

/* The standard deviation of ln error at `distance`, including the law's drift. */
static double deviation_at(const struct accuracy_curve *curve, double distance)
{
    double drift = DRIFT * distance, near = reach(distance);

    return COMMON *
           sqrt(curve->variance[0] + near * near * curve->variance[1] - 2 * near * curve->variance[2] + drift * drift);
}

struct accuracy_estimate accuracy_curve_error(const struct accuracy_curve *curve, double cost)
{
    double distance, value, spread;

    if (curve->points == 0 || !(cost > 0))
        return nothing();
    distance = det_log_d(cost) - curve->pivot;
    value = det_exp_d(curve->level - fall_at(curve, distance));
    spread = det_exp_d(NORMAL_95 * deviation_at(curve, distance));
    return (struct accuracy_estimate){value, value / spread, value * spread};
}

/* The cost from which on the error is below this one, if it is so many deviations above the law. */
static double cost_at(const struct accuracy_curve *curve, double error, double deviations)
{
    double fall = curve->level - det_log_d(error), low = -FARTHEST, high = FARTHEST;

    for (int i = 0; i < HALVINGS; i++) {
        double middle = (low + high) / 2;
        if (fall_at(curve, middle) - deviations * deviation_at(curve, middle) < fall)
            low = middle;
        else
            high = middle;
    }
    return high == FARTHEST ? INFINITY : det_exp_d(curve->pivot + high);
}

struct accuracy_estimate accuracy_curve_cost(const struct accuracy_curve *curve, double error)
{
    if (curve->points == 0 || !(error > 0) || !(curve->slope > 0))
        return nothing();
    return (struct accuracy_estimate){cost_at(curve, error, 0), cost_at(curve, error, -NORMAL_95),
                                      cost_at(curve, error, NORMAL_95)};
}
