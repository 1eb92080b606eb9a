/* path: light transport, one path at a time. This file reads from top to bottom: the loop, what happens at a vertex, its
 * steps.
 *
 * What leaves a point p towards w_o is what it emits, and what it scatters of the light that arrives there (Kajiya 1986;
 * section 13.1 of Pharr, Jakob and Humphreys, "Physically Based Rendering", fourth edition, here PBR):
 *
 *     L(p, w_o) = L_e(p, w_o) + integral over all w_i of f(p, w_o, w_i) L(p', -w_i) |cos w_i|
 *
 * where p' is what a ray from p in the direction w_i meets. With the same equation for L(p') in the integral, and so on, L is a
 * sum over paths of all lengths from the camera on (PBR 13.1.4). One path estimates it: at each vertex it draws one w_i with
 * density pdf, and carries on
 *
 *     throughput = product over the vertices so far of f |cos| / pdf
 *     radiance   = sum over the vertices so far of throughput * (what is emitted, and scattered of one light)
 *
 * Between vertices a medium absorbs, scatters and emits: the equation of transfer (PBR 14.1), of which a vertex in mid-air is
 * one more kind.
 *
 *     step of path_visit     what it is                                                     from
 *     intersect              p', the nearest surface along the ray
 *     path_medium            a vertex in mid-air before it, by free paths                   PBR 14.1
 *     path_absorb            what coloured glass leaves of the light (Beer-Lambert)         PBR 11.2
 *     path_boundary          which of overlapping bodies the ray enters or leaves           Schmidt and Budge 2002
 *     path_emitted           L_e of the surface; path_escaped: of the environment. Light
 *                            that the last vertex could have asked for has a weight         Veach 1997, 9
 *     find_bsdf              f: the material at p, its textures and normal                  PBR 9
 *     path_direct_surface    next-event estimation: one light is chosen, and what p
 *                            scatters of it is weighted against finding it by chance        PBR 12.6, 13.4
 *     path_caustic           light of a small lamp by way of one smooth surface             Hanika, Droske, Fascione 2015
 *     path_scatter           w_i drawn from f, and f |cos| / pdf                            PBR 9.1, 13.3
 *     russian_roulette       paths that carry little end at random; others carry more       Arvo and Kirk 1990; PBR 2.2.4
 *     path_next_ray          the ray from p along w_i, off the face without an offset
 *
 * An effect that the frame does not call for costs nothing: calls_for (gate.h) is false at compile time where a kernel
 * lacks it.
 */
#include "worker/render/path/path.h"

#include <stddef.h>
#include <string.h>

#include "worker/render/path/kernel.h"
#include "worker/render/path/path_parts.h"
#include "worker/render/path/path_sink.h"

static void path_start(struct path *path, const struct render_scene *scene, const struct sampler *sampler,
                       const struct ray *ray, struct camera_cone cone, struct render_stats *stats);
static enum path_end path_visit(struct path *path, struct path_vertex *v, struct path_notes *notes);
static int intersect(struct path *path, struct path_vertex *v);
static int find_bsdf(struct path *path, struct path_vertex *v);
static enum path_end path_scatter(struct path *path, struct path_vertex *v, real u_lobe);
static void path_next_ray(struct path *path, const struct path_vertex *v, struct vec3 wi);

/* ---- the path -------------------------------------------------------------------------------- */

struct vec3 path_radiance(const struct render_scene *scene, const struct sampler *sampler, const struct ray *ray,
                          struct camera_cone cone, struct path_record *record, struct render_stats *stats)
{
    struct path path;
    enum path_end end;

    path_start(&path, scene, sampler, ray, cone, stats);
    do {
        struct path_notes notes;
        struct path_vertex v;

        sink_vertex_begins(&path, &v, &notes);
        end = path_visit(&path, &v, &notes);
        sink_vertex(&path, &v, &notes, end, record);
    } while (end == PATH_GOES_ON);
    sink_path(&path, end);
    return path.radiance;
}

/* With alpha, what lies behind everything is not in the picture. */
static inline int path_is_cut_out(const struct render_scene *scene) { return scene->settings.aovs >> AOV_ALPHA & 1; }

/* Follow the path's ray to its next vertex: what it brings from there, and where it goes on. */
static inline __attribute__((always_inline)) enum path_end path_visit(struct path *path, struct path_vertex *v,
                                                                      struct path_notes *notes)
{
    const struct render_scene *scene = path->scene;
    const int met = intersect(path, v);
    struct sample2 u = {0, 0};
    enum path_end end;

    /* What lies between the vertices. */
    v->met = met ? PATH_MET_SURFACE : PATH_MET_ESCAPE;
    if (calls_for(scene->effects, EFFECT_MEDIUM) && !path->next.there) {
        end = path_medium(path, v, notes, met ? v->s.t : INFINITY);
        if (v->met == PATH_MET_MEDIUM)
            return end;
    }
    notes->throughput = path->throughput;
    if (!met) {
        path->stats->work.escaped_rays++;
        if (path->depth > 0 || !path_is_cut_out(scene))
            path_add(path, notes, FROM_PATH, path_escaped(path, notes));
        return PATH_ESCAPED;
    }
    if (calls_for(scene->effects, EFFECT_ABSORPTION) && !path->next.there)
        path_absorb(path, &v->s);
    notes->throughput = path->throughput;
    if (calls_for(EFFECTS_ALL, COINCIDENT_EFFECTS))
        path_crossing_none(&v->crossing);
    if ((calls_for(scene->effects, VOLUME_EFFECTS) ||
         (calls_for(EFFECTS_ALL, COINCIDENT_EFFECTS) && crossing_touches(&v->s))) &&
        !path_boundary(path, v))
        return path->between.boundaries > INDEX_MATCHED_MAX ? PATH_BOUNDARIES : PATH_GOES_ON;

    /* Emission. */
    path->stats->work.vertices++;
    if (v->s.material->flags & (MATERIAL_TEXTURED | MATERIAL_NORMAL_MAP))
        v->s.footprint = (path->cone.width + v->s.t * path->cone.spread) / real_sqrt(v->s.area);
    path_add(path, notes, FROM_PATH, path_emitted(path, &v->s, notes));
    sink_sight(path);
    if (path_is_unlit(path, &v->s))
        return PATH_UNLIT;
    if (path->depth >= path->tally.mark)
        path_mark(path);
    if (path->depth >= scene->settings.max_depth)
        return PATH_DEPTH;

    /* Scattering: next-event estimation, and a direction for the next ray. */
    if (!find_bsdf(path, v))
        return PATH_BEHIND;
    if (v->bsdf.has_smooth && scene->emitters.count > 0)
        path_add(path, notes, FROM_LIGHT, path_direct_surface(path, v, notes));
    if (calls_for(scene->effects, EFFECT_CAUSTICS) && scene->casters && v->bsdf.has_smooth &&
        path->depth + 1 < scene->settings.max_depth)
        path_add(path, notes, FROM_CASTER, path_caustic(path, v));
    if (v->bsdf.kind != BSDF_KIND_LAMBERT || roulette_has_begun(path)) /* a single lobe takes no number */
        u = sampler_get(path->sampler, v->dimension + VERTEX_LOBE);
    end = path_scatter(path, v, u.u);
    if (end != PATH_GOES_ON)
        return end;
    if (roulette_has_begun(path) && !russian_roulette(path, notes, u.v))
        return PATH_ROULETTE;
    if (vec3_is_black(path->throughput))
        return PATH_BLACK;
    path_next_ray(path, v, v->sample.wi);
    return PATH_GOES_ON;
}

/* ---- the steps of a path --------------------------------------------------------------------- */

static inline __attribute__((always_inline)) int intersect(struct path *path, struct path_vertex *v)
{
    v->dimension = DIMENSION_VERTEX + path->depth * DIMENSIONS_PER_VERTEX;
    path->query.ray_number++;
    if (!path->next.there && !path_trace(path, &path->interior, &path->ray, &path->next.hit))
        return 0;
    crossing_first(path->scene, &path->ray, &path->query, &path->next.hit, &v->s);
    if (calls_for(path->scene->effects, EFFECT_MATERIAL_MIX) && v->s.material->m.kind == MATERIAL_MIX)
        surface_resolve_mix(path->scene, &v->s, sampler_get(path->sampler, v->dimension + VERTEX_MEDIUM).v);
    return 1;
}

__attribute__((noinline)) int path_intersect(struct path *path, struct path_vertex *v) { return intersect(path, v); }

void path_crossing_none(struct crossing *crossing)
{
    crossing->beyond.count = 0;
    crossing->beyond.medium = -1;
    crossing->together = crossing->next_side = 0;
}

static inline __attribute__((always_inline)) int find_bsdf(struct path *path, struct path_vertex *v)
{
    const struct vec3 back = vec3_neg(path->ray.direction);

    surface_shade(path->scene, &v->s, back, &v->params);
    path_indices(path, v);
    v->wo = basis_to_local(&v->s.basis, back);
    if (!(v->wo.z > 0))
        return 0;
    bsdf_init(&v->bsdf, &v->params, v->wo);
    return 1;
}

__attribute__((noinline)) int path_bsdf(struct path *path, struct path_vertex *v) { return find_bsdf(path, v); }

/* Sample the path's next direction from the BSDF. PATH_GOES_ON: it has one. */
static inline __attribute__((always_inline)) enum path_end path_scatter(struct path *path, struct path_vertex *v,
                                                                        real u_lobe)
{
    const struct sample2 u = sampler_get(path->sampler, v->dimension + VERTEX_BSDF);
    struct bsdf_sample *sample = &v->sample;

    if (!bsdf_sample(&v->bsdf, v->wo, u_lobe, u.u, u.v, sample))
        return PATH_ABSORBED;
    path->ray.direction = vec3_normalize(basis_to_world(&v->s.basis, sample->wi));
    if (!path_keeps_side(&v->s, path->ray.direction, sample->wi))
        return PATH_SIDE;
    path->throughput = vec3_mul(path->throughput, sample->weight);
    /* Reflection takes the wavelength's colour too: its share depends on the index of refraction. */
    if (calls_for(path->scene->effects, EFFECT_DISPERSION) && path_disperses_at(path, &v->s)) {
        path->throughput = vec3_mul(path->throughput, path->wavelength.rgb);
        path->wavelength.taken = 1;
    }
    if (calls_for(path->scene->effects, VOLUME_EFFECTS) && sample->wi.z < 0)
        path->interior = v->crossing.beyond;
    path->eta_scale *= sample->eta_scale;
    if (calls_for(path->scene->effects, EFFECT_CAUSTICS) && path->scene->casters)
        path->caustics.chain = path_chain_at(path, v);
    path->specular = (sample->flags & BSDF_DELTA) != 0;
    path->caustics.any_diffuse |= !path->specular;
    path->pdf = sample->pdf;
    return PATH_GOES_ON;
}

/* Leave the vertex towards wi and prepare the next ray. */
static void path_next_ray(struct path *path, const struct path_vertex *v, struct vec3 wi)
{
    const struct surface *s = &v->s;

    if (calls_for(path->scene->effects, EFFECT_TEXTURE))
        path_widen(path, s->t);
    path->context.p = s->p;
    path->context.n = s->material->flags & MATERIAL_TWO_WAY ? vec3_splat(0) : s->ng;
    surface_leave(s, path->ray.direction, &path->ray);
    path->next.there = path_meets_coincident(&v->crossing, wi);
    if (path->next.there) {
        path->ray.left_count = 0; /* coincident faces here are searched again */
        path->next.hit = v->crossing.next;
    }
    path->depth++;
}

/* ---- its beginning --------------------------------------------------------------------------- */

static void path_start(struct path *path, const struct render_scene *scene, const struct sampler *sampler,
                       const struct ray *ray, struct camera_cone cone, struct render_stats *stats)
{
    path->scene = scene;
    path->sampler = sampler;
    path->stats = stats;
    path->query = (struct path_query){sampler, 0};
    path->throughput = vec3_splat(1);
    path->radiance = vec3_splat(0);
    path->depth = path->tally.marks = 0;
    path->tally.mark = scene->settings.max_depth / 4;
    path->tally.sight = SIGHT_NOTHING;
    path->tally.shone = 0;
    if (ray->left_count)
        path->ray = *ray;
    else
        memcpy(&path->ray, ray, offsetof(struct ray, left)); /* the rest says which faces it leaves */
    path->context = (struct light_context){.time = ray->time};
    path->pdf = 0;
    path->specular = 1;
    path->caustics.chain = CHAIN_NONE;
    path->caustics.any_diffuse = 0;
    path->eta_scale = 1;
    path->cone = cone;
    path->wavelength.nm = 0;
    path->wavelength.taken = 0;
    path->interior.count = 0;
    path->interior.medium = -1;
    if (calls_for(scene->effects, VOLUME_EFFECTS))
        path->interior = scene->camera_interior;
    path->between.boundaries = 0;
    path->between.key = path->between.depth = 0;
    path->next.there = 0;
}

/* ---- shadow rays for the pilots -------------------------------------------------------------- */

real path_arrives(const struct render_scene *scene, const struct sampler *sampler, const struct surface *s,
                  const struct interior *in, const struct light_sample *light)
{
    struct render_stats stats = {0};
    struct vec3 visible;
    struct path path;
    struct ray ray;

    surface_leave(s, light->direction, &ray);
    path_end_at_light(light, &ray);
    path_start(&path, scene, sampler, &ray, (struct camera_cone){0}, &stats);
    path.interior = *in;
    visible = path_visibility(&path, &ray);
    PROFILE_IDLE();
    return (visible.x + visible.y + visible.z) / 3;
}
