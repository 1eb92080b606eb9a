#include "common/film/tiles.h"

uint32_t tile_count(uint32_t width, uint32_t height)
{
    return tiles_across(width) * tiles_across(height);
}

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

/* The boundary at which pass `index` ends, were there no last sample. */
static uint32_t boundary(uint32_t index)
{
    uint32_t end = PASS_FIRST;

    while (index > 0 && end < PASS_LENGTH_MAX) {
        end *= 2;
        index--;
    }
    return end + index * PASS_LENGTH_MAX;
}

uint32_t pass_count(uint32_t spp)
{
    uint32_t count = 1, end = PASS_FIRST;

    while (end < spp && end < PASS_LENGTH_MAX) {
        end *= 2;
        count++;
    }
    if (end < spp)
        count += (spp - end + PASS_LENGTH_MAX - 1) / PASS_LENGTH_MAX;
    return count;
}

void pass_range(uint32_t spp, uint32_t index, uint32_t *begin, uint32_t *end)
{
    *begin = index ? boundary(index - 1) : 0;
    *end = boundary(index);
    if (*end > spp)
        *end = spp;
}
