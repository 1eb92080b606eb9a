/* lobe_diffuse: the diffuse base, scaled by what the layers above it leave on the way in and on the way out (layer.h).
 * A smooth base is Lambertian (1760):
 *
 *   f = color rest(mu_o) rest(mu_i) / (pi mean(rest))
 *
 * A rough base has the EON BRDF in place of color / pi (Portsmouth, Kutz and Hill 2025, "EON: A Practical
 * Energy-Preserving Rough Diffuse BRDF", Journal of Computer Graphics Techniques 14(1)): Fujii's form of the Oren-Nayar
 * model, with multiple scattering that returns what it loses. With roughness r, A = 1 / (1 + c1 r), B = r A, c1 = 1/2 -
 * 2/(3 pi), c2 = 2/3 - 28/(15 pi):
 *
 *   f_ss = color / pi (A + B s/t),  s = wo.wi - mu_o mu_i,  t = s > 0 ? max(mu_o, mu_i) : 1
 *   f_ms = color_ms / pi (1 - E(mu_o)) (1 - E(mu_i)) / (1 - E_mean)
 *   1 - E(mu) = B (c1 - G(mu) / pi),  E_mean = A (1 + c2 r),  1 - E_mean = B (c1 - c2)
 *   G(mu) = sin (theta - sin mu) + 2/3 (sin (1 - sin^3) / mu - sin)
 *   color_ms = color^2 E_mean / (1 - color (1 - E_mean))
 *
 * E is the exact directional albedo of f_ss for white, so a white base reflects exactly 1.
 *
 * It also samples multiple-scattering compensation (compensation.h). At a small alpha the compensation is a function of
 * mu / alpha that falls off as its square. Cosine sampling would rarely find it, and then with weights in the
 * thousands, so a share of the samples has the density 1 / (mu + alpha) in mu.
 */
#pragma once

#include "worker/render/bsdf/compensation.h"
#include "worker/render/bsdf/layer.h"
#include "worker/render/bsdf/lobe.h"
#include "worker/render/bsdf/lobe_coat.h"

/* Sample towards the horizon below this alpha. */
#define GRAZE_ALPHA REAL(0.05)

/* ---- EON ----------------------------------------------------------------------------------------- */

#define EON_C1 REAL(0.28779341)
#define EON_C2 REAL(0.07248821)
/* The variance of cosine sampling grows towards the horizon, where s/t is large. This share of the
 * samples of a base of roughness 1 is therefore uniform. For white, at mu 0.003, 0.05, 0.4 and 1,
 * it lowers the variance from 1.78, 0.93, 0.29 and 0.005 to 0.52, 0.48, 0.28 and 0.005. */
#define EON_WIDE REAL(0.35)
/* Largest mean of Schlick's weight over a hemisphere, minus the mean over the light of a base of B = 1. */
#define EON_SPREAD REAL(0.0083)

static inline int is_rough_diffuse(const struct bsdf *b)
{
    return calls_for(b->effects, EFFECT_ROUGH_DIFFUSE) && !vec3_is_black(b->diffuse.color);
}

/* (1 - E(mu)) / B. */
static inline real eon_loss(real mu)
{
    real sine = real_sqrt(real_max((1.0f - mu) * (1.0f + mu), 0.0f)), g;

    /* sin (1 - sin^3) / mu without cancellation */
    g = sine * mu * (1.0f + sine + sine * sine) / (1.0f + sine);
    g = sine * (real_acos(mu) - sine * mu) + (2.0f / REAL(3.0)) * (g - sine);
    return real_max(EON_C1 - g * REAL_INV_PI, 0.0f);
}

static inline real eon_multiple(real color, real mean) { return color * mean / (1.0f - color * (1.0f - mean)); }

/* b->diffuse.color is the Lambertian colour. */
LOBE_RARE void eon_init(struct bsdf *b, real roughness)
{
    struct bsdf_rough_diffuse *d = &b->rough_diffuse;
    struct vec3 base = b->material.base_color, color = b->diffuse.color;
    real r = clamp_to(roughness, 0, 1), mean, lost;

    d->a = 1.0f / (1.0f + EON_C1 * r);
    d->b = r * d->a;
    mean = d->a * (1.0f + EON_C2 * r);
    lost = d->b * eon_loss(b->cos_o) / (EON_C1 - EON_C2);
    d->multiple = (struct vec3){color.x * eon_multiple(base.x, mean) * lost,
                                color.y * eon_multiple(base.y, mean) * lost,
                                color.z * eon_multiple(base.z, mean) * lost};
    d->wide = EON_WIDE * r * (1.0f - b->cos_o);
}

/* f mu_i. */
LOBE_RARE struct vec3 eon_value(const struct bsdf *b, struct vec3 wo, struct vec3 wi)
{
    const struct bsdf_rough_diffuse *d = &b->rough_diffuse;
    real s = wo.x * wi.x + wo.y * wi.y;
    real slope = s > 0.0f ? s * (wi.z / real_max(b->cos_o, wi.z)) : s * wi.z;
    real single = real_max(d->a * wi.z + d->b * slope, 0.0f);

    return vec3_mad(vec3_scale(b->diffuse.color, single), d->multiple, eon_loss(wi.z) * wi.z);
}

/* ---- sampling by the cosine, and towards the horizon ------------------------------------------- */

/* Divide the lobe between the compensation's share and the Lambertian base's. */
static inline void graze_init(struct bsdf *b, real compensation, real diffuse)
{
    const real alpha = b->base.shape.y;

    if (SAFEGUARD(GRAZE_SHARE) && alpha < GRAZE_ALPHA && compensation > 0.0f) {
        b->compensation.graze = 0.75f * compensation / (compensation + diffuse);
        b->compensation.graze_log = real_log((1.0f + alpha) / alpha);
    }
}

static inline int is_grazing(const struct bsdf *b)
{
    return calls_for(b->effects, EFFECT_MULTIPLE_SCATTERING) && b->compensation.graze > 0.0f;
}

/* Without the part that a rough base adds. */
static inline real narrow_density(const struct bsdf *b, real mu)
{
    const struct bsdf_compensation *c = &b->compensation;

    if (is_grazing(b))
        return mu * REAL_INV_PI * (1.0f - c->graze) + c->graze * REAL_INV_2PI / ((mu + b->base.shape.y) * c->graze_log);
    return mu * REAL_INV_PI;
}

static inline real wide_density(const struct bsdf *b, real mu)
{
    real density = narrow_density(b, mu), wide = b->rough_diffuse.wide;

    return is_rough_diffuse(b) ? density + wide * (REAL_INV_2PI - density) : density;
}

static inline struct vec3 direction_of(real mu, real v)
{
    real radius = real_sqrt((1.0f - mu) * (1.0f + mu)), sine, cosine;

    sincos_turn(v, &sine, &cosine);
    return (struct vec3){radius * cosine, radius * sine, mu};
}

static inline struct vec3 wide_sample(const struct bsdf *b, real u, real v)
{
    const struct bsdf_compensation *c = &b->compensation;

    if (is_rough_diffuse(b)) {
        real wide = b->rough_diffuse.wide;
        if (u < wide)
            return direction_of(clamp_to(1.0f - u / wide, REAL(1e-7), 1), v);
        u = clamp_to((u - wide) / (1.0f - wide), 0, REAL_BELOW_ONE);
    }
    if (is_grazing(b)) {
        if (u < c->graze) {
            real mu = b->base.shape.y * (real_exp(u / c->graze * c->graze_log) - 1.0f);
            return direction_of(clamp_to(mu, REAL(1e-7), 1), v);
        }
        u = clamp_to((u - c->graze) / (1.0f - c->graze), 0, REAL_BELOW_ONE);
    }
    return cosine_hemisphere(u, v);
}

/* ---- the lobe ------------------------------------------------------------------------------------ */

/* rest(mu_o) / mean(rest), times the base's weight. `rest` is the mean of what plastic leaves.
 * `coated`: the light passes the coat, too, on both ways. */
static inline real lambert_scale(const struct bsdf *b, real rest, int coated)
{
    const struct bsdf_coat *c = &b->coat;

    if (calls_for(b->effects, EFFECT_CLEARCOAT) && coated)
        /* The mean of the product of what both layers leave: at least the product of the means, and
         * above it by at most this. */
        rest = rest * coat_rest_average(c) + SCHLICK_VARIANCE * b->layer.f90 * (c->weight * c->f90);
    return b->weights.diffuse * b->layer.rest_o / rest;
}

/* Seen from above, a rough base reflects less towards the horizon than a Lambertian one. So the
 * mean of what the layers leave, over the base's light, exceeds their mean over a hemisphere, by at
 * most this (tests/statistics/test_rough_diffuse.c). Adding it keeps white below 1. */
static inline real eon_rest_spread(const struct bsdf *b, real roughness)
{
    real r = clamp_to(roughness, 0, 1), spread = EON_SPREAD * b->layer.f90;

    if (calls_for(b->effects, EFFECT_CLEARCOAT))
        spread += EON_SPREAD * b->coat.weight * b->coat.f90;
    return spread * r / (1.0f + EON_C1 * r);
}

/* The share of the base that diffuse transmission takes. */
static inline real transmitted_share(const struct bsdf *b, const struct bsdf_params *params)
{
    return calls_for(b->effects, EFFECT_DIFFUSE_TRANSMISSION) ? clamp_to(params->diffuse_transmission, 0, 1) : 0;
}

/* Returns how often to sample it. `rest` as above. */
static inline real diffuse_init(struct bsdf *b, const struct bsdf_params *params, real rest)
{
    real scale, rough = params->diffuse_roughness;

    if (calls_for(b->effects, EFFECT_ROUGH_DIFFUSE))
        rest += eon_rest_spread(b, rough);
    scale = lambert_scale(b, rest, is_covered_near(b)) * (1.0f - transmitted_share(b, params));
    b->diffuse.color = vec3_scale(b->material.base_color, scale * REAL_INV_PI);
    if (vec3_is_black(b->diffuse.color))
        return -1.0f;
    if (calls_for(b->effects, EFFECT_ROUGH_DIFFUSE))
        eon_init(b, rough);
    return vec3_average(b->diffuse.color) * REAL_PI * rest;
}

static inline struct vec3 diffuse_evaluate(const struct bsdf *b, struct vec3 wo, struct vec3 wi,
                                           const struct cover *cover, real *pdf)
{
    real loss = compensation_loss(b, wi);
    struct vec3 f = LOBE_BLACK;

    if (is_rough_diffuse(b))
        f = vec3_scale(eon_value(b, wo, wi), layer_rest(b, wi.z, loss) * cover->diffuse);
    else if (b->weights.diffuse > 0.0f)
        f = vec3_scale(b->diffuse.color, layer_rest(b, wi.z, loss) * wi.z * cover->diffuse);
    if (calls_for(b->effects, EFFECT_MULTIPLE_SCATTERING))
        f = vec3_mad(f, b->compensation.color, loss * wi.z * cover->lobe);
    if (calls_for(EFFECTS_ALL, EFFECT_ROUGH_DIELECTRIC) && b->interface_compensation.on)
        f = vec3_add(f, vec3_splat(interface_compensation_near(b, wi.z) * cover->lobe));
    *pdf = b->lobe_pdf[BSDF_LOBE_DIFFUSE] * wide_density(b, wi.z);
    return f;
}

static inline enum lobe_result diffuse_sample(const struct bsdf *b, struct vec3 wo, real w, real u, real v,
                                              struct bsdf_sample *out)
{
    (void)wo, (void)w;
    out->wi = wide_sample(b, u, v);
    return LOBE_SMOOTH;
}
