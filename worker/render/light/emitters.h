/* emitters: every light that next-event estimation may choose, and the odds of each.
 *
 * The candidates are, in this order: the environment (if it is sampled), the punctual
 * lights, the triangles of emissive instances. One uniform number picks one of them by
 * estimated power; the environment's share is kept within bounds where there are others,
 * because power says nothing about which light a point can see.
 */
#ifndef AZULEJO_RENDER_EMITTERS_H
#define AZULEJO_RENDER_EMITTERS_H

#include <stdint.h>

#include "common/base/status.h"
#include "common/math/vec.h"
#include "common/scene/scene.h"

struct render_scene;

struct emitters {
    uint32_t count;               /* candidates; 0: nothing to sample */
    uint32_t punctual_count, triangle_count;
    int has_environment;
    float *cdf;                   /* [count], accumulated probability, last is 1 */
    struct scene_light *punctual; /* [punctual_count] */
    uint32_t *triangle_instance;  /* [triangle_count] */
    uint32_t *triangle_index;     /* [triangle_count] */
};

/* A light seen from a point. */
struct light_sample {
    struct vec3 direction; /* unit, towards the light */
    float distance;        /* metres to the (offset) end; INFINITY for the environment */
    struct vec3 radiance;  /* radiance, or irradiance-like intensity for delta lights */
    float pdf;             /* solid angle, times the odds of choosing this light; for delta
                              lights the odds alone */
    int delta;             /* punctual: the BSDF cannot find it, no MIS */
};

/* Needs the scene's instances, materials, environment and bounding sphere. */
status emitters_init(struct emitters *e, struct render_scene *scene,
                     const struct scene_light *lights, uint32_t light_count,
                     struct error *err) MUST_CHECK;
void emitters_release(struct emitters *e);

/* Who asks for light: which emitters are worth choosing depends on it. */
struct light_query {
    struct vec3 p;      /* world */
    struct vec3 n;      /* unit geometric normal; black: light from any side counts (media, and
                           surfaces that transmit) */
    float time;         /* 0..1 of the shutter */
};

/* Sample a light for the query. The same numbers choose the light and, rescaled, the place on
 * it: each in [0, 1). Returns 0 for "no sample". */
int emitters_sample(const struct render_scene *scene, const struct light_query *query, float u,
                    float v, struct light_sample *out);

/* Solid-angle density (odds included) with which emitters_sample would have picked
 * `direction` on the environment. */
float emitters_environment_pdf(const struct render_scene *scene, const struct light_query *query,
                               struct vec3 direction);
/* The environment's radiance along with it: they share the work. */
struct vec3 emitters_environment(const struct render_scene *scene, const struct light_query *query,
                                 struct vec3 direction, float *pdf);

/* Solid-angle density (odds included) with which emitters_sample would have picked the point
 * at that distance on a triangle of an emissive instance. `light`: the instance's light_base +
 * the triangle; `cosine`: absolute cosine at the light; `area`: the triangle's, m^2. */
float emitters_triangle_pdf(const struct render_scene *scene, const struct light_query *query,
                            uint32_t light, float distance_squared, float cosine, float area);

#endif
