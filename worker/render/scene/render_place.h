/* render_scene_place: poses of the scene, and the placing of every instance. Private to worker/render.
 *
 * A static mesh that occurs once (or is small) is baked into world space. A moving mesh gets a matrix for each step. A
 * mesh that is deformed, or flattened on the way, gets its vertices for each step.
 */
#pragma once

#include "worker/render/render_scene.h"
#include "worker/render/scene/render_pose.h"

/* Make w->instances, except the lights' part; needs the meshes and materials. ERR_INPUT: something
 * is deformed or moved beyond all bounds. */
status render_scene_place(struct render_scene *w, const struct render_poses *poses, struct error *err) MUST_CHECK;

/* The keys of the stochastic alpha, from `scene` as it was imported: the same in all frames, whatever their origins. */
void place_keys(struct render_scene *w, const struct scene *scene);

/* Does any instance move while the shutter is open? */
int place_moves(const struct render_scene *w);

/* Points whose hull contains everything that the instance covers during the shutter: at most
 * 8 * RENDER_STEPS_MAX; without motion, the corners of its mesh's box. Returns how many. */
size_t place_hull(const struct render_scene *w, const struct scene *scene, uint32_t instance, struct vec3 *out);

/* Memory that lives as long as `w`; NULL when out of memory. render_scene_own takes over a block from
 * mem_alloc, and frees it if it fails. */
int render_scene_own(struct render_scene *w, void *block);
