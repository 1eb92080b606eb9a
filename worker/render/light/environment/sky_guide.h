/* sky_guide: which parts of the environment arrive where.
 *
 * In a room most shadow rays towards the environment end at a wall. The guide divides the scene into regions
 * (light/learned/regions.h) and the map into cells, and has a distribution over the cells for each region: their light,
 * times the cosine, times what of it arrives at points of the region that a pilot found. Within a cell directions follow
 * the map's luminance. Every density is known, so whatever the guide believes, pictures stay unbiased; light that it does
 * not expect keeps a tenth of its choices, a sun half.
 *
 * A region whose distribution would not lower the second moment of the direct light clearly has none: there the map
 * alone is sampled. So open scenes cost a look-up, and a scene without any such region has no guide.
 *
 * It depends on the scene, the camera, the size of the whole picture and the settings of light, and not on seed, samples
 * or region: every worker makes the same one.
 * After learned light choice (Vevoda et al. 2018) and adaptive dome lights.
 */
#pragma once

#include "worker/render/light/environment/density.h"
#include "worker/render/light/environment/environment.h"
#include "worker/render/light/light.h"
#include "worker/render/light/learned/regions.h"

enum { SKY_COLUMNS = 32, SKY_ROWS = 16, SKY_CELLS = SKY_COLUMNS * SKY_ROWS };

struct environment_light;

struct sky_region {
    struct distribution cells; /* SKY_ROWS x SKY_COLUMNS */
    real window_share;         /* of the choices: one of the map's windows */
    real *window_start;        /* [windows + 1] 0 to 1 */
};

struct sky_guide {
    struct regions at;          /* none: there is no guide */
    struct sky_region *regions; /* [at.count] */
    struct density *cells;      /* [SKY_CELLS] by luminance, without the windows; cells.total 0: black */
};

/* What the pilot found. arrives(): what of the light from `direction` (unit, above the point's surface) reaches the
 * point, 0..1; called by several threads. */
struct sky_pilot {
    const struct pilot_point *points;
    uint32_t count;
    real (*arrives)(void *user, uint32_t point, struct vec3 direction);
    void *user;
    unsigned threads;
    real odds; /* of choosing the environment among the lights */
};

/* Make light->guide. `light` is complete but for it. ERR_NO_MEMORY. */
status sky_guide_init(struct sky_guide *g, const struct environment_light *light, const struct sky_pilot *pilot,
                      struct error *err) MUST_CHECK;
void sky_guide_release(struct sky_guide *g);

/* Where the context is; NULL: the map alone is sampled there. */
static inline const struct sky_region *sky_guide_region(const struct sky_guide *g, const struct light_context *context)
{
    const uint32_t region = g->at.count ? regions_find(&g->at, context->p, context->n) : REGION_NOWHERE;

    return region == REGION_NOWHERE ? NULL : &g->regions[region];
}

/* u, v in [0, 1). 0: no sample. *pdf: per solid angle. */
int sky_guide_aim(const struct sky_guide *g, const struct environment *env, const struct sky_region *region, real u,
                  real v, struct vec3 *direction, real *pdf);
real sky_guide_pdf(const struct sky_guide *g, const struct environment *env, const struct sky_region *region,
                   struct vec3 direction);
/* The density, and the radiance from that direction: they share the trigonometry. */
struct vec3 sky_guide_radiance(const struct sky_guide *g, const struct environment *env,
                               const struct sky_region *region, struct vec3 direction, real *pdf);
