/* Gamma compression: a power of each channel is the display code itself. It takes the place
 * of the sRGB curve and is not followed by it. */
#include <math.h>

#include "common/math/elementary.h"
#include "common/tonemap/operators.h"

enum { GAMMA, GAIN };

static const struct tonemap_parameter parameters[] = {
    [GAMMA] = {"gamma", 1.0, 5.0, 2.2, "display code = gain * light^(1/gamma)"},
    [GAIN] = {"gain", 0.001, 1000.0, 1.0, "multiplies the display code"},
};

struct curve {
    float exponent, gain;
};

static void gamma_row(const void *user, float *rgb, uint32_t width)
{
    const struct curve *curve = user;

    for (size_t i = 0; i < (size_t)width * 3; i++)
        rgb[i] = fminf(curve->gain * det_pow(rgb[i], curve->exponent), 1.0f);
}

static status gamma_apply(const struct tonemap_frame *frame, const double *state,
                          struct error *err)
{
    struct curve curve = {(float)(1.0 / frame->values[GAMMA]), (float)frame->values[GAIN]};

    (void)state;
    (void)err;
    tonemap_each_row(frame, gamma_row, &curve);
    return STATUS_OK;
}

const struct tonemap_operator tonemap_gamma = {
    .name = "gamma",
    .summary = "A power curve on each channel, in place of the sRGB curve.",
    .source = "C. A. Poynton, \"Gamma and its disguises\", SMPTE Journal 102(12), 1993",
    .parameters = parameters,
    .parameter_count = sizeof parameters / sizeof *parameters,
    .display_encoded = 1,
    .apply = gamma_apply,
};
