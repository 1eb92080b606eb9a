/* texture: decoded images and lookups in them.
 *
 * 8-bit images stay 8-bit in memory, 16-bit ones 16-bit; sRGB is decoded per texel before filtering. An image whose
 * texels are all equal is stored as one texel. Immutable once its pyramids are made: any number of threads may look up.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/base/status.h"
#include "common/math/vec.h"
#include "common/scene/scene.h"

struct texture_image; /* the decoded pixels of one scene_image; shared by textures */

struct texel {
    real r, g, b, a;
};

/* Decode PNG, JPEG, WebP (kept at 8 or 16 bits) or HDR, EXR (kept as floats). The messages of
 * ERR_LIMIT and ERR_NO_MEMORY name the image and how much memory it needs. */
status texture_image_new(struct texture_image **out, const uint8_t *data, size_t size_bytes, const char *name,
                         struct error *err) MUST_CHECK;

/* How lookups read an image's colour channels, which decides how they are averaged. */
enum texture_use {
    TEXTURE_AS_DATA = 1,  /* lookups with srgb 0 */
    TEXTURE_AS_COLOR = 2, /* lookups with srgb 1 */
};

/* How a lookup by `texture` uses its image, in a slot of colours (`srgb`) or data. */
static inline enum texture_use texture_use_of(const struct scene_texture *texture, int srgb)
{
    if (texture->encoding != ENCODING_BY_SLOT)
        srgb = texture->encoding == ENCODING_SRGB;
    return srgb ? TEXTURE_AS_COLOR : TEXTURE_AS_DATA;
}

/* Make the MIP pyramids for these uses (a third of the image's memory each), at the image's own
 * depth; existing ones are kept. Without them, lookups read the finest level for any footprint.
 * Not thread-safe with lookups. ERR_NO_MEMORY. */
status texture_image_filter(struct texture_image *image, unsigned uses, const char *name, struct error *err) MUST_CHECK;
void texture_image_free(struct texture_image *image);
size_t texture_image_bytes(const struct texture_image *image);
/* Is every texel's alpha 1? Then alpha tests have no effect. */
int texture_image_is_opaque(const struct texture_image *image);

/* Look up at (u, v), v downwards, any finite value (wrapped as the texture says; a coordinate that is not finite reads
 * as 0). `footprint`: width of the ray's beam in units of the whole image (1: it covers all of it). The lookup is
 * trilinear, between the two levels whose texel widths along the longer side enclose the footprint; 0: the finest level
 * alone. `srgb`: decode the colour channels of integer images from sRGB (never alpha, never float images), unless the
 * texture's own encoding decides. Grey images are replicated to RGB; a missing alpha is 1. Bilinear with texel centres
 * at half integers, or nearest (in the finest level, for any footprint). With WRAP_BLACK all four channels are 0
 * outside the image, whose edge stays sharp. */
struct texel texture_lookup(const struct texture_image *image, const struct scene_texture *texture, real u, real v,
                            real footprint, int srgb);

/* ---- the same in two steps, for textures that are looked up at one place ---- */
struct texture_taps {
    size_t index[4]; /* texels of one level: above left and right, below */
    real x, y;       /* weights of the right and the lower ones */
};
struct texture_place {
    uint32_t level; /* the finer one */
    int levels;     /* 0: outside the image; 1; or 2: the next coarser one, too */
    real blend;     /* weight of that */
    struct texture_taps taps[2];
};

void texture_place(struct texture_place *out, const struct texture_image *image, const struct scene_texture *texture,
                   real u, real v, real footprint, int srgb);
struct texel texture_read(const struct texture_image *image, const struct scene_texture *texture,
                          const struct texture_place *place, int srgb);
/* Do both lookups find the same place for the same coordinates? Valid once their pyramids are made. */
int texture_shares_place(const struct texture_image *a, const struct scene_texture *texture_a, int srgb_a,
                         const struct texture_image *b, const struct scene_texture *texture_b, int srgb_b);
