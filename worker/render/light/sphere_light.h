/* sphere_light: an emissive sphere (world_sphere.h), sampled by the directions in which it is seen:
 * uniformly in the cone around it (Shirley, Wang and Zimmerman 1996, "Monte Carlo Techniques for
 * Direct Lighting Calculations", section 3.2.2), from inside uniformly over its surface.
 */
#ifndef AZULEJO_RENDER_SPHERE_LIGHT_H
#define AZULEJO_RENDER_SPHERE_LIGHT_H

#include "worker/render/light/triangle_light.h"

/* The density of sphere_light_sample per solid angle for a direction in which the sphere is met;
 * 0: it sends nothing to the place. The distance and the cosine at the light count inside. */
float sphere_light_pdf(const struct render_scene *scene, const struct triangle_light *light,
                       const struct light_context *context, float distance_squared, float cosine);

#endif
