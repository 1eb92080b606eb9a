/* effects: what a scene calls for.
 *
 * Walks what is reachable from the scene's instances, lights, cameras and environment and
 * yields a set. What is not in the set need not be simulated.
 */
#ifndef AZULEJO_SCENE_EFFECTS_H
#define AZULEJO_SCENE_EFFECTS_H

#include <stdint.h>

#include "common/scene/scene.h"

/* X(name, text). What the kernel can leave out is asked by HAS(name) in worker/render. */
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
    X(CAUSTICS, "caustics")

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

/* Roughness below this is a mirror: the least float whose square (GGX alpha) is not below
 * 1e-3f, so that the answer is the renderer's to the last bit. */
#define EFFECT_MIRROR_ROUGHNESS 0.031622778f

/* The set for one camera of a validated scene. It depends on instances only through what
 * they use: a material or light that nothing uses does not count, a factor of 0 is absent
 * whatever its texture, alpha that is 1 everywhere is none, closed opaque meshes seen from
 * outside need no culling. When in doubt the effect is in the set. */
uint64_t scene_effects(const struct scene *scene, uint32_t camera);

const char *effect_name(enum effect_bit bit);

#endif
