/* One tile's picture, for those who watch while it is rendered. */
#include <math.h>
#include <string.h>

#include "common/film/film_parts.h"

/* Rec. 709 from its primaries, as everywhere. */
static const double luminance_weights[3] = {0.212656, 0.715158, 0.072186};

/* The group's sums of radiance; `scratch` is used if they have two parts. */
static const double *group_values(const struct film_group *g, size_t count, double *scratch)
{
    if (!g->cut)
        return g->whole->values;
    if (!g->whole)
        return g->cut->values;
    for (size_t i = 0; i < count; i++)
        scratch[i] = g->whole->values[i] + g->cut->values[i];
    return scratch;
}

/* Add the group's part of the means, exactly as develop_tile (film_develop.c), and of the variance of their luminance. */
static void add_group(const struct film *film, uint32_t tile, uint32_t group, double weight,
                      double means[], double variances[])
{
    double scratch[TILE_PIXELS_MAX * PIXEL_FLOATS];
    uint32_t pixels = film_tile_pixels(film, tile);
    size_t values = (size_t)pixels * 3;
    uint32_t count = film_group_samples(film, tile, group);
    double samples = count, share[GROUP_REPLICATES];
    const double *a = group_values(&film->tiles[tile].groups[group], 2 * values, scratch);
    const double *b = a + values;

    for (size_t i = 0; i < values; i++)
        means[i] += weight * ((a[i] + b[i]) / samples);
    for (uint32_t r = 0; r < GROUP_REPLICATES; r++)
        share[r] = 1.0 / replicate_samples(count, r);
    for (uint32_t p = 0; p < pixels; p++) {
        double difference = 0;
        for (uint32_t c = 0; c < 3; c++)
            difference += luminance_weights[c] * (a[p * 3 + c] * share[0] - b[p * 3 + c] * share[1]);
        variances[p] += weight * weight * (difference * difference / 4);
    }
}

int film_tile_picture(const struct film *film, uint32_t tile, float (*out)[4])
{
    double means[TILE_PIXELS_MAX * 3], variances[TILE_PIXELS_MAX];
    uint32_t pixels = film_tile_pixels(film, tile), there = 0;
    int known = 1;

    for (uint32_t g = 0; g < GROUPS; g++) {
        uint32_t samples = film_group_samples(film, tile, g);
        there += samples > 0;
        known &= samples == 0 || samples >= GROUP_REPLICATES;
    }
    if (!there)
        return 0;
    memset(means, 0, (size_t)pixels * 3 * sizeof *means);
    memset(variances, 0, pixels * sizeof *variances);
    for (uint32_t g = 0; g < GROUPS; g++)
        if (film->tiles[tile].groups[g].passes > 0)
            add_group(film, tile, g, 1.0 / there, means, variances);
    for (uint32_t p = 0; p < pixels; p++) {
        for (uint32_t c = 0; c < 3; c++)
            out[p][c] = (float)means[p * 3 + c];
        out[p][3] = known ? (float)sqrt(variances[p]) : NAN;
    }
    return 1;
}
