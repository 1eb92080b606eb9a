#include "worker/render/accel/accel_parts.h"

#include <math.h>

void accel_huge_bounds(const struct RTCBoundsFunctionArguments *args)
{
    const struct accel *accel = args->geometryUserPtr;
    const struct hit *face = &accel->sizes.huge[args->primID];
    uint32_t steps = accel->geometries[face->instance].motion_steps;
    float32 low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};

    for (uint32_t i = 0; i < (steps ? steps : 1); i++) {
        double corner[3][3];

        accel->corners(accel->scene, face->instance, face->triangle, steps ? (real)i / (real)(steps - 1) : 0, corner);
        for (int k = 0; k < 3; k++)
            for (int a = 0; a < 3; a++) {
                low[a] = float_min(nextafterf((float32)corner[k][a], -INFINITY), low[a]);
                high[a] = float_max(nextafterf((float32)corner[k][a], INFINITY), high[a]);
            }
    }
    *args->bounds_o = (struct RTCBounds){.lower_x = low[0], .lower_y = low[1], .lower_z = low[2],
                                         .upper_x = high[0], .upper_y = high[1],
                                         .upper_z = high[2]};
}

/* Is it met? If so, at *t metres. */
static int huge_meets(struct query_context *q, const struct hit *face, double *t)
{
    double u, v;
    int facing;

    if (accel_is_excepted(q, face) || !accel_covers(q, face, &u, &v, &facing) || !accel_decide(q, face, t))
        return 0;
    if (q->accel->geometries[face->instance].filtered &&
        !q->accel->accept(q->accel->scene, q->query, face->instance, face->triangle, (real)u, (real)v, facing))
        return 0;
    if (q->kind != QUERY_OCCLUDED)
        accel_keep(q, face, *t, facing);
    return 1;
}

void accel_huge_intersect(const struct RTCIntersectFunctionNArguments *args)
{
    struct query_context *q = (struct query_context *)args->context;
    struct RTCRay *ray = &((struct RTCRayHit *)args->rayhit)->ray;
    double t;

    if (args->valid[0] != -1 || !huge_meets(q, &q->accel->sizes.huge[args->primID], &t) || q->kind == QUERY_COINCIDENT)
        return;
    /* Embree need not search behind it. */
    ray->tfar = float_min((float32)((t + q->back) * (1 + ACCEL_END_SHARE)), ray->tfar);
}

void accel_huge_occluded(const struct RTCOccludedFunctionNArguments *args)
{
    struct query_context *q = (struct query_context *)args->context;
    struct RTCRay *ray = (struct RTCRay *)args->ray;
    double t;

    if (args->valid[0] == -1 && huge_meets(q, &q->accel->sizes.huge[args->primID], &t))
        ray->tfar = -INFINITY;
}
