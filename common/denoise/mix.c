#include "common/denoise/mix.h"

#include <string.h>

/* Errors are weighed by 1 / (brightness^2 + (this share of the picture's mean)^2): displays show about logarithms. */
#define DARK 0.05f

/* Filters count as worse than their estimated error by this share of the raw picture's, which the estimate's own noise is. */
#define MARGIN 0.02
/* Rounds of choosing between two ways at a time. */
enum { ROUNDS = 8 };

int mix_tile_is_known(const struct denoise_input *input, size_t tile)
{
    return !input->samples || (input->samples[tile * 2] && input->samples[tile * 2 + 1]);
}

uint32_t mix_tiles_across(const struct denoise_input *input) { return (input->width + DENOISE_TILE - 1) / DENOISE_TILE; }

uint32_t mix_tiles(const struct denoise_input *input)
{
    return mix_tiles_across(input) * ((input->height + DENOISE_TILE - 1) / DENOISE_TILE);
}

static size_t tile_of(const struct filtered *f, uint32_t x, uint32_t y)
{
    return (size_t)(y / DENOISE_TILE) * mix_tiles_across(f->input) + x / DENOISE_TILE;
}

int mix_tile_is_raw(const struct filtered *f, uint32_t tile)
{
    const uint32_t tiles_across = mix_tiles_across(f->input), side = DENOISE_TILE / MIX_CELL;
    const uint32_t left = tile % tiles_across * side, top = tile / tiles_across * side;
    float raw = 0, cells = 0;

    for (uint32_t y = top; y < top + side && y < f->down; y++)
        for (uint32_t x = left; x < left + side && x < f->across; x++) {
            raw += f->shares[(size_t)y * f->across + x][MIX_RAW];
            cells++;
        }
    return !mix_tile_is_known(f->input, tile) || raw > cells / 2;
}

static float brightness(float *const pictures[2], size_t p)
{
    float sum = 0;

    for (size_t i = p; i < p + 3; i++)
        sum += pictures[0][i] + pictures[1][i];
    return sum / 6;
}

/* By the darker of the filters: light that one spreads into a dark pixel would hide its own error. */
static float weight_at(const struct filtered *f, size_t p)
{
    const float joint = brightness(f->pictures, p), fitted = f->fitted[0] ? brightness(f->fitted, p) : joint;
    const float bright = fitted < joint ? fitted : joint, dark = DARK * f->mean + 1e-18f;

    return 1 / (bright * bright + dark * dark);
}

static void compare_pixel(const struct filtered *f, size_t p, struct mix_products *sums)
{
    const struct denoise_input *in = f->input;
    float *const *fitted = f->fitted[0] ? f->fitted : f->pictures;
    const float weight = weight_at(f, p);

    for (size_t i = p; i < p + 3; i++) {
        const float a = in->groups[0][i], b = in->groups[1][i];
        const float made[MIX_WAYS][2] = {
            [MIX_JOINT] = {f->pictures[0][i], f->pictures[1][i]}, [MIX_FITTED] = {fitted[0][i], fitted[1][i]}, [MIX_RAW] = {a, b}};
        for (int k = 0; k < MIX_WAYS; k++)
            for (int l = 0; l <= k; l++)
                sums->of[k][l] += (double)(weight * product_of(a, b, made[k], made[l]));
    }
}

void mix_compare(struct filtered *f, uint32_t row)
{
    const struct denoise_input *in = f->input;
    const uint32_t top = row * MIX_CELL;

    for (uint32_t column = 0; column < f->across; column++) {
        struct mix_products *sums = &f->products[(size_t)row * f->across + column];
        memset(sums, 0, sizeof *sums);
        if (!mix_tile_is_known(in, tile_of(f, column * MIX_CELL, top)))
            continue;
        for (uint32_t y = top; y < top + MIX_CELL && y < in->height; y++)
            for (uint32_t x = column * MIX_CELL; x < (column + 1) * MIX_CELL && x < in->width; x++)
                compare_pixel(f, ((size_t)y * in->width + x) * 3, sums);
    }
}

/* Of a cell and of the eight around it, which count for a half and a quarter. */
static struct mix_products products_around(const struct filtered *f, uint32_t row, uint32_t column)
{
    struct mix_products all = {{{0}}};

    for (int v = -1; v <= 1; v++)
        for (int u = -1; u <= 1; u++) {
            const int64_t y = (int64_t)row + v, x = (int64_t)column + u;
            const double weight = (v ? 0.5 : 1) * (u ? 0.5 : 1);
            if (x < 0 || y < 0 || x >= f->across || y >= f->down)
                continue;
            for (int k = 0; k < MIX_WAYS; k++)
                for (int l = 0; l <= k; l++)
                    all.of[k][l] += weight * f->products[(size_t)y * f->across + (size_t)x].of[k][l];
        }
    return all;
}

/* The share t in 0..1 of the second that makes the squared error of (1 - t) first + t second least, from errors and product. */
static double best_share(double first, double product, double second)
{
    const double across = first - 2 * product + second, t = first - product;

    if (!(across > 0))
        return second < first;
    return t <= 0 ? 0 : t >= across ? 1 : t / across;
}

static double product_with(const struct mix_products *p, const double s[MIX_WAYS], int k)
{
    double sum = 0;

    for (int l = 0; l < MIX_WAYS; l++)
        sum += s[l] * (l <= k ? p->of[k][l] : p->of[l][k]);
    return sum;
}

static double error_at(const struct mix_products *p, const double s[MIX_WAYS])
{
    double sum = 0;

    for (int k = 0; k < MIX_WAYS; k++)
        sum += s[k] * product_with(p, s, k);
    return sum;
}

/* Shares of least error: from the raw picture towards one way after the other. */
static void choose(const struct mix_products *p, float shares[MIX_WAYS])
{
    double s[MIX_WAYS] = {[MIX_RAW] = 1};

    for (int round = 0; round < ROUNDS; round++)
        for (int k = 0; k < MIX_WAYS; k++) {
            const double t = best_share(error_at(p, s), product_with(p, s, k), p->of[k][k]);
            for (int l = 0; l < MIX_WAYS; l++)
                s[l] = (1 - t) * s[l] + (l == k ? t : 0);
        }
    for (int l = 0; l < MIX_WAYS; l++)
        shares[l] = (float)s[l];
}

void mix_choose(struct filtered *f, uint32_t row)
{
    for (uint32_t column = 0; column < f->across; column++) {
        struct mix_products p = products_around(f, row, column);
        float *shares = f->shares[(size_t)row * f->across + column];
        if (!(p.of[MIX_RAW][MIX_RAW] > 0)) {
            memset(shares, 0, sizeof *f->shares);
            shares[MIX_RAW] = 1;
            continue;
        }
        for (int k = 0; k < MIX_RAW; k++)
            p.of[k][k] += MARGIN * p.of[MIX_RAW][MIX_RAW];
        choose(&p, shares);
    }
}

/* The shares at a pixel, between those of the four cells whose middles are around it. */
static void shares_at(const struct filtered *f, uint32_t x, uint32_t y, float out[MIX_WAYS])
{
    const float u = ((float)x + 0.5f) / MIX_CELL - 0.5f, v = ((float)y + 0.5f) / MIX_CELL - 0.5f;
    const uint32_t left = u > 0 ? (uint32_t)u : 0, top = v > 0 ? (uint32_t)v : 0;
    const uint32_t right = u > 0 && left + 1 < f->across ? left + 1 : left;
    const uint32_t bottom = v > 0 && top + 1 < f->down ? top + 1 : top;
    const float s = u > 0 ? u - (float)left : 0, t = v > 0 ? v - (float)top : 0;
    const float(*above)[MIX_WAYS] = f->shares + (size_t)top * f->across;
    const float(*below)[MIX_WAYS] = f->shares + (size_t)bottom * f->across;

    for (int k = 0; k < MIX_WAYS; k++)
        out[k] = (above[left][k] * (1 - s) + above[right][k] * s) * (1 - t) +
                 (below[left][k] * (1 - s) + below[right][k] * s) * t;
}

void mix_pixel(const struct filtered *f, uint32_t x, uint32_t y, float out[2][3])
{
    const size_t p = ((size_t)y * f->input->width + x) * 3, tile = tile_of(f, x, y);
    float shares[MIX_WAYS];

    if (!mix_tile_is_known(f->input, tile)) { /* if one has no samples, the other's mean is the picture */
        const uint32_t *samples = f->input->samples + tile * 2;
        for (int g = 0; g < 2; g++)
            memcpy(out[g], f->input->groups[samples[g] ? g : !g] + p, sizeof out[g]);
        return;
    }
    shares_at(f, x, y, shares);
    for (int g = 0; g < 2; g++)
        for (size_t c = 0; c < 3; c++) {
            const float joint = f->pictures[g][p + c], fitted = f->fitted[g] ? f->fitted[g][p + c] : joint;
            out[g][c] =
                shares[MIX_JOINT] * joint + shares[MIX_FITTED] * fitted + shares[MIX_RAW] * f->input->groups[g][p + c];
        }
}
