/* bsdf_init: all that depends on the material and wo only. */
#include "common/math/elementary.h"
#include "worker/render/bsdf/bsdf.h"
#include "worker/render/bsdf/lobes.h"
#include "worker/render/bsdf/microfacet.h"

/* A lobe that can contribute is chosen at least this often. */
#define LOBE_SHARE_MIN 0.02f
/* F90 of plastic reaches its full value at this F0 (ior 1.2); see bsdf.h. */
#define FADE_F0 (1.0f / 121.0f)

static const struct vec3 INIT_BLACK = {0, 0, 0};

static void clamp_params(struct bsdf_params *p, const struct bsdf_params *from)
{
    p->base_color = clamp_color(from->base_color, 1);
    p->metallic = clamp_to(from->metallic, 0, 1);
    p->alpha = clamp_to(from->alpha, 0, 1);
    p->ior = from->ior == 0.0f ? 0.0f : clamp_to(from->ior, 1, BSDF_IOR_MAX);
    p->specular = clamp_to(from->specular, 0, 1);
    p->specular_color = clamp_color(from->specular_color, 1e6f);
    p->transmission = clamp_to(from->transmission, 0, 1);
    p->refractive = from->refractive != 0;
    p->inside = from->inside != 0;
}

static void choose_only(struct bsdf *b, enum bsdf_lobe lobe)
{
    for (int i = 0; i < BSDF_LOBES_MAX; i++) {
        b->lobe_pdf[i] = i == (int)lobe;
        b->lobe_cdf[i] = i >= (int)lobe;
    }
}

/* Selection probabilities from the lobes' shares; a negative share is an absent lobe. */
static int choose_by_share(struct bsdf *b, const float share[BSDF_LOBES_MAX])
{
    float total = 0, sum = 0, floored[BSDF_LOBES_MAX];
    int last = -1;

    for (int i = 0; i < BSDF_LOBES_MAX; i++)
        total += share[i] > 0.0f ? share[i] : 0.0f;
    if (!(total > 1e-10f))
        total = 1e-10f;
    for (int i = 0; i < BSDF_LOBES_MAX; i++) {
        floored[i] = share[i] < 0.0f ? 0.0f
                     : share[i] > LOBE_SHARE_MIN * total ? share[i] : LOBE_SHARE_MIN * total;
        sum += floored[i];
        last = share[i] < 0.0f ? last : i;
    }
    if (last < 0)
        return 0;
    sum = 1.0f / sum;
    total = 0;
    for (int i = 0; i < BSDF_LOBES_MAX; i++) {
        b->lobe_pdf[i] = floored[i] * sum;
        total += b->lobe_pdf[i];
        b->lobe_cdf[i] = i >= last ? 1.0f : total;
    }
    return 1;
}

/* Plastic, glass, thin walls and everything between. */
static void init_mix(struct bsdf *b)
{
    const struct bsdf_params *p = &b->p;
    float dielectric = 1.0f - p->metallic, glass = p->refractive ? p->transmission : 0.0f;
    float plastic = dielectric * (1.0f - glass);
    float weight_thin = p->refractive ? 0.0f : dielectric * p->transmission;
    float weight_diffuse = dielectric * (1.0f - p->transmission);
    float r = p->ior == 0.0f ? 1.0f : (p->ior - 1.0f) / (p->ior + 1.0f);
    float fade = r * r < FADE_F0 ? r * r * (1.0f / FADE_F0) : 1.0f;
    float base = vec3_average(p->base_color), blend, rest_o, rest_average;
    float share[BSDF_LOBES_MAX];
    struct vec3 seen;

    b->kind = BSDF_KIND_MIX;
    b->normal_f0 = r * r;
    b->f0_dielectric = clamp_color(vec3_scale(p->specular_color, r * r), 1);
    b->f0_dielectric = vec3_scale(b->f0_dielectric, p->specular);
    b->layer_f0 = vec3_max(b->f0_dielectric);
    b->f90_dielectric = p->specular;
    b->layer_f90 = p->specular * fade;
    b->layer_f90 = b->layer_f90 > b->layer_f0 ? b->layer_f90 : b->layer_f0;
    b->f0 = vec3_mad(vec3_scale(b->f0_dielectric, plastic), p->base_color, p->metallic);
    b->f90 = b->layer_f90 * plastic + p->metallic;

    b->smooth = p->alpha < BSDF_ALPHA_MIN;
    if (b->smooth) {
        blend = schlick_weight(b->cos_o);
        rest_average = 1.0f - (b->layer_f0 + (b->layer_f90 - b->layer_f0) * (1.0f / 21.0f));
    } else {
        b->alpha2 = p->alpha * p->alpha;
        b->root_o = ggx_root(b->alpha2, b->cos_o);
        b->row = albedo_row_find(p->alpha);
        blend = albedo_blend_at(&b->row, b->cos_o);
        rest_average = 1.0f - (b->layer_f0 + (b->layer_f90 - b->layer_f0) * b->row.average);
    }
    rest_o = layer_rest_of(b, blend);
    b->layer_o = 1.0f - rest_o;

    share[BSDF_LOBE_DIFFUSE] = -1;
    b->diffuse = INIT_BLACK;
    if (weight_diffuse > 0.0f && base > 0.0f && rest_average > 1e-4f) {
        b->diffuse = vec3_scale(p->base_color, weight_diffuse * rest_o / rest_average * INV_PI_F);
        share[BSDF_LOBE_DIFFUSE] = rest_o > 0.0f ? base * weight_diffuse * rest_o : -1.0f;
    }

    seen = schlick_color(b, blend);
    share[BSDF_LOBE_REFLECT] = vec3_average(seen);
    if (b->f90 == 0.0f && vec3_is_black(b->f0))
        share[BSDF_LOBE_REFLECT] = -1;

    share[BSDF_LOBE_INTERFACE] = -1;
    b->weight_interface = dielectric * glass;
    b->eta = 1.0f;
    b->transmit_delta = 1;
    if (b->weight_interface > 0.0f) {
        b->exact = p->ior != 0.0f;
        if (b->exact)
            b->eta = p->inside ? 1.0f / p->ior : p->ior;
        b->inverse_rest_f0 = 1.0f / (1.0f - (b->exact ? b->normal_f0 : 0.0f));
        b->transmit_delta = b->smooth || p->alpha * fabsf(b->eta - 1.0f) < BSDF_SPREAD_MIN;
        b->tint = vec3_scale(p->base_color, b->weight_interface);
        seen = interface_color(b, b->cos_o);
        share[BSDF_LOBE_INTERFACE] =
            b->weight_interface * (vec3_average(seen) + (1.0f - vec3_max(seen)) * base);
    }

    share[BSDF_LOBE_THIN] = -1;
    b->thin_delta = 0;
    if (weight_thin > 0.0f && base > 0.0f) {
        /* No blur at ior 1, all of it from 1.5 on: the roughness is scaled, not alpha. */
        float scale = p->ior == 0.0f ? 1.0f : clamp_to(2.0f * p->ior - 2.0f, 0, 1);
        b->thin_alpha = p->alpha * (scale * scale);
        b->thin_alpha2 = b->thin_alpha * b->thin_alpha;
        b->thin_root_o = ggx_root(b->thin_alpha2, b->cos_o);
        b->thin_delta = b->thin_alpha < BSDF_ALPHA_MIN;
        b->tint = vec3_scale(p->base_color, weight_thin);
        if (b->layer_o < 1.0f)
            share[BSDF_LOBE_THIN] = weight_thin * base * (1.0f - b->layer_o);
    }

    if (!choose_by_share(b, share)) {
        b->kind = BSDF_KIND_BLACK;
        b->has_delta = b->has_smooth = 0;
        return;
    }
    b->has_delta = (b->smooth && (b->lobe_pdf[BSDF_LOBE_REFLECT] > 0.0f ||
                                  b->lobe_pdf[BSDF_LOBE_INTERFACE] > 0.0f)) ||
                   (b->transmit_delta && b->lobe_pdf[BSDF_LOBE_INTERFACE] > 0.0f) ||
                   (b->thin_delta && b->lobe_pdf[BSDF_LOBE_THIN] > 0.0f);
    b->has_smooth = b->lobe_pdf[BSDF_LOBE_DIFFUSE] > 0.0f ||
                    (!b->smooth && (b->lobe_pdf[BSDF_LOBE_REFLECT] > 0.0f ||
                                    b->lobe_pdf[BSDF_LOBE_INTERFACE] > 0.0f)) ||
                    (!b->thin_delta && b->lobe_pdf[BSDF_LOBE_THIN] > 0.0f);
}

void bsdf_init(struct bsdf *b, const struct bsdf_params *params, struct vec3 wo)
{
    float length2 = vec3_length_squared(wo);

    clamp_params(&b->p, params);
    b->kind = BSDF_KIND_BLACK;
    b->eta = 1.0f;
    b->has_delta = b->has_smooth = 0;
    b->f0_dielectric = INIT_BLACK;
    b->cos_o = clamp_to(wo.z, 0, 1);
    choose_only(b, BSDF_LOBE_DIFFUSE);
    if (!(wo.z > 0.0f && length2 > 0.9f && length2 < 1.1f))
        return;

    if (b->p.metallic == 0.0f && b->p.transmission == 0.0f &&
        (b->p.specular == 0.0f || b->p.ior == 1.0f)) {
        if (vec3_is_black(b->p.base_color))
            return;
        b->kind = BSDF_KIND_LAMBERT;
        b->diffuse = vec3_scale(b->p.base_color, INV_PI_F);
        b->has_smooth = 1;
    } else if (b->p.metallic == 1.0f && b->p.alpha >= BSDF_ALPHA_MIN) {
        b->kind = BSDF_KIND_METAL;
        b->smooth = 0;
        b->alpha2 = b->p.alpha * b->p.alpha;
        b->root_o = ggx_root(b->alpha2, b->cos_o);
        b->f0 = b->p.base_color;
        b->f90 = 1.0f;
        b->has_smooth = 1;
        choose_only(b, BSDF_LOBE_REFLECT);
    } else {
        init_mix(b);
    }
}
