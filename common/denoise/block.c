#include "common/denoise/block.h"

#include <string.h>

#include "common/denoise/wide.h"

int wide_allowed = 1;

/* An albedo below this is not divided by: what the pixel shows is not diffuse light then. */
#define ALBEDO_MIN 0.01f
/* Squared distances of albedo and normal that count as 1, without and with their noise's variance. */
#define ALBEDO_SQUARED 0.02f
#define NORMAL_SQUARED 0.02f
#define FEATURE_NOISE 4.0f
/* A value is a firefly above this many times the fourth largest around it. */
#define FIREFLY 3.0f

enum { POOL = 2, POOL_FEATURES = 2 /* radius over which variances are averaged */ };

static uint32_t clamped(int64_t at, uint32_t size)
{
    return at < 0 ? 0 : at >= (int64_t)size ? size - 1 : (uint32_t)at;
}

static int is_known(const struct denoise_input *input, uint32_t x, uint32_t y)
{
    const size_t tile = (size_t)(y / 16) * ((input->width + 15) / 16) + x / 16;

    return !input->samples || (input->samples[tile * 2] && input->samples[tile * 2 + 1]);
}

static void load_pixel(struct block *b, const struct denoise_input *input, size_t from, uint32_t to)
{
    for (int g = 0; g < 2; g++)
        for (int c = 0; c < 3; c++) {
            const float direct = input->direct[g] ? input->direct[g][from * 3 + c] : 0;
            b->colour[g][c][to] = input->groups[g][from * 3 + c] - direct;
            b->feature[g][c][to] = input->albedo[g] ? input->albedo[g][from * 3 + c] : 0;
            b->feature[g][3 + c][to] = input->normal[g] ? input->normal[g][from * 3 + c] : 0;
        }
}

static void load(struct block *b, const struct denoise_input *input, const int32_t *source)
{
    for (uint32_t v = 0, to = 0; v < BLOCK_SIDE; v++)
        for (uint32_t u = 0; u < BLOCK_SIDE; u++, to++) {
            const int64_t at_x = (int64_t)b->x + u - BLOCK_MARGIN, at_y = (int64_t)b->y + v - BLOCK_MARGIN;
            const uint32_t x = clamped(at_x, input->width), y = clamped(at_y, input->height);
            const uint32_t pixel = y * input->width + x;
            const int lost = source && source[pixel] < 0;
            const uint32_t from = source && !lost ? (uint32_t)source[pixel] : pixel;
            load_pixel(b, input, from, to);
            b->weight[to] = x == at_x && y == at_y && !lost && is_known(input, from % input->width, from / input->width);
        }
}

/* The group's own albedo, since the noise of a pixel's colour goes with that of the same samples' albedo. */
static void divide_by_albedo(struct block *b, const struct denoise_input *input)
{
    for (int g = 0; g < 2; g++)
        for (uint32_t p = 0; p < BLOCK_PIXELS; p++) {
            const float r = b->feature[g][0][p], gr = b->feature[g][1][p], bl = b->feature[g][2][p];
            const int sure = input->albedo[g] && (r > ALBEDO_MIN || gr > ALBEDO_MIN || bl > ALBEDO_MIN);
            for (int c = 0; c < 3; c++) {
                const float albedo = b->feature[g][c][p];
                b->albedo[g][c][p] = !sure ? 1 : albedo > ALBEDO_MIN ? albedo : ALBEDO_MIN;
                b->colour[g][c][p] /= b->albedo[g][c][p];
            }
        }
}

/* The mean of `values` over (2 radius + 1)^2 pixels, of which there are fewer at the block's edges. */
static INLINE void average(const float *restrict values, float *restrict out, float *restrict lines, int radius)
{
    for (int y = 0; y < BLOCK_SIDE; y++) {
        const int top = y - radius < 0 ? 0 : y - radius, bottom = y + radius < BLOCK_SIDE ? y + radius : BLOCK_SIDE - 1;
        const float scale = 1.0f / (float)(bottom - top + 1);
        float *restrict to = lines + y * BLOCK_SIDE;
        for (int x = 0; x < BLOCK_SIDE; x++)
            to[x] = 0;
        for (int v = top; v <= bottom; v++)
            for (int x = 0; x < BLOCK_SIDE; x++)
                to[x] += values[v * BLOCK_SIDE + x];
        for (int x = 0; x < BLOCK_SIDE; x++)
            to[x] *= scale;
    }
    for (int y = 0; y < BLOCK_SIDE; y++)
        for (int x = 0; x < BLOCK_SIDE; x++) {
            const int left = x - radius < 0 ? 0 : x - radius, right = x + radius < BLOCK_SIDE ? x + radius : BLOCK_SIDE - 1;
            float sum = 0;
            for (int u = left; u <= right; u++)
                sum += lines[y * BLOCK_SIDE + u];
            out[y * BLOCK_SIDE + x] = sum / (float)(right - left + 1);
        }
}

/* (A - B)^2 / 2 of three planes, added: with equal variances of both groups its mean is that variance. */
static INLINE void halve_differences(const float *restrict a, const float *restrict b, float *restrict out)
{
    for (uint32_t p = 0; p < BLOCK_PIXELS; p++) {
        const float d0 = a[p] - b[p], d1 = a[BLOCK_PIXELS + p] - b[BLOCK_PIXELS + p];
        const float d2 = a[2 * BLOCK_PIXELS + p] - b[2 * BLOCK_PIXELS + p];
        out[p] = (d0 * d0 + d1 * d1 + d2 * d2) / 2;
    }
}

static INLINE void pool(struct block *b)
{
    const float count = (2 * POOL + 1) * (2 * POOL + 1);

    halve_differences(b->colour[0][0], b->colour[1][0], b->scratch[0]);
    average(b->scratch[0], b->noise, b->scratch[1], POOL);
    /* Without the pixel itself: what the other group has in it is not to be known. Near the block's edge it is about that. */
    for (uint32_t p = 0; p < BLOCK_PIXELS; p++) {
        const float others = (b->noise[p] * count - b->scratch[0][p]) / (count - 1);
        b->noise[p] = others > 0 ? others : 0;
    }
    for (int part = 0; part < 2; part++) {
        const float apart = part == 0 ? ALBEDO_SQUARED : NORMAL_SQUARED;
        halve_differences(b->feature[0][part * 3], b->feature[1][part * 3], b->scratch[0]);
        average(b->scratch[0], b->scratch[2], b->scratch[1], POOL_FEATURES);
        for (uint32_t p = 0; p < BLOCK_PIXELS; p++)
            b->loose[part][p] = 1 / (apart + FEATURE_NOISE * b->scratch[2][p]);
    }
}

void pool_variances(struct block *b);
WIDE_VERSIONS(pool_variances, pool, (struct block * b), (b))

/* ---- fireflies -------------------------------------------------------------------------------- */

/* The value at p, or less: at most FIREFLY times the fourth largest of the 16 around it in both groups, without the
 * pixel itself. A line through the pixel, or a corner in it, has four of them, a firefly hardly ever. */
static float tamed(const struct block *b, int group, int channel, uint32_t p)
{
    float most[4] = {0, 0, 0, 0};

    for (int g = 0; g < 2; g++)
        for (int v = -1; v <= 1; v++)
            for (int u = -1; u <= 1; u++) {
                float value = u || v ? b->colour[g][channel][(int)p + v * BLOCK_SIDE + u] : 0;
                for (int i = 0; i < 4; i++) {
                    const float larger = value > most[i] ? value : most[i];
                    value = value > most[i] ? most[i] : value;
                    most[i] = larger;
                }
            }
    most[3] *= FIREFLY;
    return b->colour[group][channel][p] > most[3] ? most[3] : b->colour[group][channel][p];
}

static int is_inner(const struct block *b, uint32_t u, uint32_t v)
{
    return u >= BLOCK_MARGIN && v >= BLOCK_MARGIN && u < BLOCK_MARGIN + b->width && v < BLOCK_MARGIN + b->height;
}

static void tame(struct block *b)
{
    for (int g = 0; g < 2; g++)
        for (int c = 0; c < 3; c++) {
            float *out = b->scratch[g * 3 + c];
            memcpy(out, b->colour[g][c], sizeof(block_plane));
            for (uint32_t v = 1; v + 1 < BLOCK_SIDE; v++)
                for (uint32_t u = 1; u + 1 < BLOCK_SIDE; u++) {
                    const uint32_t p = v * BLOCK_SIDE + u;
                    const float had = b->colour[g][c][p];
                    /* Most are seen to be none without sorting: of four pixels beside it, none is less than a third. */
                    if (had > FIREFLY * b->colour[!g][c][p - 1] || had > FIREFLY * b->colour[!g][c][p + 1] ||
                        had > FIREFLY * b->colour[!g][c][p - BLOCK_SIDE] || had > FIREFLY * b->colour[!g][c][p + BLOCK_SIDE])
                        out[p] = tamed(b, g, c, p);
                    if (is_inner(b, u, v)) {
                        b->fireflies += out[p] < had;
                        b->removed += (double)(had - out[p]) * (double)b->albedo[g][c][p];
                        b->light += (double)had * (double)b->albedo[g][c][p];
                    }
                }
        }
    for (int g = 0; g < 2; g++)
        for (int c = 0; c < 3; c++)
            memcpy(b->colour[g][c], b->scratch[g * 3 + c], sizeof(block_plane));
}

static void load_all(struct block *b, const struct denoise_input *input, const int32_t *source, uint32_t x, uint32_t y)
{
    b->x = x;
    b->y = y;
    b->width = input->width - x < BLOCK_INNER ? input->width - x : BLOCK_INNER;
    b->height = input->height - y < BLOCK_INNER ? input->height - y : BLOCK_INNER;
    b->fireflies = 0;
    b->removed = b->light = 0;
    load(b, input, source);
    divide_by_albedo(b, input);
    tame(b);
}

static void take_means(struct block *b, const struct denoise_input *input, float *const means[2])
{
    for (uint32_t v = 0, to = 0; v < BLOCK_SIDE; v++)
        for (uint32_t u = 0; u < BLOCK_SIDE; u++, to++) {
            const size_t x = clamped((int64_t)b->x + u - BLOCK_MARGIN, input->width);
            const size_t y = clamped((int64_t)b->y + v - BLOCK_MARGIN, input->height);
            for (int g = 0; g < 2; g++)
                for (size_t c = 0; c < 3; c++)
                    b->colour[g][c][to] = means[g][(y * input->width + x) * 3 + c] / b->albedo[g][c][to];
        }
}

void block_load(struct block *b, const struct denoise_input *input, float *const means[2], uint32_t x, uint32_t y)
{
    load_all(b, input, NULL, x, y);
    if (means)
        take_means(b, input, means);
    pool_variances(b);
}

void block_load_other(struct block *b, const struct denoise_other *other, uint32_t x, uint32_t y)
{
    load_all(b, other->picture, other->source, x, y);
    pool_variances(b);
}
