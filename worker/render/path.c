#include "worker/render/path.h"

#include <string.h>

#include "common/base/clock.h"
#include "common/math/elementary.h"
#include "worker/render/bsdf/bsdf.h"
#include "worker/render/bsdf/dispersion.h"
#include "worker/render/charge.h"
#include "worker/render/crossing.h"
#include "worker/render/exact.h"
#include "worker/render/has.h"
#include "worker/render/interior.h"
#include "worker/render/kernel.h"
#include "worker/render/medium.h"
#include "worker/render/stage.h"
#include "worker/render/surface.h"
#include "worker/render/world.h"

/* Russian roulette never kills with more than 95 %. */
#define ROULETTE_SURVIVAL_MIN 0.05f
/* A ray that passes more boundaries that are none than this is lost: only faulty geometry
 * (a volume that is entered again and again and never left) has so many. */
#define PASSAGES_MAX 256
/* A scattered ray's beam widens with the spacing of such samples, this share of it; at most so
 * much a metre. */
#define CONE_SHARE 0.25f
#define CONE_SPREAD_MAX 0.25f

#define HAS_VOLUMES (HAS(MEDIUM) || HAS(NESTED_DIELECTRIC) || HAS(INTERFACE))

struct path {
    const struct render_scene *scene;
    const struct sampler *sampler;
    struct render_stats *stats;
    struct ray ray;
    struct vec3 throughput;
    struct path_query query;
    struct light_context context;   /* the vertex that the ray left: as the light sampling context */
    float density;              /* with which the vertex chose the ray's direction */
    int from_delta;             /* nothing competes with that choice (the camera is alike) */
    int scattered;              /* a vertex before the last one was not a mirror */
    float eta_scale;            /* product of squared relative indices, for the roulette */
    struct camera_cone cone;
    float wavelength_nm;        /* 0: not chosen yet */
    int dispersed;              /* the throughput carries the wavelength's colour */
    struct vec3 wavelength_rgb;
    struct interior interior;
    uint32_t medium_key;
    uint32_t medium_depth;      /* the depth after the last one whose number a medium used */
    /* With volumes only; else the charge stays as scattering has left it (charge.h). */
    uint8_t sender;             /* to whom the ray and what it meets are charged */
    uint8_t bearer;             /* and the stretch that is traced now: the sender, or a boundary */
};

/* Of the corners where the mesh has them, whatever their numbers and the triangle's. */
static uint32_t path_triangle_key(const struct world_mesh *mesh, const uint32_t vertex[3])
{
    uint32_t key = 0;

    for (int k = 0; k < 3; k++) {
        uint32_t bits[3];
        memcpy(bits, mesh->positions + 3 * (size_t)vertex[k], sizeof bits);
        for (int a = 0; a < 3; a++) {
            key = (key ^ bits[a]) * 0x9e3779b1u;
            key ^= key >> 15;
        }
    }
    return key;
}

int path_accept(const void *scene_, const void *query_, uint32_t instance_index, uint32_t triangle,
                float u, float v, int facing)
{
    const struct render_scene *scene = scene_;
    const struct path_query *query = query_;
    const struct world_instance *instance = &scene->instances[instance_index];
    const struct world_material *material = &scene->materials[instance->material];
    const struct world_mesh *mesh = &scene->meshes[instance->mesh];
    const uint32_t *vertex;
    float alpha;

    CHARGE_SCOPE_OF(ACTIVE(scene, CULLING) ? CHARGE_OF(CULLING) : CHARGE_OF(ALPHA));
    /* Baked triangles are seen in world space, where a mirror turns the winding round. */
    if (instance->world_positions && instance->flipped)
        facing = !facing;
    if (!facing && (material->flags & MATERIAL_CULLED))
        return 0;
    if (!HAS(ALPHA) || !(material->flags & MATERIAL_ALPHA))
        return 1;
    STAGE(SURFACE);
    CHARGE(ALPHA);
    vertex = world_vertices(mesh, triangle);
    alpha = world_alpha(material, mesh, vertex, u, v);
    STAGE(TRACE);
    if (material->m.alpha_mode == ALPHA_MASK)
        return alpha >= material->m.alpha_cutoff;
    return sampler_hash(query->sampler, query->ray_number * 0x9e3779b9u + instance->alpha_key,
                        path_triangle_key(mesh, vertex)) < alpha;
}

/* Is any of the volumes that the ray is in closed? A medium without a list of bodies has no mesh to
 * ask: it is taken to be closed where the ray starts in its midst. */
static int path_is_inside(const struct render_scene *scene, const struct interior *in,
                          const struct ray *ray)
{
    if (scene->volume_rule == VOLUMES_BOUNDARIES)
        return in->medium >= 0 && in->medium != scene->fog && ray->left_count == 0;
    for (uint32_t i = 0; i < in->count; i++)
        if (!(in->entry[i] & INTERIOR_OWED) &&
            (scene->materials[in->entry[i]].flags & MATERIAL_ENCLOSES))
            return 1;
    return 0;
}

/* Can path_is_enclosed be true at all? Asked for every ray that escapes. */
static inline int path_may_leak(const struct render_scene *scene, const struct interior *in,
                                const struct ray *ray)
{
    return scene->enclosed || (HAS_VOLUMES && (in->count > 0 || in->medium >= 0)) ||
           (ray->left_count > 0 && scene->instances[ray->left[0].instance].encloses);
}

/* Does the ray start inside something closed? Then it cannot escape: if it does, it has slipped
 * through a vertex (docs/NUMERICS.md). `in`: the volumes that it is in. */
static int path_is_enclosed(const struct render_scene *scene, const struct interior *in,
                            const struct ray *ray)
{
    const struct world_instance *instance;
    double corner[3][3], n[3], direction[3];

    if (ray->t_max < INFINITY)
        return 0; /* it reached its end */
    if (scene->enclosed || (HAS_VOLUMES && path_is_inside(scene, in, ray)))
        return 1;
    if (ray->left_count == 0)
        return 0;
    instance = &scene->instances[ray->left[0].instance];
    if (!instance->encloses)
        return 0;
    world_exact_corners(scene, ray->left[0].instance, ray->left[0].triangle, ray->time, corner);
    exact_normal(corner, n);
    exact_vec(ray->direction, direction);
    return instance->flipped ? exact_dot(n, direction) > 0 : exact_dot(n, direction) < 0;
}

/* What such a ray meets; 0: it did escape. Kept out of the way of what runs always; not `cold`, or
 * what follows every escape would be, too. */
static __attribute__((noinline)) int path_leaked(const struct path *path,
                                                       const struct interior *in,
                                                       const struct ray *ray, struct hit *hit)
{
    if (!path_is_enclosed(path->scene, in, ray) ||
        !accel_intersect_enclosed(path->scene->accel, ray, &path->query, hit))
        return 0;
    path->stats->leaked_rays++;
    return 1;
}

static int path_meets(const struct path *path, const struct interior *in, const struct ray *ray,
                      struct hit *hit)
{
    return accel_intersect(path->scene->accel, ray, &path->query, hit) ||
           (path_may_leak(path->scene, in, ray) && path_leaked(path, in, ray, hit));
}

/* The same of a shadow ray that found its way free. */
static __attribute__((noinline)) int path_leaked_shadow(const struct path *path,
                                                              const struct ray *ray)
{
    if (!path_is_enclosed(path->scene, &path->interior, ray) ||
        !accel_occluded_enclosed(path->scene->accel, ray, &path->query))
        return 0;
    path->stats->leaked_rays++;
    return 1;
}

static int path_is_blocked(const struct path *path, const struct ray *ray)
{
    return accel_occluded(path->scene->accel, ray, &path->query) ||
           (!(ray->t_max < INFINITY) && path_may_leak(path->scene, &path->interior, ray) &&
            path_leaked_shadow(path, ray));
}

static int path_trace(const struct path *path, const struct interior *in, const struct ray *ray,
                      struct hit *hit)
{
    uint64_t start;
    int met;

    STAGE(TRACE);
    path->stats->rays++;
    if (!kernel_measures_trace)
        return path_meets(path, in, ray, hit);
    start = clock_monotonic_ns();
    met = path_meets(path, in, ray, hit);
    path->stats->trace_ns += clock_monotonic_ns() - start;
    return met;
}

static void path_surface(const struct path *path, const struct ray *ray,
                         const struct path_query *query, struct hit *hit, struct surface *s)
{
    crossing_first(path->scene, ray, query, hit, s);
}

static int path_occluded(const struct path *path, const struct ray *ray)
{
    uint64_t start;
    int blocked;

    STAGE(TRACE);
    path->stats->rays++;
    if (!kernel_measures_trace)
        return path_is_blocked(path, ray);
    start = clock_monotonic_ns();
    blocked = path_is_blocked(path, ray);
    path->stats->trace_ns += clock_monotonic_ns() - start;
    return blocked;
}

/* Veach's power heuristic with exponent 2 for strategy a against b. */
static float path_mis_weight(float a, float b)
{
    float r;

    if (!(a > 0))
        return 0;
    r = b / a;
    return 1 / (1 + r * r);
}

/* ---- volumes ------------------------------------------------------------------------------ */

/* The medium around the ray, NULL: none. */
static const struct world_medium *interior_medium(const struct render_scene *scene,
                                                  const struct interior *in, int *is_fog)
{
    const struct world_material *around;
    int32_t medium = in->medium;

    if (scene->volume_rule == VOLUMES_NESTED) {
        around = interior_around(scene, in);
        medium = around ? around->m.medium : scene->fog;
        *is_fog = !around;
    } else {
        *is_fog = medium == scene->fog;
    }
    if (medium < 0 || (*is_fog && !ACTIVE(scene, FOG)))
        return NULL;
    return scene->media[medium];
}

/* To whom keeping count of the volumes is charged. */
static uint8_t path_keeper(const struct render_scene *scene)
{
    return ACTIVE(scene, NESTED_DIELECTRIC) ? CHARGE_OF(NESTED_DIELECTRIC)
           : ACTIVE(scene, INTERFACE)       ? CHARGE_OF(INTERFACE)
                                            : CHARGE_OF(MEDIUM);
}

/* Fog ends at the scene's sphere: where along the ray. */
static float path_fog_end(const struct render_scene *scene, const struct ray *ray)
{
    struct vec3 to = vec3_sub(scene->bounds_centre, ray->origin);
    float along = vec3_dot(to, ray->direction);
    float beside = vec3_length_squared(vec3_mad(to, ray->direction, -along));
    float half = scene->fog_radius * scene->fog_radius - beside;

    return half > 0 ? float_max(along + sqrtf(half), 0) : 0;
}

/* What the stretch that ends at the surface lies in; NULL: nothing that is known of. */
static const struct world_material *path_around(const struct path *path, const struct surface *s,
                                                int volumes)
{
    if (volumes && path->scene->volume_rule == VOLUMES_NESTED)
        return interior_around(path->scene, &path->interior);
    return !s->front && s->material->m.refractive ? s->material : NULL;
}

/* Beer-Lambert over a stretch inside a refractive object. */
static struct vec3 path_absorbed(const struct world_material *material, float distance)
{
    struct vec3 a = material->absorption;

    return vec3_make(a.x > 0 ? det_exp(-a.x * distance) : 1, a.y > 0 ? det_exp(-a.y * distance) : 1,
                     a.z > 0 ? det_exp(-a.z * distance) : 1);
}

/* ---- light -------------------------------------------------------------------------------- */

/* What gets through past medium boundaries, dimmed. */
static __attribute__((noinline)) struct vec3 path_visibility_through(struct path *path,
                                                                     const struct ray *ray)
{
    const struct render_scene *scene = path->scene;
    const struct vec3 black = {0, 0, 0};
    struct vec3 visible = {1, 1, 1};
    struct interior in = path->interior;
    struct ray stretch = *ray;
    float left = ray->t_max;
    uint8_t light = charge_get();

    for (int i = 0; i < PASSAGES_MAX; i++) {
        struct medium_random random = {path->sampler, path->medium_key++, 0};
        const struct world_medium *medium;
        struct crossing crossing;
        struct surface s;
        struct hit hit;
        int met, is_fog;

        met = path_trace(path, &in, &stretch, &hit);
        STAGE(MEDIUM);
        if (met) {
            path_surface(path, &stretch, &path->query, &hit, &s);
            surface_resolve_mix(scene, &s, 0);
            charge_set(light);
            if (s.material->m.kind != MATERIAL_INTERFACE)
                return black;
        }
        medium = interior_medium(scene, &in, &is_fog);
        if (medium) {
            struct ray through = stretch;
            CHARGE_SCOPE_OF(is_fog ? CHARGE_OF(FOG) : CHARGE_OF(MEDIUM));
            through.t_max = met ? s.t : stretch.t_max;
            if (is_fog)
                through.t_max = float_min(through.t_max, path_fog_end(scene, &stretch));
            visible = vec3_mul(visible, medium_transmittance(medium, &through, &random));
            if (vec3_is_black(visible))
                return black;
        }
        if (!met)
            return visible;
        CHARGE(INTERFACE);
        crossing_find(scene, &stretch, &path->query, 0, 0, 0, &in, &s, &crossing);
        if (s.material->m.kind != MATERIAL_INTERFACE)
            return black;
        in = crossing.beyond;
        surface_leave(&s, ray->direction, &stretch);
        stretch.reaches = ray->reaches;
        stretch.t_max = left -= s.t;
        if (!(left > 0))
            return visible;
        path->query.ray_number++;
    }
    return black;
}

/* What gets through from the ray's origin to its end. */
static struct vec3 path_visibility(struct path *path, const struct ray *ray)
{
    const struct render_scene *scene = path->scene;

    path->query.ray_number++;
    if (HAS_VOLUMES && (ACTIVE(scene, MEDIUM) || ACTIVE(scene, INTERFACE)))
        return path_visibility_through(path, ray);
    return vec3_splat(path_occluded(path, ray) ? 0 : 1);
}

/* Where the ray to a sampled light ends. A lamp's face is not in its own way; a light without a
 * face may stand on something. */
static void path_end_at_light(const struct light_sample *light, struct ray *ray)
{
    ray->t_max = light->on_face ? light->distance : light->distance * (1 - 0x1p-20f);
    ray->reaches = light->on_face;
    ray->end = light->face;
    ray->end_inset = light->inset;
    ray->end_cosine = light->cosine;
}

/* Does the path, if it goes on towards wi, meet another face at its place? */
static int path_meets_next(const struct crossing *crossing, struct vec3 wi)
{
    return HAS(NESTED_DIELECTRIC) && crossing->next_side &&
           (wi.z > 0) == (crossing->next_side > 0);
}

/* Next-event estimation: light that one chosen emitter sends to the surface. `crossing`: what is on
 * the other side; `scatterer`: to whom the BSDF is charged. */
static struct vec3 path_direct_light(struct path *path, const struct surface *s,
                                     const struct bsdf *bsdf, struct vec3 wo, uint32_t dimension,
                                     const struct crossing *crossing, uint8_t scatterer)
{
    const struct vec3 black = {0, 0, 0};
    struct sample2 point = sampler_get(path->sampler, dimension + VERTEX_LIGHT_POINT);
    struct light_context context = {s->p, s->ng, s->time};
    struct light_sample light;
    struct interior here;
    struct vec3 wi, value, visible;
    struct ray ray;
    float bsdf_density;
    uint8_t sender;

    STAGE(LIGHT);
    if (s->material->flags & MATERIAL_TWO_WAY)
        context.n = black;
    if (!emitters_sample(path->scene, &context, point.u, point.v, &light) ||
        vec3_is_black(light.radiance))
        return black;
    sender = charge_get();
    wi = frame_to_local(&s->frame, light.direction);
    /* The geometric normal decides on which side the light is, or it leaks. */
    if ((vec3_dot(light.direction, s->ng) > 0) != (wi.z > 0))
        return black;
    if (path_meets_next(crossing, wi))
        return black;
    STAGE(SCATTER);
    charge_set(scatterer);
    value = bsdf_eval_pdf(bsdf, wo, wi, &bsdf_density);
    charge_set(sender);
    if (vec3_is_black(value))
        return black;
    surface_leave(s, light.direction, &ray);
    path_end_at_light(&light, &ray);
    if (HAS_VOLUMES && wi.z < 0) {
        here = path->interior;
        path->interior = crossing->beyond;
        visible = path_visibility(path, &ray);
        path->interior = here;
    } else {
        visible = path_visibility(path, &ray);
    }
    if (vec3_is_black(visible))
        return black;
    if (HAS(DISPERSION) && path->wavelength_nm > 0 && !path->dispersed &&
        s->material->m.dispersion > 0 && s->material->m.refractive)
        value = vec3_mul(value, path->wavelength_rgb);
    if (HAS_VOLUMES)
        value = vec3_mul(value, visible);
    value = vec3_mul(value, vec3_scale(light.radiance, 1 / light.pdf));
    return light.delta ? value : vec3_scale(value, path_mis_weight(light.pdf, bsdf_density));
}

/* The same at the point in a medium where path->ray starts, for light that arrives along
 * `direction` there. */
static struct vec3 path_direct_phase(struct path *path, const struct world_medium *medium,
                                     struct vec3 direction, uint32_t dimension)
{
    const struct vec3 black = {0, 0, 0};
    struct sample2 point = sampler_get(path->sampler, dimension + VERTEX_LIGHT_POINT);
    const struct light_context context = {path->ray.origin, {0, 0, 0}, path->ray.time};
    struct ray ray = path->ray;
    struct light_sample light;
    struct vec3 value;
    float density;

    STAGE(LIGHT);
    if (!emitters_sample(path->scene, &context, point.u, point.v, &light) ||
        vec3_is_black(light.radiance))
        return black;
    ray.direction = light.direction;
    path_end_at_light(&light, &ray);
    density = medium_phase(medium, vec3_dot(direction, light.direction));
    value = vec3_scale(path_visibility(path, &ray), density);
    value = vec3_mul(value, vec3_scale(light.radiance, 1 / light.pdf));
    return light.delta ? value : vec3_scale(value, path_mis_weight(light.pdf, density));
}

/* Light that only reaches a surface by way of a mirror or a lens, when it is not wanted. */
static int path_is_caustic(const struct path *path)
{
    return path->from_delta && path->scattered && (path->scene->settings.without & EFFECT_CAUSTICS);
}

/* Radiance of the environment along an escaped ray, weighted against light sampling. */
static struct vec3 path_escaped(const struct path *path)
{
    const struct render_scene *scene = path->scene;
    struct vec3 radiance;
    float density;

    if (!ACTIVE(scene, ENVIRONMENT) || !scene->environment || path_is_caustic(path))
        return vec3_make(0, 0, 0);
    CHARGE(ENVIRONMENT);
    if (path->from_delta || !scene->emitters.has_environment)
        return environment_radiance(scene->environment, path->ray.direction);
    if (scene->emitters.environment.alone)
        return vec3_make(0, 0, 0);
    radiance = emitters_environment(scene, &path->context, path->ray.direction, &density);
    return vec3_scale(radiance, path_mis_weight(path->density, density));
}

static struct vec3 path_emitted(const struct path *path, const struct surface *s)
{
    const struct world_material *material = s->material;
    struct vec3 radiance, way;
    float cosine, light_density;
    int sampled;

    if (!HAS(EMISSIVE_MESH) || !(material->flags & MATERIAL_EMISSIVE) ||
        (!s->front && !material->m.double_sided) || path_is_caustic(path))
        return vec3_make(0, 0, 0); /* a lamp shines from its front */
    CHARGE_SCOPE(EMISSIVE_MESH);
    /* The parts of a mix are not sampled as lights. */
    sampled = s->instance->light_base >= 0 &&
              material == &path->scene->materials[s->instance->material];
    if (HAS(TEXTURE) && sampled &&
        emitters_is_dark(&path->scene->emitters, (uint32_t)s->instance->light_base + s->triangle))
        return vec3_make(0, 0, 0);
    cosine = fabsf(vec3_dot(s->ng, path->ray.direction));
    radiance = world_emission(material, s->mesh, s->vertex, s->b1, s->b2);
    if (HAS(CLEARCOAT) && material->m.clearcoat > 0)
        radiance = vec3_scale(radiance, world_emission_scale(material, s->mesh, s->vertex,
                                                             s->b1, s->b2, cosine));
    if (path->from_delta || !sampled)
        return radiance;
    way = vec3_sub(s->p, path->context.p);
    light_density = emitters_triangle_pdf(path->scene, &path->context,
                                          (uint32_t)s->instance->light_base + s->triangle,
                                          vec3_length_squared(way), cosine, s->area);
    return vec3_scale(radiance, path_mis_weight(path->density, light_density));
}

/* An unlit material shows its base colour, whatever the light. */
static struct vec3 path_unlit(const struct path *path, const struct surface *s)
{
    const struct scene_material *m = &s->material->m;
    struct vec3 color = vec3_make(m->base_color[0], m->base_color[1], m->base_color[2]);

    if (HAS(TEXTURE) && s->material->base_color.image) {
        struct texel texel = world_slot_lookup(&s->material->base_color, s->mesh, s->vertex, s->b1,
                                               s->b2, s->footprint, 1);
        color = vec3_mul(color, vec3_make(texel.r, texel.g, texel.b));
    }
    if (ACTIVE(path->scene, VERTEX_COLOR) && s->mesh->colors)
        color = vec3_mul(color, surface_vertex_color(s));
    return color;
}

/* ---- the steps of a path ------------------------------------------------------------------ */

/* Kill the path by chance, the likelier the less it carries. `u` in [0,1). */
static int path_survives(struct path *path, uint32_t depth, float u)
{
    float survival;

    if (depth + 1 < path->scene->roulette_depth)
        return 1;
    survival = vec3_max(path->throughput) * path->eta_scale;
    if (survival < 1) {
        survival = float_max(survival, ROULETTE_SURVIVAL_MIN);
        if (!(u < survival))
            return 0;
        path->throughput = vec3_scale(path->throughput, 1 / survival);
    }
    return 1;
}

/* Widen the beam: a direction chosen with this density stands for so much solid angle. */
static void path_widen(struct path *path, float t)
{
    float spread;

    path->cone.width += t * path->cone.spread;
    if (path->from_delta || !(path->density > 0))
        return;
    spread = float_min(CONE_SHARE / sqrtf(path->density), CONE_SPREAD_MAX);
    path->cone.spread = float_max(path->cone.spread, spread);
}

/* The ray goes on from a point on its way, in mid-air. In double: in a dense medium the way may be
 * far shorter than the distance between floats. */
static void path_go_on(struct ray *ray, float distance)
{
    double place[3], direction[3];

    exact_origin(ray, place);
    exact_vec(ray->direction, direction);
    for (int k = 0; k < 3; k++)
        place[k] += direction[k] * (double)distance;
    ray->origin = exact_round(place, ray->rest);
    ray->t_max = INFINITY;
    ray->left_count = 0;
}

/* The medium between the ray's origin and the hit: absorbs, emits, scatters. 1: the path was
 * scattered and goes on from there; 0: it reached the hit; -1: it ended. */
static int path_cross_medium(struct path *path, float t, uint32_t depth, uint32_t dimension,
                             struct vec3 *radiance)
{
    struct medium_random random = {path->sampler, path->medium_key++, 0};
    const struct render_scene *scene = path->scene;
    const struct world_medium *medium;
    struct sample2 direction, numbers;
    struct ray stretch = path->ray;
    struct medium_event event;
    struct vec3 before = path->ray.direction;
    int is_fog;
    uint8_t account;

    STAGE(MEDIUM);
    CHARGE_SCOPE(MEDIUM);
    medium = interior_medium(scene, &path->interior, &is_fog);
    if (!medium)
        return 0;
    account = is_fog ? CHARGE_OF(FOG) : CHARGE_OF(MEDIUM);
    charge_set(account);
    stretch.t_max = is_fog ? float_min(t, path_fog_end(scene, &path->ray)) : t;
    numbers = sampler_get(path->sampler, dimension + VERTEX_MEDIUM);
    if (path->medium_depth > depth) /* a second stretch without a vertex between */
        numbers.u = sampler_hash(path->sampler, random.key, 0xffffffffu);
    path->medium_depth = depth + 1;
    medium_sample(medium, &stretch, numbers.u, &random, &event);
    *radiance = vec3_add(*radiance, vec3_mul(path->throughput, event.emitted));
    path->throughput = vec3_mul(path->throughput, event.weight);
    if (vec3_is_black(path->throughput))
        return -1;
    if (!event.scattered)
        return 0;
    path->stats->vertices++;
    if (depth >= scene->settings.max_depth)
        return -1;
    path_go_on(&path->ray, event.distance);
    if (scene->emitters.count > 0)
        *radiance = vec3_add(*radiance, vec3_mul(path->throughput,
                                                 path_direct_phase(path, medium, before,
                                                                   dimension)));
    STAGE(MEDIUM);
    charge_set(account);
    path->sender = path->bearer = account;
    direction = sampler_get(path->sampler, dimension + VERTEX_BSDF);
    path->ray.direction = medium_phase_sample(medium, before, direction.u, direction.v);
    path->density = medium_phase(medium, vec3_dot(before, path->ray.direction));
    path->from_delta = 0;
    path->scattered = 1;
    path_widen(path, event.distance);
    path->context.p = path->ray.origin;
    path->context.n = vec3_make(0, 0, 0);
    if (!path_survives(path, depth,
                       sampler_get(path->sampler, dimension + VERTEX_LOBE).v))
        return -1;
    return 1;
}

/* The index for the path's wavelength, which is chosen when first needed. */
static float path_dispersed_ior(struct path *path, float ior, float dispersion)
{
    CHARGE_SCOPE(DISPERSION);
    if (!(path->wavelength_nm > 0))
        path->wavelength_nm = wavelength_sample(sampler_get(path->sampler, DIMENSION_TIME).v,
                                                &path->wavelength_rgb);
    return dispersion_ior(ior, dispersion, path->wavelength_nm);
}

/* Straight on past a boundary that is none. */
static void path_pass(struct path *path, const struct surface *s, const struct interior *next)
{
    path->interior = *next;
    path->cone.width += s->t * path->cone.spread;
    surface_leave(s, path->ray.direction, &path->ray);
}

static void path_record_hit(const struct render_scene *scene, const struct surface *s,
                            const struct bsdf_params *params, struct path_record *record)
{
    record->hit = 1;
    record->distance = s->t;
    record->position = s->p;
    record->normal = s->frame.n;
    record->albedo = params->base_color;
    record->instance = (uint32_t)(s->instance - scene->instances);
    record->material = (uint32_t)(s->material - scene->materials);
    record->triangle = s->triangle;
    record->b1 = s->b1;
    record->b2 = s->b2;
    surface_uv(s, &record->u, &record->v);
}

struct vec3 path_radiance(const struct render_scene *scene, const struct sampler *sampler,
                          const struct ray *ray, struct camera_cone cone, struct path_record *record,
                          struct render_stats *stats)
{
    struct path path;
    const int volumes = HAS_VOLUMES && (ACTIVE(scene, MEDIUM) || ACTIVE(scene, INTERFACE) ||
                                        ACTIVE(scene, NESTED_DIELECTRIC));
    const int counted = volumes && ACTIVE(scene, NESTED_DIELECTRIC);
    struct vec3 radiance = {0, 0, 0};
    uint32_t max_depth = scene->settings.max_depth, depth = 0;
    struct hit hit;   /* what the ray met; while `between`: what it is about to meet, where it is */
    int passages = 0, between = 0;

    path.scene = scene;
    path.sampler = sampler;
    path.stats = stats;
    path.ray = *ray;
    path.throughput = vec3_splat(1);
    path.query = (struct path_query){sampler, 0};
    path.context = (struct light_context){{0, 0, 0}, {0, 0, 0}, ray->time};
    path.density = 0;
    path.from_delta = 1; /* the camera chooses like a mirror: nothing competes with it */
    path.scattered = 0;
    path.eta_scale = 1;
    path.cone = cone;
    path.wavelength_nm = 0;
    path.dispersed = 0;
    path.interior.count = 0;
    path.interior.medium = -1;
    if (HAS_VOLUMES)
        path.sender = path.bearer = CHARGE_NOBODY;
    path.medium_key = path.medium_depth = 0;
    if (volumes)
        path.interior = scene->camera_interior;
    for (;;) {
        uint32_t dimension = DIMENSION_VERTEX + depth * DIMENSIONS_PER_VERTEX;
        struct sample2 direction_sample, lobe_sample;
        struct crossing crossing;
        struct bsdf_sample sample;
        struct bsdf_params params;
        struct bsdf bsdf;
        struct surface s;
        struct vec3 wo;
        int met;
        uint8_t scatterer;

        if (HAS_VOLUMES) {
            charge_set(path.bearer);
            crossing.beyond.count = 0;
            crossing.beyond.medium = -1;
        }
        crossing.together = crossing.next_side = 0;
        path.query.ray_number++;
        met = between || path_trace(&path, &path.interior, &path.ray, &hit);
        STAGE(SURFACE);
        if (met) {
            path_surface(&path, &path.ray, &path.query, &hit, &s);
            if (HAS(MATERIAL_MIX) && s.material->m.kind == MATERIAL_MIX)
                surface_resolve_mix(scene, &s,
                                    sampler_get(sampler, dimension + VERTEX_MEDIUM).v);
        }
        if (HAS_VOLUMES) {
            charge_set(path.sender);
            path.bearer = path.sender;
        }
        if (HAS(MEDIUM) && ACTIVE(scene, MEDIUM) && !between) {
            int event = path_cross_medium(&path, met ? s.t : INFINITY, depth, dimension,
                                          &radiance);
            if (event < 0)
                break;
            if (event > 0) {
                depth++;
                continue;
            }
        }
        if (!met) {
            STAGE(LIGHT);
            radiance = vec3_add(radiance, vec3_mul(path.throughput, path_escaped(&path)));
            break;
        }
        if (ACTIVE(scene, ABSORPTION) && !between) {
            const struct world_material *around = path_around(&path, &s, volumes);
            CHARGE_SCOPE(ABSORPTION);
            if (around && !vec3_is_black(around->absorption))
                path.throughput = vec3_mul(path.throughput, path_absorbed(around, s.t));
        }
        if (volumes || (HAS(NESTED_DIELECTRIC) && crossing_touches(&s))) {
            CHARGE_SCOPE_OF(path_keeper(scene));
            crossing_find(scene, &path.ray, &path.query,
                          HAS(MATERIAL_MIX) && crossing_touches(&s)
                              ? sampler_get(sampler, dimension + VERTEX_MEDIUM).v : 0,
                          counted, between, &path.interior, &s, &crossing);
            if (!crossing.real || s.material->m.kind == MATERIAL_INTERFACE) {
                if (++passages > PASSAGES_MAX)
                    break;
                path.bearer = s.material->m.kind == MATERIAL_INTERFACE ? CHARGE_OF(INTERFACE)
                                                                       : charge_get();
                path_pass(&path, &s, &crossing.beyond);
                continue;
            }
        }
        stats->vertices++;
        if (HAS(TEXTURE) && s.material->flags & (MATERIAL_TEXTURED | MATERIAL_NORMAL_MAP))
            s.footprint = (path.cone.width + s.t * path.cone.spread) / sqrtf(s.area);
        if (HAS(UNLIT) && s.material->m.unlit) {
            CHARGE_SCOPE(UNLIT);
            radiance = vec3_add(radiance, vec3_mul(path.throughput, path_unlit(&path, &s)));
            if (record && !record->hit && depth == 0) {
                surface_shade(scene, &s, vec3_neg(path.ray.direction), &params);
                path_record_hit(scene, &s, &params, record);
            }
            break;
        }
        STAGE(LIGHT);
        if (HAS(EMISSIVE_MESH))
            radiance = vec3_add(radiance, vec3_mul(path.throughput, path_emitted(&path, &s)));
        if (depth >= max_depth && !record)
            break;

        STAGE(SURFACE);
        surface_shade(scene, &s, vec3_neg(path.ray.direction), &params);
        if (record && depth == 0)
            path_record_hit(scene, &s, &params, record);
        if (depth >= max_depth)
            break;
        if (HAS(NESTED_DIELECTRIC) && crossing.together)
            params.ior = crossing.ior;
        else if (counted && s.material->flags & MATERIAL_BOUNDS)
            params.ior = interior_filling(scene, s.instance->body)->m.ior;
        if (HAS(DISPERSION) && ACTIVE(scene, DISPERSION) && s.material->m.dispersion > 0 &&
            params.refractive)
            params.ior = path_dispersed_ior(&path, params.ior, s.material->m.dispersion);
        if (counted) {
            CHARGE_SCOPE(NESTED_DIELECTRIC);
            params.ior_outside = interior_ior(scene, s.front ? &path.interior : &crossing.beyond);
        }
        wo = frame_to_local(&s.frame, vec3_neg(path.ray.direction));
        if (!(wo.z > 0))
            break;
        STAGE(SCATTER);
        bsdf_init(&bsdf, &params, wo); /* charges what scatters */
        scatterer = charge_get();
        if (bsdf.has_smooth && scene->emitters.count > 0)
            radiance = vec3_add(
                radiance, vec3_mul(path.throughput,
                                   path_direct_light(&path, &s, &bsdf, wo, dimension,
                                                     &crossing, scatterer)));

        STAGE(SCATTER);
        charge_set(scatterer);
        direction_sample = sampler_get(sampler, dimension + VERTEX_BSDF);
        lobe_sample = sampler_get(sampler, dimension + VERTEX_LOBE);
        if (!bsdf_sample(&bsdf, wo, lobe_sample.u, direction_sample.u, direction_sample.v, &sample))
            break;
        if (HAS_VOLUMES)
            path.sender = path.bearer = charge_get(); /* the lobe */
        path.ray.direction = vec3_normalize(frame_to_world(&s.frame, sample.wi));
        if ((vec3_dot(path.ray.direction, s.ng) > 0) != (sample.wi.z > 0))
            break;
        path.throughput = vec3_mul(path.throughput, sample.weight);
        /* What is reflected has the wavelength's colour, too: its share depends on the index. */
        if (HAS(DISPERSION) && path.wavelength_nm > 0 && !path.dispersed &&
            s.material->m.dispersion > 0 && params.refractive) {
            path.throughput = vec3_mul(path.throughput, path.wavelength_rgb);
            path.dispersed = 1;
        }
        if (volumes && sample.wi.z < 0)
            path.interior = crossing.beyond;
        path.eta_scale *= sample.eta_scale;
        path.from_delta = (sample.flags & BSDF_DELTA) != 0;
        path.scattered |= !path.from_delta;
        path.density = sample.pdf;
        if (!path_survives(&path, depth, lobe_sample.v))
            break;
        if (vec3_is_black(path.throughput))
            break;
        if (ACTIVE(scene, TEXTURE))
            path_widen(&path, s.t);
        path.context.p = s.p;
        path.context.n = s.material->flags & MATERIAL_TWO_WAY ? vec3_make(0, 0, 0) : s.ng;
        surface_leave(&s, path.ray.direction, &path.ray);
        between = path_meets_next(&crossing, sample.wi);
        if (between) {
            path.ray.left_count = 0; /* the faces at this place are looked for again */
            hit = crossing.next;
        }
        depth++;
    }
    return radiance;
}
