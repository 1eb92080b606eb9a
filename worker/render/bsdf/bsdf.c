#include "worker/render/bsdf/bsdf.h"

#include "common/math/elementary.h"
#include "worker/render/bsdf/lobes.h"
#include "worker/render/bsdf/microfacet.h"
#include "worker/render/bsdf/warp.h"

/* Squared length of a half vector below which it has no direction left. */
#define HALF_LENGTH2_MIN 1e-20f

static const struct vec3 BSDF_NOTHING = {0, 0, 0};

float fresnel_dielectric(float cos_i, float eta) { return fresnel_exact(cos_i, eta); }

static inline int is_finite_sum(struct vec3 f, float pdf)
{
    return f.x + f.y + f.z + pdf < INFINITY; /* nothing negative here; NaN compares false */
}

/* ---- values and densities ------------------------------------------------------------------ */

/* D G1(wo) / (4 wo.z) of the half vector between wo and wi, both above: the density of
 * reflecting a visible normal. *cos_h is wo.h; *shadowing is G2 / G1. */
static inline float reflect_density(const struct bsdf *b, const struct bsdf_shape *shape,
                                    float root_o, struct vec3 wo, struct vec3 wi, float *cos_h,
                                    float *shadowing, int full)
{
    struct vec3 h = vec3_add(wo, wi);
    float length2 = vec3_length_squared(h), root_i = shape_root(b, shape, wi, full);
    float mu_o = b->cos_o;

    if (!(length2 > HALF_LENGTH2_MIN))
        return 0;
    *cos_h = 0.5f * sqrtf(length2);
    *shadowing = wi.z * (mu_o + root_o) / (wi.z * root_o + mu_o * root_i);
    return shape_density(b, shape, h, length2, full) * 0.5f / (mu_o + root_o);
}

static inline struct vec3 metal_eval_pdf(const struct bsdf *b, struct vec3 wo, struct vec3 wi,
                                         float *pdf)
{
    float cos_h, shadowing, density;
    struct vec3 f;

    *pdf = 0;
    if (!(wi.z > 0.0f))
        return BSDF_NOTHING;
    density = reflect_density(b, &b->shape, b->root_o, wo, wi, &cos_h, &shadowing, 0);
    if (!(density > 0.0f))
        return BSDF_NOTHING;
    f = vec3_scale(schlick_color(b, schlick_weight(cos_h)), density * shadowing);
    *pdf = density;
    if (HAS(MULTIPLE_SCATTERING) && b->compensated) {
        CHARGE_SCOPE(MULTIPLE_SCATTERING);
        f = vec3_mad(f, b->given_back, albedo_loss_at(&b->loss, wi.z) * wi.z);
        *pdf = b->lobe_pdf[BSDF_LOBE_REFLECT] * density +
               b->lobe_pdf[BSDF_LOBE_DIFFUSE] * wide_density(b, wi.z);
    }
    if (!is_finite_sum(f, *pdf))
        return *pdf = 0, BSDF_NOTHING;
    return f;
}

/* The base's reflection: everything above but sheen and coat. */
static inline struct vec3 mix_reflection(const struct bsdf *b, struct vec3 wo, struct vec3 wi,
                                         float *pdf, struct layer_scale scale, int full)
{
    struct vec3 f = BSDF_NOTHING;
    float loss = 0;

    *pdf = 0;
    if (HAS(MULTIPLE_SCATTERING) && b->compensated)
        loss = shape_loss(b, wi, full);
    if (b->lobe_pdf[BSDF_LOBE_DIFFUSE] > 0.0f) {
        if (!(BSDF_HAS_INTERFACE && b->interface_only)) {
            float rest = layer_rest(b, wi.z, loss, full) * wi.z;
            f = vec3_scale(b->diffuse, full ? rest * scale.diffuse : rest);
        }
        if (HAS(MULTIPLE_SCATTERING) && b->compensated) {
            float back = loss * wi.z;
            f = vec3_mad(f, b->given_back, full ? back * scale.lobe : back);
        }
        if (BSDF_HAS_BELOW && b->interface_compensated) {
            CHARGE_SCOPE(MULTIPLE_SCATTERING);
            float back = b->given_back_near * wi.z *
                         albedo_interface_loss_at(&b->loss_near, b->shape.y, wi.z);
            f = vec3_add(f, vec3_splat(full ? back * scale.lobe : back));
        }
        *pdf = b->lobe_pdf[BSDF_LOBE_DIFFUSE] * wide_density(b, wi.z);
    }
    if (!b->smooth) {
        float cos_h, shadowing, chosen = b->lobe_pdf[BSDF_LOBE_REFLECT];
        float density =
            reflect_density(b, &b->shape, b->root_o, wo, wi, &cos_h, &shadowing, full);
        if (density > 0.0f) {
            struct vec3 r = reflect_color(b, cos_h, full);
            if (BSDF_HAS_INTERFACE && b->lobe_pdf[BSDF_LOBE_INTERFACE] > 0.0f) {
                struct vec3 interface = interface_color(b, cos_h, full);
                r = vec3_mad(r, interface, b->weight_interface);
                chosen += b->lobe_pdf[BSDF_LOBE_INTERFACE] * interface_choose(b, interface).reflect;
            }
            shadowing *= density;
            f = vec3_mad(f, r, full ? shadowing * scale.lobe : shadowing);
            *pdf += chosen * density;
        }
    }
    return f;
}

/* G(wo, wi) / G1(wo) for transmission, fully correlated: G = min(G1(wo), G1(wi)). Walter's
 * product of the two loses half the light at grazing angles even where the index is 1 and
 * nothing bends at all; this has the right limit, is reciprocal too, and what is sampled by
 * G1(wo) never gains. */
static inline float transmit_shadowing(float mu_o, float root_o, float mu_i, float root_i)
{
    float ratio = mu_i * (mu_o + root_o) / (mu_o * (mu_i + root_i));
    return ratio < 1.0f ? ratio : 1.0f;
}

/* Light through a rough thin wall: the reflection of the mirrored direction. wi.z < 0. */
static inline struct vec3 thin_transmission(const struct bsdf *b, struct vec3 wo, struct vec3 wi,
                                            float *pdf, int full)
{
    struct vec3 mirrored = {wi.x, wi.y, -wi.z};
    float cos_h, shadowing, density, layer_i, layer, loss = 0;

    *pdf = 0;
    density = reflect_density(b, &b->thin_shape, b->thin_root_o, wo, mirrored, &cos_h, &shadowing,
                              full);
    if (!(density > 0.0f))
        return BSDF_NOTHING;
    if (HAS(MULTIPLE_SCATTERING) && b->compensated)
        loss = shape_loss(b, mirrored, full);
    layer_i = 1.0f - layer_rest(b, mirrored.z, loss, full);
    layer = layer_i > b->layer_o ? layer_i : b->layer_o;
    shadowing = transmit_shadowing(b->cos_o, b->thin_root_o, mirrored.z,
                                   shape_root(b, &b->thin_shape, mirrored, full));
    *pdf = b->lobe_pdf[BSDF_LOBE_THIN] * density;
    return vec3_scale(b->tint, (1.0f - layer) * shadowing * density);
}

/* Walter et al. 2007, equations 17 and 21, with h = -(wo + eta wi) normalised towards wo,
 * whose squared length before that is their squared denominator. wi.z < 0. */
static inline struct vec3 rough_refraction(const struct bsdf *b, struct vec3 wo, struct vec3 wi,
                                           float *pdf, int full)
{
    struct vec3 h = vec3_mad(wo, wi, b->eta), f;
    float length2 = vec3_length_squared(h), mu_i = -wi.z, scale, cos_o, cos_i;
    float density, shadowing, keep;

    *pdf = 0;
    if (!(length2 > HALF_LENGTH2_MIN))
        return BSDF_NOTHING;
    scale = 1.0f / sqrtf(length2);
    scale = h.z < 0.0f ? -scale : scale;
    cos_o = vec3_dot(wo, h) * scale;
    cos_i = -vec3_dot(wi, h) * scale;
    if (!(cos_o > 0.0f && cos_i > 0.0f))
        return BSDF_NOTHING;
    f = interface_color(b, cos_o, full);
    keep = 1.0f - vec3_max(f);
    if (!(keep > 0.0f))
        return BSDF_NOTHING;
    density = shape_density(b, &b->shape, h, length2, full) * 2.0f / (b->cos_o + b->root_o) *
              (cos_o * cos_i / length2);
    shadowing =
        transmit_shadowing(b->cos_o, b->root_o, mu_i, shape_root(b, &b->shape, wi, full));
    *pdf = b->lobe_pdf[BSDF_LOBE_INTERFACE] * interface_choose(b, f).transmit *
           density * (b->eta * b->eta);
    return vec3_scale(b->tint, keep * shadowing * density);
}

/* What passes to the other side. */
static inline struct vec3 mix_transmission(const struct bsdf *b, struct vec3 wo, struct vec3 wi,
                                           float *pdf, struct layer_scale scale, int full)
{
    struct vec3 f = BSDF_NOTHING;
    float mu = -wi.z;

    if (HAS(THIN_TRANSMISSION) && b->lobe_pdf[BSDF_LOBE_THIN] > 0.0f && !b->thin_delta)
        f = thin_transmission(b, wo, wi, pdf, full);
    else if (HAS(ROUGH_DIELECTRIC) && b->lobe_pdf[BSDF_LOBE_INTERFACE] > 0.0f &&
             !b->transmit_delta)
        f = rough_refraction(b, wo, wi, pdf, full);
    if ((BSDF_HAS_BELOW || full) && b->lobe_pdf[BSDF_LOBE_BELOW] > 0.0f) {
        if (BSDF_HAS_BELOW && b->interface_compensated) {
            CHARGE_SCOPE(MULTIPLE_SCATTERING);
            f = vec3_mad(f, b->given_back_far,
                         mu * albedo_interface_loss_at(&b->loss_far, b->shape.y, mu));
        }
        *pdf += b->lobe_pdf[BSDF_LOBE_BELOW] * (mu * INV_PI_F);
    }
    if (full) {
        f = vec3_scale(f, scale.lobe);
        if (HAS(DIFFUSE_TRANSMISSION) && b->lobe_pdf[BSDF_LOBE_BELOW] > 0.0f &&
            !b->interface_only) {
            CHARGE_SCOPE(DIFFUSE_TRANSMISSION);
            float loss = HAS(MULTIPLE_SCATTERING) && b->compensated ? shape_loss(b, wi, 1) : 0.0f;
            f = vec3_mad(f, b->layers.diffuse_below,
                         layer_rest(b, mu, loss, 1) * mu * scale.diffuse);
        }
    }
    return f;
}

static inline float coat_value_pdf(const struct bsdf *b, struct vec3 wo, struct vec3 wi,
                                   float *pdf)
{
    const struct bsdf_layers *l = &b->layers;
    struct vec3 h = vec3_add(wo, wi);
    float length2 = vec3_length_squared(h), mu_o = l->coat_cos_o, f, density;
    float mu_i = vec3_dot(l->coat_normal, wi), cos_n = vec3_dot(l->coat_normal, h), root_i;
    float across2;

    *pdf = 0;
    if (!(length2 > HALF_LENGTH2_MIN && mu_i > 0.0f && mu_o > 0.0f))
        return 0;
    mu_i = float_min(mu_i, 1.0f);
    root_i = ggx_root(l->coat_shape.y2, mu_i);
    /* |h x n|^2 from the cross product, which does not cancel. */
    across2 = vec3_length_squared(vec3_cross(l->coat_normal, h));
    f = length2 / (across2 + l->coat_shape.y2 * (cos_n * cos_n));
    density = l->coat_shape.y2 * INV_PI_F * (f * f) * 0.5f / (mu_o + l->coat_root_o);
    *pdf = density;
    f = coat_fresnel(l, 0.5f * sqrtf(length2));
    return l->coat * f * density * mu_i * (mu_o + l->coat_root_o) /
           (mu_i * l->coat_root_o + mu_o * root_i);
}

static inline float sheen_value(const struct bsdf *b, struct vec3 wo, struct vec3 wi)
{
    const struct bsdf_layers *l = &b->layers;
    struct vec3 h = vec3_add(wo, wi);
    float length2 = vec3_length_squared(h), limit_i, lambda;

    if (!(length2 > HALF_LENGTH2_MIN))
        return 0;
    lambda = 1.0f + l->sheen_lambda_o + sheen_lambda(l->sheen_fit, l->sheen_fit_half, wi.z);
    sheen_share(l, wi.z, &limit_i);
    return sheen_density(l->sheen_alpha, (h.x * h.x + h.y * h.y) / length2) *
           float_min(l->sheen_limit_o, limit_i) * float_min(wi.z * (1.0f / SHEEN_MU_MIN), 1.0f) /
           (4.0f * float_max(b->cos_o, SHEEN_MU_MIN) * lambda);
}

static inline struct vec3 mix_eval_pdf(const struct bsdf *b, struct vec3 wo, struct vec3 wi,
                                       float *pdf, int full)
{
    struct vec3 f = BSDF_NOTHING;
    struct layer_scale scale = {1, 1};

    *pdf = 0;
    if (!(wi.z > 0.0f || wi.z < 0.0f))
        return BSDF_NOTHING;
    if (full)
        scale = layer_scale(b, wi, 1);
    if (wi.z > 0.0f)
        f = mix_reflection(b, wo, wi, pdf, scale, full);
    else if (BSDF_HAS_INTERFACE || HAS(THIN_TRANSMISSION) || full)
        f = mix_transmission(b, wo, wi, pdf, scale, full);
    if (full && wi.z > 0.0f && b->layers.covered) {
        const struct bsdf_layers *l = &b->layers;
        float coat_i = 1.0f;
        if (HAS(CLEARCOAT) && l->coat > 0.0f) {
            CHARGE_SCOPE(CLEARCOAT);
            coat_i = float_min(l->coat_rest_o, coat_rest(l, vec3_dot(l->coat_normal, wi)));
            if (!l->coat_smooth && b->lobe_pdf[BSDF_LOBE_COAT] > 0.0f) {
                float density, value = coat_value_pdf(b, wo, wi, &density);
                f = vec3_add(f, vec3_splat(value));
                *pdf += b->lobe_pdf[BSDF_LOBE_COAT] * density;
            }
        }
        if (HAS(SHEEN) && l->sheen_most > 0.0f) {
            CHARGE_SCOPE(SHEEN);
            f = vec3_mad(f, l->sheen, sheen_value(b, wo, wi) * coat_i);
            *pdf += b->lobe_pdf[BSDF_LOBE_SHEEN] * INV_2PI_F;
        }
    }
    if (!(*pdf > 0.0f && is_finite_sum(f, *pdf)))
        return *pdf = 0, BSDF_NOTHING;
    return f;
}

/* Apart, or what it keeps in registers would be saved for every simpler surface. */
static __attribute__((noinline)) struct vec3 layered_eval_pdf(const struct bsdf *b, struct vec3 wo,
                                                              struct vec3 wi, float *pdf)
{
    return mix_eval_pdf(b, wo, wi, pdf, 1);
}

struct vec3 bsdf_eval_pdf(const struct bsdf *b, struct vec3 wo, struct vec3 wi, float *pdf)
{
    *pdf = 0;
    if (!b->has_smooth)
        return BSDF_NOTHING;
    switch (b->kind) {
    case BSDF_KIND_LAMBERT:
        if (!(wi.z > 0.0f))
            return BSDF_NOTHING;
        *pdf = wi.z * INV_PI_F;
        return vec3_scale(b->diffuse, wi.z);
    case BSDF_KIND_METAL:
        if (HAS(GLOSSY))
            return metal_eval_pdf(b, wo, wi, pdf);
        break;
    case BSDF_KIND_MIX:
        if (BSDF_HAS_REFLECTION)
            return mix_eval_pdf(b, wo, wi, pdf, 0);
        break;
    case BSDF_KIND_LAYERED:
        if (BSDF_HAS_LAYERED)
            return layered_eval_pdf(b, wo, wi, pdf);
        break;
    case BSDF_KIND_BLACK:
        break;
    }
    return BSDF_NOTHING;
}

struct vec3 bsdf_eval(const struct bsdf *b, struct vec3 wo, struct vec3 wi)
{
    float pdf;
    return bsdf_eval_pdf(b, wo, wi, &pdf);
}

float bsdf_pdf(const struct bsdf *b, struct vec3 wo, struct vec3 wi)
{
    float pdf;
    bsdf_eval_pdf(b, wo, wi, &pdf);
    return pdf;
}

/* ---- sampling ------------------------------------------------------------------------------ */

static inline int finish_delta(struct bsdf_sample *out, int flags)
{
    out->flags = BSDF_DELTA | flags;
    return is_finite_sum(out->weight, 0) && vec3_max(out->weight) > 0.0f;
}

/* Scale a finished delta lobe by what lies over it. */
static inline void cover_delta(const struct bsdf *b, struct bsdf_sample *out, int full)
{
    if (has_cover(b, full))
        out->weight = vec3_scale(out->weight, layer_scale(b, out->wi, 1).lobe);
}

/* The mirror direction, with what all lobes reflect there over how often it is chosen. */
static inline int sample_mirror(const struct bsdf *b, struct vec3 wo, struct bsdf_sample *out,
                                int full)
{
    struct vec3 f = reflect_color(b, b->cos_o, full);
    float chosen = b->lobe_pdf[BSDF_LOBE_REFLECT];

    if (BSDF_HAS_INTERFACE && b->lobe_pdf[BSDF_LOBE_INTERFACE] > 0.0f) {
        struct vec3 interface = interface_color(b, b->cos_o, full);
        f = vec3_mad(f, interface, b->weight_interface);
        chosen += b->lobe_pdf[BSDF_LOBE_INTERFACE] * interface_choose(b, interface).reflect;
    }
    if (!(chosen > 0.0f))
        return 0;
    out->wi = (struct vec3){-wo.x, -wo.y, wo.z};
    out->weight = vec3_scale(f, 1.0f / chosen);
    cover_delta(b, out, full);
    return finish_delta(out, 0);
}

/* The interface's lobe: reflect or refract at one microfacet. 1: *wi has a density; 0: no
 * sample; -1: a delta lobe, and *out is complete with *result as the sampler's. */
static inline int sample_interface(const struct bsdf *b, struct vec3 wo, float u_side, float u,
                                   float v, struct bsdf_sample *out, int *result, int full)
{
    struct vec3 h = {0, 0, 1};
    float cos_h = b->cos_o;
    struct interface_choice choice;
    struct vec3 f;

    if (!b->smooth) {
        h = shape_sample(b, &b->shape, wo, u, v, full);
        cos_h = vec3_dot(wo, h);
    }
    if (!(cos_h > 0.0f))
        return 0;
    f = interface_color(b, cos_h, full);
    choice = interface_choose(b, f);
    if (u_side < choice.reflect || choice.transmit == 0.0f) {
        if (b->smooth)
            return *result = sample_mirror(b, wo, out, full), -1;
        out->wi = reflect_about(wo, h);
        return out->wi.z > 0.0f;
    }
    if (HAS(ROUGH_DIELECTRIC) && !b->transmit_delta) {
        out->flags = BSDF_TRANSMISSION | BSDF_REFRACTION;
        out->eta_scale = b->eta * b->eta;
        return refract_about(wo, h, cos_h, b->eta, &out->wi) && out->wi.z < 0.0f;
    }
    /* A delta refraction bends at the surface's own normal. Where reflection is rough, its
     * share is averaged over the microfacets, so both ways still add up to at most 1. */
    if (b->eta == 1.0f)
        out->wi = vec3_neg(wo);
    else if (!refract_about(wo, (struct vec3){0, 0, 1}, b->cos_o, b->eta, &out->wi))
        return 0;
    if (!(out->wi.z < 0.0f))
        return 0;
    out->eta_scale = b->eta * b->eta;
    out->weight = vec3_scale(b->tint, (1.0f - vec3_max(f)) /
                                          (b->lobe_pdf[BSDF_LOBE_INTERFACE] * choice.transmit *
                                           out->eta_scale));
    cover_delta(b, out, full);
    *result = finish_delta(out, BSDF_TRANSMISSION | BSDF_REFRACTION);
    return -1;
}

/* Straight through, or by the mirrored half vector: 1, 0 and -1 as sample_interface. */
static inline int sample_thin(const struct bsdf *b, struct vec3 wo, float u, float v,
                              struct bsdf_sample *out, int *result, int full)
{
    if (b->thin_delta) {
        out->wi = vec3_neg(wo);
        out->weight = vec3_scale(b->tint, (1.0f - b->layer_o) / b->lobe_pdf[BSDF_LOBE_THIN]);
        cover_delta(b, out, full);
        *result = finish_delta(out, BSDF_TRANSMISSION);
        return -1;
    }
    out->wi = reflect_about(wo, shape_sample(b, &b->thin_shape, wo, u, v, full));
    if (!(out->wi.z > 0.0f))
        return 0;
    out->wi.z = -out->wi.z;
    out->flags = BSDF_TRANSMISSION;
    return 1;
}

/* The coat: around its own normal. 1, 0 and -1 as sample_interface. */
static inline int sample_coat(const struct bsdf *b, struct vec3 wo, float u, float v,
                              struct bsdf_sample *out, int *result)
{
    const struct bsdf_layers *l = &b->layers;
    struct frame frame = frame_from_normal(l->coat_normal);
    float weight;

    if (l->coat_smooth) {
        out->wi = reflect_about(wo, l->coat_normal);
        if (!(out->wi.z > 0.0f))
            return *result = 0, -1;
        weight = coat_fresnel(l, l->coat_cos_o);
        out->weight = vec3_splat(l->coat * weight / b->lobe_pdf[BSDF_LOBE_COAT]);
        *result = finish_delta(out, 0);
        return -1;
    }
    wo = frame_to_local(&frame, wo);
    if (!(wo.z > 0.0f))
        return 0;
    out->wi = reflect_about(wo, ggx_sample_visible(wo, l->coat_shape.y, l->coat_shape.y, u, v));
    if (!(out->wi.z > 0.0f))
        return 0;
    out->wi = frame_to_world(&frame, out->wi);
    return out->wi.z > 0.0f;
}

/* Light that goes below by the cosine lobe: into a refractive object, or through a wall. */
static inline void sample_below(const struct bsdf *b, float u, float v, struct bsdf_sample *out,
                                int full)
{
    int lambert = full && HAS(DIFFUSE_TRANSMISSION) && !vec3_is_black(b->layers.diffuse_below);

    charge_set(lambert ? CHARGE_OF(DIFFUSE_TRANSMISSION) : CHARGE_OF(MULTIPLE_SCATTERING));
    out->wi = cosine_hemisphere(u, v);
    out->wi.z = -out->wi.z;
    out->flags = BSDF_TRANSMISSION | (b->p.refractive ? BSDF_REFRACTION : 0);
    if (b->interface_compensated && !lambert)
        out->eta_scale = b->eta * b->eta;
}

static inline struct vec3 uniform_hemisphere(float u, float v)
{
    float z = 1.0f - u, radius = sqrtf(u * (1.0f + z)), s, c;

    sincos_turn(v, &s, &c);
    return (struct vec3){radius * c, radius * s, z};
}

static inline int sample_mix(const struct bsdf *b, struct vec3 wo, float u_lobe, float u, float v,
                             struct bsdf_sample *out, int full)
{
    struct vec3 f;
    int result = 0, side = 1;

    if (u_lobe < b->lobe_cdf[BSDF_LOBE_DIFFUSE]) {
        charge_set(vec3_is_black(b->diffuse) ? CHARGE_OF(MULTIPLE_SCATTERING) : CHARGE_OF(DIFFUSE));
        out->wi = wide_sample(b, u, v);
    } else if (u_lobe < b->lobe_cdf[BSDF_LOBE_REFLECT]) {
        charge_set(b->smooth ? CHARGE_OF(MIRROR) : CHARGE_OF(GLOSSY));
        if (b->smooth)
            return sample_mirror(b, wo, out, full);
        out->wi = reflect_about(wo, shape_sample(b, &b->shape, wo, u, v, full));
        side = out->wi.z > 0.0f;
    } else if (BSDF_HAS_INTERFACE && u_lobe < b->lobe_cdf[BSDF_LOBE_INTERFACE]) {
        float u_side = (u_lobe - b->lobe_cdf[BSDF_LOBE_REFLECT]) /
                       b->lobe_pdf[BSDF_LOBE_INTERFACE];
        charge_set(b->smooth ? CHARGE_OF(DIELECTRIC) : CHARGE_OF(ROUGH_DIELECTRIC));
        side = sample_interface(b, wo, clamp_to(u_side, 0, ONE_MINUS_EPSILON), u, v, out, &result,
                                full);
    } else if (HAS(THIN_TRANSMISSION) && u_lobe < b->lobe_cdf[BSDF_LOBE_THIN]) {
        CHARGE(THIN_TRANSMISSION);
        side = sample_thin(b, wo, u, v, out, &result, full);
    } else if ((BSDF_HAS_BELOW || full) && u_lobe < b->lobe_cdf[BSDF_LOBE_BELOW]) {
        sample_below(b, u, v, out, full);
    } else if (full && HAS(CLEARCOAT) && u_lobe < b->lobe_cdf[BSDF_LOBE_COAT]) {
        CHARGE(CLEARCOAT);
        side = sample_coat(b, wo, u, v, out, &result);
    } else if (full && HAS(SHEEN)) {
        CHARGE(SHEEN);
        out->wi = uniform_hemisphere(u, v);
    } else {
        side = 0;
    }
    if (side <= 0)
        return side < 0 ? result : 0;
    /* What next-event estimation would compute for this wi, bit for bit, so that the
     * weights of multiple importance sampling add up to 1. */
    f = full ? layered_eval_pdf(b, wo, out->wi, &out->pdf)
             : mix_eval_pdf(b, wo, out->wi, &out->pdf, 0);
    if (!(out->pdf > 0.0f))
        return 0;
    out->weight = vec3_scale(f, 1.0f / out->pdf);
    return is_finite_sum(out->weight, 0) && vec3_max(out->weight) > 0.0f;
}

static inline int sample_metal(const struct bsdf *b, struct vec3 wo, float u_lobe, float u, float v,
                               struct bsdf_sample *out)
{
    float cos_h, shadowing;

    if (HAS(MULTIPLE_SCATTERING) && b->compensated) {
        struct vec3 f;
        if (u_lobe < b->lobe_cdf[BSDF_LOBE_DIFFUSE]) {
            CHARGE(MULTIPLE_SCATTERING);
            out->wi = wide_sample(b, u, v);
        } else {
            out->wi = reflect_about(wo, ggx_sample_visible(wo, b->shape.y, b->shape.y, u, v));
        }
        f = metal_eval_pdf(b, wo, out->wi, &out->pdf);
        if (!(out->pdf > 0.0f))
            return 0;
        out->weight = vec3_scale(f, 1.0f / out->pdf);
        return is_finite_sum(out->weight, 0) && vec3_max(out->weight) > 0.0f;
    }
    out->wi = reflect_about(wo, ggx_sample_visible(wo, b->shape.y, b->shape.y, u, v));
    if (!(out->wi.z > 0.0f))
        return 0;
    out->pdf = reflect_density(b, &b->shape, b->root_o, wo, out->wi, &cos_h, &shadowing, 0);
    if (!(out->pdf > 0.0f && out->pdf < INFINITY))
        return 0;
    out->weight = vec3_scale(schlick_color(b, schlick_weight(cos_h)), shadowing);
    return is_finite_sum(out->weight, 0) && vec3_max(out->weight) > 0.0f;
}

static __attribute__((noinline)) int sample_layered(const struct bsdf *b, struct vec3 wo,
                                                    float u_lobe, float u, float v,
                                                    struct bsdf_sample *out)
{
    return sample_mix(b, wo, u_lobe, u, v, out, 1);
}

int bsdf_sample(const struct bsdf *b, struct vec3 wo, float u_lobe, float u, float v,
                struct bsdf_sample *out)
{
    out->wi = out->weight = BSDF_NOTHING;
    out->pdf = 0;
    out->flags = 0;
    out->eta_scale = 1.0f;
    switch (b->kind) {
    case BSDF_KIND_LAMBERT:
        out->wi = cosine_hemisphere(u, v);
        out->pdf = out->wi.z * INV_PI_F;
        out->weight = b->p.base_color;
        return 1;
    case BSDF_KIND_METAL:
        if (HAS(GLOSSY))
            return sample_metal(b, wo, u_lobe, u, v, out);
        break;
    case BSDF_KIND_MIX:
        if (BSDF_HAS_REFLECTION)
            return sample_mix(b, wo, u_lobe, u, v, out, 0);
        break;
    case BSDF_KIND_LAYERED:
        if (BSDF_HAS_LAYERED)
            return sample_layered(b, wo, u_lobe, u, v, out);
        break;
    case BSDF_KIND_BLACK:
        break;
    }
    return 0;
}
