/* kernel_sets: the variants of the renderer's kernel and what each can simulate.
 *
 * Each set contains the one before. The first that contains all that a frame needs renders it. The
 * renderer compiles one variant per row (worker/render/path/kernels/); client and coordinator only
 * name them.
 */
#ifndef AZULEJO_SCENE_KERNEL_SETS_H
#define AZULEJO_SCENE_KERNEL_SETS_H

#include "common/scene/effects.h"

#define KERNEL_BIT(name) ((uint64_t)1 << EFFECT_BIT_##name)

/* Lambertian surfaces, any light, a pinhole camera of any kind. */
#define KERNEL_SET_MATTE                                                                    \
    (KERNEL_BIT(DIFFUSE) | KERNEL_BIT(CULLING) | KERNEL_BIT(EMISSIVE_MESH) |                \
     KERNEL_BIT(PUNCTUAL_LIGHT) | KERNEL_BIT(ENVIRONMENT) | KERNEL_BIT(ORTHOGRAPHIC) |      \
     KERNEL_BIT(INSTANCING) | KERNEL_BIT(LIGHT_IMAGE) | KERNEL_BIT(PORTAL) |                \
     KERNEL_BIT(DEFORMATION))
/* And rough diffuse bases, what reflects, what is painted (textures, normal maps, alpha), what is seen through. */
#define KERNEL_SET_GLASS                                                                    \
    (KERNEL_SET_MATTE | KERNEL_BIT(GLOSSY) | KERNEL_BIT(MIRROR) |                           \
     KERNEL_BIT(MULTIPLE_SCATTERING) | KERNEL_BIT(CONDUCTOR) | KERNEL_BIT(VERTEX_COLOR) |   \
     KERNEL_BIT(CAUSTICS) | KERNEL_BIT(TEXTURE) | KERNEL_BIT(NORMAL_MAP) |                  \
     KERNEL_BIT(ALPHA) | KERNEL_BIT(UNLIT) | KERNEL_BIT(DIELECTRIC) |                       \
     KERNEL_BIT(ROUGH_DIELECTRIC) | KERNEL_BIT(THIN_TRANSMISSION) | KERNEL_BIT(ABSORPTION) | \
     KERNEL_BIT(NESTED_DIELECTRIC) | KERNEL_BIT(ROUGH_DIFFUSE))
/* And layers, lenses, media, motion. */
#define KERNEL_SET_GENERAL EFFECTS_ALL

/* X(name, set), smallest first. docs/EFFECTS.md says how much faster each is than the next: a
 * variant that gains less than 2 % in every scene is not worth its compilation. */
#define KERNEL_MAP(X)                  \
    X(matte, KERNEL_SET_MATTE)         \
    X(glass, KERNEL_SET_GLASS)         \
    X(general, KERNEL_SET_GENERAL)

/* The name of the variant that renders a frame with these effects. */
static inline const char *kernel_set_name(uint64_t effects)
{
#define KERNEL_TRY(name, set)  \
    if (!(effects & ~(set)))   \
        return #name;
    KERNEL_MAP(KERNEL_TRY)
#undef KERNEL_TRY
    return "general";
}

#endif
