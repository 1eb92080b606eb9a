/* texture_data: a decoded image and its MIP pyramids, shared by texture.c (loading, lookups) and
 * texture_pyramid.c (making the levels). Private to the two. */
#pragma once

#include "common/image/image.h"
#include "worker/render/texture/texture.h"

enum {
    TEXTURE_LEVELS_MAX = 18,  /* of IMAGE_SIDE_MAX texels */
    TEXTURE_CODES_16 = 1 << 16
};

enum texture_layout {
    TEXTURE_GREY8,
    TEXTURE_GREY_ALPHA8,
    TEXTURE_RGB8,
    TEXTURE_RGBA8,
    TEXTURE_16,
    TEXTURE_FLOAT
};

struct texture_level {
    uint32_t width, height;
    size_t first; /* texel number in the pyramid, which begins with level 1 */
};

struct texture_image {
    uint32_t width, height, channels;
    uint32_t texel_bytes;
    enum texture_layout layout;
    int opaque;
    const void *texels;   /* level 0: uint8_t, uint16_t or float; points into one of the two */
    const float32 *srgb8; /* decoding table of 8-bit values, static */
    float32 *srgb16;      /* of 16-bit values; TEXTURE_16 only, owned */
    struct image8 integers;
    struct image floats;
    real longest;        /* longer side, in texels */
    uint32_t last_level; /* the level of 1 x 1 */
    struct texture_level levels[TEXTURE_LEVELS_MAX];
    void *pyramid[2]; /* averaged as data, as sRGB colour; NULL: not made; owned. Float
                                 images have only the one for data */
};

/* Bytes per channel. */
static inline size_t texture_value_bytes(const struct texture_image *image)
{
    return image->layout == TEXTURE_FLOAT ? 4 : image->layout == TEXTURE_16 ? 2 : 1;
}

/* Compute sides and offsets of all levels from width and height. */
void texture_levels(struct texture_image *image);

/* Make image->pyramid[color]. ERR_NO_MEMORY. */
status texture_pyramid_make(struct texture_image *image, int color, struct error *err) MUST_CHECK;
