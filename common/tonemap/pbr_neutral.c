/* Khronos' neutral tone mapper: values between 0.08 and 0.8 change only by the 0.04 that a dielectric's reflection adds
 * to its base colour; only brighter values are compressed and turned to white. */
#include <math.h>

#include "common/tonemap/operators.h"

static const double FRESNEL = 0.04;     /* reflectance at normal incidence, ior 1.5 */
static const double START = 0.8 - 0.04; /* of the compression */
static const double DESATURATION = 0.15;

static void neutral_pixel(float rgb[3])
{
    double low = fmin((double)rgb[0], fmin((double)rgb[1], (double)rgb[2]));
    double offset = low <= 2.0 * FRESNEL ? low - low * low / (4.0 * FRESNEL) : FRESNEL;
    double peak = fmax((double)rgb[0], fmax((double)rgb[1], (double)rgb[2])) - offset;
    double scale = 1.0, white = 0.0;

    if (peak > START) {
        double room = 1.0 - START, compressed = 1.0 - room * room / (peak + room - START);
        double keep = 1.0 / (DESATURATION * (peak - compressed) + 1.0);

        scale = compressed / peak * keep;
        white = compressed * (1.0 - keep);
    }
    for (int c = 0; c < 3; c++)
        rgb[c] = (float)fmax(((double)rgb[c] - offset) * scale + white, 0.0);
}

static void neutral_row(const void *user UNUSED, float *rgb, uint32_t width)
{
    for (float *p = rgb; p < rgb + (size_t)width * 3; p += 3)
        neutral_pixel(p);
}

static status neutral_apply(const struct tonemap_frame *frame, const double *state UNUSED, struct error *err UNUSED)
{
    tonemap_each_row(frame, neutral_row, NULL);
    return STATUS_OK;
}

const struct tonemap_operator tonemap_pbr_neutral = {
    .name = "pbr-neutral",
    .summary = "Keeps base colours as they were painted and compresses highlights only.",
    .source = "Khronos PBR Neutral Tone Mapper, specification 1.0, 2024",
    .apply = neutral_apply,
};
