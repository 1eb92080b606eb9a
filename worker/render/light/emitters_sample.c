/* emitters_sample: choosing a light at a path's vertex, and the odds of having chosen one. */
#include "common/math/elementary.h"
#include "worker/render/charge.h"
#include "worker/render/has.h"
#include "worker/render/light/emitters.h"
#include "worker/render/surface.h"
#include "worker/render/world.h"

/* The share of the environment's samples that go through portals, where some can be seen. */
#define PORTAL_SHARE 0.5f

/* ---- the environment --------------------------------------------------------------------- */

/* Density of a direction, given the map's. */
static float emitters_map_or_portals(const struct emitters *e, const struct light_context *context,
                                     struct vec3 direction, float map_pdf)
{
    float portal_pdf;

    if (!HAS(PORTAL) || e->portals.count == 0)
        return map_pdf;
    CHARGE_SCOPE(PORTAL);
    portal_pdf = portals_pdf(&e->portals, context->p, context->n, direction);
    return portal_pdf < 0 ? map_pdf : (1 - PORTAL_SHARE) * map_pdf + PORTAL_SHARE * portal_pdf;
}

struct vec3 emitters_environment(const struct render_scene *scene, const struct light_context *context,
                                 struct vec3 direction, float *pdf)
{
    const struct emitters *e = &scene->emitters;
    struct vec3 radiance;

    *pdf = 0;
    if (!scene->environment)
        return vec3_splat(0);
    if (!e->has_environment)
        return environment_radiance(scene->environment, direction);
    radiance = environment_radiance_pdf(scene->environment, direction, pdf);
    *pdf = emitters_map_or_portals(e, context, direction, *pdf) * e->environment_odds;
    return radiance;
}

float emitters_environment_pdf(const struct render_scene *scene, const struct light_context *context,
                               struct vec3 direction)
{
    float pdf;

    (void)emitters_environment(scene, context, direction, &pdf);
    return pdf;
}

/* Where the part of [0, 1) that begins at `start` and is `size` long contains the number. What
 * is left of a number is as good as a new one. */
static float emitters_rescaled(float number, float start, float size)
{
    return float_min(float_max((number - start) / size, 0), ONE_MINUS_EPSILON);
}

static int emitters_sees_portal(const struct emitters *e, const struct light_context *context)
{
    CHARGE_SCOPE(PORTAL);
    return portals_visible(&e->portals, context->p, context->n);
}

static int emitters_sample_map(const struct render_scene *scene, const struct light_context *context,
                               float u, float v, struct light_sample *out)
{
    const struct emitters *e = &scene->emitters;
    float map_pdf;

    out->delta = e->environment_alone;
    out->distance = INFINITY;
    CHARGE(ENVIRONMENT);
    if (!HAS(PORTAL) || e->portals.count == 0 || !emitters_sees_portal(e, context)) {
        if (!environment_sample(scene->environment, u, v, &out->direction, &out->radiance,
                                &out->pdf))
            return 0;
        out->pdf *= e->environment_odds;
        return out->pdf > 0;
    }
    if (u < PORTAL_SHARE) {
        CHARGE(PORTAL);
        if (!portals_sample(&e->portals, context->p, context->n,
                            emitters_rescaled(u, 0, PORTAL_SHARE), v, &out->direction))
            return 0;
        out->radiance = emitters_environment(scene, context, out->direction, &out->pdf);
        return out->pdf > 0;
    }
    if (!environment_sample(scene->environment,
                            emitters_rescaled(u, PORTAL_SHARE, 1 - PORTAL_SHARE), v, &out->direction,
                            &out->radiance, &map_pdf))
        return 0;
    out->pdf = emitters_map_or_portals(e, context, out->direction, map_pdf) * e->environment_odds;
    return out->pdf > 0;
}

/* ---- lights with a place ----------------------------------------------------------------- */

float emitters_triangle_pdf(const struct render_scene *scene, const struct light_context *context,
                            uint32_t light, float distance_squared, float cosine, float area)
{
    const struct emitters *e = &scene->emitters;
    float denominator = cosine * area, odds;

    if (!(denominator > 0))
        return 0;
    light += e->punctual_count - e->directional_count;
    odds = e->tree.node_count == 0 ? light_table_odds(&e->table, light)
                                   : light_tree_odds(&e->tree, context->p, context->n, light);
    return e->local_odds * odds * distance_squared / denominator;
}

/* A lower bound of the distance to the nearest edge: see surface_inset. */
static float emitters_inset(float b1, float b2, float double_area, struct vec3 e1, struct vec3 e2)
{
    float a = vec3_dot(e1, e1), b = vec3_dot(e2, e2);
    float c = vec3_length_squared(vec3_sub(e1, e2));

    return float_min(b1, float_min(b2, 1 - b1 - b2)) * double_area /
           sqrtf(float_max(a, float_max(b, c)));
}

static int emitters_sample_triangle(const struct render_scene *scene, uint32_t light,
                                    const struct light_context *context, float u, float v, float odds,
                                    struct light_sample *out)
{
    const struct emitters *e = &scene->emitters;
    const struct world_instance *instance = &scene->instances[e->triangle_instance[light]];
    const struct world_mesh *mesh = &scene->meshes[instance->mesh];
    const struct world_material *material = &scene->materials[instance->material];
    uint32_t triangle = e->triangle_index[light];
    struct vec3 corner[3], e1, e2, normal, point, to_light;
    float b1, b2, double_area, cosine, distance_squared;

    world_triangle(scene, instance, triangle, context->time, corner);
    /* Heitz 2019's low-distortion map of the square onto a triangle. */
    if (v > u) {
        b1 = 0.5f * u;
        b2 = v - b1;
    } else {
        b2 = 0.5f * v;
        b1 = u - b2;
    }
    e1 = vec3_sub(corner[1], corner[0]);
    e2 = vec3_sub(corner[2], corner[0]);
    normal = vec3_cross(e1, e2);
    double_area = vec3_length(normal);
    if (!(double_area > 0))
        return 0;
    normal = vec3_scale(normal, (instance->flipped ? -1 : 1) / double_area);
    point = vec3_add(corner[0], vec3_add(vec3_scale(e1, b1), vec3_scale(e2, b2)));
    to_light = vec3_sub(point, context->p);
    cosine = -vec3_dot(normal, to_light);
    if (cosine < 0 && !material->m.double_sided)
        return 0;
    distance_squared = vec3_length_squared(to_light);
    if (!(distance_squared > 0) || !isfinite(distance_squared))
        return 0;
    out->distance = sqrtf(distance_squared);
    out->direction = vec3_scale(to_light, 1 / out->distance);
    cosine = fabsf(vec3_dot(normal, out->direction));
    if (!(cosine > 0))
        return 0;
    out->on_face = 1;
    out->face = (struct hit){e->triangle_instance[light], triangle};
    out->cosine = cosine;
    out->inset = world_near_boundary(scene, point) ? 0
                                                   : emitters_inset(b1, b2, double_area, e1, e2);
    out->pdf = odds * distance_squared / (cosine * (0.5f * double_area));
    out->radiance = world_emission(material, mesh, world_vertices(mesh, triangle), b1, b2);
    if (HAS(CLEARCOAT) && material->m.clearcoat > 0)
        out->radiance = vec3_scale(out->radiance,
                                   world_emission_scale(material, mesh,
                                                        world_vertices(mesh, triangle), b1, b2,
                                                        cosine));
    out->delta = 0;
    if (HAS(ALPHA) && material->flags & MATERIAL_ALPHA) {
        CHARGE_SCOPE(ALPHA);
        /* What a BSDF ray meets only some of the time sends only that share. */
        float alpha = world_alpha(material, mesh, world_vertices(mesh, triangle), b1, b2);
        if (material->m.alpha_mode == ALPHA_MASK)
            alpha = alpha >= material->m.alpha_cutoff ? 1 : 0;
        out->radiance = vec3_scale(out->radiance, float_min(1, float_max(0, alpha)));
    }
    return out->pdf > 0 && isfinite(out->pdf);
}

static int emitters_sample_punctual(const struct punctual *light, const struct light_context *context,
                                    float odds, struct light_sample *out)
{
    charge_set(light->image ? CHARGE_OF(LIGHT_IMAGE) : CHARGE_OF(PUNCTUAL_LIGHT));
    out->delta = 1;
    out->pdf = odds;
    return odds > 0 && punctual_sample(light, context->p, context->time, &out->direction,
                                       &out->distance, &out->radiance);
}

static int emitters_sample_directional(const struct emitters *e, const struct light_context *context,
                                       float u, struct light_sample *out)
{
    const float *start = e->directional_start;
    uint32_t low = 0, high = e->directional_count;

    /* The last that begins at or before u: start[low] <= u < start[high]. */
    while (high - low > 1) {
        uint32_t middle = low + (high - low) / 2;

        if (start[middle] <= u)
            low = middle;
        else
            high = middle;
    }
    return emitters_sample_punctual(&e->punctual[low], context,
                           e->directional_odds * (start[low + 1] - start[low]), out);
}

static int emitters_sample_item(const struct render_scene *scene, const struct light_context *context,
                                uint32_t item, float u, float v, float odds,
                                struct light_sample *out)
{
    const struct emitters *e = &scene->emitters;
    uint32_t punctual = e->punctual_count - e->directional_count;

    odds *= e->local_odds;
    if (HAS(PUNCTUAL_LIGHT) && item < punctual)
        return emitters_sample_punctual(&e->punctual[e->directional_count + item], context, odds,
                                        out);
    return emitters_sample_triangle(scene, item - punctual, context, u, v, odds, out);
}

int emitters_sample(const struct render_scene *scene, const struct light_context *context, float u,
                    float v, struct light_sample *out)
{
    const struct emitters *e = &scene->emitters;
    uint32_t item;
    float odds;

    out->on_face = 0;
    if (HAS(ENVIRONMENT) && u < e->environment_odds)
        return emitters_sample_map(scene, context, emitters_rescaled(u, 0, e->environment_odds), v,
                                   out);
    u -= e->environment_odds;
    if (HAS(PUNCTUAL_LIGHT) && u < e->directional_odds)
        return emitters_sample_directional(e, context,
                                           emitters_rescaled(u, 0, e->directional_odds), out);
    /* Choosing among lights of both kinds counts as the triangles': they are the many. */
    charge_set(e->triangle_count ? CHARGE_OF(EMISSIVE_MESH) : CHARGE_OF(PUNCTUAL_LIGHT));
    u = emitters_rescaled(u, e->directional_odds, e->local_odds);
    if (e->tree.node_count == 0
            ? !light_table_choose(&e->table, &u, &v, &item, &odds)
            : !light_tree_choose(&e->tree, context->p, context->n, &u, &v, &item, &odds))
        return 0;
    return emitters_sample_item(scene, context, item, u, v, odds, out);
}
