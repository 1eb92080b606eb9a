/* world_material: prepares materials and images for rendering. Private to worker/render. */
#ifndef AZULEJO_RENDER_WORLD_MATERIAL_H
#define AZULEJO_RENDER_WORLD_MATERIAL_H

#include "worker/render/world.h"

/* Which rows the frame reads. Nothing is loaded for a material that no instance has, or for a
 * texture whose factor is 0 or that the settings leave out. Freed by world_used_release. */
enum { WORLD_IMAGE_USED = 4 };
struct world_used {
    uint8_t *materials, *media; /* 1: used */
    uint8_t *images;            /* 0, or WORLD_IMAGE_USED and the enum texture_use of lookups by
                                   footprint, for which it is filtered */
};
status world_used_init(struct world_used *used, const struct scene *scene,
                       const struct render_settings *settings, struct error *err) MUST_CHECK;
void world_used_release(struct world_used *used);

static inline unsigned world_image_uses(const struct world_used *used, uint32_t image)
{
    return used->images[image] & (TEXTURE_AS_DATA | TEXTURE_AS_COLOR);
}

/* Decode the used images into w->images; the others stay NULL. */
status world_images_load(struct render_scene *w, const struct scene *scene,
                         const struct world_used *used, struct blob_source blobs,
                         struct error *err) MUST_CHECK;

/* Fill w->materials from the scene's, without what the settings leave out; needs the images. */
status world_materials_load(struct render_scene *w, const struct scene *scene, struct error *err)
    MUST_CHECK;

/* Record properties of a material that depend on the meshes it is on; needs the instances. */
void world_materials_placed(struct render_scene *w);

#endif
