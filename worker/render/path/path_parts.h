/* path_parts: what the files of the integrator share. Private to path*.c, which a kernel
 * compiles as one (Makefile: KERNEL_SRC).
 *
 *   path.c          the loop: one path, vertex by vertex
 *   path_on.c       Russian roulette, marks of the depth, the beam's width
 *   path_trace.c    rays, and the safeguard against rays that slip out of a closed mesh
 *   path_volumes.c  media, absorption, boundaries of volumes, indices of refraction
 *   path_light.c    next-event estimation and its weights, emission, the environment
 *   path_caustic.c  light of lamps without size by way of one smooth surface
 *   path_alpha.c    does a hit count? (culling, alpha)
 *   path_sink.h     what else is wanted of a vertex: output variables, records, counters
 */
#pragma once

#include "common/base/safeguard.h"
#include "worker/render/bsdf/bsdf.h"
#include "worker/render/caustic/casters.h"
#include "worker/render/path/crossing.h"
#include "worker/render/base/fault.h"
#include "worker/render/base/gate.h"
#include "worker/render/base/health_scope.h"
#include "worker/render/medium/medium.h"
#include "worker/render/path/path.h"
#include "worker/render/base/profile_scope.h"
#include "worker/render/surface/surface.h"
#include "worker/render/render_scene.h"
#include "worker/render/surface/surface_shape.h"
#include "worker/render/record.h"

/* Effects for which shadow rays pass boundaries and media attenuate them; and for which a path keeps track of the
 * volumes that it is in; and in whose kernels faces of volumes may coincide (crossing.h). */
#define INDEX_MATCHED_EFFECTS (EFFECT_MEDIUM | EFFECT_INTERFACE)
#define VOLUME_EFFECTS (INDEX_MATCHED_EFFECTS | EFFECT_NESTED_DIELECTRIC)
#define COINCIDENT_EFFECTS (VOLUME_EFFECTS | EFFECT_DIELECTRIC | EFFECT_ROUGH_DIELECTRIC)

/* A path that passes more index-matched boundaries than this ends. Only faulty geometry has so
 * many (a volume that is entered repeatedly and never left). */
#define INDEX_MATCHED_MAX 256

/* Do people look at it? unit_work.subject_samples counts the rays that see a medium, or a surface that does not
 * merely shine. */
enum path_sight { SIGHT_NOTHING, SIGHT_SURFACE, SIGHT_MEDIUM };

/* A vertex that asked casters for light, and after it one at a caster: what small lamps send there has been asked for;
 * on a sunlit face, what a sun sends too. */
enum path_chain { CHAIN_NONE, CHAIN_ASKED, CHAIN_CAST, CHAIN_CAST_SUNLIT };

/* Light that casters bring (path_caustic.c) is left out where a path finds it by chance, too. */
struct path_caustics {
    enum path_chain chain; /* what the last vertices are to casters */
    int any_diffuse;       /* a vertex before the last one scattered with a finite density */
};

/* Dispersion: the one wavelength that a path has from its first refraction on. */
struct path_wavelength {
    real nm; /* 0: not sampled yet */
    struct vec3 rgb;
    int taken; /* the throughput carries its colour */
};

/* What the path passed between its vertices. */
struct path_between {
    uint32_t boundaries; /* index-matched ones so far */
    uint32_t key;        /* of the next stretch's random numbers */
    uint32_t depth;      /* after the last vertex whose number a medium used */
};

/* The next of several coincident faces, if it is at the path's position: no ray is traced. */
struct path_next {
    int there;
    struct hit hit;
};

/* For figures: nothing of it changes the path. */
struct path_tally {
    uint32_t mark, marks;  /* depth of the next mark, and how many are passed (path_mark) */
    real at_half;          /* luminance of the radiance at the mark of half the depth */
    enum path_sight sight; /* what the camera's ray met */
    real shone;            /* luminance that was seen on it directly, SIGHT_SURFACE only */
};

struct path {
    const struct render_scene *scene;
    const struct sampler *sampler;
    struct render_stats *stats;

    /* What it carries: the estimate of the light transport equation so far. */
    struct vec3 throughput; /* of the vertices so far: products of f cos / pdf, and of what the way absorbs */
    struct vec3 radiance;   /* that the path has brought */
    struct ray ray;         /* to the next vertex */
    uint32_t depth;         /* scattering vertices before this one */

    /* How its direction was found: what next-event estimation at the last vertex would have found as well is weighted. */
    struct light_context context; /* light sampling context of the vertex that the ray left */
    real pdf;                     /* density of the ray's direction at that vertex, per sr */
    int specular;                 /* the direction came from a delta distribution or the camera:
                                   light sampling cannot find it */

    /* What its tools keep. */
    struct path_query query;  /* path_alpha.c */
    struct camera_cone cone;  /* the beam over which textures are averaged */
    real eta_scale;           /* product of squared relative indices, for Russian roulette */
    struct interior interior; /* the volumes that the ray is in */
    struct path_between between;
    struct path_next next;
    struct path_wavelength wavelength;
    struct path_caustics caustics;
    struct path_tally tally;
};

/* A vertex: on a surface, in a medium, or where the path leaves the scene. */
struct path_vertex {
    enum path_met met;
    uint32_t dimension; /* first of its random numbers; the camera's ray: DIMENSION_VERTEX */
    struct surface s;
    struct crossing crossing; /* of the volume boundaries at the vertex */
    struct bsdf_params params;
    struct bsdf bsdf;
    struct vec3 wo;                     /* towards the previous vertex, in the shading frame */
    struct light_sample light;          /* chosen by next-event estimation */
    struct bsdf_sample sample;          /* of the next direction */
    const struct render_medium *medium; /* that the ray came through, or was scattered in */
    real medium_t;                      /* distance to a vertex in it */
};

/* What happened at a vertex, in figures that the path itself does not need: for the sink (path_sink.h). They
 * never leave the registers of a kernel that records nothing, so their address goes to functions of path*.c
 * that are called once, and to no other. */
struct path_notes {
    struct vec3 throughput;          /* with which the path arrived */
    struct vec3 added[PATH_SOURCES]; /* to the path's radiance */
    real met_pdf, met_weight;        /* density with which light sampling finds what the ray met; its weight */
    int asked, found, traced;        /* next-event estimation took place; it found a light; it traced a shadow ray */
    struct vec3 scatter;             /* what the vertex scatters of that light */
    real scatter_pdf;                /* the density with which scattering finds its direction */
    struct vec3 visible;             /* what of it arrives */
    real weight;                     /* of multiple importance sampling */
    real survival;                   /* of Russian roulette; 1: it did not play */
};

/* Add the light `source` at the vertex, times the throughput, to the radiance at the path's start. */
static inline void path_add(struct path *path, struct path_notes *notes, enum path_source from, struct vec3 source)
{
    notes->added[from] = vec3_mul(path->throughput, source);
    path->radiance = vec3_add(path->radiance, notes->added[from]);
}

/* Is a direction, in the world and in the shading frame, on the same side of the face as of the shading normal? The
 * face decides where light can go; by the shading normal alone it would leak through. */
static inline int path_keeps_side(const struct surface *s, struct vec3 direction, struct vec3 wi)
{
    return (vec3_dot(direction, s->ng) > 0) == (wi.z > 0) || !SAFEGUARD(SHADING_SIDES);
}

/* ---- path_on.c ------------------------------------------------------------------------------- */

/* Russian roulette: end the path at random, more often the less it carries. `u` in [0,1). 0: it ends. Call it where it
 * has begun: until then it needs no number. */
int russian_roulette(struct path *path, struct path_notes *notes, real u);
static inline int roulette_has_begun(const struct path *path) { return path->depth + 1 >= path->scene->roulette_depth; }
/* Widen the beam over which textures are averaged, behind a vertex `t` metres along the ray. A
 * direction sampled with path->pdf covers a solid angle of about 1 / pdf. */
void path_widen(struct path *path, real t);
/* The vertex has the depth of a mark: for the light that --max-depth takes (common/film/depth_light.h). Call it
 * if path->depth >= path->tally.mark. */
void path_mark(struct path *path);

/* ---- path_trace.c ---------------------------------------------------------------------------- */

/* The nearest hit of a ray that starts in the volumes `in`. 0: it escapes. */
int path_trace(const struct path *path, const struct interior *in, const struct ray *ray, struct hit *hit);
/* Is anything between the ray's origin and its end? It starts in path->interior. */
int path_occluded(const struct path *path, const struct ray *ray);

/* ---- path_volumes.c -------------------------------------------------------------------------- */

/* The medium between the ray's origin and the hit, `t` metres away: it absorbs, scatters and emits. Where
 * it scatters the path before the hit, or absorbs it, it becomes the vertex: PATH_MET_MEDIUM. */
enum path_end path_medium(struct path *path, struct path_vertex *v, struct path_notes *notes, real t);
/* Absorption (Beer-Lambert) over the segment that ends at the vertex, in a refractive object. */
void path_absorb(struct path *path, const struct surface *s);
/* Does a path count the bodies that it is inside? */
static inline int path_knows_filling(const struct render_scene *scene)
{
    return calls_for(scene->effects, VOLUME_EFFECTS) && scene->volume_rule == VOLUMES_NESTED;
}
/* What the body that the interior says is around leaves of light after `t` metres: of all of it where nothing absorbs. */
struct vec3 path_filling_transmittance(const struct render_scene *scene, const struct interior *in, real t);
/* Find what lies beyond the vertex. 0: its boundary is index-matched; the ray has continued straight through it. */
int path_boundary(struct path *path, struct path_vertex *v);
/* The indices of refraction on both sides of the vertex. */
void path_indices(struct path *path, struct path_vertex *v);
/* Transmittance from the ray's origin to its end, through index-matched boundaries and the media on the way. */
struct vec3 path_transmittance(struct path *path, const struct ray *ray);

/* Does the path's wavelength still have to colour what the material refracts? This happens once. */
static inline int path_disperses_at(const struct path *path, const struct surface *s)
{
    return path->wavelength.nm > 0 && !path->wavelength.taken && s->material->m.dispersion > 0 && s->material->m.refractive;
}

/* ---- path.c, path_caustic.c ------------------------------------------------------------------ */

/* Trace the path's ray to its next vertex; 0: it escapes. */
int path_intersect(struct path *path, struct path_vertex *v);
/* The vertex crosses no boundary. */
void path_crossing_none(struct crossing *crossing);
/* The BSDF of the vertex. 0: seen from behind the shading normal, where it scatters nothing. */
int path_bsdf(struct path *path, struct path_vertex *v);
/* The vertex scatters the path in the sampled direction: its place in the chain. */
enum path_chain path_chain_at(const struct path *path, const struct path_vertex *v);
/* Have casters been asked for what the path's ray, which escapes, brings of a sun; for what the surface that it met
 * emits? */
static inline int path_is_cast(const struct path *path)
{
    return path->caustics.chain == CHAIN_CAST_SUNLIT && environment_windows_pdf(path->scene->environment, path->ray.direction) > 0;
}
static inline int path_lamp_is_cast(const struct path *path, const struct surface *s)
{
    return path->caustics.chain >= CHAIN_CAST && casters_know_lamp(path->scene->casters, s->number);
}
/* Light that the vertex scatters towards wo and that casters send there from a small lamp or a sun. The scene
 * has casters. */
struct vec3 path_caustic(struct path *path, struct path_vertex *v);

/* ---- path_light.c ---------------------------------------------------------------------------- */

/* Transmittance from the ray's origin to its end. */
struct vec3 path_visibility(struct path *path, const struct ray *ray);
/* Next-event estimation: light from one sampled emitter, scattered at the vertex towards wo. */
struct vec3 path_direct_surface(struct path *path, struct path_vertex *v, struct path_notes *notes);
/* The same at a vertex in a medium, where path->ray starts. `direction`: the direction of flight. */
struct vec3 path_direct_medium(struct path *path, struct path_vertex *v, struct path_notes *notes,
                               struct vec3 direction);
/* Where the ray to a sampled light ends. An area light must not occlude itself. A light without
 * area may lie on a surface. */
void path_end_at_light(const struct light_sample *light, struct ray *ray);
/* Radiance of the environment along an escaped ray, weighted against light sampling. */
struct vec3 path_escaped(const struct path *path, struct path_notes *notes);
/* Emission of the surface that the ray met, weighted against light sampling. An unlit surface emits its colour. */
struct vec3 path_emitted(const struct path *path, const struct surface *s, struct path_notes *notes);

/* An unlit surface ends the path. */
static inline int path_is_unlit(const struct path *path, const struct surface *s)
{
    return calls_for(path->scene->effects, EFFECT_UNLIT) && s->material->m.unlit;
}

/* Does a path that continues towards wi meet another face at the same place? */
static inline int path_meets_coincident(const struct crossing *crossing, struct vec3 wi)
{
    return calls_for(EFFECTS_ALL, COINCIDENT_EFFECTS) && crossing->next_side && (wi.z > 0) == (crossing->next_side > 0);
}
