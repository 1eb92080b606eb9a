#include "tests/support/chi_square.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/memory.h"
#include "tests/support/statistics.h"

enum {
    DEPTH_MIN = 2,              /* every cell is cut at least this often: finds narrow peaks */
    DEPTH_MAX = 9,
    EVALUATIONS_MAX = 400000,   /* in one cell */
    WORST_PRINTED = 12,
};

/* The map between directions and the unit square (x: polar, y: azimuth). */
struct domain {
    double s[3], t[3], n[3];
    double focus;
};

struct integrand {
    const struct chi_square_setup *setup;
    const struct domain *domain;
    double scale;           /* samples: integrals are in expected hits */
    long evaluations;
    int invalid;            /* the density was negative or not finite somewhere */
};

static double dot_d(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

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
    /* Gram-Schmidt with the coordinate axis that is furthest from n. */
    a[fabs(n[0]) < 0.6 ? 0 : 1] = 1;
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
    *y = atan2(dot_d(w, d->t), dot_d(w, d->s)) / (2 * M_PI);
    *y = *y < 0 ? *y + 1 : *y;
}

/* *jacobian: solid angle per unit of x and y. */
static struct vec3 domain_to_direction(const struct domain *d, double x, double y,
                                       double *jacobian)
{
    double half = pow(x, d->focus), sine = 2 * sqrt(half * (1 - half)), cosine = 1 - 2 * half;
    double a = sine * cos(2 * M_PI * y), b = sine * sin(2 * M_PI * y);
    double w[3];

    for (int i = 0; i < 3; i++)
        w[i] = a * d->s[i] + b * d->t[i] + cosine * d->n[i];
    *jacobian = 4 * M_PI * d->focus * pow(x, d->focus - 1);
    return (struct vec3){(float)w[0], (float)w[1], (float)w[2]};
}

/* 3 x 3 Gauss-Legendre points over a rectangle. */
static double integrate_once(struct integrand *f, double x0, double x1, double y0, double y1)
{
    static const double NODE[3] = {0.1127016653792583, 0.5, 0.8872983346207417};
    static const double WEIGHT[3] = {5.0 / 18, 8.0 / 18, 5.0 / 18};
    double sum = 0;

    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            double jacobian, pdf;
            struct vec3 wi = domain_to_direction(f->domain, x0 + (x1 - x0) * NODE[i],
                                                 y0 + (y1 - y0) * NODE[j], &jacobian);
            pdf = f->setup->pdf(f->setup->user, wi);
            if (!(pdf >= 0 && pdf < INFINITY)) {
                f->invalid = 1;
                pdf = 0;
            }
            sum += WEIGHT[i] * WEIGHT[j] * pdf * jacobian;
        }
    f->evaluations += 9;
    return sum * (x1 - x0) * (y1 - y0) * f->scale;
}

/* `whole` is integrate_once of the same rectangle; `tolerance` is in expected hits. */
static double integrate(struct integrand *f, double x0, double x1, double y0, double y1,
                        double whole, double tolerance, int depth)
{
    double xm = 0.5 * (x0 + x1), ym = 0.5 * (y0 + y1);
    double parts[4] = {integrate_once(f, x0, xm, y0, ym), integrate_once(f, xm, x1, y0, ym),
                       integrate_once(f, x0, xm, ym, y1), integrate_once(f, xm, x1, ym, y1)};
    double sum = parts[0] + parts[1] + parts[2] + parts[3];

    if (depth >= DEPTH_MIN &&
        (depth >= DEPTH_MAX || f->evaluations > EVALUATIONS_MAX ||
         fabs(sum - whole) < tolerance + 1e-5 * sum))
        return sum;
    return integrate(f, x0, xm, y0, ym, parts[0], tolerance / 2, depth + 1) +
           integrate(f, xm, x1, y0, ym, parts[1], tolerance / 2, depth + 1) +
           integrate(f, x0, xm, ym, y1, parts[2], tolerance / 2, depth + 1) +
           integrate(f, xm, x1, ym, y1, parts[3], tolerance / 2, depth + 1);
}

static int cell_index(double x, int cells)
{
    int i = (int)(x * cells);
    return i < 0 ? 0 : i >= cells ? cells - 1 : i;
}

static int observe(const struct chi_square_setup *setup, const struct domain *d,
                   uint64_t samples, struct chi_square_result *r)
{
    struct test_random random = {setup->seed};
    int none = r->cos_cells * r->phi_cells, sane = 1;

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
        }
        r->observed[cell] += 1;
    }
    return sane;
}

static void expect(const struct chi_square_setup *setup, const struct domain *d,
                   uint64_t samples, struct chi_square_result *r, int *invalid)
{
    struct integrand f = {setup, d, (double)samples, 0, 0};
    double sum = 0;

    for (int i = 0; i < r->cos_cells; i++)
        for (int j = 0; j < r->phi_cells; j++) {
            double x0 = (double)i / r->cos_cells, x1 = (double)(i + 1) / r->cos_cells;
            double y0 = (double)j / r->phi_cells, y1 = (double)(j + 1) / r->phi_cells;
            double e;
            f.evaluations = 0;
            e = integrate(&f, x0, x1, y0, y1, integrate_once(&f, x0, x1, y0, y1), 0.05, 0);
            r->expected[i * r->phi_cells + j] = e;
            sum += e;
        }
    r->mass = sum / (double)samples;
    r->expected[r->cos_cells * r->phi_cells] = fmax(0, (double)samples - sum);
    *invalid = f.invalid;
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
        r->statistic += (pairs[i].observed - pairs[i].expected) *
                        (pairs[i].observed - pairs[i].expected) / pairs[i].expected;
        terms++;
    }
    if (pool.expected > 0) {
        r->statistic += (pool.observed - pool.expected) * (pool.observed - pool.expected) /
                        pool.expected;
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
    int sane, invalid = 0;

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
    sane = observe(setup, &domain, samples, out);
    expect(setup, &domain, samples, out, &invalid);
    judge(out, setup->expected_min > 0 ? setup->expected_min : 5, pairs);
    mem_free(pairs);

    if (!sane)
        out->reason = "the sampler returned a direction that is not finite or not unit";
    else if (invalid)
        out->reason = "the density is negative or not finite somewhere";
    else if (out->mass > 1 + 2e-3)
        out->reason = "the density integrates to more than 1";
    for (size_t i = 0; !out->reason && i + 1 < cells; i++)
        if (out->expected[i] == 0 && out->observed[i] > 1e-5 * (double)samples)
            out->reason = "samples fall where the density is zero";
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
            if (fabs(deviation(r, i)) < limit &&
                (worst < 0 || fabs(deviation(r, i)) > fabs(deviation(r, worst))))
                worst = i;
        if (worst < 0)
            break;
        limit = fabs(deviation(r, worst));
        if (worst == none)
            fprintf(stderr, "  none:");
        else
            fprintf(stderr, "  cell (%d,%d):", worst / r->phi_cells, worst % r->phi_cells);
        fprintf(stderr, " %.0f hits, %.2f expected, %+.1f sigma\n", r->observed[worst],
                r->expected[worst], deviation(r, worst));
    }
    print_table(r, "hits", r->observed);
    print_table(r, "expected", r->expected);
}

int chi_square_accept(const struct chi_square_setup *setup, double alpha, unsigned tests,
                      const char *name)
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
