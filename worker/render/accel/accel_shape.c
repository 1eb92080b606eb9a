/* Shapes: Embree finds their boxes, double decides whether they are met. */
#include <math.h>

#include "worker/render/accel/accel_parts.h"
#include "worker/render/base/exact.h"

static void shape_bounds(const struct RTCBoundsFunctionArguments *args)
{
    const struct accel_geometry *g = args->geometryUserPtr;
    double low[3], high[3];

    shape_rows[g->shape->kind].bounds(g->shape, (double)g->shape_margin, low, high);
    *args->bounds_o = (struct RTCBounds){.lower_x = nextafterf((float32)low[0], -INFINITY),
                                         .lower_y = nextafterf((float32)low[1], -INFINITY),
                                         .lower_z = nextafterf((float32)low[2], -INFINITY),
                                         .upper_x = nextafterf((float32)high[0], INFINITY),
                                         .upper_y = nextafterf((float32)high[1], INFINITY),
                                         .upper_z = nextafterf((float32)high[2], INFINITY)};
}

static int is_left(const struct query_context *q, const struct shape *shape)
{
    for (uint32_t i = 0; i < q->ray->left_count && SAFEGUARD(LEFT_SPHERE); i++) {
        const struct shape *left = q->accel->geometries[q->ray->left[i].instance].shape;
        if (left && shape_same(left, shape))
            return 1;
    }
    return 0;
}

/* Does the crossing count? A shape on which the ray ends does not: its end was computed alike. */
static int counts(struct query_context *q, const struct accel_geometry *g, const struct shape_crossing *at)
{
    const struct hit face = {(uint32_t)(g - q->accel->geometries), at->side};
    const int facing = at->side == g->shape->winding;

    if (!(at->t >= 0 && at->t < accel_ray_end(q)) ||
        (g->filtered && !q->accel->accept(q->accel->scene, q->query, face.instance, 0, 0, 0, facing)))
        return 0;
    if (q->kind != QUERY_OCCLUDED)
        accel_keep(q, &face, at->t, facing);
    return 1;
}

/* Met? Then *t in metres. */
static int meets(struct query_context *q, const struct accel_geometry *g, double *t)
{
    struct shape_crossing at[SHAPE_CROSSINGS_MAX];
    double off[3];
    int count;

    if (q->kind == QUERY_COINCIDENT)
        return 0;
    exact_vec(q->ray->off, off);
    count =
        shape_rows[g->shape->kind].crossings(g->shape, q->origin, q->direction, is_left(q, g->shape) ? off : NULL, at);
    for (int i = 0; i < count; i++) {
        *t = at[i].t;
        if (counts(q, g, &at[i]))
            return 1;
    }
    return 0;
}

/* What lies behind need not be looked at. */
static void intersect(struct query_context *q, const struct accel_geometry *g, struct RTCRay *ray)
{
    double t;

    if (meets(q, g, &t))
        ray->tfar = float_min((float32)((t + q->back) * (1 + ACCEL_END_SHARE) + 2 * q->error), ray->tfar);
}

static void shape_intersect(const struct RTCIntersectFunctionNArguments *args)
{
    if (args->valid[0] == -1)
        intersect((struct query_context *)args->context, args->geometryUserPtr,
                  &((struct RTCRayHit *)args->rayhit)->ray);
}

static void shape_occluded(const struct RTCOccludedFunctionNArguments *args)
{
    double t;

    if (args->valid[0] == -1 && meets((struct query_context *)args->context, args->geometryUserPtr, &t))
        ((struct RTCRay *)args->ray)->tfar = -INFINITY;
}

void accel_shapes_intersect(struct query_context *q, struct RTCRay *ray)
{
    for (uint32_t i = 0; i < q->accel->few_shapes.count; i++)
        intersect(q, &q->accel->geometries[q->accel->few_shapes.geometry[i]], ray);
}

int accel_shapes_occlude(struct query_context *q)
{
    double t;

    for (uint32_t i = 0; i < q->accel->few_shapes.count; i++)
        if (meets(q, &q->accel->geometries[q->accel->few_shapes.geometry[i]], &t))
            return 1;
    return 0;
}

RTCGeometry accel_shape_geometry(RTCDevice device, struct accel_geometry *g)
{
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_USER);

    if (!geometry)
        return NULL;
    rtcSetGeometryUserPrimitiveCount(geometry, 1);
    rtcSetGeometryUserData(geometry, g);
    rtcSetGeometryBoundsFunction(geometry, shape_bounds, NULL);
    rtcSetGeometryIntersectFunction(geometry, shape_intersect);
    rtcSetGeometryOccludedFunction(geometry, shape_occluded);
    rtcCommitGeometry(geometry);
    return geometry;
}
