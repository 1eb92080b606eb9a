/* material_fields: every field of a material, once.
 *
 * struct scene_material, its defaults, the range checks, the wire form, the simplification of textures, which images a
 * frame loads and which effects a material needs all follow from these rows (material.h). A new row needs one line in
 * scene.proto and the code that reads the field: docs/EXTENDING.md.
 *
 * VALUE(type, name, default, least, most, effect, message, number)
 *   type     FLAG, NUMBER, RGB, RGBA, INTEGER, KIND, ALPHA_MODE, MEDIUM (an index, -1: none) or
 *            MATERIALS (two indices, the second at the next number)
 *   effect   the effect that a value other than the default needs; leaving that effect out restores
 *            the default. NONE: the field alone needs no effect
 *   message, number  where it is on the wire: MATERIAL, or a group of MATERIAL_MESSAGES
 *
 * TEXTURE(name, encoding, lookup, readers, needs, message, number, meaning, parts...)
 *   The member is name_texture.
 *   encoding COLOR: sRGB unless the texture says otherwise; DATA: linear
 *   lookup   FILTERED: by the footprint of the ray's beam; FINEST: always the finest level
 *   readers  which materials read it: enum material_role
 *   needs    the value without which it does nothing: WITH(value), or ALONE
 *   meaning  FACTOR: the texture's channel multiplies each part; NORMAL: a normal map, scaled by its
 *            part; DIRECTION: the anisotropy's; BETWEEN: from the first part to the second
 *   parts    PART(value, channel), RGB_OF(value), ALPHA_OF(value)
 *
 * Ranges include their ends; ABOVE_0 and BELOW_1 are the floats next to the excluded ends. */
#pragma once

/* X(message, number of its field in message Material of scene.proto; 0: that message itself). A
 * group is on the wire if any of its fields differs from its default, so a scene without it is read
 * as before. */
#define MATERIAL_MESSAGES(X)    \
    X(MATERIAL, 0)              \
    X(ANISOTROPY, 26)           \
    X(CLEARCOAT, 27)            \
    X(SHEEN, 28)                \
    X(IRIDESCENCE, 29)          \
    X(DIFFUSE_TRANSMISSION, 30) \
    X(CONDUCTOR, 32)            \
    X(MIX, 37)

#define MATERIAL_FIELDS(VALUE, TEXTURE)                                                            \
    VALUE(KIND, kind, MATERIAL_SURFACE, 0, MATERIAL_KIND_COUNT - 1, NONE, MATERIAL, 25)            \
    /* emits base_color, reflects nothing */                                                       \
    VALUE(FLAG, unlit, 0, 0, 1, NONE, MATERIAL, 2)                                                 \
    /* 0: back faces are invisible to every ray */                                                 \
    VALUE(FLAG, double_sided, 0, 0, 1, NONE, MATERIAL, 3)                                          \
    VALUE(ALPHA_MODE, alpha_mode, ALPHA_OPAQUE, 0, ALPHA_COUNT - 1, ALPHA, MATERIAL, 4)            \
    VALUE(NUMBER, alpha_cutoff, 0.5f, 0, SCENE_RADIANCE_MAX, NONE, MATERIAL, 5)                    \
    /* linear RGB, alpha; multiplies a conductor */                                                \
    VALUE(RGBA, base_color, 1, 0, 1, NONE, MATERIAL, 6)                                            \
    TEXTURE(base_color, COLOR, FILTERED, READ_BY_ALL, ALONE, MATERIAL, 7, FACTOR,                  \
            RGB_OF(base_color), ALPHA_OF(base_color))                                              \
    VALUE(NUMBER, metallic, 1, 0, 1, NONE, MATERIAL, 8)                                            \
    VALUE(NUMBER, roughness, 1, 0, 1, NONE, MATERIAL, 9)                                           \
    TEXTURE(metallic_roughness, DATA, FILTERED, READ_BY_LIT, ALONE, MATERIAL, 10, FACTOR,          \
            PART(roughness, GREEN), PART(metallic, BLUE))                                          \
    /* of `roughness` times its texture, found by simplify; 0: not known */                        \
    VALUE(NUMBER, least_roughness, 0, 0, 1, NONE, MATERIAL, 41)                                    \
    /* of the diffuse base: 0 is Lambert's */                                                      \
    VALUE(NUMBER, diffuse_roughness, 0, 0, 1, ROUGH_DIFFUSE, MATERIAL, 39)                         \
    TEXTURE(diffuse_roughness, DATA, FILTERED, READ_BY_DIELECTRIC, ALONE, MATERIAL, 40, FACTOR,    \
            PART(diffuse_roughness, RED))                                                          \
    VALUE(NUMBER, normal_scale, 1, -1e6f, 1e6f, NONE, MATERIAL, 11)                                \
    TEXTURE(normal, DATA, FILTERED, READ_BY_LIT, ALONE, MATERIAL, 12, NORMAL,                      \
            PART(normal_scale, RED))                                                               \
    /* radiance: factor * strength */                                                              \
    VALUE(RGB, emission, 0, 0, SCENE_RADIANCE_MAX, EMISSIVE_MESH, MATERIAL, 13)                    \
    TEXTURE(emission, COLOR, FINEST, READ_BY_LIT, ALONE, MATERIAL, 14, FACTOR, RGB_OF(emission))   \
    /* or 0: Fresnel exactly 1. VOLUMES_BOUNDARIES: any above 0, that of the back over the         \
     * front's */                                                                                  \
    VALUE(NUMBER, ior, 1.5f, 1, 1e6f, NONE, MATERIAL, 15)                                          \
    /* weight of the dielectric reflection */                                                      \
    VALUE(NUMBER, specular, 1, 0, 1, NONE, MATERIAL, 16)                                           \
    TEXTURE(specular, DATA, FILTERED, READ_BY_DIELECTRIC, ALONE, MATERIAL, 17, FACTOR,             \
            PART(specular, ALPHA))                                                                 \
    VALUE(RGB, specular_color, 1, 0, SCENE_RADIANCE_MAX, NONE, MATERIAL, 18)                       \
    TEXTURE(specular_color, COLOR, FILTERED, READ_BY_DIELECTRIC, WITH(specular), MATERIAL, 19,     \
            FACTOR, RGB_OF(specular_color))                                                        \
    VALUE(NUMBER, transmission, 0, 0, 1, NONE, MATERIAL, 20)                                       \
    TEXTURE(transmission, DATA, FILTERED, READ_BY_DIELECTRIC, ALONE, MATERIAL, 21, FACTOR,         \
            PART(transmission, RED))                                                               \
    /* 1: bounds a volume and refracts; 0: thin wall */                                            \
    VALUE(FLAG, refractive, 0, 0, 1, NONE, MATERIAL, 22)                                           \
    /* transmittance after attenuation_distance (metres; INFINITY: clear) */                       \
    VALUE(RGB, attenuation_color, 1, 0, 1, NONE, MATERIAL, 23)                                     \
    VALUE(NUMBER, attenuation_distance, INFINITY, ABOVE_0, INFINITY, ABSORPTION, MATERIAL, 24)     \
    /* strength: GGX alpha along the direction becomes mix(alpha, 1, strength^2) */                \
    VALUE(NUMBER, anisotropy, 0, 0, 1, ANISOTROPY, ANISOTROPY, 1)                                  \
    /* of the direction, counter-clockwise from the tangent */                                     \
    VALUE(NUMBER, anisotropy_rotation_rad, 0, -1e5f, 1e5f, NONE, ANISOTROPY, 2)                    \
    /* red and green: the direction * 2 - 1 */                                                     \
    TEXTURE(anisotropy, DATA, FILTERED, READ_BY_LIT, ALONE, ANISOTROPY, 3, DIRECTION,              \
            PART(anisotropy, BLUE))                                                                \
    VALUE(NUMBER, clearcoat, 0, 0, 1, CLEARCOAT, CLEARCOAT, 1)                                     \
    TEXTURE(clearcoat, DATA, FILTERED, READ_BY_LIT, ALONE, CLEARCOAT, 2, FACTOR,                   \
            PART(clearcoat, RED))                                                                  \
    VALUE(NUMBER, clearcoat_roughness, 0, 0, 1, NONE, CLEARCOAT, 3)                                \
    TEXTURE(clearcoat_roughness, DATA, FILTERED, READ_BY_LIT, WITH(clearcoat), CLEARCOAT, 4,       \
            FACTOR, PART(clearcoat_roughness, GREEN))                                              \
    VALUE(NUMBER, clearcoat_least_roughness, 0, 0, 1, NONE, CLEARCOAT, 8)                          \
    VALUE(NUMBER, clearcoat_ior, 1.5f, 1, 1e6f, NONE, CLEARCOAT, 5)                                \
    VALUE(NUMBER, clearcoat_normal_scale, 1, -1e6f, 1e6f, NONE, CLEARCOAT, 6)                      \
    TEXTURE(clearcoat_normal, DATA, FILTERED, READ_BY_LIT, WITH(clearcoat), CLEARCOAT, 7, NORMAL,  \
            PART(clearcoat_normal_scale, RED))                                                     \
    VALUE(RGB, sheen_color, 0, 0, 1, SHEEN, SHEEN, 1)                                              \
    TEXTURE(sheen_color, COLOR, FILTERED, READ_BY_SURFACE, ALONE, SHEEN, 2, FACTOR,                \
            RGB_OF(sheen_color))                                                                   \
    VALUE(NUMBER, sheen_roughness, 0, 0, 1, NONE, SHEEN, 3)                                        \
    TEXTURE(sheen_roughness, DATA, FILTERED, READ_BY_SURFACE, WITH(sheen_color), SHEEN, 4, FACTOR, \
            PART(sheen_roughness, ALPHA))                                                          \
    /* weight of the thin film */                                                                  \
    VALUE(NUMBER, iridescence, 0, 0, 1, IRIDESCENCE, IRIDESCENCE, 1)                               \
    TEXTURE(iridescence, DATA, FILTERED, READ_BY_SURFACE, ALONE, IRIDESCENCE, 2, FACTOR,           \
            PART(iridescence, RED))                                                                \
    VALUE(NUMBER, iridescence_ior, 1.3f, 1, 1e6f, NONE, IRIDESCENCE, 3)                            \
    /* the least may exceed the most */                                                            \
    VALUE(NUMBER, iridescence_thickness_min_nm, 100, 0, 1e9f, NONE, IRIDESCENCE, 4)                \
    VALUE(NUMBER, iridescence_thickness_max_nm, 400, 0, 1e9f, NONE, IRIDESCENCE, 5)                \
    TEXTURE(iridescence_thickness, DATA, FILTERED, READ_BY_SURFACE, WITH(iridescence),             \
            IRIDESCENCE, 6, BETWEEN, PART(iridescence_thickness_min_nm, GREEN),                    \
            PART(iridescence_thickness_max_nm, GREEN))                                             \
    /* share of the Lambert base that goes through */                                              \
    VALUE(NUMBER, diffuse_transmission, 0, 0, 1, DIFFUSE_TRANSMISSION, DIFFUSE_TRANSMISSION, 1)    \
    TEXTURE(diffuse_transmission, DATA, FILTERED, READ_BY_DIELECTRIC, ALONE, DIFFUSE_TRANSMISSION, \
            2, FACTOR, PART(diffuse_transmission, ALPHA))                                          \
    VALUE(RGB, diffuse_transmission_color, 1, 0, 1, NONE, DIFFUSE_TRANSMISSION, 3)                 \
    TEXTURE(diffuse_transmission_color, COLOR, FILTERED, READ_BY_DIELECTRIC,                       \
            WITH(diffuse_transmission), DIFFUSE_TRANSMISSION, 4, FACTOR,                           \
            RGB_OF(diffuse_transmission_color))                                                    \
    /* 20 / Abbe number */                                                                         \
    VALUE(NUMBER, dispersion, 0, 0, 1e6f, DISPERSION, MATERIAL, 31)                                \
    /* complex index of refraction at R, G, B */                                                   \
    VALUE(RGB, conductor_eta, 1, ABOVE_0, 1e6f, NONE, CONDUCTOR, 1)                                \
    VALUE(RGB, conductor_k, 0, 0, 1e6f, NONE, CONDUCTOR, 2)                                        \
    /* light that the coat throws back at its base: base c becomes c (1 - K) / (1 - K c) (pbrt's   \
     * coats) */                                                                                   \
    VALUE(NUMBER, base_interreflection, 0, 0, BELOW_1, NONE, MATERIAL, 33)                         \
    /* thin wall: count all reflections between its two sides, R' = 2 R / (1 + R) (pbrt's thin     \
     * glass) */                                                                                   \
    VALUE(FLAG, thin_slab, 0, 0, 1, NONE, MATERIAL, 34)                                            \
    /* of a refractive volume that overlaps another: the higher one is there (Schmidt & Budge      \
     * 2002) */                                                                                    \
    VALUE(INTEGER, priority, 0, -SCENE_PRIORITY_MAX, SCENE_PRIORITY_MAX, NONE, MATERIAL, 35)       \
    /* what fills the volume */                                                                    \
    VALUE(MEDIUM, medium, -1, -1, SCENE_MEDIA_MAX - 1, MEDIUM, MATERIAL, 36)                       \
    /* VOLUMES_BOUNDARIES: the medium before its front; the same as `medium`: the ray stays in the \
     * one it is in */                                                                             \
    VALUE(MEDIUM, medium_outside, -1, -1, SCENE_MEDIA_MAX - 1, MEDIUM, MATERIAL, 38)               \
    /* MATERIAL_MIX: both lower than its own index */                                              \
    VALUE(MATERIALS, mix_material, 0, 0, SCENE_MATERIALS_MAX - 1, NONE, MIX, 1)                    \
    /* share of the second */                                                                      \
    VALUE(NUMBER, mix_amount, 0, 0, 1, NONE, MIX, 3)                                               \
    TEXTURE(mix, DATA, FINEST, READ_BY_MIX, ALONE, MIX, 4, FACTOR, PART(mix_amount, RED))
