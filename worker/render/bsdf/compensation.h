/* compensation: multiple scattering between microfacets.
 *
 * Single scattering drops the light that meets a second microfacet: 1 - E(mu) of it (albedo.h). It
 * is added as a wide lobe after Kulla and Conty 2017 ("Revisiting Physically Based Shading at
 * Imageworks"):
 *
 *   f = color (1 - E(mu_o)) (1 - E(mu_i)) / (pi (1 - E_average))
 *   color = F^2 K / (1 - F (1 - K)), F the mean Fresnel term, K = E_average
 *
 * Reciprocal, and white stays white. The part of plastic's that does not leave at once goes to its
 * base (layer.h). A rough interface's part goes to both sides, split so that it stays reciprocal.
 * All of it is sampled by the cosine lobes of lobe_diffuse.h.
 */
#ifndef AZULEJO_RENDER_COMPENSATION_H
#define AZULEJO_RENDER_COMPENSATION_H

#include "common/math/elementary.h"
#include "worker/render/bsdf/lobe.h"

/* A mean loss below this is rounding. */
#define LOSS_MEAN_MIN 1e-7f
/* The table of stretched distributions' losses errs by less than this share of the loss where
 * alphas are unlike; see tests/statistics/test_bsdf_energy.c. */
#define STRETCHED_DOUBT 0.12f
/* An interface returns a little less than the table says, for its errors; nothing below
 * the first (n - 1) / (n + 1), which is the table's first, all from the second;
 * nothing below the first alpha (the loss is at grazing angles only), all from the second. */
#define INTERFACE_KEPT 0.99f
#define INTERFACE_NONE 0.00390625f
#define INTERFACE_ALL 0.015f
/* From the table's last but one (n = 9.8) to the last, a mirror, is too far to interpolate. */
#define INTERFACE_MOST 0.8145f
#define INTERFACE_ALPHA_NONE 0.02f
#define INTERFACE_ALPHA_ALL 0.05f

static inline int is_compensated(const struct bsdf_params *params)
{
    return HAS(MULTIPLE_SCATTERING) && !params->single_scattering;
}

/* 1 - E along w, of the base's microfacets; 0 where nothing is compensated. */
static inline float compensation_loss(const struct bsdf *b, struct vec3 w)
{
    if (!CALLS_FOR(b, MULTIPLE_SCATTERING))
        return 0;
    if (ggx_is_stretched(&b->base.shape))
        return albedo_stretched_loss_at(&b->compensation.stretched_loss, w.x, w.y, fabsf(w.z));
    return albedo_loss_at(&b->compensation.loss, fabsf(w.z));
}

/* What comes out of light that microfacets of mean reflectance f throw to each other, of which
 * `kept` leaves at every bounce: f^2 kept + f^3 kept (1 - kept) + ... */
static inline float series(float f, float kept)
{
    return f * f * kept / (1.0f - f * (1.0f - kept));
}
static inline struct vec3 series_color(struct vec3 f, float kept)
{
    /* Four lanes, all of them set: gcc divides two at a time and leaves the others what the stack
     * held, and if those are subnormal the division takes a hundred cycles. */
    float lane[4] = {f.x, f.y, f.z, 0};

    for (int i = 0; i < 4; i++)
        lane[i] = series(lane[i], kept);
    return (struct vec3){lane[0], lane[1], lane[2]};
}

/* Hemispherical mean of the loss. */
static inline float compensation_mean(const struct bsdf *b)
{
    return ggx_is_stretched(&b->base.shape) ? b->compensation.stretched_loss.mean
                                            : b->compensation.loss.mean;
}

/* Prepare what is returned of a loss of `loss_o` along wo, of which microfacets return `color`:
 * series_color's with all weights. Returns how often to sample it. */
static inline float compensation_init(struct bsdf *b, struct vec3 color, float loss_o)
{
    float mean = compensation_mean(b), scale;

    if (!(mean > LOSS_MEAN_MIN)) {
        b->compensation.color = LOBE_BLACK;
        return 0;
    }
    scale = loss_o / mean;
    if (ggx_is_stretched(&b->base.shape)) /* less where the table is less sure */
        scale *= 1.0f - STRETCHED_DOUBT * (1.0f - b->base.shape.y / b->base.shape.x);
    b->compensation.color = vec3_scale(color, scale * INV_PI_F);
    return vec3_average(color) * loss_o;
}

/* ---- a rough interface --------------------------------------------------------------------------- */

/* How much of the table's loss is returned: less where the Fresnel term is not the plain one, and
 * where the table is not sure. */
static inline float interface_kept(const struct bsdf *b, float fade)
{
    const struct bsdf_dielectric *d = &b->dielectric;
    float alpha = b->base.shape.y;
    float kept = d->normal_f0 > 0.0f ? vec3_min(d->f0) / d->normal_f0 : 1.0f;

    kept = float_min(float_min(kept, b->material.specular), 1.0f);
    if (d->exact)
        kept = float_min(kept, (1.0f - vec3_max(d->f0)) * d->inverse_rest_f0);
    kept *= INTERFACE_KEPT * fade;
    kept *= clamp_to((alpha - INTERFACE_ALPHA_NONE) *
                     (1.0f / (INTERFACE_ALPHA_ALL - INTERFACE_ALPHA_NONE)), 0, 1);
    if (ggx_is_stretched(&b->base.shape))
        kept *= alpha / b->base.shape.x;
    if (CALLS_FOR(b, IRIDESCENCE))
        kept *= 1.0f - b->thin_film.weight;
    return kept;
}

/* Reflected and transmitted shares on either side are such that what passes is the same both ways
 * (times n^2). *above and *below are how often to sample either; below 0: there is none. */
static inline void interface_compensation_init(struct bsdf *b, float base, float *above,
                                               float *below)
{
    struct bsdf_interface_compensation *c = &b->interface_compensation;
    const float alpha = b->base.shape.y, weight = b->weights.glass;
    float n = b->eta > 1.0f ? b->eta : 1.0f / b->eta, r = (n - 1.0f) / (n + 1.0f), average, pass;
    float near, far, loss_o, scale;
    float fade = clamp_to((r - INTERFACE_NONE) * (1.0f / (INTERFACE_ALL - INTERFACE_NONE)), 0, 1);
    int side = b->eta < 1.0f; /* wo is in the denser medium */

    *above = *below = -1;
    if (!b->dielectric.exact) {
        r = 1;
        fade = 1;
    } else if (b->interface.transmit_delta) {
        return;
    } else {
        r = float_min(r, INTERFACE_MOST);
    }
    c->loss_near = albedo_interface_find(alpha, r, side);
    c->loss_far = albedo_interface_find(alpha, r, !side);
    near = c->loss_near.mean;
    far = c->loss_far.mean;
    if (!(near > LOSS_MEAN_MIN && far > LOSS_MEAN_MIN))
        return;
    /* Mean Fresnel reflectance from the thinner side (fit of Kulla and Conty 2017), to 0.3 %;
     * from the denser side (1 - F') = (1 - F) / n^2 exactly. */
    average = b->dielectric.exact ? (n - 1.0f) / (4.08567f + 1.00071f * n) : 1.0f;
    average = average < 1.0f ? average : 1.0f;
    pass = (1.0f - average) * (side ? 1.0f / (n * n) : 1.0f) * float_min(near, far) / near;
    scale = interface_kept(b, fade);
    if (!(scale > 0.0f))
        return;
    c->on = 1;
    loss_o = scale * albedo_interface_loss_at(&c->loss_near, alpha, b->cos_o);
    c->near = weight * loss_o * (1.0f - pass) * (INV_PI_F / near);
    c->far = vec3_scale(b->interface.tint, loss_o * pass * INV_PI_F / (far * b->eta * b->eta));
    *above = weight * loss_o * (1.0f - pass);
    *below = pass > 0.0f ? weight * loss_o * pass * base : -1.0f;
}

/* f mu of what it returns to wo's side, and to the other. */
static inline float interface_compensation_near(const struct bsdf *b, float mu)
{
    const struct bsdf_interface_compensation *c = &b->interface_compensation;
    return c->near * mu * albedo_interface_loss_at(&c->loss_near, b->base.shape.y, mu);
}
static inline struct vec3 interface_compensation_far(const struct bsdf *b, float mu)
{
    const struct bsdf_interface_compensation *c = &b->interface_compensation;
    return vec3_scale(c->far, mu * albedo_interface_loss_at(&c->loss_far, b->base.shape.y, mu));
}

#endif
