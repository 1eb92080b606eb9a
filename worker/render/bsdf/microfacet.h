/* microfacet: the GGX distribution with Smith masking, as far as the integrator needs it. All
 * directions are local, z along the normal.
 *
 * With alpha2 = alpha^2 and root(mu) = sqrt(alpha2 + (1 - alpha2) mu^2), for mu = |cos|:
 *   G1(mu)          = 2 mu / (mu + root(mu))
 *   G2(mu_o, mu_i)  = 2 mu_o mu_i / (mu_i root(mu_o) + mu_o root(mu_i))   (height-correlated)
 * (Heitz 2014, JCGT 3(2), rearranged so that no tangent, hence no infinity, appears.)
 * Stretched, with ax along x and ay along y, the same holds with
 *   root(w) = sqrt(ax^2 wx^2 + ay^2 wy^2 + wz^2).
 */
#pragma once

#include "common/base/safeguard.h"
#include "common/math/elementary.h"
#include "common/math/vec.h"
#include "worker/render/bsdf/warp.h"
#include "worker/render/base/gate.h"

/* The distribution's widths: alpha along y (and x, if not stretched), alpha along x. */
struct ggx {
    real y, y2, x, x2;
    int stretched;
};

/* Microfacets seen along wo. */
struct microfacets {
    struct ggx shape;
    real root_o; /* root(wo) */
    int smooth;  /* a mirror: reflection (and refraction) is a delta lobe */
};

static inline real ggx_root(real alpha2, real mu) { return real_sqrt(alpha2 + (1.0f - alpha2) * (mu * mu)); }

static inline real ggx_stretched_root(real x2, real y2, struct vec3 w)
{
    return real_sqrt(x2 * (w.x * w.x) + y2 * (w.y * w.y) + w.z * w.z);
}

/* D(h) for a half vector of any length, length2 = |h|^2 > 0. The usual form's
 * (n.h)^2 (alpha2 - 1) + 1 cancels for a small alpha; this one only adds. */
static inline real ggx_density(real alpha2, struct vec3 h, real length2)
{
    real spread = h.x * h.x + h.y * h.y + alpha2 * (h.z * h.z);
    real ratio = length2 / spread;

    if (!SAFEGUARD(GGX_DENSITY))
        ratio = 1.0f / (h.z * h.z / length2 * (alpha2 - 1.0f) + 1.0f);
    return alpha2 * REAL_INV_PI * (ratio * ratio);
}

static inline real ggx_stretched_density(real alpha_x, real alpha_y, struct vec3 h, real length2)
{
    real spread = h.x * h.x * (alpha_y / alpha_x) + h.y * h.y * (alpha_x / alpha_y) + alpha_x * alpha_y * (h.z * h.z);
    real ratio = length2 / spread;

    return alpha_x * alpha_y * REAL_INV_PI * (ratio * ratio);
}

/* Sample a microfacet normal with the density G1(wo) D(h) (wo.h) / wo.z: the spherical caps of
 * Dupuy and Benyoub 2023 (Computer Graphics Forum 42(8)). wo.z > 0. */
static inline struct vec3 ggx_sample_visible(struct vec3 wo, real alpha_x, real alpha_y, real u, real v)
{
    real x = alpha_x * wo.x, y = alpha_y * wo.y, z = wo.z, side2 = x * x + y * y;
    real scale = 1.0f / real_sqrt(side2 + z * z), below, above, sine, s, c;
    struct vec3 h;

    x *= scale;
    y *= scale;
    z *= scale;
    /* The cap's height is (1 - u)(1 + z) - z. 1 minus it and 1 plus it are computed separately,
     * because near 1 the height itself has no digits left for the sine. The same goes for 1 - z. */
    below = u * (1.0f + z);
    above = (1.0f - u) * (1.0f + z) + side2 * (scale * scale) / (1.0f + z);
    sine = real_sqrt(below * above);
    sincos_turn(v, &s, &c);
    h.x = alpha_x * (sine * c + x);
    h.y = alpha_y * (sine * s + y);
    h.z = (1.0f - below) + z;
    /* Both vectors lie above the plane they span, up to rounding. */
    h.z = h.z > REAL(1e-7) ? h.z : REAL(1e-7);
    return vec3_scale(h, 1.0f / real_sqrt(vec3_length_squared(h)));
}

/* ---- of either shape --------------------------------------------------------------------------- */

static inline struct ggx ggx_make(real alpha_y, real alpha_x, int stretched)
{
    return (struct ggx){alpha_y, alpha_y * alpha_y, alpha_x, alpha_x * alpha_x, stretched};
}

static inline int ggx_is_stretched(const struct ggx *g)
{
    return calls_for(EFFECTS_ALL, EFFECT_ANISOTROPY) && g->stretched;
}

static inline real ggx_root_of(const struct ggx *g, struct vec3 w)
{
    return ggx_is_stretched(g) ? ggx_stretched_root(g->x2, g->y2, w) : ggx_root(g->y2, w.z);
}

static inline real ggx_density_of(const struct ggx *g, struct vec3 h, real length2)
{
    return ggx_is_stretched(g) ? ggx_stretched_density(g->x, g->y, h, length2) : ggx_density(g->y2, h, length2);
}

static inline struct vec3 ggx_sample_of(const struct ggx *g, struct vec3 wo, real u, real v)
{
    return ggx_sample_visible(wo, ggx_is_stretched(g) ? g->x : g->y, g->y, u, v);
}

/* ---- reflection and transmission --------------------------------------------------------------- */

/* Squared length of a half vector below which its direction is undefined. */
#define HALF_LENGTH2_MIN REAL(1e-20)

/* Density of reflecting at a visible normal, D G1(wo) / (4 wo.z), for the half vector between wo
 * and wi, both above the surface; 0 if there is none. *cos_h is wo.h; *shadowing is G2 / G1. */
static inline real reflection_density(const struct microfacets *m, struct vec3 wo, real mu_o, struct vec3 wi,
                                      real *cos_h, real *shadowing)
{
    struct vec3 h = vec3_add(wo, wi);
    real length2 = vec3_length_squared(h), root_i = ggx_root_of(&m->shape, wi);

    if (!(length2 > HALF_LENGTH2_MIN))
        return 0;
    *cos_h = 0.5f * real_sqrt(length2);
    *shadowing = wi.z * (mu_o + m->root_o) / (wi.z * m->root_o + mu_o * root_i);
    return ggx_density_of(&m->shape, h, length2) * 0.5f / (mu_o + m->root_o);
}

/* G(wo, wi) / G1(wo) for transmission, fully correlated: G = min(G1(wo), G1(wi)). Walter's product
 * of the two loses half the light at grazing angles even if the index is 1 and nothing bends. This
 * form has the right limit, is reciprocal too, and samples drawn with G1(wo) never gain energy. */
static inline real transmission_shadowing(real mu_o, real root_o, real mu_i, real root_i)
{
    real ratio = mu_i * (mu_o + root_o) / (mu_o * (mu_i + root_i));

    if (!SAFEGUARD(CORRELATED_SHADOW))
        return 2.0f * mu_i / (mu_i + root_i);
    return ratio < 1.0f ? ratio : 1.0f;
}

static inline struct vec3 reflect_about(struct vec3 wo, struct vec3 h)
{
    return vec3_sub(vec3_scale(h, 2.0f * vec3_dot(wo, h)), wo);
}
