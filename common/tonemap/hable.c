/* Hable's filmic curve of 2010, with the constants that were published for it:
 *
 *   f(x) = (x (A x + C B) + D E) / (x (A x + B) + D F) - E / F
 *   out  = f(bias x) / f(white)
 *
 * on each channel, light in and light out. The two fractions are combined, so that f(0) is exactly 0.
 */
#include <math.h>

#include "common/tonemap/operators.h"

enum { WHITE, BIAS };

static const struct tonemap_parameter parameters[] = {
    [WHITE] = {"white", 0.1, 1000.0, 11.2, "what becomes white, after the bias", TONEMAP_NUMBER,
               NULL},
    [BIAS] = {"bias", 0.01, 100.0, 2.0, "multiplies the light before the curve", TONEMAP_NUMBER,
              NULL},
};

struct curve {
    double bias, scale;
};

static double filmic(double x)
{
    const double a = 0.15, b = 0.50, c = 0.10, d = 0.20, e = 0.02, f = 0.30;

    return x * (a * x * (1.0 - e / f) + b * (c - e / f)) / (x * (a * x + b) + d * f);
}

static void hable_row(const void *user, float *rgb, uint32_t width)
{
    const struct curve *curve = user;

    for (size_t i = 0; i < (size_t)width * 3; i++)
        rgb[i] = (float)fmin(curve->scale * filmic(curve->bias * (double)rgb[i]), 1.0);
}

static status hable_apply(const struct tonemap_frame *frame, const double *state UNUSED, struct error *err UNUSED)
{
    struct curve curve = {frame->values[BIAS], 1.0 / filmic(frame->values[WHITE])};

    tonemap_each_row(frame, hable_row, &curve);
    return STATUS_OK;
}

const struct tonemap_operator tonemap_hable = {
    .name = "hable",
    .summary = "The filmic curve of Uncharted 2, on each channel.",
    .source = "J. Hable, \"Uncharted 2: HDR Lighting\", Game Developers Conference 2010",
    .parameters = parameters,
    .parameter_count = sizeof parameters / sizeof *parameters,
    .apply = hable_apply,
};
