/* lobe_reflection: GGX reflection at the base's microfacets (microfacet.h).
 *
 *   f = F(wo.h) D G2 / (4 mu_o mu_i)
 *
 * One lobe for metal and plastic. Their Fresnel terms add up, each with its weight:
 *   metal    Schlick from the base colour to 1; a conductor: the exact term of its complex index.
 *   plastic  Schlick from F0 = min(((ior-1)/(ior+1))^2 specular_color, 1) * specular to F90 =
 *            specular. F90 fades to 0 below ior 1.2, so that ior 1 has no interface at all:
 *            Schlick's formula, made for 1.2 to 2.2, would keep a bright rim. pbrt's coated diffuse
 *            has the exact term; a slab counts all reflections between its faces.
 *   film     replaces the Fresnel term, in proportion to its weight (thin_film.h); over plastic, up to
 *            what the layer below it does not receive.
 * A refractive interface reflects at the same microfacets: its reflection is added here.
 */
#pragma once

#include "worker/render/base/health_scope.h"
#include "worker/render/bsdf/compensation.h"
#include "worker/render/bsdf/layer.h"
#include "worker/render/bsdf/lobe.h"
#include "worker/render/bsdf/lobe_coat.h"
#include "worker/render/bsdf/lobe_interface.h"

/* ---- the Fresnel term -------------------------------------------------------------------------- */

static inline struct vec3 conductor_fresnel(const struct bsdf *b, real cos_h)
{
    const struct bsdf_reflection *r = &b->reflection;
    real back = r->interreflection;
    struct vec3 f;

    if (calls_for(b->effects, EFFECT_CLEARCOAT) && b->coat.exact) {
        /* Light reaches a metal under a coat more steeply, and is reflected back and forth. */
        back = b->coat.weight * coat_fresnel(&b->coat, cos_h);
        cos_h = real_sqrt(1.0f - (1.0f - cos_h * cos_h) / (b->coat.ior * b->coat.ior));
    }
    f = (struct vec3){fresnel_conductor(cos_h, r->eta.x, r->k.x),
                      fresnel_conductor(cos_h, r->eta.y, r->k.y),
                      fresnel_conductor(cos_h, r->eta.z, r->k.z)};
    f = vec3_mul(f, b->material.base_color);
    if (calls_for(b->effects, EFFECT_IRIDESCENCE))
        f = clamp_color(vec3_mad(f, thin_film_difference(&b->thin_film, cos_h, r->f0), b->thin_film.weight), 1);
    f.x = interreflected(f.x, back);
    f.y = interreflected(f.y, back);
    f.z = interreflected(f.z, back);
    return f;
}

LOBE_RARE struct vec3 metal_fresnel(const struct bsdf *b, real cos_h)
{
    const struct vec3 f0 = b->material.base_color;
    struct vec3 f;

    if (calls_for(b->effects, EFFECT_CONDUCTOR))
        return conductor_fresnel(b, cos_h);
    f = schlick_mix(f0, 1.0f, schlick_weight(cos_h));
    if (calls_for(b->effects, EFFECT_IRIDESCENCE))
        f = clamp_color(vec3_mad(f, thin_film_difference(&b->thin_film, cos_h, f0), b->thin_film.weight), 1);
    return f;
}

/* What lies below a film receives what a Schlick term of the layer's ends leaves (layer.h). The film's
 * own term exceeds that one at some angles, because both of its faces approach 1 towards the horizon,
 * and faster than Schlick's formula. It may not reflect that light, too. */
static inline real film_limit(const struct bsdf *b, real weight)
{
    const struct bsdf_layer *l = &b->layer;

    return SAFEGUARD(FILM_ENERGY) ? real_min(l->f0 + (l->f90 - l->f0) * weight, 1.0f) : 1.0f;
}

LOBE_RARE struct vec3 plastic_fresnel(const struct bsdf *b, real cos_h)
{
    const struct bsdf_dielectric *d = &b->dielectric;
    int exact = b->layer.exact || (is_slab(b) && b->base.smooth && d->exact);
    struct vec3 f;

    f = schlick_mix(d->f0, d->f90, exact ? exact_weight(b, cos_h) : schlick_weight(cos_h));
    if (calls_for(b->effects, EFFECT_IRIDESCENCE)) {
        f = vec3_mad(f, thin_film_difference(&b->thin_film, cos_h, b->thin_film.f0),
                     b->thin_film.weight * b->material.specular);
        f = clamp_color(f, film_limit(b, exact ? exact_weight(b, cos_h) : schlick_weight(cos_h)));
    }
    f = clamp_color(f, 1);
    if (is_slab(b)) {
        f.x = slab_reflectance(f.x);
        f.y = slab_reflectance(f.y);
        f.z = slab_reflectance(f.z);
    }
    return f;
}

/* The sum of both, if it is not one Schlick formula again. */
LOBE_RARE struct vec3 mixed_fresnel(const struct bsdf *b, real cos_h)
{
    struct vec3 f = LOBE_BLACK;

    if (b->weights.metal > 0.0f)
        f = vec3_scale(metal_fresnel(b, cos_h), b->weights.metal);
    if (b->weights.plastic > 0.0f)
        f = vec3_mad(f, plastic_fresnel(b, cos_h), b->weights.plastic);
    return f;
}

/* The lobe's Fresnel term, all weights included. */
static inline struct vec3 reflection_fresnel(const struct bsdf *b, real cos_h)
{
    if (b->reflection.schlick)
        return schlick_mix(b->reflection.f0, b->reflection.f90, schlick_weight(cos_h));
    return mixed_fresnel(b, cos_h);
}

/* Hemispherical mean of the metal's term. */
static inline struct vec3 metal_average(const struct bsdf *b)
{
    const struct vec3 f0 = b->material.base_color;

    if (calls_for(b->effects, EFFECT_CONDUCTOR)) /* Gauss's rule for the weight 2 mu */
        return vec3_add(vec3_scale(metal_fresnel(b, REAL(0.35505103)), REAL(0.36391724)),
                        vec3_scale(metal_fresnel(b, REAL(0.84494897)), REAL(0.63608276)));
    if (calls_for(b->effects, EFFECT_IRIDESCENCE)) /* the film's part by the one-point rule */
        return clamp_color(vec3_mad(schlick_mix(f0, 1.0f, SCHLICK_MEAN),
                                    thin_film_difference(&b->thin_film, 2.0f / REAL(3.0), f0), b->thin_film.weight), 1);
    return schlick_mix(f0, 1.0f, SCHLICK_MEAN);
}

/* The same for plastic, whose Schlick weight has the mean `weight`. */
static inline struct vec3 plastic_average(const struct bsdf *b, real weight)
{
    struct vec3 f = schlick_mix(b->dielectric.f0, b->dielectric.f90, weight);

    if (calls_for(b->effects, EFFECT_IRIDESCENCE))
        f = clamp_color(vec3_mad(f, thin_film_difference(&b->thin_film, 2.0f / REAL(3.0), b->thin_film.f0),
                                 b->thin_film.weight * b->material.specular), film_limit(b, weight));
    return f;
}

/* ---- the lobe ------------------------------------------------------------------------------------ */

/* Multiple-scattering compensation of metal and plastic; returns how often to sample it. */
LOBE_OFTEN real reflection_compensation(struct bsdf *b, real loss_o)
{
    real kept = 1.0f - compensation_mean(b);
    struct vec3 color = LOBE_BLACK;

    b->layer.returned = 0;
    if (b->weights.plastic > 0.0f) {
        real weight = SCHLICK_MEAN;
        if (b->layer.exact)
            weight += b->layer.exact_row.smooth_mean;
        color = vec3_scale(series_color(plastic_average(b, weight), kept), b->weights.plastic);
        b->layer.returned = series(b->layer.f0 + (b->layer.f90 - b->layer.f0) * weight, kept);
    }
    if (b->weights.metal > 0.0f)
        color = vec3_mad(color, series_color(metal_average(b), kept), b->weights.metal);
    return compensation_init(b, color, loss_o);
}

static inline void conductor_init(struct bsdf *b, const struct bsdf_params *p)
{
    struct bsdf_reflection *r = &b->reflection;

    r->eta.x = relative_index(clamp_to(p->eta.x, REAL(1e-4), 1e4f), p);
    r->eta.y = relative_index(clamp_to(p->eta.y, REAL(1e-4), 1e4f), p);
    r->eta.z = relative_index(clamp_to(p->eta.z, REAL(1e-4), 1e4f), p);
    r->k.x = relative_index(clamp_to(p->k.x, 0, 1e4f), p);
    r->k.y = relative_index(clamp_to(p->k.y, 0, 1e4f), p);
    r->k.z = relative_index(clamp_to(p->k.z, 0, 1e4f), p);
    r->interreflection = clamp_to(p->base_interreflection, 0, REAL(0.999));
    /* Interreflection applies to all that the conductor reflects, not only to its factor. */
    b->material.base_color = clamp_color(p->base_color, 1);
    b->material.metallic = 1;
    b->material.transmission = 0;
}

/* Returns how often to sample it. `blend` is the mean of Schlick's weight along wo. */
LOBE_OFTEN real reflection_init(struct bsdf *b, real blend)
{
    struct bsdf_reflection *r = &b->reflection;
    int film = calls_for(b->effects, EFFECT_IRIDESCENCE);

    r->schlick =
        !calls_for(b->effects, EFFECT_CONDUCTOR | EFFECT_IRIDESCENCE | EFFECT_THIN_TRANSMISSION) && !b->layer.exact;
    if (r->f90 == 0.0f && vec3_is_black(r->f0) && !(film && b->weights.plastic > 0.0f && b->material.specular > 0.0f))
        return -1.0f;
    return vec3_average(film ? reflection_fresnel(b, b->cos_o) : schlick_mix(r->f0, r->f90, blend));
}

/* What reflects at a microfacet, including the interface, and how often it is sampled. */
static inline struct vec3 reflection_color(const struct bsdf *b, real cos_h, real *chosen)
{
    struct vec3 f = reflection_fresnel(b, cos_h);

    *chosen = b->lobe_pdf[BSDF_LOBE_REFLECTION];
    if (lobe_is_present(b, BSDF_LOBE_INTERFACE)) {
        struct vec3 interface = interface_fresnel(b, cos_h);
        f = vec3_mad(f, interface, b->weights.glass);
        *chosen += b->lobe_pdf[BSDF_LOBE_INTERFACE] * interface_choose(b, interface).reflect;
    }
    return f;
}

LOBE_OFTEN struct vec3 reflection_evaluate(const struct bsdf *b, struct vec3 wo, struct vec3 wi,
                                           const struct cover *cover, real *pdf)
{
    real cos_h, shadowing, chosen;
    real density = reflection_density(&b->base, wo, b->cos_o, wi, &cos_h, &shadowing);
    struct vec3 f;

    *pdf = 0;
    if (!(density > 0.0f))
        return health_density(density), LOBE_BLACK;
    f = reflection_color(b, cos_h, &chosen);
    *pdf = chosen * density;
    return vec3_scale(f, shadowing * density * cover->lobe);
}

/* The mirror direction: what all lobes reflect there, over how often it is chosen. */
static inline enum lobe_result reflection_sample_mirror(const struct bsdf *b, struct vec3 wo, struct bsdf_sample *out)
{
    real chosen;
    struct vec3 f = reflection_color(b, b->cos_o, &chosen);

    if (!(chosen > 0.0f))
        return LOBE_NOTHING;
    out->wi = (struct vec3){-wo.x, -wo.y, wo.z};
    out->weight = vec3_scale(f, 1.0f / chosen);
    return LOBE_DELTA;
}

static inline enum lobe_result reflection_sample(const struct bsdf *b, struct vec3 wo, real w, real u, real v,
                                                 struct bsdf_sample *out)
{
    (void)w;
    if (b->base.smooth)
        return reflection_sample_mirror(b, wo, out);
    out->wi = reflect_about(wo, ggx_sample_of(&b->base.shape, wo, u, v));
    return out->wi.z > 0.0f ? LOBE_SMOOTH : LOBE_NOTHING;
}
