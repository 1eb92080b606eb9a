/* effects: which effects a scene needs.
 *
 * Walks what is reachable from the scene's instances, lights, cameras and environment and returns a
 * set. What is not in the set need not be simulated.
 */
#ifndef AZULEJO_SCENE_EFFECTS_H
#define AZULEJO_SCENE_EFFECTS_H

#include <stdint.h>

#include "common/scene/scene.h"

/* X(name, text). What the kernel can leave out is asked by HAS(name) in worker/render. A row's number
 * is its bit on the wire and in what is stored: a new row is the last. */
#define EFFECT_MAP(X)                                 \
    X(DIFFUSE, "diffuse")                             \
    X(GLOSSY, "glossy")                               \
    X(MIRROR, "mirror")                               \
    X(DIELECTRIC, "smooth dielectric")                \
    X(ROUGH_DIELECTRIC, "rough dielectric")           \
    X(THIN_TRANSMISSION, "thin transmission")         \
    X(ABSORPTION, "absorption")                       \
    X(TEXTURE, "texture")                             \
    X(NORMAL_MAP, "normal map")                       \
    X(VERTEX_COLOR, "vertex color")                   \
    X(ALPHA, "alpha")                                 \
    X(CULLING, "back-face culling")                   \
    X(UNLIT, "unlit")                                 \
    X(EMISSIVE_MESH, "emissive mesh")                 \
    X(PUNCTUAL_LIGHT, "punctual light")               \
    X(ENVIRONMENT, "environment light")               \
    X(ORTHOGRAPHIC, "orthographic camera")            \
    X(INSTANCING, "instancing")                       \
    X(ANISOTROPY, "anisotropy")                       \
    X(CLEARCOAT, "clearcoat")                         \
    X(SHEEN, "sheen")                                 \
    X(IRIDESCENCE, "iridescence")                     \
    X(DIFFUSE_TRANSMISSION, "diffuse transmission")   \
    X(DISPERSION, "dispersion")                       \
    X(CONDUCTOR, "conductor")                         \
    X(MATERIAL_MIX, "material mix")                   \
    X(INTERFACE, "medium interface")                  \
    X(NESTED_DIELECTRIC, "nested dielectrics")        \
    X(MULTIPLE_SCATTERING, "microfacet multiple scattering") \
    X(MEDIUM, "participating medium")                 \
    X(MEDIUM_GRID, "heterogeneous medium")            \
    X(MEDIUM_EMISSION, "emissive medium")             \
    X(FOG, "fog")                                     \
    X(DEPTH_OF_FIELD, "depth of field")               \
    X(PANORAMA, "panorama camera")                    \
    X(MOTION_BLUR, "motion blur")                     \
    X(DEFORMATION, "skinning and morphing")           \
    X(LIGHT_IMAGE, "light with an image")             \
    X(PORTAL, "portal")                               \
    X(CAUSTICS, "caustics")                           \
    X(ROUGH_DIFFUSE, "rough diffuse")

enum effect_bit {
#define EFFECT_ENUM(name, text) EFFECT_BIT_##name,
    EFFECT_MAP(EFFECT_ENUM)
#undef EFFECT_ENUM
        EFFECT_COUNT
};
_Static_assert(EFFECT_COUNT <= 64, "a set of effects is a uint64_t");
#define EFFECT_VALUE(name, text) \
    static const uint64_t EFFECT_##name = (uint64_t)1 << EFFECT_BIT_##name;
EFFECT_MAP(EFFECT_VALUE)
#undef EFFECT_VALUE
#define EFFECTS_ALL (((uint64_t)1 << EFFECT_COUNT) - 1)

/* What the user may switch off (settings.without); the others are parts of the scene itself. */
#define EFFECTS_SWITCHABLE                                                                     \
    (EFFECT_ABSORPTION | EFFECT_TEXTURE | EFFECT_NORMAL_MAP | EFFECT_VERTEX_COLOR |             \
     EFFECT_ALPHA | EFFECT_EMISSIVE_MESH | EFFECT_PUNCTUAL_LIGHT | EFFECT_ENVIRONMENT |         \
     EFFECT_ANISOTROPY | EFFECT_CLEARCOAT | EFFECT_SHEEN | EFFECT_IRIDESCENCE |                 \
     EFFECT_DIFFUSE_TRANSMISSION | EFFECT_DISPERSION | EFFECT_NESTED_DIELECTRIC |               \
     EFFECT_MULTIPLE_SCATTERING | EFFECT_MEDIUM | EFFECT_MEDIUM_EMISSION | EFFECT_FOG |         \
     EFFECT_DEPTH_OF_FIELD | EFFECT_MOTION_BLUR | EFFECT_LIGHT_IMAGE | EFFECT_PORTAL |          \
     EFFECT_CAUSTICS | EFFECT_ROUGH_DIFFUSE)

/* A frame's time is divided among accounts: 0 belongs to no effect (tracing rays, the geometry they
 * meet, sums), bit + 1 to the effect (worker/render/base/profile_scope.h). */
enum { EFFECT_ACCOUNTS = EFFECT_COUNT + 1 };
/* These have no account of their own: they change how other work is done, or take too little time
 * to be distinguished. `azulejo effects --measure` prices those that can be switched off. */
#define EFFECTS_WITHOUT_TIME                                                                   \
    (EFFECT_CULLING | EFFECT_UNLIT | EFFECT_ANISOTROPY | EFFECT_CONDUCTOR | EFFECT_IRIDESCENCE | \
     EFFECT_ORTHOGRAPHIC | EFFECT_INSTANCING |                                                  \
     EFFECT_DISPERSION | EFFECT_MATERIAL_MIX | EFFECT_INTERFACE | EFFECT_NESTED_DIELECTRIC |   \
     EFFECT_MEDIUM_EMISSION | EFFECT_DEPTH_OF_FIELD | EFFECT_PANORAMA | EFFECT_MOTION_BLUR |   \
     EFFECT_DEFORMATION | EFFECT_CAUSTICS | EFFECT_ROUGH_DIFFUSE)

/* Roughness below this is a mirror: the smallest float whose square (GGX alpha) is not below 1e-3f,
 * so that the decision equals the renderer's exactly. */
#define EFFECT_MIRROR_ROUGHNESS 0.031622778f

struct render_settings;

/* How many causes of an effect are named after the first. */
enum { EFFECT_CAUSES_ALSO = 7 };

struct effect_caller {
    const char *kind;   /* "material", "light", "camera", "environment", "medium", "mesh" ... */
    const char *name;   /* may be "" */
    uint32_t index;     /* its row */
};

/* What needs an effect. */
struct effect_cause {
    const char *kind;   /* of the first cause; NULL: nothing needs it */
    const char *name;
    uint32_t index;
    uint32_t count;     /* number of causes */
    struct effect_caller also[EFFECT_CAUSES_ALSO]; /* the next ones; kind is NULL after the last */
};

/* What one frame of a validated scene needs, without what settings->without switches off. Instances
 * count only through what they use: an unused material or light does not count, a factor of 0 is
 * absent whatever its texture, alpha that is 1 everywhere is absent, closed opaque meshes seen from
 * outside need no culling, motion while the shutter is closed blurs nothing. If in doubt the effect
 * is in the set.
 * causes[EFFECT_COUNT], filled if not NULL. */
uint64_t scene_effects(const struct scene *scene, const struct render_settings *settings,
                       uint32_t frame, struct effect_cause *causes);

/* The same for frame 0 with default settings and this camera. */
uint64_t scene_effects_default(const struct scene *scene, uint32_t camera);

/* Remove the effects of `without` from a material: what is left acts as if they were 0. */
void scene_material_reduce(struct scene_material *material, uint64_t without);

const char *effect_name(enum effect_bit bit);       /* "normal map" */
/* "normal-map" or "normal map"; -1: unknown. */
int effect_parse(const char *name);

#endif
