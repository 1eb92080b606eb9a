/* compensation: multiple scattering between microfacets.
 *
 * Single scattering drops the light that meets a second microfacet: 1 - E(mu) of it (albedo.h). It is added back as a
 * wide lobe after Kulla and Conty 2017 ("Revisiting Physically Based Shading at Imageworks"):
 *
 *   f = color (1 - E(mu_o)) (1 - E(mu_i)) / (pi (1 - E_average))
 *   color = F^2 K / (1 - F (1 - K)), F the mean Fresnel term, K = E_average
 *
 * This is reciprocal, and white stays white. In plastic, the part that does not leave at once goes to the base
 * (layer.h). A rough interface sends it to both sides, split so that it stays reciprocal. The cosine lobes of
 * lobe_diffuse.h sample all of it.
 */
#pragma once

#include "common/math/elementary.h"
#include "worker/render/bsdf/lobe.h"

/* A mean loss below this is rounding error. */
#define LOSS_MEAN_MIN REAL(1e-7)
/* The error of the table of stretched distributions' losses is below this share of the loss if the
 * two alphas differ; see tests/statistics/test_bsdf_energy.c. */
#define STRETCHED_DOUBT REAL(0.12)
/* An interface returns slightly less than the table says, to allow for its errors. From an index of 9.8
 * (INTERFACE_MOST) on it is less by a hundredth: the table has only a mirror's entry after that, which is too far to
 * interpolate, and light stays inside for so many reflections that the smallest gain would add up. It returns nothing
 * below the first (n - 1) / (n + 1), which is the table's first, and all from the second on; nothing below the first
 * alpha (the loss is at grazing angles only), and all from the second on. */
#define INTERFACE_DOUBT REAL(1e-4)
#define INTERFACE_DOUBT_BEYOND REAL(0.01)
#define INTERFACE_MOST REAL(0.8145)
#define INTERFACE_IOR_MOST REAL(9.8)
#define INTERFACE_NONE 0.00390625f
#define INTERFACE_ALL REAL(0.02)
#define INTERFACE_ALPHA_NONE ALBEDO_INTERFACE_ALPHA_FIRST
#define INTERFACE_ALPHA_ALL REAL(0.05)
/* The loss's mean is corrected fully from here on, and not at all below INTERFACE_ALPHA_ALL: the
 * table errs at grazing angles there, and to make up for it would be too much elsewhere. */
#define INTERFACE_ALPHA_MEAN REAL(0.1)
/* Single scattering is sampled with at least this share of what it would be without a loss. */
#define INTERFACE_SHARE_MIN REAL(0.1)

static inline int is_compensated(const struct bsdf_params *params)
{
    return calls_for(EFFECTS_ALL, EFFECT_MULTIPLE_SCATTERING) && !params->single_scattering;
}

/* 1 - E along w, of the base's microfacets; 0 if nothing is compensated. */
static inline real compensation_loss(const struct bsdf *b, struct vec3 w)
{
    if (!calls_for(b->effects, EFFECT_MULTIPLE_SCATTERING))
        return 0;
    if (ggx_is_stretched(&b->base.shape))
        return albedo_stretched_loss_at(&b->compensation.stretched_loss, w.x, w.y, real_abs(w.z));
    return albedo_loss_at(&b->compensation.loss, real_abs(w.z));
}

/* The light that leaves after microfacets of mean reflectance f reflect it among themselves, if
 * `kept` of it leaves at every bounce: f^2 kept + f^3 kept (1 - kept) + ... */
static inline real series(real f, real kept) { return f * f * kept / (1.0f - f * (1.0f - kept)); }
static inline struct vec3 series_color(struct vec3 f, real kept)
{
    /* Four lanes, all of them set: gcc divides two at a time and leaves in the others whatever was
     * on the stack; a division of subnormals takes a hundred cycles. */
    real lane[4] = {f.x, f.y, f.z, 0};

    for (int i = 0; i < 4; i++)
        lane[i] = series(lane[i], kept);
    return (struct vec3){lane[0], lane[1], lane[2]};
}

/* Hemispherical mean of the loss. */
static inline real compensation_mean(const struct bsdf *b)
{
    return ggx_is_stretched(&b->base.shape) ? b->compensation.stretched_loss.mean : b->compensation.loss.mean;
}

/* Prepare the compensation of a loss of `loss_o` along wo, if microfacets return `color`:
 * series_color's result with all weights. Returns how often to sample it. */
static inline real compensation_init(struct bsdf *b, struct vec3 color, real loss_o)
{
    real mean = compensation_mean(b), scale;

    if (!(mean > LOSS_MEAN_MIN)) {
        b->compensation.color = LOBE_BLACK;
        return 0;
    }
    scale = loss_o / mean;
    if (ggx_is_stretched(&b->base.shape)) /* less if the table is less accurate */
        scale *= 1.0f - STRETCHED_DOUBT * (1.0f - b->base.shape.y / b->base.shape.x);
    b->compensation.color = vec3_scale(color, scale * REAL_INV_PI);
    return vec3_average(color) * loss_o;
}

/* ---- a rough interface --------------------------------------------------------------------------- */

/* What the table may be wrong by, as a share of the loss. */
static inline real interface_doubt(real n)
{
    return INTERFACE_DOUBT + INTERFACE_DOUBT_BEYOND * clamp_to(n * (1.0f / INTERFACE_IOR_MOST) - 1.0f, 0, 1);
}

/* How much of the table's loss is returned: less if the Fresnel term is not the plain one, and
 * where the table is inaccurate. n: the denser side's index relative to the other's, r: (n - 1) /
 * (n + 1), or 1 where there is no index. */
static inline real interface_kept(const struct bsdf *b, real n, real r)
{
    const struct bsdf_dielectric *d = &b->dielectric;
    real fade = clamp_to((r - INTERFACE_NONE) * (1.0f / (INTERFACE_ALL - INTERFACE_NONE)), 0, 1);
    real alpha = b->base.shape.y;
    real kept = d->normal_f0 > 0.0f ? vec3_min(d->f0) / d->normal_f0 : 1.0f;

    kept = real_min(real_min(kept, b->material.specular), 1.0f);
    if (d->exact)
        kept = real_min(kept, (1.0f - vec3_max(d->f0)) * d->inverse_rest_f0);
    if (SAFEGUARD(INTERFACE_DOUBT))
        kept *= (1.0f - interface_doubt(n)) * fade;
    kept *= clamp_to((alpha - INTERFACE_ALPHA_NONE) * (1.0f / (INTERFACE_ALPHA_ALL - INTERFACE_ALPHA_NONE)), 0, 1);
    if (ggx_is_stretched(&b->base.shape))
        kept *= alpha / b->base.shape.x;
    if (calls_for(b->effects, EFFECT_IRIDESCENCE))
        kept *= 1.0f - b->thin_film.weight;
    return kept;
}

/* How far the loss's mean is moved from the interpolated one to the true one. */
static inline real interface_correction(real alpha)
{
    return clamp_to((alpha - INTERFACE_ALPHA_ALL) * (1.0f / (INTERFACE_ALPHA_MEAN - INTERFACE_ALPHA_ALL)), 0, 1);
}

/* The reflected and transmitted shares on each side are such that the same light (times n^2) passes both ways: with
 * losses k L scaled from the mean M to the corrected k M, and the smaller one of both sides' k M in `pass`, f = k_o L_o
 * k_i L_i pass / (pi k_i M_i eta^2). *above and *below: how often to sample each; below 0: no such lobe. Returns the
 * share that is not lost: sampled as often as it is bright, single scattering makes the square of a sample's weight
 * 1.26 on average, not 1.46, inside a body of index 3 and alpha 1, where these squares multiply from wall to wall. */
static inline real interface_compensation_init(struct bsdf *b, real base, real *above, real *below)
{
    struct bsdf_interface_compensation *c = &b->interface_compensation;
    const real alpha = b->base.shape.y, weight = b->weights.glass;
    real n = b->eta > 1.0f ? b->eta : 1.0f / b->eta, r = 1, average, pass, near, far, loss_o;
    real corrected, inverse;
    int side = b->eta < 1.0f; /* wo is in the denser medium */

    *above = *below = -1;
    if (b->dielectric.exact) {
        if (b->interface.transmit_delta)
            return 1;
        r = real_min((n - 1.0f) / (n + 1.0f), INTERFACE_MOST);
    }
    loss_o = interface_kept(b, n, r);
    if (!(loss_o > 0.0f))
        return 1;
    c->loss_near = albedo_interface_find(alpha, r, side);
    c->loss_far = albedo_interface_find(alpha, r, !side);
    if (!(c->loss_near.mean > LOSS_MEAN_MIN && c->loss_far.mean > LOSS_MEAN_MIN))
        return 1;
    corrected = interface_correction(alpha);
    near = c->loss_near.mean + (c->loss_near.lost - c->loss_near.mean) * corrected;
    far = c->loss_far.mean + (c->loss_far.lost - c->loss_far.mean) * corrected;
    /* Mean Fresnel reflectance from the thinner side (fit of Kulla and Conty 2017), to 0.3 %; from
     * the denser side exactly (1 - F') = (1 - F) / n^2. */
    average = b->dielectric.exact ? (n - 1.0f) / (REAL(4.08567) + REAL(1.00071) * n) : 1.0f;
    average = average < 1.0f ? average : 1.0f;
    pass = (1.0f - average) * (side ? 1.0f / (n * n) : 1.0f) * real_min(near, far) / near;
    c->on = 1;
    inverse = 1.0f / c->loss_near.mean;
    loss_o *= near * inverse * albedo_interface_loss_at(&c->loss_near, alpha, b->cos_o);
    c->near = weight * loss_o * (1.0f - pass) * (REAL_INV_PI * inverse);
    c->far = vec3_scale(b->interface.tint, loss_o * pass * REAL_INV_PI / (c->loss_far.mean * b->eta * b->eta));
    *above = weight * loss_o * (1.0f - pass);
    *below = pass > 0.0f ? weight * loss_o * pass * base : -1.0f;
    return real_max(1.0f - loss_o, INTERFACE_SHARE_MIN);
}

/* f mu of what it returns to wo's side, and to the other. */
static inline real interface_compensation_near(const struct bsdf *b, real mu)
{
    const struct bsdf_interface_compensation *c = &b->interface_compensation;
    return c->near * mu * albedo_interface_loss_at(&c->loss_near, b->base.shape.y, mu);
}
static inline struct vec3 interface_compensation_far(const struct bsdf *b, real mu)
{
    const struct bsdf_interface_compensation *c = &b->interface_compensation;
    return vec3_scale(c->far, mu * albedo_interface_loss_at(&c->loss_far, b->base.shape.y, mu));
}
