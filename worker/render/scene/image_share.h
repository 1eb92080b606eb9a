/* image_share: decoded images shared by several scenes of one process.
 *
 * The frames of an animation are separate scenes with the same textures. An image is decoded once
 * while any living scene holds it. Two requests match if the file's digest and the uses for which
 * the image is filtered are the same. Thread-safe; the images returned are immutable.
 */
#pragma once

#include "common/base/digest.h"
#include "worker/render/texture/texture.h"

struct image_share;

/* The image of these bytes, filtered for `uses` (enum texture_use; 0: the finest level only). Errors as
 * texture_image_new. Each image_share_get needs an image_share_put (NULL does nothing). */
status image_share_get(struct image_share **out, const struct digest *digest, unsigned uses, const uint8_t *data,
                       size_t size_bytes, const char *name, struct error *err) MUST_CHECK;
void image_share_put(struct image_share *share);
struct texture_image *image_share_image(const struct image_share *share);

/* Does some scene hold it already, so that it needs no more memory? */
int image_share_has(const struct digest *digest, unsigned uses);
