/* medium: what light meets between surfaces: absorption, scattering and emission.
 *
 * Homogeneous media are sampled in closed form, one colour channel's free path at a time with
 * the others' weights by the balance heuristic; grids by delta tracking against a majorant per
 * block of cells, transmittance by ratio tracking (Novak et al. 2014; Miller et al. 2019 for
 * the colour weights): no weight of medium_sample exceeds 3, or 1 without colour. All results are
 * finite and >= 0. Immutable after medium_new (medium_build.c; medium.c is what paths call).
 */
#ifndef AZULEJO_RENDER_MEDIUM_H
#define AZULEJO_RENDER_MEDIUM_H

#include "common/math/vec.h"
#include "common/scene/scene.h"
#include "worker/render/accel/accel.h"
#include "worker/render/base/sampler.h"

struct world_medium; /* its fields are in medium_data.h, medium.c's own business */

/* Random numbers for one stretch of a path: any number of them, a pure function of the sampler
 * and `key`, which the path raises for every stretch. */
struct medium_random {
    const struct sampler *sampler;
    uint32_t key, drawn;
};

struct medium_event {
    int scattered;          /* 1: at `distance`; 0: the ray reached t_max */
    float distance;         /* metres */
    struct vec3 weight;     /* throughput of the stretch: transmittance (times the scattering
                               coefficient) over the density of this event */
    struct vec3 emitted;    /* radiance that the stretch adds, before `weight`: all of it up to
                               t_max, wherever the event is */
};

/* `grid` is the blob of a medium with one (its length already checked), else NULL; it is used in
 * place and must outlive the medium. Grid values that are negative or not finite count as 0.
 * Between cell centres the density is trilinear; within half a cell of the box's sides it is that
 * of the outermost cells, so that equal cells fill the box evenly. ERR_NO_MEMORY. */
status medium_new(struct world_medium **out, const struct scene_medium *medium,
                  const uint8_t *grid, struct error *err) MUST_CHECK;
void medium_free(struct world_medium *medium);
size_t medium_bytes(const struct world_medium *medium); /* without the grid's own */
int medium_scatters(const struct world_medium *medium);

/* Where along the ray, up to ray->t_max (may be INFINITY), the light last scattered. `first`
 * in [0,1) is the sequence's number for the first free path. */
void medium_sample(const struct world_medium *medium, const struct ray *ray, float first,
                   struct medium_random *random, struct medium_event *out);

/* The part of light that gets from the origin to ray->t_max, an unbiased estimate in grids. */
struct vec3 medium_transmittance(const struct world_medium *medium, const struct ray *ray,
                                 struct medium_random *random);

/* Henyey-Greenstein: value (= density, 1/sr) for the cosine between the directions of flight
 * before and after; and a direction of flight after, for (u, v) in [0,1). */
float medium_phase(const struct world_medium *medium, float cosine);
struct vec3 medium_phase_sample(const struct world_medium *medium, struct vec3 direction, float u,
                                float v);

#endif
