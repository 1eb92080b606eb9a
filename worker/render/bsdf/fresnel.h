/* fresnel: reflectance of an interface: Schlick 1994 (Computer Graphics Forum 13(3)), Cook and
 * Torrance 1982 (ACM TOG 1(1)) for dielectrics, Born and Wolf 1999 for conductors. */
#pragma once

#include "common/base/safeguard.h"
#include "common/math/vec.h"

/* (1 - cos)^5, Schlick's weight; cos is clamped to 0..1. */
static inline real schlick_weight(real cosine)
{
    real m = 1.0f - real_max(real_min(cosine, 1), 0), m2 = m * m;
    return m2 * m2 * m;
}

/* Its mean over the hemisphere (weighted by the cosine), and its variance. */
#define SCHLICK_MEAN (1.0f / REAL(21.0))
#define SCHLICK_VARIANCE REAL(0.0129)

static inline struct vec3 schlick_mix(struct vec3 f0, real f90, real weight)
{
    return (struct vec3){f0.x + (f90 - f0.x) * weight, f0.y + (f90 - f0.y) * weight, f0.z + (f90 - f0.z) * weight};
}

/* fresnel_dielectric() of bsdf.h, inline: Cook and Torrance's form with the squared relative index. g - c is computed
 * as (eta^2 - 1) / (g + c), so an eta near 1 neither cancels nor divides by 0; eta = 1 gives exactly 0. */
static inline real fresnel_exact(real cos_i, real eta)
{
    real c = real_max(real_min(cos_i, 1), 0);
    real e = (eta - 1.0f) * (eta + 1.0f), g2 = e + c * c, g, sum, difference, a, b, r;

    if (e == 0.0f)
        return 0.0f;
    if (SAFEGUARD(TOTAL_REFLECTION) && !(g2 > 0.0f))
        return 1.0f; /* total internal reflection */
    g = real_sqrt(g2);
    sum = g + c;
    difference = e / sum;
    a = difference / sum;
    b = (c * sum - 1.0f) / (c * difference + 1.0f);
    r = 0.5f * (a * a) * (1.0f + b * b);
    return r < 1.0f || !SAFEGUARD(TOTAL_REFLECTION) ? r : 1.0f;
}

/* Unpolarised reflectance of a conductor with relative index eta + i k, eta > 0, k >= 0, one of
 * them at most 1e4 (Born and Wolf 1999, 14.2). a^2, the real part of the transmitted wave's squared
 * normal component, is computed without cancellation. */
static inline real fresnel_conductor(real cos_i, real eta, real k)
{
    real c = real_max(real_min(cos_i, 1), 0);
    real c2 = c * c, s2 = 1.0f - c2, ek = 2.0f * eta * k;
    real t0 = (eta - k) * (eta + k) - s2, length = real_sqrt(t0 * t0 + ek * ek), a, sum, cross, rs, rp;

    a = real_sqrt(0.5f * (t0 > 0.0f ? length + t0 : length - t0));
    if (!(t0 > 0.0f))
        a = a > 0.0f ? 0.5f * ek / a : 0.0f;
    sum = length + c2;
    cross = 2.0f * a * c;
    if (!(sum + cross > 0.0f))
        return 1.0f;
    rs = (sum - cross) / (sum + cross);
    sum = c2 * length + s2 * s2;
    cross *= s2;
    rp = sum + cross > 0.0f ? rs * (sum - cross) / (sum + cross) : rs;
    rs = 0.5f * (rs + rp);
    return rs < 1.0f ? (rs > 0.0f ? rs : 0.0f) : 1.0f;
}

/* Refract wo about h (wo.h = cos_i > 0), eta = n_far / n_near; 0 at total reflection. */
static inline int refract_about(struct vec3 wo, struct vec3 h, real cos_i, real eta, struct vec3 *wi)
{
    real inverse = 1.0f / eta, sin2_t;
    /* From the tangent, because 1 - cos^2 has few digits near normal incidence. */
    struct vec3 tangent = vec3_sub(vec3_scale(h, cos_i), wo);

    sin2_t = vec3_length_squared(tangent) * (inverse * inverse);
    if (!(sin2_t < 1.0f))
        return 0;
    *wi = vec3_mad(vec3_scale(tangent, inverse), h, -real_sqrt(1.0f - sin2_t));
    return 1;
}
