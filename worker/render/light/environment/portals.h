/* portals: windows through which the environment shines in, as targets for sampling.
 *
 * A direction is uniform in solid angle within all portals together, whichever way they face. One
 * that crosses two of them counts twice, both in the choice and in the density. A portal that lies
 * wholly below the horizon of the light sampling context is left out.
 */
#pragma once

#include <stdint.h>

#include "common/base/status.h"
#include "common/math/vec.h"
#include "common/scene/scene.h"
#include "worker/render/light/light.h"
#include "worker/render/light/environment/spherical.h"

struct portals {
    uint32_t count;
    struct vec3 (*corners)[4]; /* [count], in order round the parallelogram */
};

status portals_init(struct portals *p, const struct scene_portal *portals, uint32_t count,
                    struct error *err) MUST_CHECK;
void portals_release(struct portals *p);

/* All of them from a light sampling context. */
struct portals_view {
    real solid_angle;                  /* sr, of those above the horizon; 0: none is visible */
    uint32_t last;                     /* the last one of these */
    struct spherical_triangle half[2]; /* of the last one */
};

void portals_look(const struct portals *portals, const struct light_context *context, struct portals_view *out);
/* A direction through one of them, of density portals_crossed() / solid_angle. 0: the portal is too thin for double. */
int portals_sample(const struct portals *portals, const struct light_context *context, const struct portals_view *view,
                   real u, real v, struct vec3 *direction);
/* How many of those above the horizon the direction crosses. */
real portals_crossed(const struct portals *portals, const struct light_context *context, struct vec3 direction);
