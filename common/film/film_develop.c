#include <math.h>
#include <string.h>

#include "common/film/film_parts.h"
#include "common/film/matte.h"

#define GROUPS_ALL ((1u << GROUPS) - 1)

/* ---- means ---------------------------------------------------------------------------------- */

/* The groups of `mask` that have samples on the tile, as a mask. */
static unsigned groups_there(const struct film *film, uint32_t tile, unsigned mask)
{
    unsigned there = 0;

    for (uint32_t g = 0; g < GROUPS; g++)
        if (mask >> g & 1 && film->tiles[tile].groups[g].passes > 0)
            there |= 1u << g;
    return there;
}

static void develop_groups(const struct film *film, uint32_t index, unsigned mask, float *rgb)
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
            means[i] += weight * (film_sum(group, i) / samples);
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
        develop_groups(film, i, mask, rgb);
}

void film_develop(const struct film *film, float *rgb) { develop(film, GROUPS_ALL, rgb); }

void film_develop_tile(const struct film *film, uint32_t tile, float *rgb)
{
    develop_groups(film, tile, GROUPS_ALL, rgb);
}

void film_develop_group(const struct film *film, uint32_t group, float *rgb) { develop(film, 1u << group, rgb); }

/* ---- errors --------------------------------------------------------------------------------- */

double film_half_difference(const struct film *film, uint32_t tile, size_t i)
{
    const struct film_group *g = film->tiles[tile].groups;

    return (film_sum(&g[0], i) / film_group_samples(film, tile, 0) -
            film_sum(&g[1], i) / film_group_samples(film, tile, 1)) / 2;
}

int film_has_groups(const struct film *film)
{
    for (uint32_t g = 0; g < GROUPS; g++)
        if (film->begun[g] < film->tiles_total)
            return 0;
    return 1;
}

/* ---- AOVs ----------------------------------------------------------------------------------- */

uint32_t film_aov_channels(enum aov aov)
{
    if (AOV_MATTES >> aov & 1)
        return 0;
    return aov == AOV_SAMPLES ? 1 : aov == AOV_ERROR || aov == AOV_VARIANCE ? 3 : aov_channels(aov);
}

/* Samples of the group that the AOV's sums are of. */
static double aov_samples(const struct film *film, uint32_t tile, uint32_t group, enum aov aov)
{
    uint32_t samples = film_group_samples(film, tile, group);

    return AOV_FEATURES >> aov & 1 && samples > FEATURE_SAMPLES ? FEATURE_SAMPLES : samples;
}

/* Value `c` of pixel `pixel` of a tile whose groups `there` have samples. */
static double aov_value(const struct film *film, uint32_t tile, unsigned there, enum aov aov, size_t pixel, uint32_t c)
{
    uint32_t pixels = film_tile_pixels(film, tile);
    double value = 0;

    if (aov == AOV_SAMPLES)
        return film_tile_samples(film, tile);
    if (aov == AOV_ERROR)
        return there == GROUPS_ALL ? fabs(film_half_difference(film, tile, pixel * 3 + c)) : 0;
    if (aov == AOV_VARIANCE && there == GROUPS_ALL) {
        value = film_half_difference(film, tile, pixel * 3 + c);
        return value * value;
    }
    for (uint32_t g = 0; g < GROUPS; g++) {
        uint32_t kept = unit_aovs(film->aovs, g, 0);
        size_t at = tile_aov_offset(pixels, kept, aov) + pixel * aov_channels(aov) + c;
        if (!(there >> g & 1) || !(kept >> aov & 1))
            continue;
        value += aov_is_point(aov) ? film_sum(&film->tiles[tile].groups[g], at)
                                   : film_sum(&film->tiles[tile].groups[g], at) / aov_samples(film, tile, g, aov) *
                                         (there == 1u << g ? 1 : 0.5);
    }
    return value;
}

void film_group_tile(const struct film *film, uint32_t tile, uint32_t group, int aov, float *out)
{
    const struct tile_rect rect = tile_rect_of(film->width, film->height, tile);
    const size_t line = (size_t)film->width * 3;

    film_group_tile_at(film, tile, group, aov, out + rect.y * line + (size_t)rect.x * 3, line);
}

void film_group_tile_at(const struct film *film, uint32_t tile, uint32_t group, int aov, float *out, size_t line)
{
    const struct film_group *g = &film->tiles[tile].groups[group];
    const struct tile_rect rect = tile_rect_of(film->width, film->height, tile);
    const uint32_t kept = unit_aovs(film->aovs, group, 0);
    const int is_picture = aov == FILM_PICTURE;
    size_t at = is_picture ? 0 : tile_aov_offset(rect.width * rect.height, kept, (enum aov)aov);
    double samples;

    if (g->passes == 0 || !(is_picture || kept >> aov & 1))
        return;
    samples = is_picture ? film_group_samples(film, tile, group) : aov_samples(film, tile, group, (enum aov)aov);
    for (uint32_t y = 0; y < rect.height; y++)
        for (uint32_t k = 0; k < rect.width * 3; k++)
            out[y * line + k] = (float)(film_sum(g, at++) / samples);
}

void film_group_rows(const struct film *film, uint32_t group, uint32_t y, uint32_t height, float *out)
{
    const uint32_t across = tiles_across(film->width), end = y + height;

    memset(out, 0, (size_t)height * film->width * 3 * sizeof *out);
    for (uint32_t i = y / TILE_SIZE * across; i < film->tiles_total; i++) {
        const struct tile_rect rect = tile_rect_of(film->width, film->height, i);
        const struct film_group *g = &film->tiles[i].groups[group];
        const uint32_t first = rect.y > y ? rect.y : y, last = rect.y + rect.height < end ? rect.y + rect.height : end;
        double samples;
        if (rect.y >= end)
            return;
        if (g->passes == 0)
            continue;
        samples = film_group_samples(film, i, group);
        for (uint32_t row = first; row < last; row++) {
            float *to = out + ((size_t)(row - y) * film->width + rect.x) * 3;
            size_t at = (size_t)(row - rect.y) * rect.width * 3;
            for (uint32_t k = 0; k < rect.width * 3; k++)
                to[k] = (float)(film_sum(g, at++) / samples);
        }
    }
}

int film_tile_aov(const struct film *film, uint32_t tile, enum aov aov, float (*out)[4])
{
    unsigned there = groups_there(film, tile, GROUPS_ALL);
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

/* Into lines y .. y + height - 1 of the picture, of which `out` is made. */
static void develop_tile_aov(const struct film *film, uint32_t tile, enum aov aov, uint32_t y, uint32_t height, float *out)
{
    const struct tile_rect rect = tile_rect_of(film->width, film->height, tile);
    const unsigned there = groups_there(film, tile, GROUPS_ALL);
    const uint32_t channels = film_aov_channels(aov);
    const size_t plane = (size_t)height * film->width;

    for (uint32_t row = 0; there && row < rect.height && rect.y + row < y + height; row++)
        for (uint32_t x = 0; x < rect.width; x++)
            for (uint32_t c = 0; c < channels; c++)
                out[c * plane + (size_t)(rect.y + row - y) * film->width + rect.x + x] =
                    (float)aov_value(film, tile, there, aov, (size_t)row * rect.width + x, c);
}

void film_develop_tile_aov(const struct film *film, uint32_t tile, enum aov aov, float *out)
{
    develop_tile_aov(film, tile, aov, 0, film->height, out);
}

void film_develop_aov(const struct film *film, enum aov aov, uint32_t y, uint32_t height, float *out)
{
    const uint32_t across = tiles_across(film->width);

    memset(out, 0, film_aov_channels(aov) * (size_t)height * film->width * sizeof *out);
    for (uint32_t i = y / TILE_SIZE * across; i < film->tiles_total; i++) {
        if (tile_rect_of(film->width, film->height, i).y >= y + height)
            break;
        develop_tile_aov(film, i, aov, y, height, out);
    }
}

/* ---- which things -------------------------------------------------------------------------- */

/* The pixel's counts in the group's whole and short passes; NULL: none. */
static void find_mattes(const struct film *film, uint32_t tile, uint32_t group, enum aov aov, uint32_t pixel,
                        const double *out[2])
{
    const struct film_group *g = &film->tiles[tile].groups[group];
    const size_t at = tile_aov_offset(film_tile_pixels(film, tile), unit_aovs(film->aovs, group, 0), aov) +
                      (size_t)pixel * MATTE_FLOATS;

    out[0] = g->whole ? g->whole->values + at : NULL;
    out[1] = g->cut ? g->cut->values + at : NULL;
}

/* Sorted into the `count` that are there; `samples` of the group count `weight`. Returns how many there are now. */
static uint32_t add_things(struct film_thing *out, uint32_t count, const double matte[MATTE_FLOATS], double weight,
                           double samples)
{
    for (uint32_t i = 0; i < MATTE_SLOTS && matte[2 * i + 2] > 0; i++) {
        const uint32_t number = (uint32_t)matte[2 * i + 1];
        uint32_t at = count;
        while (at > 0 && out[at - 1].number >= number)
            at--;
        if (at == count || out[at].number != number) {
            memmove(out + at + 1, out + at, (count - at) * sizeof *out);
            out[at] = (struct film_thing){number, 0};
            count++;
        }
        out[at].share += weight * (matte[2 * i + 2] / samples);
    }
    return count;
}

uint32_t film_things(const struct film *film, uint32_t tile, enum aov aov, uint32_t pixel,
                     struct film_thing out[FILM_THINGS_MAX])
{
    const unsigned there = groups_there(film, tile, GROUPS_ALL);
    uint32_t count = 0;

    for (uint32_t g = 0; g < GROUPS; g++) {
        const double *mattes[2];
        if (!(there >> g & 1))
            continue;
        find_mattes(film, tile, g, aov, pixel, mattes);
        for (int i = 0; i < 2; i++)
            if (mattes[i])
                count =
                    add_things(out, count, mattes[i], there == 1u << g ? 1 : 0.5, film_group_samples(film, tile, g));
    }
    return count;
}

uint64_t film_things_lost(const struct film *film, enum aov aov)
{
    uint64_t lost = 0;

    for (uint32_t i = 0; i < film->tiles_total; i++)
        for (uint32_t p = 0; p < film_tile_pixels(film, i); p++)
            for (uint32_t g = 0; g < GROUPS; g++) {
                const double *mattes[2];
                find_mattes(film, i, g, aov, p, mattes);
                for (int k = 0; k < 2; k++)
                    lost += mattes[k] ? (uint64_t)mattes[k][0] : 0;
            }
    return lost;
}
