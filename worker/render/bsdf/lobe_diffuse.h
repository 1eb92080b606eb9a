/* lobe_diffuse: the Lambert base (Lambert 1760), f = color / pi, scaled by what the layers above it
 * leave on the way in and on the way out (layer.h):
 *
 *   f = color rest(mu_o) rest(mu_i) / (pi mean(rest))
 *
 * It samples multiple-scattering compensation (compensation.h), too. At a small alpha that is a
 * function of mu / alpha that falls off as its square: a share of the samples has the density
 * 1 / (mu + alpha) in mu, for cosine sampling would rarely find it, and then weigh it by thousands.
 */
#ifndef AZULEJO_RENDER_LOBE_DIFFUSE_H
#define AZULEJO_RENDER_LOBE_DIFFUSE_H

#include "worker/render/bsdf/compensation.h"
#include "worker/render/bsdf/layer.h"
#include "worker/render/bsdf/lobe.h"
#include "worker/render/bsdf/lobe_coat.h"

/* Grazing samples below this alpha. */
#define GRAZE_ALPHA 0.05f

/* ---- sampling by the cosine, and towards the horizon ------------------------------------------- */

/* Divide the lobe between the compensation's share and the Lambert base's. */
static inline void graze_init(struct bsdf *b, float compensation, float diffuse)
{
    const float alpha = b->base.shape.y;

    if (alpha < GRAZE_ALPHA && compensation > 0.0f) {
        b->compensation.graze = 0.75f * compensation / (compensation + diffuse);
        b->compensation.graze_log = det_log((1.0f + alpha) / alpha);
    }
}

static inline int is_grazing(const struct bsdf *b)
{
    return CALLS_FOR(b, MULTIPLE_SCATTERING) && b->compensation.graze > 0.0f;
}

static inline float wide_density(const struct bsdf *b, float mu)
{
    const struct bsdf_compensation *c = &b->compensation;

    if (is_grazing(b))
        return mu * INV_PI_F * (1.0f - c->graze) +
               c->graze * INV_2PI_F / ((mu + b->base.shape.y) * c->graze_log);
    return mu * INV_PI_F;
}

static inline struct vec3 wide_sample(const struct bsdf *b, float u, float v)
{
    const struct bsdf_compensation *c = &b->compensation;

    if (is_grazing(b)) {
        if (u < c->graze) {
            float mu = b->base.shape.y * (det_exp(u / c->graze * c->graze_log) - 1.0f);
            float radius, sine, cosine;
            mu = clamp_to(mu, 1e-7f, 1);
            radius = sqrtf((1.0f - mu) * (1.0f + mu));
            sincos_turn(v, &sine, &cosine);
            return (struct vec3){radius * cosine, radius * sine, mu};
        }
        u = clamp_to((u - c->graze) / (1.0f - c->graze), 0, ONE_MINUS_EPSILON);
    }
    return cosine_hemisphere(u, v);
}

/* ---- the lobe ------------------------------------------------------------------------------------ */

/* rest(mu_o) / mean(rest), times the base's weight. `rest` is the mean of what plastic leaves;
 * `coated`: on both ways the light passes the coat, too. */
static inline float lambert_scale(const struct bsdf *b, float rest, int coated)
{
    const struct bsdf_coat *c = &b->coat;

    if (CALLS_FOR(b, CLEARCOAT) && coated)
        /* The mean is that of the product of what both layers leave: not below the product of the
         * means, and above it by at most this. */
        rest = rest * coat_rest_average(c) +
               SCHLICK_VARIANCE * b->layer.f90 * (c->weight * c->f90);
    return b->weights.diffuse * b->layer.rest_o / rest;
}

/* Share of the base that diffuse transmission has. */
static inline float transmitted_share(const struct bsdf *b, const struct bsdf_params *params)
{
    return CALLS_FOR(b, DIFFUSE_TRANSMISSION) ? clamp_to(params->diffuse_transmission, 0, 1) : 0;
}

/* Returns how often to sample it. `rest` as above. */
static inline float diffuse_init(struct bsdf *b, const struct bsdf_params *params, float rest)
{
    float scale = lambert_scale(b, rest, is_covered_near(b)) *
                  (1.0f - transmitted_share(b, params));

    b->diffuse.color = vec3_scale(b->material.base_color, scale * INV_PI_F);
    if (vec3_is_black(b->diffuse.color))
        return -1.0f;
    return vec3_average(b->diffuse.color) * PI_F * rest;
}

static inline struct vec3 diffuse_evaluate(const struct bsdf *b, struct vec3 wo, struct vec3 wi,
                                           const struct cover *cover, float *pdf)
{
    float loss = compensation_loss(b, wi);
    struct vec3 f = LOBE_BLACK;

    (void)wo;
    if (b->weights.diffuse > 0.0f)
        f = vec3_scale(b->diffuse.color, layer_rest(b, wi.z, loss) * wi.z * cover->diffuse);
    if (CALLS_FOR(b, MULTIPLE_SCATTERING))
        f = vec3_mad(f, b->compensation.color, loss * wi.z * cover->lobe);
    if (LOBE_ENABLED(EFFECT_ROUGH_DIELECTRIC) && b->interface_compensation.on)
        f = vec3_add(f, vec3_splat(interface_compensation_near(b, wi.z) * cover->lobe));
    *pdf = b->lobe_pdf[BSDF_LOBE_DIFFUSE] * wide_density(b, wi.z);
    return f;
}

static inline enum lobe_result diffuse_sample(const struct bsdf *b, struct vec3 wo, float w,
                                              float u, float v, struct bsdf_sample *out)
{
    (void)wo, (void)w;
    out->wi = wide_sample(b, u, v);
    return LOBE_SMOOTH;
}

#endif
