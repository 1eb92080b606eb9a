/* path: the radiance that arrives along one camera ray.
 *
 * Unidirectional path tracing with next-event estimation, multiple importance sampling (power heuristic, in a form that
 * neither overflows nor underflows) and Russian roulette, on surfaces and in media. Overlapping volumes are resolved by
 * priority (Schmidt & Budge 2002). Compiled once for each kernel (gate.h).
 */
#pragma once

#include "worker/render/accel/accel.h"
#include "worker/render/camera/camera.h"
#include "worker/render/render.h"
#include "worker/render/base/sampler.h"

/* What the camera ray met, for the AOVs. */
struct path_record {
    int hit;                              /* 0: nothing; the other fields but `passed` are then 0 */
    real distance;                        /* metres along the ray */
    struct vec3 position, normal, albedo; /* world space; the shading normal faces the camera */
    real u, v;                            /* first uv set */
    uint32_t instance, material, triangle;
    real b1, b2; /* barycentric coordinates on the triangle */
    /* The features of a denoiser, if the job has any of them: of the first hit that is not of a smooth surface alone.
     * Filled as the path goes: `weight` and `length` are of the way up to there. */
    int is_rough; /* it was found; the next three are then complete */
    struct vec3 rough_albedo, rough_normal;
    struct vec3 emission; /* radiance that was met on the way, this hit included */
    struct vec3 weight;   /* what the smooth surfaces reflect or let through */
    real length;          /* metres */
    real passed;          /* share of the light from behind everything that the camera's ray lets
                                  through: mean of RGB; 0 where it meets or is scattered by something */
};

/* Linear RGB radiance. It is not finite only if there is a fault, which the caller counts. `record` may be NULL. */
struct vec3 path_radiance(const struct render_scene *scene, const struct sampler *sampler, const struct ray *ray,
                          struct camera_cone cone, struct path_record *record, struct render_stats *stats);

/* accel's accept callback: does a hit on this triangle count (culling, alpha)? */
int path_accept(const void *scene, const void *query, uint32_t instance, uint32_t triangle, real u, real v, int facing);

/* What path_accept needs to know about the ray. */
struct path_query {
    const struct sampler *sampler;
    uint32_t ray_number; /* within the path: part of the key of stochastic alpha */
};
