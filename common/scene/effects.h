/* effects: the effects that can be simulated, each once; a set of them is a uint64_t. scene_effects.h finds those that a
 * scene needs. */
#pragma once

#include <stdint.h>

/* X(name, text). What a kernel can leave out is asked by calls_for (worker/render/base/gate.h). A row's number
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

const char *effect_name(enum effect_bit bit); /* "normal map" */
/* "normal-map" or "normal map"; -1: unknown. */
int effect_parse(const char *name);
