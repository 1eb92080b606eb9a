/* lobe_diffuse_transmission: light that a Lambertian base sends out on its other side
 * (KHR_materials_diffuse_transmission): a share of the base, with its own colour.
 *
 *   f = color rest(mu_o) rest(mu_i) / (pi mean(rest))
 *
 * Sampled by the cosine, like the compensation that a rough interface sends there (compensation.h).
 */
#pragma once

#include "worker/render/bsdf/lobe_diffuse.h"

/* Returns how often to sample it; arguments as diffuse_init's. */
static inline real diffuse_transmission_init(struct bsdf *b, const struct bsdf_params *params, real rest)
{
    struct vec3 color = clamp_color(params->diffuse_transmission_color, 1);
    real scale = lambert_scale(b, rest, is_covered_near(b) && is_covered_far(b)) * transmitted_share(b, params);

    b->diffuse_transmission.color = vec3_scale(color, scale * REAL_INV_PI);
    if (vec3_is_black(b->diffuse_transmission.color))
        return -1.0f;
    return vec3_average(b->diffuse_transmission.color) * REAL_PI * rest;
}

static inline struct vec3 diffuse_transmission_evaluate(const struct bsdf *b, struct vec3 wo, struct vec3 wi,
                                                        const struct cover *cover, real *pdf)
{
    real mu = -wi.z;

    (void)wo;
    *pdf = b->lobe_pdf[BSDF_LOBE_DIFFUSE_TRANSMISSION] * (mu * REAL_INV_PI);
    if (!(b->weights.diffuse > 0.0f)) /* only the interface's compensation */
        return LOBE_BLACK;
    return vec3_scale(b->diffuse_transmission.color, layer_rest(b, mu, compensation_loss(b, wi)) * mu * cover->diffuse);
}

static inline enum lobe_result diffuse_transmission_sample(const struct bsdf *b, struct vec3 wo, real w, real u, real v,
                                                           struct bsdf_sample *out)
{
    (void)wo, (void)w;
    out->wi = cosine_hemisphere(u, v);
    out->wi.z = -out->wi.z;
    out->flags = BSDF_TRANSMISSION | (b->material.refractive ? BSDF_REFRACTION : 0);
    if (b->interface_compensation.on && vec3_is_black(b->diffuse_transmission.color))
        out->eta_scale = b->eta * b->eta;
    return LOBE_SMOOTH;
}
