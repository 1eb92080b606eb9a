/* One tile's picture, for those who watch while it is rendered. */
#include <math.h>

#include "common/film/film_parts.h"

/* Rec. 709 from its primaries, as everywhere. */
static const double luminance_weights[3] = {0.212656, 0.715158, 0.072186};

/* The group's means of radiance. */
static void means_of_group(const struct film *film, uint32_t tile, uint32_t group, double means[])
{
    const struct film_group *g = &film->tiles[tile].groups[group];
    const size_t values = film_radiance_numbers(film, tile);
    const double samples = film_group_samples(film, tile, group);

    for (size_t i = 0; i < values; i++)
        means[i] = film_sum(g, i) / samples;
}

double film_tile_contrast(const struct film *film, uint32_t tile)
{
    enum { STEP = 8 };
    const struct film_group *groups = film->tiles[tile].groups;
    float means[GROUPS][TILE_PIXELS_MAX / STEP * 3], codes[GROUPS][TILE_PIXELS_MAX / STEP * 3];
    uint32_t width = tile_rect_of(film->width, film->height, tile).width, count = 0;
    double sum = 0;

    for (uint32_t p = 0; p < film_tile_pixels(film, tile) && count < TILE_PIXELS_MAX / STEP; p++) {
        if ((p % width + 3 * (p / width)) % STEP) /* not one column of them */
            continue;
        for (uint32_t g = 0; g < GROUPS; g++) {
            if (groups[g].passes == 0 || !film_codes_of(film, g))
                return NAN;
            for (uint32_t c = 0; c < 3; c++)
                means[g][count * 3 + c] = (float)(film_sum(&groups[g], p * 3 + c) / film_group_samples(film, tile, g));
        }
        count++;
    }
    for (uint32_t g = 0; g < GROUPS && count > 0; g++)
        film->codes[g].codes(film->codes[g].user, means[g], count, codes[g]);
    for (uint32_t p = 0; p < count; p++) {
        double largest = 0;
        for (uint32_t c = 0; c < 3; c++) {
            double half = fabs((double)codes[0][p * 3 + c] - (double)codes[1][p * 3 + c]) / 2;
            largest = half > largest ? half : largest;
        }
        sum += largest * largest;
    }
    return count > 0 ? sum / count : (double)NAN;
}

int film_tile_picture(const struct film *film, uint32_t tile, float (*out)[4])
{
    double means[GROUPS][TILE_PIXELS_MAX * 3];
    uint32_t pixels = film_tile_pixels(film, tile), there = 0;

    for (uint32_t g = 0; g < GROUPS; g++)
        if (film->tiles[tile].groups[g].passes > 0)
            means_of_group(film, tile, g, means[there++]);
    for (uint32_t p = 0; p < pixels && there > 0; p++) {
        double error = there == GROUPS ? 0 : NAN;
        for (uint32_t c = 0; c < 3; c++) {
            const size_t i = p * 3 + c;
            /* Exactly as develop_tile (film_develop.c) and film_half_difference. */
            out[p][c] = (float)(there == GROUPS ? 0.5 * means[0][i] + 0.5 * means[1][i] : means[0][i]);
            if (there == GROUPS)
                error += luminance_weights[c] * ((means[0][i] - means[1][i]) / 2);
        }
        out[p][3] = (float)fabs(error);
    }
    return there > 0;
}
