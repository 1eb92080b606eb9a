/* sight: what a camera sees, coarsely, and which origin of coordinates that calls for.
 *
 * The error of float arithmetic on rays and triangles grows with the coordinates (docs/NUMERICS.md), so what a
 * camera sees must lie near the renderer's origin, whatever else is in the scene. A view is drawn as a coarse
 * picture of distances: a thing that is seen needs the more precision the nearer it is. The scene's origin
 * stays where it is nearly as good as the best: then all views have the same coordinates.
 * A pure function of scene, camera and time: all in double, in a fixed order.
 */
#pragma once

#include "common/scene/pose.h"

struct scene_sight;

/* The view of `camera` at `pose`; `aspect` is the picture's width over its height. Reads the blobs of the meshes that
 * are in view: at most some 260,000 triangles, evenly chosen. ERR_NO_MEMORY, or what the reader returns. */
status scene_sight_new(struct scene_sight **out, const struct scene *scene, const struct scene_pose *pose,
                       uint32_t camera, double aspect, struct scene_blob_reader blobs, struct error *err) MUST_CHECK;
void scene_sight_free(struct scene_sight *sight);

/* The origin for this view, metres relative to the scene's. Returns how far what is seen is from the camera, metres
 * (the harmonic mean; half the height of a parallel view). 0 0 0 and 0: the origin may stay. */
double scene_sight_origin(const struct scene_sight *sight, double origin[3]);

/* The largest detail, in pixels of a picture of this height, whose shadow may be wrong with that origin, and
 * where it is: metres of the detail, and from the camera. 0: nothing is seen. */
double scene_sight_blur(const struct scene_sight *sight, const double origin[3], uint32_t height, double *detail_m,
                        double *distance_m);
