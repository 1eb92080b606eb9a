/* path: the radiance that arrives along one camera ray.
 *
 * Unidirectional path tracing with next-event estimation and multiple importance sampling
 * (power heuristic, written so that it neither over- nor underflows) and Russian roulette.
 */
#ifndef AZULEJO_RENDER_PATH_H
#define AZULEJO_RENDER_PATH_H

#include "worker/render/accel.h"
#include "worker/render/render.h"
#include "worker/render/sampler.h"

/* Linear RGB radiance; may be non-finite only through a fault, which the caller counts. */
struct vec3 path_radiance(const struct render_scene *scene, const struct sampler *sampler,
                          struct ray ray, struct render_stats *stats);

/* The accel's question: does a hit on this triangle count (culling, alpha)? */
int path_accept(const void *scene, const void *query, uint32_t instance, uint32_t triangle,
                float u, float v, int facing);

#endif
