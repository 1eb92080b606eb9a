/* triangle_light: a triangle of an emissive mesh, sampled uniformly by area. */
#include "worker/render/light/face_light.h"

#include "worker/render/base/health_scope.h"
#include "worker/render/base/profile_scope.h"
#include "worker/render/base/gate.h"
#include "worker/render/surface/surface.h"
#include "worker/render/render_scene.h"

/* A lower bound of the distance to the nearest edge: see surface_inset. */
static real triangle_inset(real b1, real b2, real double_area, struct vec3 e1, struct vec3 e2)
{
    real a = vec3_dot(e1, e1), b = vec3_dot(e2, e2);
    real c = vec3_length_squared(vec3_sub(e1, e2));

    return real_min(b1, real_min(b2, 1 - b1 - b2)) * double_area / real_sqrt(real_max(a, real_max(b, c)));
}

/* Heitz 2019's low-distortion map of the square onto a triangle. */
static void triangle_point(real u, real v, real *b1, real *b2)
{
    if (v > u) {
        *b1 = 0.5f * u;
        *b2 = v - *b1;
    } else {
        *b2 = 0.5f * v;
        *b1 = u - *b2;
    }
}

/* A point of an emissive triangle. */
struct triangle_place {
    const struct render_mesh *mesh;
    const struct render_material *material;
    const uint32_t *vertex;
    real b1, b2;
};

/* What a BSDF ray meets only some of the time sends only that share. */
static struct vec3 triangle_covered(const struct triangle_place *at, struct vec3 radiance)
{
    real alpha;

    if (!calls_for(EFFECTS_ALL, EFFECT_ALPHA) || !(at->material->flags & MATERIAL_ALPHA))
        return radiance;
    PROFILE_EFFECT(ALPHA);
    alpha = material_alpha(at->material, at->mesh, at->vertex, at->b1, at->b2);
    if (at->material->m.alpha_mode == ALPHA_MASK)
        alpha = alpha >= at->material->m.alpha_cutoff ? 1 : 0;
    return vec3_scale(radiance, real_min(1, real_max(0, alpha)));
}

struct vec3 triangle_light_point(const struct render_scene *scene, const struct hit *light, real time, real u, real v)
{
    struct vec3 corner[3];
    real b1, b2;

    triangle_of_instance(scene, &scene->instances[light->instance], light->triangle, time, corner);
    triangle_point(u, v, &b1, &b2);
    return vec3_add(corner[0], vec3_add(vec3_scale(vec3_sub(corner[1], corner[0]), b1),
                                        vec3_scale(vec3_sub(corner[2], corner[0]), b2)));
}

int triangle_light_sample(const struct render_scene *scene, const void *light_, const struct light_context *context,
                          real u, real v, struct light_sample *out)
{
    const struct hit *light = light_;
    const struct render_instance *instance = &scene->instances[light->instance];
    struct triangle_place at = {.mesh = &scene->meshes[instance->mesh],
                            .material = &scene->materials[instance->material]};
    struct vec3 corner[3], e1, e2, normal, point, to_light;
    real double_area, cosine, distance_squared;
    struct light_meeting met;

    triangle_of_instance(scene, instance, light->triangle, context->time, corner);
    triangle_point(u, v, &at.b1, &at.b2);
    e1 = vec3_sub(corner[1], corner[0]);
    e2 = vec3_sub(corner[2], corner[0]);
    normal = vec3_cross(e1, e2);
    double_area = triangle_double_area(normal);
    if (!(double_area > 0))
        return health_distance(double_area);
    normal = vec3_scale(normal, (instance->flipped ? -1 : 1) / double_area);
    point = vec3_add(corner[0], vec3_add(vec3_scale(e1, at.b1), vec3_scale(e2, at.b2)));
    to_light = vec3_sub(point, context->p);
    if (vec3_dot(normal, to_light) > 0 && !at.material->m.double_sided)
        return 0;
    distance_squared = vec3_length_squared(to_light);
    if (!light_is_apart(distance_squared))
        return health_distance(distance_squared);
    out->distance = real_sqrt(distance_squared);
    out->direction = vec3_scale(to_light, 1 / out->distance);
    cosine = real_abs(vec3_dot(normal, out->direction));
    out->on_face = 1;
    out->face = *light;
    out->cosine = cosine;
    out->inset = triangle_inset(at.b1, at.b2, double_area, e1, e2);
    if (render_near_face(scene, instance, light->triangle, point, out->inset))
        out->inset = 0;
    met = (struct light_meeting){out->pdf, distance_squared, cosine, 0.5f * double_area};
    out->pdf = face_light_area_pdf(&met, met.area);
    if (!(out->pdf > 0) || !isfinite(out->pdf))
        return cosine == 0 ? 0 : health_density(out->pdf); /* seen from the side it is infinite */
    at.vertex = triangle_vertices(at.mesh, light->triangle);
    out->radiance = triangle_covered(&at, material_emitted(at.material, at.mesh, at.vertex, at.b1, at.b2, cosine,
                                                           light_context_ior(context, out->direction)));
    out->delta = 0;
    return 1;
}

real triangle_light_pdf(const struct render_scene *scene, const void *light, const struct light_context *context,
                        const struct light_meeting *met)
{
    (void)scene;
    (void)light;
    (void)context;
    return face_light_area_pdf(met, met->area);
}
