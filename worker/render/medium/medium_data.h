/* medium_data: the fields of a medium, shared by medium_build.c (runs once) and by medium.c,
 * medium_walk.h and null_collisions.c (run for every segment of a path). Private to them and their tests. */
#pragma once

#include <string.h>

#include "common/base/safeguard.h"
#include "common/math/transform.h"
#include "worker/render/medium/medium.h"

enum {
    MEDIUM_BLOCK_SIDE = 8,         /* cells along a side of a block that shares one majorant */
    MEDIUM_STEPS_MAX = 1 << 16,    /* tentative collisions on one segment; then it is absorbed. Only
                                      a grid whose cells differ by many powers of ten gets there */
    MEDIUM_EMISSION_STEPS = 8,     /* tentative collisions across an emissive grid, at least */
};
/* Coefficients and densities are clamped to this, so that products of the two stay finite. */
#define MEDIUM_COEFFICIENT_MAX REAL(1e18)
#define MEDIUM_COEFFICIENT_MIN REAL(1e-20) /* smaller coefficients count as 0: no scene is that wide */
#define MEDIUM_RADIANCE_MAX REAL(1e30)
/* Beyond this |g| the cosine's last bit would decide the phase function's value. */
#define MEDIUM_G_MAX REAL(0.999)

struct render_medium {
    real absorption[3], scattering[3], extinction[3]; /* 1/metre, for density 1 */
    real emission[3];                                 /* radiance per metre, for density 1 */
    real extinction_max;
    real g;
    int scatters, emits;
    int chromatic; /* the extinction differs between the channels */

    /* Grids only; otherwise size[0] is 0. */
    uint32_t size[3], blocks[3];
    struct transform to_cells; /* world to cell numbers: cell i reaches from i to i + 1 */
    const uint8_t *cells;      /* the blob; not owned */
    real *block_max;           /* [z][y][x] largest density that interpolation reaches; owned */
    real glow_rate;            /* lower bound of the extinction used for tracking, if it emits */
    real glow[3];              /* emission / (the extinction used for tracking) */
};

/* The density of a cell. A file may hold any bits: what is no density counts as 0. */
static inline real medium_density_at(const uint8_t *cells, size_t index)
{
    float32 x;

    memcpy(&x, cells + index * sizeof x, sizeof x);
    /* Bits of floats from 0 on are in the floats' order. */
    if (!SAFEGUARD(GRID_CELL) || float_bits(x) <= float_bits((float32)MEDIUM_COEFFICIENT_MAX))
        return x;
    return x > 0.0f && x < INFINITY ? real_min(x, MEDIUM_COEFFICIENT_MAX) : 0.0f;
}
