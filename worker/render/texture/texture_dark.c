/* A summed-area table (Crow 1984) counts the blocks of texels that hold any light, so a query takes
 * the same few steps for any area. */
#include "worker/render/texture/texture_dark.h"

#include <math.h>

#include "common/base/memory.h"
#include "worker/render/texture/texture_data.h"

enum { BLOCKS_A_SIDE_MAX = 512 };
/* Lookups compute in float: their texel may differ from the one in double by this share of the
 * coordinate's magnitude plus this many texels. */
#define COORDINATE_SLACK 0x1p-20
#define TEXELS_SLACK 2

struct texture_dark {
    uint32_t size[2]; /* texels */
    uint32_t blocks[2];
    uint32_t shift; /* a block is 2^shift texels wide */
    uint32_t *lit;  /* [blocks[1] + 1][blocks[0] + 1] blocks with light above and to the left */
};

static int texel_is_lit(const struct texture_image *image, size_t index)
{
    uint32_t colors = image->channels < 3 ? 1 : 3;
    size_t first = index * image->channels;

    for (uint32_t c = 0; c < colors; c++) {
        if (image->layout == TEXTURE_FLOAT ? !(((const float32 *)image->texels)[first + c] == 0)
            : image->layout == TEXTURE_16  ? ((const uint16_t *)image->texels)[first + c] != 0
                                           : ((const uint8_t *)image->texels)[first + c] != 0)
            return 1;
    }
    return 0;
}

/* Mark the blocks with light in row `y` of texels. */
static void mark_row(struct texture_dark *dark, const struct texture_image *image, uint32_t y)
{
    uint32_t *row = dark->lit + ((size_t)(y >> dark->shift) + 1) * (dark->blocks[0] + 1) + 1;

    for (uint32_t x = 0; x < image->width; x++)
        if (!row[x >> dark->shift] && texel_is_lit(image, (size_t)y * image->width + x))
            row[x >> dark->shift] = 1;
}

status texture_dark_new(struct texture_dark **out, const struct texture_image *image, struct error *err)
{
    struct texture_dark *dark = mem_calloc(1, sizeof *dark);
    size_t stride;

    *out = NULL;
    NEED(dark, err, "where a texture is dark");
    dark->size[0] = image->width;
    dark->size[1] = image->height;
    while ((image->width - 1) >> dark->shift >= BLOCKS_A_SIDE_MAX ||
           (image->height - 1) >> dark->shift >= BLOCKS_A_SIDE_MAX)
        dark->shift++;
    for (int axis = 0; axis < 2; axis++)
        dark->blocks[axis] = ((dark->size[axis] - 1) >> dark->shift) + 1;
    stride = (size_t)dark->blocks[0] + 1;
    dark->lit = mem_calloc(stride * ((size_t)dark->blocks[1] + 1), sizeof *dark->lit);
    if (!dark->lit) {
        texture_dark_free(dark);
        return error_no_memory(err, "where a texture is dark");
    }
    for (uint32_t y = 0; y < image->height; y++)
        mark_row(dark, image, y);
    for (size_t i = stride + 1; i < stride * ((size_t)dark->blocks[1] + 1); i++)
        if (i % stride > 0)
            dark->lit[i] += dark->lit[i - 1] + dark->lit[i - stride] - dark->lit[i - stride - 1];
    *out = dark;
    return STATUS_OK;
}

void texture_dark_free(struct texture_dark *dark)
{
    if (!dark)
        return;
    mem_free(dark->lit);
    mem_free(dark);
}

/* The first and last block of the texels that lookups in the range read. */
static void block_range(const struct texture_dark *dark, int axis, enum scene_wrap wrap, const double range[2],
                        uint32_t out[2])
{
    double size = (double)dark->size[axis];
    double slack = TEXELS_SLACK + size * COORDINATE_SLACK * (fabs(range[0]) + fabs(range[1]));
    double whole = wrap == WRAP_REPEAT ? floor(range[0]) : 0;
    double first = (range[0] - whole) * size - slack, last = (range[1] - whole) * size + slack;

    if (wrap == WRAP_CLAMP || wrap == WRAP_BLACK) {
        first = fmin(fmax(first, 0), size - 1);
        last = fmin(fmax(last, 0), size - 1);
    } else if (!(first >= 0 && last <= size - 1)) { /* past an edge: the whole side */
        first = 0;
        last = size - 1;
    }
    out[0] = (uint32_t)first >> dark->shift;
    out[1] = (uint32_t)last >> dark->shift;
}

int texture_dark_in(const struct texture_dark *dark, const struct scene_texture *texture, const double u[2],
                    const double v[2])
{
    size_t stride = (size_t)dark->blocks[0] + 1;
    uint32_t x[2], y[2];

    if (!isfinite(u[0]) || !isfinite(u[1]) || !isfinite(v[0]) || !isfinite(v[1]))
        return 0;
    block_range(dark, 0, texture->wrap_u, u, x);
    block_range(dark, 1, texture->wrap_v, v, y);
    return dark->lit[(y[1] + 1) * stride + x[1] + 1] - dark->lit[(y[1] + 1) * stride + x[0]] -
               dark->lit[y[0] * stride + x[1] + 1] + dark->lit[y[0] * stride + x[0]] == 0;
}
