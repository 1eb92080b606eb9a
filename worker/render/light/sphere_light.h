/* sphere_light: an emissive sphere (world_sphere.h), sampled by the directions in which it is seen:
 * from outside uniformly in the cone around it (Shirley, Wang and Zimmerman 1996, "Monte Carlo
 * Techniques for Direct Lighting Calculations", section 3.2.2), from inside uniformly over its
 * surface.
 */
#ifndef AZULEJO_RENDER_SPHERE_LIGHT_H
#define AZULEJO_RENDER_SPHERE_LIGHT_H

#include "worker/render/light/triangle_light.h"

/* The solid-angle density of sphere_light_sample for a direction that meets the sphere; 0: it emits
 * nothing towards the point. Distance and cosine at the light count only inside. */
float sphere_light_pdf(const struct render_scene *scene, const struct triangle_light *light,
                       const struct light_context *context, float distance_squared, float cosine);

#endif
