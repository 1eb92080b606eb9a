/* move: another origin for a scene's coordinates.
 *
 * Positions are kept relative to scene->origin, so that floats are fine where they are needed: the importer
 * chooses the origin of a file, the renderer one for each frame's view.
 */
#pragma once

#include "common/base/status.h"
#include "common/scene/scene.h"

/* Make `by`, metres relative to the present origin, the origin: every position except the nodes' is
 * written again, in double. */
void scene_move(struct scene *scene, const double by[3]);

/* A copy of `scene` that shares everything with it but what scene_move writes. `scene` must outlive it, and
 * does not change. Release it with scene_copy_release (not scene_release). ERR_NO_MEMORY. */
status scene_copy_movable(struct scene *out, const struct scene *scene, struct error *err) MUST_CHECK;
void scene_copy_release(struct scene *copy);
