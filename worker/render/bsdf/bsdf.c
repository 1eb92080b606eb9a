#include "worker/render/bsdf/bsdf.h"

#include "common/math/elementary.h"
#include "worker/render/bsdf/lobes.h"
#include "worker/render/bsdf/microfacet.h"
#include "worker/render/bsdf/warp.h"

/* Squared length of a half vector below which it has no direction left. */
#define HALF_LENGTH2_MIN 1e-20f

static const struct vec3 BLACK = {0, 0, 0};

float fresnel_dielectric(float cos_i, float eta) { return fresnel_exact(cos_i, eta); }

static inline int is_finite_sum(struct vec3 f, float pdf)
{
    return f.x + f.y + f.z + pdf < INFINITY; /* nothing negative here; NaN compares false */
}

/* ---- values and densities ------------------------------------------------------------------ */

/* D G1(wo) / (4 wo.z) of the half vector between wo and wi, both above: the density of
 * reflecting a visible normal. *cos_h is wo.h; *shadowing is G2 / G1. */
static inline float reflect_density(float alpha2, float root_o, float mu_o, struct vec3 wo,
                                    struct vec3 wi, float *cos_h, float *shadowing)
{
    struct vec3 h = vec3_add(wo, wi);
    float length2 = vec3_length_squared(h), root_i = ggx_root(alpha2, wi.z);

    if (!(length2 > HALF_LENGTH2_MIN))
        return 0;
    *cos_h = 0.5f * sqrtf(length2);
    *shadowing = wi.z * (mu_o + root_o) / (wi.z * root_o + mu_o * root_i);
    return ggx_density(alpha2, h, length2) * 0.5f / (mu_o + root_o);
}

static inline struct vec3 metal_eval_pdf(const struct bsdf *b, struct vec3 wo, struct vec3 wi,
                                         float *pdf)
{
    float cos_h, shadowing;
    struct vec3 f;

    *pdf = 0;
    if (!(wi.z > 0.0f))
        return BLACK;
    *pdf = reflect_density(b->alpha2, b->root_o, b->cos_o, wo, wi, &cos_h, &shadowing);
    if (!(*pdf > 0.0f))
        return *pdf = 0, BLACK;
    f = vec3_scale(schlick_color(b, schlick_weight(cos_h)), *pdf * shadowing);
    if (!is_finite_sum(f, *pdf))
        return *pdf = 0, BLACK;
    return f;
}

static inline struct vec3 mix_reflection(const struct bsdf *b, struct vec3 wo, struct vec3 wi,
                                         float *pdf)
{
    struct vec3 f = BLACK;

    *pdf = 0;
    if (b->lobe_pdf[BSDF_LOBE_DIFFUSE] > 0.0f) {
        f = vec3_scale(b->diffuse, layer_rest(b, wi.z) * wi.z);
        *pdf = b->lobe_pdf[BSDF_LOBE_DIFFUSE] * (wi.z * INV_PI_F);
    }
    if (!b->smooth) {
        float cos_h, shadowing, chosen = b->lobe_pdf[BSDF_LOBE_REFLECT];
        float density = reflect_density(b->alpha2, b->root_o, b->cos_o, wo, wi, &cos_h, &shadowing);
        if (density > 0.0f) {
            struct vec3 r = schlick_color(b, schlick_weight(cos_h));
            if (b->lobe_pdf[BSDF_LOBE_INTERFACE] > 0.0f) {
                struct vec3 interface = interface_color(b, cos_h);
                r = vec3_mad(r, interface, b->weight_interface);
                chosen += b->lobe_pdf[BSDF_LOBE_INTERFACE] * interface_choose(b, interface).reflect;
            }
            f = vec3_mad(f, r, density * shadowing);
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
                                            float *pdf)
{
    struct vec3 mirrored = {wi.x, wi.y, -wi.z};
    float cos_h, shadowing, density, layer_i, layer;

    *pdf = 0;
    density = reflect_density(b->thin_alpha2, b->thin_root_o, b->cos_o, wo, mirrored, &cos_h,
                              &shadowing);
    if (!(density > 0.0f))
        return BLACK;
    layer_i = 1.0f - layer_rest(b, mirrored.z);
    layer = layer_i > b->layer_o ? layer_i : b->layer_o;
    shadowing = transmit_shadowing(b->cos_o, b->thin_root_o, mirrored.z,
                                   ggx_root(b->thin_alpha2, mirrored.z));
    *pdf = b->lobe_pdf[BSDF_LOBE_THIN] * density;
    return vec3_scale(b->tint, (1.0f - layer) * shadowing * density);
}

/* Walter et al. 2007, equations 17 and 21, with h = -(wo + eta wi) normalised towards wo,
 * whose squared length before that is their squared denominator. wi.z < 0. */
static inline struct vec3 rough_refraction(const struct bsdf *b, struct vec3 wo, struct vec3 wi,
                                           float *pdf)
{
    struct vec3 h = vec3_mad(wo, wi, b->eta), f;
    float length2 = vec3_length_squared(h), mu_i = -wi.z, scale, cos_o, cos_i;
    float density, shadowing, keep;

    *pdf = 0;
    if (!(length2 > HALF_LENGTH2_MIN))
        return BLACK;
    scale = 1.0f / sqrtf(length2);
    scale = h.z < 0.0f ? -scale : scale;
    cos_o = vec3_dot(wo, h) * scale;
    cos_i = -vec3_dot(wi, h) * scale;
    if (!(cos_o > 0.0f && cos_i > 0.0f))
        return BLACK;
    f = interface_color(b, cos_o);
    keep = 1.0f - vec3_max(f);
    if (!(keep > 0.0f))
        return BLACK;
    density = ggx_density(b->alpha2, h, length2) * 2.0f / (b->cos_o + b->root_o) *
              (cos_o * cos_i / length2);
    shadowing = transmit_shadowing(b->cos_o, b->root_o, mu_i, ggx_root(b->alpha2, mu_i));
    *pdf = b->lobe_pdf[BSDF_LOBE_INTERFACE] * interface_choose(b, f).transmit *
           density * (b->eta * b->eta);
    return vec3_scale(b->tint, keep * shadowing * density);
}

static inline struct vec3 mix_eval_pdf(const struct bsdf *b, struct vec3 wo, struct vec3 wi,
                                       float *pdf)
{
    struct vec3 f = BLACK;

    *pdf = 0;
    if (wi.z > 0.0f)
        f = mix_reflection(b, wo, wi, pdf);
    else if (!(wi.z < 0.0f))
        return BLACK;
    else if (b->lobe_pdf[BSDF_LOBE_THIN] > 0.0f && !b->thin_delta)
        f = thin_transmission(b, wo, wi, pdf);
    else if (b->lobe_pdf[BSDF_LOBE_INTERFACE] > 0.0f && !b->transmit_delta)
        f = rough_refraction(b, wo, wi, pdf);
    if (!(*pdf > 0.0f && is_finite_sum(f, *pdf)))
        return *pdf = 0, BLACK;
    return f;
}

struct vec3 bsdf_eval_pdf(const struct bsdf *b, struct vec3 wo, struct vec3 wi, float *pdf)
{
    *pdf = 0;
    if (!b->has_smooth)
        return BLACK;
    switch (b->kind) {
    case BSDF_KIND_LAMBERT:
        if (!(wi.z > 0.0f))
            return BLACK;
        *pdf = wi.z * INV_PI_F;
        return vec3_scale(b->diffuse, wi.z);
    case BSDF_KIND_METAL:
        return metal_eval_pdf(b, wo, wi, pdf);
    case BSDF_KIND_MIX:
        return mix_eval_pdf(b, wo, wi, pdf);
    case BSDF_KIND_BLACK:
        break;
    }
    return BLACK;
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

/* The mirror direction, with what all lobes reflect there over how often it is chosen. */
static int sample_mirror(const struct bsdf *b, struct vec3 wo, struct bsdf_sample *out)
{
    struct vec3 f = schlick_color(b, schlick_weight(b->cos_o));
    float chosen = b->lobe_pdf[BSDF_LOBE_REFLECT];

    if (b->lobe_pdf[BSDF_LOBE_INTERFACE] > 0.0f) {
        struct vec3 interface = interface_color(b, b->cos_o);
        f = vec3_mad(f, interface, b->weight_interface);
        chosen += b->lobe_pdf[BSDF_LOBE_INTERFACE] * interface_choose(b, interface).reflect;
    }
    if (!(chosen > 0.0f))
        return 0;
    out->wi = (struct vec3){-wo.x, -wo.y, wo.z};
    out->weight = vec3_scale(f, 1.0f / chosen);
    return finish_delta(out, 0);
}

/* The interface's lobe: reflect or refract at one microfacet. 1: *wi has a density; 0: no
 * sample; -1: a delta lobe, and *out is complete with *result as the sampler's. */
static int sample_interface(const struct bsdf *b, struct vec3 wo, float u_side, float u, float v,
                            struct bsdf_sample *out, int *result)
{
    struct vec3 h = b->smooth ? (struct vec3){0, 0, 1} : ggx_sample_visible(wo, b->p.alpha, u, v);
    float cos_h = b->smooth ? b->cos_o : vec3_dot(wo, h);
    struct interface_choice choice;
    struct vec3 f;

    if (!(cos_h > 0.0f))
        return 0;
    f = interface_color(b, cos_h);
    choice = interface_choose(b, f);
    if (u_side < choice.reflect || choice.transmit == 0.0f) {
        if (b->smooth)
            return *result = sample_mirror(b, wo, out), -1;
        out->wi = reflect_about(wo, h);
        return out->wi.z > 0.0f;
    }
    if (!b->transmit_delta) {
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
    *result = finish_delta(out, BSDF_TRANSMISSION | BSDF_REFRACTION);
    return -1;
}

static int sample_mix(const struct bsdf *b, struct vec3 wo, float u_lobe, float u, float v,
                      struct bsdf_sample *out)
{
    struct vec3 f;
    int result = 0, side;

    if (u_lobe < b->lobe_cdf[BSDF_LOBE_DIFFUSE]) {
        out->wi = cosine_hemisphere(u, v);
    } else if (u_lobe < b->lobe_cdf[BSDF_LOBE_REFLECT]) {
        if (b->smooth)
            return sample_mirror(b, wo, out);
        out->wi = reflect_about(wo, ggx_sample_visible(wo, b->p.alpha, u, v));
        if (!(out->wi.z > 0.0f))
            return 0;
    } else if (u_lobe < b->lobe_cdf[BSDF_LOBE_INTERFACE]) {
        float u_side = (u_lobe - b->lobe_cdf[BSDF_LOBE_REFLECT]) /
                       b->lobe_pdf[BSDF_LOBE_INTERFACE];
        side = sample_interface(b, wo, clamp_to(u_side, 0, ONE_MINUS_EPSILON), u, v, out, &result);
        if (side <= 0)
            return side < 0 ? result : 0;
    } else if (b->thin_delta) {
        out->wi = vec3_neg(wo);
        out->weight = vec3_scale(b->tint, (1.0f - b->layer_o) / b->lobe_pdf[BSDF_LOBE_THIN]);
        return finish_delta(out, BSDF_TRANSMISSION);
    } else {
        out->wi = reflect_about(wo, ggx_sample_visible(wo, b->thin_alpha, u, v));
        if (!(out->wi.z > 0.0f))
            return 0;
        out->wi.z = -out->wi.z;
        out->flags = BSDF_TRANSMISSION;
    }
    /* What next-event estimation would compute for this wi, bit for bit, so that the
     * weights of multiple importance sampling add up to 1. */
    f = mix_eval_pdf(b, wo, out->wi, &out->pdf);
    if (!(out->pdf > 0.0f))
        return 0;
    out->weight = vec3_scale(f, 1.0f / out->pdf);
    return is_finite_sum(out->weight, 0) && vec3_max(out->weight) > 0.0f;
}

static int sample_metal(const struct bsdf *b, struct vec3 wo, float u, float v,
                        struct bsdf_sample *out)
{
    float cos_h, shadowing;

    out->wi = reflect_about(wo, ggx_sample_visible(wo, b->p.alpha, u, v));
    if (!(out->wi.z > 0.0f))
        return 0;
    out->pdf = reflect_density(b->alpha2, b->root_o, b->cos_o, wo, out->wi, &cos_h, &shadowing);
    if (!(out->pdf > 0.0f && out->pdf < INFINITY))
        return 0;
    out->weight = vec3_scale(schlick_color(b, schlick_weight(cos_h)), shadowing);
    return is_finite_sum(out->weight, 0) && vec3_max(out->weight) > 0.0f;
}

int bsdf_sample(const struct bsdf *b, struct vec3 wo, float u_lobe, float u, float v,
                struct bsdf_sample *out)
{
    out->wi = out->weight = BLACK;
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
        return sample_metal(b, wo, u, v, out);
    case BSDF_KIND_MIX:
        return sample_mix(b, wo, u_lobe, u, v, out);
    case BSDF_KIND_BLACK:
        break;
    }
    return 0;
}
