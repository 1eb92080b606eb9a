/* environment_light: the environment as a light: sampled by its map, or where portals can be seen by
 * halves through those, whose one-sample mixture is the density.
 */
#ifndef AZULEJO_RENDER_ENVIRONMENT_LIGHT_H
#define AZULEJO_RENDER_ENVIRONMENT_LIGHT_H

#include "worker/render/light/environment.h"
#include "worker/render/light/portals.h"

struct environment_light {
    const struct environment *map;
    struct portals portals;
    int alone; /* only light sampling finds it: no MIS */
};

/* Radiance that arrives from a direction, and the solid-angle density of environment_light_sample for
 * it: they share the work. */
struct vec3 environment_light_radiance(const struct environment_light *light,
                                       const struct light_context *context,
                                       struct vec3 direction, float *pdf);

#endif
