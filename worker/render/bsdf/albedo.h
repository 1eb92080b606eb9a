/* albedo: how much of a rough dielectric's light its reflection takes, on average.
 *
 * For a GGX surface with Schlick's Fresnel term the mean reflectance of the microfacets
 * seen along mu = cos theta is f0 + (f90 - f0) * blend(mu, alpha), where blend is the mean
 * of (1 - v.h)^5 weighted by masking and shadowing. The layer below gets what is left:
 * its BRDF is scaled by (1 - mean(mu_o)) (1 - mean(mu_i)) / (1 - mean_average), after
 * Kelemen and Szirmay-Kalos 2001, which is reciprocal and sends out exactly
 * 1 - mean(mu_o) of a white layer.
 *
 * `blend` is tabulated (tests/numerics/test_albedo_table.c recomputes the table, checks it
 * and prints it with --print); columns are equal in sqrt(mu) from 0 to 1, rows in
 * sqrt(alpha) from sqrt(BSDF_ALPHA_MIN) to 1. The entries are raised by ALBEDO_MARGIN, so
 * that interpolation never lets layer and reflection together send out more than came in.
 */
#ifndef AZULEJO_RENDER_ALBEDO_H
#define AZULEJO_RENDER_ALBEDO_H

#include <math.h>

enum { ALBEDO_ROWS = 32, ALBEDO_COLUMNS = 32 };
#define ALBEDO_ROW_FIRST 0.031622777f /* sqrt(BSDF_ALPHA_MIN) */
#define ALBEDO_MARGIN 1.003f

extern const float albedo_blend[ALBEDO_ROWS][ALBEDO_COLUMNS];
/* Cosine-weighted hemispherical mean of each row as it is interpolated. */
extern const float albedo_blend_average[ALBEDO_ROWS];

/* Where an alpha lies between two rows. */
struct albedo_row {
    const float *low;  /* the row below; the one above follows it */
    float average;     /* hemispherical mean of blend */
    float t;
};

/* alpha in BSDF_ALPHA_MIN..1. */
static inline struct albedo_row albedo_row_find(float alpha)
{
    float x = (sqrtf(alpha) - ALBEDO_ROW_FIRST) *
              ((float)(ALBEDO_ROWS - 1) / (1.0f - ALBEDO_ROW_FIRST));
    int row = x > 0.0f ? (int)x : 0;
    struct albedo_row r;

    row = row < ALBEDO_ROWS - 2 ? row : ALBEDO_ROWS - 2;
    r.low = albedo_blend[row];
    r.t = x > 0.0f ? x - (float)row : 0.0f;
    r.average = albedo_blend_average[row] +
                (albedo_blend_average[row + 1] - albedo_blend_average[row]) * r.t;
    return r;
}

/* blend(mu) of that row, mu in 0..1. */
static inline float albedo_blend_at(const struct albedo_row *r, float mu)
{
    float x = sqrtf(mu) * (float)(ALBEDO_COLUMNS - 1), a, b;
    int column = (int)x;
    const float *low;

    column = column < ALBEDO_COLUMNS - 2 ? column : ALBEDO_COLUMNS - 2;
    x -= (float)column;
    low = r->low + column;
    a = low[0] + (low[1] - low[0]) * x;
    b = low[ALBEDO_COLUMNS] + (low[ALBEDO_COLUMNS + 1] - low[ALBEDO_COLUMNS]) * x;
    return a + (b - a) * r->t;
}

#endif
