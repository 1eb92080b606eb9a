#include "worker/render/light/emitters.h"

#include <string.h>

#include "common/base/memory.h"
#include "common/math/elementary.h"
#include "worker/render/surface.h"
#include "worker/render/world.h"

/* The environment's share of the choices where there are other lights. */
#define ENVIRONMENT_ODDS_MIN 0.25
#define ENVIRONMENT_ODDS_MAX 0.75

/* Mean emitted luminance of a triangle, from a fixed pattern of points where it is textured.
 * A point that the pattern misses is not lost: the BSDF finds it, and MIS knows (pdf 0). */
static double triangle_luminance(const struct world_material *material,
                                 const struct world_mesh *mesh, const uint32_t vertex[3])
{
    enum { SIDE = 4 };
    double sum = 0;
    int n = 0;

    if (!material->emission.image)
        return (double)vec3_luminance(vec3_make(material->m.emission[0], material->m.emission[1],
                                                material->m.emission[2]));
    for (int i = 0; i < SIDE; i++)
        for (int j = 0; j < SIDE - i; j++, n++) {
            float b1 = ((float)i + 1.0f / 3) / SIDE, b2 = ((float)j + 1.0f / 3) / SIDE;
            sum += (double)vec3_luminance(world_emission(material, mesh, vertex, b1, b2));
        }
    return sum / n;
}

static double triangle_area(const struct vec3 c[3])
{
    return 0.5 * (double)vec3_length(vec3_cross(vec3_sub(c[1], c[0]), vec3_sub(c[2], c[0])));
}

static double punctual_power(const struct scene_light *light, double radius)
{
    double intensity = (double)vec3_luminance(
        vec3_make(light->intensity[0], light->intensity[1], light->intensity[2]));

    switch (light->kind) {
    case LIGHT_DIRECTIONAL: return intensity * PI_D * radius * radius;
    case LIGHT_SPOT: return intensity * 2 * PI_D * (1 - (double)det_cos(light->outer_cone_rad));
    default: return intensity * 4 * PI_D;
    }
}

/* First pass: number the emissive instances' triangles. */
static uint64_t count_triangles(struct render_scene *scene)
{
    uint64_t total = 0;

    for (uint32_t i = 0; i < scene->instance_count; i++) {
        struct world_instance *instance = &scene->instances[i];
        instance->light_base = -1;
        if (!(scene->materials[instance->material].flags & MATERIAL_EMISSIVE) ||
            scene->materials[instance->material].m.unlit)
            continue;
        instance->light_base = (int32_t)(total < INT32_MAX ? total : INT32_MAX);
        total += scene->meshes[instance->mesh].triangle_count;
    }
    return total;
}

/* Weights of all triangles into power[]; returns their sum. */
static double weigh_triangles(struct emitters *e, const struct render_scene *scene, double *power)
{
    double sum = 0;
    uint32_t next = 0;

    for (uint32_t i = 0; i < scene->instance_count; i++) {
        const struct world_instance *instance = &scene->instances[i];
        const struct world_mesh *mesh = &scene->meshes[instance->mesh];
        const struct world_material *material = &scene->materials[instance->material];
        if (instance->light_base < 0)
            continue;
        for (uint32_t t = 0; t < mesh->triangle_count; t++, next++) {
            struct vec3 corner[3];
            double weight;
            world_triangle(scene, instance, t, 0, corner);
            weight = triangle_area(corner) * PI_D *
                     triangle_luminance(material, mesh, world_vertices(mesh, t)) *
                     (material->m.double_sided ? 2 : 1);
            power[next] = weight > 0 && isfinite(weight) ? weight : 0;
            sum += power[next];
            e->triangle_instance[next] = i;
            e->triangle_index[next] = t;
        }
    }
    return sum;
}

static void fill_cdf(struct emitters *e, const double *power, double environment_odds, double sum)
{
    uint32_t at = 0, last = 0, locals = e->punctual_count + e->triangle_count;
    double accumulated = 0;

    if (e->has_environment) {
        accumulated = environment_odds;
        e->cdf[at++] = (float)accumulated;
    }
    for (uint32_t i = 0; i < locals; i++, at++) {
        if (power[i] > 0) {
            accumulated += power[i] / sum * (1 - (e->has_environment ? environment_odds : 0));
            last = at;
        }
        e->cdf[at] = (float)(accumulated < 1 ? accumulated : 1);
    }
    for (uint32_t i = last; i < e->count; i++)
        e->cdf[i] = 1;
}

status emitters_init(struct emitters *e, struct render_scene *scene,
                     const struct scene_light *lights, uint32_t light_count, struct error *err)
{
    uint64_t triangles = count_triangles(scene);
    double *power = NULL, sum = 0, environment_power = 0, odds = 1;
    double radius = (double)scene->bounds_radius;
    uint32_t locals;

    memset(e, 0, sizeof *e);
    if (triangles > INT32_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "%llu emissive triangles: more than 2^31",
                         (unsigned long long)triangles);
    e->triangle_count = (uint32_t)triangles;
    e->punctual_count = light_count;
    e->has_environment = scene->environment && !environment_is_black(scene->environment) &&
                         scene->settings.env_sampling != ENV_SAMPLING_BSDF;
    locals = e->punctual_count + e->triangle_count;
    power = mem_calloc(locals, sizeof *power);
    e->punctual = mem_calloc(light_count, sizeof *e->punctual);
    e->triangle_instance = mem_alloc_array(e->triangle_count, sizeof *e->triangle_instance);
    e->triangle_index = mem_alloc_array(e->triangle_count, sizeof *e->triangle_index);
    e->cdf = mem_calloc((size_t)locals + 1, sizeof *e->cdf);
    if (!power || !e->punctual || !e->triangle_instance || !e->triangle_index || !e->cdf) {
        mem_free(power);
        emitters_release(e);
        return error_no_memory(err, "the table of lights");
    }
    for (uint32_t i = 0; i < light_count; i++) {
        double weight = punctual_power(&lights[i], radius);
        e->punctual[i] = lights[i];
        power[i] = weight > 0 && isfinite(weight) ? weight : 0;
        sum += power[i];
    }
    sum += weigh_triangles(e, scene, power + light_count);
    if (e->has_environment) {
        environment_power = 4 * PI_D * PI_D * radius * radius *
                            (double)environment_mean_luminance(scene->environment);
        if (sum > 0) {
            odds = environment_power / (environment_power + sum);
            odds = odds < ENVIRONMENT_ODDS_MIN ? ENVIRONMENT_ODDS_MIN : odds;
            odds = odds > ENVIRONMENT_ODDS_MAX ? ENVIRONMENT_ODDS_MAX : odds;
        }
    }
    if (sum > 0 || e->has_environment) {
        e->count = locals + (uint32_t)e->has_environment;
        fill_cdf(e, power, odds, sum > 0 ? sum : 1);
    }
    mem_free(power);
    return STATUS_OK;
}

void emitters_release(struct emitters *e)
{
    mem_free(e->cdf);
    mem_free(e->punctual);
    mem_free(e->triangle_instance);
    mem_free(e->triangle_index);
    memset(e, 0, sizeof *e);
}

static float odds_of(const struct emitters *e, uint32_t index)
{
    return index ? e->cdf[index] - e->cdf[index - 1] : e->cdf[0];
}

static float environment_odds(const struct emitters *e)
{
    return e->has_environment ? e->cdf[0] : 0;
}

float emitters_environment_pdf(const struct render_scene *scene, const struct light_query *query,
                               struct vec3 direction)
{
    (void)query;
    return scene->emitters.has_environment
               ? environment_pdf(scene->environment, direction) * environment_odds(&scene->emitters)
               : 0;
}

struct vec3 emitters_environment(const struct render_scene *scene, const struct light_query *query,
                                 struct vec3 direction, float *pdf)
{
    struct vec3 radiance;

    (void)query;
    if (!scene->emitters.has_environment) {
        *pdf = 0;
        return environment_radiance(scene->environment, direction);
    }
    radiance = environment_radiance_pdf(scene->environment, direction, pdf);
    *pdf *= environment_odds(&scene->emitters);
    return radiance;
}

float emitters_triangle_pdf(const struct render_scene *scene, const struct light_query *query,
                            uint32_t light, float distance_squared, float cosine, float area)
{
    const struct emitters *e = &scene->emitters;
    uint32_t index = light + e->punctual_count + (uint32_t)e->has_environment;
    float denominator = cosine * area;

    (void)query;
    if (e->count == 0 || !(denominator > 0))
        return 0;
    return odds_of(e, index) * distance_squared / denominator;
}

/* The first candidate whose accumulated probability exceeds u. */
static uint32_t choose(const struct emitters *e, float u)
{
    uint32_t low = 0, high = e->count - 1;

    while (low < high) {
        uint32_t middle = low + (high - low) / 2;
        if (e->cdf[middle] > u)
            high = middle;
        else
            low = middle + 1;
    }
    return low;
}

/* Windowed inverse-square falloff (KHR_lights_punctual). */
static float range_window(float distance, float range)
{
    float q;

    if (range <= 0)
        return 1;
    q = distance / range;
    q = 1 - q * q * q * q;
    return q < 0 ? 0 : q > 1 ? 1 : q;
}

static int sample_punctual(const struct scene_light *light, struct vec3 p, struct light_sample *out)
{
    struct vec3 axis = {light->direction[0], light->direction[1], light->direction[2]};
    float distance_squared, scale;

    out->delta = 1;
    out->radiance = vec3_make(light->intensity[0], light->intensity[1], light->intensity[2]);
    if (light->kind == LIGHT_DIRECTIONAL) {
        out->direction = vec3_neg(axis);
        out->distance = INFINITY;
        return 1;
    }
    out->direction =
        vec3_sub(vec3_make(light->position[0], light->position[1], light->position[2]), p);
    distance_squared = vec3_length_squared(out->direction);
    if (!(distance_squared > 0) || !isfinite(distance_squared))
        return 0;
    out->distance = sqrtf(distance_squared);
    out->direction = vec3_scale(out->direction, 1 / out->distance);
    scale = range_window(out->distance, light->range) / distance_squared;
    if (light->kind == LIGHT_SPOT) {
        float cos_inner = det_cos(light->inner_cone_rad), cos_outer = det_cos(light->outer_cone_rad);
        float cos_angle = -vec3_dot(axis, out->direction);
        float span = float_max(0.001f, cos_inner - cos_outer);
        float fade = float_min(1, float_max(0, (cos_angle - cos_outer) / span));
        scale *= fade * fade;
    }
    out->radiance = vec3_scale(out->radiance, scale);
    return scale > 0 && isfinite(scale);
}

static int sample_triangle(const struct render_scene *scene, uint32_t light,
                           const struct light_query *query, float u, float v,
                           struct light_sample *out)
{
    const struct emitters *e = &scene->emitters;
    const struct world_instance *instance = &scene->instances[e->triangle_instance[light]];
    const struct world_mesh *mesh = &scene->meshes[instance->mesh];
    const struct world_material *material = &scene->materials[instance->material];
    uint32_t triangle = e->triangle_index[light];
    struct vec3 corner[3], e1, e2, normal, point, to_light;
    float b1, b2, double_area, cosine, distance_squared, offset;

    world_triangle(scene, instance, triangle, query->time, corner);
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
    to_light = vec3_sub(point, query->p);
    cosine = -vec3_dot(normal, to_light);
    if (cosine < 0 && !material->m.double_sided)
        return 0;
    /* The shadow ray ends on the near side of the lamp, off its surface. */
    offset = surface_offset(point, corner, instance);
    point = vec3_mad(point, normal, cosine < 0 ? -offset : offset);
    to_light = vec3_sub(point, query->p);
    distance_squared = vec3_length_squared(to_light);
    if (!(distance_squared > 0) || !isfinite(distance_squared))
        return 0;
    out->distance = sqrtf(distance_squared);
    out->direction = vec3_scale(to_light, 1 / out->distance);
    cosine = fabsf(vec3_dot(normal, out->direction));
    out->pdf = emitters_triangle_pdf(scene, query, light, distance_squared, cosine, 0.5f * double_area);
    out->radiance = world_emission(material, mesh, world_vertices(mesh, triangle), b1, b2);
    out->delta = 0;
    if (material->flags & MATERIAL_ALPHA) {
        /* What a BSDF ray meets only some of the time sends only that share. */
        float alpha = world_alpha(material, mesh, world_vertices(mesh, triangle), b1, b2);
        if (material->m.alpha_mode == ALPHA_MASK)
            alpha = alpha >= material->m.alpha_cutoff ? 1 : 0;
        out->radiance = vec3_scale(out->radiance, float_min(1, float_max(0, alpha)));
    }
    return out->pdf > 0 && isfinite(out->pdf);
}

int emitters_sample(const struct render_scene *scene, const struct light_query *query, float u,
                    float v, struct light_sample *out)
{
    const struct emitters *e = &scene->emitters;
    uint32_t index = choose(e, u);
    float begin = index > 0 ? e->cdf[index - 1] : 0, odds = e->cdf[index] - begin;

    if (!(odds > 0))
        return 0;
    /* What is left of the number is as good as a new one. */
    u = float_min(float_max((u - begin) / odds, 0), 0x1.fffffep-1f);
    if (e->has_environment) {
        if (index == 0) {
            out->delta = 0;
            out->distance = INFINITY;
            if (!environment_sample(scene->environment, u, v, &out->direction, &out->radiance,
                                    &out->pdf))
                return 0;
            out->pdf *= e->cdf[0];
            return out->pdf > 0;
        }
        index--;
    }
    if (index < e->punctual_count) {
        out->pdf = odds;
        return sample_punctual(&e->punctual[index], query->p, out);
    }
    return sample_triangle(scene, index - e->punctual_count, query, u, v, out);
}
