/* render_memory: will the scene fit? Private to worker/render. */
#pragma once

#include "worker/render/scene/render_material.h"

/* What rendering the scene takes, in bytes, estimated from tables and headers before anything is
 * decoded or built. The estimate should be right within a quarter where it matters. */
struct render_need {
    uint64_t meshes;   /* blobs, vertices in world space, steps of motion */
    uint64_t textures; /* and the environment's map and the media's grids */
    uint64_t bvh;
};
status need_of(struct render_need *need, const struct scene *scene, const struct render_settings *settings,
               const struct render_used *used, struct blob_source blobs, struct error *err) MUST_CHECK;

/* ERR_NO_MEMORY, with a message that gives the numbers, if it needs more than the machine has free
 * or than render_memory_limit allows. */
status need_check(const struct render_need *need, struct error *err) MUST_CHECK;
