/* triangle_light: a triangle of an emissive mesh, sampled uniformly by area.
 *
 * triangle_light.c samples at a path's vertex; triangle_light_find.c finds the triangles and weighs
 * them before the rendering.
 */
#ifndef AZULEJO_RENDER_TRIANGLE_LIGHT_H
#define AZULEJO_RENDER_TRIANGLE_LIGHT_H

#include "worker/render/light/light.h"

/* Of a sphere (sphere_light.c) all of it is one light, and the triangle 0. */
struct triangle_light {
    uint32_t instance, triangle;
};

/* The odds times the density of triangle_light_sample per solid angle, for a point at that
 * distance. `cosine`: absolute cosine at the light; `area`: the triangle's, m^2. */
static inline float triangle_light_pdf(float odds, float distance_squared, float cosine,
                                       float area)
{
    float denominator = cosine * area;

    return denominator > 0 ? odds * distance_squared / denominator : 0;
}

/* Numbers the emissive instances' triangles by light_base; how many there are. */
uint64_t triangle_lights_count(struct render_scene *scene);
/* lights[count]; the bits of `dark`, zeroed, of those whose emissive texture is black all over.
 * ERR_NO_MEMORY. */
status triangle_lights_find(const struct render_scene *scene, struct triangle_light *lights,
                            uint8_t *dark, struct error *err) MUST_CHECK;

/* The length of a triangle's normal: its square is below what a float holds where the edges are below
 * 1e-10 m. */
static inline float triangle_double_area(struct vec3 normal)
{
    float squared = vec3_length_squared(normal), most, power;

    if (squared > 1e-30f && squared < 1e30f)
        return sqrtf(squared);
    most = float_max(fabsf(normal.x), float_max(fabsf(normal.y), fabsf(normal.z)));
    if (!(most > 0 && most < INFINITY))
        return most;
    power = float_power_below(most);
    return power * vec3_length(vec3_scale(normal, 1 / power));
}

#endif
