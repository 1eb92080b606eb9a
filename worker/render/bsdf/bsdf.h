/* bsdf: how a surface scatters light, at one point, for one outgoing direction.
 *
 * Directions are unit vectors in the local shading frame, z along the normal on the side
 * of wo: wo.z > 0 always (the caller flips the frame for a hit from behind). wi.z > 0 is
 * reflection, wi.z < 0 transmission. Values are radiance throughput (camera paths): f
 * includes 1/eta^2 for refraction. All functions are pure and use only deterministic
 * arithmetic; no result is ever NaN or negative.
 *
 * Lobes: Lambert diffuse; GGX reflection (height-correlated Smith, visible normals:
 * Dupuy & Benyoub 2023) as a metal (Schlick with the base colour) or a dielectric; smooth
 * mirror below ALPHA_MIN; smooth and rough refraction (Walter 2007) or thin-wall
 * transmission (KHR_materials_transmission). The mix is glTF 2.0's: lerp(dielectric,
 * metal, metallic), dielectric = lerp(diffuse, transmission, transmission) under a Fresnel
 * reflection, made energy-conserving.
 */
#ifndef AZULEJO_RENDER_BSDF_H
#define AZULEJO_RENDER_BSDF_H

#include "common/math/vec.h"

/* GGX alpha below this is a perfect mirror (a delta lobe). */
#define BSDF_ALPHA_MIN 1e-3f

/* The material's values at the hit point, textures applied. */
struct bsdf_params {
    struct vec3 base_color;     /* 0..1 */
    float metallic;             /* 0..1 */
    float alpha;                /* GGX alpha = roughness^2, 0..1 */
    float ior;                  /* >= 1, or 0: Fresnel is exactly 1 */
    float specular;             /* weight of the dielectric reflection, 0..1 */
    struct vec3 specular_color; /* scales F0 of the dielectric, >= 0 */
    float transmission;         /* 0..1 */
    int refractive;             /* transmission refracts; else thin wall */
    int inside;                 /* refractive: wo is inside the object (hit from behind) */
};

enum { BSDF_LOBES_MAX = 4 };

struct bsdf {
    struct bsdf_params p;
    float eta;                  /* n on the far side / n on wo's side */
    float lobe_cdf[BSDF_LOBES_MAX]; /* selection probabilities, accumulated, last is 1 */
    int has_delta, has_smooth;  /* any delta lobe; any lobe with a density */
    /* the implementation may add fields here */
    struct vec3 f0_dielectric;
    float cos_o;
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

/* Prepare for one wo (unit, wo.z > 0). Clamps params into their ranges. */
void bsdf_init(struct bsdf *b, const struct bsdf_params *params, struct vec3 wo);

/* f(wo, wi) * |wi.z| of all lobes that have a density; black for a delta-only surface. */
struct vec3 bsdf_eval(const struct bsdf *b, struct vec3 wo, struct vec3 wi);

/* Solid-angle density with which bsdf_sample picks wi by lobes that have a density. */
float bsdf_pdf(const struct bsdf *b, struct vec3 wo, struct vec3 wi);

/* eval and pdf together, sharing the work: what next-event estimation calls. */
struct vec3 bsdf_eval_pdf(const struct bsdf *b, struct vec3 wo, struct vec3 wi, float *pdf);

/* Sample wi. u_lobe, u, v in [0,1). Returns 0 for "no sample" (absorbed). For smooth lobes
 * weight is the sum over all lobes' f over the mixture pdf. */
int bsdf_sample(const struct bsdf *b, struct vec3 wo, float u_lobe, float u, float v,
                struct bsdf_sample *out);

/* Exact unpolarised Fresnel reflectance; cos_i >= 0, eta = n_t / n_i > 0. 1 at total
 * internal reflection, 0 for eta = 1. */
float fresnel_dielectric(float cos_i, float eta);

#endif
