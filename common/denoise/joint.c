/* The joint filter of block.h. */
#include "common/denoise/block.h"

#include <string.h>

#include "common/denoise/fit.h"
#include "common/denoise/wide.h"

enum {
    PATCH = 3, /* radius of the neighbourhoods that are compared */
    PATCH_PIXELS = (2 * PATCH + 1) * (2 * PATCH + 1),
    REACH = BLOCK_INNER + 2 * PATCH, /* a line of differences */
};
/* A squared difference of colours counts as 1 if it is this many times its noise's variance (NL-means' k^2). */
#define STRICTNESS 0.5f
#define NOISE_MIN 1e-12f

struct shift {
    int x, y, offset;
    int top, bottom; /* lines of the strip */
};

/* How unlike the pixels that are `shift` apart are in either group, around the inner part: 0 on average where they
 * differ by noise alone. */
static INLINE void compare(const struct block *b, struct shift s, float *restrict first, float *restrict second)
{
    for (int y = s.top - PATCH; y < s.bottom + PATCH; y++) {
        const int line = (y + BLOCK_MARGIN) * BLOCK_SIDE + BLOCK_MARGIN - PATCH;
        const float *restrict noise = b->noise + line, *restrict other = noise + s.offset;
        for (int x = 0; x < REACH; x++) {
            const float sum = noise[x] + other[x], twice = 2 * noise[x];
            const float less = twice < sum ? twice : sum, scale = 1 / (NOISE_MIN + STRICTNESS * sum);
            float d[2];
            for (int g = 0; g < 2; g++) {
                const float *here = b->colour[g][0] + line + x;
                const float d0 = here[0] - here[s.offset];
                const float d1 = here[BLOCK_PIXELS] - here[BLOCK_PIXELS + s.offset];
                const float d2 = here[2 * BLOCK_PIXELS] - here[2 * BLOCK_PIXELS + s.offset];
                d[g] = (d0 * d0 + d1 * d1 + d2 * d2 - less) * scale;
            }
            first[line + x] = d[0];
            second[line + x] = d[1];
        }
    }
}

/* Means over patches, without the terms that have the group's value in the pixel in the middle (unless it is to know). */
static INLINE void sum_patches(const float *restrict each, struct shift s, int knowing, float *restrict out)
{
    const float own = knowing ? 0.0f : 1.0f;
    const int twice = !knowing && s.x >= -PATCH && s.x <= PATCH && s.y >= -PATCH && s.y <= PATCH;
    const float scale = 1.0f / (float)(PATCH_PIXELS - !knowing - twice), back_too = twice ? 1.0f : 0.0f;
    const int back = twice ? s.offset : 0;

    for (int y = s.top; y < s.bottom; y++) {
        const int line = (y + BLOCK_MARGIN) * BLOCK_SIDE + BLOCK_MARGIN;
        const float *restrict from = each + line - PATCH, *restrict middle = each + line;
        float sums[REACH];
        for (int x = 0; x < REACH; x++)
            sums[x] = from[x - 3 * BLOCK_SIDE] + from[x - 2 * BLOCK_SIDE] + from[x - BLOCK_SIDE] + from[x] +
                      from[x + BLOCK_SIDE] + from[x + 2 * BLOCK_SIDE] + from[x + 3 * BLOCK_SIDE];
        for (int x = 0; x < BLOCK_INNER; x++)
            out[line + x] = (sums[x] + sums[x + 1] + sums[x + 2] + sums[x + 3] + sums[x + 4] + sums[x + 5] +
                             sums[x + 6] - own * middle[x] - back_too * middle[x - back]) * scale;
    }
}

static INLINE void add_weighted(struct block *b, int g, struct shift s, const float *restrict distance,
                                float *restrict total)
{
    for (int y = s.top; y < s.bottom; y++) {
        const int line = (y + BLOCK_MARGIN) * BLOCK_SIDE + BLOCK_MARGIN;
        const float *restrict feature = b->feature[g][0] + line, *restrict loose = b->loose[0] + line;
        const float *restrict weight = b->weight + line + s.offset;
        const float *restrict colour = b->colour[g][0] + line + s.offset;
        float *restrict result = b->result[g][0] + line, *restrict sum = total + line;
        for (int x = 0; x < BLOCK_INNER; x++) {
            float far[2], w;
            for (int part = 0; part < 2; part++) {
                const float *f = feature + part * 3 * BLOCK_PIXELS + x;
                const float d0 = f[0] - f[s.offset], d1 = f[BLOCK_PIXELS] - f[BLOCK_PIXELS + s.offset];
                const float d2 = f[2 * BLOCK_PIXELS] - f[2 * BLOCK_PIXELS + s.offset];
                far[part] = (d0 * d0 + d1 * d1 + d2 * d2) * loose[part * BLOCK_PIXELS + x];
            }
            w = distance ? distance[line + x] : 0;
            w = weight_of((w > 0 ? w : 0) + far[0] + far[1]) * weight[x];
            sum[x] += w;
            result[x] += w * colour[x];
            result[BLOCK_PIXELS + x] += w * colour[BLOCK_PIXELS + x];
            result[2 * BLOCK_PIXELS + x] += w * colour[2 * BLOCK_PIXELS + x];
        }
    }
}

/* The same for fits, of the pixels that the joint filter takes in and those whose normals differ more. */
static INLINE void add_fits(struct block *b, int g, struct shift s, const float *restrict distance, float radius)
{
    float w[BLOCK_INNER], z[FIT_GRADIENT][BLOCK_INNER];

    for (int x = 0; x < BLOCK_INNER; x++) {
        z[3][x] = (float)s.x / radius;
        z[4][x] = (float)s.y / radius;
    }
    for (int y = s.top; y < s.bottom; y++) {
        const int line = (y + BLOCK_MARGIN) * BLOCK_SIDE + BLOCK_MARGIN;
        const float *restrict f = b->feature[g][0] + line, *restrict n = b->feature[g][3] + line;
        const float *restrict loose = b->loose[0] + line, *restrict like = distance + line;
        const float *restrict weight = b->weight + line + s.offset;
        for (int x = 0; x < BLOCK_INNER; x++) {
            const float d0 = f[x + s.offset] - f[x], d1 = f[x + BLOCK_PIXELS + s.offset] - f[x + BLOCK_PIXELS];
            const float d2 = f[x + 2 * BLOCK_PIXELS + s.offset] - f[x + 2 * BLOCK_PIXELS];
            const float n0 = n[x + s.offset] - n[x], n1 = n[x + BLOCK_PIXELS + s.offset] - n[x + BLOCK_PIXELS];
            const float n2 = n[x + 2 * BLOCK_PIXELS + s.offset] - n[x + 2 * BLOCK_PIXELS];
            const float far = (d0 * d0 + d1 * d1 + d2 * d2) * loose[x] +
                              (n0 * n0 + n1 * n1 + n2 * n2) * loose[BLOCK_PIXELS + x] * FIT_NORMALS;
            z[0][x] = n0;
            z[1][x] = n1;
            z[2][x] = n2;
            w[x] = weight_of((like[x] > 0 ? like[x] : 0) * FIT_COLOURS + far) * weight[x];
        }
        fit_add_line(b->sums[g] + (y - s.top) * BLOCK_INNER, w, z, b->colour[g][0] + line + s.offset);
    }
}

static INLINE void divide(struct block *b, int g, struct shift s, const float *total)
{
    for (int c = 0; c < 3; c++)
        for (int y = s.top; y < s.bottom; y++)
            for (int x = 0; x < BLOCK_INNER; x++) {
                const uint32_t p = block_index((uint32_t)x, (uint32_t)y);
                b->result[g][c][p] *= b->albedo[g][c][p] / (total[p] > 0 ? total[p] : 1);
            }
}

static INLINE void solve(struct block *b, int g, struct shift s)
{
    for (int y = s.top; y < s.bottom; y++)
        for (int x = 0; x < BLOCK_INNER; x++) {
            const uint32_t p = block_index((uint32_t)x, (uint32_t)y);
            const float normal = FIT_RIDGE_NORMAL / b->loose[1][p];
            const float ridges[FIT_GRADIENT] = {normal, normal, normal, FIT_RIDGE_POSITION, FIT_RIDGE_POSITION};
            float value[3];
            const int good = fit_solve(b->sums[g] + (y - s.top) * BLOCK_INNER + x, ridges, value);
            for (int c = 0; c < 3; c++)
                b->fitted[g][c][p] = good ? value[c] * b->albedo[g][c][p] : b->result[g][c][p];
        }
}

/* Line by line, so that sums stay in the processor's cache. */
static INLINE void filter(struct block *b, int radius, enum joint_colours colours, int fits)
{
    float *total[2] = {b->scratch[0], b->scratch[1]}, *each[2] = {b->scratch[2], b->scratch[3]};
    float *distance = b->scratch[4];
    struct shift s = {0, 0, 0, 0, 0};

    memset(b->result, 0, sizeof b->result);
    memset(total[0], 0, sizeof(block_plane));
    memset(total[1], 0, sizeof(block_plane));
    for (; s.top < (int)b->height; s.top += BLOCK_LINES) {
        s.bottom = s.top + BLOCK_LINES;
        if (fits)
            memset(b->sums, 0, sizeof b->sums);
        for (s.y = -radius; s.y <= radius; s.y++)
            for (s.x = -radius; s.x <= radius; s.x++) {
                s.offset = s.y * BLOCK_SIDE + s.x;
                if (colours)
                    compare(b, s, each[0], each[1]);
                for (int g = 0; g < 2; g++) {
                    if (colours)
                        sum_patches(each[!g], s, colours == JOINT_KNOWING, distance);
                    add_weighted(b, g, s, colours ? distance : NULL, total[g]);
                    if (fits)
                        add_fits(b, g, s, distance, (float)radius);
                }
            }
        for (int g = 0; g < 2; g++) {
            divide(b, g, s, total[g]);
            if (fits)
                solve(b, g, s);
        }
    }
}

static INLINE void filter_joint(struct block *b, int radius, enum joint_colours colours) { filter(b, radius, colours, 0); }

static INLINE void filter_fitted(struct block *b, int radius) { filter(b, radius, JOINT_COLOURS, 1); }

WIDE_VERSIONS(block_filter_joint, filter_joint, (struct block * b, int radius, enum joint_colours colours), (b, radius, colours))
WIDE_VERSIONS(block_filter_fitted, filter_fitted, (struct block * b, int radius), (b, radius))
