/* layer: what the reflection of plastic leaves for what lies below it.
 *
 * A plain mix of the two by F(v.h), as in glTF, sends out almost twice the incoming light at
 * grazing angles. So the Lambertian base is scaled by what the reflection leaves on the way in and
 * on the way out, over its mean (Kelemen and Szirmay-Kalos 2001; albedo.h has the formula). This is
 * reciprocal, and a white smooth plastic sends out exactly 1. Mean reflectance along mu:
 *
 *   R(mu) = f0 + (f90 - f0) blend(mu), minus what microfacets lose, plus what of it is returned
 *
 * A slab reflects at both faces: R' = 2 R / (1 + R).
 */
#pragma once

#include "worker/render/bsdf/lobe.h"

static inline real slab_reflectance(real r) { return 2.0f * r / (1.0f + r); }

static inline int is_slab(const struct bsdf *b) { return calls_for(b->effects, EFFECT_THIN_TRANSMISSION); }

/* The alpha whose tables give the base's mean reflectance. */
static inline real layer_alpha(const struct bsdf *b)
{
    const struct ggx *g = &b->base.shape;
    return ggx_is_stretched(g) ? albedo_stretched_layer(g->x, g->y) : g->y;
}

/* Replaces Schlick's weight if plastic has the exact Fresnel term. */
static inline real exact_weight(const struct bsdf *b, real cosine)
{
    return (fresnel_exact(cosine, b->material.ior) - b->dielectric.normal_f0) * b->dielectric.inverse_rest_f0;
}

/* The share of light left if Schlick's mean weight is `blend` and microfacets lose `loss`. */
static inline real layer_rest_of(const struct bsdf *b, real blend, real loss)
{
    const struct bsdf_layer *l = &b->layer;
    real r = l->f0 + (l->f90 - l->f0) * blend;

    if (calls_for(b->effects, EFFECT_MULTIPLE_SCATTERING)) {
        /* The loss of a stretched distribution is known less precisely: only its F0 counts it. */
        r = ggx_is_stretched(&b->base.shape) ? r - loss * l->f0 : r - loss * r;
        r += loss * l->returned;
    }
    if (is_slab(b))
        r = slab_reflectance(r > 0.0f ? r : 0.0f);
    return r < 1.0f ? (r > 0.0f ? 1.0f - r : 1.0f) : 0.0f;
}

/* The same along a direction. */
static inline real layer_rest(const struct bsdf *b, real mu, real loss)
{
    real blend;

    if (b->layer.f90 == 0.0f)
        return 1.0f;
    if (b->base.smooth) {
        blend = b->layer.exact || (is_slab(b) && b->dielectric.exact) ? exact_weight(b, mu) : schlick_weight(mu);
    } else {
        blend = albedo_blend_at(&b->layer.row, mu);
        if (b->layer.exact)
            blend += albedo_exact_at(&b->layer.exact_row, mu);
    }
    return layer_rest_of(b, blend, loss);
}

/* What is left of a hemisphere's light. */
static inline real layer_rest_average(const struct bsdf *b)
{
    const struct bsdf_layer *l = &b->layer;
    real range = l->f90 - l->f0, loss, more = 0, more_kept = 0;

    if (l->exact) {
        more = b->base.smooth ? l->exact_row.smooth_mean : l->exact_row.mean;
        more_kept = l->exact_row.kept_mean;
    }
    if (b->base.smooth)
        return 1.0f - (l->f0 + range * (SCHLICK_MEAN + more));
    if (!calls_for(b->effects, EFFECT_MULTIPLE_SCATTERING))
        return 1.0f - (l->f0 + range * (l->row.average + more));
    if (ggx_is_stretched(&b->base.shape)) {
        loss = b->compensation.stretched_loss.mean;
        return 1.0f - (l->f0 * (1.0f - loss) + range * (l->row.average + more) + loss * l->returned);
    }
    loss = b->compensation.loss.mean;
    return 1.0f -
           (l->f0 * (1.0f - loss) + range * (b->compensation.loss.schlick_mean + more_kept) + loss * l->returned);
}

/* Under a film the base sends out no more than with Schlick's term between these ends. */
static inline void layer_raise_ends(struct bsdf *b)
{
    struct bsdf_layer *l = &b->layer;
    real specular = b->material.specular, bound = thin_film_bound(b->thin_film.ior, b->thin_film.f0) * specular;

    l->f0 = l->f0 + (bound - l->f0) * b->thin_film.weight;
    l->f90 = l->f90 + (specular - l->f90) * b->thin_film.weight;
    l->f90 = real_max(l->f90, l->f0);
}
