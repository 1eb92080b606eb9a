/* Spheres: Embree finds their boxes; double decides whether they are met. */
#include <math.h>

#include "worker/render/accel/accel_parts.h"
#include "worker/render/base/sphere.h"

static void sphere_bounds(const struct RTCBoundsFunctionArguments *args)
{
    const struct accel_geometry *g = args->geometryUserPtr;
    const double reach = g->sphere->radius + g->sphere->margin;
    float low[3], high[3];

    for (int k = 0; k < 3; k++) {
        low[k] = nextafterf((float)(g->sphere->centre[k] - reach), -INFINITY);
        high[k] = nextafterf((float)(g->sphere->centre[k] + reach), INFINITY);
    }
    *args->bounds_o = (struct RTCBounds){.lower_x = low[0], .lower_y = low[1], .lower_z = low[2],
                                         .upper_x = high[0], .upper_y = high[1],
                                         .upper_z = high[2]};
}

static int is_left(const struct query_context *q, const struct accel_sphere *sphere)
{
    for (uint32_t i = 0; i < q->ray->left_count; i++) {
        const struct accel_sphere *left = q->accel->geometries[q->ray->left[i].instance].sphere;
        if (left && sphere_same(left, sphere))
            return 1;
    }
    return 0;
}

/* Does the intersection at `t` metres count? `inside`: the ray comes from inside. The sphere on
 * which the ray ends does not count: its end was computed in the same way. */
static int counts(struct query_context *q, const struct accel_geometry *g, double t, int inside)
{
    const struct hit face = {(uint32_t)(g - q->accel->geometries), (uint32_t)inside};
    const int facing = inside == g->sphere->inward;

    if (!(t >= 0 && t < accel_ray_end(q)) ||
        (g->filtered && !q->accel->accept(q->accel->scene, q->query, face.instance, 0, 0, 0, facing)))
        return 0;
    if (q->kind != QUERY_OCCLUDED)
        accel_keep(q, &face, t, facing);
    return 1;
}

/* A ray that leaves the sphere outwards never meets it again; one that goes inwards meets its far
 * side. Both hold whatever the rounding. */
static int meets_left(struct query_context *q, const struct accel_geometry *g,
                      const struct sphere_chord *chord, double *t)
{
    double normal[3], off[3];

    exact_sub(q->origin, g->sphere->centre, normal);
    exact_vec(q->ray->off, off);
    *t = fmax(chord->middle + chord->half, 0);
    return exact_dot(off, normal) < 0 && counts(q, g, *t, 1);
}

/* Is it met? If so, at *t metres. */
static int meets(struct query_context *q, const struct accel_geometry *g, double *t)
{
    struct sphere_chord chord;

    if (q->kind == QUERY_COINCIDENT)
        return 0;
    sphere_chord_find(g->sphere, q->origin, q->direction, &chord);
    if (is_left(q, g->sphere))
        return meets_left(q, g, &chord, t);
    if (!chord.meets)
        return 0;
    *t = chord.middle - chord.half;
    if (counts(q, g, *t, 0))
        return 1;
    *t = chord.middle + chord.half;
    return counts(q, g, *t, 1);
}

static void sphere_intersect(const struct RTCIntersectFunctionNArguments *args)
{
    struct query_context *q = (struct query_context *)args->context;
    struct RTCRay *ray = &((struct RTCRayHit *)args->rayhit)->ray;
    double t;

    /* Embree need not search behind it. */
    if (args->valid[0] == -1 && meets(q, args->geometryUserPtr, &t))
        ray->tfar = fminf(ray->tfar, (float)((t + q->back) * (1 + ACCEL_END_SHARE) + 2 * q->error));
}

static void sphere_occluded(const struct RTCOccludedFunctionNArguments *args)
{
    double t;

    if (args->valid[0] == -1 &&
        meets((struct query_context *)args->context, args->geometryUserPtr, &t))
        ((struct RTCRay *)args->ray)->tfar = -INFINITY;
}

RTCGeometry accel_sphere_geometry(RTCDevice device, struct accel_geometry *g)
{
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_USER);

    if (!geometry)
        return NULL;
    rtcSetGeometryUserPrimitiveCount(geometry, 1);
    rtcSetGeometryUserData(geometry, g);
    rtcSetGeometryBoundsFunction(geometry, sphere_bounds, NULL);
    rtcSetGeometryIntersectFunction(geometry, sphere_intersect);
    rtcSetGeometryOccludedFunction(geometry, sphere_occluded);
    rtcCommitGeometry(geometry);
    return geometry;
}
