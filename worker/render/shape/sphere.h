/* sphere: a whole sphere, and a line that meets it, in double precision. Private to worker/render. Side 0 is outside.
 *
 * The point of the line nearest to the centre decides whether and where the line meets the sphere (Haines, Gunther and
 * Akenine-Moeller 2019, "Precision Improvements for Ray/Sphere Intersection", Ray Tracing Gems, chapter 7): the
 * discriminant of the textbook's quadratic would cancel for a small sphere far away. The error is about 2^-50 of the
 * distance and the radius.
 */
#pragma once

#include "common/base/safeguard.h"
#include "worker/render/base/exact.h"
#include "worker/render/shape/shape.h"

struct sphere_shape {
    struct shape shape;
    double centre[3], radius; /* metres, world */
};

static inline const struct sphere_shape *sphere_of(const struct shape *shape)
{
    return (const struct sphere_shape *)shape;
}

struct sphere_chord {
    double foot[3];      /* from the centre to the line's nearest point, metres */
    double middle, half; /* that point's position on the line, and half the chord: both in
                            lengths of the direction */
    int meets;           /* 0: the line misses the sphere; half is then 0 */
};

/* The square of half the chord, in metres: by the nearest point. Without the safeguard: by the
 * textbook's discriminant, in float. */
static inline double sphere_inside(const struct sphere_shape *sphere, const double foot[3], const double to_origin[3],
                                   const double direction[3])
{
    real b, c;

    if (SAFEGUARD(SPHERE_NEAREST_POINT))
        return sphere->radius * sphere->radius - exact_dot(foot, foot);
    b = (real)exact_dot(to_origin, direction);
    c = (real)exact_dot(to_origin, to_origin) - (real)(sphere->radius * sphere->radius);
    return (double)(b * b - c);
}

static inline void sphere_chord_find(const struct sphere_shape *sphere, const double origin[3],
                                     const double direction[3], struct sphere_chord *out)
{
    double to_origin[3], length2 = exact_dot(direction, direction), inside;

    exact_sub(origin, sphere->centre, to_origin);
    out->middle = -exact_dot(to_origin, direction) / length2;
    for (int k = 0; k < 3; k++)
        out->foot[k] = to_origin[k] + out->middle * direction[k];
    inside = sphere_inside(sphere, out->foot, to_origin, direction);
    out->meets = inside >= 0;
    out->half = out->meets ? sqrt(inside / length2) : 0;
}
