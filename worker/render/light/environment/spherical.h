/* spherical: a triangle as seen from a point, and directions uniform within it.
 *
 * Arvo 1995, "Stratified Sampling of Spherical Triangles", in a form without cancellation, so that it works for
 * triangles as small as numbers allow: the sub-triangle of a given area is found from tan(E/2) = tan(a/2) tan(b/2) sin
 * C / (1 + tan(a/2) tan(b/2) cos C), E being the spherical excess over two sides and the angle between them. In double;
 * the only elementary functions are one arc tangent for the area and one sine and cosine per sample.
 */
#pragma once

#include <math.h>

#include "common/base/safeguard.h"
#include "common/math/elementary.h"
#include "common/math/vec.h"

struct dvec3 {
    double x, y, z;
};

struct spherical_triangle {
    struct dvec3 a, b, c; /* from the point to the corners, metres */
    double la, lb, lc;    /* their lengths */
    real solid_angle;     /* 0: seen edge-on, or the point is a corner */
};

static inline struct dvec3 dvec3_between(struct vec3 from, struct vec3 to)
{
    return (struct dvec3){(double)to.x - (double)from.x, (double)to.y - (double)from.y, (double)to.z - (double)from.z};
}
static inline double dvec3_dot(struct dvec3 a, struct dvec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
static inline struct dvec3 dvec3_sub(struct dvec3 a, struct dvec3 b)
{
    return (struct dvec3){a.x - b.x, a.y - b.y, a.z - b.z};
}
static inline struct dvec3 dvec3_cross(struct dvec3 a, struct dvec3 b)
{
    return (struct dvec3){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
static inline struct dvec3 dvec3_scale(struct dvec3 a, double s) { return (struct dvec3){a.x * s, a.y * s, a.z * s}; }
/* a + b * s */
static inline struct dvec3 dvec3_mad(struct dvec3 a, struct dvec3 b, double s)
{
    return (struct dvec3){a.x + b.x * s, a.y + b.y * s, a.z + b.z * s};
}

static inline struct vec3 dvec3_rounded(struct dvec3 a, double length)
{
    return vec3_make((real)(a.x / length), (real)(a.y / length), (real)(a.z / length));
}

/* Van Oosterom and Strackee 1983, by the edges: the triple product of three nearly parallel unit vectors
 * would cancel. */
static inline real spherical_triangle_area(const struct spherical_triangle *t)
{
    double volume, rest;

    if (!SAFEGUARD(PORTAL_SOLID_ANGLE)) {
        struct vec3 a = dvec3_rounded(t->a, t->la), b = dvec3_rounded(t->b, t->lb);
        struct vec3 c = dvec3_rounded(t->c, t->lc);

        return 2 * real_atan2(real_abs(vec3_dot(a, vec3_cross(b, c))),
                              1 + vec3_dot(a, b) + vec3_dot(b, c) + vec3_dot(c, a));
    }
    volume = fabs(dvec3_dot(t->a, dvec3_cross(dvec3_sub(t->b, t->a), dvec3_sub(t->c, t->a))));
    rest = t->la * t->lb * t->lc + dvec3_dot(t->a, t->b) * t->lc + dvec3_dot(t->b, t->c) * t->la +
           dvec3_dot(t->c, t->a) * t->lb;
    return volume > 0 && isfinite(volume) && isfinite(rest) ? 2 * real_atan2((real)volume, (real)rest) : 0;
}

static inline void spherical_triangle_init(struct spherical_triangle *t, struct vec3 p, struct vec3 a, struct vec3 b,
                                           struct vec3 c)
{
    t->a = dvec3_between(p, a);
    t->b = dvec3_between(p, b);
    t->c = dvec3_between(p, c);
    t->la = sqrt(dvec3_dot(t->a, t->a));
    t->lb = sqrt(dvec3_dot(t->b, t->b));
    t->lc = sqrt(dvec3_dot(t->c, t->c));
    t->solid_angle = spherical_triangle_area(t);
}

/* A direction (unit) uniform in solid angle, density 1 / solid_angle. u, v in [0, 1). The map of
 * the square is continuous. 0: the triangle is too thin for double. */
static inline int spherical_triangle_sample(const struct spherical_triangle *t, real u, real v, struct vec3 *direction)
{
    struct dvec3 a = dvec3_scale(t->a, 1 / t->la), b = dvec3_scale(t->b, 1 / t->lb), c = dvec3_scale(t->c, 1 / t->lc),
                 to_c, to_b, normal, point, along;
    double scale, sin_alpha, cos_alpha, chord, sum, top, bottom, rise, x, length;
    real sine, cosine;

    /* The angle at a, between the planes (a, b) and (a, c): that of the tangents there. */
    to_b = dvec3_sub(b, a);
    to_c = dvec3_sub(c, a);
    chord = dvec3_dot(to_b, to_b); /* 2 (1 - cos ab) */
    sum = 4 - chord;               /* |a + b|^2 */
    to_b = dvec3_mad(to_b, a, 0.5 * chord);
    to_c = dvec3_mad(to_c, a, 0.5 * dvec3_dot(to_c, to_c));
    normal = dvec3_cross(to_b, to_c);
    scale = sqrt(dvec3_dot(to_b, to_b) * dvec3_dot(to_c, to_c));
    if (!(scale > 0) || !(chord > 0) || !(sum > 0))
        return 0;
    sin_alpha = sqrt(dvec3_dot(normal, normal)) / scale;
    cos_alpha = dvec3_dot(to_b, to_c) / scale;

    /* tan of half the arc from a to the sub-triangle's corner is top / bottom. */
    real_sincos(0.5f * u * t->solid_angle, &sine, &cosine);
    top = (double)sine;
    bottom = sqrt(chord / sum) * ((double)cosine * sin_alpha - (double)sine * cos_alpha);
    rise = top * top + bottom * bottom;
    if (!(rise > 0))
        return 0;
    length = sqrt(dvec3_dot(to_c, to_c));
    point = dvec3_mad(dvec3_scale(a, (bottom - top) * (bottom + top) / rise), to_c, 2 * top * bottom / (rise * length));

    /* Between b and that corner, uniform in the cosine of the arc from b. */
    along = dvec3_sub(point, b);
    x = 0.5 * dvec3_dot(along, along); /* 1 - cos */
    along = dvec3_mad(along, b, x);
    length = sqrt(dvec3_dot(along, along));
    x *= (double)v;
    point = dvec3_mad(dvec3_scale(b, 1 - x), along, length > 0 ? sqrt(x * (2 - x)) / length : 0);
    *direction = vec3_normalize(vec3_make((real)point.x, (real)point.y, (real)point.z));
    return !vec3_is_black(*direction);
}
