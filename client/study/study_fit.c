/* The power law through measured points, and whether it would have predicted them. */
#include <math.h>

#include "client/study/run.h"

/* ln of a point's error, and its uncertainty. */
static int log_point(const struct study_point *p, double *x, double *y, double *weight)
{
    double width = (p->codes.high - p->codes.low) / (2 * p->codes.value * 1.96);

    if (!(p->core_s > 0) || !(p->codes.value > 0))
        return 0;
    *x = log(p->core_s);
    *y = log(p->codes.value);
    /* At least 2 %: the law is only a model, and one point must not outweigh all others. */
    width = isfinite(width) ? fmax(width, 0.02) : 1;
    *weight = 1 / (width * width);
    return 1;
}

void study_fit_points(struct study_fit *fit, const struct study_point *points, size_t count)
{
    double w_sum = 0, x_mean = 0, y_mean = 0, xx = 0, xy = 0, squares = 0;
    double slope, scatter, t, at_pivot;
    unsigned used = 0;
    double x, y, w;

    *fit = (struct study_fit){{NAN, NAN, NAN}, NAN, {NAN, NAN, NAN}};
    for (size_t i = 0; i < count; i++)
        if (log_point(&points[i], &x, &y, &w)) {
            w_sum += w;
            x_mean += w * x;
            y_mean += w * y;
            used++;
        }
    if (used < 3)
        return;
    x_mean /= w_sum;
    y_mean /= w_sum;
    for (size_t i = 0; i < count; i++)
        if (log_point(&points[i], &x, &y, &w)) {
            xx += w * (x - x_mean) * (x - x_mean);
            xy += w * (x - x_mean) * (y - y_mean);
        }
    if (!(xx > 0))
        return;
    slope = xy / xx;
    for (size_t i = 0; i < count; i++)
        if (log_point(&points[i], &x, &y, &w))
            squares += w * pow(y - y_mean - slope * (x - x_mean), 2);
    /* The points' own uncertainty, or their scatter around the law if that is larger. */
    scatter = sqrt(fmax(1, squares / (used - 2)));
    t = scatter > 1 ? student_t95(used - 2) : 1.96;
    at_pivot = t * scatter / sqrt(w_sum);
    fit->exponent = (struct study_interval){-slope, -slope - t * scatter / sqrt(xx),
                                            -slope + t * scatter / sqrt(xx)};
    fit->pivot_core_s = exp(x_mean);
    fit->codes_at_pivot = (struct study_interval){exp(y_mean), exp(y_mean - at_pivot),
                                                  exp(y_mean + at_pivot)};
}
