/* portals: windows through which the environment shines in, as targets for sampling.
 *
 * A direction is uniform in solid angle within all portals together, whichever way they face. One
 * that crosses two of them counts twice, both in the choice and in the density. A portal that lies
 * wholly below the horizon of the light sampling context is left out.
 */
#ifndef AZULEJO_RENDER_PORTALS_H
#define AZULEJO_RENDER_PORTALS_H

#include <stdint.h>

#include "common/base/status.h"
#include "common/math/vec.h"
#include "common/scene/scene.h"
#include "worker/render/light/light.h"

struct portals {
    uint32_t count;
    struct vec3 (*corners)[4]; /* [count], in order round the parallelogram */
};

status portals_init(struct portals *p, const struct scene_portal *portals, uint32_t count,
                    struct error *err) MUST_CHECK;
void portals_release(struct portals *p);

/* Is any visible? */
int portals_visible(const struct portals *portals, const struct light_context *context);
/* A direction through one of them. 0: none is visible. */
int portals_sample(const struct portals *portals, const struct light_context *context, real u,
                   real v, struct vec3 *direction);
/* Solid-angle density of portals_sample; negative: none is visible. */
real portals_pdf(const struct portals *portals, const struct light_context *context,
                  struct vec3 direction);

#endif
