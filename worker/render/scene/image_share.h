/* image_share: decoded images that several scenes of one process use.
 *
 * The frames of an animation are scenes of their own, but their textures are the same: an image
 * is decoded once while any living scene holds it. Two requests are alike when the file's
 * digest and the uses for which it is filtered are. Thread-safe; what is handed out is immutable.
 */
#ifndef AZULEJO_RENDER_IMAGE_SHARE_H
#define AZULEJO_RENDER_IMAGE_SHARE_H

#include "common/base/digest.h"
#include "worker/render/texture/texture.h"

struct image_share;

/* The image of these bytes, filtered for `uses` (enum texture_use; 0: the finest level alone).
 * Errors are texture_image_new's. Each image_share_get needs an image_share_put (NULL is nothing). */
status image_share_get(struct image_share **out, const struct digest *digest, unsigned uses,
                       const uint8_t *data, size_t size_bytes, const char *name,
                       struct error *err) MUST_CHECK;
void image_share_put(struct image_share *share);
struct texture_image *image_share_image(const struct image_share *share);

/* Does some scene hold it already, so that it would take no more memory? */
int image_share_has(const struct digest *digest, unsigned uses);

#endif
