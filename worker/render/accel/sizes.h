/* sizes: how large and how slender a scene's triangles are, which bounds the errors of float
 * arithmetic on them. Private to worker/render; used by accel.
 *
 * Embree subtracts the ray's origin from the corners in float, so its error at a triangle grows
 * with the triangle's longest edge, and for slender triangles also with longest edge / height. A
 * few triangles beside which the rest is tiny (a ground of 1,000 km under a box of 2 cm) would blur
 * everything near them. They are called huge, and are intersected in double.
 */
#pragma once

#include "worker/render/accel/accel.h"

enum { SIZES_HUGE_MAX = 1024 };  /* triangles */

struct sizes {
    double *longest; /* [instances] metres in world space: upper bound of the longest edge
                             of the triangles that are not huge */
    uint32_t huge_count;
    struct hit *huge; /* [huge_count] by instance, then by triangle */
};

/* Reads every triangle once. ERR_NO_MEMORY. */
status sizes_init(struct sizes *sizes, const struct accel_input *in, struct error *err) MUST_CHECK;
void sizes_release(struct sizes *sizes);

/* How much a matrix magnifies the errors of Embree's float inverse and products: the largest row
 * sum of |M| |M^-1|; and a lower bound of how much it stretches anything (0 for a flat matrix). */
double sizes_condition(const struct transform *m);
double sizes_least_stretch(const struct transform *m);

/* Binary logarithm of longest edge / height of each triangle, rounded up and at most SIZES_SLENDER_MAX; *out is NULL if
 * all are small. *worst_squared is the square of the largest ratio, rounded in the same way; 1 if all are small. */
enum { SIZES_SLENDER_MAX = 30 };
status sizes_slender(const float32 *positions, const struct accel_mesh *mesh, uint8_t **out, double *worst_squared,
                     struct error *err) MUST_CHECK;
