/* world_place: poses of the scene, and every instance put where it is. Private to worker/render.
 *
 * A static mesh that occurs once (or is small) is baked into world space; what moves keeps its
 * mesh and gets a matrix for each step; what is deformed, or flattened on the way, gets its
 * vertices for each step.
 */
#ifndef AZULEJO_RENDER_WORLD_PLACE_H
#define AZULEJO_RENDER_WORLD_PLACE_H

#include "worker/render/world.h"
#include "worker/render/scene/world_pose.h"

/* Make w->instances, all but the lights' part; needs the meshes and materials. ERR_INPUT: something
 * is deformed or moved out of all bounds. */
status world_place(struct render_scene *w, const struct world_poses *poses, struct error *err)
    MUST_CHECK;

/* Does any instance move while the shutter is open? */
int world_place_moves(const struct render_scene *w);

/* Points around which everything that the instance ever is lies: at most 8 * WORLD_STEPS_MAX.
 * The corners of its mesh's box for what stands still. Returns how many. */
size_t world_place_hull(const struct render_scene *w, const struct scene *scene, uint32_t instance,
                        struct vec3 *out);

/* Memory that lives as long as `w`; NULL when out of memory. world_own takes over a block of
 * mem_alloc's, and frees it if it fails. */
int world_own(struct render_scene *w, void *block);

#endif
