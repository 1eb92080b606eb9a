#include "common/accuracy/sample.h"

#include "common/base/memory.h"

static size_t tiles_of(const struct accuracy_picture *p)
{
    return (size_t)((p->width + ACCURACY_TILE - 1) / ACCURACY_TILE) * ((p->height + ACCURACY_TILE - 1) / ACCURACY_TILE);
}

double sample_scale(const struct accuracy_picture *picture)
{
    return picture->of_tiles > 0 ? (double)picture->of_tiles / (double)tiles_of(picture) : 1;
}

double sample_ratio_variance(const struct accuracy_picture *picture, const double *above, const double *below,
                             size_t tiles)
{
    double up = 0, down = 0, squares = 0, n = (double)tiles;

    if (picture->of_tiles <= tiles || tiles < 2)
        return 0;
    for (size_t i = 0; i < tiles; i++) {
        up += above[i];
        down += below[i];
    }
    if (!(down > 0))
        return 0;
    for (size_t i = 0; i < tiles; i++) {
        double off = above[i] - up / down * below[i];
        squares += off * off;
    }
    return (1 - n / picture->of_tiles) * n / (n - 1) * squares / (down * down);
}

/* Sums over the tiles, of a pixel's squared error in codes, of that in linear radiance, and of its radiance. */
struct tile_sums {
    double *codes, *linear, *light, *pixels;
};

static void add_tiles(const struct tile_sums *out, const struct gathered *g)
{
    const float *a = g->picture->groups[0], *b = g->picture->groups[1];
    size_t across = (g->width + ACCURACY_TILE - 1) / ACCURACY_TILE;

    for (size_t p = 0; p < g->pixels; p++) {
        size_t tile = p / g->width / ACCURACY_TILE * across + p % g->width / ACCURACY_TILE;
        out->codes[tile] += (double)g->error[p];
        out->linear[tile] += (double)g->squared[p];
        out->pixels[tile]++;
        for (size_t c = p * 3; c < p * 3 + 3; c++)
            out->light[tile] += ((double)a[c] + (double)b[c]) / 2;
    }
}

/* The squared deviation of the sum over its value. */
static double relative_variance(const struct gathered *g, const double *sums, const struct tile_sums *all, size_t tiles)
{
    double sum = 0, pixels = 0, mean;

    for (size_t i = 0; i < tiles; i++) {
        sum += sums[i];
        pixels += all->pixels[i];
    }
    mean = sum / pixels;
    return mean > 0 ? sample_ratio_variance(g->picture, sums, all->pixels, tiles) / (mean * mean) : 0;
}

status sample_widen(struct gathered *g, struct error *err)
{
    size_t tiles = tiles_of(g->picture);
    struct tile_sums sums;
    double *all;

    if (g->picture->of_tiles <= tiles)
        return STATUS_OK;
    all = mem_calloc(tiles * 4, sizeof *all);
    NEED(all, err, "a picture's tiles");
    sums = (struct tile_sums){all, all + tiles, all + 2 * tiles, all + 3 * tiles};
    add_tiles(&sums, g);
    g->codes_variance += relative_variance(g, sums.codes, &sums, tiles) * g->codes * g->codes;
    g->linear_variance += relative_variance(g, sums.linear, &sums, tiles) * g->linear * g->linear;
    g->mean_variance += relative_variance(g, sums.light, &sums, tiles) * g->mean * g->mean;
    mem_free(all);
    return STATUS_OK;
}
