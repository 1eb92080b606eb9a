#include "coordinator/pictures/fill.h"

#include "common/base/memory.h"
#include "common/film/tiles.h"

enum {
    CHANNELS = 3,
    GRIDS_MAX = 20,
    SWEEPS_FINE = 8,    /* of a grid finer than tiles */
    SWEEPS_COARSE = 32, /* of the others, which have few cells */
};

struct grid {
    uint32_t width, height;
    float *values;  /* [height][width][CHANNELS] */
    uint8_t *known; /* [height][width] */
};

static status grid_init(struct grid *g, uint32_t width, uint32_t height, struct error *err)
{
    size_t cells = (size_t)width * height;

    *g = (struct grid){.width = width, .height = height};
    g->values = mem_calloc(cells, CHANNELS * sizeof *g->values);
    g->known = mem_calloc(cells, 1);
    return g->values && g->known ? STATUS_OK : error_no_memory(err, "a preview");
}

static void grid_release(struct grid *g)
{
    mem_free(g->known);
    mem_free(g->values);
}

static float *value_at(const struct grid *g, uint32_t x, uint32_t y)
{
    return g->values + ((size_t)y * g->width + x) * CHANNELS;
}

/* The mean of a cell's pixels. */
static void take_cell(struct grid *g, const struct image *image, uint32_t x, uint32_t y)
{
    uint32_t x0 = x * FILL_CELL, y0 = y * FILL_CELL;
    uint32_t x1 = x0 + FILL_CELL < image->width ? x0 + FILL_CELL : image->width;
    uint32_t y1 = y0 + FILL_CELL < image->height ? y0 + FILL_CELL : image->height;
    float *value = value_at(g, x, y), scale = 1.0f / (float)((x1 - x0) * (y1 - y0));

    for (uint32_t py = y0; py < y1; py++)
        for (uint32_t px = x0; px < x1; px++)
            for (int c = 0; c < CHANNELS; c++)
                value[c] += image->pixels[((size_t)py * image->width + px) * CHANNELS + c] * scale;
    g->known[(size_t)y * g->width + x] = 1;
}

static void take_cells(struct grid *g, const struct image *image, const uint8_t *there)
{
    uint32_t across = tiles_across(image->width), cells = TILE_SIZE / FILL_CELL;

    for (uint32_t y = 0; y < g->height; y++)
        for (uint32_t x = 0; x < g->width; x++)
            if (there[y / cells * across + x / cells])
                take_cell(g, image, x, y);
}

/* A cell is known if any of the four below it is: the mean of those. */
static void coarsen(const struct grid *fine, struct grid *coarse)
{
    for (uint32_t y = 0; y < coarse->height; y++)
        for (uint32_t x = 0; x < coarse->width; x++) {
            float *to = value_at(coarse, x, y);
            uint32_t count = 0;
            for (uint32_t k = 0; k < 4; k++) {
                uint32_t fx = 2 * x + (k & 1), fy = 2 * y + (k >> 1);
                if (fx >= fine->width || fy >= fine->height || !fine->known[(size_t)fy * fine->width + fx])
                    continue;
                for (int c = 0; c < CHANNELS; c++)
                    to[c] += value_at(fine, fx, fy)[c];
                count++;
            }
            for (int c = 0; c < CHANNELS && count > 0; c++)
                to[c] /= (float)count;
            coarse->known[(size_t)y * coarse->width + x] = count > 0;
        }
}

/* The grid's value at a place in units of its cells, whose centres are at halves. */
static void interpolate(const struct grid *g, float x, float y, float out[CHANNELS])
{
    float right = (float)(g->width - 1), bottom = (float)(g->height - 1);
    uint32_t x0, y0, x1, y1;
    float u, v;

    x = x - 0.5f < 0 ? 0 : x - 0.5f > right ? right : x - 0.5f;
    y = y - 0.5f < 0 ? 0 : y - 0.5f > bottom ? bottom : y - 0.5f;
    x0 = (uint32_t)x;
    y0 = (uint32_t)y;
    x1 = x0 + 1 < g->width ? x0 + 1 : x0;
    y1 = y0 + 1 < g->height ? y0 + 1 : y0;
    u = x - (float)x0;
    v = y - (float)y0;
    for (int c = 0; c < CHANNELS; c++)
        out[c] = (value_at(g, x0, y0)[c] * (1 - u) + value_at(g, x1, y0)[c] * u) * (1 - v) +
                 (value_at(g, x0, y1)[c] * (1 - u) + value_at(g, x1, y1)[c] * u) * v;
}

/* Each unknown cell becomes the mean of its neighbours (Gauss and Seidel). */
static void relax(struct grid *g, int sweeps)
{
    for (int sweep = 0; sweep < sweeps; sweep++)
        for (uint32_t y = 0; y < g->height; y++)
            for (uint32_t x = 0; x < g->width; x++) {
                const float *left, *right, *up, *down;
                float *at = value_at(g, x, y);
                if (g->known[(size_t)y * g->width + x])
                    continue;
                left = x > 0 ? at - CHANNELS : at;
                right = x + 1 < g->width ? at + CHANNELS : at;
                up = y > 0 ? value_at(g, x, y - 1) : at;
                down = y + 1 < g->height ? value_at(g, x, y + 1) : at;
                for (int c = 0; c < CHANNELS; c++)
                    at[c] = 0.25f * (left[c] + right[c] + up[c] + down[c]);
            }
}

static void refine(const struct grid *coarse, struct grid *fine, int sweeps)
{
    for (uint32_t y = 0; y < fine->height; y++)
        for (uint32_t x = 0; x < fine->width; x++)
            if (!fine->known[(size_t)y * fine->width + x])
                interpolate(coarse, ((float)x + 0.5f) / 2, ((float)y + 0.5f) / 2, value_at(fine, x, y));
    relax(fine, sweeps);
}

static void fill_pixels(struct image *image, const uint8_t *there, const struct grid *g)
{
    uint32_t across = tiles_across(image->width);

    for (uint32_t y = 0; y < image->height; y++)
        for (uint32_t x = 0; x < image->width; x++)
            if (!there[y / TILE_SIZE * across + x / TILE_SIZE])
                interpolate(g, ((float)x + 0.5f) / FILL_CELL, ((float)y + 0.5f) / FILL_CELL,
                            image->pixels + ((size_t)y * image->width + x) * CHANNELS);
}

status fill_tiles(struct image *image, const uint8_t *there, struct error *err)
{
    struct grid grids[GRIDS_MAX];
    uint32_t width = (image->width + FILL_CELL - 1) / FILL_CELL;
    uint32_t height = (image->height + FILL_CELL - 1) / FILL_CELL;
    int count = 0;
    status s = STATUS_OK;

    while (s == STATUS_OK && count < GRIDS_MAX) {
        s = grid_init(&grids[count++], width, height, err);
        if (width == 1 && height == 1)
            break;
        width = (width + 1) / 2;
        height = (height + 1) / 2;
    }
    if (s == STATUS_OK) {
        take_cells(&grids[0], image, there);
        for (int i = 1; i < count; i++)
            coarsen(&grids[i - 1], &grids[i]);
        for (int i = count - 1; i-- > 0;)
            refine(&grids[i + 1], &grids[i], FILL_CELL << i >= TILE_SIZE ? SWEEPS_COARSE : SWEEPS_FINE);
        fill_pixels(image, there, &grids[0]);
    }
    while (count > 0)
        grid_release(&grids[--count]);
    return s;
}
