/* lobe_coat: a clear coat above everything else: GGX (microfacet.h) with Schlick's Fresnel term and its own normal
 * (KHR_materials_clearcoat).
 *
 *   f = weight F(wo.h) D G2 / (4 (n.wo) (n.wi))
 *
 * Exact: pbrt's coat over a conductor (coatedconductor) uses Fresnel's equations instead of Schlick's formula. The coat
 * leaves 1 - weight E of the light along a direction to what lies below, where E is its mean reflectance (albedo.h). */
#pragma once

#include "worker/render/bsdf/lobe.h"

/* Reflectance of the coat's microfacets. */
static inline real coat_fresnel(const struct bsdf_coat *c, real cos_h)
{
    if (c->exact)
        return fresnel_exact(cos_h, c->ior);
    return c->f0 + (c->f90 - c->f0) * schlick_weight(cos_h);
}

/* The share that the coat leaves along a direction whose cosine to its normal is `mu`. */
static inline real coat_rest(const struct bsdf_coat *c, real mu)
{
    real r;

    mu = real_min(real_abs(mu), 1.0f);
    if (c->micro.smooth) {
        r = coat_fresnel(c, mu);
    } else {
        r = albedo_blend_at(&c->row, mu);
        if (c->exact)
            r += albedo_exact_at(&c->exact_row, mu);
        r = c->f0 + (c->f90 - c->f0) * r;
        r *= 1.0f - albedo_loss_at(&c->loss, mu);
    }
    return 1.0f - c->weight * r;
}

/* Mean of what the coat leaves, over the hemisphere. */
static inline real coat_rest_average(const struct bsdf_coat *c)
{
    real range = c->f90 - c->f0;

    if (c->micro.smooth)
        return 1.0f - c->weight * (c->f0 + range * SCHLICK_MEAN);
    return 1.0f - c->weight * (c->f0 * (1.0f - c->loss.mean) + range * c->loss.schlick_mean);
}

/* Over a conductor that knows of it (pbrt's) it has the exact Fresnel term, where the tables do. */
static inline void coat_init(struct bsdf *b, const struct bsdf_params *p, struct vec3 wo)
{
    struct bsdf_coat *c = &b->coat;
    int exact = calls_for(b->effects, EFFECT_CONDUCTOR) && b->reflection.interreflection > 0.0f;
    real n = relative_index(clamp_to(p->clearcoat_ior, 1, BSDF_IOR_MAX), p);
    real r = (n - 1.0f) / (n + 1.0f), alpha = clamp_to(p->clearcoat_alpha, 0, 1);

    c->weight = clamp_to(p->clearcoat, 0, 1);
    c->ior = n;
    c->f0 = r * r;
    c->f90 = bsdf_f90_of(r * r);
    c->exact = exact && n >= ALBEDO_EXACT_IOR_FIRST && n <= ALBEDO_EXACT_IOR_LAST;
    c->micro.shape = ggx_make(alpha, alpha, 0);
    c->micro.smooth = alpha_is_smooth(alpha);
    if (!c->micro.smooth) {
        c->row = albedo_row_find(alpha);
        c->loss = albedo_loss_row_find(alpha);
        if (c->exact)
            c->exact_row = albedo_exact_find(alpha, n);
    }
    c->normal = vec3_normalize(p->clearcoat_normal);
    if (!(c->normal.z > 0.0f))
        c->normal = (struct vec3){0, 0, 1};
    c->cos_o = real_min(vec3_dot(c->normal, wo), 1.0f);
    c->micro.root_o = ggx_root(c->micro.shape.y2, c->cos_o);
    c->rest_o = coat_rest(c, c->cos_o);
}

static inline real coat_share(const struct bsdf *b, real *rest)
{
    const struct bsdf_coat *c = &b->coat;

    *rest *= c->rest_o;
    if (!(c->cos_o > 0.0f) || (c->f90 == 0.0f && c->f0 == 0.0f))
        return -1.0f;
    return 1.0f - c->rest_o;
}

static inline void coat_cover(const struct bsdf *b, struct vec3 wi, int near, int far, struct cover *cover)
{
    real rest_o = near ? b->coat.rest_o : 1.0f;
    real rest_i = far ? coat_rest(&b->coat, vec3_dot(b->coat.normal, wi)) : 1.0f;

    cover->lobe = real_min(rest_o, rest_i);
    cover->diffuse = near && far ? rest_o * rest_i : cover->lobe;
}

/* |h x n|^2. From the cosine it would cancel, and with it the peak of a narrow D. */
static inline real coat_sine2(struct vec3 n, struct vec3 h, real length2, real cosine)
{
    return SAFEGUARD(COAT_DENSITY) ? vec3_length_squared(vec3_cross(n, h)) : length2 - cosine * cosine;
}

static inline struct vec3 coat_evaluate(const struct bsdf *b, struct vec3 wo, struct vec3 wi, const struct cover *cover,
                                        real *pdf)
{
    const struct bsdf_coat *c = &b->coat;
    const real alpha2 = c->micro.shape.y2, mu_o = c->cos_o, root_o = c->micro.root_o;
    struct vec3 h = vec3_add(wo, wi);
    real length2 = vec3_length_squared(h), mu_i = vec3_dot(c->normal, wi), cos_n, f, root_i;
    real density;

    (void)cover;
    *pdf = 0;
    if (!(length2 > HALF_LENGTH2_MIN && mu_i > 0.0f && mu_o > 0.0f))
        return LOBE_BLACK;
    mu_i = real_min(mu_i, 1.0f);
    root_i = ggx_root(alpha2, mu_i);
    cos_n = vec3_dot(c->normal, h);
    f = length2 / (coat_sine2(c->normal, h, length2, cos_n) + alpha2 * (cos_n * cos_n));
    density = alpha2 * REAL_INV_PI * (f * f) * 0.5f / (mu_o + root_o);
    *pdf = b->lobe_pdf[BSDF_LOBE_COAT] * density;
    f = coat_fresnel(c, 0.5f * real_sqrt(length2));
    return vec3_splat(c->weight * f * density * mu_i * (mu_o + root_o) / (mu_i * root_o + mu_o * root_i));
}

static inline enum lobe_result coat_sample(const struct bsdf *b, struct vec3 wo, real w, real u, real v,
                                           struct bsdf_sample *out)
{
    const struct bsdf_coat *c = &b->coat;
    struct basis frame = basis_from_normal(c->normal);

    (void)w;
    if (c->micro.smooth) {
        out->wi = reflect_about(wo, c->normal);
        out->weight = vec3_splat(c->weight * coat_fresnel(c, c->cos_o) / b->lobe_pdf[BSDF_LOBE_COAT]);
        return out->wi.z > 0.0f ? LOBE_DELTA : LOBE_NOTHING;
    }
    wo = basis_to_local(&frame, wo);
    if (!(wo.z > 0.0f))
        return LOBE_NOTHING;
    out->wi = reflect_about(wo, ggx_sample_visible(wo, c->micro.shape.y, c->micro.shape.y, u, v));
    if (!(out->wi.z > 0.0f))
        return LOBE_NOTHING;
    out->wi = basis_to_world(&frame, out->wi);
    return out->wi.z > 0.0f ? LOBE_SMOOTH : LOBE_NOTHING;
}
