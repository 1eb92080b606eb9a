/* lobe_sheen: cloth's Charlie distribution with its shadowing (Conty Estevez and Kulla 2017, "Production Friendly
 * Microfacet Sheen BRDF", as in KHR_materials_sheen).
 *
 * Below alpha 0.1 the model itself sends out more light than comes in at grazing angles (its directional albedo,
 * albedo.h, is above 1). There it is divided by the larger of the two directions' albedos, which keeps it reciprocal.
 *
 *   f = color D(h) / (4 mu_o mu_i (1 + Lambda(mu_o) + Lambda(mu_i)))
 *   D(h) = (2 + 1/alpha) sin(theta_h)^(1/alpha) / (2 pi)
 *
 * What lies below is scaled by what the sheen leaves, along the brighter of the two directions (glTF's rule). Sampled
 * uniformly over the hemisphere.
 */
#pragma once

#include "common/math/elementary.h"
#include "worker/render/bsdf/lobe.h"

/* Nearer to the horizon the fit shadows too little, and 1 / mu diverges. */
#define SHEEN_MU_MIN (SAFEGUARD(SHEEN_HORIZON) ? REAL(1e-4) : REAL(1e-30))

/* The shadowing's fit at this alpha: a / (1 + b x^c) + d x + e. */
static inline void sheen_fit(real alpha, real fit[5])
{
    static const real ends[5][2] = {{REAL(21.5473), REAL(25.3245)}, {REAL(3.82987), REAL(3.32435)},
                                     {REAL(0.19823), REAL(0.16801)}, {-REAL(1.97760), -REAL(1.27393)},
                                     {-REAL(4.32054), -REAL(4.85967)}};
    real t = (1.0f - alpha) * (1.0f - alpha);

    for (int i = 0; i < 5; i++)
        fit[i] = ends[i][0] + (ends[i][1] - ends[i][0]) * t;
}

static inline real sheen_curve(const real fit[5], real x)
{
    return fit[0] / (1.0f + fit[1] * real_pow(x, fit[2])) + fit[3] * x + fit[4];
}

/* Lambda(mu); half = sheen_curve(fit, 0.5), the fit's point of symmetry. */
static inline real sheen_lambda(const real fit[5], real half, real mu)
{
    return real_exp(mu < 0.5f ? sheen_curve(fit, mu) : 2.0f * half - sheen_curve(fit, 1.0f - mu));
}

/* D of a half vector whose squared sine with the normal is sin2. */
static inline real sheen_density(real alpha, real sin2)
{
    real inverse = 1.0f / alpha;
    return (2.0f + inverse) * REAL_INV_2PI * real_pow(sin2 < 1.0f ? sin2 : 1.0f, 0.5f * inverse);
}

/* Directional albedo before its colour, scaled to at most 1; *limit is the scale. */
static inline real sheen_albedo(const struct bsdf_sheen *s, real mu, real *limit)
{
    real e = albedo_sheen_at(s->alpha, real_min(real_abs(mu), 1.0f));

    *limit = e > 1.0f && SAFEGUARD(SHEEN_LIMIT) ? 1.0f / e : 1.0f;
    return e > 1.0f ? 1.0f : e;
}

static inline void sheen_init(struct bsdf *b, const struct bsdf_params *p, struct vec3 wo)
{
    struct bsdf_sheen *s = &b->sheen;

    (void)wo;
    s->color = clamp_color(p->sheen_color, 1);
    s->most = vec3_max(s->color);
    s->alpha = clamp_to(p->sheen_alpha, BSDF_SHEEN_ALPHA_MIN, 1);
    sheen_fit(s->alpha, s->fit);
    s->fit_half = sheen_curve(s->fit, 0.5f);
    s->lambda_o = sheen_lambda(s->fit, s->fit_half, b->cos_o);
    s->rest_o = 1.0f - s->most * sheen_albedo(s, b->cos_o, &s->limit_o);
}

static inline real sheen_share(const struct bsdf *b, real *rest)
{
    real limit, above = *rest;

    *rest *= b->sheen.rest_o;
    return vec3_average(b->sheen.color) * sheen_albedo(&b->sheen, b->cos_o, &limit) * above;
}

static inline void sheen_cover(const struct bsdf *b, struct vec3 wi, int near, int far, struct cover *cover)
{
    real rest_i = 1.0f, limit;

    if (far)
        rest_i -= b->sheen.most * sheen_albedo(&b->sheen, wi.z, &limit);
    rest_i = real_min(near ? b->sheen.rest_o : 1.0f, rest_i);
    cover->lobe *= rest_i;
    cover->diffuse *= rest_i;
}

/* f mu_i before its colour. */
static inline real sheen_value(const struct bsdf_sheen *s, struct vec3 wo, real mu_o, struct vec3 wi)
{
    struct vec3 h = vec3_add(wo, wi);
    real length2 = vec3_length_squared(h), limit_i, lambda;

    if (!(length2 > HALF_LENGTH2_MIN))
        return 0;
    lambda = 1.0f + s->lambda_o + sheen_lambda(s->fit, s->fit_half, wi.z);
    sheen_albedo(s, wi.z, &limit_i);
    return sheen_density(s->alpha, (h.x * h.x + h.y * h.y) / length2) * real_min(s->limit_o, limit_i) *
           real_min(wi.z * (1.0f / SHEEN_MU_MIN), 1.0f) / (4.0f * real_max(mu_o, SHEEN_MU_MIN) * lambda);
}

static inline struct vec3 sheen_evaluate(const struct bsdf *b, struct vec3 wo, struct vec3 wi,
                                         const struct cover *cover, real *pdf)
{
    *pdf = b->lobe_pdf[BSDF_LOBE_SHEEN] * REAL_INV_2PI;
    return vec3_scale(b->sheen.color, sheen_value(&b->sheen, wo, b->cos_o, wi) * cover->sheen);
}

static inline enum lobe_result sheen_sample(const struct bsdf *b, struct vec3 wo, real w, real u, real v,
                                            struct bsdf_sample *out)
{
    real z = 1.0f - u, radius = real_sqrt(u * (1.0f + z)), s, c;

    (void)b, (void)wo, (void)w;
    sincos_turn(v, &s, &c);
    out->wi = (struct vec3){radius * c, radius * s, z};
    return LOBE_SMOOTH;
}
