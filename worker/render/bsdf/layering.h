/* layering: combines the lobes of a surface: what each of them weighs, what coat and sheen leave of
 * what lies below, how often each lobe is sampled.
 *
 * The base is glTF 2.0's, metallic m and transmission t:
 *   m * metal + (1 - m) * ((1 - t) * plastic + t * glass)
 * plastic is a reflection over a Lambertian base (layer.h), glass a refractive interface or a thin
 * wall. Above the base lies the sheen, then the coat, on the outside of a refractive object and on
 * both sides of a thin wall. Below the coat, lobes are scaled by the smaller of the shares that the
 * coat leaves along wo and wi, and the Lambertian base by the product of both over its mean. This
 * is reciprocal and never gains energy.
 */
#pragma once

#include <string.h>

#include "worker/render/bsdf/compensation.h"
#include "worker/render/bsdf/layer.h"
#include "worker/render/bsdf/lobe.h"
#include "worker/render/bsdf/lobe_coat.h"
#include "worker/render/bsdf/lobe_diffuse.h"
#include "worker/render/bsdf/lobe_diffuse_transmission.h"
#include "worker/render/bsdf/lobe_interface.h"
#include "worker/render/bsdf/lobe_reflection.h"
#include "worker/render/bsdf/lobe_sheen.h"
#include "worker/render/bsdf/lobe_thin_wall.h"

/* A lobe that can contribute is chosen at least this often. */
#define LOBE_SHARE_MIN REAL(0.02)

/* ---- what lies over the base ------------------------------------------------------------------- */

#define LAYER_EFFECT(name, prefix, side, effects, account) | (effects)
#define LAYER_EFFECTS (0 BSDF_LAYER_MAP(LAYER_EFFECT))

static inline struct cover cover_find(const struct bsdf *b, struct vec3 wi)
{
    struct cover cover = COVER_NONE;
    int near = is_covered_near(b), far = wi.z > 0.0f ? near : is_covered_far(b);

    if (!near && !far)
        return cover;
#define LAYER_COVERS(name, prefix, side, bringing, account) \
    cover.prefix = cover.lobe;                             \
    if (calls_for(b->effects, bringing)) \
        prefix##_cover(b, wi, near, far, &cover);
    BSDF_LAYER_MAP(LAYER_COVERS)
#undef LAYER_COVERS
    return cover;
}

static inline struct cover cover_between(const struct bsdf *b, struct vec3 wi)
{
    if (calls_for(b->effects, LAYER_EFFECTS))
        return cover_find(b, wi);
    return COVER_NONE;
}

/* ---- how often each lobe is sampled -------------------------------------------------------------- */

/* About what each lobe reflects along wo, at any scale. */
struct lobe_shares {
    real share[BSDF_LOBES]; /* 0 for absent lobes */
    uint32_t lobes;         /* bit BSDF_LOBE_x: it is there */
};

/* Add to a lobe, which may still be absent; a share below 0 adds nothing. */
LOBE_OFTEN void shares_add(struct lobe_shares *s, enum bsdf_lobe lobe, real share)
{
    if (share >= 0.0f) {
        s->share[lobe] += share;
        s->lobes |= 1u << lobe;
    }
}

/* `lobe` runs through the bits of `lobes`, from the lowest. */
#define EACH_LOBE(lobe, lobes)                                                             \
    for (uint32_t left = (lobes), lobe; left && (lobe = (uint32_t)__builtin_ctz(left), 1); \
         left &= left - 1)

/* Selection probabilities from the shares, none of them too small. */
LOBE_OFTEN void choose_by_share(struct bsdf *b, const struct lobe_shares *s)
{
    real total = 0, sum = 0, least;

#define LOBE_ENABLED_BIT(name, prefix, side, effects, account) \
    | (calls_for(EFFECTS_ALL, effects) ? 1u << BSDF_LOBE_##name : 0)
    b->lobes = s->lobes & (0 BSDF_LOBE_MAP(LOBE_ENABLED_BIT));
#undef LOBE_ENABLED_BIT
    memset(b->lobe_pdf, 0, sizeof b->lobe_pdf);
    EACH_LOBE(i, b->lobes)
    total += s->share[i];
    least = LOBE_SHARE_MIN * (total > REAL(1e-10) ? total : REAL(1e-10));
    EACH_LOBE(i, b->lobes)
    sum += b->lobe_pdf[i] = real_max(s->share[i], least);
    sum = 1.0f / sum;
    EACH_LOBE(i, b->lobes)
    b->lobe_pdf[i] *= sum;
}

/* Which lobes have a density, and whether any is a delta lobe. */
static inline void find_delta_lobes(struct bsdf *b)
{
    uint32_t delta = 0, interface = 1u << BSDF_LOBE_INTERFACE;
    uint32_t smooth = b->lobes;

    if (smooth & interface) /* REFLECTION evaluates what the interface reflects */
        smooth |= 1u << BSDF_LOBE_REFLECTION;
    if (b->base.smooth)
        delta |= 1u << BSDF_LOBE_REFLECTION | interface;
    if (lobe_is_present(b, BSDF_LOBE_THIN_WALL) && b->thin_wall.spread.smooth)
        delta |= 1u << BSDF_LOBE_THIN_WALL;
    if (lobe_is_present(b, BSDF_LOBE_COAT) && b->coat.micro.smooth)
        delta |= 1u << BSDF_LOBE_COAT;
    b->smooth_lobes = smooth & ~delta;
    b->has_smooth = b->smooth_lobes != 0;
    b->has_delta = (b->lobes & delta) != 0 || ((b->lobes & interface) && b->interface.transmit_delta);
}

/* ---- preparing for wo ---------------------------------------------------------------------------- */

/* Textures and vertices may have colours above 1, and no numbers. */
static inline struct vec3 color_in_range(struct vec3 color)
{
    return SAFEGUARD(COLOR_RANGE) ? clamp_color(color, 1) : color;
}

/* Beyond it F0 rounds to 1, and what is left of it is divided by 0. */
static inline real index_in_range(real n)
{
    return SAFEGUARD(INDEX_RANGE) ? clamp_to(n, 1 / BSDF_IOR_MAX, BSDF_IOR_MAX) : n;
}

static inline void material_init(struct bsdf_material *m, const struct bsdf_params *from)
{
    m->base_color = color_in_range(from->base_color);
    m->metallic = clamp_to(from->metallic, 0, 1);
    m->alpha = clamp_to(from->alpha, 0, 1);
    m->ior = from->ior == 0.0f ? 0.0f : index_in_range(from->ior);
    m->ior = relative_index(m->ior, from);
    m->specular = clamp_to(from->specular, 0, 1);
    m->specular_color = clamp_color(from->specular_color, 1e6f);
    m->transmission = clamp_to(from->transmission, 0, 1);
    m->refractive = from->refractive != 0;
    m->inside = from->inside != 0;
    if (from->base_interreflection > 0.0f) {
        real k = real_min(from->base_interreflection, REAL(0.999));
        m->base_color.x = interreflected(m->base_color.x, k);
        m->base_color.y = interreflected(m->base_color.y, k);
        m->base_color.z = interreflected(m->base_color.z, k);
    }
}

static inline uint64_t effects_called_for(const struct bsdf_params *p)
{
    uint64_t set = 0;

#define CALL(name, condition)                           \
    if (__builtin_expect(calls_for(EFFECTS_ALL, EFFECT_##name) && (condition), 0)) \
        set |= EFFECT_##name;
    BSDF_CALL_MAP(CALL)
#undef CALL
    return set;
}

/* A stretched GGX is never smooth. */
LOBE_RARE void stretched_init(struct bsdf *b, const struct bsdf_params *p)
{
    real stretched = clamp_to(p->alpha_stretched, 0, 1), alpha = b->material.alpha;

    if (!(stretched > alpha && stretched >= BSDF_ALPHA_MIN))
        return;
    if (SAFEGUARD(NARROW_AXIS)) /* the density divides by the narrow alpha, too */
        alpha = b->material.alpha = real_max(alpha, BSDF_ALPHA_MIN);
    b->base.shape = ggx_make(alpha, stretched, stretched > alpha);
    b->compensation.stretched_loss = albedo_stretched_find(stretched, alpha);
}

LOBE_OFTEN void weights_init(struct bsdf *b)
{
    const struct bsdf_material *m = &b->material;
    real dielectric = 1.0f - m->metallic, glass = m->refractive ? m->transmission : 0.0f;

    b->weights.metal = m->metallic;
    b->weights.plastic = dielectric * (1.0f - glass);
    b->weights.glass = dielectric * glass;
    b->weights.wall = m->refractive ? 0.0f : dielectric * m->transmission;
    b->weights.diffuse = dielectric * (1.0f - m->transmission);
    b->interface.only = b->weights.glass == 1.0f;
}

static inline void thin_film_init(struct bsdf *b, const struct bsdf_params *p)
{
    struct thin_film *film = &b->thin_film;
    real thickness = clamp_to(p->iridescence_thickness_nm, 0, 1e5f);
    real n = clamp_to(p->iridescence_ior, 1, BSDF_IOR_MAX);
    real t = real_min(thickness * (1.0f / FILM_FADE_NM), 1.0f);

    film->weight = clamp_to(p->iridescence, 0, 1);
    /* A film optically thinner than its surroundings counts as absent: the formulas do not describe
     * total reflection in a film thinner than a wavelength. */
    film->ior = real_max(relative_index(n, p), 1.0f);
    t = t * t * (3.0f - 2.0f * t);
    film->ior = 1.0f + (film->ior - 1.0f) * t;
    film->path_nm = 2.0f * film->ior * index_outside(p) * thickness;
}

/* Fresnel's ends of plastic, glass and metal, and of what plastic leaves for its base. */
LOBE_OFTEN void fresnel_init(struct bsdf *b)
{
    const struct bsdf_material *m = &b->material;
    struct bsdf_dielectric *d = &b->dielectric;
    struct bsdf_reflection *r = &b->reflection;
    real root = m->ior == 0.0f ? 1.0f : (m->ior - 1.0f) / (m->ior + 1.0f);

    d->exact = m->ior != 0.0f;
    d->normal_f0 = root * root;
    if (b->weights.glass > 0.0f || b->layer.exact || is_slab(b))
        d->inverse_rest_f0 = 1.0f / (1.0f - (d->exact ? d->normal_f0 : 0.0f));
    b->thin_film.f0 = clamp_color(vec3_scale(m->specular_color, d->normal_f0), 1);
    d->f0 = vec3_scale(b->thin_film.f0, m->specular);
    b->layer.f0 = vec3_max(d->f0);
    d->f90 = b->layer.f90 = real_max(m->specular * bsdf_f90_of(d->normal_f0), b->layer.f0);
    if (calls_for(b->effects, EFFECT_IRIDESCENCE))
        layer_raise_ends(b);
    r->f0 = vec3_mad(vec3_scale(d->f0, b->weights.plastic), m->base_color, m->metallic);
    r->f90 = d->f90 * b->weights.plastic + m->metallic;
    if (calls_for(b->effects, EFFECT_CONDUCTOR))
        r->f0 = vec3_mul(m->base_color, (struct vec3){fresnel_conductor(1, r->eta.x, r->k.x),
                                                      fresnel_conductor(1, r->eta.y, r->k.y),
                                                      fresnel_conductor(1, r->eta.z, r->k.z)});
}

/* What plastic and metal reflect along wo, what plastic leaves for the base, and the shares of the
 * reflection and of its compensation. */
LOBE_OFTEN void init_reflection(struct bsdf *b, const struct bsdf_params *params, struct vec3 wo, real *reflection,
                                real *compensation)
{
    real blend = 0, loss_o = 0;

    *compensation = -1;
    if (b->base.smooth) {
        blend = schlick_weight(b->cos_o);
    } else if (!b->interface.only) {
        b->layer.row = albedo_row_find(layer_alpha(b));
        blend = albedo_blend_at(&b->layer.row, b->cos_o);
        if (is_compensated(params)) {
            b->effects |= EFFECT_MULTIPLE_SCATTERING;
            b->compensation.loss = albedo_loss_row_find(b->base.shape.y);
            loss_o = compensation_loss(b, wo);
            *compensation = reflection_compensation(b, loss_o);
        }
    }
    b->layer.rest_o = b->interface.only ? 1.0f : layer_rest(b, b->cos_o, loss_o);
    b->layer.reflected_o = 1.0f - b->layer.rest_o;
    *reflection = reflection_init(b, blend);
}

/* The Lambertian base, on both sides. */
LOBE_OFTEN void init_lambert(struct bsdf *b, const struct bsdf_params *params, struct lobe_shares *shares)
{
    real rest = layer_rest_average(b);

    if (!(rest > REAL(1e-4) && b->layer.rest_o > 0.0f))
        return;
    shares_add(shares, BSDF_LOBE_DIFFUSE, diffuse_init(b, params, rest));
    if (calls_for(b->effects, EFFECT_DIFFUSE_TRANSMISSION))
        shares_add(shares, BSDF_LOBE_DIFFUSE_TRANSMISSION, diffuse_transmission_init(b, params, rest));
}

/* Metal, plastic, glass, thin walls and everything between. */
LOBE_OFTEN void init_base(struct bsdf *b, const struct bsdf_params *params, struct vec3 wo, struct lobe_shares *shares)
{
    real base = vec3_average(b->material.base_color), reflection, compensation, above, below;

    b->diffuse.color = b->diffuse_transmission.color = LOBE_BLACK;
    b->compensation.graze = 0;
    b->interface.transmit_delta = b->interface_compensation.on = 0;
    if (!b->base.smooth)
        b->base.root_o = ggx_root_of(&b->base.shape, wo);
    init_reflection(b, params, wo, &reflection, &compensation);
    if (b->weights.diffuse > 0.0f)
        init_lambert(b, params, shares);
    if (compensation > 0.0f) {
        shares_add(shares, BSDF_LOBE_DIFFUSE, 0);
        graze_init(b, compensation, shares->share[BSDF_LOBE_DIFFUSE]);
        shares_add(shares, BSDF_LOBE_DIFFUSE, compensation);
    }
    shares_add(shares, BSDF_LOBE_REFLECTION, reflection);
    if (calls_for(EFFECTS_ALL, EFFECT_DIELECTRIC | EFFECT_ROUGH_DIELECTRIC) && b->weights.glass > 0.0f) {
        real interface = interface_init(b, base);
        if (!b->base.smooth && is_compensated(params)) {
            interface *= interface_compensation_init(b, base, &above, &below);
            shares_add(shares, BSDF_LOBE_DIFFUSE, above);
            shares_add(shares, BSDF_LOBE_DIFFUSE_TRANSMISSION, below);
        }
        shares_add(shares, BSDF_LOBE_INTERFACE, interface);
    }
    if (calls_for(EFFECTS_ALL, EFFECT_THIN_TRANSMISSION) && b->weights.wall > 0.0f && base > 0.0f)
        shares_add(shares, BSDF_LOBE_THIN_WALL, thin_wall_init(b, wo, base));
}

/* What changes the base's lobes and lies over them. */
LOBE_OFTEN void init_layers(struct bsdf *b, const struct bsdf_params *params, struct vec3 wo)
{
    const real n = b->material.ior;

    b->base.shape = ggx_make(b->material.alpha, b->material.alpha, 0);
    if (calls_for(b->effects, EFFECT_ANISOTROPY))
        stretched_init(b, params);
    b->base.smooth = !ggx_is_stretched(&b->base.shape) && alpha_is_smooth(b->material.alpha);
    b->layer.exact = calls_for(b->effects, EFFECT_GLOSSY) && !calls_for(b->effects, EFFECT_CONDUCTOR) &&
                     n >= ALBEDO_EXACT_IOR_FIRST && n <= ALBEDO_EXACT_IOR_LAST;
    if (b->layer.exact)
        b->layer.exact_row = albedo_exact_find(layer_alpha(b), n);
    if (calls_for(b->effects, EFFECT_CONDUCTOR))
        conductor_init(b, params);
    if (calls_for(b->effects, EFFECT_IRIDESCENCE))
        thin_film_init(b, params);
#define LAYER_INIT(name, prefix, side, bringing, account) \
    if (calls_for(b->effects, bringing)) \
        prefix##_init(b, params, wo);
    BSDF_LAYER_MAP(LAYER_INIT)
#undef LAYER_INIT
}

/* Any surface. What the base's lobes ask for is prepared first. Compiled twice, with what it calls:
 * see init_core_lobes (bsdf.c). */
LOBE_OFTEN void layering_init(struct bsdf *b, const struct bsdf_params *params, struct vec3 wo)
{
    struct lobe_shares shares = {{0}, 0};

    init_layers(b, params, wo);
    weights_init(b);
    fresnel_init(b);
    init_base(b, params, wo, &shares);
    if (is_covered_near(b)) {
        real rest = 1.0f;
#define LAYER_SHARE(name, prefix, side, bringing, account) \
    if (calls_for(b->effects, bringing)) \
        shares_add(&shares, BSDF_LOBE_##name, prefix##_share(b, &rest));
        BSDF_LAYER_MAP(LAYER_SHARE)
#undef LAYER_SHARE
    }
    choose_by_share(b, &shares);
    find_delta_lobes(b);
    if (!b->lobes)
        b->kind = BSDF_KIND_BLACK;
}

/* A shortcut for rough metal with Schlick's term. */
static inline void metal_init(struct bsdf *b, const struct bsdf_params *params, struct vec3 wo)
{
    real loss_o, compensation, reflected;

    b->base.shape = ggx_make(b->material.alpha, b->material.alpha, 0);
    b->base.smooth = 0;
    b->base.root_o = ggx_root(b->base.shape.y2, b->cos_o);
    b->reflection.f0 = b->material.base_color;
    b->reflection.f90 = 1.0f;
    b->reflection.schlick = 1;
    b->layer.exact = 0;
    b->weights = (struct bsdf_weights){.metal = 1};
    b->interface_compensation.on = 0;
    b->diffuse.color = LOBE_BLACK;
    b->compensation.graze = 0;
    b->lobes = b->smooth_lobes = 1u << BSDF_LOBE_REFLECTION;
    b->lobe_pdf[BSDF_LOBE_REFLECTION] = 1.0f;
    b->has_smooth = 1;
    if (!is_compensated(params))
        return;
    b->effects |= EFFECT_MULTIPLE_SCATTERING;
    b->compensation.loss = albedo_loss_row_find(b->material.alpha);
    loss_o = compensation_loss(b, wo);
    compensation = reflection_compensation(b, loss_o);
    graze_init(b, compensation, 0);
    reflected = (1.0f - loss_o) * vec3_average(b->reflection.f0) + loss_o * REAL(1e-3) + REAL(1e-6);
    b->lobe_pdf[BSDF_LOBE_DIFFUSE] = compensation / (compensation + reflected);
    b->lobe_pdf[BSDF_LOBE_REFLECTION] = 1.0f - b->lobe_pdf[BSDF_LOBE_DIFFUSE];
    b->lobes = b->smooth_lobes |= 1u << BSDF_LOBE_DIFFUSE;
}
