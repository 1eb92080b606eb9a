/* bsdf: how a surface scatters light, at one point, for one outgoing direction.
 *
 * Directions are unit vectors in the local shading frame, z along the normal on the side
 * of wo: wo.z > 0 always (the caller flips the frame for a hit from behind). wi.z > 0 is
 * reflection, wi.z < 0 transmission. Values are radiance throughput (camera paths): f
 * includes 1/eta^2 for refraction. All functions are pure and use only deterministic
 * arithmetic; no result is ever NaN, infinite or negative.
 *
 * The material is glTF 2.0's, metallic m and transmission t:
 *   m * metal + (1 - m) * ((1 - t) * plastic + t * glass)
 * metal    GGX reflection, Schlick from the base colour to 1.
 * plastic  GGX reflection, Schlick from F0 = min(((ior-1)/(ior+1))^2 specular_color, 1) *
 *          specular to F90 = specular, over a Lambert base. glTF's plain mix of the two by
 *          F(v.h) sends out almost twice what comes in at grazing angles, so the base is
 *          scaled by what the reflection leaves on the way in and on the way out
 *          (albedo.h): reciprocal, a white smooth plastic sends out exactly 1.
 *          F90 fades to 0 below ior 1.2, so that ior 1 is no interface at all: Schlick's
 *          formula, made for 1.2 to 2.2, would keep a bright rim.
          thin_slab counts all the reflections between the wall's sides.
          diffuse_transmission sends that share of the base through, into the other half.
 * glass    refractive: one rough interface (Walter et al. 2007, but with masking and
 *          shadowing fully correlated in transmission: bsdf.c) with the exact Fresnel
 *          term, remapped so that it begins at F0 and ends at F90 (total internal
 *          reflection is always 1); reflection or refraction is chosen for the sampled
 *          microfacet. Transmitted light is base_color * (1 - max component of F).
 *          thin wall: plastic's reflection; light passes with GGX spread and mirrored half
 *          vector (KHR_materials_transmission), tinted, scaled by 1 minus the larger of
 *          the mean reflectances along wo and wi: reciprocal, never gains energy. Its
 *          spread fades to none as ior goes from 1.5 to 1, as glTF viewers have it.
 * A conductor is the metal with the exact Fresnel term of its complex index.
 *
 * Over and in them, each absent at 0:
 *   multiple scattering between microfacets: what GGX loses (albedo.h) is given back as a wide
 *          lobe f = color (1 - E(wo)) (1 - E(wi)) / (pi (1 - E_average)) after Kulla and Conty
 *          2017, coloured by the mean Fresnel term as if it were a geometric series; plastic's
 *          share that does not leave at once goes to its base; a rough interface gives back on
 *          both sides, split so that it stays reciprocal. Reciprocal, and white stays white.
 *   stretched  GGX with alpha_stretched along x.
 *   film   iridescence (film.h) replaces the Fresnel term by its weight.
 *   sheen  Charlie's distribution (sheen.h) over all of that, which is scaled by what the
 *          sheen leaves along the brighter of the two directions (glTF's rule).
 *   coat   GGX with Schlick's term and a normal of its own over everything. What lies below is
 *          scaled by the lesser share that the coat leaves along wo and wi, the Lambert base by
 *          the product of both over its mean: reciprocal, never gains energy.
 * Sheen and coat lie on the outside of a refractive object and on both sides of a thin wall.
 *
 * Special cases: alpha < BSDF_ALPHA_MIN is smooth (delta lobes); ior 0 is Fresnel 1 at F0
 * (no bending); a refraction that would spread by less than BSDF_SPREAD_MIN is a delta
 * lobe, so ior 1 passes straight whatever alpha, and so does an ior that is ior_outside.
 */
#ifndef AZULEJO_RENDER_BSDF_H
#define AZULEJO_RENDER_BSDF_H

#include "common/math/vec.h"
#include "worker/render/bsdf/albedo.h"
#include "worker/render/bsdf/fresnel.h"

/* GGX alpha below this is a perfect mirror (a delta lobe). */
#define BSDF_ALPHA_MIN 1e-3f
/* F90 of plastic and of coats reaches its full value at this F0 (ior 1.2). */
#define BSDF_FADE_F0 (1.0f / 121.0f)
/* Rough refraction with alpha * |eta - 1| below this is a delta lobe: floats could not
 * resolve its half vector, and nobody its blur (radians). */
#define BSDF_SPREAD_MIN 1e-4f
/* Larger indices are clamped to this (F0 = 0.996). */
#define BSDF_IOR_MAX 1000.0f

/* The material's values at the hit point, textures applied. */
struct bsdf_params {
    struct vec3 base_color;     /* 0..1 */
    float metallic;             /* 0..1 */
    float alpha;                /* GGX alpha = roughness^2, 0..1 */
    float ior;                  /* > 0, below 1 where it is relative to what is around (ice in
                                   water), or 0: Fresnel is exactly 1; else clamped */
    float specular;             /* weight of the dielectric reflection, 0..1 */
    struct vec3 specular_color; /* scales F0 of the dielectric, >= 0 */
    float transmission;         /* 0..1 */
    int refractive;             /* transmission refracts; else thin wall */
    int inside;                 /* refractive: wo is inside the object (hit from behind) */
    float ior_outside;          /* of what surrounds the object, >= 1; 0 counts as 1. Every
                                   index here is absolute: a larger one outside is fine */

    /* Everything below is absent when 0 (memset), whatever the rest says. */
    float alpha_stretched;      /* anisotropy: GGX alpha along the frame's x, >= alpha, which then
                                   is the one along y; 0: isotropic */
    int conductor;              /* Fresnel of a metal with eta, k at R, G, B (relative to vacuum),
                                   times base_color; metallic, specular, transmission, ... unused */
    struct vec3 eta, k;
    float clearcoat;            /* weight 0..1 */
    float clearcoat_alpha, clearcoat_ior;
    struct vec3 clearcoat_normal; /* unit, in the shading frame (z = 1: the same normal) */
    struct vec3 sheen_color;    /* 0..1 */
    float sheen_alpha;          /* Charlie's alpha: roughness^2 */
    float iridescence;          /* weight 0..1 */
    float iridescence_ior, iridescence_thickness_nm;
    float diffuse_transmission; /* share of the Lambert base that goes through, 0..1 */
    struct vec3 diffuse_transmission_color;
    float base_interreflection; /* 0..<1 (scene.h): plastic is pbrt's coat, with Fresnel's exact term
                                   for an ior of 1.2 to 3; a conductor's clearcoat likewise */
    int thin_slab;              /* thin wall: R' = 2 R / (1 + R) */
    int single_scattering;      /* do not give back what microfacets lose among themselves
                                   (--without multiple-scattering) */
};

/* The lobes that are chosen between. All reflection with Schlick's or a conductor's Fresnel
 * term (metal, plastic, thin wall) is one lobe; a refractive interface, both ways, is one. */
enum bsdf_lobe {
    BSDF_LOBE_DIFFUSE,   /* cosine: Lambert, and what is given back above */
    BSDF_LOBE_REFLECT,
    BSDF_LOBE_INTERFACE,
    BSDF_LOBE_THIN,
    BSDF_LOBE_BELOW,     /* cosine, on the other side */
    BSDF_LOBE_COAT,
    BSDF_LOBE_SHEEN,
    BSDF_LOBES_MAX
};

/* Shortcuts for the surfaces that most scenes are made of. */
enum bsdf_kind {
    BSDF_KIND_BLACK,   /* scatters nothing */
    BSDF_KIND_LAMBERT, /* no reflection: exactly base_color / pi */
    BSDF_KIND_METAL,   /* rough metal only */
    BSDF_KIND_MIX,     /* metal, plastic, glass, thin walls */
    BSDF_KIND_LAYERED, /* and everything that struct bsdf_params may leave 0 */
};

/* The first part of struct bsdf_params, clamped. */
struct bsdf_base {
    struct vec3 base_color;
    float metallic, alpha, ior /* relative to what surrounds it */, specular;
    struct vec3 specular_color;
    float transmission;
    int refractive, inside;
};

/* GGX: alpha along y (and x, if not stretched), alpha along x. */
struct bsdf_shape {
    float y, y2, x, x2;
};

/* What only BSDF_KIND_LAYERED has. */
struct bsdf_layers {
    int stretched;
    struct albedo_stretched stretched_loss;
    int conductor;
    struct vec3 eta, k;          /* relative to what surrounds it */
    float interreflection;
    int slab;
    int exact_coat;              /* plastic's Fresnel term is the exact one */
    struct albedo_exact exact;   /* ... or the coat's over a metal */
    float weight_metal, weight_plastic;

    float film;                  /* weight of iridescence */
    float film_ior, film_path;   /* relative index; 2 n d in nm */
    struct vec3 film_f0;         /* plastic's or glass's F0 without `specular` */

    int covered;                 /* sheen and coat lie on wo's side */
    int through;                 /* they lie on the far side, or on both: what passes is scaled */
    float coat;                  /* weight; 0: none */
    struct vec3 coat_normal;
    int coat_smooth;
    int coat_exact;              /* Fresnel's term for coat_ior, and the metal below knows of it */
    float coat_ior;              /* relative */
    struct bsdf_shape coat_shape;
    float coat_f0, coat_f90, coat_cos_o, coat_root_o, coat_rest_o;
    struct albedo_row coat_row;
    struct albedo_loss_row coat_loss;

    struct vec3 sheen;           /* colour; black: none */
    float sheen_most, sheen_alpha;
    float sheen_fit[5], sheen_fit_half;
    float sheen_lambda_o, sheen_limit_o, sheen_rest_o;

    struct vec3 diffuse_below;   /* Lambert / pi to the other side, as `diffuse` */
};

/* Fields below `eta` are set only as far as the kind needs them. */
struct bsdf {
    enum bsdf_kind kind;
    int has_delta, has_smooth;  /* any delta lobe; any lobe with a density */
    float cos_o;
    struct vec3 diffuse;        /* Lambert / pi with all weights and wo's share */
    struct bsdf_base p;
    float eta;                  /* n on the far side / n on wo's side */

    float lobe_cdf[BSDF_LOBES_MAX]; /* selection probabilities, accumulated; as many as the
                                       kind has, the last of them is 1 */
    float lobe_pdf[BSDF_LOBES_MAX];
    struct bsdf_shape shape;
    float root_o;               /* microfacet.h */
    struct vec3 f0;             /* reflect lobe: Schlick's ends, with all weights */
    float f90;

    int compensated;            /* multiple scattering is given back */
    struct albedo_loss_row loss;
    struct vec3 given_back;     /* colour (1 - E(wo)) / (pi mean loss), with all weights */
    float graze, graze_log;     /* share of the diffuse lobe that is sampled towards the horizon,
                                   log((1 + alpha) / alpha): lobes.h */

    int smooth;                 /* reflection (and refraction) is a delta lobe */
    int transmit_delta;         /* refraction is a delta lobe */
    int thin_delta;
    int exact;                  /* interface: exact Fresnel; else Schlick (ior 0) */
    struct vec3 f0_dielectric;
    float f90_dielectric;
    float normal_f0, inverse_rest_f0; /* interface: F at normal incidence, 1 / (1 - it) */
    float weight_interface;
    int interface_only;         /* its weight is 1: there is no other reflection and no base */
    struct vec3 tint;           /* base colour of transmitted light, with all weights */
    float layer_f0, layer_f90;  /* what scales the base: ends of the mean reflectance */
    float layer_given_back;     /* and the share of what microfacets lose that comes back */
    float layer_o;              /* mean reflectance along wo */
    struct albedo_row row;
    struct bsdf_shape thin_shape;
    float thin_root_o;

    int interface_compensated;
    struct albedo_interface loss_near, loss_far;
    float given_back_near;      /* as given_back, by the interface: to wo's side */
    struct vec3 given_back_far; /* and to the other, with 1 / eta^2 */

    struct bsdf_layers layers;
};

enum bsdf_flags {
    BSDF_DELTA = 1,        /* the lobe has no density: pdf is 0, MIS weight is 1 */
    BSDF_TRANSMISSION = 2, /* wi is on the other side */
    BSDF_REFRACTION = 4,   /* ... and the medium changed (not a thin wall) */
};

struct bsdf_sample {
    struct vec3 wi;
    struct vec3 weight;    /* f * |cos wi| / pdf */
    float pdf;             /* solid angle; 0 for a delta lobe */
    int flags;
    float eta_scale;       /* squared relative ior for Russian roulette: product of eta^2 */
};

/* Prepare for one wo (unit, wo.z > 0). Clamps params into their ranges. Charges what scatters
 * (charge.h), or leaves the charge as it is. */
void bsdf_init(struct bsdf *b, const struct bsdf_params *params, struct vec3 wo);

/* f(wo, wi) * |wi.z| of all lobes that have a density; black for a delta-only surface. */
struct vec3 bsdf_eval(const struct bsdf *b, struct vec3 wo, struct vec3 wi);

/* Solid-angle density with which bsdf_sample picks wi by lobes that have a density. */
float bsdf_pdf(const struct bsdf *b, struct vec3 wo, struct vec3 wi);

/* eval and pdf together, sharing the work: what next-event estimation calls. */
struct vec3 bsdf_eval_pdf(const struct bsdf *b, struct vec3 wo, struct vec3 wi, float *pdf);

/* Sample wi. u_lobe, u, v in [0,1). Returns 0 for "no sample" (absorbed). For smooth lobes
 * weight is the sum over all lobes' f over the mixture pdf. Charges the lobe (charge.h). */
int bsdf_sample(const struct bsdf *b, struct vec3 wo, float u_lobe, float u, float v,
                struct bsdf_sample *out);

/* Exact unpolarised Fresnel reflectance; cos_i >= 0, eta = n_t / n_i > 0. 1 at total
 * internal reflection, 0 for eta = 1. */
float fresnel_dielectric(float cos_i, float eta);

/* What Schlick's term comes to at a grazing angle: 1, and for what hardly refracts less. */
static inline float bsdf_f90_of(float f0)
{
    return f0 < BSDF_FADE_F0 ? f0 * (1.0f / BSDF_FADE_F0) : 1.0f;
}

#endif
