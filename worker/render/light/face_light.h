/* face_light: the faces of emissive instances, each of them a light: a mesh's triangle, or all of
 * another shape, whose only face is 0.
 *
 * What a face of each shape does as a light is in triangle_light.c, sphere_light.c; `light` is there
 * the face's name, a struct hit.
 */
#pragma once

#include "worker/render/light/light.h"
#include "worker/render/shape/shape.h"

/* The row of LIGHT_KINDS for the faces of an instance with this shape: that of the same name. */
static inline int face_light_kind(const struct shape *shape)
{
    switch (shape_kind_of(shape)) {
#define SHAPE_LIGHT(KIND, ...) \
    case SHAPE_##KIND:         \
        return LIGHT_##KIND;
        SHAPE_KINDS(SHAPE_LIGHT)
#undef SHAPE_LIGHT
    case SHAPE_KIND_COUNT: break;
    }
    return LIGHT_TRIANGLE;
}

/* Density (1/sr) of a point that is chosen uniformly on `area` (m2), times the odds of the light; 0 where
 * the face is seen edge-on. */
static inline real face_light_area_pdf(const struct light_meeting *met, real area)
{
    real denominator = met->cosine * area;

    return denominator > 0 ? met->odds * met->distance_squared / denominator : 0;
}

/* Where triangle_light_sample puts these numbers. */
struct vec3 triangle_light_point(const struct render_scene *scene, const struct hit *light, real time, real u, real v);

/* Number the emissive instances' faces by light_base; returns how many there are. */
uint64_t face_lights_count(struct render_scene *scene);
/* faces[count]; the bits of `dark`, zeroed, of those whose emissive texture is black all over. ERR_NO_MEMORY. */
status face_lights_find(const struct render_scene *scene, struct hit *faces, uint8_t *dark,
                        struct error *err) MUST_CHECK;

/* Twice a triangle's area (m2): the length of its `normal`, the cross product of two edges. Where the square of that
 * length leaves the range of floats (edges below 1e-10 m) the vector is scaled by a power of two first. */
static inline real triangle_double_area(struct vec3 normal)
{
    real squared = vec3_length_squared(normal), most, power;

    if (squared > REAL(1e-30) && squared < REAL(1e30))
        return real_sqrt(squared);
    most = real_max(real_abs(normal.x), real_max(real_abs(normal.y), real_abs(normal.z)));
    if (!(most > 0 && most < INFINITY))
        return most;
    power = real_power_below(most);
    return power * vec3_length(vec3_scale(normal, 1 / power));
}
