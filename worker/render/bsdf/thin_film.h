/* thin_film: reflectance of a thin film on a base, for iridescence. Not a lobe: it replaces the
 * Fresnel term of reflection and interface, in proportion to its weight.
 *
 * Belcour and Barla 2017 (ACM TOG 36(4), 65) in the simplified form of KHR_materials_iridescence:
 * unpolarised, the Airy series truncated after the second order, the eye's response to a cosine of
 * the wavelength in closed form from Gaussian fits. Two things differ: the upper interface has the
 * exact Fresnel term, and below FILM_FADE_NM the film's index fades to that of its surroundings (as
 * in the authors' own code). Both are needed so that a film of thickness 0 has no effect.
 */
#pragma once

#include "common/math/elementary.h"
#include "common/math/vec.h"
#include "worker/render/bsdf/fresnel.h"
#include "worker/render/bsdf/warp.h"

#define FILM_FADE_NM 30.0f
/* No colour component of the response exceeds this (tests/unit/render/test_bsdf_layers.c). */
#define FILM_RESPONSE_MAX REAL(1.8)

struct thin_film {
    real weight;
    real ior;       /* relative to its surroundings */
    real path_nm;   /* 2 n d */
    struct vec3 f0; /* of the plastic or glass below it, without `specular` */
};

/* e^-x for x >= 0, to 2e-6. */
static inline real thin_film_exp(real x)
{
#ifdef AZULEJO_DOUBLE
    return real_exp(-x);
#else
    real t = x * REAL(1.4426950), f;
    int whole;

    if (SAFEGUARD(THICK_FILM) && !(t < 120.0f))
        return 0.0f;
    whole = (int)t;
    f = (t - (real)whole) * -REAL(0.69314718);
    f = 1.0f + f * (1.0f + f * (0.5f + f * (REAL(1.6666667e-1) + f * (REAL(4.1666667e-2) +
        f * (REAL(8.3333333e-3) + f * (REAL(1.3888889e-3) + f * REAL(1.9841270e-4)))))));
    return f * float_from_bits((uint32_t)(127 - whole) << 23);
#endif
}

/* amplitude cos(2 pi turns) e^-x */
static inline real thin_film_wave(real turns, real x, real amplitude)
{
    real s, c, e = thin_film_exp(x);

    if (e == 0.0f)
        return 0.0f;
    turns -= real_floor(turns);
    sincos_turn(turns, &s, &c);
    return amplitude * c * e;
}

/* Linear Rec. 709 response to cos(2 pi path / wavelength + shift), path in nm; `half` has 1 for each of X, Y, Z whose
 * shift is half a turn. The fits' constants are those of KHR_materials_iridescence, per nm. */
static inline struct vec3 thin_film_response(real path, struct vec3 half)
{
    real p2 = path * path;
    real x = thin_film_wave(REAL(1.6810e-3) * path + 0.5f * half.x, REAL(1.7085470e-7) * p2, REAL(0.846590)) +
             thin_film_wave(REAL(2.2399e-3) * path + 0.5f * half.x, REAL(1.7876617e-7) * p2, REAL(0.153868));
    real y = thin_film_wave(REAL(1.7953e-3) * path + 0.5f * half.y, REAL(3.6733088e-7) * p2, REAL(1.000222));
    real z = thin_film_wave(REAL(2.2084e-3) * path + 0.5f * half.z, REAL(2.6103525e-7) * p2, REAL(1.001122));

    return (struct vec3){REAL(3.2404542) * x - REAL(1.5371385) * y - REAL(0.4985314) * z,
                         -REAL(0.9692660) * x + REAL(1.8760108) * y + REAL(0.0415560) * z,
                         REAL(0.0556434) * x - REAL(0.2040259) * y + REAL(1.0572252) * z};
}

/* Index of a base that reflects f0 at normal incidence, relative to the film's surroundings. */
static inline real film_base_ior(real f0)
{
    real root = real_sqrt(f0 < REAL(0.9999) || !SAFEGUARD(WHITE_UNDER_FILM) ? f0 : REAL(0.9999));
    return (1.0f + root) / (1.0f - root);
}

/* One component's terms of the series. r12: the upper interface; ior: the film's. */
static inline real thin_film_terms(real f0, real ior, real r12, real cos_2, real *shift, real *c1, real *c2)
{
    real base = film_base_ior(f0), n = (base - ior) / (base + ior), r1 = n * n;
    real r23 = r1 + (1.0f - r1) * schlick_weight(cos_2);
    real product = r12 * r23, root, rs;

    product = product > 0.0f ? (product < REAL(0.9999) ? product : REAL(0.9999)) : 0.0f;
    root = real_sqrt(product);
    rs = (1.0f - r12) * (1.0f - r12) * r23 / (1.0f - product);
    *shift = base < ior ? 1.0f : 0.0f;
    *c1 = (rs - (1.0f - r12)) * root;
    *c2 = *c1 * root;
    return r12 + rs;
}

/* Reflectance of the film on a base with F0 = f0 (per component, in the film's surroundings). ior: the film's, relative
 * to its surroundings; path = 2 n d in nm; cos_1 outside the film. Each component in 0..1. */
static inline struct vec3 thin_film_reflectance(real ior, real path, real cos_1, struct vec3 f0)
{
    real sin2 = (1.0f - cos_1 * cos_1) / (ior * ior), r12 = fresnel_exact(cos_1, ior), cos_2;
    struct vec3 sum, shift, c1, c2, response;

    if (!(sin2 < 1.0f))
        return (struct vec3){1, 1, 1};
    cos_2 = real_sqrt(1.0f - sin2);
    path *= cos_2;
    sum.x = thin_film_terms(f0.x, ior, r12, cos_2, &shift.x, &c1.x, &c2.x);
    sum.y = thin_film_terms(f0.y, ior, r12, cos_2, &shift.y, &c1.y, &c2.y);
    sum.z = thin_film_terms(f0.z, ior, r12, cos_2, &shift.z, &c1.z, &c2.z);
    if (ior > 1.0f) /* half a turn at the upper interface, seen from inside */
        shift = (struct vec3){1.0f - shift.x, 1.0f - shift.y, 1.0f - shift.z};
    response = thin_film_response(path, shift);
    sum = vec3_add(sum, vec3_scale(vec3_mul(c1, response), 2.0f));
    response = thin_film_response(2.0f * path, (struct vec3){0, 0, 0});
    sum = vec3_add(sum, vec3_scale(vec3_mul(c2, response), 2.0f));
    sum.x = sum.x > 0.0f ? (sum.x < 1.0f ? sum.x : 1.0f) : 0.0f;
    sum.y = sum.y > 0.0f ? (sum.y < 1.0f ? sum.y : 1.0f) : 0.0f;
    sum.z = sum.z > 0.0f ? (sum.z < 1.0f ? sum.z : 1.0f) : 0.0f;
    return sum;
}

/* No component is larger at normal incidence, for any thickness. */
static inline real thin_film_bound(real ior, struct vec3 f0)
{
    real most = 0, n = (ior - 1.0f) / (ior + 1.0f), r12 = n * n;
    const real components[3] = {f0.x, f0.y, f0.z};

    for (int i = 0; i < 3; i++) {
        real shift, c1, c2, sum = thin_film_terms(components[i], ior, r12, 1.0f, &shift, &c1, &c2);
        sum += 2.0f * FILM_RESPONSE_MAX * (real_abs(c1) + real_abs(c2));
        most = sum > most ? sum : most;
    }
    return most < 1.0f ? most : 1.0f;
}

/* What the film adds to a Fresnel term that Schlick's formula approximates from f0 to 1. It is a
 * difference of the two, so it vanishes at thickness 0 whatever form the term has. */
static inline struct vec3 thin_film_difference(const struct thin_film *film, real cos_1, struct vec3 f0)
{
    struct vec3 f = thin_film_reflectance(film->ior, film->path_nm, cos_1, f0);
    return vec3_sub(f, schlick_mix(f0, 1.0f, schlick_weight(cos_1)));
}
