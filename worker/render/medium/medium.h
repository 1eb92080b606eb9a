/* medium: what light meets between surfaces: absorption, scattering and emission.
 *
 * Homogeneous media are sampled in closed form: the free path of one colour channel, weighted for
 * the others by the balance heuristic. Grids use delta tracking against a majorant per block of
 * cells, and ratio tracking for transmittance (Novak et al. 2014; Miller et al. 2019 for the colour
 * weights). No weight of medium_sample exceeds 3, or 1 without colour. All results are finite and
 * >= 0. Immutable after medium_new (medium_build.c; medium.c is what paths call).
 */
#pragma once

#include "common/math/vec.h"
#include "common/scene/scene.h"
#include "worker/render/accel/accel.h"
#include "worker/render/base/sampler.h"

struct render_medium; /* its fields are in medium_data.h, private to medium.c */

/* Random numbers for one segment of a path: as many as needed, a pure function of the sampler and
 * `key`, which the path increments for every segment. */
struct medium_random {
    const struct sampler *sampler;
    uint32_t key, drawn;
};

struct medium_event {
    int scattered;       /* 1: at `distance`; 0: the ray reached t_max */
    real distance;       /* metres */
    struct vec3 weight;  /* throughput of the segment: transmittance (times the scattering
                               coefficient) over the density of this event */
    struct vec3 emitted; /* radiance that the segment adds, before `weight`: all of it up to
                               t_max, wherever the event is */
};

/* `grid` is the blob of a medium with a grid (its length already checked), else NULL. It is used in
 * place and must outlive the medium. Grid values that are negative or not finite count as 0. The
 * density is trilinear between cell centres; within half a cell of the box's sides it is that of
 * the outermost cells, so that equal cells fill the box evenly. ERR_NO_MEMORY. */
status medium_new(struct render_medium **out, const struct scene_medium *medium, const uint8_t *grid,
                  struct error *err) MUST_CHECK;
void medium_free(struct render_medium *medium);
size_t medium_bytes(const struct render_medium *medium); /* without the grid's blob */
int medium_scatters(const struct render_medium *medium);
int medium_has_grid(const struct render_medium *medium);

/* Where along the ray, up to ray->t_max (may be INFINITY), the light last scattered. `first` in
 * [0,1) is the sequence's number for the first free path. */
void medium_sample(const struct render_medium *medium, const struct ray *ray, real first, struct medium_random *random,
                   struct medium_event *out);

/* Transmittance from the origin to ray->t_max; in grids an unbiased estimate. */
struct vec3 medium_transmittance(const struct render_medium *medium, const struct ray *ray,
                                 struct medium_random *random);

/* Henyey-Greenstein. The value (= density, 1/sr) for the cosine between the directions of flight
 * before and after; and a direction of flight after the event, for (u, v) in [0,1). */
real medium_phase(const struct render_medium *medium, real cosine);
struct vec3 medium_phase_sample(const struct render_medium *medium, struct vec3 direction, real u, real v);
