/* path_volumes: what a path meets between surfaces, and which volumes it is in.
 *
 * Media are sampled by free paths (medium.h). Refractive objects absorb by the Beer-Lambert law. Overlapping bodies are
 * resolved by priority (interior.h); coincident faces are crossed as one (crossing.h).
 */
#include "common/base/safeguard.h"
#include "common/math/elementary.h"
#include "worker/render/bsdf/dispersion.h"
#include "worker/render/base/exact.h"
#include "worker/render/path/path_parts.h"

/* ---- media ----------------------------------------------------------------------------------- */

/* The medium around a ray, NULL: none. */
static const struct render_medium *interior_medium(const struct render_scene *scene, const struct interior *in,
                                                   int *is_fog)
{
    const struct render_material *around;
    int32_t medium = in->medium;

    if (scene->volume_rule == VOLUMES_NESTED) {
        around = interior_around(scene, in);
        medium = around ? around->m.medium : scene->fog;
        *is_fog = !around;
    } else {
        *is_fog = medium == scene->fog;
    }
    if (medium < 0 || (*is_fog && !calls_for(scene->effects, EFFECT_FOG)))
        return NULL;
    return scene->media[medium];
}

/* Fog ends at the scene's bounding sphere: the distance along the ray. */
static real fog_end(const struct render_scene *scene, const struct ray *ray)
{
    struct vec3 to = vec3_sub(scene->bounds_centre, ray->origin);
    real along = vec3_dot(to, ray->direction);
    real beside = vec3_length_squared(vec3_mad(to, ray->direction, -along));
    real half = scene->fog_radius * scene->fog_radius - beside;

    return half > 0 ? real_max(along + real_sqrt(half), 0) : 0;
}

static uint8_t medium_account(int is_fog) { return is_fog ? PROFILE_ACCOUNT(FOG) : PROFILE_ACCOUNT(MEDIUM); }

/* Move the ray's origin along it to a point in mid-air. In double: in a dense medium the step may
 * be far shorter than the spacing of floats. */
static void ray_advance(struct ray *ray, real distance)
{
    double place[3], direction[3];

    exact_origin(ray, place);
    exact_vec(ray->direction, direction);
    for (int k = 0; k < 3; k++)
        place[k] += direction[k] * (double)distance;
    ray->origin = exact_round(place, ray->rest);
    if (!SAFEGUARD(MEDIUM_STEP))
        ray->rest[0] = ray->rest[1] = ray->rest[2] = 0;
    ray->t_max = INFINITY;
    ray->left_count = 0;
}

/* How far light gets along the path's ray, at most `t` metres, and what the segment emits. */
static void sample_medium(struct path *path, const struct path_vertex *v, int is_fog, real t, uint32_t key,
                          struct medium_event *event)
{
    struct medium_random random = {path->sampler, key, 0};
    struct ray stretch = path->ray;
    real first = sampler_get(path->sampler, v->dimension + VERTEX_MEDIUM).u;

    PROFILE_STAGE_EFFECT(MEDIUM, medium_account(is_fog));
    stretch.t_max = is_fog ? real_min(t, fog_end(path->scene, &path->ray)) : t;
    if (path->between.depth > path->depth) /* a second segment without a vertex between */
        first = sampler_hash(path->sampler, key, 0xffffffffu);
    path->between.depth = path->depth + 1;
    medium_sample(v->medium, &stretch, first, &random, event);
}

/* The vertex in the medium: next-event estimation, a direction by the phase function, Russian roulette. */
static enum path_end scatter_in_medium(struct path *path, struct path_vertex *v, struct path_notes *notes)
{
    const struct sample2 u = sampler_get(path->sampler, v->dimension + VERTEX_BSDF);
    const struct vec3 before = path->ray.direction;

    path->stats->work.vertices++;
    if (path->depth >= path->tally.mark)
        path_mark(path);
    if (path->depth >= path->scene->settings.max_depth)
        return PATH_MEDIUM_DEPTH;
    ray_advance(&path->ray, v->medium_t);
    if (path->scene->emitters.count > 0)
        path_add(path, notes, FROM_LIGHT, path_direct_medium(path, v, notes, before));
    PROFILE_STAGE(MEDIUM);
    path->ray.direction = medium_phase_sample(v->medium, before, u.u, u.v);
    path->pdf = medium_phase(v->medium, vec3_dot(before, path->ray.direction));
    path->specular = 0;
    path->caustics.chain = CHAIN_NONE;
    path->caustics.any_diffuse = 1;
    path_widen(path, v->medium_t);
    path->context.p = path->ray.origin;
    path->context.n = vec3_make(0, 0, 0);
    if (roulette_has_begun(path) &&
        !russian_roulette(path, notes, sampler_get(path->sampler, v->dimension + VERTEX_LOBE).v))
        return PATH_ROULETTE;
    path->depth++;
    return PATH_GOES_ON;
}

enum path_end path_medium(struct path *path, struct path_vertex *v, struct path_notes *notes, real t)
{
    const uint32_t key = path->between.key++;
    struct medium_event event;
    int is_fog;

    v->medium = interior_medium(path->scene, &path->interior, &is_fog);
    if (!v->medium)
        return PATH_GOES_ON;
    if (path->depth == 0)
        path->tally.sight = SIGHT_MEDIUM;
    sample_medium(path, v, is_fog, t, key, &event);
    path_add(path, notes, FROM_MEDIUM, event.emitted);
    path->throughput = vec3_mul(path->throughput, event.weight);
    if (!event.scattered && !vec3_is_black(path->throughput))
        return PATH_GOES_ON;
    v->met = PATH_MET_MEDIUM;
    notes->throughput = path->throughput;
    v->medium_t = event.distance;
    return vec3_is_black(path->throughput) ? PATH_BLACK : scatter_in_medium(path, v, notes);
}

static struct vec3 beer_lambert(struct vec3 a, real distance)
{
    return vec3_make(a.x > 0 ? real_exp(-a.x * distance) : 1, a.y > 0 ? real_exp(-a.y * distance) : 1,
                     a.z > 0 ? real_exp(-a.z * distance) : 1);
}

struct vec3 path_filling_transmittance(const struct render_scene *scene, const struct interior *in, real t)
{
    const struct render_material *filling = path_knows_filling(scene) ? interior_around(scene, in) : NULL;

    return filling && t < INFINITY ? beer_lambert(filling->absorption, t) : vec3_splat(1);
}

/* Transmittance of the medium along a shadow ray's segment, up to `t` metres. */
static struct vec3 stretch_transmittance(const struct render_scene *scene, const struct interior *in,
                                         const struct ray *stretch, real t, struct medium_random *random)
{
    struct ray through = *stretch;
    const struct render_medium *medium;
    int is_fog;

    medium = interior_medium(scene, in, &is_fog);
    if (!medium)
        return vec3_splat(1);
    PROFILE_STAGE_EFFECT(MEDIUM, medium_account(is_fog));
    through.t_max = is_fog ? real_min(t, fog_end(scene, stretch)) : t;
    return medium_transmittance(medium, &through, random);
}

__attribute__((noinline)) struct vec3 path_transmittance(struct path *path, const struct ray *ray)
{
    const struct render_scene *scene = path->scene;
    struct vec3 visible = {1, 1, 1};
    struct interior in = path->interior;
    struct ray stretch = *ray;
    real left = ray->t_max;

    for (int i = 0; i < INDEX_MATCHED_MAX; i++) {
        struct medium_random random = {path->sampler, path->between.key++, 0};
        struct crossing crossing;
        struct surface s;
        struct hit hit;
        int met = path_trace(path, &in, &stretch, &hit);

        if (met) {
            crossing_first(scene, &stretch, &path->query, &hit, &s);
            surface_resolve_mix(scene, &s, 0);
            if (s.material->m.kind != MATERIAL_INTERFACE)
                return vec3_splat(0);
        }
        visible = vec3_mul(visible, stretch_transmittance(scene, &in, &stretch, met ? s.t : stretch.t_max, &random));
        if (calls_for(scene->effects, EFFECT_ABSORPTION))
            visible = vec3_mul(visible, path_filling_transmittance(scene, &in, met ? s.t : stretch.t_max));
        if (!met || vec3_is_black(visible))
            return visible;
        crossing_find(scene, &stretch, &path->query, 0, 0, 0, &in, &s, &crossing);
        if (s.material->m.kind != MATERIAL_INTERFACE)
            return vec3_splat(0);
        in = crossing.beyond;
        surface_leave(&s, ray->direction, &stretch);
        stretch.reaches = ray->reaches;
        stretch.t_max = left -= s.t;
        if (!(left > 0))
            return visible;
        path->query.ray_number++;
    }
    health_note(HEALTH_GUARDED_PATHS);
    return vec3_splat(0);
}

/* ---- refractive objects ---------------------------------------------------------------------- */

/* The body that contains the segment that ends at the surface; NULL: unknown. */
static const struct render_material *stretch_filling(const struct path *path, const struct surface *s)
{
    if (path_knows_filling(path->scene))
        return interior_around(path->scene, &path->interior);
    return !s->front && s->material->m.refractive ? s->material : NULL;
}

void path_absorb(struct path *path, const struct surface *s)
{
    const struct render_material *filling = stretch_filling(path, s);

    if (!filling || vec3_is_black(filling->absorption))
        return;
    PROFILE_STAGE_EFFECT(MEDIUM, PROFILE_ACCOUNT(ABSORPTION));
    path->throughput = vec3_mul(path->throughput, beer_lambert(filling->absorption, s->t));
}

int path_boundary(struct path *path, struct path_vertex *v)
{
    real mix = calls_for(path->scene->effects, EFFECT_MATERIAL_MIX) && crossing_touches(&v->s)
                    ? sampler_get(path->sampler, v->dimension + VERTEX_MEDIUM).v : 0;

    crossing_find(path->scene, &path->ray, &path->query, mix, calls_for(path->scene->effects, EFFECT_NESTED_DIELECTRIC),
                  path->next.there, &path->interior, &v->s, &v->crossing);
    if (v->crossing.is_boundary && v->s.material->m.kind != MATERIAL_INTERFACE)
        return 1;
    v->met = PATH_MET_BOUNDARY;
    path->between.boundaries++;
    path->interior = v->crossing.beyond;
    path->cone.width += v->s.t * path->cone.spread;
    surface_leave(&v->s, path->ray.direction, &path->ray);
    return 0;
}

/* The index for the path's wavelength, which is sampled when it is first needed. */
static real dispersed_ior(struct path *path, real ior, real dispersion)
{
    if (!(path->wavelength.nm > 0))
        path->wavelength.nm = wavelength_sample(sampler_get(path->sampler, DIMENSION_TIME).v, &path->wavelength.rgb);
    return dispersion_ior(ior, dispersion, path->wavelength.nm);
}

void path_indices(struct path *path, struct path_vertex *v)
{
    const struct render_material *material = v->s.material;

    if (calls_for(EFFECTS_ALL, COINCIDENT_EFFECTS) && v->crossing.together)
        v->params.ior = v->crossing.ior;
    else if (calls_for(path->scene->effects, EFFECT_NESTED_DIELECTRIC) && material->flags & MATERIAL_BOUNDS)
        v->params.ior = interior_filling(path->scene, v->s.instance->body)->m.ior;
    if (calls_for(path->scene->effects, EFFECT_DISPERSION) && material->m.dispersion > 0 && v->params.refractive)
        v->params.ior = dispersed_ior(path, v->params.ior, material->m.dispersion);
    if (calls_for(path->scene->effects, EFFECT_NESTED_DIELECTRIC))
        v->params.ior_outside = interior_ior(path->scene, v->s.front ? &path->interior : &v->crossing.beyond);
}
