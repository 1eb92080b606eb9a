/* bsdf_init: all that depends on the material and wo only. */
#include "common/math/elementary.h"
#include "worker/render/bsdf/bsdf.h"
#include "worker/render/bsdf/lobes.h"
#include "worker/render/bsdf/microfacet.h"

/* A lobe that can contribute is chosen at least this often. */
#define LOBE_SHARE_MIN 0.02f
/* Hemispherical mean of (1 - mu)^5, and its variance. */
#define SCHLICK_MEAN (1.0f / 21.0f)
#define SCHLICK_VARIANCE 0.0129f
/* Give back nothing of a mean loss below: it is rounding. */
#define LOSS_MEAN_MIN 1e-7f
/* The table of stretched distributions' losses errs by less than this share of the loss where
 * alphas are unlike; see tests/statistics/test_bsdf_energy.c. */
#define STRETCHED_DOUBT 0.12f
/* An interface gives back a little less than the table says, for its errors; nothing below
 * the first (n - 1) / (n + 1), which is the table's first, all from the second;
 * nothing below the first alpha (the loss is at grazing angles only), all from the second. */
#define INTERFACE_KEPT 0.99f
#define INTERFACE_NONE 0.00390625f
#define INTERFACE_ALL 0.015f
/* From the table's last but one (n = 9.8) to the last, a mirror, is too far to interpolate. */
#define INTERFACE_MOST 0.8145f
#define INTERFACE_ALPHA_NONE 0.02f
#define INTERFACE_ALPHA_ALL 0.05f

static const struct vec3 BSDF_INIT_BLACK = {0, 0, 0};

static inline void clamp_base(struct bsdf_base *p, const struct bsdf_params *from)
{
    p->base_color = clamp_color(from->base_color, 1);
    p->metallic = clamp_to(from->metallic, 0, 1);
    p->alpha = clamp_to(from->alpha, 0, 1);
    p->ior = from->ior == 0.0f ? 0.0f : clamp_to(from->ior, 1 / BSDF_IOR_MAX, BSDF_IOR_MAX);
    if (HAS(NESTED_DIELECTRIC) && from->ior_outside > 1.0f)
        p->ior /= from->ior_outside < BSDF_IOR_MAX ? from->ior_outside : BSDF_IOR_MAX;
    p->specular = clamp_to(from->specular, 0, 1);
    p->specular_color = clamp_color(from->specular_color, 1e6f);
    p->transmission = clamp_to(from->transmission, 0, 1);
    p->refractive = from->refractive != 0;
    p->inside = from->inside != 0;
    if (from->base_interreflection > 0.0f) {
        float k = float_min(from->base_interreflection, 0.999f);
        p->base_color.x = interreflected(p->base_color.x, k);
        p->base_color.y = interreflected(p->base_color.y, k);
        p->base_color.z = interreflected(p->base_color.z, k);
    }
}

/* Does anything of the lower part of struct bsdf_params act? */
static inline int is_layered(const struct bsdf_params *p)
{
    return (HAS(ANISOTROPY) && p->alpha_stretched > 0.0f) || (HAS(CONDUCTOR) && p->conductor) ||
           (HAS(CLEARCOAT) && p->clearcoat > 0.0f) ||
           (HAS(SHEEN) &&
            (p->sheen_color.x > 0.0f || p->sheen_color.y > 0.0f || p->sheen_color.z > 0.0f)) ||
           (HAS(IRIDESCENCE) && p->iridescence > 0.0f) ||
           (HAS(DIFFUSE_TRANSMISSION) && p->diffuse_transmission > 0.0f) ||
           (HAS(THIN_TRANSMISSION) && p->thin_slab && !p->refractive) ||
           p->base_interreflection > 0.0f;
}

/* Selection probabilities from the first `count` lobes' shares; a negative share is an absent
 * lobe. */
static inline int choose_by_share(struct bsdf *b, const float *share, int count)
{
    float total = 0, sum = 0, floored[BSDF_LOBES_MAX];
    int last = -1;

    for (int i = 0; i < count; i++)
        total += share[i] > 0.0f ? share[i] : 0.0f;
    if (!(total > 1e-10f))
        total = 1e-10f;
    for (int i = 0; i < count; i++) {
        floored[i] = share[i] < 0.0f ? 0.0f
                     : share[i] > LOBE_SHARE_MIN * total ? share[i] : LOBE_SHARE_MIN * total;
        sum += floored[i];
        last = share[i] < 0.0f ? last : i;
    }
    if (last < 0)
        return 0;
    sum = 1.0f / sum;
    total = 0;
    for (int i = 0; i < count; i++) {
        b->lobe_pdf[i] = floored[i] * sum;
        total += b->lobe_pdf[i];
        b->lobe_cdf[i] = i >= last ? 1.0f : total;
    }
    return 1;
}

/* The same for BSDF_KIND_MIX, with as few lobes as may be: their number is a constant in each. */
static inline int choose_of_mix(struct bsdf *b, const float *share)
{
    int few = 1;

    if (BSDF_HAS_INTERFACE)
        few = share[BSDF_LOBE_INTERFACE] < 0.0f;
    if (HAS(THIN_TRANSMISSION))
        few &= share[BSDF_LOBE_THIN] < 0.0f;
    if (BSDF_HAS_BELOW && share[BSDF_LOBE_BELOW] >= 0.0f)
        return choose_by_share(b, share, BSDF_LOBE_BELOW + 1);
    for (int i = few ? BSDF_LOBE_INTERFACE : BSDF_LOBE_BELOW; i < BSDF_LOBES_MIX; i++) {
        b->lobe_pdf[i] = 0;
        b->lobe_cdf[i] = 1;
    }
    if (few)
        return choose_by_share(b, share, BSDF_LOBE_REFLECT + 1);
    return choose_by_share(b, share, BSDF_LOBES_MIX < BSDF_LOBE_THIN + 1 ? BSDF_LOBES_MIX
                                                                         : BSDF_LOBE_THIN + 1);
}

/* ---- multiple scattering ----------------------------------------------------------------------- */

/* What comes out of light that microfacets of mean reflectance f throw to each other, of which
 * `kept` leaves at every bounce: f^2 kept + f^3 kept (1 - kept) + ... (Kulla and Conty 2017). */
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

static inline struct vec3 schlick_average_color(struct vec3 f0, float f90)
{
    return schlick_mix(f0, f90, SCHLICK_MEAN);
}

/* Hemispherical mean of the metal's term. */
static inline struct vec3 metal_average(const struct bsdf *b, int full)
{
    const struct bsdf_layers *l = &b->layers;

    if (full && HAS(CONDUCTOR) && l->conductor) /* Gauss's rule for the weight 2 mu */
        return vec3_add(vec3_scale(layered_metal(b, 0.35505103f), 0.36391724f),
                        vec3_scale(layered_metal(b, 0.84494897f), 0.63608276f));
    if (full && HAS(IRIDESCENCE) && l->film > 0.0f) /* the film's part by the one-point rule */
        return clamp_color(vec3_mad(schlick_average_color(b->p.base_color, 1.0f),
                                    film_difference(b, 2.0f / 3.0f, b->p.base_color), l->film), 1);
    return schlick_average_color(b->p.base_color, 1.0f);
}

/* How the diffuse lobe is shared between what is given back and a Lambert base. */
static inline void init_graze(struct bsdf *b, float given_back, float diffuse)
{
    if (b->shape.y < GRAZE_ALPHA && given_back > 0.0f) {
        b->graze = 0.75f * given_back / (given_back + diffuse);
        b->graze_log = det_log((1.0f + b->shape.y) / b->shape.y);
    }
}

/* Prepare what is given back of the metal's and the plastic's loss; returns the share for
 * sampling it. */
static inline float init_given_back(struct bsdf *b, struct vec3 wo, float metal, float plastic,
                                    float *loss_o, int full)
{
    float mean, kept, scale;
    struct vec3 color = BSDF_INIT_BLACK, plastic_average;

    *loss_o = shape_loss(b, wo, full);
    mean = is_stretched(b, full) ? b->layers.stretched_loss.mean : b->loss.mean;
    kept = 1.0f - mean;
    b->layer_given_back = 0;
    if (plastic > 0.0f) {
        float weight = SCHLICK_MEAN;
        if (full && b->layers.exact_coat)
            weight += b->layers.exact.smooth_mean;
        plastic_average = schlick_mix(b->f0_dielectric, b->f90_dielectric, weight);
        if (full && HAS(IRIDESCENCE) && b->layers.film > 0.0f)
            plastic_average = clamp_color(
                vec3_mad(plastic_average, film_difference(b, 2.0f / 3.0f, b->layers.film_f0),
                         b->layers.film * b->p.specular), 1);
        color = vec3_scale(series_color(plastic_average, kept), plastic);
        b->layer_given_back = series(b->layer_f0 + (b->layer_f90 - b->layer_f0) * weight, kept);
    }
    if (metal > 0.0f)
        color = vec3_mad(color, series_color(metal_average(b, full), kept), metal);
    if (!(mean > LOSS_MEAN_MIN)) {
        b->given_back = BSDF_INIT_BLACK;
        return 0;
    }
    scale = *loss_o / mean;
    if (is_stretched(b, full)) /* less where the table is less sure */
        scale *= 1.0f - STRETCHED_DOUBT * (1.0f - b->shape.y / b->shape.x);
    b->given_back = vec3_scale(color, scale * INV_PI_F);
    return vec3_average(color) * *loss_o;
}

/* The same for a rough refractive interface. Reflected and transmitted shares on either side
 * are such that what passes is the same both ways (times n^2). *below is the share that goes
 * through. Returns the share above. */
static inline float init_interface_given_back(struct bsdf *b, float base, float *below, int full)
{
    float n = b->eta > 1.0f ? b->eta : 1.0f / b->eta, r = (n - 1.0f) / (n + 1.0f), average, pass;
    float near, far, loss_o, scale;
    float fade = clamp_to((r - INTERFACE_NONE) * (1.0f / (INTERFACE_ALL - INTERFACE_NONE)), 0, 1);
    int side = b->eta < 1.0f; /* wo is in the denser medium */

    b->interface_compensated = 0;
    *below = -1;
    if (!b->exact) {
        r = 1;
        fade = 1;
    } else if (b->transmit_delta) {
        return -1;
    } else {
        r = float_min(r, INTERFACE_MOST);
    }
    b->loss_near = albedo_interface_find(b->shape.y, r, side);
    b->loss_far = albedo_interface_find(b->shape.y, r, !side);
    near = b->loss_near.mean;
    far = b->loss_far.mean;
    if (!(near > LOSS_MEAN_MIN && far > LOSS_MEAN_MIN))
        return -1;
    /* Mean Fresnel reflectance from the thinner side (fit of Kulla and Conty 2017), to 0.3 %;
     * from the denser side (1 - F') = (1 - F) / n^2 exactly. */
    average = b->exact ? (n - 1.0f) / (4.08567f + 1.00071f * n) : 1.0f;
    average = average < 1.0f ? average : 1.0f;
    pass = (1.0f - average) * (side ? 1.0f / (n * n) : 1.0f) * float_min(near, far) / near;

    /* Where the Fresnel term is not the plain one, the loss is at least this share of it. */
    scale = b->normal_f0 > 0.0f ? vec3_min(b->f0_dielectric) / b->normal_f0 : 1.0f;
    scale = float_min(float_min(scale, b->p.specular), 1.0f);
    if (b->exact)
        scale = float_min(scale, (1.0f - vec3_max(b->f0_dielectric)) * b->inverse_rest_f0);
    scale *= INTERFACE_KEPT * fade;
    scale *= clamp_to((b->shape.y - INTERFACE_ALPHA_NONE) *
                      (1.0f / (INTERFACE_ALPHA_ALL - INTERFACE_ALPHA_NONE)), 0, 1);
    if (is_stretched(b, full))
        scale *= b->shape.y / b->shape.x;
    if (full && HAS(IRIDESCENCE))
        scale *= 1.0f - b->layers.film;
    if (!(scale > 0.0f))
        return -1;
    b->interface_compensated = 1;
    loss_o = scale * albedo_interface_loss_at(&b->loss_near, b->shape.y, b->cos_o);
    b->given_back_near = b->weight_interface * loss_o * (1.0f - pass) * (INV_PI_F / near);
    b->given_back_far = vec3_scale(b->tint, loss_o * pass * INV_PI_F / (far * b->eta * b->eta));
    *below = pass > 0.0f ? b->weight_interface * loss_o * pass * base : -1.0f;
    return b->weight_interface * loss_o * (1.0f - pass);
}

/* ---- layers -------------------------------------------------------------------------------------- */

static inline struct bsdf_shape shape_make(float alpha_y, float alpha_x)
{
    return (struct bsdf_shape){alpha_y, alpha_y * alpha_y, alpha_x, alpha_x * alpha_x};
}

static inline float relative_to(float n, float outside)
{
    return outside > 1.0f ? n / float_min(outside, BSDF_IOR_MAX) : n;
}

static inline void init_film(struct bsdf_layers *l, const struct bsdf_params *p)
{
    float outside = HAS(NESTED_DIELECTRIC) && p->ior_outside > 1.0f
                        ? float_min(p->ior_outside, BSDF_IOR_MAX) : 1.0f;
    float t, thickness = clamp_to(p->iridescence_thickness_nm, 0, 1e5f);

    CHARGE_SCOPE(IRIDESCENCE);
    l->film = clamp_to(p->iridescence, 0, 1);
    /* Optically thinner than its surroundings it counts as none: total reflection in a film
     * thinner than a wavelength is not what the formulas describe. */
    l->film_ior = float_max(clamp_to(p->iridescence_ior, 1, BSDF_IOR_MAX) / outside, 1.0f);
    t = float_min(thickness * (1.0f / FILM_FADE_NM), 1.0f);
    t = t * t * (3.0f - 2.0f * t);
    l->film_ior = 1.0f + (l->film_ior - 1.0f) * t;
    l->film_path = 2.0f * l->film_ior * outside * thickness;
}

static inline void init_conductor(struct bsdf *b, const struct bsdf_params *p)
{
    struct bsdf_layers *l = &b->layers;
    float outside = HAS(NESTED_DIELECTRIC) ? p->ior_outside : 1.0f;

    CHARGE_SCOPE(CONDUCTOR);
    l->conductor = 1;
    l->eta.x = relative_to(clamp_to(p->eta.x, 1e-4f, 1e4f), outside);
    l->eta.y = relative_to(clamp_to(p->eta.y, 1e-4f, 1e4f), outside);
    l->eta.z = relative_to(clamp_to(p->eta.z, 1e-4f, 1e4f), outside);
    l->k.x = relative_to(clamp_to(p->k.x, 0, 1e4f), outside);
    l->k.y = relative_to(clamp_to(p->k.y, 0, 1e4f), outside);
    l->k.z = relative_to(clamp_to(p->k.z, 0, 1e4f), outside);
    l->interreflection = clamp_to(p->base_interreflection, 0, 0.999f);
    /* Interreflection acts on what the conductor reflects, not on its factor alone. */
    b->p.base_color = clamp_color(p->base_color, 1);
    b->p.metallic = 1;
    b->p.transmission = 0;
}

static inline void init_coat(struct bsdf *b, const struct bsdf_params *p, struct vec3 wo)
{
    struct bsdf_layers *l = &b->layers;
    float n = clamp_to(p->clearcoat_ior, 1, BSDF_IOR_MAX), r, alpha;

    CHARGE_SCOPE(CLEARCOAT);
    l->coat = clamp_to(p->clearcoat, 0, 1);
    if (HAS(NESTED_DIELECTRIC))
        n = relative_to(n, p->ior_outside);
    r = (n - 1.0f) / (n + 1.0f);
    l->coat_f0 = r * r;
    l->coat_f90 = bsdf_f90_of(r * r);
    alpha = clamp_to(p->clearcoat_alpha, 0, 1);
    l->coat_smooth = alpha < BSDF_ALPHA_MIN;
    l->coat_ior = n;
    l->coat_exact = l->conductor && l->interreflection > 0.0f && n >= ALBEDO_EXACT_IOR_FIRST &&
                    n <= ALBEDO_EXACT_IOR_LAST;
    if (l->coat_exact && !l->coat_smooth)
        l->exact = albedo_exact_find(alpha, n);
    l->coat_shape = shape_make(alpha, alpha);
    if (!l->coat_smooth) {
        l->coat_row = albedo_row_find(alpha);
        l->coat_loss = albedo_loss_row_find(alpha);
    }
    l->coat_normal = vec3_normalize(p->clearcoat_normal);
    if (!(l->coat_normal.z > 0.0f))
        l->coat_normal = (struct vec3){0, 0, 1};
    l->coat_cos_o = float_min(vec3_dot(l->coat_normal, wo), 1.0f);
    l->coat_root_o = ggx_root(l->coat_shape.y2, l->coat_cos_o);
    l->coat_rest_o = coat_rest(l, l->coat_cos_o);
}

/* Mean of what the coat leaves, over the hemisphere. */
static inline float coat_rest_average(const struct bsdf_layers *l)
{
    float range = l->coat_f90 - l->coat_f0;

    if (l->coat_smooth)
        return 1.0f - l->coat * (l->coat_f0 + range * SCHLICK_MEAN);
    return 1.0f - l->coat * (l->coat_f0 * (1.0f - l->coat_loss.mean) +
                             range * l->coat_loss.schlick_mean);
}

static inline void init_sheen(struct bsdf *b, const struct bsdf_params *p)
{
    struct bsdf_layers *l = &b->layers;

    l->sheen = clamp_color(p->sheen_color, 1);
    l->sheen_most = vec3_max(l->sheen);
    if (!(l->sheen_most > 0.0f))
        return;
    CHARGE_SCOPE(SHEEN);
    l->sheen_alpha = clamp_to(p->sheen_alpha, BSDF_SHEEN_ALPHA_MIN, 1);
    sheen_fit(l->sheen_alpha, l->sheen_fit);
    l->sheen_fit_half = sheen_curve(l->sheen_fit, 0.5f);
    l->sheen_lambda_o = sheen_lambda(l->sheen_fit, l->sheen_fit_half, b->cos_o);
    l->sheen_rest_o = 1.0f - l->sheen_most * sheen_share(l, b->cos_o, &l->sheen_limit_o);
}

/* All that comes before the lobes of the base. */
static inline void init_layers(struct bsdf *b, const struct bsdf_params *p, struct vec3 wo)
{
    struct bsdf_layers *l = &b->layers;
    float stretched = HAS(ANISOTROPY) ? clamp_to(p->alpha_stretched, 0, 1) : 0.0f;

    l->stretched = l->conductor = l->slab = l->coat_smooth = 0;
    l->film = l->coat = l->sheen_most = l->interreflection = 0;
    l->diffuse_below = BSDF_INIT_BLACK;
    if (HAS(ANISOTROPY) && stretched > b->p.alpha && stretched >= BSDF_ALPHA_MIN) {
        CHARGE_SCOPE(ANISOTROPY);
        b->p.alpha = float_max(b->p.alpha, BSDF_ALPHA_MIN);
        l->stretched = stretched > b->p.alpha;
        l->stretched_loss = albedo_stretched_find(stretched, b->p.alpha);
    }
    b->shape = shape_make(b->p.alpha, HAS(ANISOTROPY) && l->stretched ? stretched : b->p.alpha);
    if (HAS(CONDUCTOR) && p->conductor)
        init_conductor(b, p);
    if (HAS(IRIDESCENCE) && p->iridescence > 0.0f)
        init_film(l, p);
    if (HAS(THIN_TRANSMISSION))
        l->slab = p->thin_slab && !p->refractive;
    l->exact_coat = p->base_interreflection > 0.0f && !p->conductor && b->p.ior >= ALBEDO_EXACT_IOR_FIRST &&
                    b->p.ior <= ALBEDO_EXACT_IOR_LAST;
    if (l->exact_coat)
        l->exact = albedo_exact_find(
            l->stretched ? albedo_stretched_layer(b->shape.x, b->shape.y) : b->p.alpha, b->p.ior);
    l->covered = !(b->p.refractive && b->p.inside);
    l->through = !b->p.refractive || b->p.inside;
    if (HAS(CLEARCOAT) && p->clearcoat > 0.0f)
        init_coat(b, p, wo);
    if (HAS(SHEEN))
        init_sheen(b, p);
}

/* ---- the base ------------------------------------------------------------------------------------- */

/* The ends of the mean reflectance of the film's plastic: it sends out no more than Schlick's
 * term between them. */
static inline void raise_layer_ends(struct bsdf *b)
{
    const struct bsdf_layers *l = &b->layers;
    float bound = film_bound(l->film_ior, l->film_f0) * b->p.specular;

    b->layer_f0 = b->layer_f0 + (bound - b->layer_f0) * l->film;
    b->layer_f90 = b->layer_f90 + (b->p.specular - b->layer_f90) * l->film;
    b->layer_f90 = float_max(b->layer_f90, b->layer_f0);
}

/* What the base's own reflection leaves of a hemisphere's light. */
static inline float layer_rest_average(const struct bsdf *b, int full)
{
    float range = b->layer_f90 - b->layer_f0, mean, more = 0, more_kept = 0;

    if (full && b->layers.exact_coat) {
        more = b->smooth ? b->layers.exact.smooth_mean : b->layers.exact.mean;
        more_kept = b->layers.exact.kept_mean;
    }
    if (b->smooth)
        return 1.0f - (b->layer_f0 + range * (SCHLICK_MEAN + more));
    if (!HAS(MULTIPLE_SCATTERING) || !b->compensated)
        return 1.0f - (b->layer_f0 + range * (b->row.average + more));
    if (is_stretched(b, full)) {
        mean = b->layers.stretched_loss.mean;
        return 1.0f - (b->layer_f0 * (1.0f - mean) + range * (b->row.average + more) +
                       mean * b->layer_given_back);
    }
    return 1.0f - (b->layer_f0 * (1.0f - b->loss.mean) +
                   range * (b->loss.schlick_mean + more_kept) +
                   b->loss.mean * b->layer_given_back);
}

/* The Lambert base, to both sides. */
static inline void init_diffuse(struct bsdf *b, const struct bsdf_params *params, float weight,
                                float rest_o, float share[BSDF_LOBES_MAX], int full)
{
    struct bsdf_layers *l = &b->layers;
    float rest_average = layer_rest_average(b, full), through = 0, above, below;
    struct vec3 below_color;

    if (!(weight > 0.0f && rest_average > 1e-4f && rest_o > 0.0f))
        return;
    if (full && HAS(DIFFUSE_TRANSMISSION))
        through = clamp_to(params->diffuse_transmission, 0, 1);
    above = below = weight * rest_o / rest_average;
    if (full && HAS(CLEARCOAT) && l->coat > 0.0f) {
        /* Under two layers the mean is that of the product of what both leave: not below the
         * product of the means, and above it by at most this. */
        float coat_average = coat_rest_average(l);
        float both = rest_average * coat_average +
                     SCHLICK_VARIANCE * b->layer_f90 * (l->coat * l->coat_f90);
        both = weight * rest_o / both;
        above = l->covered ? both : above;
        below = l->covered && l->through ? both : below;
    }
    b->diffuse = vec3_scale(b->p.base_color, above * (1.0f - through) * INV_PI_F);
    if (!vec3_is_black(b->diffuse))
        share[BSDF_LOBE_DIFFUSE] = vec3_average(b->diffuse) * PI_F * rest_average;
    if (!(full && HAS(DIFFUSE_TRANSMISSION) && through > 0.0f))
        return;
    below_color = clamp_color(params->diffuse_transmission_color, 1);
    l->diffuse_below = vec3_scale(below_color, below * through * INV_PI_F);
    if (!vec3_is_black(l->diffuse_below))
        share[BSDF_LOBE_BELOW] = vec3_average(l->diffuse_below) * PI_F * rest_average;
}

/* The refractive interface. */
static inline void init_interface(struct bsdf *b, const struct bsdf_params *params, float base,
                                  float share[BSDF_LOBES_MAX], int full)
{
    struct vec3 seen;
    float near, far, spread = b->shape.x;

    charge_set(b->smooth ? CHARGE_OF(DIELECTRIC) : CHARGE_OF(ROUGH_DIELECTRIC));
    if (b->exact)
        b->eta = b->p.inside ? 1.0f / b->p.ior : b->p.ior;
    b->transmit_delta = b->smooth || spread * fabsf(b->eta - 1.0f) < BSDF_SPREAD_MIN;
    if (is_stretched(b, full)) /* the narrow way must be resolved too */
        b->transmit_delta |= b->shape.y * fabsf(b->eta - 1.0f) < 0.1f * BSDF_SPREAD_MIN;
    b->tint = vec3_scale(b->p.base_color, b->weight_interface);
    seen = interface_color(b, b->cos_o, full);
    share[BSDF_LOBE_INTERFACE] =
        b->weight_interface * (vec3_average(seen) + (1.0f - vec3_max(seen)) * base);
    if (HAS(ROUGH_DIELECTRIC) && HAS(MULTIPLE_SCATTERING) && !b->smooth &&
        !params->single_scattering) {
        CHARGE_SCOPE(MULTIPLE_SCATTERING);
        near = init_interface_given_back(b, base, &far, full);
        if (b->interface_compensated) {
            share[BSDF_LOBE_DIFFUSE] = float_max(share[BSDF_LOBE_DIFFUSE], 0) + near;
            if (far >= 0.0f)
                share[BSDF_LOBE_BELOW] = float_max(share[BSDF_LOBE_BELOW], 0) + far;
        }
    }
}

/* The thin wall's transmission. */
static inline void init_thin(struct bsdf *b, struct vec3 wo, float weight, float base,
                             float share[BSDF_LOBES_MAX], int full)
{
    /* No blur at ior 1, all of it from 1.5 on: the roughness is scaled, not alpha. */
    float n = b->p.ior, scale, y, x;

    CHARGE(THIN_TRANSMISSION);
    if (HAS(NESTED_DIELECTRIC) && n < 1.0f && n > 0.0f)
        n = 1.0f / n;
    scale = n == 0.0f ? 1.0f : clamp_to(2.0f * n - 2.0f, 0, 1);
    scale *= scale;
    x = y = b->p.alpha * scale;
    if (is_stretched(b, full)) {
        x = b->shape.x * scale;
        y = x < BSDF_ALPHA_MIN ? y : float_max(y, BSDF_ALPHA_MIN);
    }
    b->thin_delta = x < BSDF_ALPHA_MIN;
    b->thin_shape = shape_make(y, x);
    b->thin_root_o = shape_root(b, &b->thin_shape, wo, full);
    b->tint = vec3_scale(b->p.base_color, weight);
    if (b->layer_o < 1.0f)
        share[BSDF_LOBE_THIN] = weight * base * (1.0f - b->layer_o);
}

/* Plastic, glass, thin walls and everything between; and what lies over them. */
static inline void init_mix(struct bsdf *b, const struct bsdf_params *params, struct vec3 wo,
                            int full)
{
    const struct bsdf_base *p = &b->p;
    struct bsdf_layers *l = &b->layers;
    float dielectric = 1.0f - p->metallic, glass = p->refractive ? p->transmission : 0.0f;
    float plastic = dielectric * (1.0f - glass);
    float weight_thin = p->refractive ? 0.0f : dielectric * p->transmission;
    float weight_diffuse = dielectric * (1.0f - p->transmission);
    float r = p->ior == 0.0f ? 1.0f : (p->ior - 1.0f) / (p->ior + 1.0f);
    float fade = bsdf_f90_of(r * r);
    float base = vec3_average(p->base_color), blend, rest_o, loss_o = 0, given_back = -1;
    float share[BSDF_LOBES_MAX];
    const int lobes = full ? BSDF_LOBES_MAX : BSDF_LOBES_MIX;

    for (int i = 0; i < lobes; i++)
        share[i] = -1;
    b->normal_f0 = r * r;
    b->exact = p->ior != 0.0f;
    if (full || (BSDF_HAS_INTERFACE && glass > 0.0f))
        b->inverse_rest_f0 = 1.0f / (1.0f - (b->exact ? b->normal_f0 : 0.0f));
    b->f0_dielectric = clamp_color(vec3_scale(p->specular_color, r * r), 1);
    if (full)
        l->film_f0 = b->f0_dielectric;
    b->f0_dielectric = vec3_scale(b->f0_dielectric, p->specular);
    b->layer_f0 = vec3_max(b->f0_dielectric);
    b->layer_f90 = p->specular * fade;
    b->layer_f90 = b->layer_f90 > b->layer_f0 ? b->layer_f90 : b->layer_f0;
    b->f90_dielectric = b->layer_f90;
    b->f0 = vec3_mad(vec3_scale(b->f0_dielectric, plastic), p->base_color, p->metallic);
    b->f90 = b->layer_f90 * plastic + p->metallic;
    if (full) {
        l->weight_metal = p->metallic;
        l->weight_plastic = plastic;
        if (HAS(IRIDESCENCE) && l->film > 0.0f)
            raise_layer_ends(b);
        if (HAS(CONDUCTOR) && l->conductor)
            b->f0 = vec3_mul(p->base_color,
                             (struct vec3){fresnel_conductor(1, l->eta.x, l->k.x),
                                           fresnel_conductor(1, l->eta.y, l->k.y),
                                           fresnel_conductor(1, l->eta.z, l->k.z)});
    } else {
        b->shape.y = b->shape.x = p->alpha;
        b->shape.y2 = p->alpha * p->alpha;
    }

    b->weight_interface = dielectric * glass;
    b->interface_only = BSDF_HAS_INTERFACE && b->weight_interface == 1.0f;
    b->smooth = p->alpha < BSDF_ALPHA_MIN;
    b->compensated = 0;
    b->interface_compensated = 0;
    b->graze = 0;
    if (b->f90 != 0.0f)
        charge_set(b->smooth ? CHARGE_OF(MIRROR) : CHARGE_OF(GLOSSY));
    if (!b->smooth)
        b->root_o = shape_root(b, &b->shape, wo, full);
    if (b->interface_only) {
        blend = 0;
    } else if (b->smooth) {
        blend = schlick_weight(b->cos_o);
    } else {
        b->row = albedo_row_find(
            is_stretched(b, full) ? albedo_stretched_layer(b->shape.x, b->shape.y) : p->alpha);
        blend = albedo_blend_at(&b->row, b->cos_o);
        if (HAS(MULTIPLE_SCATTERING) && !params->single_scattering) {
            CHARGE_SCOPE(MULTIPLE_SCATTERING);
            b->compensated = 1;
            b->given_back = BSDF_INIT_BLACK;
            b->loss = albedo_loss_row_find(p->alpha);
            given_back = init_given_back(b, wo, p->metallic, plastic, &loss_o, full);
        }
    }
    rest_o = b->layer_f90 == 0.0f || b->interface_only ? 1.0f
                                                       : layer_rest(b, b->cos_o, loss_o, full);
    b->layer_o = 1.0f - rest_o;

    b->diffuse = BSDF_INIT_BLACK;
    init_diffuse(b, params, weight_diffuse, rest_o, share, full);
    if (HAS(MULTIPLE_SCATTERING) && given_back > 0.0f) {
        share[BSDF_LOBE_DIFFUSE] = float_max(share[BSDF_LOBE_DIFFUSE], 0);
        init_graze(b, given_back, share[BSDF_LOBE_DIFFUSE]);
        share[BSDF_LOBE_DIFFUSE] += given_back;
    }

    share[BSDF_LOBE_REFLECT] = vec3_average(schlick_color(b, blend));
    if (full && HAS(IRIDESCENCE) && l->film > 0.0f)
        share[BSDF_LOBE_REFLECT] = vec3_average(reflect_color(b, b->cos_o, 1));
    if (b->f90 == 0.0f && vec3_is_black(b->f0) &&
        !(full && HAS(IRIDESCENCE) && l->film > 0.0f && plastic > 0.0f && p->specular > 0.0f)) {
        share[BSDF_LOBE_REFLECT] = -1;
        if (!vec3_is_black(b->diffuse))
            CHARGE(DIFFUSE);
    }

    b->transmit_delta = 1;
    b->thin_delta = 0;
    if (BSDF_HAS_INTERFACE && b->weight_interface > 0.0f)
        init_interface(b, params, base, share, full);
    if (HAS(THIN_TRANSMISSION) && weight_thin > 0.0f && base > 0.0f)
        init_thin(b, wo, weight_thin, base, share, full);
    if (full && has_cover(b, 1) && l->covered) {
        float under = 1.0f;
        if (HAS(CLEARCOAT) && l->coat > 0.0f) {
            share[BSDF_LOBE_COAT] = l->coat_cos_o > 0.0f ? 1.0f - l->coat_rest_o : -1.0f;
            if (l->coat_f90 == 0.0f && l->coat_f0 == 0.0f)
                share[BSDF_LOBE_COAT] = -1;
            under = l->coat_rest_o;
        }
        if (HAS(SHEEN) && l->sheen_most > 0.0f) {
            float limit;
            share[BSDF_LOBE_SHEEN] =
                vec3_average(l->sheen) * sheen_share(l, b->cos_o, &limit) * under;
        }
    }

    if (!(full ? choose_by_share(b, share, BSDF_LOBES_MAX) : choose_of_mix(b, share))) {
        b->kind = BSDF_KIND_BLACK;
        return;
    }
    b->has_delta = b->smooth && b->lobe_pdf[BSDF_LOBE_REFLECT] > 0.0f;
    b->has_smooth = b->lobe_pdf[BSDF_LOBE_DIFFUSE] > 0.0f ||
                    (!b->smooth && b->lobe_pdf[BSDF_LOBE_REFLECT] > 0.0f);
    if (BSDF_HAS_INTERFACE && b->lobe_pdf[BSDF_LOBE_INTERFACE] > 0.0f) {
        b->has_delta |= b->smooth || b->transmit_delta;
        b->has_smooth |= !b->smooth;
    }
    if (HAS(THIN_TRANSMISSION) && b->lobe_pdf[BSDF_LOBE_THIN] > 0.0f) {
        b->has_delta |= b->thin_delta;
        b->has_smooth |= !b->thin_delta;
    }
    if (BSDF_HAS_BELOW || full)
        b->has_smooth |= b->lobe_pdf[BSDF_LOBE_BELOW] > 0.0f;
    if (full) {
        b->has_delta |= l->coat_smooth && b->lobe_pdf[BSDF_LOBE_COAT] > 0.0f;
        b->has_smooth |= (!l->coat_smooth && b->lobe_pdf[BSDF_LOBE_COAT] > 0.0f) ||
                         b->lobe_pdf[BSDF_LOBE_SHEEN] > 0.0f;
    }
}

static inline void init_metal(struct bsdf *b, const struct bsdf_params *params, struct vec3 wo)
{
    b->shape.y = b->p.alpha;
    b->shape.y2 = b->p.alpha * b->p.alpha;
    b->root_o = ggx_root(b->shape.y2, b->cos_o);
    b->f0 = b->p.base_color;
    b->f90 = 1.0f;
    b->has_smooth = 1;
    b->compensated = 0;
    b->graze = 0;
    if (HAS(MULTIPLE_SCATTERING) && !params->single_scattering) {
        float loss_o, given_back, reflected;
        CHARGE_SCOPE(MULTIPLE_SCATTERING);
        b->compensated = 1;
        b->loss = albedo_loss_row_find(b->p.alpha);
        given_back = init_given_back(b, wo, 1, 0, &loss_o, 0);
        init_graze(b, given_back, 0);
        reflected = (1.0f - loss_o) * vec3_average(b->f0) + loss_o * 1e-3f + 1e-6f;
        b->lobe_pdf[BSDF_LOBE_DIFFUSE] = given_back / (given_back + reflected);
        b->lobe_pdf[BSDF_LOBE_REFLECT] = 1.0f - b->lobe_pdf[BSDF_LOBE_DIFFUSE];
        b->lobe_cdf[BSDF_LOBE_DIFFUSE] = b->lobe_pdf[BSDF_LOBE_DIFFUSE];
    }
}

/* Apart, or what they keep in registers would be saved for every Lambert surface. */
static __attribute__((noinline)) void init_mix_only(struct bsdf *b,
                                                    const struct bsdf_params *params,
                                                    struct vec3 wo)
{
    init_mix(b, params, wo, 0);
}
static __attribute__((noinline)) void init_layered(struct bsdf *b,
                                                   const struct bsdf_params *params,
                                                   struct vec3 wo)
{
    init_layers(b, params, wo);
    init_mix(b, params, wo, 1);
}

void bsdf_init(struct bsdf *b, const struct bsdf_params *params, struct vec3 wo)
{
    float length2 = vec3_length_squared(wo);

    clamp_base(&b->p, params);
    b->kind = BSDF_KIND_BLACK;
    b->eta = 1.0f;
    b->has_delta = b->has_smooth = 0;
    b->cos_o = clamp_to(wo.z, 0, 1);
    if (!(wo.z > 0.0f && length2 > 0.9f && length2 < 1.1f))
        return;

    if (BSDF_HAS_LAYERED && is_layered(params)) {
        b->kind = BSDF_KIND_LAYERED;
        init_layered(b, params, wo);
    } else if (b->p.metallic == 0.0f && b->p.transmission == 0.0f &&
               (b->p.specular == 0.0f || b->p.ior == 1.0f)) {
        if (vec3_is_black(b->p.base_color))
            return;
        CHARGE(DIFFUSE);
        b->kind = BSDF_KIND_LAMBERT;
        b->diffuse = vec3_scale(b->p.base_color, INV_PI_F);
        b->has_smooth = 1;
    } else if (HAS(GLOSSY) && b->p.metallic == 1.0f && b->p.alpha >= BSDF_ALPHA_MIN) {
        CHARGE(GLOSSY);
        b->kind = BSDF_KIND_METAL;
        init_metal(b, params, wo);
    } else if (BSDF_HAS_REFLECTION) {
        b->kind = BSDF_KIND_MIX;
        init_mix_only(b, params, wo);
    }
}
