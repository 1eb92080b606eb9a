#include "tests/support/chi_square.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/memory.h"
#include "tests/support/statistics.h"

/* An error of this share of a cell's standard deviation: in 200 cells the squares add up to 0.5 and 0.02, where
 * chi-square itself has a standard deviation of 20. */
#define QUICK_SHARE 0.05
#define DOUBT_SHARE 0.01

enum {
    DEPTH_MIN = 2,              /* every cell is cut at least this often: finds narrow peaks */
    DEPTH_MAX = 9,
    EVALUATIONS_MAX = 50000,    /* in one cell */
    /* The same for a cell whose hits are far from the first estimate. */
    DOUBT_DEPTH_MIN = 5,
    DOUBT_DEPTH_MAX = 13,
    DOUBT_EVALUATIONS_MAX = 1000000,
    WORST_PRINTED = 12,
};

/* The map between directions and the unit square (x: polar, y: azimuth). */
struct domain {
    double s[3], t[3], n[3];
    double focus, squeeze;
};

struct integrand {
    const struct chi_square_setup *setup;
    const struct domain *domain;
    double scale; /* samples: integrals are in expected hits */
    int depth_min, depth_max;
    long evaluations, evaluations_max;
    int invalid;   /* the density was negative or not finite somewhere */
    double parted; /* the tolerance of a quarter over that of the whole */
};

static double dot_d(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static void domain_init(struct domain *d, const struct chi_square_setup *setup)
{
    struct vec3 axis = vec3_normalize(setup->axis);
    double length, n[3], a[3] = {0, 0, 0};

    if (vec3_is_black(axis))
        axis.z = 1;
    n[0] = axis.x, n[1] = axis.y, n[2] = axis.z;
    length = sqrt(dot_d(n, n));
    for (int i = 0; i < 3; i++)
        d->n[i] = n[i] / length;
    /* Azimuth 0 lies in the plane of z and the axis, where they span one. */
    a[fabs(n[2]) < 0.9999 * length ? 2 : 0] = 1;
    length = dot_d(a, d->n);
    for (int i = 0; i < 3; i++)
        d->s[i] = a[i] - length * d->n[i];
    length = sqrt(dot_d(d->s, d->s));
    for (int i = 0; i < 3; i++)
        d->s[i] /= length;
    d->t[0] = d->n[1] * d->s[2] - d->n[2] * d->s[1];
    d->t[1] = d->n[2] * d->s[0] - d->n[0] * d->s[2];
    d->t[2] = d->n[0] * d->s[1] - d->n[1] * d->s[0];
    d->focus = setup->focus > 0 ? setup->focus : 1.0;
    d->squeeze = setup->squeeze > 0 ? setup->squeeze : 1.0;
}

static void domain_from_direction(const struct domain *d, struct vec3 wi, double *x, double *y)
{
    double w[3] = {wi.x, wi.y, wi.z}, delta[3], length = sqrt(dot_d(w, w)), half;

    for (int i = 0; i < 3; i++) {
        w[i] /= length;
        delta[i] = w[i] - d->n[i];
    }
    half = dot_d(delta, delta) / 4; /* (1 - cos) / 2, exact near the axis */
    *x = pow(half < 1 ? half : 1, 1 / d->focus);
    *y = atan2(dot_d(w, d->t), d->squeeze * dot_d(w, d->s)) / (2 * M_PI);
    *y = *y < 0 ? *y + 1 : *y;
}

/* 3 x 3 Gauss-Legendre points over a rectangle. The solid angle of dx dy is the product of
 * the two factors below. */
static double integrate_once(struct integrand *f, double x0, double x1, double y0, double y1)
{
    static const double NODE[3] = {0.1127016653792583, 0.5, 0.8872983346207417};
    static const double WEIGHT[3] = {5.0 / 18, 8.0 / 18, 5.0 / 18};
    const struct domain *d = f->domain;
    double c[3], s[3], y_factor[3], sum = 0;

    for (int j = 0; j < 3; j++) {
        double angle = 2 * M_PI * (y0 + (y1 - y0) * NODE[j]), length2;
        c[j] = cos(angle);
        s[j] = d->squeeze * sin(angle);
        length2 = c[j] * c[j] + s[j] * s[j];
        c[j] /= sqrt(length2);
        s[j] /= sqrt(length2);
        y_factor[j] = WEIGHT[j] * d->squeeze / length2;
    }
    for (int i = 0; i < 3; i++) {
        double x = x0 + (x1 - x0) * NODE[i], half = pow(x, d->focus);
        double sine = 2 * sqrt(half * (1 - half)), cosine = 1 - 2 * half;
        double x_factor = WEIGHT[i] * 4 * M_PI * d->focus * half / x;
        for (int j = 0; j < 3; j++) {
            double w[3], pdf;
            for (int k = 0; k < 3; k++)
                w[k] = sine * (c[j] * d->s[k] + s[j] * d->t[k]) + cosine * d->n[k];
            pdf = f->setup->pdf(f->setup->user, (struct vec3){(float)w[0], (float)w[1], (float)w[2]});
            if (!(pdf >= 0 && pdf < INFINITY)) {
                f->invalid = 1;
                pdf = 0;
            }
            sum += x_factor * y_factor[j] * pdf;
        }
    }
    f->evaluations += 9;
    return sum * (x1 - x0) * (y1 - y0) * f->scale;
}

/* `whole` is integrate_once of the same rectangle; `tolerance` is in expected hits. Where the density is smooth the error
 * is far below it; along an edge of the density the errors of its rectangles have either sign, so that they add up in
 * squares, unless it is `aligned` with the cells. */
static double integrate(struct integrand *f, double x0, double x1, double y0, double y1, double whole, double tolerance,
                        int depth)
{
    double xm = 0.5 * (x0 + x1), ym = 0.5 * (y0 + y1);
    double parts[4] = {integrate_once(f, x0, xm, y0, ym), integrate_once(f, xm, x1, y0, ym),
                       integrate_once(f, x0, xm, ym, y1), integrate_once(f, xm, x1, ym, y1)};
    double sum = parts[0] + parts[1] + parts[2] + parts[3];

    if (depth >= f->depth_min &&
        (depth >= f->depth_max || f->evaluations > f->evaluations_max || fabs(sum - whole) < tolerance + 1e-4 * sum))
        return sum;
    return integrate(f, x0, xm, y0, ym, parts[0], tolerance * f->parted, depth + 1) +
           integrate(f, xm, x1, y0, ym, parts[1], tolerance * f->parted, depth + 1) +
           integrate(f, x0, xm, ym, y1, parts[2], tolerance * f->parted, depth + 1) +
           integrate(f, xm, x1, ym, y1, parts[3], tolerance * f->parted, depth + 1);
}

static int cell_index(double x, int cells)
{
    int i = (int)(x * cells);
    return i < 0 ? 0 : i >= cells ? cells - 1 : i;
}

static void observe(const struct chi_square_setup *setup, const struct domain *d, uint64_t samples,
                    struct chi_square_result *r)
{
    struct test_random random = {setup->seed};
    int none = r->cos_cells * r->phi_cells, sane = 1;
    uint64_t impossible = 0;

    for (uint64_t i = 0; i < samples; i++) {
        float u[3] = {test_random_float(&random), test_random_float(&random),
                      test_random_float(&random)};
        struct vec3 wi = {0, 0, 0};
        double x, y;
        int cell = none;
        if (setup->sample(setup->user, u, &wi)) {
            if (!vec3_is_finite(wi) || fabsf(vec3_length_squared(wi) - 1) > 1e-3f) {
                sane = 0;
                continue;
            }
            domain_from_direction(d, wi, &x, &y);
            cell = cell_index(x, r->cos_cells) * r->phi_cells + cell_index(y, r->phi_cells);
            impossible += !(setup->pdf(setup->user, wi) > 0);
        }
        r->observed[cell] += 1;
    }
    if (!sane)
        r->reason = "the sampler returned a direction that is not finite or not unit";
    else if ((double)impossible > 1e-5 * (double)samples)
        r->reason = "the density is zero where samples fall";
}

/* To `tolerance` hits, or where more are expected to `share` of their standard deviation. */
static double integrate_cell(struct integrand *f, const struct chi_square_result *r, int cell, double tolerance,
                             double share)
{
    int i = cell / r->phi_cells, j = cell % r->phi_cells;
    double x0 = (double)i / r->cos_cells, x1 = (double)(i + 1) / r->cos_cells;
    double y0 = (double)j / r->phi_cells, y1 = (double)(j + 1) / r->phi_cells;

    f->evaluations = 0;
    if (!f->setup->aligned)
        tolerance = fmax(tolerance, share * sqrt(r->observed[cell]));
    return integrate(f, x0, x1, y0, y1, integrate_once(f, x0, x1, y0, y1), tolerance, 0);
}

static int is_doubtful(double hits, double expected) { return fabs(hits - expected) > 2.5 * sqrt(fmax(expected, 1)); }

/* Where hits and expectation disagree the quadrature may have missed a sliver of the
 * density: it is then repeated with far more points. That only ever brings the expectation
 * nearer to its true value, so the test stays honest. */
static void expect(const struct chi_square_setup *setup, const struct domain *d, uint64_t samples,
                   struct chi_square_result *r, int *invalid)
{
    struct integrand quick = {.setup = setup, .domain = d, .scale = (double)samples,
                              .depth_min = DEPTH_MIN, .depth_max = DEPTH_MAX,
                              .evaluations_max = EVALUATIONS_MAX, .parted = setup->aligned ? 0.5 : M_SQRT1_2};
    struct integrand careful = quick;
    int none = r->cos_cells * r->phi_cells;

    careful.depth_min = DOUBT_DEPTH_MIN;
    careful.depth_max = DOUBT_DEPTH_MAX;
    careful.evaluations_max = DOUBT_EVALUATIONS_MAX;
    /* The second round is for doubt about the total only. */
    for (int round = 0; round < 2; round++) {
        double sum = 0;
        for (int i = 0; i < none; i++) {
            if (round == 0)
                r->expected[i] = integrate_cell(&quick, r, i, 0.5, QUICK_SHARE);
            if (round == 1 ? r->expected[i] > 1 : is_doubtful(r->observed[i], r->expected[i]))
                r->expected[i] = integrate_cell(&careful, r, i, 0.05, DOUBT_SHARE);
            sum += r->expected[i];
        }
        r->mass = sum / (double)samples;
        r->expected[none] = fmax(0, (double)samples - sum);
        if (!is_doubtful(r->observed[none], r->expected[none]))
            break;
    }
    *invalid = quick.invalid || careful.invalid;
}

struct pair {
    double expected, observed;
};

static int pair_compare(const void *a, const void *b)
{
    const struct pair *p = a, *q = b;
    return (p->expected > q->expected) - (p->expected < q->expected);
}

/* Pearson's statistic with the cells of low expectation pooled, smallest first, until the
 * pool itself has enough. */
static void judge(struct chi_square_result *r, double expected_min, struct pair *pairs)
{
    int cells = r->cos_cells * r->phi_cells + 1, terms = 0;
    struct pair pool = {0, 0};

    for (int i = 0; i < cells; i++)
        pairs[i] = (struct pair){r->expected[i], r->observed[i]};
    qsort(pairs, (size_t)cells, sizeof *pairs, pair_compare);
    for (int i = 0; i < cells; i++) {
        if (pairs[i].expected < expected_min || (r->pooled > 0 && pool.expected < expected_min)) {
            pool.expected += pairs[i].expected;
            pool.observed += pairs[i].observed;
            r->pooled++;
            continue;
        }
        r->statistic +=
            (pairs[i].observed - pairs[i].expected) * (pairs[i].observed - pairs[i].expected) / pairs[i].expected;
        terms++;
    }
    if (pool.expected > 0) {
        r->statistic += (pool.observed - pool.expected) * (pool.observed - pool.expected) / pool.expected;
        terms++;
    }
    r->degrees = terms - 1;
    /* One term only: all that can be said is that it holds everything, and it does. */
    r->p_value = r->degrees > 0 ? chi_square_p_value(r->statistic, r->degrees) : 1.0;
}

int chi_square_run(const struct chi_square_setup *setup, struct chi_square_result *out)
{
    struct domain domain;
    struct pair *pairs;
    uint64_t samples;
    size_t cells;
    int invalid = 0;

    memset(out, 0, sizeof *out);
    out->cos_cells = setup->cos_cells > 0 ? setup->cos_cells : 10;
    out->phi_cells = setup->phi_cells > 0 ? setup->phi_cells : 20;
    cells = (size_t)out->cos_cells * (size_t)out->phi_cells + 1;
    samples = setup->samples ? setup->samples : 5000 * (uint64_t)(cells - 1);
    out->observed = mem_calloc(cells, sizeof *out->observed);
    out->expected = mem_calloc(cells, sizeof *out->expected);
    pairs = mem_calloc(cells, sizeof *pairs);
    if (!out->observed || !out->expected || !pairs) {
        mem_free(pairs);
        chi_square_result_release(out);
        return 0;
    }
    domain_init(&domain, setup);
    observe(setup, &domain, samples, out);
    expect(setup, &domain, samples, out, &invalid);
    judge(out, setup->expected_min > 0 ? setup->expected_min : 5, pairs);
    mem_free(pairs);

    if (!out->reason && invalid)
        out->reason = "the density is negative or not finite somewhere";
    if (!out->reason && out->mass > 1 + 2e-3)
        out->reason = "the density integrates to more than 1";
    if (out->reason)
        out->p_value = 0;
    return 1;
}

void chi_square_result_release(struct chi_square_result *r)
{
    mem_free(r->observed);
    mem_free(r->expected);
    r->observed = r->expected = NULL;
}

static void print_table(const struct chi_square_result *r, const char *title, const double *cells)
{
    fprintf(stderr, "  %s (rows: from the axis outwards; columns: azimuth)\n", title);
    for (int i = 0; i < r->cos_cells; i++) {
        fprintf(stderr, "   ");
        for (int j = 0; j < r->phi_cells; j++)
            fprintf(stderr, " %8.1f", cells[i * r->phi_cells + j]);
        fprintf(stderr, "\n");
    }
    fprintf(stderr, "    none: %.1f\n", cells[r->cos_cells * r->phi_cells]);
}

static double deviation(const struct chi_square_result *r, int cell)
{
    return (r->observed[cell] - r->expected[cell]) / sqrt(fmax(r->expected[cell], 1));
}

void chi_square_print(const struct chi_square_result *r, const char *name)
{
    int none = r->cos_cells * r->phi_cells;
    double limit = INFINITY;

    fprintf(stderr, "%s: p = %.3g, chi-square %.2f with %d degrees of freedom, %d cells pooled, "
            "the density integrates to %.6f%s%s\n", name, r->p_value, r->statistic, r->degrees,
            r->pooled, r->mass, r->reason ? "; " : "", r->reason ? r->reason : "");
    for (int n = 0; n < WORST_PRINTED; n++) {
        int worst = -1;
        for (int i = 0; i <= none; i++)
            if (fabs(deviation(r, i)) < limit && (worst < 0 || fabs(deviation(r, i)) > fabs(deviation(r, worst))))
                worst = i;
        if (worst < 0)
            break;
        limit = fabs(deviation(r, worst));
        if (worst == none)
            fprintf(stderr, "  none:");
        else
            fprintf(stderr, "  cell (%d,%d):", worst / r->phi_cells, worst % r->phi_cells);
        fprintf(stderr, " %.0f hits, %.2f expected, %+.1f sigma\n", r->observed[worst], r->expected[worst],
                deviation(r, worst));
    }
    print_table(r, "hits", r->observed);
    print_table(r, "expected", r->expected);
}

int chi_square_accept(const struct chi_square_setup *setup, double alpha, unsigned tests, const char *name)
{
    struct chi_square_result r;
    int accepted;

    if (!chi_square_run(setup, &r)) {
        fprintf(stderr, "%s: out of memory\n", name);
        return 0;
    }
    accepted = r.p_value >= sidak_alpha(alpha, tests);
    if (!accepted)
        chi_square_print(&r, name);
    chi_square_result_release(&r);
    return accepted;
}
