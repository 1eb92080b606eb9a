/* path_parts: what the files of the integrator share. Private to path*.c, which a kernel variant
 * compiles as one (kernels/kernel.inc).
 *
 *   path.c          the loop: one path, vertex by vertex
 *   path_trace.c    rays, and the safeguard against rays that slip out of a closed mesh
 *   path_volumes.c  media, absorption, boundaries of volumes, indices of refraction
 *   path_light.c    next-event estimation and its weights, emission, the environment
 *   path_alpha.c    does a hit count? (culling, alpha)
 */
#ifndef AZULEJO_RENDER_PATH_PARTS_H
#define AZULEJO_RENDER_PATH_PARTS_H

#include "common/base/safeguard.h"
#include "worker/render/bsdf/bsdf.h"
#include "worker/render/path/crossing.h"
#include "worker/render/base/fault.h"
#include "worker/render/base/has.h"
#include "worker/render/base/health_scope.h"
#include "worker/render/medium/medium.h"
#include "worker/render/path/path.h"
#include "worker/render/base/profile_scope.h"
#include "worker/render/surface/surface.h"
#include "worker/render/world.h"
#include "worker/render/surface/surface_shape.h"
#include "worker/render/path/record_hooks.h"

/* A kernel variant makes these functions static. */
#ifndef PATH_FUNCTION
#define PATH_FUNCTION
#endif

/* What the integrator has to do in this scene. A kernel variant knows at compile time what is
 * absent, and the compiler removes the code that depends on it. */
struct path_features {
    int absorption, dispersion, environment, fog, media, mixes, nested,
        textures, unlit, vertex_colors;
    int index_matched;  /* shadow rays pass boundaries, and media attenuate them */
    int volumes;        /* the path keeps track of the volumes that it is in */
    int coincident;     /* faces of volumes may coincide (crossing.h) */
};

static inline __attribute__((always_inline)) struct path_features
path_features_of(const struct render_scene *scene)
{
    return (struct path_features){
        .absorption = ACTIVE(scene, ABSORPTION),
        .dispersion = ACTIVE(scene, DISPERSION),
        .environment = ACTIVE(scene, ENVIRONMENT),
        .fog = ACTIVE(scene, FOG),
        .media = ACTIVE(scene, MEDIUM),
        .mixes = ACTIVE(scene, MATERIAL_MIX),
        .nested = ACTIVE(scene, NESTED_DIELECTRIC),
        .textures = ACTIVE(scene, TEXTURE),
        .unlit = ACTIVE(scene, UNLIT),
        .vertex_colors = ACTIVE(scene, VERTEX_COLOR),
        .index_matched = ACTIVE(scene, MEDIUM) || ACTIVE(scene, INTERFACE),
        .volumes = ACTIVE(scene, MEDIUM) || ACTIVE(scene, INTERFACE) ||
                   ACTIVE(scene, NESTED_DIELECTRIC),
        .coincident = HAS(NESTED_DIELECTRIC),
    };
}

/* A path that passes more index-matched boundaries than this ends. Only faulty geometry has so
 * many (a volume that is entered repeatedly and never left). */
#define INDEX_MATCHED_MAX 256

struct path {
    const struct render_scene *scene;
    const struct sampler *sampler;
    struct render_stats *stats;
    struct path_query query;
    struct vec3 throughput;
    uint32_t depth;             /* scattering vertices before this one */
    uint32_t mark, marks;       /* depth of the next mark, and how many are passed (path_mark) */
    real at_half;               /* luminance of the radiance at the mark of half the depth */
    struct ray ray;
    struct light_context context; /* light sampling context of the vertex that the ray left */
    real pdf;                  /* density of the ray's direction at that vertex, per sr */
    int specular;               /* the direction came from a delta distribution or the camera:
                                   light sampling cannot find it */
    int any_diffuse;            /* a vertex before the last one scattered with a finite density */
    real eta_scale;            /* product of squared relative indices, for Russian roulette */
    struct camera_cone cone;
    /* Dispersion. */
    real wavelength_nm;        /* 0: not sampled yet */
    int dispersed;              /* the throughput carries the wavelength's colour */
    struct vec3 wavelength_rgb;
    /* Volumes. */
    struct interior interior;   /* the volumes that the ray is in */
    uint32_t boundaries_passed; /* index-matched ones so far */
    uint32_t medium_key;
    uint32_t medium_depth;      /* depth after the last vertex whose number a medium used */
    /* The next of several coincident faces is at the path's position: it is `hit`; no ray is
     * traced. */
    int at_next;
    struct hit hit;
};

/* A vertex on a surface. */
struct path_vertex {
    struct surface s;
    struct crossing crossing;   /* of the volume boundaries at the vertex */
    struct bsdf_params params;
    struct bsdf bsdf;
    struct vec3 wo;             /* towards the previous vertex, in the shading frame */
    uint32_t dimension;         /* first of its random numbers */
};

/* Add the light `source` at the path's end, times the throughput, to the radiance at its start. */
static inline void path_add(const struct path *path, struct vec3 source, struct vec3 *radiance)
{
    RECORD(recorded->added[recorded->adding] = vec3_mul(path->throughput, source));
    *radiance = vec3_add(*radiance, vec3_mul(path->throughput, source));
}

/* Is a direction, in the world and in the shading frame, on the same side of the face as of the
 * shading normal? The face decides where light can go; by the shading normal alone it would leak
 * through. */
static inline int path_keeps_side(const struct surface *s, struct vec3 direction, struct vec3 wi)
{
    return (vec3_dot(direction, s->ng) > 0) == (wi.z > 0) || !SAFEGUARD(SHADING_SIDES);
}

/* ---- path.c ---------------------------------------------------------------------------------- */

/* Russian roulette: end the path at random, more often the less it carries. `u` in [0,1). 0: it
 * ends. */
PATH_FUNCTION int russian_roulette(struct path *path, real u);
/* Widen the beam over which textures are averaged, behind a vertex `t` metres along the ray. A
 * direction sampled with path->pdf covers a solid angle of about 1 / pdf. */
PATH_FUNCTION void path_widen(struct path *path, real t);
/* The vertex has the depth of a mark: for the light that --max-depth takes (common/film/depth_light.h). `radiance`:
 * what the path has brought up to here. Call it if path->depth >= path->mark. */
PATH_FUNCTION void path_mark(struct path *path, struct vec3 radiance);

/* ---- path_trace.c ---------------------------------------------------------------------------- */

/* The nearest hit of a ray that starts in the volumes `in`. 0: it escapes. */
PATH_FUNCTION int path_trace(const struct path *path, const struct interior *in,
                             const struct ray *ray, struct hit *hit);
/* Is anything between the ray's origin and its end? It starts in path->interior. */
PATH_FUNCTION int path_occluded(const struct path *path, const struct ray *ray);

/* ---- path_volumes.c -------------------------------------------------------------------------- */

enum medium_outcome {
    MEDIUM_PASSED,    /* the path reaches the hit */
    MEDIUM_SCATTERED, /* it was scattered before the hit; the next vertex is there */
    MEDIUM_ENDED
};

/* The medium between the ray's origin and the hit, `t` metres away: it absorbs, scatters and emits
 * (added to *radiance). */
PATH_FUNCTION enum medium_outcome path_medium(struct path *path, real t, uint32_t dimension,
                                              struct vec3 *radiance);
/* Absorption (Beer-Lambert) over the segment that ends at the vertex, in a refractive object. */
PATH_FUNCTION void path_absorb(struct path *path, const struct surface *s);
/* Find what lies beyond the vertex. 0: its boundary is index-matched; the ray has continued
 * straight through it. */
PATH_FUNCTION int path_boundary(struct path *path, struct path_vertex *v);
/* The indices of refraction on both sides of the vertex. */
PATH_FUNCTION void path_indices(struct path *path, struct path_vertex *v);
/* Transmittance from the ray's origin to its end, through index-matched boundaries and the media
 * on the way. */
PATH_FUNCTION struct vec3 path_transmittance(struct path *path, const struct ray *ray);

/* Does the path's wavelength still have to colour what the material refracts? This happens once. */
static inline int path_disperses_at(const struct path *path, const struct surface *s)
{
    return path->wavelength_nm > 0 && !path->dispersed && s->material->m.dispersion > 0 &&
           s->material->m.refractive;
}

/* ---- path_light.c ---------------------------------------------------------------------------- */

/* Next-event estimation: light from one sampled emitter, scattered at the vertex towards wo. */
PATH_FUNCTION struct vec3 path_direct_surface(struct path *path, const struct path_vertex *v);
/* The same at a point in a medium, where path->ray starts. `direction`: the direction of flight. */
PATH_FUNCTION struct vec3 path_direct_medium(struct path *path, const struct world_medium *medium,
                                             struct vec3 direction, uint32_t dimension);
/* Radiance of the environment along an escaped ray, weighted against light sampling. */
PATH_FUNCTION struct vec3 path_escaped(const struct path *path);
/* Emission of the surface that the ray met, weighted against light sampling. An unlit surface
 * emits its colour. */
PATH_FUNCTION struct vec3 path_emitted(const struct path *path, const struct surface *s);

/* An unlit surface ends the path. */
static inline int path_is_unlit(const struct path *path, const struct surface *s)
{
    return path_features_of(path->scene).unlit && s->material->m.unlit;
}

/* Does a path that continues towards wi meet another face at the same place? */
static inline int path_meets_coincident(const struct path *path, const struct crossing *crossing,
                                        struct vec3 wi)
{
    return path_features_of(path->scene).coincident && crossing->next_side &&
           (wi.z > 0) == (crossing->next_side > 0);
}

#include "worker/render/path/record_path.h"

#endif
