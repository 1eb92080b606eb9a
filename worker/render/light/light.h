/* light: the renderer's interface to every kind of light, and the table of the kinds.
 *
 * A kind is one file (spot_light.c) and one row of LIGHT_KINDS. With `light` the kind's own struct:
 *
 *   prefix_new      for a light of the scene's list: creates that struct from the description
 *   prefix_weigh    power and bounds, from which the odds of choosing the light follow
 *   prefix_sample   next-event estimation: a point on the light, from two random numbers
 *
 * What scattered rays can meet has a density as well, with which multiple importance sampling weighs the meeting;
 * column MET says how they meet it:
 *
 *   FACE     at a face (face_light.h): prefix_pdf
 *   ESCAPE   by leaving the scene: prefix_radiance, which gives the density with the radiance
 *   NEVER    light sampling alone finds it
 *
 * Two places use the rows: emitters_sample.c calls prefix_sample and prefix_pdf, light.c has the rest as a table.
 * The tree (tree.h) and the table of odds (light_table.h), which choose a light, know its bounds and its number alone.
 * docs/EXTENDING.md lists the files of a new light.
 */
#pragma once

#include "common/base/safeguard.h"
#include "common/math/vec.h"
#include "common/scene/scene.h"
#include "worker/render/accel/accel.h"
#include "worker/render/light/environment/environment.h"
#include "worker/render/light/tree.h"
#include "worker/render/texture/texture.h"

struct punctual;
struct render_scene;

/* X(KIND, prefix, EFFECT, ACCOUNT, MET): without EFFECT in the scene there is no such light; its time
 * is charged to ACCOUNT, or to EFFECT where the scene has no ACCOUNT. */
#define LIGHT_KINDS_LISTED(X) /* of the scene's list of lights: SCENE_LIGHT_KINDS */  \
    X(POINT, point_light, PUNCTUAL_LIGHT, PUNCTUAL_LIGHT, NEVER)                      \
    X(SPOT, spot_light, PUNCTUAL_LIGHT, PUNCTUAL_LIGHT, NEVER)                        \
    X(DIRECTIONAL, directional_light, PUNCTUAL_LIGHT, PUNCTUAL_LIGHT, NEVER)          \
    X(GONIOMETRIC, goniometric_light, PUNCTUAL_LIGHT, LIGHT_IMAGE, NEVER)             \
    X(PROJECTION, projection_light, PUNCTUAL_LIGHT, LIGHT_IMAGE, NEVER)
#define LIGHT_KINDS_FOUND(X) /* in other parts of the scene: enum light_kind */       \
    X(TRIANGLE, triangle_light, EMISSIVE_MESH, EMISSIVE_MESH, FACE)                   \
    X(SPHERE, sphere_light, EMISSIVE_MESH, EMISSIVE_MESH, FACE)                       \
    X(ENVIRONMENT, environment_light, ENVIRONMENT, ENVIRONMENT, ESCAPE)
#define LIGHT_KINDS(X) LIGHT_KINDS_LISTED(X) LIGHT_KINDS_FOUND(X)

enum light_kind { LIGHT_FOUND_FIRST = LIGHT_KIND_COUNT - 1,
#define LIGHT_ENUM(KIND, ...) LIGHT_##KIND,
                  LIGHT_KINDS_FOUND(LIGHT_ENUM)
#undef LIGHT_ENUM
};

/* The light sampling context: what the choice and sampling of a light may depend on at a vertex. */
struct light_context {
    struct vec3 p; /* world */
    struct vec3 n; /* unit geometric normal; black: light from any side counts (media, and
                           surfaces that transmit) */
    real time;     /* 0..1 of the shutter */
    /* Indices of what surrounds p, and of what is on the other side of `front`, for lamps under a coat; 0 counts as 1. */
    real ior, ior_beyond;
    struct vec3 front;
};

/* Index of what light from this direction comes through. */
static inline real light_context_ior(const struct light_context *context, struct vec3 direction)
{
    return vec3_dot(context->front, direction) < 0 ? context->ior_beyond : context->ior;
}

/* A light seen from the context. */
struct light_sample {
    int kind;              /* of LIGHT_KINDS, and what of that kind was sampled: a punctual light, a struct hit of */
    const void *light;     /* a face, the environment; NULL: no light was chosen */
    struct vec3 direction; /* unit, towards the light */
    real distance;         /* metres; INFINITY for directional lights and the environment */
    int on_face;           /* the light is a point of this face */
    struct hit face;
    real inset, cosine;               /* of that point and direction (struct ray) */
    struct vec3 radiance;             /* radiance, or irradiance-like intensity for delta lights; see light_radiance */
    const struct environment *unread; /* not NULL: there, in this direction, it is to be read first */
    real pdf;                         /* solid angle, times the odds of choosing this light; for delta
                              lights only the odds */
    int delta;                        /* only light sampling finds it (lights at a point, and an environment
                              that is sampled alone): no MIS */
};

/* The environment in a direction, to ask what of it arrives. */
static inline struct light_sample light_of_sky(struct vec3 direction)
{
    return (struct light_sample){.kind = LIGHT_ENVIRONMENT, .direction = direction, .distance = INFINITY};
}

static inline struct vec3 light_radiance(const struct light_sample *light)
{
    return light->unread ? environment_radiance(light->unread, light->direction) : light->radiance;
}

/* A scattered ray's meeting with a light's face: what its density depends on. */
struct light_meeting {
    real odds;             /* of having chosen this light */
    real distance_squared; /* from the light sampling context, m^2 */
    real cosine;           /* absolute, to the face's normal */
    real area;             /* m^2, of a triangle */
};

/* What decides how often a light is chosen. */
struct light_weight {
    struct light_bounds bounds; /* without the intensity; unused for lights at infinity */
    double intensity;           /* W/sr in its main direction */
    double power;               /* luminous, W; if infinitely far away: into the scene's sphere */
};

/* u, v in [0, 1). On entry out->pdf holds the odds of having chosen this light, on_face is 0 and unread
 * NULL; the kind multiplies the pdf by its own density and sets the rest. 0: no light arrives. */
typedef int light_sample_function(const struct render_scene *scene, const void *light,
                                  const struct light_context *context, real u, real v, struct light_sample *out);
/* The odds times the density of prefix_sample, per solid angle, for the point that was met. */
typedef real light_pdf_function(const struct render_scene *scene, const void *light,
                                const struct light_context *context, const struct light_meeting *met);
/* *out is zeroed. The scene's instances, materials and bounding sphere are known. */
typedef void light_weigh_function(const struct render_scene *scene, const void *light, struct light_weight *out);
/* `image`: decoded, or NULL; must outlive the light. NULL: out of memory. Freed by mem_free. */
typedef struct punctual *light_new_function(const struct scene_light *light, const struct texture_image *image);

/* Is there a direction to a light so far away? A surface may touch a lamp, where there is none. */
static inline int light_is_apart(real distance_squared)
{
    return (distance_squared > 0 && isfinite(distance_squared)) || !SAFEGUARD(LAMP_DISTANCE);
}

#define LIGHT_DECLARE_FACE(prefix) light_pdf_function prefix##_pdf;
#define LIGHT_DECLARE_ESCAPE(prefix)
#define LIGHT_DECLARE_NEVER(prefix)
#define LIGHT_DECLARE(KIND, prefix, EFFECT, ACCOUNT, MET) \
    light_sample_function prefix##_sample;                \
    light_weigh_function prefix##_weigh;                  \
    LIGHT_DECLARE_##MET(prefix)
#define LIGHT_DECLARE_NEW(KIND, prefix, ...) light_new_function prefix##_new;
LIGHT_KINDS(LIGHT_DECLARE)
LIGHT_KINDS_LISTED(LIGHT_DECLARE_NEW)
#undef LIGHT_DECLARE
#undef LIGHT_DECLARE_FACE
#undef LIGHT_DECLARE_ESCAPE
#undef LIGHT_DECLARE_NEVER
#undef LIGHT_DECLARE_NEW

/* A row, without its sampling; `kind` is one of enum scene_light_kind or light_kind. */
struct light_row {
    light_new_function *create; /* NULL: not in the scene's list */
    light_weigh_function *weigh;
};
const struct light_row *light_row(int kind);
