#include "common/denoise/frames.h"

#include <math.h>

#include "common/denoise/wide.h"

/* Frames are compared over this radius. */
enum { PATCH = 3, PATCH_PIXELS = (2 * PATCH + 1) * (2 * PATCH + 1) };
/* Distances, of which weight_of() makes a weight. Squared differences over a patch, in variances of the noise: what noise explains counts
 * as 0, with what it varies by (CHANCE). The mean difference of a patch, squared, in variances of such a mean: that sees a shadow that
 * moves below the noise of single pixels. */
#define UNLIKE 4.0f
#define CHANCE 0.5f
#define APART 0.5f
#define NOISE_MIN 1e-12f

static size_t pixel_of(const struct denoise_input *input, const struct block *b, uint32_t x, uint32_t y)
{
    return (size_t)(b->y + y) * input->width + b->x + x;
}

void frames_begin(struct frames *f, const struct denoise_input *input, const struct block *b)
{
    for (int g = 0; g < 2; g++)
        for (uint32_t y = 0; y < b->height; y++)
            for (uint32_t x = 0; x < b->width; x++) {
                const size_t to = pixel_of(input, b, x, y);
                const uint32_t p = block_index(x, y);
                f->total[g][to] = 1;
                for (size_t c = 0; c < 3; c++)
                    f->sums[g][to * 3 + c] = b->colour[g][c][p] * b->albedo[g][c][p];
            }
}

/* Of each pixel: the squared difference less what noise explains, and the difference. */
static INLINE void take_differences(const struct block *b, const struct block *other, int g, float *restrict unlike,
                                    float *restrict apart)
{
    const float *restrict here = b->colour[g][0], *restrict there = other->colour[g][0];

    for (uint32_t p = 0; p < BLOCK_PIXELS; p++) {
        const float d0 = here[p] - there[p], d1 = here[BLOCK_PIXELS + p] - there[BLOCK_PIXELS + p];
        const float d2 = here[2 * BLOCK_PIXELS + p] - there[2 * BLOCK_PIXELS + p];
        const float noise = NOISE_MIN + b->noise[p] + other->noise[p];
        unlike[p] = (d0 * d0 + d1 * d1 + d2 * d2) / noise - 1;
        apart[p] = (d0 + d1 + d2) / sqrtf(noise);
    }
}

/* Means over patches around a line's pixels, which are taken down first. */
static INLINE void average_line(const float *restrict each, uint32_t y, float *restrict out)
{
    enum { REACH = BLOCK_INNER + 2 * PATCH };
    const float *restrict from = each + block_index(0, y) - PATCH;
    float sums[REACH];

    for (int x = 0; x < REACH; x++)
        sums[x] = from[x - 3 * BLOCK_SIDE] + from[x - 2 * BLOCK_SIDE] + from[x - BLOCK_SIDE] + from[x] +
                  from[x + BLOCK_SIDE] + from[x + 2 * BLOCK_SIDE] + from[x + 3 * BLOCK_SIDE];
    for (int x = 0; x < BLOCK_INNER; x++)
        out[x] = (sums[x] + sums[x + 1] + sums[x + 2] + sums[x + 3] + sums[x + 4] + sums[x + 5] + sums[x + 6]) / PATCH_PIXELS;
}

static INLINE void weigh_line(const struct block *b, const struct block *other, int g, uint32_t y,
                              const float *restrict unlike, const float *restrict apart, float *restrict out)
{
    const uint32_t line = block_index(0, y);

    for (int x = 0; x < BLOCK_INNER; x++) {
        const float shifted = apart[x] * apart[x] * (PATCH_PIXELS / 3.0f) - 1;
        float far = (unlike[x] > CHANCE ? (unlike[x] - CHANCE) * UNLIKE : 0) + (shifted > 0 ? shifted * APART : 0);
        for (int k = 0; k < BLOCK_FEATURES; k++) {
            const float d = b->feature[g][k][line + (uint32_t)x] - other->feature[g][k][line + (uint32_t)x];
            far += d * d * b->loose[k / 3][line + (uint32_t)x];
        }
        out[x] = weight_of(far) * other->weight[line + (uint32_t)x];
    }
}

static INLINE void add(struct frames *f, const struct denoise_input *input, struct block *b, const struct block *other)
{
    float *unlike = b->scratch[0], *apart = b->scratch[1];
    float near[BLOCK_INNER], along[BLOCK_INNER], weights[BLOCK_INNER];

    for (int g = 0; g < 2; g++) {
        take_differences(b, other, g, unlike, apart);
        for (uint32_t y = 0; y < b->height; y++) {
            average_line(unlike, y, near);
            average_line(apart, y, along);
            weigh_line(b, other, g, y, near, along, weights);
            for (uint32_t x = 0; x < b->width; x++) {
                const size_t to = pixel_of(input, b, x, y);
                const uint32_t p = block_index(x, y);
                f->total[g][to] += weights[x];
                for (size_t c = 0; c < 3; c++)
                    f->sums[g][to * 3 + c] += weights[x] * other->colour[g][c][p] * other->albedo[g][c][p];
            }
        }
    }
}

WIDE_VERSIONS(frames_add, add,
              (struct frames * f, const struct denoise_input *input, struct block *b, const struct block *other),
              (f, input, b, other))

void frames_end(struct frames *f, const struct denoise_input *input, const struct block *b)
{
    for (int g = 0; g < 2; g++)
        for (uint32_t y = 0; y < b->height; y++)
            for (uint32_t x = 0; x < b->width; x++) {
                const size_t to = pixel_of(input, b, x, y);
                for (size_t c = 0; c < 3; c++)
                    f->sums[g][to * 3 + c] /= f->total[g][to];
            }
}
