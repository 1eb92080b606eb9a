/* lobe_thin_wall: transmission through a wall without thickness (KHR_materials_transmission): GGX
 * with the half vector mirrored at the wall, tinted, scaled by 1 minus the larger of plastic's mean
 * reflectances along wo and wi. This is reciprocal and never gains energy.
 *
 *   f = tint (1 - max(R(mu_o), R(mu_i))) D G / (4 mu_o mu_i)
 *
 * The blur fades out as ior goes from 1.5 to 1, as in glTF viewers.
 */
#pragma once

#include "worker/render/base/health_scope.h"
#include "worker/render/bsdf/compensation.h"
#include "worker/render/bsdf/layer.h"
#include "worker/render/bsdf/lobe.h"

/* Returns how often to sample it. `base` is the mean of the base colour. */
static inline real thin_wall_init(struct bsdf *b, struct vec3 wo, real base)
{
    /* No blur at ior 1, full blur from 1.5 on. The factor scales the roughness, not alpha. */
    struct microfacets *m = &b->thin_wall.spread;
    real n = b->material.ior, scale, y, x;

    if (n < 1.0f && n > 0.0f) /* in a denser medium */
        n = 1.0f / n;
    scale = n == 0.0f ? 1.0f : clamp_to(2.0f * n - 2.0f, 0, 1);
    scale *= scale;
    x = y = b->material.alpha * scale;
    if (ggx_is_stretched(&b->base.shape)) {
        x = b->base.shape.x * scale;
        y = x < BSDF_ALPHA_MIN ? y : real_max(y, BSDF_ALPHA_MIN);
    }
    m->shape = ggx_make(y, x, b->base.shape.stretched);
    m->smooth = alpha_is_smooth(x);
    m->root_o = ggx_root_of(&m->shape, wo);
    b->thin_wall.tint = vec3_scale(b->material.base_color, b->weights.wall);
    if (!(b->layer.reflected_o < 1.0f))
        return -1.0f;
    return b->weights.wall * base * (1.0f - b->layer.reflected_o);
}

static inline struct vec3 thin_wall_evaluate(const struct bsdf *b, struct vec3 wo, struct vec3 wi,
                                             const struct cover *cover, real *pdf)
{
    const struct microfacets *m = &b->thin_wall.spread;
    struct vec3 mirrored = {wi.x, wi.y, -wi.z};
    real cos_h, shadowing, reflected_i, reflected;
    real density = reflection_density(m, wo, b->cos_o, mirrored, &cos_h, &shadowing);

    *pdf = 0;
    if (!(density > 0.0f))
        return health_density(density), LOBE_BLACK;
    reflected_i = 1.0f - layer_rest(b, mirrored.z, compensation_loss(b, mirrored));
    reflected = real_max(reflected_i, b->layer.reflected_o);
    shadowing = transmission_shadowing(b->cos_o, m->root_o, mirrored.z, ggx_root_of(&m->shape, mirrored));
    *pdf = b->lobe_pdf[BSDF_LOBE_THIN_WALL] * density;
    return vec3_scale(vec3_scale(b->thin_wall.tint, (1.0f - reflected) * shadowing * density), cover->lobe);
}

/* Straight through, or by the mirrored half vector. */
static inline enum lobe_result thin_wall_sample(const struct bsdf *b, struct vec3 wo, real w, real u, real v,
                                                struct bsdf_sample *out)
{
    const struct microfacets *m = &b->thin_wall.spread;

    (void)w;
    out->flags = BSDF_TRANSMISSION;
    if (m->smooth) {
        out->wi = vec3_neg(wo);
        out->weight = vec3_scale(b->thin_wall.tint, (1.0f - b->layer.reflected_o) / b->lobe_pdf[BSDF_LOBE_THIN_WALL]);
        return LOBE_DELTA;
    }
    out->wi = reflect_about(wo, ggx_sample_of(&m->shape, wo, u, v));
    out->wi.z = -out->wi.z;
    return out->wi.z < 0.0f ? LOBE_SMOOTH : LOBE_NOTHING;
}
