/* lobes: the pieces that preparing, evaluating and sampling a BSDF share. Private to
 * worker/render/bsdf.
 *
 * `full` is a constant at every call: 1 for BSDF_KIND_LAYERED, 0 for BSDF_KIND_MIX, whose code
 * is thereby free of all that only layered surfaces have.
 */
#ifndef AZULEJO_RENDER_LOBES_H
#define AZULEJO_RENDER_LOBES_H

#include "common/math/vec.h"
#include "worker/render/bsdf/albedo.h"
#include "worker/render/bsdf/bsdf.h"
#include "worker/render/bsdf/film.h"
#include "worker/render/bsdf/fresnel.h"
#include "worker/render/bsdf/microfacet.h"
#include "worker/render/bsdf/sheen.h"
#include "worker/render/bsdf/warp.h"
#include "worker/render/charge.h"
#include "worker/render/has.h"

/* What a kernel variant can leave out (has.h). */
#define BSDF_HAS_INTERFACE (HAS(DIELECTRIC) || HAS(ROUGH_DIELECTRIC))
#define BSDF_HAS_LAYERED                                                                       \
    (HAS(ANISOTROPY) || HAS(CONDUCTOR) || HAS(CLEARCOAT) || HAS(SHEEN) || HAS(IRIDESCENCE) ||   \
     HAS(DIFFUSE_TRANSMISSION) || HAS(THIN_TRANSMISSION))
#define BSDF_HAS_REFLECTION (HAS(GLOSSY) || HAS(MIRROR) || BSDF_HAS_INTERFACE || BSDF_HAS_LAYERED)
/* Does BSDF_KIND_MIX need the cosine lobe below? */
#define BSDF_HAS_BELOW (HAS(ROUGH_DIELECTRIC) && HAS(MULTIPLE_SCATTERING))

/* BSDF_KIND_MIX chooses between the first of the lobes only; beyond them lobe_pdf is not set. */
#define BSDF_LOBES_MIX                                                 \
    (BSDF_HAS_BELOW             ? BSDF_LOBE_BELOW + 1                  \
     : HAS(THIN_TRANSMISSION)   ? BSDF_LOBE_THIN + 1                   \
     : BSDF_HAS_INTERFACE       ? BSDF_LOBE_INTERFACE + 1              \
                                : BSDF_LOBE_REFLECT + 1)

/* x clamped to low..high; NaN becomes low. */
static inline float clamp_to(float x, float low, float high)
{
    return x > low ? (x < high ? x : high) : low;
}
static inline struct vec3 clamp_color(struct vec3 c, float high)
{
    return (struct vec3){clamp_to(c.x, 0, high), clamp_to(c.y, 0, high), clamp_to(c.z, 0, high)};
}

/* ---- GGX of either shape --------------------------------------------------------------------- */

static inline int is_stretched(const struct bsdf *b, int full)
{
    return full && HAS(ANISOTROPY) && b->layers.stretched;
}

static inline float shape_root(const struct bsdf *b, const struct bsdf_shape *shape, struct vec3 w,
                               int full)
{
    if (is_stretched(b, full)) {
        CHARGE_SCOPE(ANISOTROPY);
        return ggx_stretched_root(shape->x2, shape->y2, w);
    }
    return ggx_root(shape->y2, w.z);
}

static inline float shape_density(const struct bsdf *b, const struct bsdf_shape *shape,
                                  struct vec3 h, float length2, int full)
{
    if (is_stretched(b, full)) {
        CHARGE_SCOPE(ANISOTROPY);
        return ggx_stretched_density(shape->x, shape->y, h, length2);
    }
    return ggx_density(shape->y2, h, length2);
}

static inline struct vec3 shape_sample(const struct bsdf *b, const struct bsdf_shape *shape,
                                       struct vec3 wo, float u, float v, int full)
{
    return ggx_sample_visible(wo, is_stretched(b, full) ? shape->x : shape->y, shape->y, u, v);
}

/* 1 - E along w. */
static inline float shape_loss(const struct bsdf *b, struct vec3 w, int full)
{
    CHARGE_SCOPE(MULTIPLE_SCATTERING);
    if (is_stretched(b, full))
        return albedo_stretched_loss_at(&b->layers.stretched_loss, w.x, w.y, fabsf(w.z));
    return albedo_loss_at(&b->loss, fabsf(w.z));
}

/* ---- the cosine lobe above ------------------------------------------------------------------------
 *
 * At a small alpha what is given back is a function of mu / alpha that falls off as its square:
 * it is sampled with the density 1 / (mu + alpha) in mu, for by the cosine it would be all
 * but never found, and then weigh thousands. */
#define GRAZE_ALPHA 0.05f

static inline float wide_density(const struct bsdf *b, float mu)
{
    if (HAS(MULTIPLE_SCATTERING) && b->graze > 0.0f)
        return mu * INV_PI_F * (1.0f - b->graze) +
               b->graze * INV_2PI_F / ((mu + b->shape.y) * b->graze_log);
    return mu * INV_PI_F;
}

static inline struct vec3 wide_sample(const struct bsdf *b, float u, float v)
{
    if (HAS(MULTIPLE_SCATTERING) && b->graze > 0.0f) {
        if (u < b->graze) {
            float mu = b->shape.y * (det_exp(u / b->graze * b->graze_log) - 1.0f), radius, s, c;
            mu = clamp_to(mu, 1e-7f, 1);
            radius = sqrtf((1.0f - mu) * (1.0f + mu));
            sincos_turn(v, &s, &c);
            return (struct vec3){radius * c, radius * s, mu};
        }
        u = clamp_to((u - b->graze) / (1.0f - b->graze), 0, ONE_MINUS_EPSILON);
    }
    return cosine_hemisphere(u, v);
}

/* ---- reflectance of a microfacet -------------------------------------------------------------- */

static inline struct vec3 schlick_mix(struct vec3 f0, float f90, float weight)
{
    return (struct vec3){f0.x + (f90 - f0.x) * weight, f0.y + (f90 - f0.y) * weight,
                         f0.z + (f90 - f0.z) * weight};
}

/* Schlick reflectance of the reflect lobe, all weights included. */
static inline struct vec3 schlick_color(const struct bsdf *b, float weight)
{
    return schlick_mix(b->f0, b->f90, weight);
}

/* What the film adds to a Fresnel term that Schlick's formula approximates from f0 to 1. The
 * difference of the two, so that it is nothing without thickness whatever the term's form. */
static inline struct vec3 film_difference(const struct bsdf *b, float cos_1, struct vec3 f0)
{
    CHARGE_SCOPE(IRIDESCENCE);
    struct vec3 f = film_reflectance(b->layers.film_ior, b->layers.film_path, cos_1, f0);
    return vec3_sub(f, schlick_mix(f0, 1.0f, schlick_weight(cos_1)));
}

static inline float slab_reflectance(float r) { return 2.0f * r / (1.0f + r); }

static inline float interreflected(float r, float k) { return r * (1.0f - k) / (1.0f - k * r); }

/* Reflectance of the coat's microfacets. */
static inline float coat_fresnel(const struct bsdf_layers *l, float cos_h)
{
    if (l->coat_exact)
        return fresnel_exact(cos_h, l->coat_ior);
    return l->coat_f0 + (l->coat_f90 - l->coat_f0) * schlick_weight(cos_h);
}

static inline struct vec3 conductor_color(const struct bsdf *b, float cos_h)
{
    CHARGE_SCOPE(CONDUCTOR);
    const struct bsdf_layers *l = &b->layers;
    float back = l->interreflection;
    struct vec3 f;

    if (HAS(CLEARCOAT) && l->coat > 0.0f && l->coat_exact) {
        /* Light comes steeper to a metal under a coat, and is thrown back and forth. */
        back = l->coat * coat_fresnel(l, cos_h);
        cos_h = sqrtf(1.0f - (1.0f - cos_h * cos_h) / (l->coat_ior * l->coat_ior));
    }
    f = (struct vec3){fresnel_conductor(cos_h, l->eta.x, l->k.x),
                     fresnel_conductor(cos_h, l->eta.y, l->k.y),
                     fresnel_conductor(cos_h, l->eta.z, l->k.z)};

    f = vec3_mul(f, b->p.base_color);
    if (HAS(IRIDESCENCE) && l->film > 0.0f)
        f = clamp_color(vec3_mad(f, film_difference(b, cos_h, b->f0), l->film), 1);
    f.x = interreflected(f.x, back);
    f.y = interreflected(f.y, back);
    f.z = interreflected(f.z, back);
    return f;
}

/* The metal's and the plastic's terms, apart and without weights. */
static inline struct vec3 layered_metal(const struct bsdf *b, float cos_h)
{
    const struct bsdf_layers *l = &b->layers;
    struct vec3 f;

    if (HAS(CONDUCTOR) && l->conductor)
        return conductor_color(b, cos_h);
    f = schlick_mix(b->p.base_color, 1.0f, schlick_weight(cos_h));
    if (HAS(IRIDESCENCE) && l->film > 0.0f)
        f = clamp_color(vec3_mad(f, film_difference(b, cos_h, b->p.base_color), l->film), 1);
    return f;
}

static inline struct vec3 layered_plastic(const struct bsdf *b, float cos_h)
{
    const struct bsdf_layers *l = &b->layers;
    float fade = b->f90_dielectric, weight = schlick_weight(cos_h);
    struct vec3 f;

    if (l->exact_coat || (HAS(THIN_TRANSMISSION) && l->slab && b->smooth && b->exact))
        weight = (fresnel_exact(cos_h, b->p.ior) - b->normal_f0) * b->inverse_rest_f0;
    f = schlick_mix(b->f0_dielectric, fade, weight);
    if (HAS(IRIDESCENCE) && l->film > 0.0f)
        f = vec3_mad(f, film_difference(b, cos_h, l->film_f0), l->film * b->p.specular);
    f = clamp_color(f, 1);
    if (HAS(THIN_TRANSMISSION) && l->slab) {
        f.x = slab_reflectance(f.x);
        f.y = slab_reflectance(f.y);
        f.z = slab_reflectance(f.z);
    }
    return f;
}

/* The reflect lobe's term, all weights included. */
static inline struct vec3 reflect_color(const struct bsdf *b, float cos_h, int full)
{
    const struct bsdf_layers *l = &b->layers;
    struct vec3 f = {0, 0, 0};

    if (full && ((HAS(CONDUCTOR) && l->conductor) || (HAS(IRIDESCENCE) && l->film > 0.0f) ||
                 (HAS(THIN_TRANSMISSION) && l->slab) || l->exact_coat)) {
        if (l->weight_metal > 0.0f)
            f = vec3_scale(layered_metal(b, cos_h), l->weight_metal);
        if (l->weight_plastic > 0.0f)
            f = vec3_mad(f, layered_plastic(b, cos_h), l->weight_plastic);
        return f;
    }
    return schlick_color(b, schlick_weight(cos_h));
}

/* Reflectance of the refractive interface (without its weight). */
static inline struct vec3 interface_color(const struct bsdf *b, float cos_i, int full)
{
    float weight;
    struct vec3 f;

    if (b->exact) {
        float r = fresnel_exact(cos_i, b->eta);
        if (r >= 1.0f)
            return (struct vec3){1, 1, 1};
        weight = (r - b->normal_f0) * b->inverse_rest_f0;
    } else {
        weight = schlick_weight(cos_i);
    }
    f = schlick_mix(b->f0_dielectric, b->p.specular, weight);
    if (full && HAS(IRIDESCENCE) && b->layers.film > 0.0f) {
        float cos_1 = cos_i;
        if (b->p.inside && b->exact) /* the film sees the angle outside */
            cos_1 = sqrtf(float_max(0.0f, 1.0f - (1.0f - cos_i * cos_i) / (b->eta * b->eta)));
        f = vec3_mad(f, film_difference(b, cos_1, b->layers.film_f0),
                     b->layers.film * b->p.specular);
    }
    /* The exact term dips below its value at normal incidence for an ior above 3.7. */
    return clamp_color(f, 1);
}

/* How likely the interface lobe reflects or transmits at a microfacet that reflects `f`. 0
 * only where that way carries nothing. Apart, for 1 - F has few digits at grazing angles. */
struct interface_choice {
    float reflect, transmit;
};

static inline struct interface_choice interface_choose(const struct bsdf *b, struct vec3 f)
{
    float reflected = vec3_average(f);
    float transmitted = (1.0f - vec3_max(f)) * vec3_average(b->p.base_color);
    float scale = reflected + transmitted;

    if (!(scale > 0.0f))
        return (struct interface_choice){1, 0};
    scale = 1.0f / scale;
    return (struct interface_choice){reflected * scale, transmitted * scale};
}

/* ---- what is left below a layer --------------------------------------------------------------- */

/* Share of light that plastic's reflection leaves for the base where Schlick's mean weight is
 * `blend` and microfacets lose `loss`; and along a direction. */
static inline float layer_rest_of(const struct bsdf *b, float blend, float loss, int full)
{
    float r = b->layer_f0 + (b->layer_f90 - b->layer_f0) * blend;

    if (HAS(MULTIPLE_SCATTERING) && b->compensated) {
        /* A stretched distribution's loss is known less well: only its F0 counts it. */
        r = is_stretched(b, full) ? r - loss * b->layer_f0 : r - loss * r;
        r += loss * b->layer_given_back;
    }
    if (full && HAS(THIN_TRANSMISSION) && b->layers.slab)
        r = slab_reflectance(r > 0.0f ? r : 0.0f);
    return r < 1.0f ? (r > 0.0f ? 1.0f - r : 1.0f) : 0.0f;
}
static inline float layer_rest(const struct bsdf *b, float mu, float loss, int full)
{
    float blend;

    if (b->layer_f90 == 0.0f)
        return 1.0f;
    blend = b->smooth ? schlick_weight(mu) : albedo_blend_at(&b->row, mu);
    if (full && b->layers.exact_coat && !b->smooth)
        blend += albedo_exact_at(&b->layers.exact, mu);
    if (full && b->smooth &&
        (b->layers.exact_coat || (HAS(THIN_TRANSMISSION) && b->layers.slab && b->exact)))
        blend = (fresnel_exact(mu, b->p.ior) - b->normal_f0) * b->inverse_rest_f0;
    return layer_rest_of(b, blend, loss, full);
}

/* Share that the coat leaves along a direction whose cosine to its normal is `mu`. */
static inline float coat_rest(const struct bsdf_layers *l, float mu)
{
    float r;

    mu = float_min(fabsf(mu), 1.0f);
    if (l->coat_smooth) {
        r = coat_fresnel(l, mu);
    } else {
        r = albedo_blend_at(&l->coat_row, mu);
        if (l->coat_exact)
            r += albedo_exact_at(&l->exact, mu);
        r = l->coat_f0 + (l->coat_f90 - l->coat_f0) * r;
        r *= 1.0f - albedo_loss_at(&l->coat_loss, mu);
    }
    return 1.0f - l->coat * r;
}

/* Directional albedo of the sheen, before its colour, scaled to at most 1; *limit is the scale. */
static inline float sheen_share(const struct bsdf_layers *l, float mu, float *limit)
{
    float e = albedo_sheen_at(l->sheen_alpha, float_min(fabsf(mu), 1.0f));

    *limit = e > 1.0f ? 1.0f / e : 1.0f;
    return e > 1.0f ? 1.0f : e;
}

/* What sheen and coat leave of what lies below, between wo and wi: of lobes in general, and of
 * the Lambert base, whose mean over wi is taken care of by b->diffuse. */
struct layer_scale {
    float lobe, diffuse;
};

static inline int has_cover(const struct bsdf *b, int full)
{
    return full && ((HAS(CLEARCOAT) && b->layers.coat > 0.0f) ||
                    (HAS(SHEEN) && b->layers.sheen_most > 0.0f));
}

static inline struct layer_scale layer_scale(const struct bsdf *b, struct vec3 wi, int full)
{
    const struct bsdf_layers *l = &b->layers;
    struct layer_scale s = {1, 1};
    int near = l->covered, far = wi.z > 0.0f ? l->covered : l->through;

    if (!has_cover(b, full) || (!near && !far))
        return s;
    if (HAS(CLEARCOAT) && l->coat > 0.0f) {
        CHARGE_SCOPE(CLEARCOAT);
        float rest_o = near ? l->coat_rest_o : 1.0f;
        float rest_i = far ? coat_rest(l, vec3_dot(l->coat_normal, wi)) : 1.0f;
        s.lobe = float_min(rest_o, rest_i);
        s.diffuse = near && far ? rest_o * rest_i : s.lobe;
    }
    if (HAS(SHEEN) && l->sheen_most > 0.0f) {
        CHARGE_SCOPE(SHEEN);
        float rest_i = 1.0f, limit;
        if (far)
            rest_i -= l->sheen_most * sheen_share(l, wi.z, &limit);
        rest_i = float_min(near ? l->sheen_rest_o : 1.0f, rest_i);
        s.lobe *= rest_i;
        s.diffuse *= rest_i;
    }
    return s;
}

#endif
