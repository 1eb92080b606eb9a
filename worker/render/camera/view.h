/* view: how the image of a point moves. */
#pragma once

#include "worker/render/render_scene.h"

/* How far a point of a triangle moves on the film while the shutter is open: pixels, x right, y
 * down. 0, 0 where it is behind the camera at the opening or the closing. */
void view_motion(const struct render_scene *scene, uint32_t instance, uint32_t triangle, real b1, real b2, real out[2]);
