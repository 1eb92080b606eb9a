#include <math.h>
#include <string.h>

#include "common/film/film_parts.h"

/* ---- means ---------------------------------------------------------------------------------- */

/* The groups of `mask` that have samples on the tile, as a mask. */
static unsigned groups_there(const struct film *film, uint32_t tile, unsigned mask)
{
    unsigned there = 0;

    for (uint32_t g = 0; g < GROUPS; g++)
        if (film->tiles[tile].groups[g].passes > 0)
            there |= 1u << g;
    return there & mask;
}

static void develop_tile(const struct film *film, uint32_t index, unsigned mask, float *rgb)
{
    struct tile_rect rect = tile_rect_of(film->width, film->height, index);
    double means[TILE_PIXELS_MAX * 3] = {0};
    unsigned there = groups_there(film, index, mask);
    size_t values = (size_t)rect.width * rect.height * 3;

    if (!there)
        return;
    for (uint32_t g = 0; g < GROUPS; g++) {
        const struct film_group *group = &film->tiles[index].groups[g];
        double weight = there == 1u << g ? 1 : 0.5, samples;
        if (!(there >> g & 1))
            continue;
        samples = film_group_samples(film, index, g);
        for (size_t i = 0; i < values; i++)
            means[i] += weight * ((film_sum(group, i) + film_sum(group, values + i)) / samples);
    }
    for (uint32_t y = 0; y < rect.height; y++) {
        float *row = rgb + ((size_t)(rect.y + y) * film->width + rect.x) * 3;
        for (uint32_t i = 0; i < rect.width * 3; i++)
            row[i] = (float)means[(size_t)y * rect.width * 3 + i];
    }
}

static void develop(const struct film *film, unsigned mask, float *rgb)
{
    memset(rgb, 0, (size_t)film->width * film->height * 3 * sizeof *rgb);
    for (uint32_t i = 0; i < film->tiles_total; i++)
        develop_tile(film, i, mask, rgb);
}

void film_develop(const struct film *film, float *rgb)
{
    develop(film, (1u << GROUPS) - 1, rgb);
}

void film_develop_group(const struct film *film, uint32_t group, float *rgb)
{
    develop(film, 1u << group, rgb);
}

void film_replicates(const struct film *film, uint32_t r, uint32_t y, uint32_t height, float *out)
{
    uint32_t group = r / GROUP_REPLICATES, within = r % GROUP_REPLICATES;

    memset(out, 0, (size_t)height * film->width * 3 * sizeof *out);
    for (uint32_t i = y / TILE_SIZE * tiles_across(film->width); i < film->tiles_total; i++) {
        struct tile_rect rect = tile_rect_of(film->width, film->height, i);
        const struct film_group *g = &film->tiles[i].groups[group];
        size_t first = (size_t)rect.width * rect.height * 3 * within;
        uint32_t samples = replicate_samples(film_group_samples(film, i, group), within);
        if (rect.y >= y + height)
            break;
        for (uint32_t row = 0; samples > 0 && row < rect.height && rect.y + row < y + height; row++)
            for (uint32_t k = 0; k < rect.width * 3; k++)
                out[((size_t)(rect.y + row - y) * film->width + rect.x) * 3 + k] =
                    (float)(film_sum(g, first + (size_t)row * rect.width * 3 + k) / samples);
    }
}

/* ---- errors --------------------------------------------------------------------------------- */

/* Squared standard error of channel `i`'s mean; negative: a group has only one replicate. */
static double squared_error(const struct film *film, uint32_t tile, unsigned there, size_t i)
{
    size_t second = (size_t)film_tile_pixels(film, tile) * 3 + i;
    double sum = 0;

    for (uint32_t g = 0; g < GROUPS; g++) {
        const struct film_group *group = &film->tiles[tile].groups[g];
        uint32_t samples = film_group_samples(film, tile, g);
        double difference;
        if (!(there >> g & 1))
            continue;
        if (samples < GROUP_REPLICATES)
            return -1;
        difference = film_sum(group, i) / replicate_samples(samples, 0) -
                     film_sum(group, second) / replicate_samples(samples, 1);
        sum += difference * difference / 4;
    }
    return there == (1u << GROUPS) - 1 ? sum / 4 : sum;
}

int film_has_replicates(const struct film *film)
{
    for (uint32_t g = 0; g < GROUPS; g++)
        if (film->begun[g] < film->tiles_total || group_samples(film->spp, g) < GROUP_REPLICATES)
            return 0;
    return 1;
}

/* ---- AOVs ----------------------------------------------------------------------------------- */

uint32_t film_aov_channels(enum aov aov)
{
    return aov == AOV_SAMPLES ? 1 : aov == AOV_ERROR ? 3 : aov_channels(aov);
}

/* Value `c` of pixel `pixel` of a tile whose groups `there` have samples. */
static double aov_value(const struct film *film, uint32_t tile, unsigned there, enum aov aov,
                        size_t pixel, uint32_t c)
{
    uint32_t pixels = film_tile_pixels(film, tile);
    double squared, value = 0;

    if (aov == AOV_SAMPLES)
        return film_tile_samples(film, tile);
    if (aov == AOV_ERROR) {
        squared = squared_error(film, tile, there, pixel * 3 + c);
        return squared > 0 ? sqrt(squared) : 0;
    }
    for (uint32_t g = 0; g < GROUPS; g++) {
        uint32_t kept = unit_aovs(film->aovs, g, 0);
        size_t at = tile_aov_offset(pixels, kept, aov) + pixel * aov_channels(aov) + c;
        if (!(there >> g & 1) || !(kept >> aov & 1))
            continue;
        value += aov_is_point(aov) ? film_sum(&film->tiles[tile].groups[g], at)
                                   : film_sum(&film->tiles[tile].groups[g], at) /
                                         film_group_samples(film, tile, g) *
                                         (there == 1u << g ? 1 : 0.5);
    }
    return value;
}

int film_tile_aov(const struct film *film, uint32_t tile, enum aov aov, float (*out)[4])
{
    unsigned there = groups_there(film, tile, (1u << GROUPS) - 1);
    uint32_t pixels = film_tile_pixels(film, tile), channels = film_aov_channels(aov);

    if (!there)
        return 0;
    for (uint32_t p = 0; p < pixels; p++) {
        memset(out[p], 0, sizeof out[p]);
        out[p][3] = NAN;
        for (uint32_t c = 0; c < channels; c++)
            out[p][c] = (float)aov_value(film, tile, there, aov, p, c);
    }
    return 1;
}

void film_develop_aov(const struct film *film, enum aov aov, uint32_t y, uint32_t height,
                      float *out)
{
    uint32_t across = tiles_across(film->width), channels = film_aov_channels(aov);
    size_t plane = (size_t)height * film->width;

    memset(out, 0, channels * plane * sizeof *out);
    for (uint32_t i = y / TILE_SIZE * across; i < film->tiles_total; i++) {
        struct tile_rect rect = tile_rect_of(film->width, film->height, i);
        unsigned there = groups_there(film, i, (1u << GROUPS) - 1);
        if (rect.y >= y + height)
            break;
        if (!there)
            continue;
        for (uint32_t row = 0; row < rect.height && rect.y + row < y + height; row++)
            for (uint32_t x = 0; x < rect.width; x++)
                for (uint32_t c = 0; c < channels; c++)
                    out[c * plane + (size_t)(rect.y + row - y) * film->width + rect.x + x] =
                        (float)aov_value(film, i, there, aov, (size_t)row * rect.width + x, c);
    }
}
