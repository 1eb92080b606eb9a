/* The figures behind the sentences and the plots: the cost of errors, and the importance of choices. */
#include <math.h>

#include "client/study/data/study_words.h"
#include "common/accuracy/curve.h"

#define LONG_S 1.0 /* wall-clock: shorter times do not show how many cores work */
#define NORMAL_95 1.959963984540054
/* A study has some thirty ways, of whose 95 % intervals more than one is wrong by chance. So much wider ones (99.8 %)
 * hold for all of them together. */
#define MANY 1.58
enum { TILES_MIN = 100, TILE = 16 };

int study_has_fit(const struct study *s)
{
    const struct study_fit *f = &s->fit;

    return f->exponent.value > 0 && isfinite(f->exponent.value) && f->pivot_core_s > 0 && isfinite(f->pivot_core_s) &&
           f->codes_at_pivot.value > 0 && isfinite(f->codes_at_pivot.value);
}

static struct accuracy_estimate estimate_of(const struct study_interval *i)
{
    return (struct accuracy_estimate){i->value, i->low, i->high};
}

struct study_interval study_codes_after(const struct study *s, double core_s)
{
    const struct study_fit *f = &s->fit;
    struct study_interval out = {NAN, NAN, NAN};
    struct accuracy_curve curve;
    struct accuracy_estimate at;
    double start_s;

    if (!study_has_fit(s) || !(core_s > 0))
        return out;
    start_s = f->start_core_s > 0 && f->start_core_s < f->pivot_core_s ? f->start_core_s : 0;
    if (!(core_s > start_s))
        return out;
    accuracy_curve_set(&curve, f->pivot_core_s - start_s, estimate_of(&f->codes_at_pivot), estimate_of(&f->exponent));
    at = accuracy_curve_error(&curve, core_s - start_s);
    return (struct study_interval){at.value, at.lo, at.hi};
}

/* When a curve of the fit (0: the line, -1: its lower edge, 1: its upper) falls to `codes`. */
static double cost_on(const struct study *s, double codes, int edge)
{
    /* Errors before the first ray are not known, and larger than any. */
    double low = log(s->fit.pivot_core_s) - 60, high = low + 120;

    for (int i = 0; i < 100; i++) {
        const double middle = (low + high) / 2;
        const struct study_interval at = study_codes_after(s, exp(middle));
        const double error = edge == 0 ? at.value : edge < 0 ? at.low : at.high;

        if (!(error <= codes))
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
    if (s->fit.exponent.low > 0 && isfinite(s->fit.exponent.high) && s->fit.codes_at_pivot.low > 0 &&
        isfinite(s->fit.codes_at_pivot.high)) {
        out.low = cost_on(s, codes, -1);
        out.high = cost_on(s, codes, 1);
        if (s->clock_noise > 0) { /* the next picture's time is as uncertain as the last one's */
            out.low = out.value * exp(-hypot(log(out.value / out.low), NORMAL_95 * s->clock_noise));
            out.high = out.value * exp(hypot(log(out.high / out.value), NORMAL_95 * s->clock_noise));
        }
    }
    return out;
}

const struct study_choice *study_by_target(const struct study *s)
{
    for (size_t i = 0; i < s->questions.count; i++)
        for (size_t k = 0; k < s->questions.items[i].choices.count; k++) {
            const struct study_choice *c = &s->questions.items[i].choices.items[k];
            if (c->by_target && !c->baseline && !c->missed && c->gain.value > 0 && study_time_differs(c))
                return c;
        }
    return NULL;
}

static double together(double a, double b) { return exp(hypot(log(a), log(b))); }

struct study_interval study_headline_cost(const struct study *s)
{
    const struct study_choice *c = study_by_target(s);
    struct study_interval cost = study_target_cost(s);

    if (!c || !isfinite(cost.value))
        return cost;
    return (struct study_interval){
        cost.value / c->gain.value,
        cost.value / c->gain.value / together(cost.value / cost.low, c->gain.high / c->gain.value),
        cost.value / c->gain.value * together(cost.high / cost.value, c->gain.value / c->gain.low)};
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

struct study_interval study_sure_gain(const struct study_choice *c)
{
    const struct study_interval *g = &c->gain;

    return (struct study_interval){g->value, g->value * pow(g->low / g->value, MANY), g->value * pow(g->high / g->value, MANY)};
}

int study_time_differs(const struct study_choice *c)
{
    const struct study_interval sure = study_sure_gain(c);

    return sure.low > 1.05 || sure.high < 1 / 1.05;
}

double study_tiles(const struct study *s) { return ceil(s->width / TILE) * ceil(s->height / TILE); }

int study_is_small(const struct study *s) { return study_tiles(s) < TILES_MIN; }

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

        while (at > 0 && (weight[i] > weight[out[at - 1]] || (isnan(weight[out[at - 1]]) && !isnan(weight[i])))) {
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
