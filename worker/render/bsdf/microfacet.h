/* microfacet: the GGX distribution with Smith masking, reduced to what the
 * integrator needs. All directions are local, z along the normal.
 *
 * With alpha2 = alpha^2 and root(mu) = sqrt(alpha2 + (1 - alpha2) mu^2), for mu = |cos|:
 *   G1(mu)          = 2 mu / (mu + root(mu))
 *   G2(mu_o, mu_i)  = 2 mu_o mu_i / (mu_i root(mu_o) + mu_o root(mu_i))   (height-correlated)
 * (Heitz 2014, JCGT 3(2), rearranged so that no tangent, hence no infinity, appears.)
 * Stretched, with ax along x and ay along y, the same holds with
 *   root(w) = sqrt(ax^2 wx^2 + ay^2 wy^2 + wz^2).
 */
#ifndef AZULEJO_RENDER_MICROFACET_H
#define AZULEJO_RENDER_MICROFACET_H

#include "common/math/elementary.h"
#include "common/math/vec.h"
#include "worker/render/bsdf/warp.h"

static inline float ggx_root(float alpha2, float mu)
{
    return sqrtf(alpha2 + (1.0f - alpha2) * (mu * mu));
}

static inline float ggx_stretched_root(float x2, float y2, struct vec3 w)
{
    return sqrtf(x2 * (w.x * w.x) + y2 * (w.y * w.y) + w.z * w.z);
}

/* D(h) for a half vector of any length, length2 = |h|^2 > 0. The usual form's
 * (n.h)^2 (alpha2 - 1) + 1 cancels for a small alpha; this one only adds. */
static inline float ggx_density(float alpha2, struct vec3 h, float length2)
{
    float spread = h.x * h.x + h.y * h.y + alpha2 * (h.z * h.z);
    float ratio = length2 / spread;

    return alpha2 * INV_PI_F * (ratio * ratio);
}

static inline float ggx_stretched_density(float alpha_x, float alpha_y, struct vec3 h,
                                          float length2)
{
    float spread = h.x * h.x * (alpha_y / alpha_x) + h.y * h.y * (alpha_x / alpha_y) +
                   alpha_x * alpha_y * (h.z * h.z);
    float ratio = length2 / spread;

    return alpha_x * alpha_y * INV_PI_F * (ratio * ratio);
}

/* A microfacet normal with the density G1(wo) D(h) (wo.h) / wo.z: the spherical caps of
 * Dupuy and Benyoub 2023 (Computer Graphics Forum 42(8)). wo.z > 0. */
static inline struct vec3 ggx_sample_visible(struct vec3 wo, float alpha_x, float alpha_y, float u,
                                             float v)
{
    float x = alpha_x * wo.x, y = alpha_y * wo.y, z = wo.z, side2 = x * x + y * y;
    float scale = 1.0f / sqrtf(side2 + z * z), below, above, sine, s, c;
    struct vec3 h;

    x *= scale;
    y *= scale;
    z *= scale;
    /* The cap's height is (1 - u)(1 + z) - z; 1 minus it and 1 plus it are taken apart,
     * because near 1 the height itself has no digits left for the sine. 1 - z likewise. */
    below = u * (1.0f + z);
    above = (1.0f - u) * (1.0f + z) + side2 * (scale * scale) / (1.0f + z);
    sine = sqrtf(below * above);
    sincos_turn(v, &s, &c);
    h.x = alpha_x * (sine * c + x);
    h.y = alpha_y * (sine * s + y);
    h.z = (1.0f - below) + z;
    /* Both vectors lie above the plane they span, up to rounding. */
    h.z = h.z > 1e-7f ? h.z : 1e-7f;
    return vec3_scale(h, 1.0f / sqrtf(vec3_length_squared(h)));
}

static inline struct vec3 reflect_about(struct vec3 wo, struct vec3 h)
{
    return vec3_sub(vec3_scale(h, 2.0f * vec3_dot(wo, h)), wo);
}

#endif
