/* bounds: a sphere around the scene.
 *
 * A path tracer lets environment rays go to infinity. The sphere gives directional lights and the
 * environment a finite power, from which the odds of choosing them follow.
 */
#pragma once

#include <stddef.h>

#include "common/math/vec.h"

struct sphere {
    struct vec3 centre;
    real radius;
};

/* Ritter 1990 ("An Efficient Bounding Sphere", Graphics Gems): start from a far pair, grow to
 * include points outside; at most about 20 % larger than the smallest. Contains every point,
 * rounding included. No points: radius 0 at the origin. */
struct sphere sphere_around(const struct vec3 *points, size_t count);
