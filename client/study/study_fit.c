/* The law of prices (common/accuracy/price.h) through measured points. */
#include <math.h>

#include "client/study/run.h"
#include "common/accuracy/price.h"

enum { POINTS_MIN = 3 };

static struct study_interval interval_of(struct accuracy_estimate e)
{
    return (struct study_interval){e.value, e.lo, e.hi};
}

/* Points whose work is not known have it by their time, with no start. */
static struct price_point price_point_of(const struct study_point *p, int work_known)
{
    return (struct price_point){
        .core_s = p->core_s, .samples = work_known ? p->samples : p->core_s, .rays = work_known ? p->rays : 0,
        .figures = {.known = 1, .display_error = p->codes.value, .display_lo = p->codes.low, .display_hi = p->codes.high}};
}

void study_fit_points(struct study_fit *fit, const struct study_point *points, size_t count)
{
    struct price_point known[RUN_POINTS_MAX];
    struct prices prices;
    size_t used = 0;
    int work_known = 1;

    *fit = (struct study_fit){{NAN, NAN, NAN}, NAN, NAN, {NAN, NAN, NAN}};
    for (size_t i = 0; i < count; i++)
        work_known &= points[i].samples > 0;
    for (size_t i = 0; i < count && used < RUN_POINTS_MAX; i++)
        if (points[i].core_s > 0 && points[i].codes.value > 0)
            known[used++] = price_point_of(&points[i], work_known);
    if (used < POINTS_MIN)
        return;
    prices_fit(&prices, known, used, ALLOCATION_DISPLAY);
    fit->exponent = interval_of(accuracy_curve_exponent(&prices.curve));
    fit->pivot_core_s = prices.core_s;
    fit->start_core_s = fmax(0, prices.core_s - prices.work * prices.work_core_s);
    fit->codes_at_pivot = interval_of(accuracy_curve_error(&prices.curve, prices.work));
}
