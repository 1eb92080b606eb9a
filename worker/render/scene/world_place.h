/* world_place: poses of the scene, and the placing of every instance. Private to worker/render.
 *
 * A static mesh that occurs once (or is small) is baked into world space. A moving mesh gets a
 * matrix for each step. A mesh that is deformed, or flattened on the way, gets its vertices for
 * each step.
 */
#ifndef AZULEJO_RENDER_WORLD_PLACE_H
#define AZULEJO_RENDER_WORLD_PLACE_H

#include "worker/render/world.h"
#include "worker/render/scene/world_pose.h"

/* Make w->instances, except the lights' part; needs the meshes and materials. ERR_INPUT: something
 * is deformed or moved beyond all bounds. */
status world_place(struct render_scene *w, const struct world_poses *poses, struct error *err)
    MUST_CHECK;

/* The keys of the stochastic alpha, from `scene` as it was imported: the same in all frames, whatever their
 * origins. */
void world_place_keys(struct render_scene *w, const struct scene *scene);

/* Does any instance move while the shutter is open? */
int world_place_moves(const struct render_scene *w);

/* Points whose hull contains everything that the instance covers during the shutter: at most
 * 8 * WORLD_STEPS_MAX; without motion, the corners of its mesh's box. Returns how many. */
size_t world_place_hull(const struct render_scene *w, const struct scene *scene, uint32_t instance,
                        struct vec3 *out);

/* Memory that lives as long as `w`; NULL when out of memory. world_own takes over a block from
 * mem_alloc, and frees it if it fails. */
int world_own(struct render_scene *w, void *block);

#endif
