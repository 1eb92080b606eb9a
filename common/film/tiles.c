#include "common/film/tiles.h"

uint32_t tile_count(uint32_t width, uint32_t height) { return tiles_across(width) * tiles_across(height); }

struct tile_rect tile_rect_of(uint32_t width, uint32_t height, uint32_t index)
{
    uint32_t across = tiles_across(width);
    struct tile_rect r = {index % across * TILE_SIZE, index / across * TILE_SIZE, TILE_SIZE,
                          TILE_SIZE};

    if (r.x + r.width > width)
        r.width = width - r.x;
    if (r.y + r.height > height)
        r.height = height - r.y;
    return r;
}

size_t tile_floats(uint32_t width, uint32_t height, uint32_t index, uint32_t aovs)
{
    struct tile_rect r = tile_rect_of(width, height, index);

    return (size_t)r.width * r.height * (PIXEL_FLOATS + aov_floats(aovs));
}

size_t tile_aov_offset(uint32_t pixels, uint32_t aovs, enum aov aov)
{
    return (size_t)pixels * (PIXEL_FLOATS + aov_floats(aovs & ((1u << aov) - 1)));
}

enum {
    PASSES_DOUBLING = 4,      /* 2, 4, 8, 16: one pass a doubling, then two */
    HALVES_FROM = 16,         /* samples at the end of those */
    PASSES_GROWING = 22,      /* up to GROWING_SAMPLES; from there on all are of one length */
    GROWING_SAMPLES = 8192,
};

uint32_t unit_aovs(uint32_t aovs, uint32_t group, uint32_t pass)
{
    uint32_t points = 0;

    for (int aov = 0; aov < AOV_COUNT; aov++)
        points |= (uint32_t)(aov_is_point((enum aov)aov) != 0) << aov;
    if (pass >= FEATURE_PASSES)
        aovs &= ~AOV_FEATURES;
    return group == 0 && pass == 0 ? aovs : aovs & ~points;
}

uint32_t pass_boundary(uint32_t index)
{
    uint32_t half;

    if (index < PASSES_DOUBLING)
        return 2u << index;
    if (index >= PASSES_GROWING)
        return GROWING_SAMPLES + (index - PASSES_GROWING + 1) * PASS_LENGTH_MAX;
    half = index - PASSES_DOUBLING;
    return (half % 2 ? 4u : 3u) * (HALVES_FROM / 2) << half / 2;
}

uint32_t pass_count(uint32_t spp, uint32_t group)
{
    uint32_t samples = group_samples(spp, group), count = 0;

    if (samples > GROWING_SAMPLES)
        return PASSES_GROWING + (samples - GROWING_SAMPLES + PASS_LENGTH_MAX - 1) / PASS_LENGTH_MAX;
    while (samples > (count ? pass_boundary(count - 1) : 0))
        count++;
    return count;
}

void pass_range(uint32_t spp, uint32_t group, uint32_t index, uint32_t *begin, uint32_t *end)
{
    uint32_t samples = group_samples(spp, group);

    *begin = index ? pass_boundary(index - 1) : 0;
    *end = pass_boundary(index);
    if (*end > samples)
        *end = samples;
}

int pass_is_short(uint32_t spp, uint32_t group, uint32_t index)
{
    return pass_boundary(index) > group_samples(spp, group);
}

uint32_t level_passes(uint32_t level) { return pass_count(GROUPS * level_samples(level), 0); }

uint32_t level_count(uint32_t passes) { return passes ? 31 - (uint32_t)__builtin_clz(pass_boundary(passes - 1)) : 0; }

int level_at(uint32_t passes)
{
    uint32_t samples = passes ? pass_boundary(passes - 1) : 0;

    return samples == 0 || samples & (samples - 1) ? -1 : (int)level_count(passes) - 1;
}
