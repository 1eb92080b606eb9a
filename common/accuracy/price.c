#include "common/accuracy/price.h"

#include <math.h>

#include "common/math/elementary.h"

#define NORMAL_95 1.959963984540054

static double work_of(const struct price_point *p, int by_rays) { return by_rays ? p->rays : p->samples; }

/* Of the work between the first and the last point, if that is much of it. */
static double work_cost(const struct price_point *points, size_t count, int by_rays)
{
    const struct price_point *first = &points[0], *last = &points[count - 1];
    double work = work_of(last, by_rays) - work_of(first, by_rays), core_s = last->core_s - first->core_s;

    if (work > work_of(last, by_rays) / 4 && core_s > 0)
        return core_s / work;
    return work_of(last, by_rays) > 0 ? last->core_s / work_of(last, by_rays) : 0;
}

/* What the picture is off the law makes its error no less known, but says less of the law. */
static void widen(struct accuracy_point *p, double uneven)
{
    double own = p->lo > 0 && p->hi > p->lo ? det_log_d(p->hi / p->lo) / 2 : 0;
    double wide = det_exp_d(sqrt(own * own + NORMAL_95 * NORMAL_95 * uneven * uneven));

    if (uneven > 0 && p->error > 0) {
        p->lo = p->error / wide;
        p->hi = p->error * wide;
    }
}

void prices_fit(struct prices *out, const struct price_point *points, size_t count, enum allocation_measure measure)
{
    struct accuracy_point curve[ACCURACY_POINTS_MAX];

    *out = (struct prices){.by_rays = 1};
    if (count > ACCURACY_POINTS_MAX) {
        points += count - ACCURACY_POINTS_MAX;
        count = ACCURACY_POINTS_MAX;
    }
    for (size_t i = 0; i < count; i++)
        out->by_rays &= points[i].rays > 0;
    for (size_t i = 0; i < count; i++) {
        curve[i] = target_point(&points[i].figures, work_of(&points[i], out->by_rays), measure);
        widen(&curve[i], points[i].uneven);
    }
    accuracy_curve_fit(&out->curve, curve, count);
    if (out->curve.points == 0)
        return;
    out->core_s = points[count - 1].core_s;
    out->work = work_of(&points[count - 1], out->by_rays);
    out->work_core_s = work_cost(points, count, out->by_rays);
}

static double core_s_of(const struct prices *prices, double work)
{
    return fmax(prices->core_s + (work - prices->work) * prices->work_core_s, 0);
}

struct accuracy_estimate prices_cost(const struct prices *prices, double error)
{
    struct accuracy_estimate work = accuracy_curve_cost(&prices->curve, error);

    if (isnan(work.value))
        return work;
    return (struct accuracy_estimate){core_s_of(prices, work.value), core_s_of(prices, work.lo),
                                      core_s_of(prices, work.hi)};
}

struct accuracy_estimate prices_target(const struct prices *prices, const struct allocation_target *target)
{
    return prices_cost(prices, PRICE_STOP * target_error(target));
}

struct accuracy_estimate prices_error(const struct prices *prices, double core_s)
{
    double work = prices->work;

    if (prices->work_core_s > 0)
        work += (core_s - prices->core_s) / prices->work_core_s;
    return accuracy_curve_error(&prices->curve, fmax(work, 1));
}

int prices_are_known(struct accuracy_estimate more) { return more.lo > 0 && more.hi <= PRICE_WIDTH * more.lo; }
