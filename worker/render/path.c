#include "worker/render/path.h"

#include "common/base/clock.h"
#include "common/math/elementary.h"
#include "worker/render/bsdf/bsdf.h"
#include "worker/render/surface.h"
#include "worker/render/world.h"

/* Russian roulette begins at this vertex, and never kills with more than 95 %. */
#define ROULETTE_DEPTH 3
#define ROULETTE_SURVIVAL_MIN 0.05f

static int measure_trace;

void render_measure_trace(int on)
{
    measure_trace = on;
}

/* What a traversal needs to know to answer path_accept. */
struct path_query {
    const struct sampler *sampler;
    uint32_t ray_number; /* within the path: keys the stochastic alpha */
};

int path_accept(const void *scene_, const void *query_, uint32_t instance_index, uint32_t triangle,
                float u, float v, int facing)
{
    const struct render_scene *scene = scene_;
    const struct path_query *query = query_;
    const struct world_instance *instance = &scene->instances[instance_index];
    const struct world_material *material = &scene->materials[instance->material];
    float alpha;

    /* Baked triangles are seen in world space, where a mirror turns the winding round. */
    if (instance->world_positions && instance->flipped)
        facing = !facing;
    if (!facing && (material->flags & MATERIAL_CULLED))
        return 0;
    if (!(material->flags & MATERIAL_ALPHA))
        return 1;
    alpha = world_alpha(material, &scene->meshes[instance->mesh],
                        world_vertices(&scene->meshes[instance->mesh], triangle), u, v);
    if (material->m.alpha_mode == ALPHA_MASK)
        return alpha >= material->m.alpha_cutoff;
    return sampler_hash(query->sampler, query->ray_number * 0x9e3779b9u + instance_index,
                        triangle) < alpha;
}

static int trace(const struct render_scene *scene, const struct ray *ray,
                 const struct path_query *query, struct hit *hit, struct render_stats *stats)
{
    uint64_t start;
    int met;

    stats->rays++;
    if (!measure_trace)
        return accel_intersect(scene->accel, ray, query, hit);
    start = clock_monotonic_ns();
    met = accel_intersect(scene->accel, ray, query, hit);
    stats->trace_ns += clock_monotonic_ns() - start;
    return met;
}

static int occluded(const struct render_scene *scene, const struct ray *ray,
                    const struct path_query *query, struct render_stats *stats)
{
    uint64_t start;
    int blocked;

    stats->rays++;
    if (!measure_trace)
        return accel_occluded(scene->accel, ray, query);
    start = clock_monotonic_ns();
    blocked = accel_occluded(scene->accel, ray, query);
    stats->trace_ns += clock_monotonic_ns() - start;
    return blocked;
}

/* Veach's power heuristic with exponent 2 for strategy a against b. */
static float mis_weight(float a, float b)
{
    float r;

    if (!(a > 0))
        return 0;
    r = b / a;
    return 1 / (1 + r * r);
}

/* Next-event estimation: light that one chosen emitter sends to the surface. */
static struct vec3 direct_light(const struct render_scene *scene, const struct surface *s,
                                const struct bsdf *bsdf, struct vec3 wo,
                                const struct sampler *sampler, uint32_t vertex_dimension,
                                struct path_query *query, struct render_stats *stats)
{
    const struct vec3 black = {0, 0, 0};
    struct sample2 point = sampler_get(sampler, vertex_dimension + VERTEX_LIGHT_POINT);
    const struct light_query asker = {s->p, {0, 0, 0}, 0};
    struct light_sample light;
    struct vec3 wi, value;
    struct ray ray;
    float bsdf_density;

    if (!emitters_sample(scene, &asker, point.u, point.v, &light) ||
        vec3_is_black(light.radiance))
        return black;
    wi = frame_to_local(&s->frame, light.direction);
    /* The geometric normal decides on which side the light is, or it leaks. */
    if ((vec3_dot(light.direction, s->ng) > 0) != (wi.z > 0))
        return black;
    value = bsdf_eval_pdf(bsdf, wo, wi, &bsdf_density);
    if (vec3_is_black(value))
        return black;
    ray.origin = surface_ray_origin(s, light.direction);
    ray.direction = light.direction;
    ray.t_max = INFINITY;
    if (light.distance < INFINITY) {
        /* Aim again from the moved origin, so that the ray ends where the sample lies. */
        struct vec3 to_light =
            vec3_sub(vec3_mad(s->p, light.direction, light.distance), ray.origin);
        float distance = vec3_length(to_light);
        if (!(distance > 0))
            return black;
        ray.direction = vec3_scale(to_light, 1 / distance);
        ray.t_max = distance * (1 - 0x1p-20f);
    }
    query->ray_number++;
    if (occluded(scene, &ray, query, stats))
        return black;
    value = vec3_mul(value, vec3_scale(light.radiance, 1 / light.pdf));
    return light.delta ? value : vec3_scale(value, mis_weight(light.pdf, bsdf_density));
}

/* Radiance of the environment along an escaped ray, weighted against light sampling. */
static struct vec3 escaped(const struct render_scene *scene, const struct light_query *asker,
                           struct vec3 direction, int from_delta, float bsdf_density)
{
    struct vec3 radiance;
    float density;

    if (!scene->environment)
        return vec3_make(0, 0, 0);
    if (from_delta || !scene->emitters.has_environment)
        return environment_radiance(scene->environment, direction);
    radiance = emitters_environment(scene, asker, direction, &density);
    return vec3_scale(radiance, mis_weight(bsdf_density, density));
}

static struct vec3 emitted(const struct render_scene *scene, const struct surface *s,
                           const struct light_query *asker, struct vec3 direction, int from_delta, float bsdf_density)
{
    const struct world_material *material = s->material;
    struct vec3 radiance;
    float cosine, light_density;

    if (!(material->flags & MATERIAL_EMISSIVE) || (!s->front && !material->m.double_sided))
        return vec3_make(0, 0, 0); /* a lamp shines from its front */
    radiance = world_emission(material, s->mesh, s->vertex, s->b1, s->b2);
    if (from_delta || s->instance->light_base < 0)
        return radiance;
    cosine = fabsf(vec3_dot(s->ng, direction));
    light_density =
        emitters_triangle_pdf(scene, asker, (uint32_t)s->instance->light_base + s->triangle,
                              s->t * s->t, cosine, s->area);
    return vec3_scale(radiance, mis_weight(bsdf_density, light_density));
}

/* An unlit material shows its base colour, whatever the light. */
static struct vec3 unlit_radiance(const struct surface *s)
{
    const struct scene_material *m = &s->material->m;
    struct vec3 color = vec3_make(m->base_color[0], m->base_color[1], m->base_color[2]);

    if (s->material->base_color.image) {
        struct texel texel =
            world_slot_lookup(&s->material->base_color, s->mesh, s->vertex, s->b1, s->b2, s->footprint, 1);
        color = vec3_mul(color, vec3_make(texel.r, texel.g, texel.b));
    }
    if (s->mesh->colors) {
        const float *c = s->mesh->colors;
        float b0 = 1 - s->b1 - s->b2;
        const float *a0 = c + 4 * (size_t)s->vertex[0], *a1 = c + 4 * (size_t)s->vertex[1],
                    *a2 = c + 4 * (size_t)s->vertex[2];
        color.x *= b0 * a0[0] + s->b1 * a1[0] + s->b2 * a2[0];
        color.y *= b0 * a0[1] + s->b1 * a1[1] + s->b2 * a2[1];
        color.z *= b0 * a0[2] + s->b1 * a1[2] + s->b2 * a2[2];
    }
    return color;
}

/* Beer-Lambert over the stretch of the path that just ended inside a refractive object. */
static struct vec3 absorbed(const struct world_material *material, float distance)
{
    struct vec3 a = material->absorption;

    return vec3_make(a.x > 0 ? det_exp(-a.x * distance) : 1, a.y > 0 ? det_exp(-a.y * distance) : 1,
                     a.z > 0 ? det_exp(-a.z * distance) : 1);
}

struct vec3 path_radiance(const struct render_scene *scene, const struct sampler *sampler,
                          struct ray ray, struct render_stats *stats)
{
    struct vec3 radiance = {0, 0, 0}, throughput = {1, 1, 1};
    struct path_query query = {sampler, 0};
    struct light_query asker = {{0, 0, 0}, {0, 0, 0}, 0};
    float bsdf_density = 0, eta_scale = 1;
    int from_delta = 1; /* the camera samples like a delta lobe: nothing competes with it */
    uint32_t max_depth = scene->settings.max_depth;

    for (uint32_t depth = 0;; depth++) {
        uint32_t dimension = DIMENSION_VERTEX + depth * DIMENSIONS_PER_VERTEX;
        struct sample2 direction_sample, lobe_sample;
        struct bsdf_sample sample;
        struct bsdf_params params;
        struct bsdf bsdf;
        struct surface s;
        struct hit hit;
        struct vec3 wo;
        float survival;

        query.ray_number++;
        if (!trace(scene, &ray, &query, &hit, stats)) {
            radiance = vec3_add(radiance, vec3_mul(throughput, escaped(scene, &asker, ray.direction,
                                                                       from_delta, bsdf_density)));
            break;
        }
        stats->vertices++;
        surface_from_hit(scene, &ray, &hit, &s);
        if (!s.front && s.material->m.refractive && !vec3_is_black(s.material->absorption))
            throughput = vec3_mul(throughput, absorbed(s.material, s.t));
        if (s.material->m.unlit) {
            radiance = vec3_add(radiance, vec3_mul(throughput, unlit_radiance(&s)));
            break;
        }
        radiance = vec3_add(radiance, vec3_mul(throughput, emitted(scene, &s, &asker, ray.direction,
                                                                   from_delta, bsdf_density)));
        if (depth >= max_depth)
            break;

        surface_shade(&s, vec3_neg(ray.direction), &params);
        wo = frame_to_local(&s.frame, vec3_neg(ray.direction));
        if (!(wo.z > 0))
            break;
        bsdf_init(&bsdf, &params, wo);
        if (bsdf.has_smooth && scene->emitters.count > 0)
            radiance = vec3_add(
                radiance, vec3_mul(throughput, direct_light(scene, &s, &bsdf, wo, sampler,
                                                            dimension, &query, stats)));

        direction_sample = sampler_get(sampler, dimension + VERTEX_BSDF);
        lobe_sample = sampler_get(sampler, dimension + VERTEX_LOBE);
        if (!bsdf_sample(&bsdf, wo, lobe_sample.u, direction_sample.u, direction_sample.v, &sample))
            break;
        ray.direction = vec3_normalize(frame_to_world(&s.frame, sample.wi));
        if ((vec3_dot(ray.direction, s.ng) > 0) != (sample.wi.z > 0))
            break;
        throughput = vec3_mul(throughput, sample.weight);
        eta_scale *= sample.eta_scale;
        from_delta = (sample.flags & BSDF_DELTA) != 0;
        bsdf_density = sample.pdf;
        if (depth + 1 >= ROULETTE_DEPTH) {
            survival = vec3_max(throughput) * eta_scale;
            if (survival < 1) {
                survival = float_max(survival, ROULETTE_SURVIVAL_MIN);
                if (!(lobe_sample.v < survival))
                    break;
                throughput = vec3_scale(throughput, 1 / survival);
            }
        }
        if (vec3_is_black(throughput))
            break;
        asker.p = s.p;
        ray.origin = surface_ray_origin(&s, ray.direction);
        ray.t_max = INFINITY;
    }
    return radiance;
}
