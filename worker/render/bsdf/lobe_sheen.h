/* lobe_sheen: cloth's Charlie distribution with its shadowing (Conty Estevez and Kulla 2017,
 * "Production Friendly Microfacet Sheen BRDF", as in KHR_materials_sheen).
 *
 * Below alpha 0.1 the model itself sends out more light than comes in at grazing angles (its
 * directional albedo, albedo.h, is above 1). There it is divided by the larger of the two
 * directions' albedos, which keeps it reciprocal.
 *
 *   f = color D(h) / (4 mu_o mu_i (1 + Lambda(mu_o) + Lambda(mu_i)))
 *   D(h) = (2 + 1/alpha) sin(theta_h)^(1/alpha) / (2 pi)
 *
 * What lies below is scaled by what the sheen leaves, along the brighter of the two directions
 * (glTF's rule). Sampled uniformly over the hemisphere.
 */
#ifndef AZULEJO_RENDER_LOBE_SHEEN_H
#define AZULEJO_RENDER_LOBE_SHEEN_H

#include "common/math/elementary.h"
#include "worker/render/bsdf/lobe.h"

/* Nearer to the horizon the fit shadows too little, and 1 / mu diverges. */
#define SHEEN_MU_MIN (SAFEGUARD(SHEEN_HORIZON) ? 1e-4f : 1e-30f)

/* The shadowing's fit at this alpha: a / (1 + b x^c) + d x + e. */
static inline void sheen_fit(float alpha, float fit[5])
{
    static const float ends[5][2] = {{21.5473f, 25.3245f}, {3.82987f, 3.32435f},
                                     {0.19823f, 0.16801f}, {-1.97760f, -1.27393f},
                                     {-4.32054f, -4.85967f}};
    float t = (1.0f - alpha) * (1.0f - alpha);

    for (int i = 0; i < 5; i++)
        fit[i] = ends[i][0] + (ends[i][1] - ends[i][0]) * t;
}

static inline float sheen_curve(const float fit[5], float x)
{
    return fit[0] / (1.0f + fit[1] * det_pow(x, fit[2])) + fit[3] * x + fit[4];
}

/* Lambda(mu); half = sheen_curve(fit, 0.5), the fit's point of symmetry. */
static inline float sheen_lambda(const float fit[5], float half, float mu)
{
    return det_exp(mu < 0.5f ? sheen_curve(fit, mu) : 2.0f * half - sheen_curve(fit, 1.0f - mu));
}

/* D of a half vector whose squared sine with the normal is sin2. */
static inline float sheen_density(float alpha, float sin2)
{
    float inverse = 1.0f / alpha;
    return (2.0f + inverse) * INV_2PI_F * det_pow(sin2 < 1.0f ? sin2 : 1.0f, 0.5f * inverse);
}

/* Directional albedo before its colour, scaled to at most 1; *limit is the scale. */
static inline float sheen_albedo(const struct bsdf_sheen *s, float mu, float *limit)
{
    float e = albedo_sheen_at(s->alpha, float_min(fabsf(mu), 1.0f));

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

static inline float sheen_share(const struct bsdf *b, float *rest)
{
    float limit, above = *rest;

    *rest *= b->sheen.rest_o;
    return vec3_average(b->sheen.color) * sheen_albedo(&b->sheen, b->cos_o, &limit) * above;
}

static inline void sheen_cover(const struct bsdf *b, struct vec3 wi, int near, int far,
                               struct cover *cover)
{
    float rest_i = 1.0f, limit;

    if (far)
        rest_i -= b->sheen.most * sheen_albedo(&b->sheen, wi.z, &limit);
    rest_i = float_min(near ? b->sheen.rest_o : 1.0f, rest_i);
    cover->lobe *= rest_i;
    cover->diffuse *= rest_i;
}

/* f mu_i before its colour. */
static inline float sheen_value(const struct bsdf_sheen *s, struct vec3 wo, float mu_o,
                                struct vec3 wi)
{
    struct vec3 h = vec3_add(wo, wi);
    float length2 = vec3_length_squared(h), limit_i, lambda;

    if (!(length2 > HALF_LENGTH2_MIN))
        return 0;
    lambda = 1.0f + s->lambda_o + sheen_lambda(s->fit, s->fit_half, wi.z);
    sheen_albedo(s, wi.z, &limit_i);
    return sheen_density(s->alpha, (h.x * h.x + h.y * h.y) / length2) *
           float_min(s->limit_o, limit_i) * float_min(wi.z * (1.0f / SHEEN_MU_MIN), 1.0f) /
           (4.0f * float_max(mu_o, SHEEN_MU_MIN) * lambda);
}

static inline struct vec3 sheen_evaluate(const struct bsdf *b, struct vec3 wo, struct vec3 wi,
                                         const struct cover *cover, float *pdf)
{
    *pdf = b->lobe_pdf[BSDF_LOBE_SHEEN] * INV_2PI_F;
    return vec3_scale(b->sheen.color, sheen_value(&b->sheen, wo, b->cos_o, wi) * cover->sheen);
}

static inline enum lobe_result sheen_sample(const struct bsdf *b, struct vec3 wo, float w, float u,
                                            float v, struct bsdf_sample *out)
{
    float z = 1.0f - u, radius = sqrtf(u * (1.0f + z)), s, c;

    (void)b, (void)wo, (void)w;
    sincos_turn(v, &s, &c);
    out->wi = (struct vec3){radius * c, radius * s, z};
    return LOBE_SMOOTH;
}

#endif
