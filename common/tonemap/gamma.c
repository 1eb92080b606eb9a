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

static status gamma_apply(struct image *image, const struct tonemap_statistics *statistics,
                          const double *values, struct error *err)
{
    size_t count = (size_t)image->width * image->height * 3;
    float exponent = (float)(1.0 / values[GAMMA]), gain = (float)values[GAIN];

    (void)statistics;
    (void)err;
    for (size_t i = 0; i < count; i++)
        image->pixels[i] = fminf(gain * det_pow(image->pixels[i], exponent), 1.0f);
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
