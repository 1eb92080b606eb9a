/* sphere: a line and a whole sphere in double precision. Private to worker/render.
 *
 * The point of the line nearest to the centre decides whether and where the line meets the sphere
 * (Haines, Gunther and Akenine-Moeller 2019, "Precision Improvements for Ray/Sphere Intersection",
 * Ray Tracing Gems, chapter 7): the discriminant of the textbook's quadratic would cancel for a
 * small sphere far away. The error is about 2^-50 of the distance and the radius.
 */
#ifndef AZULEJO_RENDER_SPHERE_H
#define AZULEJO_RENDER_SPHERE_H

#include "worker/render/base/exact.h"

struct sphere_chord {
    double foot[3];      /* from the centre to the line's nearest point, metres */
    double middle, half; /* that point's position on the line, and half the chord: both in
                            lengths of the direction */
    int meets;           /* 0: the line misses the sphere; half is then 0 */
};

static inline void sphere_chord_find(const struct accel_sphere *sphere, const double origin[3],
                                     const double direction[3], struct sphere_chord *out)
{
    double to_origin[3], length2 = exact_dot(direction, direction), inside;

    exact_sub(origin, sphere->centre, to_origin);
    out->middle = -exact_dot(to_origin, direction) / length2;
    for (int k = 0; k < 3; k++)
        out->foot[k] = to_origin[k] + out->middle * direction[k];
    inside = sphere->radius * sphere->radius - exact_dot(out->foot, out->foot);
    out->meets = inside >= 0;
    out->half = out->meets ? sqrt(inside / length2) : 0;
}

/* The intersection of line and sphere nearest to `t`; if the line misses, its point nearest to the
 * centre. */
static inline double sphere_nearest(const struct accel_sphere *sphere, const double origin[3],
                                    const double direction[3], double t)
{
    struct sphere_chord chord;

    sphere_chord_find(sphere, origin, direction, &chord);
    return t < chord.middle ? chord.middle - chord.half : chord.middle + chord.half;
}

static inline int sphere_same(const struct accel_sphere *a, const struct accel_sphere *b)
{
    return a == b || (a->radius == b->radius && a->centre[0] == b->centre[0] &&
                      a->centre[1] == b->centre[1] && a->centre[2] == b->centre[2]);
}

#endif
