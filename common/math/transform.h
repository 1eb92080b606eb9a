/* transform: affine maps of space, three rows of four, row-major: p' = M p + t.
 *
 * Chains are concatenated in double and kept in float for rendering.
 */
#pragma once

#include <stddef.h>

#include "common/math/vec.h"

struct transform_d {
    double m[3][4];
};

struct transform {
    real m[3][4];
};

/* As a scene holds and sends it. */
struct transform_stored {
    float32 m[3][4];
};

static inline struct transform transform_from_d(const struct transform_d *a)
{
    struct transform out;

    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 4; c++)
            out.m[r][c] = (real)a->m[r][c];
    return out;
}

static inline struct transform_d transform_to_d(const struct transform *a)
{
    struct transform_d out;

    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 4; c++)
            out.m[r][c] = (double)a->m[r][c];
    return out;
}

static inline int transform_is_finite(const struct transform *a)
{
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 4; c++)
            if (!isfinite(a->m[r][c]))
                return 0;
    return 1;
}

static inline struct transform_d transform_d_identity(void)
{
    return (struct transform_d){{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}};
}

/* a after b: x -> a(b(x)). */
struct transform_d transform_d_multiply(const struct transform_d *a, const struct transform_d *b);

void transform_d_point(const struct transform_d *a, const double p[3], double out[3]);

/* From a column-major 4x4 matrix as glTF stores it (the last row is taken as 0 0 0 1). */
struct transform_d transform_d_from_columns(const double columns[16]);

/* Translation * rotation(unit quaternion x,y,z,w; normalised here) * scale. */
struct transform_d transform_d_from_trs(const double t[3], const double q[4], const double s[3]);

double transform_d_determinant(const struct transform_d *a);

/* Inverse; 0 when the determinant is zero or not finite (out is then the identity). */
int transform_d_invert(const struct transform_d *a, struct transform_d *out);

/* The rotation and translation of an object that looks along its -Z with its +Y up. The viewing
 * direction and the position stay exact, up is made orthogonal to it, and a mirrored transform
 * still gives a proper rotation. 0 when its axes vanish (out is then the identity). */
int transform_d_rigid(const struct transform_d *a, struct transform_d *out);

struct transform_stored transform_stored_from_d(const struct transform_d *a);
struct transform_d transform_stored_to_d(const struct transform_stored *a);
int transform_stored_is_finite(const struct transform_stored *a);
int transform_d_is_finite(const struct transform_d *a);

static inline struct vec3 transform_point(const struct transform *a, struct vec3 p)
{
    return (struct vec3){a->m[0][0] * p.x + a->m[0][1] * p.y + a->m[0][2] * p.z + a->m[0][3],
                         a->m[1][0] * p.x + a->m[1][1] * p.y + a->m[1][2] * p.z + a->m[1][3],
                         a->m[2][0] * p.x + a->m[2][1] * p.y + a->m[2][2] * p.z + a->m[2][3]};
}
/* Points of 3 floats each, computed in double; out may be in. */
void transform_points(const struct transform_d *a, const float32 *in, size_t count, float32 *out);
static inline struct vec3 transform_vector(const struct transform *a, struct vec3 v)
{
    return (struct vec3){a->m[0][0] * v.x + a->m[0][1] * v.y + a->m[0][2] * v.z,
                         a->m[1][0] * v.x + a->m[1][1] * v.y + a->m[1][2] * v.z,
                         a->m[2][0] * v.x + a->m[2][1] * v.y + a->m[2][2] * v.z};
}
/* A normal, given the INVERSE of the transform (multiplies by the transpose); not unit. */
static inline struct vec3 transform_normal(const struct transform *inverse, struct vec3 n)
{
    return (struct vec3){inverse->m[0][0] * n.x + inverse->m[1][0] * n.y + inverse->m[2][0] * n.z,
                         inverse->m[0][1] * n.x + inverse->m[1][1] * n.y + inverse->m[2][1] * n.z,
                         inverse->m[0][2] * n.x + inverse->m[1][2] * n.y + inverse->m[2][2] * n.z};
}
