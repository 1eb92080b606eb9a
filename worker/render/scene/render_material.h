/* render_material: prepares materials and images for rendering. Private to worker/render. */
#pragma once

#include "worker/render/render_scene.h"

/* Which rows the frame reads. Nothing is loaded for a material that no instance has, or for a
 * texture whose factor is 0 or that the settings leave out. Freed by used_release. */
enum { RENDER_IMAGE_USED = 4 };
struct render_used {
    uint8_t *materials, *media; /* 1: used */
    uint8_t *images;            /* 0, or RENDER_IMAGE_USED and the enum texture_use of lookups by
                                   footprint, for which it is filtered */
};
status used_init(struct render_used *used, const struct scene *scene, const struct render_settings *settings,
                 struct error *err) MUST_CHECK;
void used_release(struct render_used *used);

static inline unsigned image_uses(const struct render_used *used, uint32_t image)
{
    return used->images[image] & (TEXTURE_AS_DATA | TEXTURE_AS_COLOR);
}

/* Decode the used images into w->images; the others stay NULL. */
status images_load(struct render_scene *w, const struct scene *scene, const struct render_used *used,
                   struct blob_source blobs, struct error *err) MUST_CHECK;

/* Fill w->materials from the scene's, without what the settings leave out; needs the images. */
status materials_load(struct render_scene *w, const struct scene *scene, struct error *err) MUST_CHECK;

/* Record properties of a material that depend on the meshes it is on; needs the instances. */
void materials_placed(struct render_scene *w);
