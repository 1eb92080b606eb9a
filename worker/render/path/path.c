#include "worker/render/path/path.h"

#include "worker/render/path/path_parts.h"

/* Russian roulette ends a path with a probability of at most 95 %. */
#define ROULETTE_SURVIVAL_MIN REAL(0.05)
/* After a scattering event the beam widens by this share of the spacing of such samples, and by at
 * most this much per metre. */
#define CONE_SHARE 0.25f
#define CONE_SPREAD_MAX 0.25f

static void path_start(struct path *path, const struct render_scene *scene,
                       const struct sampler *sampler, const struct ray *ray,
                       struct camera_cone cone, struct render_stats *stats)
{
    path->scene = scene;
    path->sampler = sampler;
    path->stats = stats;
    path->query = (struct path_query){sampler, 0};
    path->throughput = vec3_splat(1);
    path->depth = path->marks = 0;
    path->mark = scene->settings.max_depth / 4;
    path->ray = *ray;
    path->context = (struct light_context){{0, 0, 0}, {0, 0, 0}, ray->time};
    path->pdf = 0;
    path->specular = 1;
    path->any_diffuse = 0;
    path->eta_scale = 1;
    path->cone = cone;
    path->wavelength_nm = 0;
    path->dispersed = 0;
    path->interior.count = 0;
    path->interior.medium = -1;
    if (path_features_of(scene).volumes)
        path->interior = scene->camera_interior;
    path->boundaries_passed = 0;
    path->medium_key = path->medium_depth = 0;
    path->at_next = 0;
    if (FAULT(ENDLESS_PATH))
        path->depth = SETTINGS_DEPTH_MAX;
}

PATH_FUNCTION __attribute__((noinline)) void path_mark(struct path *path, struct vec3 radiance)
{
    const uint32_t max = path->scene->settings.max_depth;
    const uint32_t marks[] = {max / 4, max / 2, max, UINT32_MAX}; /* of DEPTH_QUARTER, _HALF, _ENDED */
    const real carried = vec3_luminance(path->throughput) * path->eta_scale; /* as if it were outside of glass */

    for (; path->depth >= marks[path->marks]; path->marks++) {
        if (carried >= 0 && carried < INFINITY)
            path->stats->depth.sum[DEPTH_QUARTER + path->marks] += (double)carried;
        if (DEPTH_QUARTER + path->marks == DEPTH_HALF)
            path->at_half = vec3_luminance(radiance);
    }
    path->mark = marks[path->marks];
}

/* What the path has brought since the mark of half the depth. */
static void path_count_gathered(struct path *path, struct vec3 radiance)
{
    const real more = vec3_luminance(radiance) - path->at_half;

    if (DEPTH_QUARTER + path->marks > DEPTH_HALF && more > 0 && more < INFINITY)
        path->stats->depth.sum[DEPTH_GATHERED] += (double)more;
}

/* What a path carries stays bad once it is, so it is looked at once, where the path ends. */
static inline void path_examine(const struct path *path)
{
    const struct vec3 t = path->throughput;

    if (path->boundaries_passed > INDEX_MATCHED_MAX)
        RECORD_END(BOUNDARIES);
    RECORD_END(BLACK);
    if (!(t.x + t.y + t.z < INFINITY))
        health_note(HEALTH_BAD_THROUGHPUTS);
    if (!(vec3_length_squared(path->ray.direction) > 0.5f)) /* of no number a normalised vector is 0 */
        health_note(HEALTH_BAD_DIRECTIONS);
    if (path->depth >= SETTINGS_DEPTH_MAX)
        health_note(HEALTH_GUARDED_PATHS);
}

/* The vertex scatters nothing: is that its basis' fault? */
static __attribute__((noinline)) int path_vertex_fails(const struct basis *basis)
{
    return health_basis(basis);
}

/* ---- the steps of a path --------------------------------------------------------------------- */

/* Trace the path's ray; 0: it escapes. */
static int path_intersect(struct path *path, struct path_vertex *v)
{
    v->dimension = DIMENSION_VERTEX + path->depth * DIMENSIONS_PER_VERTEX;
    path->query.ray_number++;
    if (!path->at_next && !path_trace(path, &path->interior, &path->ray, &path->hit))
        return 0;
    PROFILE_STAGE(SURFACE);
    crossing_first(path->scene, &path->ray, &path->query, &path->hit, &v->s);
    if (path_features_of(path->scene).mixes && v->s.material->m.kind == MATERIAL_MIX)
        surface_resolve_mix(path->scene, &v->s,
                            sampler_get(path->sampler, v->dimension + VERTEX_MEDIUM).v);
    return 1;
}

/* The crossing of a vertex that crosses no boundary. */
static void crossing_none(struct crossing *crossing)
{
    crossing->beyond.count = 0;
    crossing->beyond.medium = -1;
    crossing->together = crossing->next_side = 0;
}

/* The material's values at the vertex. At the path's first vertex they go into `record`, if given.
 * */
static void path_shade(const struct path *path, struct path_vertex *v, struct path_record *record)
{
    const struct render_scene *scene = path->scene;
    const struct surface *s = &v->s;

    PROFILE_STAGE(SURFACE);
    surface_shade(scene, &v->s, vec3_neg(path->ray.direction), &v->params);
    if (!record || path->depth > 0)
        return;
    record->hit = 1;
    record->distance = s->t;
    record->position = world_outside(scene, s->p, s->rest);
    record->normal = s->basis.n;
    record->albedo = v->params.base_color;
    record->instance = (uint32_t)(s->instance - scene->instances);
    record->material = (uint32_t)(s->material - scene->materials);
    record->triangle = surface_locate(scene, &v->s);
    record->b1 = s->b1;
    record->b2 = s->b2;
    surface_uv(s, &record->u, &record->v);
}

/* The BSDF of the shaded vertex. 0: seen from behind the shading normal, where it scatters nothing.
 * */
static int path_bsdf(struct path *path, struct path_vertex *v)
{
    path_indices(path, v);
    if (FAULT(NAN_BASIS))
        v->s.basis.n.x = NAN;
    v->wo = basis_to_local(&v->s.basis, vec3_neg(path->ray.direction));
    if (!(v->wo.z > 0)) {
        RECORD_END(BEHIND);
        return path_vertex_fails(&v->s.basis);
    }
    PROFILE_STAGE(SCATTER);
    bsdf_init(&v->bsdf, &v->params, v->wo);
    return 1;
}

static int sample_bsdf(const struct path *path, const struct path_vertex *v, real u_lobe,
                       struct bsdf_sample *sample)
{
    struct sample2 u = sampler_get(path->sampler, v->dimension + VERTEX_BSDF);

    PROFILE_STAGE(SCATTER);
    return bsdf_sample(&v->bsdf, v->wo, u_lobe, u.u, u.v, sample);
}

/* Sample the path's next direction from the BSDF. 0: the path is absorbed. */
static int path_scatter(struct path *path, const struct path_vertex *v, real u_lobe,
                        struct bsdf_sample *sample)
{
    const struct path_features f = path_features_of(path->scene);

    if (!sample_bsdf(path, v, u_lobe, sample)) {
        RECORD_END(ABSORBED);
        return path_vertex_fails(&v->s.basis);
    }
    if (FAULT(NAN_DIRECTION))
        sample->wi.x = NAN;
    if (FAULT(NAN_THROUGHPUT))
        sample->weight.x = NAN;
    path->ray.direction = vec3_normalize(basis_to_world(&v->s.basis, sample->wi));
    RECORD(record_direction(path, sample->weight, sample->pdf, sample->flags & BSDF_DELTA));
    if (!path_keeps_side(&v->s, path->ray.direction, sample->wi)) {
        RECORD_END(SIDE);
        return 0;
    }
    path->throughput = vec3_mul(path->throughput, sample->weight);
    /* Reflection takes the wavelength's colour too: its share depends on the index of refraction.
     * */
    if (f.dispersion && path_disperses_at(path, &v->s)) {
        path->throughput = vec3_mul(path->throughput, path->wavelength_rgb);
        path->dispersed = 1;
    }
    if (f.volumes && sample->wi.z < 0)
        path->interior = v->crossing.beyond;
    path->eta_scale *= sample->eta_scale;
    path->specular = (sample->flags & BSDF_DELTA) != 0;
    path->any_diffuse |= !path->specular;
    path->pdf = sample->pdf;
    return 1;
}

/* What is left of the light. Radiance shrinks by eta^2 where it enters a denser medium, and grows
 * again where it leaves: that is no reason to end a path. */
static real path_left(const struct path *path)
{
    return vec3_max(path->throughput) * (SAFEGUARD(ROULETTE_ETA) ? path->eta_scale : 1);
}

/* This bounds the weight of what survives. */
static real at_least_survival(real survival)
{
    return SAFEGUARD(ROULETTE_FLOOR) ? real_max(survival, ROULETTE_SURVIVAL_MIN) : survival;
}

PATH_FUNCTION int russian_roulette(struct path *path, real u)
{
    real survival;

    if (path->depth + 1 < path->scene->roulette_depth)
        return 1;
    survival = path_left(path);
    if (survival < 1) {
        survival = at_least_survival(survival);
        RECORD(recorded->survival = survival);
        if (!(u < survival)) {
            RECORD_END(ROULETTE);
            return 0;
        }
        path->throughput = vec3_scale(path->throughput, 1 / survival);
    }
    return 1;
}

PATH_FUNCTION void path_widen(struct path *path, real t)
{
    real spread;

    path->cone.width += t * path->cone.spread;
    if (path->specular || !(path->pdf > 0))
        return;
    spread = real_min(CONE_SHARE / real_sqrt(path->pdf), CONE_SPREAD_MAX);
    path->cone.spread = real_max(path->cone.spread, spread);
}

/* Leave the vertex towards wi and prepare the next ray. */
static void path_next_ray(struct path *path, const struct path_vertex *v, struct vec3 wi)
{
    const struct surface *s = &v->s;

    if (path_features_of(path->scene).textures)
        path_widen(path, s->t);
    path->context.p = s->p;
    path->context.n = s->material->flags & MATERIAL_TWO_WAY ? vec3_splat(0) : s->ng;
    surface_leave(s, path->ray.direction, &path->ray);
    path->at_next = path_meets_coincident(path, &v->crossing, wi);
    if (path->at_next) {
        path->ray.left_count = 0; /* coincident faces here are searched again */
        path->hit = v->crossing.next;
    }
    path->depth++;
}

/* With alpha, what lies behind everything is not in the picture. */
static inline int path_is_cut_out(const struct render_scene *scene)
{
    return scene->settings.aovs >> AOV_ALPHA & 1;
}

/* ---- the path -------------------------------------------------------------------------------- */

struct vec3 path_radiance(const struct render_scene *scene, const struct sampler *sampler,
                          const struct ray *ray, struct camera_cone cone,
                          struct path_record *record, struct render_stats *stats)
{
    const struct path_features f = path_features_of(scene);
    struct vec3 radiance = {0, 0, 0};
    struct path path;

    path_start(&path, scene, sampler, ray, cone, stats);
    while (path.boundaries_passed <= INDEX_MATCHED_MAX) {
        struct bsdf_sample sample;
        struct path_vertex v;
        struct sample2 u;
        int met = path_intersect(&path, &v), ends;

        RECORD_BEGIN(&path, met, &v);
        /* What lies between the vertices. */
        if (f.media && !path.at_next) {
            enum medium_outcome outcome = path_medium(&path, met ? v.s.t : INFINITY, v.dimension,
                                                      &radiance);
            if (outcome == MEDIUM_ENDED)
                break;
            if (outcome == MEDIUM_SCATTERED)
                continue;
        }
        if (!met) {
            if (record && path.depth == 0)
                record->passed = (path.throughput.x + path.throughput.y + path.throughput.z) / 3;
            if (path.depth > 0 || !path_is_cut_out(scene))
                path_add(&path, path_escaped(&path), &radiance);
            RECORD_END(ESCAPED);
            break;
        }
        if (f.absorption && !path.at_next)
            path_absorb(&path, &v.s);
        if (f.coincident)
            crossing_none(&v.crossing);
        if ((f.volumes || (f.coincident && crossing_touches(&v.s))) && !path_boundary(&path, &v))
            continue;

        /* Emission. */
        stats->vertices++;
        RECORD(record_surface(&path, &v));
        if (v.s.material->flags & (MATERIAL_TEXTURED | MATERIAL_NORMAL_MAP))
            v.s.footprint = (path.cone.width + v.s.t * path.cone.spread) / real_sqrt(v.s.area);
        path_add(&path, path_emitted(&path, &v.s), &radiance);
        if (path.depth >= path.mark && !path_is_unlit(&path, &v.s))
            path_mark(&path, radiance);
        ends = path.depth >= scene->settings.max_depth || path_is_unlit(&path, &v.s);
        if (path_is_unlit(&path, &v.s))
            RECORD_END(UNLIT);
        else if (ends)
            RECORD_END(DEPTH);
        if (ends && !record)
            break;

        /* Scattering: next-event estimation, and a direction for the next ray. */
        path_shade(&path, &v, record);
        RECORD(recorded->ns = v.s.basis.n);
        if (ends || !path_bsdf(&path, &v))
            break;
        if (v.bsdf.has_smooth && scene->emitters.count > 0)
            path_add(&path, path_direct_surface(&path, &v), &radiance);
        u = sampler_get(sampler, v.dimension + VERTEX_LOBE);
        if (!path_scatter(&path, &v, u.u, &sample))
            break;
        if (!russian_roulette(&path, u.v) || vec3_is_black(path.throughput))
            break;
        path_next_ray(&path, &v, sample.wi);
    }
    path_examine(&path);
    path_count_gathered(&path, radiance);
    return radiance;
}
