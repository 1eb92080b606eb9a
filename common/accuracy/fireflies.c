#include "common/accuracy/fireflies.h"

#include <math.h>

enum { NEIGHBOURS = 8 };

static float brightest(const float *codes) { return fmaxf(codes[0], fmaxf(codes[1], codes[2])); }

/* The neighbours' brightest channels, ascending. */
static uint32_t sorted_neighbours(const float *codes, uint32_t width, uint32_t height, uint32_t x, uint32_t y,
                                  float out[NEIGHBOURS])
{
    uint32_t count = 0;

    for (uint32_t v = y > 0 ? y - 1 : 0; v <= y + 1 && v < height; v++)
        for (uint32_t u = x > 0 ? x - 1 : 0; u <= x + 1 && u < width; u++) {
            float value = brightest(codes + ((size_t)v * width + u) * 3);
            uint32_t at = count;
            if (u == x && v == y)
                continue;
            for (; at > 0 && out[at - 1] > value; at--)
                out[at] = out[at - 1];
            out[at] = value;
            count++;
        }
    return count;
}

static float median_of(const float *sorted, uint32_t count)
{
    return count == 0 ? 0 : (sorted[(count - 1) / 2] + sorted[count / 2]) / 2;
}

float firefly_height(const float *codes, uint32_t width, uint32_t height, uint32_t x, uint32_t y)
{
    float around[NEIGHBOURS], above, spread = 0;
    uint32_t count = sorted_neighbours(codes, width, height, x, y, around);

    if (count == 0)
        return 0;
    above = brightest(codes + ((size_t)y * width + x) * 3) - median_of(around, count);
    if (!(above >= FIREFLY_CODES))
        return 0;
    for (uint32_t i = 0; i < count; i++)
        spread += fabsf(around[i] - median_of(around, count)) / (float)count;
    return above >= FIREFLY_SPREADS * spread ? above : 0;
}

size_t fireflies_find(const float *a, const float *b, const float *mean, uint32_t width, uint32_t height,
                      uint8_t *marks)
{
    size_t found = 0;

    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++) {
            size_t p = (size_t)y * width + x;
            float shown = brightest(mean + p * 3), first = brightest(a + p * 3), second = brightest(b + p * 3);
            const float *darker = first < second ? a : b;
            float around[NEIGHBOURS], above = 0;
            marks[p] = 0;
            /* Few pixels pass this, so the rest costs nothing. */
            if (shown - fminf(first, second) >= FIREFLY_CODES)
                above = firefly_height(mean, width, height, x, y);
            if (!(above > 0))
                continue;
            marks[p] = brightest(darker + p * 3) -
                           median_of(around, sorted_neighbours(darker, width, height, x, y, around)) < above / 2;
            found += marks[p];
        }
    return found;
}
