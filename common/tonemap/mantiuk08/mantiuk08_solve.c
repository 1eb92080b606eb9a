/* A small dense quadratic programme, by a primal-dual interior point method with the predictor and corrector of S.
 * Mehrotra, "On the Implementation of a Primal-Dual Interior Point Method", SIAM J. Optimization 2(4), 1992.
 *
 * With slack t of the sum and multipliers z (of d >= 0) and w (of the sum), the optimum is where
 *
 *   H d + f - z + w 1 = 0,   sum(d) + t = limit,   d z = 0,   t w = 0,   d, z, t, w >= 0.
 *
 * A Newton step eliminates all but d, which leaves (H + Z/D) + (w/t) 1 1'. H of a tone curve has a band around its
 * diagonal, so its Cholesky factor is cheap within its envelope. The full matrix 1 1' would fill it, and is included by
 * the Sherman-Morrison formula.
 */
#include <math.h>
#include <string.h>

#include "common/tonemap/mantiuk08/mantiuk08.h"

enum { ITERATIONS_MAX = 100 };

static const double TOLERANCE = 1e-10;
/* Share of the diagonal: makes what no equation determines well defined. */
static const double RIDGE = 1e-12;
/* The share of the way to the boundary that a step takes. */
static const double STEP_SHARE = 0.995;
/* A step below this length, or that leaves more than this share of the gap, is replaced by one
 * towards equal products, of this share of the gap. */
static const double STUCK = 0.1, PROGRESS = 0.9, CENTRING = 0.5;

struct point {
    double d[M08_SEGMENTS], z[M08_SEGMENTS], t, w;
};

static void find_envelope(struct m08_programme *p)
{
    for (size_t i = 0; i < p->count; i++)
        for (p->first[i] = 0; p->first[i] < i && p->h[i][p->first[i]] == 0.0;)
            p->first[i]++;
}

/* Factor H + ridge + diag(z / d). */
static void factorise(struct m08_programme *p, const struct point *at, double ridge)
{
    for (size_t i = 0; i < p->count; i++)
        for (size_t j = p->first[i]; j <= i; j++) {
            double sum = p->h[i][j];
            size_t k = p->first[i] > p->first[j] ? p->first[i] : p->first[j];

            if (i == j)
                sum += ridge + at->z[i] / at->d[i];
            for (; k < j; k++)
                sum -= p->factor[i][k] * p->factor[j][k];
            /* Rounding alone can make the last pivots of a semidefinite matrix vanish. */
            p->factor[i][j] = i == j ? sqrt(sum > ridge ? sum : ridge) : sum / p->factor[j][j];
        }
}

static void back_substitute(const struct m08_programme *p, double *x)
{
    for (size_t i = 0; i < p->count; i++) {
        for (size_t k = p->first[i]; k < i; k++)
            x[i] -= p->factor[i][k] * x[k];
        x[i] /= p->factor[i][i];
    }
    for (size_t i = p->count; i-- > 0;) {
        x[i] /= p->factor[i][i];
        for (size_t k = p->first[i]; k < i; k++)
            x[k] -= p->factor[i][k] * x[i];
    }
}

/* H d + f - z + w 1. */
static void dual_residual(const struct m08_programme *p, const struct point *at, double ridge, double *out)
{
    for (size_t i = 0; i < p->count; i++)
        out[i] = p->f[i] - at->z[i] + at->w + ridge * at->d[i];
    for (size_t i = 0; i < p->count; i++) {
        for (size_t j = p->first[i]; j < i; j++) {
            out[i] += p->h[i][j] * at->d[j];
            out[j] += p->h[i][j] * at->d[i];
        }
        out[i] += p->h[i][i] * at->d[i];
    }
}

static double sum_of(const double *values, size_t count)
{
    double sum = 0.0;

    for (size_t i = 0; i < count; i++)
        sum += values[i];
    return sum;
}

/* The residuals of a point, and M^-1 1 for the factored M. */
struct system {
    double dual[M08_SEGMENTS], primal;
    double ones[M08_SEGMENTS], ones_sum;
};

/* The Newton step after which d z = cd and t w = ct, to first order. */
static void newton_step(const struct m08_programme *p, const struct point *at, const struct system *sys,
                        const double *cd, double ct, struct point *step)
{
    double ratio = at->w / at->t, sum;

    for (size_t i = 0; i < p->count; i++)
        step->d[i] = cd[i] / at->d[i] - sys->dual[i] - (ct + at->w * sys->primal) / at->t;
    back_substitute(p, step->d);
    sum = sum_of(step->d, p->count) / (1.0 + ratio * sys->ones_sum);
    for (size_t i = 0; i < p->count; i++) {
        step->d[i] -= sys->ones[i] * ratio * sum;
        step->z[i] = (cd[i] - at->z[i] * step->d[i]) / at->d[i];
    }
    step->t = -sys->primal - sum;
    step->w = (ct - at->w * step->t) / at->t;
}

/* The longest step, up to 1, that keeps positive what must be positive. */
static double longest(const struct m08_programme *p, const struct point *at, const struct point *step)
{
    double length = 1.0;

    for (size_t i = 0; i < p->count; i++) {
        if (step->d[i] < 0.0)
            length = fmin(length, -at->d[i] / step->d[i]);
        if (step->z[i] < 0.0)
            length = fmin(length, -at->z[i] / step->z[i]);
    }
    if (step->t < 0.0)
        length = fmin(length, -at->t / step->t);
    if (step->w < 0.0)
        length = fmin(length, -at->w / step->w);
    return length;
}

/* The mean of the products that must vanish, `length` along the step. */
static double gap_after(const struct m08_programme *p, const struct point *at, const struct point *step, double length)
{
    double sum = (at->t + length * step->t) * (at->w + length * step->w);

    for (size_t i = 0; i < p->count; i++)
        sum += (at->d[i] + length * step->d[i]) * (at->z[i] + length * step->z[i]);
    return sum / (double)(p->count + 1);
}

static void move(const struct m08_programme *p, struct point *at, const struct point *step, double length)
{
    for (size_t i = 0; i < p->count; i++) {
        at->d[i] += length * step->d[i];
        at->z[i] += length * step->z[i];
    }
    at->t += length * step->t;
    at->w += length * step->w;
}

/* One predictor and corrector. */
static void improve(struct m08_programme *p, struct point *at, struct system *sys, double gap, double ridge)
{
    struct point step;
    double cd[M08_SEGMENTS], ct, centre, length;

    factorise(p, at, ridge);
    for (size_t i = 0; i < p->count; i++) {
        sys->ones[i] = 1.0;
        cd[i] = -at->d[i] * at->z[i];
    }
    back_substitute(p, sys->ones);
    sys->ones_sum = sum_of(sys->ones, p->count);
    ct = -at->t * at->w;
    newton_step(p, at, sys, cd, ct, &step);
    length = longest(p, at, &step);
    centre = gap_after(p, at, &step, length) / gap;
    centre = centre * centre * centre * gap;
    for (size_t i = 0; i < p->count; i++)
        cd[i] += centre - length * length * step.d[i] * step.z[i];
    ct += centre - length * length * step.t * step.w;
    newton_step(p, at, sys, cd, ct, &step);
    length = fmin(1.0, STEP_SHARE * longest(p, at, &step));
    if (length < STUCK || gap_after(p, at, &step, length) > PROGRESS * gap) {
        /* Too near the boundary, where the corrector can cycle: go towards the middle first. */
        for (size_t i = 0; i < p->count; i++)
            cd[i] = CENTRING * gap - at->d[i] * at->z[i];
        ct = CENTRING * gap - at->t * at->w;
        newton_step(p, at, sys, cd, ct, &step);
        length = fmin(1.0, STEP_SHARE * longest(p, at, &step));
    }
    move(p, at, &step, length);
}

/* Make the mean of H's diagonal 1, so that tolerances are meaningful. */
static void normalise(struct m08_programme *p)
{
    double trace = 0.0, scale;

    for (size_t i = 0; i < p->count; i++)
        trace += p->h[i][i];
    scale = trace > 0.0 ? (double)p->count / trace : 1.0;
    for (size_t i = 0; i < p->count; i++) {
        p->f[i] *= scale;
        for (size_t j = 0; j <= i; j++)
            p->h[i][j] *= scale;
    }
}

int m08_programme_solve(struct m08_programme *p)
{
    struct point at = {.t = p->limit * 0.5, .w = 1.0};
    struct system sys;
    double ridge;
    int iteration;

    normalise(p);
    find_envelope(p);
    ridge = RIDGE * (double)p->count;
    for (size_t i = 0; i < p->count; i++) {
        at.d[i] = 0.5 * p->limit / (double)p->count;
        at.z[i] = 1.0;
    }
    for (iteration = 0; iteration < ITERATIONS_MAX; iteration++) {
        double gap = at.t * at.w, worst;

        dual_residual(p, &at, ridge, sys.dual);
        sys.primal = sum_of(at.d, p->count) + at.t - p->limit;
        worst = fabs(sys.primal);
        for (size_t i = 0; i < p->count; i++) {
            gap += at.d[i] * at.z[i];
            worst = fmax(worst, fabs(sys.dual[i]));
        }
        gap /= (double)(p->count + 1);
        if (gap <= TOLERANCE && worst <= TOLERANCE)
            break;
        improve(p, &at, &sys, gap, ridge);
    }
    memcpy(p->d, at.d, p->count * sizeof *p->d);
    return iteration;
}
