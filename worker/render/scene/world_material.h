/* world_material: materials and images made ready. Private to worker/render. */
#ifndef AZULEJO_RENDER_WORLD_MATERIAL_H
#define AZULEJO_RENDER_WORLD_MATERIAL_H

#include "worker/render/world.h"

/* Which rows the frame reads: of a material that no instance has, a texture whose factor is 0 or
 * that the settings do without, nothing is loaded. Freed by world_used_release. */
enum { WORLD_IMAGE_USED = 4 };
struct world_used {
    uint8_t *materials, *media; /* 1: used */
    uint8_t *images;            /* 0, or WORLD_IMAGE_USED and the enum texture_use of lookups by
                                   footprint, for which it is to be filtered */
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

/* w->materials from the scene's, less what the settings do without; needs the images. */
status world_materials_load(struct render_scene *w, const struct scene *scene, struct error *err)
    MUST_CHECK;

/* Note what a material is on the meshes that it is put on; needs the instances. */
void world_materials_placed(struct render_scene *w);

#endif
