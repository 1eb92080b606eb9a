#include "common/film/levels.h"

#include <math.h>
#include <string.h>

#include "common/film/tiles.h"
#include "common/image/color.h"

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

static void measure_codes(struct film_level *out, const float *first, const float *second,
                          uint32_t pixels)
{
    double sum = 0, channels = 0;

    for (uint32_t i = 0; i < pixels; i++, first += 3, second += 3) {
        float squared = 0;
        for (int c = 0; c < 3; c++) {
            float half = (first[c] - second[c]) / 2;
            squared = half * half > squared ? half * half : squared;
            channels += (double)(half * half);
        }
        sum += (double)squared;
        out->bins[level_bin(sqrtf(squared))]++;
    }
    out->display = (float)sum;
    out->channels = (float)channels;
    out->has_codes = 1;
}

void film_level_measure(struct film_level *out, const double *sums, uint32_t pixels,
                        uint32_t samples, const struct film_codes *codes)
{
    float means[GROUP_REPLICATES][TILE_PIXELS_MAX * 3] = {{0}};
    float shown[GROUP_REPLICATES][TILE_PIXELS_MAX * 3];
    double each = samples / (double)GROUP_REPLICATES;
    const double *second = sums + (size_t)pixels * 3;
    uint64_t rays = out->rays;

    memset(out, 0, sizeof *out);
    out->rays = rays;
    for (uint32_t i = 0; i < pixels * 3; i++) {
        double a = sums[i] / each, b = second[i] / each;
        out->radiance += (a + b) / 2;
        out->linear += (a - b) * (a - b) / 4;
        means[0][i] = (float)a;
        means[1][i] = (float)b;
    }
    if (!codes->codes)
        return;
    for (int r = 0; r < GROUP_REPLICATES; r++)
        codes->codes(codes->user, means[r], pixels, shown[r]);
    measure_codes(out, shown[0], shown[1], pixels);
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
