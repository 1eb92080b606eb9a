#include "common/image/quantize.h"

#include "common/base/safeguard.h"

/* The dither's threshold at a pixel, 0..1 exclusive: the R2 low-discrepancy sequence of
 * Roberts 2018 ("The Unreasonable Effectiveness of Quasirandom Sequences"), x / p + y / p^2
 * with the plastic number p, as a triangle wave so that the mask has no jumps. In integers, and
 * held off the ends, so that values that are code values but for rounding stay so. */
static double dither_threshold(uint32_t x, uint32_t y)
{
    uint32_t phase = x * 3242174889u + y * 2447445414u;
    uint32_t wave = phase < 0x80000000u ? phase * 2 : ~phase * 2;

    return (1.0 + (double)wave * (1022.0 / 4294967296.0)) / 1024.0;
}

/* value * most, cut to 0..most, and rounded down after adding the threshold. */
static uint32_t quantize(float value, double most, double threshold)
{
    double code = (double)value * most;

    if (!(code > 0.0)) /* NaN too */
        return (uint32_t)threshold;
    return (uint32_t)(code >= most ? most : SAFEGUARD(CODES_ROUNDED) ? code + threshold : code);
}

void quantize_row8(const struct image *image, uint32_t y, int plain, uint8_t *out)
{
    const float *p = image->pixels + (size_t)y * image->width * image->channels;

    for (uint32_t x = 0; x < image->width; x++, p += image->channels) {
        double threshold = plain ? 0.5 : dither_threshold(x, y);

        for (int c = 0; c < 3; c++)
            *out++ = (uint8_t)quantize(p[c], 255.0, threshold);
    }
}

void quantize_row16(const struct image *image, uint32_t y, int plain, uint8_t *out)
{
    const float *p = image->pixels + (size_t)y * image->width * image->channels;

    for (uint32_t x = 0; x < image->width; x++, p += image->channels) {
        double threshold = plain ? 0.5 : dither_threshold(x, y);

        for (int c = 0; c < 3; c++) {
            uint32_t code = quantize(p[c], 65535.0, threshold);

            *out++ = (uint8_t)(code >> 8);
            *out++ = (uint8_t)code;
        }
    }
}
