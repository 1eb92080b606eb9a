/* pbrt_material_parts: internals of pbrt_material, private to its files.
 *
 * pbrt_material.c         resolves materials, and makes their rows
 * pbrt_material_v4.c      the kinds of pbrt-v4, and mixes
 * pbrt_material_v3.c      kinds that only pbrt-v3 has
 * pbrt_material_values.c  shared values: roughnesses, indices, colours
 */
#pragma once

#include "client/import/pbrt/read/pbrt_context.h"

/* `read` makes m->base and m->color of m->params. The last kind of a list is NULL. */
struct pbrt_kind {
    const char *kind;
    status (*read)(struct pbrt *p, struct pbrt_material *m);
};
extern const struct pbrt_kind pbrt_kinds_v4[], pbrt_kinds_v3[];

/* ---- pbrt_material_values.c --------------------------------------------------------------- */

/* pbrt-v4 maps roughness to the square root, GGX alpha; pbrt-v3 used a polynomial in its logarithm (its microfacet.h);
 * with "remaproughness" false it is alpha already. Ours is the square root of alpha. */
enum pbrt_remap { REMAP_NONE, REMAP_V4, REMAP_V3 };

struct pbrt_roughness {
    const struct pbrt_texture *u, *v;
    enum pbrt_remap remap;
};

/* "roughness", "uroughness" and "vroughness", each after `prefix`. */
status pbrt_read_roughness(struct pbrt *p, struct pbrt_material *m, const char *prefix, double otherwise, int version3,
                           struct pbrt_roughness *out) MUST_CHECK;
/* The surface's own roughness, with its anisotropy. */
status pbrt_put_roughness(struct pbrt *p, struct pbrt_material *m, const struct pbrt_roughness *r) MUST_CHECK;
/* Both of them, without a prefix. */
status pbrt_own_roughness(struct pbrt *p, struct pbrt_material *m, double otherwise, int version3) MUST_CHECK;
/* The coat's: no anisotropy there. */
status pbrt_put_coat_roughness(struct pbrt *p, struct pbrt_material *m, const struct pbrt_roughness *r) MUST_CHECK;
int pbrt_same_constant(const struct pbrt_texture *a, const struct pbrt_texture *b);

/* The range of a dielectric's index: that behind the surface over that before it. */
#define PBRT_INDEX_MIN 1e-3
/* An index of refraction from `least` to 1000, and Abbe's number (0: no dispersion). */
status pbrt_read_index(struct pbrt *p, struct pbrt_material *m, const char *name, double least, double *index,
                       double *abbe) MUST_CHECK;
/* The reflectance of a smooth surface for diffuse light from inside: 1 - (1 - F) / eta^2 with F the
 * diffuse reflectance from outside (Egan & Hilgeman 1973). */
double pbrt_inner_reflectance(double eta);
/* The complex index of a metal. `prefix` is "conductor." below a coat. */
status pbrt_read_metal(struct pbrt *p, struct pbrt_material *m, const char *prefix, double eta[3],
                       double k[3]) MUST_CHECK;
/* A metal of a given reflectance r at normal incidence: eta 1 and this k, as in pbrt. */
double pbrt_k_of_reflectance(double r);

/* A colour or a texture of colours; `otherwise`, grey, when it is not given. */
status pbrt_color_or(struct pbrt *p, struct pbrt_material *m, const char *name, double otherwise,
                     const struct pbrt_texture **out) MUST_CHECK;
void pbrt_be_matte(struct pbrt_material *m);
void pbrt_be_glass(struct pbrt_material *m, double index, double abbe);

/* ---- pbrt_material_v4.c ------------------------------------------------------------------- */
status pbrt_read_conductor(struct pbrt *p, struct pbrt_material *m, const char *prefix, double relative_to) MUST_CHECK;
/* r / pi and t / pi become (1 - w) c / pi and w d / pi: w so that neither colour exceeds 1. */
status pbrt_put_two_sides(struct pbrt *p, struct pbrt_material *m, const struct pbrt_texture *r,
                          const struct pbrt_texture *t) MUST_CHECK;
/* `depth` counts the mixes around this one. */
status pbrt_read_mix(struct pbrt *p, struct pbrt_material *m, unsigned depth) MUST_CHECK;
double pbrt_unchanged(double value, double unused); /* a pbrt_change */
