/* bsdf: how a surface scatters light, at one point, for one outgoing direction.
 *
 * Directions are unit vectors in the local shading frame, z along the normal on the side of wo: wo.z > 0 always (the
 * caller flips the frame for a hit from behind). wi.z > 0 is reflection, wi.z < 0 transmission. Values are radiance
 * throughput (camera paths): f includes 1/eta^2 for refraction. All functions are pure and use only deterministic
 * arithmetic; no result is ever NaN, infinite or negative.
 *
 * A surface is a sum of lobes. Each lobe is a row of BSDF_LOBE_MAP below and one file, lobe_*.h,
 * with its model, its paper and three functions: init, evaluate (with the density), sample.
 * layering.h combines them: how much each one weighs and how often it is sampled. What modifies a
 * lobe without being one has its own file: the microfacets (microfacet.h), their Fresnel term
 * (fresnel.h, thin_film.h), multiple scattering between them (compensation.h), and what a layer
 * leaves for what lies below it (layer.h).
 *
 * Special cases: alpha < BSDF_ALPHA_MIN is smooth (delta lobes); ior 0 means Fresnel 1 at F0 (no bending). A refraction
 * that spreads by less than BSDF_SPREAD_MIN is a delta lobe, so light passes straight through ior 1, or an ior equal to
 * ior_outside, for any alpha.
 */
#pragma once

#include <stdint.h>

#include "common/base/safeguard.h"
#include "common/math/vec.h"
#include "worker/render/bsdf/albedo.h"
#include "worker/render/bsdf/fresnel.h"
#include "worker/render/bsdf/microfacet.h"
#include "worker/render/bsdf/thin_film.h"

/* GGX alpha below this is treated as a perfect mirror (a delta lobe). */
#define BSDF_ALPHA_MIN REAL(1e-3)
/* F90 of plastic and of coats reaches its full value at this F0 (ior 1.2). */
#define BSDF_FADE_F0 (1.0f / REAL(121.0))
/* Rough refraction with alpha * |eta - 1| below this is a delta lobe: floats could not resolve its
 * half vector, and no picture would show its blur (radians). */
#define BSDF_SPREAD_MIN REAL(1e-4)
/* Larger indices are clamped to this (F0 = 0.996). */
#define BSDF_IOR_MAX 1000.0f

/* Parameters that are the material's field of the same name times one channel of its texture, and
 * that act if they are above 0: X(effect without which they are 0, FORM(name)). Such a row is all
 * that the field needs here (surface_shade.c). */
#define BSDF_FACTOR_MAP(X, FORM)                                                                  \
    X(CLEARCOAT, FORM(clearcoat))       /* weight of the coat, 0..1 */                            \
    X(IRIDESCENCE, FORM(iridescence))   /* weight of the film, 0..1 */                            \
    X(DIFFUSE_TRANSMISSION, FORM(diffuse_transmission)) /* share of the base that goes through */ \
    X(ROUGH_DIFFUSE, FORM(diffuse_roughness)) /* of the base, 0..1 */
#define BSDF_FACTOR_IS_SET(name) p->name > 0.0f

/* The material's values at the hit point, textures applied. */
struct bsdf_params {
    struct vec3 base_color;     /* 0..1 */
    real metallic;              /* 0..1 */
    real alpha;                 /* GGX alpha = roughness^2, 0..1 */
    real ior;                   /* > 0, below 1 if it is relative to the surroundings (ice in
                                   water), or 0: Fresnel is exactly 1; else clamped */
    real specular;              /* weight of the dielectric reflection, 0..1 */
    struct vec3 specular_color; /* scales F0 of the dielectric, >= 0 */
    real transmission;          /* 0..1 */
    int refractive;             /* transmission refracts; otherwise a thin wall */
    int inside;                 /* refractive: wo is inside the object (hit from behind) */
    real ior_outside;           /* of the object's surroundings, >= 1; 0 counts as 1. Every
                                   index here is absolute: a larger one outside is fine */

    /* Everything below is absent when 0 (memset), whatever the fields above say. */
#define BSDF_FACTOR_FLOAT(name) real name
#define BSDF_FACTOR_MEMBER(effect, member) member;
    BSDF_FACTOR_MAP(BSDF_FACTOR_MEMBER, BSDF_FACTOR_FLOAT)
#undef BSDF_FACTOR_MEMBER
#undef BSDF_FACTOR_FLOAT
    real alpha_stretched; /* anisotropy: GGX alpha along the frame's x, >= alpha, which is
                                   then the alpha along y; 0: isotropic */
    int conductor;        /* Fresnel of a metal with eta, k at R, G, B (relative to vacuum),
                                   times base_color; metallic, specular, transmission, ... unused */
    struct vec3 eta, k;
    real clearcoat_alpha, clearcoat_ior;
    struct vec3 clearcoat_normal; /* unit, in the shading frame (z = 1: the same normal) */
    struct vec3 sheen_color;      /* 0..1 */
    real sheen_alpha;             /* Charlie's alpha: roughness^2 */
    real iridescence_ior, iridescence_thickness_nm;
    struct vec3 diffuse_transmission_color;
    real base_interreflection; /* 0..<1 (scene.h): plastic is pbrt's coat, with Fresnel's exact term
                                   for an ior of 1.2 to 3; a conductor's clearcoat likewise */
    int thin_slab;             /* thin wall: R' = 2 R / (1 + R) */
    int single_scattering;     /* no multiple-scattering compensation
                                   (--without multiple-scattering) */
};

/* Which of the fields above act on a surface, and the effect that they need: X(effect, condition on
 * params p). A surface with none of them is glTF's core material, for which there are shortcuts.
 * calls_for(b->effects, effect) (gate.h) tests for it. */
#define BSDF_CALL_MAP(X)                                                                          \
    BSDF_FACTOR_MAP(X, BSDF_FACTOR_IS_SET)                                                        \
    X(ANISOTROPY, p->alpha_stretched > 0.0f)                                                      \
    X(CONDUCTOR, p->conductor)                                                                    \
    X(SHEEN, p->sheen_color.x > 0.0f || p->sheen_color.y > 0.0f || p->sheen_color.z > 0.0f)       \
    X(GLOSSY, p->base_interreflection > 0.0f)                                                     \
    X(THIN_TRANSMISSION, p->thin_slab && !p->refractive)

/* The lobes, in the order in which their values are added up and in which the selection number
 * runs through them: those of the base, then the layers over it, the uppermost first.
 *
 *   X(NAME, prefix, side, effects, account)
 *
 * prefix:  of the lobe's functions in its file:
 *            init: prepares the lobe for one wo; for one of the base it also says how often to
 *              sample it, and layering.h calls it;
 *            struct vec3 prefix_evaluate(b, wo, wi, cover, &pdf): f |wi.z| with all weights, and
 *              the density of the lobe's samples times its selection probability; called only
 *              where the lobe has a density;
 *            enum lobe_result prefix_sample(b, wo, w, u, v, &sample);
 *          and of a layer, called where its effect acts:
 *            void prefix_init(b, params, wo);
 *            float prefix_share(b, &rest): how often to sample it, about the share of light that it
 *              reflects; rest: what the layers above leave along wo, times what this one leaves;
 *            void prefix_cover(b, wi, near, far, &cover): what it leaves of what lies below (lobe.h).
 * side:    the side of wi on which it is evaluated.
 * effects: kernel variants without any of these are compiled without the lobe; of a layer: that
 *          which brings it.
 * account: the effect that its time is charged to (profile_scope.h).
 *
 * tests (tests/statistics): test_bsdf_lobes tests each row alone, samples against densities
 * (chi-square) and furnace; test_bsdf_chi_square and test_bsdf_energy test whole surfaces of the
 * base's lobes, test_bsdf_layers_chi_square and test_bsdf_layers_energy all others.
 *
 * REFLECTION: everything that reflects at the base's microfacets (metal, plastic, thin wall; also
 * the interface's reflection, which INTERFACE samples). DIFFUSE and DIFFUSE_TRANSMISSION also
 * sample, by the cosine, the multiple-scattering compensation on their sides. */
#define BSDF_LOBE_MAP(X)                                                                         \
    X(DIFFUSE, diffuse, ABOVE, EFFECTS_ALL,                                                      \
      ACCOUNT(vec3_is_black(b->diffuse.color), MULTIPLE_SCATTERING, DIFFUSE))                    \
    X(REFLECTION, reflection, ABOVE, EFFECT_GLOSSY | EFFECT_MIRROR,                              \
      ACCOUNT(b->base.smooth, MIRROR, GLOSSY))                                                   \
    X(INTERFACE, interface, BELOW, EFFECT_DIELECTRIC | EFFECT_ROUGH_DIELECTRIC,                  \
      ACCOUNT(b->base.smooth, DIELECTRIC, ROUGH_DIELECTRIC))                                     \
    X(THIN_WALL, thin_wall, BELOW, EFFECT_THIN_TRANSMISSION, PROFILE_ACCOUNT(THIN_TRANSMISSION))       \
    X(DIFFUSE_TRANSMISSION, diffuse_transmission, BELOW,                                         \
      EFFECT_DIFFUSE_TRANSMISSION | EFFECT_ROUGH_DIELECTRIC,                                     \
      ACCOUNT(vec3_is_black(b->diffuse_transmission.color), MULTIPLE_SCATTERING,                 \
              DIFFUSE_TRANSMISSION))                                                             \
    BSDF_LAYER_MAP(X)
#define BSDF_LAYER_MAP(X)                                                                        \
    X(COAT, coat, ABOVE, EFFECT_CLEARCOAT, PROFILE_ACCOUNT(CLEARCOAT))                           \
    X(SHEEN, sheen, ABOVE, EFFECT_SHEEN, PROFILE_ACCOUNT(SHEEN))

enum bsdf_lobe {
#define BSDF_LOBE_ENUM(name, ...) BSDF_LOBE_##name,
    BSDF_LOBE_MAP(BSDF_LOBE_ENUM)
#undef BSDF_LOBE_ENUM
    BSDF_LOBES
};

/* Shortcuts for the most common surfaces. */
enum bsdf_kind {
    BSDF_KIND_BLACK,   /* scatters nothing */
    BSDF_KIND_LAMBERT, /* no reflection: exactly base_color / pi */
    BSDF_KIND_METAL,   /* rough metal only */
    BSDF_KIND_LOBES,   /* any sum of lobes */
};

/* ---- what bsdf_init prepares for the lobes ----------------------------------------------------- */

/* The first part of struct bsdf_params, clamped. */
struct bsdf_material {
    struct vec3 base_color;
    real metallic, alpha, ior /* relative to what surrounds it */, specular;
    struct vec3 specular_color;
    real transmission;
    int refractive, inside;
};

/* The share of each kind in the base; they add up to 1. */
struct bsdf_weights {
    real metal, plastic, glass;
    real wall, diffuse; /* of plastic: what passes through a thin wall; what has a Lambert base */
};

/* Fresnel term of plastic and glass, `specular` included. */
struct bsdf_dielectric {
    int exact; /* ior is not 0: Fresnel's equations are known */
    struct vec3 f0;
    real f90;
    real normal_f0, inverse_rest_f0; /* the plain term at normal incidence, 1 / (1 - it) */
};

/* lobe_reflection.h */
struct bsdf_reflection {
    struct vec3 f0; /* Schlick's ends, with all weights */
    real f90;
    int schlick;          /* only Schlick's formula between them */
    struct vec3 eta, k;   /* of a conductor, relative to what surrounds it */
    real interreflection; /* of a conductor */
};

/* lobe_interface.h */
struct bsdf_interface {
    struct vec3 tint;   /* base colour of transmitted light, with all weights */
    int only;           /* its weight is 1: there is no other reflection and no base */
    int transmit_delta; /* refraction is a delta lobe */
};

/* lobe_thin_wall.h */
struct bsdf_thin_wall {
    struct vec3 tint; /* as the interface's */
    struct microfacets spread;
};

/* lobe_diffuse.h, lobe_diffuse_transmission.h */
struct bsdf_lambert {
    struct vec3 color; /* over pi, with all weights and wo's share */
};

/* lobe_diffuse.h: of a rough base; set where `diffuse` is not black */
struct bsdf_rough_diffuse {
    real a, b;            /* coefficients of single scattering */
    struct vec3 multiple; /* colour of multiple scattering over pi, with wo's share */
    real wide;            /* share of the lobe's samples that are uniform over directions */
};

/* layer.h: what plastic's reflection leaves for what lies below it */
struct bsdf_layer {
    real f0, f90;             /* ends of the mean reflectance */
    real returned;            /* share of the microfacets' loss that is returned */
    real reflected_o, rest_o; /* what it reflects, and leaves, along wo */
    int exact;                /* the Fresnel term is the exact one, not Schlick's */
    struct albedo_row row;
    struct albedo_exact exact_row;
};

/* compensation.h: of metal's and plastic's reflection; of a rough interface */
struct bsdf_compensation {
    struct albedo_loss_row loss;
    struct albedo_stretched stretched_loss;
    struct vec3 color;     /* colour (1 - E(wo)) / (pi mean loss), with all weights */
    real graze, graze_log; /* share of the diffuse lobe that is sampled towards the horizon,
                                    log((1 + alpha) / alpha) */
};
struct bsdf_interface_compensation {
    int on;
    struct albedo_interface loss_near, loss_far;
    real near;       /* as `color` above: to wo's side */
    struct vec3 far; /* and to the other, with 1 / eta^2 */
};

/* lobe_coat.h */
struct bsdf_coat {
    real weight; /* 0: none */
    struct vec3 normal;
    int exact; /* Fresnel's equations for `ior`, also for the metal below */
    real ior;  /* relative */
    real f0, f90;
    struct microfacets micro;
    real cos_o, rest_o;
    struct albedo_row row;
    struct albedo_loss_row loss;
    struct albedo_exact exact_row;
};

/* lobe_sheen.h */
struct bsdf_sheen {
    struct vec3 color; /* black: none */
    real most, alpha;  /* its largest component; Charlie's alpha */
    real fit[5], fit_half;
    real lambda_o, limit_o, rest_o;
};

/* Fields below `material` are set only as far as the kind and the effects need them. */
struct bsdf {
    enum bsdf_kind kind;
    int has_delta, has_smooth; /* any delta lobe; any lobe with a density */
    uint8_t account;           /* the account charged for the base's time (profile_scope.h) */
    real cos_o;
    real eta; /* n on the far side / n on wo's side */
    struct bsdf_lambert diffuse;
    struct bsdf_material material;

    uint64_t effects;          /* that act here: those of BSDF_CALL_MAP, and compensation's */
    uint32_t lobes;            /* bit BSDF_LOBE_x: the lobe is sampled */
    uint32_t smooth_lobes;     /* ... the lobe is evaluated: it has a density */
    real lobe_pdf[BSDF_LOBES]; /* selection probabilities, 0 for absent lobes */

    struct bsdf_weights weights;
    struct microfacets base; /* what metal, plastic and glass share */
    struct bsdf_dielectric dielectric;
    struct bsdf_rough_diffuse rough_diffuse;
    struct bsdf_reflection reflection;
    struct bsdf_layer layer;
    struct bsdf_compensation compensation;
    struct bsdf_interface interface;
    struct bsdf_interface_compensation interface_compensation;
    struct bsdf_thin_wall thin_wall;
    struct bsdf_lambert diffuse_transmission;
    struct thin_film thin_film;
    struct bsdf_coat coat;
    struct bsdf_sheen sheen;
};

enum bsdf_flags {
    BSDF_DELTA = 1,        /* the lobe has no density: pdf is 0, MIS weight is 1 */
    BSDF_TRANSMISSION = 2, /* wi is on the other side */
    BSDF_REFRACTION = 4,   /* ... and the medium changed (not a thin wall) */
};

struct bsdf_sample {
    struct vec3 wi;
    struct vec3 weight; /* f * |cos wi| / pdf */
    real pdf;           /* solid angle; 0 for a delta lobe */
    int flags;
    enum bsdf_lobe lobe; /* that chose wi; BSDF_LOBES: none */
    real eta_scale;      /* squared relative ior for Russian roulette: product of eta^2 */
};

/* Prepare for one wo (unit, wo.z > 0). Clamps params to their ranges. This and what
 * follows begin the stage of scattering (profile_scope.h). */
void bsdf_init(struct bsdf *b, const struct bsdf_params *params, struct vec3 wo);

/* f(wo, wi) * |wi.z| of all lobes that have a density; black for a delta-only surface. */
struct vec3 bsdf_eval(const struct bsdf *b, struct vec3 wo, struct vec3 wi);

/* Solid-angle density with which bsdf_sample picks wi by lobes that have a density. */
real bsdf_pdf(const struct bsdf *b, struct vec3 wo, struct vec3 wi);

/* eval and pdf together, which share work; next-event estimation calls this. */
struct vec3 bsdf_eval_pdf(const struct bsdf *b, struct vec3 wo, struct vec3 wi, real *pdf);

/* Sample wi. u_lobe, u, v in [0,1). Returns 0 for "no sample" (absorbed). For smooth lobes
 * weight is the sum over all lobes' f over the mixture pdf. Charges the lobe (profile_scope.h). */
int bsdf_sample(const struct bsdf *b, struct vec3 wo, real u_lobe, real u, real v, struct bsdf_sample *out);

/* What the smooth base and a smooth coat over it send from one direction to wo: reflected, or refracted if `transmits`.
 * Sets wi, and the weight f |cos wi| without the delta function. 0: it has no such lobe, or reflects totally. A coat that is bent by a
 * map of its own is left out. */
int bsdf_delta(const struct bsdf *b, struct vec3 wo, int transmits, struct vec3 *wi, struct vec3 *weight);

/* Exact unpolarised Fresnel reflectance; cos_i >= 0, eta = n_t / n_i > 0. 1 at total
 * internal reflection, 0 for eta = 1. */
real fresnel_dielectric(real cos_i, real eta);

/* Schlick's term at a grazing angle: 1, and less for an interface that hardly refracts. */
static inline real bsdf_f90_of(real f0)
{
    return f0 < BSDF_FADE_F0 && SAFEGUARD(F90_FADE) ? f0 * (1.0f / BSDF_FADE_F0) : 1.0f;
}
