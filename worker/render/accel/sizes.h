/* sizes: how large and how slender a scene's triangles are, which bounds the errors that float
 * makes with them. Private to worker/render; used by accel.
 *
 * Embree subtracts the ray's origin from the corners in float, so its error at a triangle grows
 * with the triangle's longest edge, and in slender ones with longest edge / height, too. A few
 * triangles beside which the rest is tiny (a ground of 1,000 km under a box of 2 cm) would blur
 * everything near them: they are called huge, and are intersected in double.
 */
#ifndef AZULEJO_RENDER_SIZES_H
#define AZULEJO_RENDER_SIZES_H

#include "worker/render/accel/accel.h"

enum { SIZES_HUGE_MAX = 1024 };  /* triangles */

struct sizes {
    double *longest;      /* [instances] metres: the longest edge of a triangle that is not huge, in
                             the world; at most so long */
    uint32_t huge_count;
    struct hit *huge;     /* [huge_count] by instance, then by triangle */
};

/* Looks at every triangle once. ERR_NO_MEMORY. */
status sizes_init(struct sizes *sizes, const struct accel_input *in, struct error *err) MUST_CHECK;
void sizes_release(struct sizes *sizes);

/* The part of a matrix that Embree's float inverse and products magnify: the largest row sum of
 * |M| |M^-1|; and a lower bound on how much it stretches anything (0 for a flat one). */
double sizes_condition(const struct transform *m);
double sizes_least_stretch(const struct transform *m);

/* Binary logarithm of longest edge / height of each triangle, rounded up and at most
 * SIZES_SLENDER_MAX; *out is NULL where all are small. *worst_squared is the largest ratio's
 * square so rounded, 1 where all are small. */
enum { SIZES_SLENDER_MAX = 30 };
status sizes_slender(const float *positions, const struct accel_mesh *mesh, uint8_t **out,
                     double *worst_squared, struct error *err) MUST_CHECK;

#endif
