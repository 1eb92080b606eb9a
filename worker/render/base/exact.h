/* exact: a ray and a triangle in double precision. Private to worker/render.
 *
 * Positions are float[3] converted to double, so the difference of two of them is exact or nearly
 * so. The results are accurate to about 2^-50 of the largest input length.
 */
#pragma once

#include <math.h>

#include "worker/render/accel/accel.h"

static inline void exact_cross(const double a[3], const double b[3], double out[3])
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

static inline double exact_dot(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static inline void exact_sub(const double a[3], const double b[3], double out[3])
{
    for (int k = 0; k < 3; k++)
        out[k] = a[k] - b[k];
}

static inline void exact_vec(struct vec3 v, double out[3])
{
    out[0] = (double)v.x;
    out[1] = (double)v.y;
    out[2] = (double)v.z;
}

static inline double exact_largest(const double a[3])
{
    double x = fabs(a[0]), y = fabs(a[1]), z = fabs(a[2]), most = x > y ? x : y;

    return z > most ? z : most; /* inline: fmax would be a function call */
}

/* Where the ray starts. */
static inline void exact_origin(const struct ray *ray, double out[3])
{
    out[0] = (double)ray->origin.x + ray->rest[0];
    out[1] = (double)ray->origin.y + ray->rest[1];
    out[2] = (double)ray->origin.z + ray->rest[2];
}

/* The floats nearest to a position, and the remainders. They are volatile because gcc 12 treats the
 * conversion from double to float and back as the identity where it vectorises. */
static inline struct vec3 exact_round(const double place[3], double rest[3])
{
    volatile real rounded[3];

    for (int k = 0; k < 3; k++) {
        rounded[k] = (real)place[k];
        rest[k] = place[k] - (double)rounded[k];
    }
    return vec3_make(rounded[0], rounded[1], rounded[2]);
}

/* Not normalised: its length is twice the area. */
static inline void exact_normal(const double corner[3][3], double out[3])
{
    double e1[3], e2[3];

    exact_sub(corner[1], corner[0], e1);
    exact_sub(corner[2], corner[0], e2);
    exact_cross(e1, e2, out);
}

/* Where the line meets the triangle's plane, in lengths of `direction`; NaN or infinite if it is
 * parallel to the plane. */
static inline double exact_crossing(const double corner[3][3], const double normal[3], const double origin[3],
                                    const double direction[3])
{
    double to_corner[3];

    exact_sub(corner[0], origin, to_corner);
    return exact_dot(normal, to_corner) / exact_dot(normal, direction);
}

/* The part of a triangle that is `inset` metres from its edges. 0: there is none; `out` is its incentre then. */
static inline int exact_inset(const double corner[3][3], double inset, double out[3][3])
{
    double length[3], n[3], e[3], perimeter, incentre, left;

    for (int k = 0; k < 3; k++) {
        exact_sub(corner[(k + 2) % 3], corner[(k + 1) % 3], e); /* opposite the corner */
        length[k] = sqrt(exact_dot(e, e));
    }
    perimeter = length[0] + length[1] + length[2];
    exact_normal(corner, n);
    left = 1 - inset * perimeter / sqrt(exact_dot(n, n));
    if (!(left > 0))
        left = 0;
    for (int a = 0; a < 3; a++) {
        incentre = (length[0] * corner[0][a] + length[1] * corner[1][a] + length[2] * corner[2][a]) / perimeter;
        for (int k = 0; k < 3; k++)
            out[k][a] = incentre + (corner[k][a] - incentre) * left;
    }
    return left > 0;
}
