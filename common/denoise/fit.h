/* fit: a model of first order around each pixel, colour = c + gradient * (normal, position), fitted with the joint
 * filter's weights; its value at the pixel, c, is less biased than a mean where light changes evenly. Private to
 * common/denoise; these functions are compiled into joint.c's loops. Bitterli et al. 2016, with one normal equation a pixel. */
#pragma once

#include <math.h>

#include "common/denoise/block.h"
#include "common/denoise/wide.h"

/* Of the joint filter's distances: fits take in more, since the model explains part of the difference. */
#define FIT_COLOURS 0.5f
#define FIT_NORMALS 0.03f
/* Gradients are held back as if so much squared distance had been seen without a change of colour: of positions (in
 * window radii), and of normals over what counts as 1 in the joint filter. */
#define FIT_RIDGE_POSITION 0.0003f
#define FIT_RIDGE_NORMAL 0.0005f
/* A fit needs at least this share of the weights where gradients leave it: below, it is extrapolated. */
#define FIT_LEAST 0.02f

enum {
    FIT_GRADIENT = 5, /* normal, position */
    FIT_SQUARES = FIT_GRADIENT * (FIT_GRADIENT + 1) / 2,
    /* Sums over the window, of weights: times 1, times each variable, times products of two, times colours, times
     * products of colours and variables. */
    FIT_ONE = 0,
    FIT_FIRST = 1,
    FIT_SECOND = FIT_FIRST + FIT_GRADIENT,
    FIT_COLOUR = FIT_SECOND + FIT_SQUARES,
    FIT_MIXED = FIT_COLOUR + 3,
    FIT_SUMS = FIT_MIXED + 3 * FIT_GRADIENT,
};
_Static_assert((int)FIT_SUMS == (int)BLOCK_SUMS, "a block has room for a fit's sums");

/* sums += products of a line of pixels. */
static INLINE void fit_add(float *restrict sums, const float *restrict first, const float *restrict second)
{
    for (int x = 0; x < BLOCK_INNER; x++)
        sums[x] += first[x] * second[x];
}

/* What one pixel of the window adds at each pixel of a line: `w` weights, `z` variables but position, whose differences are
 * the same for all. */
static INLINE void fit_add_line(float *restrict sums, const float *restrict w, float (*restrict z)[BLOCK_INNER],
                                const float *restrict colour)
{
    float wz[BLOCK_INNER];
    int second = FIT_SECOND;

    for (int x = 0; x < BLOCK_INNER; x++)
        sums[FIT_ONE * BLOCK_STRIP + x] += w[x];
    for (int c = 0; c < 3; c++)
        fit_add(sums + (FIT_COLOUR + c) * BLOCK_STRIP, w, colour + c * BLOCK_PIXELS);
    for (int k = 0; k < FIT_GRADIENT; k++) {
        for (int x = 0; x < BLOCK_INNER; x++) {
            wz[x] = w[x] * z[k][x];
            sums[(FIT_FIRST + k) * BLOCK_STRIP + x] += wz[x];
        }
        for (int l = 0; l <= k; l++)
            fit_add(sums + second++ * BLOCK_STRIP, wz, z[l]);
        for (int c = 0; c < 3; c++)
            fit_add(sums + (FIT_MIXED + c * FIT_GRADIENT + k) * BLOCK_STRIP, wz, colour + c * BLOCK_PIXELS);
    }
}

/* The fitted colour at the pixel, by Cholesky's decomposition of the variables' products: with L L^T = S2, L u = S1,
 * L v = T1, it is (T0 - u v) / (S0 - u u). `ridges` are shares of the weights' sum. 0: the sums do not say. */
static INLINE int fit_solve(const float *restrict sums, const float ridges[FIT_GRADIENT], float out[3])
{
    float l[FIT_GRADIENT][FIT_GRADIENT], right[4][FIT_GRADIENT], left = sums[FIT_ONE * BLOCK_STRIP];
    const float all = left;
    int second = FIT_SECOND;

    if (!(all > 0))
        return 0;
    for (int k = 0; k < FIT_GRADIENT; k++) {
        float diagonal;
        right[3][k] = sums[(FIT_FIRST + k) * BLOCK_STRIP];
        for (int c = 0; c < 3; c++)
            right[c][k] = sums[(FIT_MIXED + c * FIT_GRADIENT + k) * BLOCK_STRIP];
        for (int m = 0; m <= k; m++) {
            float sum = sums[second++ * BLOCK_STRIP] + (m == k ? all * ridges[k] : 0);
            for (int i = 0; i < m; i++)
                sum -= l[k][i] * l[m][i];
            l[k][m] = m < k ? sum / l[m][m] : sum;
        }
        diagonal = l[k][k];
        if (!(diagonal > 0))
            return 0;
        l[k][k] = sqrtf(diagonal);
        for (int c = 0; c < 4; c++) {
            for (int i = 0; i < k; i++)
                right[c][k] -= l[k][i] * right[c][i];
            right[c][k] /= l[k][k];
        }
        left -= right[3][k] * right[3][k];
    }
    if (!(left > FIT_LEAST * all))
        return 0;
    for (int c = 0; c < 3; c++) {
        out[c] = sums[(FIT_COLOUR + c) * BLOCK_STRIP];
        for (int k = 0; k < FIT_GRADIENT; k++)
            out[c] -= right[3][k] * right[c][k];
        out[c] = out[c] > 0 ? out[c] / left : 0;
    }
    return 1;
}
