/* Hill's fit to the ACES 1.x output transform: a rational curve between two matrices. Neutrals come
 * within 1.5 % of the transform, reds within 14 %; `aces` is the transform itself. */
#include <math.h>

#include "common/base/safeguard.h"
#include "common/tonemap/operators.h"

/* sRGB to AP1 and the RRT's desaturation in one; the ODT's and AP1 to sRGB. */
static const double into[3][3] = {
    {0.59719, 0.35458, 0.04823}, {0.07600, 0.90834, 0.01566}, {0.02840, 0.13383, 0.83777}};
static const double back[3][3] = {
    {1.60475, -0.53108, -0.07367}, {-0.10208, 1.10813, -0.00605}, {-0.00327, -0.07276, 1.07602}};

/* In double: in float the squares of light above 2e19 are infinite. */
static double fit(double v)
{
    double above = v * (v + 0.0245786) - 0.000090537;
    double below = v * (0.983729 * v + 0.4329510) + 0.238081;

    return SAFEGUARD(HILL_DOUBLE) ? above / below : (double)((float)above / (float)below);
}

static void hill_row(const void *user UNUSED, float *rgb, uint32_t width)
{
    for (float *p = rgb; p < rgb + (size_t)width * 3; p += 3) {
        double v[3];

        for (int i = 0; i < 3; i++)
            v[i] = fit(into[i][0] * (double)p[0] + into[i][1] * (double)p[1] + into[i][2] * (double)p[2]);
        for (int i = 0; i < 3; i++)
            p[i] = (float)fmax(back[i][0] * v[0] + back[i][1] * v[1] + back[i][2] * v[2], 0.0);
    }
}

static status hill_apply(const struct tonemap_frame *frame, const double *state UNUSED, struct error *err UNUSED)
{
    tonemap_each_row(frame, hill_row, NULL);
    return STATUS_OK;
}

const struct tonemap_operator tonemap_aces_hill = {
    .name = "aces-hill",
    .summary = "Hill's fit to the ACES output transform: close for neutrals, not for reds.",
    .source = "S. Hill's fit as published in MJP's BakingLab, 2016",
    .apply = hill_apply,
};
