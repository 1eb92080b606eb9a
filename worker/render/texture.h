/* texture: decoded images and lookups in them.
 *
 * 8-bit images stay 8-bit in memory; sRGB is decoded per texel before filtering. A texture
 * is immutable after texture_new.
 */
#ifndef AZULEJO_RENDER_TEXTURE_H
#define AZULEJO_RENDER_TEXTURE_H

#include <stddef.h>
#include <stdint.h>

#include "common/base/status.h"
#include "common/math/vec.h"
#include "common/scene/scene.h"

struct texture_image; /* the decoded pixels of one scene_image; shared by textures */

struct texel {
    float r, g, b, a;
};

/* Decode PNG, JPEG (kept at 8 or 16 bits) or HDR, EXR (kept as float RGB). */
status texture_image_new(struct texture_image **out, const uint8_t *data, size_t size_bytes,
                         const char *name, struct error *err) MUST_CHECK;
void texture_image_free(struct texture_image *image);
size_t texture_image_bytes(const struct texture_image *image);
/* Is every texel's alpha 1? Then alpha tests cannot do anything. */
int texture_image_is_opaque(const struct texture_image *image);

/* Look up at (u, v), v downwards, any finite value (wrapped as the texture says; a
 * coordinate that is not finite reads as 0). `footprint`: width of the looking ray's beam in
 * units of the whole image (1: it covers all of it); 0: the finest level alone. `srgb`: decode the colour channels of integer
 * images from sRGB (never alpha, never float images). Grey images are replicated to RGB;
 * a missing alpha is 1. Bilinear with texel centres at half integers, or nearest. */
struct texel texture_lookup(const struct texture_image *image, const struct scene_texture *texture,
                            float u, float v, float footprint, int srgb);

#endif
