/* null_collisions: free paths and transmittance in a grid, by null collisions (Woodcock et al. 1965).
 *
 * The grid is filled up to its block's majorant with matter that does nothing. Free paths in that are drawn in closed
 * form; where one ends, the collision is real with the probability density / majorant, and null otherwise: the light
 * flies on as it came. Delta tracking decides so at random (a path's own ray); ratio tracking multiplies by the
 * probability of the null collision (shadow rays, and media that only absorb). Private to medium.c.
 */
#pragma once

#include "worker/render/medium/medium_data.h"

/* `first`: sampler_hash_first of the segment's key. */
static inline real medium_next(struct medium_random *random, uint32_t first)
{
    return sampler_hash_second(first, random->drawn++);
}

/* Optical depth of the next collision, -log(1 - u): exponentially distributed, for u in [0,1). In float, for walks ask
 * for it at every step: 2 artanh((m - 1) / (m + 1)), whose argument is below 0.172. Good to 3e-7 of itself
 * (tests/unit/render/test_medium.c). */
static inline real medium_depth_of(real u)
{
#ifdef AZULEJO_DOUBLE
    return -real_log(1 - u);
#else
    const uint32_t root_half = 0x3f3504f3u, offset = float_bits(1.0f - u) - root_half;
    const real f = float_from_bits((offset & 0x7fffffu) + root_half) - 1.0f; /* m - 1, sqrt(1/2) <= m < sqrt(2) */
    const real s = f / (2.0f + f), z = s * s;
    const real series = z * (2.0f / 3 + z * (2.0f / 5 + z * (2.0f / 7 + z * (2.0f / 9))));

    return -((real)((int32_t)offset >> 23) * 0.69314718056f + (2 * s + s * series));
#endif
}

/* Choose one of the three channels with equal probability; *u becomes a new number in [0,1). */
static inline int medium_channel(real *u)
{
    real scaled = *u * 3.0f;
    int channel = scaled < 1.0f ? 0 : scaled < 2.0f ? 1 : 2;

    *u = real_min(scaled - (real)channel, REAL_BELOW_ONE);
    return channel;
}

static inline struct vec3 medium_vec(const real x[3]) { return (struct vec3){x[0], x[1], x[2]}; }

/* medium_sample in a grid that scatters. `u`: for the first free path. */
void null_collisions_sample(const struct render_medium *medium, const struct ray *ray, real u,
                            struct medium_random *random, struct medium_event *out);
/* Transmittance of a grid; unbiased. Adds what the segment emits unless `emitted` is NULL. */
struct vec3 null_collisions_transmittance(const struct render_medium *medium, const struct ray *ray, real u,
                                          struct medium_random *random, real *emitted);
