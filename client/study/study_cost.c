/* The figures behind the sentences and the plots: the cost of errors, and the importance of
 * choices. */
#include <math.h>

#include "client/study/study_words.h"

#define LONG_S 1.0 /* wall-clock: shorter times do not show how many cores work */

int study_has_fit(const struct study *s)
{
    const struct study_fit *f = &s->fit;

    return f->exponent.value > 0 && isfinite(f->exponent.value) && f->pivot_core_s > 0 &&
           isfinite(f->pivot_core_s) && f->codes_at_pivot.value > 0 &&
           isfinite(f->codes_at_pivot.value);
}

struct study_interval study_codes_after(const struct study *s, double core_s)
{
    const struct study_fit *f = &s->fit;
    struct study_interval out = {NAN, NAN, NAN};
    double x, up, down;

    if (!study_has_fit(s) || !(core_s > 0))
        return out;
    x = log(core_s / f->pivot_core_s);
    out.value = f->codes_at_pivot.value * exp(-f->exponent.value * x);
    /* Where the exponent is too small, the error falls less after the pivot and grows less before. */
    up = x * (x > 0 ? f->exponent.value - f->exponent.low : f->exponent.high - f->exponent.value);
    down = x * (x > 0 ? f->exponent.high - f->exponent.value : f->exponent.value - f->exponent.low);
    out.high = out.value * exp(hypot(log(f->codes_at_pivot.high / f->codes_at_pivot.value), up));
    out.low = out.value * exp(-hypot(log(f->codes_at_pivot.value / f->codes_at_pivot.low), down));
    return out;
}

/* When a curve of the fit (0: the line, -1: its lower edge, 1: its upper) falls to `codes`. */
static double cost_on(const struct study *s, double codes, int edge)
{
    double low = log(s->fit.pivot_core_s) - 60, high = low + 120;

    for (int i = 0; i < 100; i++) {
        const double middle = (low + high) / 2;
        const struct study_interval at = study_codes_after(s, exp(middle));
        const double error = edge == 0 ? at.value : edge < 0 ? at.low : at.high;

        if (error > codes)
            low = middle;
        else
            high = middle;
    }
    return exp(low);
}

struct study_interval study_cost_of(const struct study *s, double codes)
{
    struct study_interval out = {NAN, NAN, NAN};

    if (!study_has_fit(s) || !(codes > 0))
        return out;
    out.value = cost_on(s, codes, 0);
    /* An exponent that may be 0 leaves the cost without a bound. */
    if (s->fit.exponent.low > 0 && isfinite(s->fit.exponent.high) &&
        s->fit.codes_at_pivot.low > 0 && isfinite(s->fit.codes_at_pivot.high)) {
        out.low = cost_on(s, codes, -1);
        out.high = cost_on(s, codes, 1);
    }
    return out;
}

struct study_interval study_target_cost(const struct study *s)
{
    return s->target_core_s.value > 0 ? s->target_core_s : study_cost_of(s, s->target_codes);
}

const struct study_point *study_last_point(const struct study *s)
{
    return s->points.count ? &s->points.items[s->points.count - 1] : NULL;
}

double study_rate(const struct study *s)
{
    const struct study_point *first = s->points.items, *last = study_last_point(s);

    /* A job's overhead on the farm is the same for a short picture as for a long one. */
    if (last && last->wall_s - first->wall_s >= LONG_S && last->core_s > first->core_s)
        return (last->core_s - first->core_s) / (last->wall_s - first->wall_s);
    return s->cores > 0 ? s->cores : last && last->core_s > 0 && last->wall_s > 0 ? last->core_s / last->wall_s : 1;
}

int study_time_differs(const struct study_choice *c)
{
    return c->gain.low > 1.05 || c->gain.high < 1 / 1.05;
}

int study_bias_counts(const struct study *s, const struct study_choice *c)
{
    return c->floor.low > 0 && c->floor.value > s->target_codes / 4;
}

double study_choice_weight(const struct study *s, const struct study_choice *c)
{
    double weight = 0;

    if (!isfinite(c->gain.value) && !isfinite(c->floor.value))
        return NAN;
    if (study_time_differs(c))
        weight += fabs(log(c->gain.value));
    if (study_bias_counts(s, c))
        weight += log(c->floor.value / (s->target_codes / 4));
    return weight;
}

double study_question_weight(const struct study *s, const struct study_question *q)
{
    double weight = NAN; /* fmax prefers a number */

    for (size_t i = 0; i < q->choices.count; i++)
        if (!q->choices.items[i].baseline)
            weight = fmax(weight, study_choice_weight(s, &q->choices.items[i]));
    return weight;
}

int study_effect_is_spare(const struct study *s, const struct study_effect *e)
{
    return e->bias.high < s->target_codes / 4;
}

/* Falling weights, unknown ones last; insertion sort, stable, for a handful. */
static void order_by(const double *weight, size_t count, size_t *out)
{
    for (size_t i = 0; i < count; i++) {
        size_t at = i;

        while (at > 0 && (weight[i] > weight[out[at - 1]] ||
                          (isnan(weight[out[at - 1]]) && !isnan(weight[i])))) {
            out[at] = out[at - 1];
            at--;
        }
        out[at] = i;
    }
}

void study_order_questions(const struct study *s, size_t *out)
{
    double weight[STUDY_LIST_MAX];

    for (size_t i = 0; i < s->questions.count; i++)
        weight[i] = study_question_weight(s, &s->questions.items[i]);
    order_by(weight, s->questions.count, out);
}

void study_order_effects(const struct study *s, size_t *out)
{
    double weight[STUDY_LIST_MAX];

    for (size_t i = 0; i < s->effects.count; i++) {
        const struct study_effect *e = &s->effects.items[i];
        /* Time saved per code of bias; less than a tenth of a code is not visible. */
        weight[i] = e->saved.value / fmax(0.1, e->bias.value);
    }
    order_by(weight, s->effects.count, out);
}
