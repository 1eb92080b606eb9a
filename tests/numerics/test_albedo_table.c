/* The table behind albedo.h against its definition, and what it promises. With --print it
 * writes worker/render/bsdf/albedo_table.bin to standard output instead. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "worker/render/bsdf/albedo.h"
#include "worker/render/bsdf/bsdf.h"

enum { POINTS = 128 };
/* One in so many entries of the means of true losses is recomputed. */
enum { SOME_MEANS = 13 };
/* How far the table of the exact term may be off between its entries. */
#define EXACT_BELOW 4e-3
#define EXACT_ABOVE 8e-3

static double square(double x) { return x * x; }

static double fifth(double x) { return square(square(x)) * x; }

struct azimuth {
    double cosine, sine;
};

/* The midpoints of so many equal steps over half a turn, at most POINTS: computed once. */
static const struct azimuth *azimuths(int steps)
{
    static struct azimuth known[POINTS + 1][POINTS];
    struct azimuth *of = known[steps];

    for (int j = 0; j < steps && of[0].cosine == 0; j++) {
        const int last = steps - 1 - j; /* first comes last: it tells that all are there */
        of[last] = (struct azimuth){cos(M_PI * (last + 0.5) / steps), sin(M_PI * (last + 0.5) / steps)};
    }
    return of;
}

/* Directional albedo of GGX with unit Fresnel, *all, and with (1 - v.h)^5, *schlick: the
 * midpoint rule over the visible normals, whose weight is G2 / G1. */
static void ggx_albedo(double mu, double alpha, int points, double *all, double *schlick)
{
    double wo_x = sqrt(1 - mu * mu), length = hypot(alpha * wo_x, mu);
    double x = alpha * wo_x / length, z = mu / length, root_o = length;
    const struct azimuth *phi = azimuths(points);

    *all = *schlick = 0;
    for (int i = 0; i < points; i++)
        for (int j = 0; j < points; j++) {
            double height = (1 - (i + 0.5) / points) * (1 + z) - z;
            double sine = sqrt(fmax(0, 1 - height * height));
            double h[3] = {alpha * (sine * phi[j].cosine + x), alpha * sine * phi[j].sine, height + z};
            double norm = sqrt(h[0] * h[0] + h[1] * h[1] + h[2] * h[2]);
            double cosine = (wo_x * h[0] + mu * h[2]) / norm;
            double mu_i = 2 * cosine * h[2] / norm - mu, root_i, weight;
            if (mu_i <= 0)
                continue;
            root_i = sqrt(alpha * alpha * (1 - mu_i * mu_i) + mu_i * mu_i);
            weight = mu_i * (mu + root_o) / (mu_i * root_o + mu * root_i);
            *all += weight;
            *schlick += weight * fifth(1 - cosine);
        }
    *all /= points * points;
    *schlick /= points * points;
}

/* 1 - *all by another rule: steps in u = 1 - t^2 resolve the few steep microfacets that throw
 * light seen from above under the horizon, alpha^2 of all. */
static double ggx_loss(double mu, double alpha, int points)
{
    double wo_x = sqrt(1 - mu * mu), root_o = hypot(alpha * wo_x, mu);
    double x = alpha * wo_x / root_o, z = mu / root_o, sum = 0;
    const struct azimuth *phi = azimuths(points);

    for (int i = 0; i < points; i++)
        for (int j = 0; j < points; j++) {
            double t = (i + 0.5) / points;
            double height = t * t * (1 + z) - z, sine = sqrt(fmax(0, 1 - height * height));
            double h[3] = {alpha * (sine * phi[j].cosine + x), alpha * sine * phi[j].sine, height + z};
            double norm = sqrt(h[0] * h[0] + h[1] * h[1] + h[2] * h[2]);
            double cosine = (wo_x * h[0] + mu * h[2]) / norm;
            double mu_i = 2 * cosine * h[2] / norm - mu, root_i, weight = 0;
            if (mu_i > 0) {
                root_i = sqrt(alpha * alpha * (1 - mu_i * mu_i) + mu_i * mu_i);
                weight = mu_i * (mu + root_o) / (mu_i * root_o + mu * root_i);
            }
            sum += 2 * t * (1 - weight);
        }
    return sum / (points * points);
}

static double row_alpha(double row)
{
    double first = sqrt(BSDF_ALPHA_MIN);
    double root = first + (1 - first) * row / (ALBEDO_ROWS - 1);
    return fmin(1, root * root);
}

static double table_entry(int row, int column)
{
    double s = (double)column / (ALBEDO_COLUMNS - 1), all, schlick;

    ggx_albedo(fmax(1e-4, s * s), row_alpha(row), POINTS, &all, &schlick);
    return fmin(1, ALBEDO_MARGIN * schlick / all);
}

/* Integral of 2 mu blend(mu) over mu in 0..1, with mu = s^2 and blend linear in s. */
static double row_average(const float *row)
{
    double sum = 0, step = 1.0 / (ALBEDO_COLUMNS - 1);

    for (int j = 0; j + 1 < ALBEDO_COLUMNS; j++) {
        double a = j * step, b = a + step, slope = (row[j + 1] - row[j]) / step;
        double constant = row[j] - slope * a;
        sum += constant * (pow(b, 4) - pow(a, 4)) + slope * 4 / 5 * (pow(b, 5) - pow(a, 5));
    }
    return sum;
}

/* ---- loss of GGX with unit Fresnel ----------------------------------------------------------- */

/* mu of column x = 0..1 of the loss tables; the inverse of albedo_loss_column. */
static double column_mu(double x, double alpha) { return alpha * x * x / (1 + alpha - x * x); }

static double column_scale(int column, int columns, double alpha)
{
    return square(1 - square((double)column / (columns - 1))) + alpha * alpha;
}

static double loss_entry(int row, int column)
{
    double alpha = row_alpha(row);

    if (column == 0)
        return 0; /* the limit */
    return ggx_loss(fmin(1, column_mu((double)column / (ALBEDO_COLUMNS - 1), alpha)), alpha, POINTS) /
           column_scale(column, ALBEDO_COLUMNS, alpha);
}

/* Hemispherical means, as interpolated: of the loss, and of E blend. By Simpson's rule in
 * mu^(1/4), which is smooth enough at both ends. */
static void row_means(double alpha, double *loss, double *schlick)
{
    struct albedo_loss_row row = albedo_loss_row_find((float)alpha);
    struct albedo_row blend = albedo_row_find((float)alpha);
    enum { STEPS = 4000 };

    *loss = *schlick = 0;
    for (int i = 0; i <= STEPS; i++) {
        double s = (double)i / STEPS, mu = s * s * s * s;
        double w = (i == 0 || i == STEPS ? 1 : i & 1 ? 4 : 2) / (3.0 * STEPS) * 8 * mu * s * s * s;
        double l = albedo_loss_at(&row, (float)mu);
        *loss += w * l;
        *schlick += w * (1 - l) * albedo_blend_at(&blend, (float)mu);
    }
}

/* ---- stretched distributions ------------------------------------------------------------------ */

static double stretched_alpha(double t)
{
    double first = sqrt(BSDF_ALPHA_MIN);
    return (first + (1 - first) * t) * (first + (1 - first) * t);
}

/* Loss along (mu, azimuth) for alphas x and y, and *schlick, the mean of (1 - v.h)^5 that is
 * sent out: the midpoint rule over the visible normals. */
static double stretched_loss(double mu, double cos2_azimuth, double ax, double ay, double *schlick)
{
    double sine = sqrt(1 - mu * mu), w[3] = {sine * sqrt(cos2_azimuth),
                                             sine * sqrt(1 - cos2_azimuth), mu};
    double x = ax * w[0], y = ay * w[1], root_o = sqrt(x * x + y * y + mu * mu), z = mu / root_o;
    double sum = 0;
    enum { N = 48 };
    const struct azimuth *phi = azimuths(N);

    x /= root_o;
    y /= root_o;
    *schlick = 0;
    for (int i = 0; i < N; i++)
        for (int j = 0; j < 2 * N; j++) {
            double t = (i + 0.5) / N, height = t * t * (1 + z) - z;
            double s = sqrt(fmax(0, 1 - height * height)) * (j < N ? 1 : -1);
            double h[3] = {ax * (s * phi[j % N].cosine + x), ay * (s * phi[j % N].sine + y), height + z};
            double norm = sqrt(h[0] * h[0] + h[1] * h[1] + h[2] * h[2]);
            double c = 2 * (w[0] * h[0] + w[1] * h[1] + w[2] * h[2]) / norm;
            double v[3] = {c * h[0] / norm - w[0], c * h[1] / norm - w[1], c * h[2] / norm - w[2]};
            double root_i, weight = 0;
            if (v[2] > 0) {
                root_i = sqrt(ax * ax * v[0] * v[0] + ay * ay * v[1] * v[1] + v[2] * v[2]);
                weight = v[2] * (mu + root_o) / (v[2] * root_o + mu * root_i);
            }
            sum += 2 * t * (1 - weight);
            *schlick += 2 * t * weight * fifth(1 - 0.5 * c) / (2 * N * N);
        }
    return sum / (2 * N * N);
}

static double stretched_entry(int row, int ratio, int azimuth, int column)
{
    double ax = stretched_alpha((double)row / (ALBEDO_STRETCHED_ROWS - 1));
    double ay = fmax(BSDF_ALPHA_MIN, ax * ratio / (ALBEDO_STRETCHED_RATIOS - 1));
    double q = (double)azimuth / (ALBEDO_STRETCHED_AZIMUTHS - 1), across = ay + (ax - ay) * q * q;
    double schlick, cos2 = ax > ay ? (across * across - ay * ay) / (ax * ax - ay * ay) : 1;

    if (column == 0)
        return 0;
    return stretched_loss(fmin(1, column_mu((double)column / (ALBEDO_STRETCHED_COLUMNS - 1), across)),
                          fmin(1, fmax(0, cos2)), ax, ay, &schlick) /
           column_scale(column, ALBEDO_STRETCHED_COLUMNS, ax);
}

/* Hemispherical mean of the interpolated loss. */
static double stretched_mean(double row, double ratio)
{
    double ax = stretched_alpha(row / (ALBEDO_STRETCHED_ROWS - 1)), sum = 0, weight = 0;
    double ay = fmax(BSDF_ALPHA_MIN, ax * ratio / (ALBEDO_STRETCHED_RATIOS - 1));
    struct albedo_stretched s = albedo_stretched_find((float)ax, (float)ay);
    enum { STEPS = 200, TURNS = 64 };

    for (int i = 0; i < STEPS; i++)
        for (int j = 0; j < TURNS; j++) {
            double t = (i + 0.5) / STEPS, mu = t * t * t * t, w = mu * t * t * t;
            /* Crowded towards the narrow side. */
            double turn = (j + 0.5) / TURNS, phi = M_PI / 2 * turn * turn * turn;
            double sine = sqrt(1 - mu * mu);
            w *= turn * turn;
            sum += w * albedo_stretched_loss_at(&s, (float)(sine * sin(phi)), (float)(sine * cos(phi)), (float)mu);
            weight += w;
        }
    return sum / weight / (ax * ax);
}

/* ---- rough dielectrics ------------------------------------------------------------------------- */

static double interface_row_alpha(double row)
{
    double first = sqrt((double)ALBEDO_INTERFACE_ALPHA_FIRST);

    return fmin(1, square(first + (1 - first) * row / (ALBEDO_INTERFACE_ROWS - 1)));
}

static double fresnel(double c, double eta)
{
    double sin2 = (1 - c * c) / (eta * eta), t, s, p;

    if (sin2 >= 1)
        return 1;
    t = sqrt(1 - sin2);
    s = (c - eta * t) / (c + eta * t);
    p = (eta * c - t) / (eta * c + t);
    return 0.5 * (s * s + p * p);
}

/* Light that a rough interface of relative index eta (0: a mirror) loses along mu at one visible
 * normal, whose cap's height is u, 0..1. */
static double interface_lost(double mu, double alpha, double eta, double u, struct azimuth phi)
{
    double wo_x = sqrt(1 - mu * mu), root_o = sqrt(alpha * wo_x * alpha * wo_x + mu * mu);
    double x = alpha * wo_x / root_o, z = mu / root_o, height = u * (1 + z) - z;
    double s = sqrt(fmax(0, 1 - height * height)), mu_i, root_i, t, kept = 0;
    double h[3] = {alpha * (s * phi.cosine + x), alpha * s * phi.sine, height + z};
    double norm = sqrt(h[0] * h[0] + h[1] * h[1] + h[2] * h[2]), hz = h[2] / norm;
    double c = (wo_x * h[0] + mu * h[2]) / norm, f = eta > 0 ? fresnel(c, eta) : 1;

    mu_i = 2 * c * hz - mu;
    if (mu_i > 0) {
        root_i = sqrt(alpha * alpha * (1 - mu_i * mu_i) + mu_i * mu_i);
        kept += f * mu_i * (mu + root_o) / (mu_i * root_o + mu * root_i);
    }
    t = f < 1 ? sqrt(1 - (1 - c * c) / (eta * eta)) : 0;
    mu_i = f < 1 ? -((c * hz - mu) / eta - t * hz) : 0;
    if (mu_i > 0) {
        root_i = sqrt(alpha * alpha * (1 - mu_i * mu_i) + mu_i * mu_i);
        kept += (1 - f) * fmin(1, mu_i * (mu + root_o) / (mu * (mu_i + root_i)));
    }
    return 1 - kept;
}

/* Of index (1 + r) / (1 - r), seen from the thinner (side 0) or denser side. */
static double interface_eta(double r, int side) { return r < 1 ? side ? (1 - r) / (1 + r) : (1 + r) / (1 - r) : 0; }

/* What a rough interface does not send out, reflection and refraction together, seen along mu. */
static double interface_loss(double mu, double alpha, double r, int side)
{
    double eta = interface_eta(r, side), sum = 0;
    enum { N = 96 };
    const struct azimuth *phi = azimuths(N);

    for (int i = 0; i < N; i++)
        for (int j = 0; j < N; j++) {
            double v = (i + 0.5) / N;
            sum += 2 * v * interface_lost(mu, alpha, eta, v * v, phi[j]);
        }
    return sum / (N * N);
}

/* r of index x = 0..1 of the tables. */
static double interface_r(double x)
{
    double first = (double)ALBEDO_INTERFACE_FIRST;
    return square(square(first + (1 - first) * x));
}

static double interface_entry(int side, int row, int index, int column)
{
    double alpha = interface_row_alpha(row), x = (double)column / (ALBEDO_INTERFACE_COLUMNS - 1);
    double c = 0.5 * (sqrt(1 + 8 * x) - 1), mu = alpha * c / (1 + alpha - c);

    return interface_loss(fmax(1e-6, fmin(1, mu)), alpha, interface_r((double)index / (ALBEDO_INTERFACE_INDICES - 1)),
                          side) /
           ((1 - c) * (1 - c + alpha) + 0.5 * alpha * alpha);
}

/* Of the table as it stands, over alpha^2. */
static double interface_mean(int side, int row, int index)
{
    double alpha = interface_row_alpha((double)row / ALBEDO_MEAN_STEPS), sum = 0;
    double r = interface_r((double)index / (ALBEDO_INTERFACE_INDICES - 1));
    struct albedo_interface t = albedo_interface_find((float)alpha, (float)r, side);
    enum { STEPS = 4000 };

    for (int i = 0; i < STEPS; i++) {
        double s = (i + 0.5) / STEPS, mu = s * s * s * s;
        sum += 8 * mu * s * s * s * albedo_interface_loss_at(&t, (float)alpha, (float)mu);
    }
    return sum / STEPS / (alpha * alpha);
}

/* A point of the additive recurrence of Kronecker and Weyl, folded so that no edge of the unit
 * interval stands out. */
static double recurrence(int i, double step)
{
    double x = 0.5 + i * step;
    return 1 - fabs(2 * (x - floor(x)) - 1);
}

/* The true loss's mean over alpha, to about 5e-4 of it (2e-3 for alpha 0.1): the recurrence's steps are
 * powers of the inverse of the root of x^4 = x + 1. */
static double interface_lost_mean(int side, int row, int index)
{
    double alpha = interface_row_alpha((double)row / 2), sum = 0;
    double r = interface_r((double)index / (ALBEDO_INTERFACE_LOST_INDICES - 1));
    double eta = interface_eta(r, side);
    enum { POINTS_OF_MEAN = 300000 };
    static struct {
        double a, b;
        struct azimuth phi;
    } points[POINTS_OF_MEAN];

    for (int i = 0; i < POINTS_OF_MEAN && points[0].a == 0; i++) { /* the first comes last */
        const int k = POINTS_OF_MEAN - 1 - i;
        const double phi = M_PI * recurrence(k, 0.5497004779019703);
        points[k].phi = (struct azimuth){cos(phi), sin(phi)};
        points[k].b = recurrence(k, 0.6710436067037893);
        points[k].a = recurrence(k, 0.8191725133961645);
    }
    for (int i = 0; i < POINTS_OF_MEAN; i++) {
        double a = points[i].a, b = points[i].b;
        sum += 12 * a * a * a * a * a * b * /* mu = a^3 */
               interface_lost(a * a * a, alpha, eta, b * b, points[i].phi);
    }
    return sum / POINTS_OF_MEAN / alpha;
}

/* ---- the exact Fresnel term ---------------------------------------------------------------------- */

static double exact_alpha(double row)
{
    double first = sqrt(sqrt(BSDF_ALPHA_MIN));

    return square(square(first + (1 - first) * row / (ALBEDO_EXACT_ROWS - 1)));
}

static double exact_r(double index)
{
    double first = sqrt(1.0 / 11);
    return square(first + (sqrt(0.5) - first) * index / (ALBEDO_EXACT_INDICES - 1));
}

/* What is above Schlick's mean weight along mu, for `count` values of r. */
static void exact_above(double mu, double alpha, int points, const double *r, int count, double *above)
{
    double wo_x = sqrt(1 - mu * mu), root_o = hypot(alpha * wo_x, mu), all = 0;
    double x = alpha * wo_x / root_o, z = mu / root_o;
    const struct azimuth *phi = azimuths(points);

    memset(above, 0, (size_t)count * sizeof *above);
    for (int i = 0; i < points; i++)
        for (int j = 0; j < points; j++) {
            double height = (1 - (i + 0.5) / points) * (1 + z) - z;
            double sine = sqrt(fmax(0, 1 - height * height));
            double h[3] = {alpha * (sine * phi[j].cosine + x), alpha * sine * phi[j].sine, height + z};
            double norm = sqrt(h[0] * h[0] + h[1] * h[1] + h[2] * h[2]);
            double cosine = fmin(1, (wo_x * h[0] + mu * h[2]) / norm);
            double mu_i = 2 * cosine * h[2] / norm - mu, root_i, weight, schlick;
            if (mu_i <= 0)
                continue;
            root_i = sqrt(alpha * alpha * (1 - mu_i * mu_i) + mu_i * mu_i);
            weight = mu_i * (mu + root_o) / (mu_i * root_o + mu * root_i);
            schlick = fifth(1 - cosine);
            all += weight;
            for (int k = 0; k < count; k++)
                above[k] +=
                    weight * ((fresnel(cosine, (1 + r[k]) / (1 - r[k])) - square(r[k])) / (1 - square(r[k])) - schlick);
        }
    for (int k = 0; k < count; k++)
        above[k] /= all;
}

static void exact_entries(int row, int column, double entries[ALBEDO_EXACT_INDICES])
{
    double r[ALBEDO_EXACT_INDICES], s = (double)column / (ALBEDO_EXACT_COLUMNS - 1);

    for (int k = 0; k < ALBEDO_EXACT_INDICES; k++)
        r[k] = exact_r(k);
    exact_above(fmax(1e-4, s * s), exact_alpha(row), 96, r, ALBEDO_EXACT_INDICES, entries);
    for (int k = 0; k < ALBEDO_EXACT_INDICES; k++)
        entries[k] += ALBEDO_EXACT_MARGIN;
}

/* Of the table as it stands. */
static void exact_means(int row, int index, double *mean, double *kept)
{
    double alpha = exact_alpha(row), r = exact_r(index);
    struct albedo_exact t = albedo_exact_find((float)alpha, (float)((1 + r) / (1 - r)));
    struct albedo_loss_row loss = albedo_loss_row_find((float)alpha);
    enum { STEPS = 4000 };

    *mean = *kept = 0;
    for (int i = 0; i < STEPS; i++) {
        double s = (i + 0.5) / STEPS, mu = s * s * s * s, weight = 8 * mu * s * s * s / STEPS;
        double at = (double)albedo_exact_at(&t, (float)mu);
        *mean += weight * at;
        *kept += weight * at * (1 - (double)albedo_loss_at(&loss, (float)mu));
    }
}

/* ---- sheen --------------------------------------------------------------------------------------- */

static double sheen_fit(double x, double alpha)
{
    double t = (1 - alpha) * (1 - alpha);
    double a = t * 25.3245 + (1 - t) * 21.5473, b = t * 3.32435 + (1 - t) * 3.82987;
    double c = t * 0.16801 + (1 - t) * 0.19823, d = t * -1.27393 + (1 - t) * -1.97760;
    double e = t * -4.85967 + (1 - t) * -4.32054;
    return a / (1 + b * pow(x, c)) + d * x + e;
}

static double sheen_lambda(double mu, double alpha)
{
    return exp(mu < 0.5 ? sheen_fit(mu, alpha) : 2 * sheen_fit(0.5, alpha) - sheen_fit(1 - mu, alpha));
}

/* Directional albedo of Charlie's distribution with its shadowing. */
static double sheen_albedo(double mu, double alpha, int points)
{
    double so = sqrt(1 - mu * mu), lambda_o = sheen_lambda(mu, alpha), sum = 0;

    for (int i = 0; i < points; i++) {
        /* Crowded towards the horizon, where a soft cloth shines. */
        double s = (i + 0.5) / points, z = s * s, si = sqrt(1 - z * z);
        double v = 2 * s / (4 * mu * (1 + lambda_o + sheen_lambda(z, alpha)));
        for (int j = 0; j < points; j++) {
            double phi = M_PI * (j + 0.5) / points, hx = so + si * cos(phi), hy = si * sin(phi);
            double sin2 = (hx * hx + hy * hy) / (hx * hx + hy * hy + (mu + z) * (mu + z));
            sum += v * (2 + 1 / alpha) / (2 * M_PI) * pow(sin2, 0.5 / alpha);
        }
    }
    return sum * 2 * M_PI / points / points;
}

static double sheen_entry(int row, int column)
{
    double first = sqrt(BSDF_SHEEN_ALPHA_MIN), s = (double)column / (ALBEDO_COLUMNS - 1);
    double root = first + (1 - first) * row / (ALBEDO_ROWS - 1);

    return ALBEDO_MARGIN * sheen_albedo(fmax(1e-4, s * s), fmin(1, root * root), 160);
}

/* ---- printing -------------------------------------------------------------------------------------- */

/* Every number is rounded to a few decimal digits before it becomes a float. */
static void print_rounded(const float *values, int count, int digits)
{
    for (int i = 0; i < count; i++) {
        char text[32];
        float value;
        snprintf(text, sizeof text, "%.*e", digits - 1, (double)values[i]);
        value = strtof(text, NULL);
        fwrite(&value, sizeof value, 1, stdout);
    }
}

static void print_numbers(const float *values, int count) { print_rounded(values, count, 6); }
static void print_short(const float *values, int count) { print_rounded(values, count, 5); }

static void print_interface_means(void)
{
    static float mean[2][ALBEDO_INTERFACE_MEAN_ROWS][ALBEDO_INTERFACE_INDICES];
    static float lost[2][ALBEDO_INTERFACE_LOST_ROWS][ALBEDO_INTERFACE_LOST_INDICES];

    for (int side = 0; side < 2; side++)
        for (int i = 0; i < ALBEDO_INTERFACE_MEAN_ROWS; i++)
            for (int n = 0; n < ALBEDO_INTERFACE_INDICES; n++)
                mean[side][i][n] = (float)interface_mean(side, i, n);
    for (int side = 0; side < 2; side++)
        for (int i = 0; i < ALBEDO_INTERFACE_LOST_ROWS; i++)
            for (int n = 0; n < ALBEDO_INTERFACE_LOST_INDICES; n++)
                lost[side][i][n] = (float)interface_lost_mean(side, i, n);
    print_short(mean[0][0], sizeof mean / sizeof(float));
    print_short(lost[0][0], sizeof lost / sizeof(float));
}

static void print_interface(void)
{
    static float loss[2][ALBEDO_INTERFACE_ROWS][ALBEDO_INTERFACE_INDICES][ALBEDO_INTERFACE_COLUMNS];

    for (int side = 0; side < 2; side++)
        for (int i = 0; i < ALBEDO_INTERFACE_ROWS; i++)
            for (int n = 0; n < ALBEDO_INTERFACE_INDICES; n++)
                for (int c = 0; c < ALBEDO_INTERFACE_COLUMNS; c++)
                    loss[side][i][n][c] = (float)interface_entry(side, i, n, c);
    print_short(loss[0][0][0], sizeof loss / sizeof(float));
}

/* The tables of means depend on those that they are means of: print, compile, print again. */
static void print_losses(void)
{
    static float loss[ALBEDO_ROWS][ALBEDO_COLUMNS], means[2][ALBEDO_MEAN_ROWS];
    static float stretched[ALBEDO_STRETCHED_ROWS][ALBEDO_STRETCHED_RATIOS][ALBEDO_STRETCHED_AZIMUTHS]
                          [ALBEDO_STRETCHED_COLUMNS];
    static float stretched_means[ALBEDO_STRETCHED_MEAN_ROWS][ALBEDO_STRETCHED_MEAN_RATIOS];
    static float sheen[ALBEDO_ROWS][ALBEDO_COLUMNS];

    for (int i = 0; i < ALBEDO_ROWS; i++)
        for (int j = 0; j < ALBEDO_COLUMNS; j++) {
            loss[i][j] = (float)loss_entry(i, j);
            sheen[i][j] = (float)sheen_entry(i, j);
        }
    for (int i = 0; i < ALBEDO_MEAN_ROWS; i++) {
        double a, b;
        row_means(row_alpha((double)i / ALBEDO_MEAN_STEPS), &a, &b);
        means[0][i] = (float)(a / square(row_alpha((double)i / ALBEDO_MEAN_STEPS)));
        means[1][i] = (float)b;
    }
    for (int i = 0; i < ALBEDO_STRETCHED_ROWS; i++)
        for (int r = 0; r < ALBEDO_STRETCHED_RATIOS; r++)
            for (int q = 0; q < ALBEDO_STRETCHED_AZIMUTHS; q++)
                for (int c = 0; c < ALBEDO_STRETCHED_COLUMNS; c++)
                    stretched[i][r][q][c] = (float)stretched_entry(i, r, q, c);
    for (int i = 0; i < ALBEDO_STRETCHED_MEAN_ROWS; i++)
        for (int r = 0; r < ALBEDO_STRETCHED_MEAN_RATIOS; r++)
            stretched_means[i][r] = (float)stretched_mean((double)i / ALBEDO_MEAN_STEPS, 0.5 * r);
    print_numbers(loss[0], ALBEDO_ROWS * ALBEDO_COLUMNS);
    print_numbers(means[0], ALBEDO_MEAN_ROWS);
    print_numbers(means[1], ALBEDO_MEAN_ROWS);
    print_numbers(stretched[0][0][0], sizeof stretched / sizeof(float));
    print_numbers(stretched_means[0], sizeof stretched_means / sizeof(float));
    print_interface();
    print_interface_means();
    print_numbers(sheen[0], ALBEDO_ROWS * ALBEDO_COLUMNS);
}

static void print_exact(void)
{
    static float exact[ALBEDO_EXACT_ROWS][ALBEDO_EXACT_INDICES][ALBEDO_EXACT_COLUMNS];
    static float means[2][ALBEDO_EXACT_ROWS * ALBEDO_EXACT_INDICES];

    for (int i = 0; i < ALBEDO_EXACT_ROWS; i++) {
        double entries[ALBEDO_EXACT_INDICES], mean, kept;
        for (int c = 0; c < ALBEDO_EXACT_COLUMNS; c++) {
            exact_entries(i, c, entries);
            for (int n = 0; n < ALBEDO_EXACT_INDICES; n++)
                exact[i][n][c] = (float)entries[n];
        }
        for (int n = 0; n < ALBEDO_EXACT_INDICES; n++) {
            exact_means(i, n, &mean, &kept);
            means[0][i * ALBEDO_EXACT_INDICES + n] = (float)mean;
            means[1][i * ALBEDO_EXACT_INDICES + n] = (float)kept;
        }
    }
    print_numbers(exact[0][0], sizeof exact / sizeof(float));
    print_numbers(means[0], ALBEDO_EXACT_ROWS * ALBEDO_EXACT_INDICES);
    print_numbers(means[1], ALBEDO_EXACT_ROWS * ALBEDO_EXACT_INDICES);
}

static float rounded_to(double value, int decimals)
{
    char text[32];

    snprintf(text, sizeof text, "%.*f", decimals, value);
    return strtof(text, NULL);
}

static void print_table(void)
{
    static float table[ALBEDO_ROWS][ALBEDO_COLUMNS];
    float averages[ALBEDO_ROWS];

    for (int i = 0; i < ALBEDO_ROWS; i++) {
        for (int j = 0; j < ALBEDO_COLUMNS; j++)
            table[i][j] = rounded_to(table_entry(i, j), 6);
        averages[i] = rounded_to(row_average(table[i]), 7);
    }
    fwrite(table, sizeof table, 1, stdout);
    fwrite(averages, sizeof averages, 1, stdout);
    print_losses();
    print_exact();
}

static void entries_match_their_definition(void **state)
{
    (void)state;
    for (int i = 0; i < ALBEDO_ROWS; i++)
        for (int j = 0; j < ALBEDO_COLUMNS; j++)
            if (fabs(albedo_blend[i][j] - table_entry(i, j)) > 2e-6)
                fail_msg("row %d column %d: %.7f in the table, %.7f computed", i, j, (double)albedo_blend[i][j],
                         table_entry(i, j));
    for (int i = 0; i < ALBEDO_ROWS; i++)
        assert_true(fabs(albedo_blend_average[i] - row_average(albedo_blend[i])) < 1e-6);
}

static void assert_near(const char *table, int index, float got, double want, double tolerance)
{
    if (fabs((double)got - want) > tolerance * fmax(0.05, fabs(want)))
        fail_msg("%s entry %d: %.7g in the table, %.7g computed", table, index, (double)got, want);
}

static void assert_entry(const char *table, int index, float got, double want)
{
    assert_near(table, index, got, want, 2e-5);
}

/* Of the tables that are printed with five digits. */
static void assert_short(const char *table, int index, float got, double want)
{
    assert_near(table, index, got, want, 7e-5);
}

/* Every entry of the tables of losses, and of the means what the tables as they stand yield. */
static void losses_match_their_definition(void **state)
{
    int n = 0;

    (void)state;
    for (int i = 0; i < ALBEDO_ROWS; i++)
        for (int j = 0; j < ALBEDO_COLUMNS; j++, n++) {
            assert_entry("loss", n, albedo_loss[n], loss_entry(i, j));
            assert_entry("sheen", n, albedo_sheen[n], sheen_entry(i, j));
        }
    for (int i = 0; i < ALBEDO_MEAN_ROWS; i++) {
        double alpha = row_alpha((double)i / ALBEDO_MEAN_STEPS), loss, schlick;
        row_means(alpha, &loss, &schlick);
        assert_entry("loss mean", i, albedo_loss_mean[i], loss / (alpha * alpha));
        assert_entry("schlick mean", i, albedo_schlick_mean[i], schlick);
    }
    n = 0;
    for (int i = 0; i < ALBEDO_STRETCHED_ROWS; i++)
        for (int r = 0; r < ALBEDO_STRETCHED_RATIOS; r++)
            for (int q = 0; q < ALBEDO_STRETCHED_AZIMUTHS; q++)
                for (int c = 0; c < ALBEDO_STRETCHED_COLUMNS; c++, n++)
                    assert_entry("stretched", n, albedo_stretched_loss[n], stretched_entry(i, r, q, c));
    n = 0;
    for (int i = 0; i < ALBEDO_STRETCHED_MEAN_ROWS; i++)
        for (int r = 0; r < ALBEDO_STRETCHED_MEAN_RATIOS; r++, n++)
            assert_entry("stretched mean", n, albedo_stretched_mean[n],
                         stretched_mean((double)i / ALBEDO_MEAN_STEPS, 0.5 * r));
    n = 0;
    for (int side = 0; side < 2; side++)
        for (int i = 0; i < ALBEDO_INTERFACE_ROWS; i++)
            for (int r = 0; r < ALBEDO_INTERFACE_INDICES; r++)
                for (int c = 0; c < ALBEDO_INTERFACE_COLUMNS; c++, n++)
                    assert_short("interface", n, albedo_interface_loss[n], interface_entry(side, i, r, c));
    n = 0;
    for (int side = 0; side < 2; side++)
        for (int i = 0; i < ALBEDO_INTERFACE_MEAN_ROWS; i++)
            for (int r = 0; r < ALBEDO_INTERFACE_INDICES; r++, n++)
                assert_short("interface mean", n, albedo_interface_mean[n], interface_mean(side, i, r));
    n = 0;
    for (int side = 0; side < 2; side++)
        for (int i = 0; i < ALBEDO_INTERFACE_LOST_ROWS; i++)
            for (int r = 0; r < ALBEDO_INTERFACE_LOST_INDICES; r++, n++)
                if (n % SOME_MEANS == 0) /* all of them take half a minute */
                    assert_short("interface lost", n, albedo_interface_lost[n], interface_lost_mean(side, i, r));
}

/* Directional albedo of GGX with F = 1, by quadrature independent of this code, good to 1e-4;
 * and the loss between the entries. */
static void losses_are_close_everywhere(void **state)
{
    static const float ALPHAS[6] = {0.0625f, 0.25f, 0.5f, 0.64f, 0.81f, 1};
    static const float MU[6] = {0.05f, 0.1f, 0.25f, 0.5f, 0.75f, 1};
    static const double KNOWN[6][7] = {
        {0.8941, 0.8968, 0.9616, 0.9884, 0.9938, 0.9957, 0.9869},
        {0.9331, 0.8916, 0.8401, 0.8573, 0.8915, 0.9158, 0.8823},
        {0.9126, 0.8601, 0.7652, 0.6983, 0.6821, 0.6879, 0.7003},
        {0.8950, 0.8331, 0.7181, 0.6212, 0.5755, 0.5552, 0.6042},
        {0.8727, 0.7985, 0.6598, 0.5353, 0.4647, 0.4200, 0.5024},
        {0.8478, 0.7602, 0.5976, 0.4507, 0.3645, 0.3069, 0.4092},
    };

    (void)state;
    for (int a = 0; a < 6; a++) {
        struct albedo_loss_row row = albedo_loss_row_find(ALPHAS[a]);
        for (int m = 0; m < 6; m++)
            if (fabs(1 - (double)albedo_loss_at(&row, MU[m]) - KNOWN[a][m]) > 2e-3)
                fail_msg("alpha %g mu %g: %g, should be %g", (double)ALPHAS[a], (double)MU[m],
                         1 - (double)albedo_loss_at(&row, MU[m]), KNOWN[a][m]);
        assert_true(fabs(1 - (double)row.mean - KNOWN[a][6]) < 1.3e-3);
    }
    for (double r = 0.5; r < ALBEDO_ROWS - 1; r += 2.3)
        for (double c = 0.02; c < 1; c += 0.043) {
            double alpha = row_alpha(r), mu = fmin(1, column_mu(c, alpha)), loss;
            struct albedo_loss_row row = albedo_loss_row_find((float)alpha);
            loss = ggx_loss(mu, alpha, 96);
            if (fabs(loss - (double)albedo_loss_at(&row, (float)mu)) > 2e-3)
                fail_msg("alpha %g mu %g: loss %g, should be %g", alpha, mu, (double)albedo_loss_at(&row, (float)mu),
                         loss);
        }
}

static void exact_match_their_definition(void **state)
{
    (void)state;
    for (int i = 0; i < ALBEDO_EXACT_ROWS; i++) {
        double entries[ALBEDO_EXACT_INDICES], mean, kept;
        for (int c = 0; c < ALBEDO_EXACT_COLUMNS; c++) {
            exact_entries(i, c, entries);
            for (int n = 0; n < ALBEDO_EXACT_INDICES; n++) {
                int at = (i * ALBEDO_EXACT_INDICES + n) * ALBEDO_EXACT_COLUMNS + c;
                assert_entry("exact", at, albedo_exact[at], entries[n]);
            }
        }
        for (int n = 0; n < ALBEDO_EXACT_INDICES; n++) {
            int at = i * ALBEDO_EXACT_INDICES + n;
            exact_means(i, n, &mean, &kept);
            assert_entry("mean of exact", at, albedo_exact_mean[at], mean);
            assert_entry("kept mean of exact", at, albedo_exact_kept_mean[at], kept);
        }
    }
}

/* Between the entries: near the truth, and the base never gets what was reflected. */
static void exact_is_close_everywhere(void **state)
{
    enum { COUNT = 9 };
    static const double IORS[COUNT] = {1.2, 1.25, 1.33, 1.45, 1.5, 1.7, 2, 2.6, 3};
    double r[COUNT], above[COUNT], sum = 0;
    int count = 0;

    (void)state;
    for (int k = 0; k < COUNT; k++)
        r[k] = (IORS[k] - 1) / (IORS[k] + 1);
    for (double row = 0; row <= ALBEDO_EXACT_ROWS - 1; row += 0.5)
        for (double s = 0.02; s < 1; s += 0.0313) {
            float alpha = (float)exact_alpha(row), mu = (float)(s * s);
            exact_above((double)mu, (double)alpha, 64, r, COUNT, above);
            for (int k = 0; k < COUNT; k++) {
                struct albedo_exact t = albedo_exact_find(alpha, (float)IORS[k]);
                double got = (double)albedo_exact_at(&t, mu), off = got - above[k];
                sum += off * off;
                count++;
                if (off < -EXACT_BELOW || off > EXACT_ABOVE)
                    fail_msg("alpha %g ior %g mu %g: %g, should be %g", (double)alpha, IORS[k], (double)mu, got,
                             above[k]);
            }
        }
    assert_true(sqrt(sum / count) < 2e-3);
}

/* Between the entries: near the truth, and a plastic of ior 1.5 gains no energy. */
static void interpolation_is_close_and_gains_nothing(void **state)
{
    double sum = 0;
    int count = 0;

    (void)state;
    for (double row = 0.5; row < ALBEDO_ROWS - 1; row += 1.5)
        for (double s = 0.01; s < 1; s += 0.0213) {
            float alpha = (float)row_alpha(row), mu = (float)(s * s);
            struct albedo_row found = albedo_row_find(alpha);
            double all, schlick, blend = albedo_blend_at(&found, mu), total;
            ggx_albedo(mu, alpha, 64, &all, &schlick);
            sum += (blend - schlick / all) * (blend - schlick / all);
            count++;
            if (fabs(blend - schlick / all) > 0.01)
                fail_msg("alpha %g, mu %g: %g, should be %g", (double)alpha, (double)mu, blend, schlick / all);
            total = 0.04 * (all - schlick) + schlick + 1 - (0.04 + 0.96 * blend);
            if (total > 1 + 2e-4)
                fail_msg("alpha %g, mu %g: sends out %g", (double)alpha, (double)mu, total);
        }
    assert_true(sqrt(sum / count) < 1e-3);
}

/* The alpha by which a stretched plastic's base is scaled: what is reflected in any azimuth is
 * taken from it, and in the mean over the hemisphere not much more. */
static void stretched_layer_takes_what_is_reflected(void **state)
{
    static const double WIDE[] = {0.01, 0.03, 0.1, 0.2, 0.35, 0.5, 0.7, 1};
    static const double RATIOS[] = {0.001, 0.05, 0.1, 0.2, 0.3, 0.45, 0.6, 0.8, 0.95};
    double most = -1;
    enum { COSINES = 12, TURNS = 4 };

    (void)state;
    assert_true(ALBEDO_ALPHA_FIRST == BSDF_ALPHA_MIN);
    for (int k = 0; k < 8 * 9; k++) {
        double ax = WIDE[k / 9], ay = fmax(BSDF_ALPHA_MIN, ax * RATIOS[k % 9]), sum = 0, all = 0;
        struct albedo_row row = albedo_row_find(albedo_stretched_layer((float)ax, (float)ay));
        for (int i = 0; i < COSINES * (TURNS + 1); i++) {
            double s = (i / (TURNS + 1) + 0.5) / COSINES, mu = s * s, schlick, taken;
            double cosine = cos(0.5 * M_PI * (i % (TURNS + 1)) / TURNS);
            double weight = s * mu * (i % (TURNS + 1) % TURNS ? 1 : 0.5);
            stretched_loss(mu, cosine * cosine, ax, ay, &schlick);
            taken = (double)albedo_blend_at(&row, (float)mu);
            most = fmax(most, schlick - taken);
            sum += weight * (taken - schlick);
            all += weight;
            if (schlick - taken > 0.004)
                fail_msg("alphas %g %g, mu %g, azimuth's cosine %g: %g, which is above %g", ax, ay, mu, cosine, schlick,
                         taken);
        }
        if (!(sum / all < 0.04))
            fail_msg("alphas %g %g: %g too much is taken", ax, ay, sum / all);
    }
    assert_true(most > 0.003); /* as albedo.h and docs/NUMERICS.md say */
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(entries_match_their_definition),
        cmocka_unit_test(losses_match_their_definition),
        cmocka_unit_test(losses_are_close_everywhere),
        cmocka_unit_test(exact_match_their_definition),
        cmocka_unit_test(exact_is_close_everywhere),
        cmocka_unit_test(interpolation_is_close_and_gains_nothing),
        cmocka_unit_test(stretched_layer_takes_what_is_reflected),
    };

    if (argc > 1 && strcmp(argv[1], "--print") == 0) {
        print_table();
        return 0;
    }
    return cmocka_run_group_tests_name("albedo_table", tests, NULL, NULL);
}
