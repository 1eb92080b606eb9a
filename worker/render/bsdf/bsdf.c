/* bsdf: the loops over the table of lobes, and shortcuts for the simplest surfaces. */
#include "worker/render/bsdf/bsdf.h"

#include "worker/render/bsdf/layering.h"
#include "worker/render/base/health_scope.h"
#include "worker/render/base/profile_scope.h"

/* Expansions of a row of the table. */
#define ACCOUNT(condition, then, otherwise) \
    ((condition) ? PROFILE_ACCOUNT(then) : PROFILE_ACCOUNT(otherwise))
#define LOBE_BIT(name) (1u << BSDF_LOBE_##name)
#define LOBE_IS_BASE(name) (BSDF_LOBE_##name <= BSDF_LOBE_THIN_WALL)
#define LOBE_BIT_ON(name, prefix, side, effects, account) \
    | (calls_for(EFFECTS_ALL, effects) && LOBE_SIDE_##side == wanted ? LOBE_BIT(name) : 0)

/* Can this kernel variant render more than Lambertian surfaces? */
#define EFFECT_OR(name, condition) | EFFECT_##name
#define HAS_LOBES calls_for(EFFECTS_ALL, EFFECT_MIRROR BSDF_CALL_MAP(EFFECT_OR))

real fresnel_dielectric(real cos_i, real eta) { return fresnel_exact(cos_i, eta); }

static inline int is_finite_sum(struct vec3 f, real pdf)
{
    return f.x + f.y + f.z + pdf < INFINITY; /* nothing negative here; NaN compares false */
}

/* ---- preparing ----------------------------------------------------------------------------------- */

/* The account charged for evaluating the base: that of the last of its lobes. */
static inline uint8_t base_account(const struct bsdf *b)
{
    const uint32_t base = b->lobes & (2 * LOBE_BIT(THIN_WALL) - 1);

#define LOBE_ACCOUNT(name, prefix, side, effects, account)                            \
    if (calls_for(EFFECTS_ALL, effects) && LOBE_IS_BASE(name) && base >> BSDF_LOBE_##name == 1) \
        return account;
    BSDF_LOBE_MAP(LOBE_ACCOUNT)
#undef LOBE_ACCOUNT
    return PROFILE_NO_EFFECT;
}

/* Not inlined: otherwise every Lambertian surface would save the registers that these need. */
static __attribute__((noinline)) void init_lobes(struct bsdf *b, const struct bsdf_params *params, struct vec3 wo)
{
    layering_init(b, params, wo);
    b->account = base_account(b);
}

/* The same of glTF's core material. The compiler knows here that no effect acts on it, and leaves
 * out what any would change. */
static __attribute__((noinline)) void init_core_lobes(struct bsdf *b, const struct bsdf_params *params, struct vec3 wo)
{
    b->effects = 0;
    layering_init(b, params, wo);
    b->account = base_account(b);
}

void bsdf_init(struct bsdf *b, const struct bsdf_params *params, struct vec3 wo)
{
    const struct bsdf_material *m = &b->material;
    real length2 = vec3_length_squared(wo);

    PROFILE_STAGE(SCATTER);
    material_init(&b->material, params);
    b->effects = effects_called_for(params);
    b->kind = BSDF_KIND_BLACK;
    b->eta = 1.0f;
    b->has_delta = b->has_smooth = 0;
    b->account = PROFILE_NO_EFFECT;
    b->cos_o = clamp_to(wo.z, 0, 1);
    if (!(wo.z > 0.0f && length2 > REAL(0.9) && length2 < REAL(1.1)))
        return; /* it then scatters nothing, and who asked looks at the basis */
    if (b->effects) {
        b->kind = BSDF_KIND_LOBES;
        init_lobes(b, params, wo);
    } else if (m->metallic == 0.0f && m->transmission == 0.0f &&
               (m->specular == 0.0f || m->ior == 1.0f)) {
        if (vec3_is_black(m->base_color))
            return;
        b->account = PROFILE_ACCOUNT(DIFFUSE);
        b->kind = BSDF_KIND_LAMBERT;
        b->diffuse.color = vec3_scale(m->base_color, REAL_INV_PI);
        b->has_smooth = 1;
    } else if (HAS_LOBES && m->metallic == 1.0f && !alpha_is_smooth(m->alpha)) {
        b->account = PROFILE_ACCOUNT(GLOSSY);
        b->kind = BSDF_KIND_METAL;
        metal_init(b, params, wo);
    } else if (HAS_LOBES) {
        b->kind = BSDF_KIND_LOBES;
        init_core_lobes(b, params, wo);
    }
}

/* ---- values and densities ------------------------------------------------------------------------ */

/* The rows that scatter to this side. */
static inline uint32_t lobes_of_side(enum lobe_side wanted) { return 0 BSDF_LOBE_MAP(LOBE_BIT_ON); }

static inline struct vec3 lobes_evaluate(const struct bsdf *b, struct vec3 wo, struct vec3 wi, real *pdf)
{
    uint32_t lobes = b->smooth_lobes;
    struct vec3 f = LOBE_BLACK;
    struct cover cover;
    real density;
    PROFILE_EFFECT_ACCOUNT(b->account);

    *pdf = 0;
    if (!(wi.z > 0.0f || wi.z < 0.0f))
        return LOBE_BLACK;
    lobes &= wi.z > 0.0f ? lobes_of_side(LOBE_SIDE_ABOVE) : lobes_of_side(LOBE_SIDE_BELOW);
    cover = cover_between(b, wi);
#define LOBE_EVALUATE(name, prefix, side, effects, account)              \
    if (calls_for(EFFECTS_ALL, effects) && lobes & LOBE_BIT(name)) {     \
        if (!LOBE_IS_BASE(name))                                         \
            profile_account(account);                                         \
        f = vec3_add(f, prefix##_evaluate(b, wo, wi, &cover, &density)); \
        *pdf += density;                                                 \
    }
    BSDF_LOBE_MAP(LOBE_EVALUATE)
#undef LOBE_EVALUATE
    if (!(*pdf > 0.0f && is_finite_sum(f, *pdf))) {
        if (*pdf != 0.0f)
            health_value(f, *pdf);
        return *pdf = 0, LOBE_BLACK;
    }
    return f;
}

struct vec3 bsdf_eval_pdf(const struct bsdf *b, struct vec3 wo, struct vec3 wi, real *pdf)
{
    PROFILE_STAGE(SCATTER);
    *pdf = 0;
    if (!b->has_smooth)
        return LOBE_BLACK;
    if (b->kind == BSDF_KIND_LAMBERT) {
        if (!(wi.z > 0.0f))
            return LOBE_BLACK;
        *pdf = wi.z * REAL_INV_PI;
        return vec3_scale(b->diffuse.color, wi.z);
    }
    if (!HAS_LOBES)
        return LOBE_BLACK;
    return lobes_evaluate(b, wo, wi, pdf);
}

struct vec3 bsdf_eval(const struct bsdf *b, struct vec3 wo, struct vec3 wi)
{
    real pdf;
    return bsdf_eval_pdf(b, wo, wi, &pdf);
}

real bsdf_pdf(const struct bsdf *b, struct vec3 wo, struct vec3 wi)
{
    real pdf;
    bsdf_eval_pdf(b, wo, wi, &pdf);
    return pdf;
}

/* ---- sampling ------------------------------------------------------------------------------------ */

static inline int is_usable(struct vec3 weight)
{
    return !SAFEGUARD(USABLE_SAMPLE) || (is_finite_sum(weight, 0) && vec3_max(weight) > 0.0f) ||
           health_throughput(weight);
}

/* Can a sample be weighed by its density? Where floats cannot resolve a microfacet it has none. */
static inline int has_density(real pdf) { return !SAFEGUARD(USABLE_SAMPLE) || pdf > 0.0f; }

/* The lobe that u_lobe selects samples; the rest of the number is as good as a new one. */
static inline enum lobe_result lobes_sample(const struct bsdf *b, struct vec3 wo, real u_lobe, real u, real v,
                                            struct bsdf_sample *out)
{
    real before = 0, after = 0;

#define LOBE_SAMPLE(name, prefix, side, effects, account)                                    \
    if (calls_for(EFFECTS_ALL, effects) && b->lobes & LOBE_BIT(name)) {                      \
        before = after;                                                                      \
        after += b->lobe_pdf[BSDF_LOBE_##name];                                              \
        if (u_lobe < after || b->lobes < 2 * LOBE_BIT(name)) { /* or it is the last */       \
            real w = (u_lobe - before) / b->lobe_pdf[BSDF_LOBE_##name];                     \
            enum lobe_result result;                                                         \
            out->lobe = BSDF_LOBE_##name;                                                    \
            profile_account(account);                                                             \
            result = prefix##_sample(b, wo, clamp_to(w, 0, REAL_BELOW_ONE), u, v, out);   \
            /* Nothing lies above a coat's own mirror.  */                                  \
            if (result == LOBE_DELTA && BSDF_LOBE_##name != BSDF_LOBE_COAT)                  \
                out->weight = vec3_scale(out->weight, cover_between(b, out->wi).lobe);       \
            return result;                                                                   \
        }                                                                                    \
    }
    BSDF_LOBE_MAP(LOBE_SAMPLE)
#undef LOBE_SAMPLE
    return LOBE_NOTHING;
}

/* Rough metal without compensation: the density cancels. */
static inline int metal_sample(const struct bsdf *b, struct vec3 wo, real u, real v, struct bsdf_sample *out)
{
    real cos_h, shadowing;

    out->lobe = BSDF_LOBE_REFLECTION;
    out->wi = reflect_about(wo, ggx_sample_visible(wo, b->base.shape.y, b->base.shape.y, u, v));
    if (!(out->wi.z > 0.0f))
        return health_direction(out->wi);
    out->pdf = reflection_density(&b->base, wo, b->cos_o, out->wi, &cos_h, &shadowing);
    if (!(out->pdf > 0.0f && out->pdf < INFINITY))
        return health_density(out->pdf);
    out->weight = vec3_scale(reflection_fresnel(b, cos_h), shadowing);
    return is_usable(out->weight);
}

static inline int sample_mixture(const struct bsdf *b, struct vec3 wo, real u_lobe, real u, real v,
                                 struct bsdf_sample *out)
{
    struct vec3 f;

    if (b->kind == BSDF_KIND_METAL && !calls_for(b->effects, EFFECT_MULTIPLE_SCATTERING))
        return metal_sample(b, wo, u, v, out);
    switch (lobes_sample(b, wo, u_lobe, u, v, out)) {
    case LOBE_NOTHING: return 0;
    case LOBE_DELTA: out->flags |= BSDF_DELTA; return is_usable(out->weight);
    case LOBE_SMOOTH: break;
    }
    /* Evaluate this wi exactly as next-event estimation would, bit for bit, so that the weights of
     * multiple importance sampling add up to 1. */
    f = lobes_evaluate(b, wo, out->wi, &out->pdf);
    if (!has_density(out->pdf))
        return 0;
    out->weight = vec3_scale(f, 1.0f / out->pdf);
    return is_usable(out->weight);
}

int bsdf_sample(const struct bsdf *b, struct vec3 wo, real u_lobe, real u, real v, struct bsdf_sample *out)
{
    out->wi = out->weight = LOBE_BLACK;
    out->pdf = 0;
    out->flags = 0;
    out->lobe = BSDF_LOBES;
    out->eta_scale = 1.0f;
    PROFILE_STAGE(SCATTER);
    profile_account(b->account);
    if (b->kind == BSDF_KIND_LAMBERT) {
        out->lobe = BSDF_LOBE_DIFFUSE;
        out->wi = cosine_hemisphere(u, v);
        out->pdf = out->wi.z * REAL_INV_PI;
        out->weight = b->material.base_color;
        return 1;
    }
    if (!HAS_LOBES || b->kind == BSDF_KIND_BLACK)
        return 0;
    return sample_mixture(b, wo, u_lobe, u, v, out);
}

/* ---- delta lobes in a given direction -------------------------------------------------------------- */

static int delta_reflection(const struct bsdf *b, struct vec3 wo, struct vec3 *wi, struct vec3 *weight)
{
    const struct bsdf_coat *coat = &b->coat;
    real chosen;

    *wi = (struct vec3){-wo.x, -wo.y, wo.z};
    *weight = LOBE_BLACK;
    if (b->base.smooth && b->lobes & (LOBE_BIT(REFLECTION) | LOBE_BIT(INTERFACE)))
        *weight = vec3_scale(reflection_color(b, b->cos_o, &chosen), cover_between(b, *wi).lobe);
    if (calls_for(EFFECTS_ALL, EFFECT_CLEARCOAT) && lobe_is_present(b, BSDF_LOBE_COAT) && coat->micro.smooth &&
        coat->normal.z == 1.0f)
        *weight = vec3_add(*weight, vec3_splat(coat->weight * coat_fresnel(coat, coat->cos_o)));
    return !vec3_is_black(*weight);
}

static int delta_refraction(const struct bsdf *b, struct vec3 wo, struct vec3 *wi, struct vec3 *weight)
{
    struct vec3 f;

    if (!calls_for(EFFECTS_ALL, EFFECT_DIELECTRIC | EFFECT_ROUGH_DIELECTRIC) ||
        !lobe_is_present(b, BSDF_LOBE_INTERFACE) || !b->base.smooth)
        return 0;
    f = interface_fresnel(b, b->cos_o);
    if (!refract_about(wo, (struct vec3){0, 0, 1}, b->cos_o, b->eta, wi) || !(wi->z < 0.0f))
        return 0;
    *weight = vec3_scale(b->interface.tint, (1.0f - vec3_max(f)) / (b->eta * b->eta) * cover_between(b, *wi).lobe);
    return !vec3_is_black(*weight);
}

int bsdf_delta(const struct bsdf *b, struct vec3 wo, int transmits, struct vec3 *wi, struct vec3 *weight)
{
    PROFILE_STAGE(SCATTER);
    if (!HAS_LOBES || b->kind != BSDF_KIND_LOBES)
        return 0;
    return transmits ? delta_refraction(b, wo, wi, weight) : delta_reflection(b, wo, wi, weight);
}
