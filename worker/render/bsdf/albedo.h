/* albedo: how much of a rough dielectric's light its reflection takes, on average.
 *
 * For a GGX surface with Schlick's Fresnel term the mean reflectance of the microfacets seen along mu = cos theta is f0
 * + (f90 - f0) * blend(mu, alpha), where blend is the mean of (1 - v.h)^5 weighted by masking and shadowing. The layer
 * below gets the rest: its BRDF is scaled by (1 - mean(mu_o)) (1 - mean(mu_i)) / (1 - mean_average), after Kelemen and
 * Szirmay-Kalos 2001. This is reciprocal, and a white layer sends out exactly 1 - mean(mu_o).
 *
 * `blend` is tabulated (tests/numerics/test_albedo_table.c recomputes the table, checks it and prints it with --print).
 * Columns are equally spaced in sqrt(mu) from 0 to 1, rows in sqrt(alpha) from sqrt(BSDF_ALPHA_MIN) to 1. The entries
 * are raised by ALBEDO_MARGIN, so that interpolation never lets layer and reflection together send out more than came
 * in.
 */
#pragma once

#include <math.h>

#include "common/math/vec.h"

enum { ALBEDO_ROWS = 32, ALBEDO_COLUMNS = 32 };
#define ALBEDO_ALPHA_FIRST REAL(1e-3)      /* BSDF_ALPHA_MIN */
#define ALBEDO_ROW_FIRST REAL(0.031622777) /* its root */
#define ALBEDO_MARGIN REAL(1.003)

extern const float32 albedo_blend[ALBEDO_ROWS][ALBEDO_COLUMNS];
/* Cosine-weighted hemispherical mean of each row as it is interpolated. */
extern const float32 albedo_blend_average[ALBEDO_ROWS];

/* The position of an alpha between two rows. */
struct albedo_row {
    const float32 *low; /* the row below; the one above follows it */
    real average;       /* hemispherical mean of blend */
    real t;
};

/* alpha in BSDF_ALPHA_MIN..1. */
static inline struct albedo_row albedo_row_find(real alpha)
{
    real x = (real_sqrt(alpha) - ALBEDO_ROW_FIRST) * ((real)(ALBEDO_ROWS - 1) / (1.0f - ALBEDO_ROW_FIRST));
    int row = x > 0.0f ? (int)x : 0;
    struct albedo_row r;

    row = row < ALBEDO_ROWS - 2 ? row : ALBEDO_ROWS - 2;
    r.low = albedo_blend[row];
    r.t = x > 0.0f ? x - (real)row : 0.0f;
    r.average = albedo_blend_average[row] + (albedo_blend_average[row + 1] - albedo_blend_average[row]) * r.t;
    return r;
}

/* blend(mu) of that row, mu in 0..1. */
static inline real albedo_blend_at(const struct albedo_row *r, real mu)
{
    real x = real_sqrt(mu) * (real)(ALBEDO_COLUMNS - 1), a, b;
    int column = (int)x;
    const float32 *low;

    column = column < ALBEDO_COLUMNS - 2 ? column : ALBEDO_COLUMNS - 2;
    x -= (real)column;
    low = r->low + column;
    a = low[0] + (low[1] - low[0]) * x;
    b = low[ALBEDO_COLUMNS] + (low[ALBEDO_COLUMNS + 1] - low[ALBEDO_COLUMNS]) * x;
    return a + (b - a) * r->t;
}

/* ---- the exact Fresnel term --------------------------------------------------------------------
 *
 * Schlick's formula is up to a fifth below Fresnel's equations around 60 degrees for an index of
 * 1.5. Write the exact term as F = f0 + (1 - f0) w. The table holds the difference between the mean
 * of w and Schlick's blend, over (alpha, r = (n - 1) / (n + 1), mu). Rows are equally spaced in the
 * fourth root of alpha and in sqrt(r) for n from 1.2 to 3, columns in sqrt(mu). The entries are
 * raised by ALBEDO_EXACT_MARGIN. Means over the hemisphere are of the function as it is
 * interpolated: of itself, and of itself times what GGX keeps. */
enum { ALBEDO_EXACT_ROWS = 12, ALBEDO_EXACT_INDICES = 9, ALBEDO_EXACT_COLUMNS = 24 };
#define ALBEDO_EXACT_IOR_FIRST REAL(1.2)
#define ALBEDO_EXACT_IOR_LAST 3.0f
#define ALBEDO_EXACT_ROW_FIRST REAL(0.17782794) /* fourth root of ALBEDO_ALPHA_FIRST */
#define ALBEDO_EXACT_ROOT_FIRST REAL(0.30151134) /* sqrt(r) of these */
#define ALBEDO_EXACT_ROOT_LAST REAL(0.70710678)
#define ALBEDO_EXACT_MARGIN REAL(1e-3)
extern const float32 albedo_exact[ALBEDO_EXACT_ROWS * ALBEDO_EXACT_INDICES * ALBEDO_EXACT_COLUMNS];
extern const float32 albedo_exact_mean[ALBEDO_EXACT_ROWS * ALBEDO_EXACT_INDICES];
extern const float32 albedo_exact_kept_mean[ALBEDO_EXACT_ROWS * ALBEDO_EXACT_INDICES];

struct albedo_exact {
    const float32 *low;
    real row, index; /* how far between the neighbours */
    real mean, kept_mean;
    real smooth_mean; /* for no roughness: never above the true value, since it has no table */
};

/* mu in 0..1. */
static inline real albedo_exact_at(const struct albedo_exact *t, real mu)
{
    real x = real_sqrt(mu) * (real)(ALBEDO_EXACT_COLUMNS - 1), v[2];
    int column = (int)x;
    const float32 *low;

    column = column < ALBEDO_EXACT_COLUMNS - 2 ? column : ALBEDO_EXACT_COLUMNS - 2;
    x -= (real)column;
    low = t->low + column;
    for (int i = 0; i < 2; i++) {
        const float32 *p = low + i * ALBEDO_EXACT_INDICES * ALBEDO_EXACT_COLUMNS;
        const float32 *n = p + ALBEDO_EXACT_COLUMNS;
        real a = p[0] + (p[1] - p[0]) * x, b = n[0] + (n[1] - n[0]) * x;
        v[i] = a + (b - a) * t->index;
    }
    return v[0] + (v[1] - v[0]) * t->row;
}

/* ---- what GGX loses ------------------------------------------------------------------------
 *
 * Smith's single scattering drops the light that meets a second microfacet: with unit Fresnel term,
 * 1 - E(mu, alpha) of it. `albedo_loss` tabulates that loss. Its columns are equally spaced in
 * c = sqrt(mu (1 + alpha) / (mu + alpha)), because at small alpha the loss is a function of mu /
 * alpha alone, largest near mu = alpha. Linear interpolation is then accurate to 0.002 for every mu
 * and alpha (32 columns in sqrt(mu) are not accurate to 0.01). The entries are the loss over
 * (1 - c^2)^2 + alpha^2, which falls off in the same way. Rows as above. Hemispherical means are of
 * the function as it is interpolated, so that the compensation computed from them adds up; their
 * rows are ALBEDO_MEAN_STEPS times denser, because the columns' positions move with alpha. Means of
 * losses are tabulated over alpha^2 (of the wider alpha), with which they grow. */
enum { ALBEDO_MEAN_STEPS = 4, ALBEDO_MEAN_ROWS = ALBEDO_MEAN_STEPS * (ALBEDO_ROWS - 1) + 1 };
extern const float32 albedo_loss[ALBEDO_ROWS * ALBEDO_COLUMNS];
extern const float32 albedo_loss_mean[ALBEDO_MEAN_ROWS];
extern const float32 albedo_schlick_mean[ALBEDO_MEAN_ROWS]; /* of (1 - loss) blend */

struct albedo_loss_row {
    const float32 *low;
    real t, alpha;
    real mean, schlick_mean;
};

/* x = 0..last of a table; x and x + 1 are then the neighbouring entries. */
static inline int albedo_cell(real *x, int count)
{
    int cell = *x > 0.0f ? (int)*x : 0;

    cell = cell < count - 2 ? cell : count - 2;
    *x = *x > 0.0f ? *x - (real)cell : 0.0f;
    return cell;
}

/* alpha in BSDF_ALPHA_MIN..1. */
static inline struct albedo_loss_row albedo_loss_row_find(real alpha)
{
    real x = (real_sqrt(alpha) - ALBEDO_ROW_FIRST) * ((real)(ALBEDO_ROWS - 1) / (1.0f - ALBEDO_ROW_FIRST));
    real y = x * (real)ALBEDO_MEAN_STEPS;
    struct albedo_loss_row r;
    int mean = albedo_cell(&y, ALBEDO_MEAN_ROWS);

    r.low = albedo_loss + albedo_cell(&x, ALBEDO_ROWS) * ALBEDO_COLUMNS;
    r.t = x;
    r.alpha = alpha;
    r.mean = albedo_loss_mean[mean] + (albedo_loss_mean[mean + 1] - albedo_loss_mean[mean]) * y;
    r.mean *= alpha * alpha;
    r.schlick_mean = albedo_schlick_mean[mean] + (albedo_schlick_mean[mean + 1] - albedo_schlick_mean[mean]) * y;
    return r;
}

/* c of mu, 0..1; and the factor of the entries there. */
static inline real albedo_loss_column(real alpha, real mu, real *scale)
{
    real c2 = mu * (1.0f + alpha) / (mu + alpha);

    c2 = c2 < 1.0f ? c2 : 1.0f;
    *scale = (1.0f - c2) * (1.0f - c2) + alpha * alpha;
    return real_sqrt(c2);
}

/* mu in 0..1. */
static inline real albedo_loss_at(const struct albedo_loss_row *r, real mu)
{
    real scale, x = albedo_loss_column(r->alpha, mu, &scale) * (real)(ALBEDO_COLUMNS - 1), a, b;
    const float32 *low = r->low + albedo_cell(&x, ALBEDO_COLUMNS);

    a = low[0] + (low[1] - low[0]) * x;
    b = low[ALBEDO_COLUMNS] + (low[ALBEDO_COLUMNS + 1] - low[ALBEDO_COLUMNS]) * x;
    return (a + (b - a) * r->t) * scale;
}

static inline real albedo_exact_between(const float32 *p, real row, real index)
{
    const float32 *n = p + ALBEDO_EXACT_INDICES;
    real a = p[0] + (p[1] - p[0]) * index, b = n[0] + (n[1] - n[0]) * index;

    return a + (b - a) * row;
}

/* alpha in 0..1, n in ALBEDO_EXACT_IOR_FIRST..LAST. */
static inline struct albedo_exact albedo_exact_find(real alpha, real n)
{
    real row = (real_sqrt(real_sqrt(alpha)) - ALBEDO_EXACT_ROW_FIRST) *
               ((real)(ALBEDO_EXACT_ROWS - 1) / (1.0f - ALBEDO_EXACT_ROW_FIRST));
    real index = (real_sqrt((n - 1.0f) / (n + 1.0f)) - ALBEDO_EXACT_ROOT_FIRST) *
                 ((real)(ALBEDO_EXACT_INDICES - 1) / (ALBEDO_EXACT_ROOT_LAST - ALBEDO_EXACT_ROOT_FIRST));
    int i = albedo_cell(&row, ALBEDO_EXACT_ROWS), k = albedo_cell(&index, ALBEDO_EXACT_INDICES);
    struct albedo_exact t;

    t.row = row;
    t.index = index;
    t.low = albedo_exact + (i * ALBEDO_EXACT_INDICES + k) * ALBEDO_EXACT_COLUMNS;
    i = i * ALBEDO_EXACT_INDICES + k;
    t.mean = albedo_exact_between(albedo_exact_mean + i, row, index);
    t.kept_mean = albedo_exact_between(albedo_exact_kept_mean + i, row, index);
    t.smooth_mean = albedo_exact_between(albedo_exact_mean + k, 0, index) - ALBEDO_EXACT_MARGIN;
    return t;
}

/* ---- stretched GGX: the loss depends on the azimuth, too ----------------------------------------
 *
 * Tables over (alpha x, alpha y / alpha x, azimuth, mu), x the wider. The azimuth enters as the
 * alpha across the direction, sqrt(ax^2 cos^2 + ay^2 sin^2) = ay + (ax - ay) q^2, with equal steps
 * in q. That alpha also replaces alpha in the columns (but the entries are over (1 - c^2)^2 + ax^2:
 * seen from above both alphas count). */
enum {
    ALBEDO_STRETCHED_ROWS = 8,
    ALBEDO_STRETCHED_RATIOS = 6,
    ALBEDO_STRETCHED_AZIMUTHS = 4,
    ALBEDO_STRETCHED_COLUMNS = 12,
    ALBEDO_STRETCHED_MEAN_ROWS = ALBEDO_MEAN_STEPS * (ALBEDO_STRETCHED_ROWS - 1) + 1,
    ALBEDO_STRETCHED_MEAN_RATIOS = 2 * (ALBEDO_STRETCHED_RATIOS - 1) + 1,
};
extern const float32 albedo_stretched_loss[ALBEDO_STRETCHED_ROWS * ALBEDO_STRETCHED_RATIOS * ALBEDO_STRETCHED_AZIMUTHS *
                                           ALBEDO_STRETCHED_COLUMNS];
extern const float32 albedo_stretched_mean[ALBEDO_STRETCHED_MEAN_ROWS * ALBEDO_STRETCHED_MEAN_RATIOS];

struct albedo_stretched {
    const float32 *low;
    real row, ratio; /* how far between the neighbours */
    real x, y, inverse_range;
    real mean;
};

/* 1 >= alpha_x >= alpha_y >= BSDF_ALPHA_MIN. */
static inline struct albedo_stretched albedo_stretched_find(real alpha_x, real alpha_y)
{
    real row =
        (real_sqrt(alpha_x) - ALBEDO_ROW_FIRST) * ((real)(ALBEDO_STRETCHED_ROWS - 1) / (1.0f - ALBEDO_ROW_FIRST));
    real ratio = alpha_y / alpha_x * (real)(ALBEDO_STRETCHED_RATIOS - 1), a, b;
    real mean_row = row * (real)ALBEDO_MEAN_STEPS, mean_ratio = ratio * 2.0f;
    int i = albedo_cell(&row, ALBEDO_STRETCHED_ROWS);
    int k = albedo_cell(&ratio, ALBEDO_STRETCHED_RATIOS);
    const float32 *mean =
        albedo_stretched_mean + albedo_cell(&mean_row, ALBEDO_STRETCHED_MEAN_ROWS) * ALBEDO_STRETCHED_MEAN_RATIOS;
    struct albedo_stretched s;

    s.low = albedo_stretched_loss +
            (i * ALBEDO_STRETCHED_RATIOS + k) * ALBEDO_STRETCHED_AZIMUTHS * ALBEDO_STRETCHED_COLUMNS;
    s.row = row;
    s.ratio = ratio;
    s.x = alpha_x;
    s.y = alpha_y;
    s.inverse_range = alpha_x > alpha_y ? 1.0f / (alpha_x - alpha_y) : 0.0f;
    mean += albedo_cell(&mean_ratio, ALBEDO_STRETCHED_MEAN_RATIOS);
    a = mean[0] + (mean[1] - mean[0]) * mean_ratio;
    mean += ALBEDO_STRETCHED_MEAN_RATIOS;
    b = mean[0] + (mean[1] - mean[0]) * mean_ratio;
    s.mean = (a + (b - a) * mean_row) * (alpha_x * alpha_x);
    return s;
}

/* Loss along a unit direction; mu = |z|. */
static inline real albedo_stretched_loss_at(const struct albedo_stretched *s, real x, real y, real mu)
{
    enum {
        RATIO = ALBEDO_STRETCHED_AZIMUTHS * ALBEDO_STRETCHED_COLUMNS,
        ROW = ALBEDO_STRETCHED_RATIOS * RATIO
    };
    real side2 = x * x + y * y, across, q, column, scale, v[2];
    const float32 *low;

    across =
        side2 > REAL(1e-12) ? real_sqrt((s->x * s->x * (x * x) + s->y * s->y * (y * y)) / side2) : 0.5f * (s->x + s->y);
    q = real_sqrt(real_max(0.0f, (across - s->y) * s->inverse_range)) * (real)(ALBEDO_STRETCHED_AZIMUTHS - 1);
    column = albedo_loss_column(across, mu, &scale) * (real)(ALBEDO_STRETCHED_COLUMNS - 1);
    q = real_min(q, (real)(ALBEDO_STRETCHED_AZIMUTHS - 1));
    low = s->low + albedo_cell(&q, ALBEDO_STRETCHED_AZIMUTHS) * ALBEDO_STRETCHED_COLUMNS;
    low += albedo_cell(&column, ALBEDO_STRETCHED_COLUMNS);
    for (int i = 0; i < 2; i++) {
        real w[2];
        for (int k = 0; k < 2; k++) {
            const float32 *p = low + i * ROW + k * RATIO, *n = p + ALBEDO_STRETCHED_COLUMNS;
            real a = p[0] + (p[1] - p[0]) * column, b = n[0] + (n[1] - n[0]) * column;
            w[k] = a + (b - a) * q;
        }
        v[i] = w[0] + (w[1] - w[0]) * s->ratio;
    }
    return (v[0] + (v[1] - v[0]) * s->row) * (scale - across * across + s->x * s->x);
}

/* The alpha whose `blend` is, in every azimuth, at least the mean Schlick weight of a stretched distribution. It is
 * smaller than the narrow alpha: to a viewer across the stretch the visible microfacets lean sideways, which lowers
 * v.h. Found by quadrature (docs/NUMERICS.md), according to which the weight exceeds the blend by at most 0.004. 1 >=
 * alpha_x >= alpha_y >= BSDF_ALPHA_MIN. */
static inline real albedo_stretched_layer(real alpha_x, real alpha_y)
{
    real alpha = alpha_y * real_sqrt(alpha_y / alpha_x);

    return alpha > ALBEDO_ALPHA_FIRST ? alpha : ALBEDO_ALPHA_FIRST;
}

/* ---- rough dielectrics ---------------------------------------------------------------------------
 *
 * What reflection and refraction together lose, seen from the thinner (side 0) or the denser side
 * (1), over (alpha, r^(1/4) with r = (n - 1) / (n + 1), mu). Just inside a slightly denser medium
 * nearly all light is lost at grazing angles: refraction lifts it above the horizon. Where that
 * begins depends on r, hence the fourth root. Below ALBEDO_INTERFACE_FIRST (n = 1.008) no table of
 * this size is accurate enough. Rows are equally spaced in sqrt(alpha), from the alpha below which
 * nothing is returned. Columns are equally spaced in c (1 + c) / 2, c = mu (1 + alpha) / (mu +
 * alpha): closer than the other tables' towards c = 1, because there the loss of a wide
 * distribution is steep. Entries are the loss over (1 - c)(1 - c + alpha) + alpha^2 / 2. */
enum {
    ALBEDO_INTERFACE_ROWS = 12,
    ALBEDO_INTERFACE_INDICES = 16,
    ALBEDO_INTERFACE_COLUMNS = 24,
    ALBEDO_INTERFACE_MEAN_ROWS = ALBEDO_MEAN_STEPS * (ALBEDO_INTERFACE_ROWS - 1) + 1,
    ALBEDO_INTERFACE_LOST_ROWS = 2 * (ALBEDO_INTERFACE_ROWS - 1) + 1,
    ALBEDO_INTERFACE_LOST_INDICES = 2 * (ALBEDO_INTERFACE_INDICES - 1) + 1,
};
#define ALBEDO_INTERFACE_FIRST 0.25f /* the first index's fourth root of r */
#define ALBEDO_INTERFACE_ALPHA_FIRST REAL(0.02)
#define ALBEDO_INTERFACE_ROW_FIRST REAL(0.14142136) /* its root */
extern const float32
    albedo_interface_loss[2 * ALBEDO_INTERFACE_ROWS * ALBEDO_INTERFACE_INDICES * ALBEDO_INTERFACE_COLUMNS];
/* Hemispherical means: of the loss as it is interpolated, over alpha^2 (linear between the indices, as the loss itself
 * is), and of the loss in truth, over alpha. Their quotient corrects the interpolated loss, so that light inside a
 * body, which meets its surface many times before it leaves, is right on average. */
extern const float32 albedo_interface_mean[2 * ALBEDO_INTERFACE_MEAN_ROWS * ALBEDO_INTERFACE_INDICES];
extern const float32 albedo_interface_lost[2 * ALBEDO_INTERFACE_LOST_ROWS * ALBEDO_INTERFACE_LOST_INDICES];

struct albedo_interface {
    const float32 *low;
    real row, index;
    real mean, lost; /* the means above */
};

/* Between four entries of a table of means with `width` entries a row. */
static inline real albedo_mean_between(const float32 *t, int width, real row, real column)
{
    real a = t[0] + (t[1] - t[0]) * column;
    real b = t[width] + (t[width + 1] - t[width]) * column;
    return a + (b - a) * row;
}

/* alpha in ALBEDO_INTERFACE_ALPHA_FIRST..1. */
static inline struct albedo_interface albedo_interface_find(real alpha, real r, int side)
{
    real row = (real_sqrt(alpha) - ALBEDO_INTERFACE_ROW_FIRST) *
               ((real)(ALBEDO_INTERFACE_ROWS - 1) / (1.0f - ALBEDO_INTERFACE_ROW_FIRST));
    real index = (real_sqrt(real_sqrt(r)) - ALBEDO_INTERFACE_FIRST) *
                 ((real)(ALBEDO_INTERFACE_INDICES - 1) / (1.0f - ALBEDO_INTERFACE_FIRST));
    real mean_row = row * (real)ALBEDO_MEAN_STEPS, lost_row = row * 2.0f, lost_index = index * 2.0f;
    int i = albedo_cell(&row, ALBEDO_INTERFACE_ROWS) + side * ALBEDO_INTERFACE_ROWS;
    int k = albedo_cell(&index, ALBEDO_INTERFACE_INDICES);
    struct albedo_interface t;

    t.low = albedo_interface_loss + (i * ALBEDO_INTERFACE_INDICES + k) * ALBEDO_INTERFACE_COLUMNS;
    t.row = row;
    t.index = index;
    i = albedo_cell(&mean_row, ALBEDO_INTERFACE_MEAN_ROWS) + side * ALBEDO_INTERFACE_MEAN_ROWS;
    t.mean = albedo_mean_between(albedo_interface_mean + i * ALBEDO_INTERFACE_INDICES + k,
                                 ALBEDO_INTERFACE_INDICES, mean_row, index) * (alpha * alpha);
    i = albedo_cell(&lost_row, ALBEDO_INTERFACE_LOST_ROWS) + side * ALBEDO_INTERFACE_LOST_ROWS;
    k = albedo_cell(&lost_index, ALBEDO_INTERFACE_LOST_INDICES);
    t.lost = albedo_mean_between(albedo_interface_lost + i * ALBEDO_INTERFACE_LOST_INDICES + k,
                                 ALBEDO_INTERFACE_LOST_INDICES, lost_row, lost_index) * alpha;
    return t;
}

static inline real albedo_interface_loss_at(const struct albedo_interface *t, real alpha, real mu)
{
    real c = real_min(mu * (1.0f + alpha) / (mu + alpha), 1.0f), v[2];
    real column = c * (1.0f + c) * (0.5f * (real)(ALBEDO_INTERFACE_COLUMNS - 1)), rest = 1.0f - c;
    const float32 *low = t->low + albedo_cell(&column, ALBEDO_INTERFACE_COLUMNS);

    for (int i = 0; i < 2; i++) {
        const float32 *p = low + i * ALBEDO_INTERFACE_INDICES * ALBEDO_INTERFACE_COLUMNS;
        const float32 *n = p + ALBEDO_INTERFACE_COLUMNS;
        real a = p[0] + (p[1] - p[0]) * column, b = n[0] + (n[1] - n[0]) * column;
        v[i] = a + (b - a) * t->index;
    }
    return (v[0] + (v[1] - v[0]) * t->row) * (rest * (rest + alpha) + 0.5f * (alpha * alpha));
}

/* ---- sheen: directional albedo of Charlie's distribution ----------------------------------------
 *
 * Rows equally spaced in sqrt(alpha) from sqrt(BSDF_SHEEN_ALPHA_MIN) to 1, columns in sqrt(mu).
 * Raised by ALBEDO_MARGIN. Above 1 for a small alpha at grazing angles. */
#define BSDF_SHEEN_ALPHA_MIN REAL(0.01)
extern const float32 albedo_sheen[ALBEDO_ROWS * ALBEDO_COLUMNS];

static inline real albedo_sheen_at(real alpha, real mu)
{
    real x = real_sqrt(mu) * (real)(ALBEDO_COLUMNS - 1), a, b;
    real y = (real_sqrt(alpha) - REAL(0.1)) * ((real)(ALBEDO_ROWS - 1) / (1.0f - REAL(0.1)));
    const float32 *low = albedo_sheen + albedo_cell(&y, ALBEDO_ROWS) * ALBEDO_COLUMNS;

    low += albedo_cell(&x, ALBEDO_COLUMNS);
    a = low[0] + (low[1] - low[0]) * x;
    b = low[ALBEDO_COLUMNS] + (low[ALBEDO_COLUMNS + 1] - low[ALBEDO_COLUMNS]) * x;
    return a + (b - a) * y;
}
