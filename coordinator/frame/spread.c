#include "coordinator/frame/spread.h"

#include "common/film/tiles.h"

/* The tiles lie in a grid of 2^x_bits times 2^y_bits places. A place's rank has the coordinates' bits from the highest
 * (in bit 0) to the lowest. First come those that only the longer side has, then the two sides' in pairs. */
struct grid {
    uint32_t across, down, x_bits, y_bits;
};

static uint32_t bits_for(uint32_t count)
{
    uint32_t bits = 0;

    while (1u << bits < count)
        bits++;
    return bits;
}

static struct grid grid_of(uint32_t width, uint32_t height)
{
    struct grid g = {.across = tiles_across(width), .down = tiles_across(height)};

    g.x_bits = bits_for(g.across);
    g.y_bits = bits_for(g.down);
    return g;
}

/* In a pair the second place is diagonal to the first. */
static void place_of(const struct grid *g, uint32_t rank, uint32_t *x, uint32_t *y)
{
    uint32_t bx = g->x_bits, by = g->y_bits;

    *x = *y = 0;
    for (; bx > by; rank >>= 1)
        *x |= (rank & 1) << --bx;
    for (; by > bx; rank >>= 1)
        *y |= (rank & 1) << --by;
    for (; bx > 0; rank >>= 2) {
        *x |= (rank & 1) << --bx;
        *y |= ((rank ^ rank >> 1) & 1) << --by;
    }
}

void spread_order(uint32_t width, uint32_t height, uint32_t *order)
{
    struct grid g = grid_of(width, height);
    uint32_t x, y;

    for (uint32_t rank = 0; rank >> (g.x_bits + g.y_bits) == 0; rank++) {
        place_of(&g, rank, &x, &y);
        if (x < g.across && y < g.down)
            *order++ = y * g.across + x;
    }
}

uint32_t spread_rank(uint32_t width, uint32_t height, uint32_t tile)
{
    struct grid g = grid_of(width, height);
    uint32_t x = tile % g.across, y = tile / g.across;
    uint32_t bx = g.x_bits, by = g.y_bits, rank = 0, at = 0;

    while (bx > by)
        rank |= (x >> --bx & 1) << at++;
    while (by > bx)
        rank |= (y >> --by & 1) << at++;
    while (bx > 0) {
        uint32_t first = x >> --bx & 1, second = y >> --by & 1;
        rank |= (first | (first ^ second) << 1) << at;
        at += 2;
    }
    return rank;
}
