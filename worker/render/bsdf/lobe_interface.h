/* lobe_interface: a dielectric interface, smooth or rough, that reflects and refracts: Walter et al. 2007 ("Microfacet
 * Models for Refraction through Rough Surfaces"), equations 16 (half vector), 17 (half vector's density) and 21 (f),
 * but with fully correlated masking and shadowing in transmission (microfacet.h). The Fresnel term is the exact one,
 * remapped to begin at F0 and end at F90; total internal reflection is always 1. Transmitted light is base_color * (1 -
 * max component of F). The choice between reflection and refraction depends on the sampled microfacet.
 *
 * Its reflection is evaluated together with the rest of the base's: lobe_reflection.h.
 */
#pragma once

#include "worker/render/bsdf/compensation.h"
#include "worker/render/bsdf/lobe.h"

/* Reflectance of the interface (without the lobe's weight). */
static inline struct vec3 interface_fresnel(const struct bsdf *b, real cos_i)
{
    const struct bsdf_dielectric *d = &b->dielectric;
    real weight;
    struct vec3 f;

    if (d->exact) {
        real r = fresnel_exact(cos_i, b->eta);
        if (r >= 1.0f)
            return (struct vec3){1, 1, 1};
        weight = (r - d->normal_f0) * d->inverse_rest_f0;
    } else {
        weight = schlick_weight(cos_i);
    }
    f = schlick_mix(d->f0, b->material.specular, weight);
    if (calls_for(b->effects, EFFECT_IRIDESCENCE)) {
        real cos_1 = cos_i;
        if (b->material.inside && d->exact) /* the film sees the angle outside */
            cos_1 = real_sqrt(real_max(0.0f, 1.0f - (1.0f - cos_i * cos_i) / (b->eta * b->eta)));
        f = vec3_mad(f, thin_film_difference(&b->thin_film, cos_1, b->thin_film.f0),
                     b->thin_film.weight * b->material.specular);
    }
    /* For an ior above 3.7 the exact term dips below its value at normal incidence. */
    return clamp_color(f, 1);
}

/* How often the lobe reflects or transmits at a microfacet that reflects `f`. 0 only if that way
 * carries no light. A separate function, because 1 - F has few digits at grazing angles. */
struct interface_choice {
    real reflect, transmit;
};

static inline struct interface_choice interface_choose(const struct bsdf *b, struct vec3 f)
{
    real reflected = vec3_average(f);
    real transmitted = (1.0f - vec3_max(f)) * vec3_average(b->material.base_color);
    real scale = reflected + transmitted;

    if (!(scale > 0.0f))
        return (struct interface_choice){1, 0};
    scale = 1.0f / scale;
    return (struct interface_choice){reflected * scale, transmitted * scale};
}

/* Does refraction spread so little that floats cannot resolve its half vector? */
static inline int refraction_is_straight(const struct ggx *shape, real eta)
{
    int straight = shape->x * real_abs(eta - 1.0f) < BSDF_SPREAD_MIN;

    if (ggx_is_stretched(shape)) /* the narrow axis must be resolved too */
        straight |= shape->y * real_abs(eta - 1.0f) < REAL(0.1) * BSDF_SPREAD_MIN;
    return SAFEGUARD(STRAIGHT_REFRACTION) && straight;
}

/* Returns how often to sample it. `base` is the mean of the base colour. */
static inline real interface_init(struct bsdf *b, real base)
{
    struct vec3 seen;

    if (b->dielectric.exact)
        b->eta = b->material.inside ? 1.0f / b->material.ior : b->material.ior;
    b->interface.transmit_delta = b->base.smooth || refraction_is_straight(&b->base.shape, b->eta);
    b->interface.tint = vec3_scale(b->material.base_color, b->weights.glass);
    seen = interface_fresnel(b, b->cos_o);
    return b->weights.glass * (vec3_average(seen) + (1.0f - vec3_max(seen)) * base);
}

/* Equations 17 and 21, with h = -(wo + eta wi) normalised and on wo's side. Its squared length
 * before normalisation is their squared denominator. */
static inline struct vec3 interface_refraction(const struct bsdf *b, struct vec3 wo, struct vec3 wi, real *pdf)
{
    struct vec3 h = vec3_mad(wo, wi, b->eta), f;
    real length2 = vec3_length_squared(h), scale, cos_o, cos_i, density, shadowing, keep;

    *pdf = 0;
    if (!(length2 > HALF_LENGTH2_MIN))
        return LOBE_BLACK;
    scale = 1.0f / real_sqrt(length2);
    scale = h.z < 0.0f ? -scale : scale;
    cos_o = vec3_dot(wo, h) * scale;
    cos_i = -vec3_dot(wi, h) * scale;
    if (!(cos_o > 0.0f && cos_i > 0.0f))
        return LOBE_BLACK;
    f = interface_fresnel(b, cos_o);
    keep = 1.0f - vec3_max(f);
    if (!(keep > 0.0f))
        return LOBE_BLACK;
    density =
        ggx_density_of(&b->base.shape, h, length2) * 2.0f / (b->cos_o + b->base.root_o) * (cos_o * cos_i / length2);
    shadowing = transmission_shadowing(b->cos_o, b->base.root_o, -wi.z, ggx_root_of(&b->base.shape, wi));
    *pdf = b->lobe_pdf[BSDF_LOBE_INTERFACE] * interface_choose(b, f).transmit * density * (b->eta * b->eta);
    return vec3_scale(b->interface.tint, keep * shadowing * density);
}

static inline struct vec3 interface_evaluate(const struct bsdf *b, struct vec3 wo, struct vec3 wi,
                                             const struct cover *cover, real *pdf)
{
    struct vec3 f = LOBE_BLACK;

    *pdf = 0;
    if (!b->interface.transmit_delta)
        f = interface_refraction(b, wo, wi, pdf);
    if (b->interface_compensation.on)
        f = vec3_add(f, interface_compensation_far(b, -wi.z));
    return vec3_scale(f, cover->lobe);
}

/* Light bends at the surface's own normal. If the reflection is rough, its share is averaged over the microfacets, so
 * both ways still add up to at most 1. f: reflectance; it chooses with `transmit`. */
static inline enum lobe_result interface_sample_delta(const struct bsdf *b, struct vec3 wo, struct vec3 f,
                                                      real transmit, struct bsdf_sample *out)
{
    if (b->eta == 1.0f)
        out->wi = vec3_neg(wo);
    else if (!refract_about(wo, (struct vec3){0, 0, 1}, b->cos_o, b->eta, &out->wi))
        return LOBE_NOTHING;
    out->weight = vec3_scale(b->interface.tint,
                             (1.0f - vec3_max(f)) / (b->lobe_pdf[BSDF_LOBE_INTERFACE] * transmit * out->eta_scale));
    return out->wi.z < 0.0f ? LOBE_DELTA : LOBE_NOTHING;
}

static inline enum lobe_result reflection_sample_mirror(const struct bsdf *b, struct vec3 wo, struct bsdf_sample *out);

/* Reflect or refract at one microfacet, chosen with w. */
static inline enum lobe_result interface_sample(const struct bsdf *b, struct vec3 wo, real w, real u, real v,
                                                struct bsdf_sample *out)
{
    struct vec3 h = {0, 0, 1}, f;
    struct interface_choice choice;
    real cos_h = b->cos_o;

    if (!b->base.smooth) {
        h = ggx_sample_of(&b->base.shape, wo, u, v);
        cos_h = vec3_dot(wo, h);
    }
    if (!(cos_h > 0.0f))
        return LOBE_NOTHING;
    f = interface_fresnel(b, cos_h);
    choice = interface_choose(b, f);
    if (w < choice.reflect || choice.transmit == 0.0f) {
        if (b->base.smooth)
            return reflection_sample_mirror(b, wo, out);
        out->wi = reflect_about(wo, h);
        return out->wi.z > 0.0f ? LOBE_SMOOTH : LOBE_NOTHING;
    }
    out->flags = BSDF_TRANSMISSION | BSDF_REFRACTION;
    out->eta_scale = b->eta * b->eta;
    if (b->interface.transmit_delta)
        return interface_sample_delta(b, wo, f, choice.transmit, out);
    return refract_about(wo, h, cos_h, b->eta, &out->wi) && out->wi.z < 0.0f ? LOBE_SMOOTH : LOBE_NOTHING;
}
