/* triangle_light: a triangle of an emissive mesh, sampled uniformly by area.
 *
 * triangle_light.c samples at a path's vertex; triangle_light_find.c finds and weighs the triangles
 * before rendering.
 */
#ifndef AZULEJO_RENDER_TRIANGLE_LIGHT_H
#define AZULEJO_RENDER_TRIANGLE_LIGHT_H

#include "worker/render/light/light.h"

/* A sphere (sphere_light.c) is a single light, with triangle 0. */
struct triangle_light {
    uint32_t instance, triangle;
};

/* The odds times the solid-angle density of triangle_light_sample, for a point at that distance.
 * `cosine`: absolute cosine at the light; `area`: the triangle's, m^2. */
static inline float triangle_light_pdf(float odds, float distance_squared, float cosine,
                                       float area)
{
    float denominator = cosine * area;

    return denominator > 0 ? odds * distance_squared / denominator : 0;
}

/* Number the emissive instances' triangles by light_base; returns how many there are. */
uint64_t triangle_lights_count(struct render_scene *scene);
/* Fill lights[count]; set the bits of `dark` (zeroed) for those whose emissive texture is all
 * black. ERR_NO_MEMORY. */
status triangle_lights_find(const struct render_scene *scene, struct triangle_light *lights,
                            uint8_t *dark, struct error *err) MUST_CHECK;

#endif
