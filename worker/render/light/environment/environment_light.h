/* environment_light: the environment as a light. Where the guide knows what arrives, it is sampled by that; else by its
 * map, and where portals can be seen, half of the samples go through the portals, and the density is that of the mixture.
 */
#pragma once

#include "worker/render/light/environment/environment.h"
#include "worker/render/light/environment/portals.h"
#include "worker/render/light/environment/sky_guide.h"

struct environment_light {
    const struct environment *map;
    struct portals portals;
    struct sky_guide guide;
    int alone; /* only light sampling finds it: no MIS */
};

/* Radiance that arrives from a direction, and the solid-angle density with which
 * environment_light_sample picks it: the two share work. */
struct vec3 environment_light_radiance(const struct environment_light *light, const struct light_context *context,
                                       struct vec3 direction, real *pdf);
