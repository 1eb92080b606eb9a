/* world_memory: will the scene fit? Private to worker/render. */
#ifndef AZULEJO_RENDER_WORLD_MEMORY_H
#define AZULEJO_RENDER_WORLD_MEMORY_H

#include "worker/render/scene/world_material.h"

/* What rendering the scene takes, in bytes, estimated from tables and headers before anything is
 * decoded or built. The estimate should be right within a quarter where it matters. */
struct world_need {
    uint64_t meshes;    /* blobs, vertices in world space, steps of motion */
    uint64_t textures;  /* and the environment's map and the media's grids */
    uint64_t bvh;
};
status world_need_of(struct world_need *need, const struct scene *scene,
                     const struct render_settings *settings, const struct world_used *used,
                     struct blob_source blobs, struct error *err) MUST_CHECK;

/* ERR_NO_MEMORY, with a message that gives the numbers, if it needs more than the machine has free
 * or than render_memory_limit allows. */
status world_need_check(const struct world_need *need, struct error *err) MUST_CHECK;

#endif
