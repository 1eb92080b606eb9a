#include "common/accuracy/curve.h"

#include <math.h>

#include "common/base/safeguard.h"
#include "common/math/elementary.h"

#define NORMAL_95 1.959963984540054
/* Prior of b, before any point is known: 1/2 is that of independent samples. */
#define SLOPE 0.5
#define SLOPE_SPREAD 0.25
/* Whole renders of real scenes fall with 0.3 to 0.9 (docs/ACCURACY.md). Points taken half way
 * through a frame, when its tiles differ in samples, can look far steeper and would promise too
 * much. */
#define SLOPE_MIN 0.25
#define SLOPE_MAX 1.0
/* All in ln error: the smallest deviation of a point from the law; what is added to it for a point
 * a factor e of cost before the last one, growing with the square of that distance; and how far the
 * law may be off a factor e of cost further on. Chosen on `make accuracy`: the slope changes from
 * scene to scene and within a scene, and the last doublings predict the next ones better than the
 * first do. */
#define POINT_SPREAD 0.01
#define MEMORY 0.2
#define DRIFT 0.1
/* Of a point's own without an interval. */
#define UNKNOWN_SPREAD 0.05

static double spread_of(const struct accuracy_point *p, double distance)
{
    double own = p->lo > 0 && p->hi > p->lo && isfinite(p->hi)
                     ? det_log_d(p->hi / p->lo) / (2 * NORMAL_95)
                     : UNKNOWN_SPREAD;
    double drift = MEMORY * distance * distance;

    return sqrt(own * own + POINT_SPREAD * POINT_SPREAD + drift * drift);
}

static int counts(const struct accuracy_point *p)
{
    return (p->cost > 0 && p->error > 0 && isfinite(p->cost) && isfinite(p->error)) ||
           !SAFEGUARD(CURVE_POINT);
}

void accuracy_curve_fit(struct accuracy_curve *out, const struct accuracy_point *points,
                        size_t count)
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

static struct accuracy_estimate nothing(void)
{
    return (struct accuracy_estimate){NAN, NAN, NAN};
}

struct accuracy_estimate accuracy_curve_exponent(const struct accuracy_curve *curve)
{
    double spread = NORMAL_95 * sqrt(curve->variance[1]);

    if (curve->points == 0)
        return nothing();
    return (struct accuracy_estimate){curve->slope, curve->slope - spread, curve->slope + spread};
}

/* The standard deviation of ln error at `distance` = ln cost - pivot, including the law's drift. */
static double deviation_at(const struct accuracy_curve *curve, double distance)
{
    double drift = DRIFT * distance;

    return sqrt(curve->variance[0] + distance * distance * curve->variance[1] -
                2 * distance * curve->variance[2] + drift * drift);
}

struct accuracy_estimate accuracy_curve_error(const struct accuracy_curve *curve, double cost)
{
    double distance, value, spread;

    if (curve->points == 0 || !(cost > 0))
        return nothing();
    distance = det_log_d(cost) - curve->pivot;
    value = det_exp_d(curve->level - curve->slope * distance);
    spread = det_exp_d(NORMAL_95 * deviation_at(curve, distance));
    return (struct accuracy_estimate){value, value / spread, value * spread};
}

struct accuracy_estimate accuracy_curve_cost(const struct accuracy_curve *curve, double error)
{
    double distance, spread, least, most, fall, off;

    if (curve->points == 0 || !(error > 0) || !(curve->slope > 0))
        return nothing();
    fall = curve->level - det_log_d(error); /* of ln error, from the last point on */
    off = NORMAL_95 * sqrt(curve->variance[0]);
    distance = fall / curve->slope;
    spread = NORMAL_95 * deviation_at(curve, distance) / curve->slope;
    least = distance - spread;
    most = distance + spread;
    /* Limit the slope to what pictures show. */
    if (fall > off) {
        least = fmax(least, (fall - off) / SLOPE_MAX);
        most = fmin(most, (fall + off) / SLOPE_MIN);
    }
    return (struct accuracy_estimate){det_exp_d(curve->pivot + distance),
                                      det_exp_d(curve->pivot + least),
                                      det_exp_d(curve->pivot + most)};
}
