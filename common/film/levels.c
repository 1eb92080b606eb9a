#include "common/film/levels.h"

#include <math.h>
#include <string.h>

#include "common/film/tiles.h"
#include "common/image/color.h"
#include "common/math/elementary.h"

uint32_t level_bin(float codes)
{
    float edge = 0x1.6a09e6p-5f; /* 2^-4.5, where bin 1 begins */
    uint32_t bin = 0;

    /* Comparisons with exact constants: two half octaves are a factor of two, exactly. */
    for (float whole = 0x1p-4f; bin + 1 < LEVEL_BINS; whole *= 2, edge *= 2) {
        if (!(codes >= edge))
            return bin;
        bin++;
        if (bin + 1 >= LEVEL_BINS || !(codes >= whole))
            return bin;
        bin++;
    }
    return bin;
}

float level_spread(uint32_t i)
{
    static const float quarters[4] = {0x1p-5f, 0x1.306fep-5f, 0x1.6a09e6p-5f, 0x1.ae89fap-5f};

    return quarters[i % 4] * (float)(1u << i / 4);
}

/* ---- one pixel's errors --------------------------------------------------------------------- */

static void measure_codes(struct film_level *out, const float *first, const float *second,
                          uint32_t pixels)
{
    double sum = 0;

    for (uint32_t i = 0; i < pixels; i++, first += 3, second += 3) {
        float squared = 0;
        for (int c = 0; c < 3; c++) {
            float half = (first[c] - second[c]) / 2;
            squared = half * half > squared ? half * half : squared;
        }
        sum += (double)squared;
        out->bins[level_bin(sqrtf(squared))]++;
    }
    out->display = (float)sum;
}

/* ---- what would be reported ----------------------------------------------------------------- */

/* Add half of one side's squared errors: the largest channel's to squares[], all to the return
 * value. */
static double add_side(const float *shown, const float *mean, uint32_t pixels, float *squares)
{
    double channels = 0;

    for (uint32_t i = 0; i < pixels; i++) {
        float largest = 0;
        for (uint32_t c = i * 3; c < i * 3 + 3; c++) {
            float d = shown[c] - mean[c];
            largest = d * d > largest ? d * d : largest;
            channels += (double)(d * d) / 2;
        }
        squares[i] += largest / 2;
    }
    return channels;
}

static float mean_around(const float *squares, uint32_t width, uint32_t height, uint32_t x, uint32_t y)
{
    float sum = 0;
    uint32_t count = 0;

    for (uint32_t v = y > 0 ? y - 1 : 0; v <= y + 1 && v < height; v++)
        for (uint32_t u = x > 0 ? x - 1 : 0; u <= x + 1 && u < width; u++, count++)
            sum += squares[v * width + u];
    return sum / (float)count;
}

/* Divide a pixel between its two places: a whole count at the nearest would be off by up to 9 %. */
static void spread_add(uint16_t *spreads, float deviation)
{
    uint32_t i, above;
    float low, high;

    if (!(deviation >= level_spread(0)))
        return;
    i = ((float_bits(deviation) >> 23) - (float_bits(level_spread(0)) >> 23)) * 4; /* its octave */
    i = i + 2 < LEVEL_SPREADS ? i : LEVEL_SPREADS - 2;
    while (i + 2 < LEVEL_SPREADS && deviation >= level_spread(i + 1))
        i++;
    low = level_spread(i);
    high = level_spread(i + 1);
    above = deviation < high ? (uint32_t)((deviation - low) / (high - low) * LEVEL_SPREAD_ONE + 0.5f)
                             : LEVEL_SPREAD_ONE;
    spreads[i] = (uint16_t)(spreads[i] + LEVEL_SPREAD_ONE - above);
    spreads[i + 1] = (uint16_t)(spreads[i + 1] + above);
}

/* `first` and `second`: the codes of the replicates, that is of the mean plus and minus half of
 * their difference. */
static void measure_spreads(struct film_level *out, const float *first, const float *second,
                            const float *mean, uint32_t width, uint32_t height)
{
    float squares[TILE_PIXELS_MAX] = {0};

    out->channels = (float)(add_side(first, mean, width * height, squares) +
                            add_side(second, mean, width * height, squares));
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++)
            spread_add(out->spreads, sqrtf(mean_around(squares, width, height, x, y)));
}

void film_level_measure(struct film_level *out, const double *sums, uint32_t width, uint32_t height,
                        uint32_t samples, const struct film_codes *codes)
{
    enum { MEAN = GROUP_REPLICATES, PICTURES };
    float linear[PICTURES][TILE_PIXELS_MAX * 3], shown[PICTURES][TILE_PIXELS_MAX * 3];
    double each = samples / (double)GROUP_REPLICATES;
    uint32_t pixels = width * height;
    const double *second = sums + (size_t)pixels * 3;
    uint64_t rays = out->rays;

    memset(out, 0, sizeof *out);
    out->rays = rays;
    for (uint32_t i = 0; i < pixels * 3; i++) {
        double a = sums[i] / each, b = second[i] / each;
        out->radiance += (a + b) / 2;
        out->linear += (a - b) * (a - b) / 4;
        linear[0][i] = (float)a;
        linear[1][i] = (float)b;
        linear[MEAN][i] = (float)((a + b) / 2);
    }
    if (!codes->codes)
        return;
    for (int p = 0; p < PICTURES; p++)
        codes->codes(codes->user, linear[p], pixels, shown[p]);
    measure_codes(out, shown[0], shown[1], pixels);
    measure_spreads(out, shown[0], shown[1], shown[MEAN], width, height);
    out->has_codes = 1;
}

void film_codes_plain(void *user, const float *rgb, uint32_t count, float *codes)
{
    (void)user;
    for (uint32_t i = 0; i < count * 3; i++)
        codes[i] = rgb[i] > 0 ? rgb[i] < 1 ? rgb[i] : 1 : 0;
    srgb_encode_row(codes, (size_t)count * 3);
    for (uint32_t i = 0; i < count * 3; i++)
        codes[i] *= 255;
}
