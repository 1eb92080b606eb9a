/* kernel_sets: the variants of the renderer's kernel and what each can simulate.
 *
 * The first set that contains all that a frame needs renders it; the last contains everything. The renderer compiles
 * one variant per row (Makefile: KERNEL_ROWS); client and coordinator only name them.
 */
#pragma once

#include "common/scene/effects.h"

#define KERNEL_BIT(name) ((uint64_t)1 << EFFECT_BIT_##name)

/* Lambertian surfaces, any light, a pinhole camera of any kind. */
#define KERNEL_SET_MATTE                                                                    \
    (KERNEL_BIT(DIFFUSE) | KERNEL_BIT(CULLING) | KERNEL_BIT(EMISSIVE_MESH) |                \
     KERNEL_BIT(PUNCTUAL_LIGHT) | KERNEL_BIT(ENVIRONMENT) | KERNEL_BIT(ORTHOGRAPHIC) |      \
     KERNEL_BIT(INSTANCING) | KERNEL_BIT(LIGHT_IMAGE) | KERNEL_BIT(PORTAL) |                \
     KERNEL_BIT(DEFORMATION))
/* And rough diffuse bases, what reflects, what is painted (textures, normal maps, alpha). */
#define KERNEL_SET_OPAQUE                                                                   \
    (KERNEL_SET_MATTE | KERNEL_BIT(GLOSSY) | KERNEL_BIT(MIRROR) |                           \
     KERNEL_BIT(MULTIPLE_SCATTERING) | KERNEL_BIT(CONDUCTOR) | KERNEL_BIT(VERTEX_COLOR) |   \
     KERNEL_BIT(CAUSTICS) | KERNEL_BIT(TEXTURE) | KERNEL_BIT(NORMAL_MAP) |                  \
     KERNEL_BIT(ALPHA) | KERNEL_BIT(UNLIT) | KERNEL_BIT(ROUGH_DIFFUSE))
/* And what is seen through. */
#define KERNEL_SET_GLASS                                                                    \
    (KERNEL_SET_OPAQUE | KERNEL_BIT(DIELECTRIC) | KERNEL_BIT(ROUGH_DIELECTRIC) |            \
     KERNEL_BIT(THIN_TRANSMISSION) | KERNEL_BIT(ABSORPTION) | KERNEL_BIT(NESTED_DIELECTRIC))
/* What is opaque, with layers, and leaves. */
#define KERNEL_SET_LAYERED                                                                  \
    (KERNEL_SET_OPAQUE | KERNEL_BIT(ANISOTROPY) | KERNEL_BIT(CLEARCOAT) | KERNEL_BIT(SHEEN) | \
     KERNEL_BIT(IRIDESCENCE) | KERNEL_BIT(DIFFUSE_TRANSMISSION))
/* And all else: lenses, media, motion. */
#define KERNEL_SET_GENERAL EFFECTS_ALL

/* X(name, set), smallest first. A row is kept if without it some scene would pay 2 % more for effects that it
 * lacks (make bench-effects; docs/EFFECTS.md). */
#define KERNEL_MAP(X)                  \
    X(matte, KERNEL_SET_MATTE)         \
    X(opaque, KERNEL_SET_OPAQUE)       \
    X(glass, KERNEL_SET_GLASS)         \
    X(layered, KERNEL_SET_LAYERED)     \
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
