/* Materials: what a Material directive means, and the rows that shapes with it use. */
#include <math.h>
#include <string.h>

#include "client/import/pbrt.h"
#include "common/base/memory.h"
#include "common/math/elementary.h"

/* A row that was made: a material as one kind of shape asks for it. */
struct pbrt_variant {
    struct pbrt_variant *next;
    const struct pbrt_material *material;
    const struct pbrt_area_light *light;
    const struct pbrt_texture *alpha;
    double area;
    int32_t medium;
    int one_sided;
    uint32_t row;
};

/* ---- roughness ---------------------------------------------------------------------------- */

/* pbrt-v4 maps roughness to the square root, GGX alpha; pbrt-v3 used a polynomial in its
 * logarithm (its microfacet.h); with "remaproughness" false it is alpha already. Ours is the
 * square root of alpha. */
enum remap { REMAP_NONE, REMAP_V4, REMAP_V3 };

static double alpha_of(double roughness, enum remap remap)
{
    double x;

    if (!(roughness > 0))
        return 0;
    if (remap == REMAP_V4)
        return sqrt(roughness);
    if (remap == REMAP_NONE)
        return roughness;
    x = det_log_d(roughness > 1e-3 ? roughness : 1e-3);
    return 1.62142 + x * (0.819955 + x * (0.1734 + x * (0.0171201 + x * 0.000640711)));
}

static double perceptual(double roughness, double remap)
{
    double alpha = alpha_of(roughness, (enum remap)(int)remap);

    return sqrt(alpha > 0 ? alpha < 1 ? alpha : 1 : 0);
}

struct roughness {
    const struct pbrt_texture *u, *v;
    enum remap remap;
};

static status read_roughness(struct pbrt *p, struct pbrt_material *m, const char *prefix,
                             double otherwise, int version3, struct roughness *out)
{
    const struct pbrt_texture *both;
    char name[3][64];

    snprintf(name[0], sizeof name[0], "%sroughness", prefix);
    snprintf(name[1], sizeof name[1], "%suroughness", prefix);
    snprintf(name[2], sizeof name[2], "%svroughness", prefix);
    TRY(pbrt_float_texture(p, m->params, name[0], &both));
    TRY(pbrt_float_texture(p, m->params, name[1], &out->u));
    TRY(pbrt_float_texture(p, m->params, name[2], &out->v));
    if (!both)
        both = pbrt_constant(p, otherwise, otherwise, otherwise);
    if (!both)
        return error_no_memory(p->err, "a material");
    out->u = out->u ? out->u : both;
    out->v = out->v ? out->v : both;
    out->remap = !pbrt_bool(m->params, "remaproughness", 1) ? REMAP_NONE
                 : version3                                 ? REMAP_V3
                                                            : REMAP_V4;
    return STATUS_OK;
}

static int same_constant(const struct pbrt_texture *a, const struct pbrt_texture *b)
{
    return a == b || (a->op == TEXTURE_CONSTANT && b->op == TEXTURE_CONSTANT &&
                      a->value[0] == b->value[0]);
}

static double unit_alpha(const struct pbrt_texture *t, enum remap remap)
{
    double a = alpha_of(t->value[0], remap);

    return a > 0 ? a < 1 ? a : 1 : 0;
}

/* The surface's own roughness, with its anisotropy. */
static status put_roughness(struct pbrt *p, struct pbrt_material *m, const struct roughness *r)
{
    double u, v, low, high;

    if (!same_constant(r->u, r->v) &&
        (r->u->op != TEXTURE_CONSTANT || r->v->op != TEXTURE_CONSTANT))
        pbrt_warn(p, &m->at, "roughness by two textures",
                  "material \"%.60s\": two roughnesses are supported as numbers only: that along u "
                  "counts",
                  m->name);
    else if (!same_constant(r->u, r->v)) {
        u = unit_alpha(r->u, r->remap);
        v = unit_alpha(r->v, r->remap);
        low = fmin(u, v);
        high = fmax(u, v);
        /* alpha along the direction becomes mix(alpha, 1, strength^2). */
        m->base.roughness = (float)sqrt(low);
        m->base.anisotropy = low < 1 ? (float)sqrt((high - low) / (1 - low)) : 0;
        m->base.anisotropy_rotation_rad = u >= v ? 0 : PI_F / 2;
        m->wants_tangents = 1;
        return STATUS_OK;
    }
    return pbrt_scalar_slot(p, r->u, perceptual, (double)r->remap, &m->base.roughness,
                            &m->base.metallic_roughness_texture);
}

/* The coat's: no anisotropy there. */
static status put_coat_roughness(struct pbrt *p, struct pbrt_material *m,
                                 const struct roughness *r)
{
    if (!same_constant(r->u, r->v))
        pbrt_warn(p, &m->at, "anisotropic coat",
                  "material \"%.60s\": a coat has one roughness: that along u counts", m->name);
    return pbrt_scalar_slot(p, r->u, perceptual, (double)r->remap, &m->base.clearcoat_roughness,
                            &m->base.clearcoat_roughness_texture);
}

/* ---- indices of refraction ---------------------------------------------------------------- */

static status read_index(struct pbrt *p, struct pbrt_material *m, const char *name,
                         double otherwise, double *index, double *abbe)
{
    const struct pbrt_param *param = pbrt_param(m->params, name, PBRT_NUMBERS | PBRT_COLORS);

    *index = otherwise;
    *abbe = 0;
    if (!param)
        return STATUS_OK;
    if (param->type == PBRT_SPECTRUM) {
        struct spectrum s;
        int given;
        if (param->string_count && spectrum_named_glass(param->strings[0], index, abbe))
            return STATUS_OK;
        TRY(pbrt_spectrum(p, param, &s, &given));
        spectrum_glass(&s, index, abbe);
    } else if (param->type == PBRT_RGB) {
        *index = (param->numbers[0] + param->numbers[1] + param->numbers[2]) / 3;
    } else {
        *index = param->numbers[0];
    }
    if (!(*index >= 1 && *index <= 1e3)) {
        pbrt_warn(p, &param->at, "index of refraction",
                  "material \"%.60s\": an index of refraction of %g is not supported (1 to 1000): "
                  "%g is used",
                  m->name, *index, *index < 1 ? 1.0 : otherwise);
        *index = *index < 1 ? 1 : otherwise;
        *abbe = 0;
    }
    return STATUS_OK;
}

/* Fresnel's equations for unpolarised light. */
static double fresnel(double cosine, double eta)
{
    double sine2 = (1 - cosine * cosine) / (eta * eta), inner, parallel, across;

    if (sine2 >= 1)
        return 1;
    inner = sqrt(1 - sine2);
    parallel = (eta * cosine - inner) / (eta * cosine + inner);
    across = (cosine - eta * inner) / (cosine + eta * inner);
    return (parallel * parallel + across * across) / 2;
}

/* What a smooth surface throws back of diffuse light that comes from inside it:
 * 1 - (1 - F) / eta^2 with F the diffuse reflectance from outside (Egan & Hilgeman 1973). */
static double inner_reflectance(double eta)
{
    enum { STEPS = 1024 };
    double sum = 0;

    if (!(eta > 1))
        return 0;
    for (int i = 0; i < STEPS; i++) {
        double c = (i + 0.5) / STEPS;
        sum += 2 * c * fresnel(c, eta) / STEPS;
    }
    return 1 - (1 - sum) / (eta * eta);
}

/* The complex index of a metal. `prefix` is "conductor." below a coat. */
static status read_metal(struct pbrt *p, struct pbrt_material *m, const char *prefix,
                         double eta[3], double k[3])
{
    const struct spectrum *const copper[2] = {spectrum_named("metal-Cu-eta"),
                                              spectrum_named("metal-Cu-k")};
    const struct pbrt_param *param[2];
    struct spectrum s[2];
    int given[2];
    char name[64];

    for (int i = 0; i < 2; i++) {
        snprintf(name, sizeof name, "%s%s", prefix, i ? "k" : "eta");
        param[i] = pbrt_param(m->params, name, PBRT_NUMBERS | PBRT_COLORS);
        TRY(pbrt_spectrum(p, param[i], &s[i], &given[i]));
    }
    if ((given[0] || !param[0]) && (given[1] || !param[1])) {
        spectrum_conductor(given[0] ? &s[0] : copper[0], given[1] ? &s[1] : copper[1], eta, k);
    } else {
        for (int i = 0; i < 2; i++) {
            double *to = i ? k : eta;
            if (!param[i])
                spectrum_reflectance(copper[i], to);
            else if (param[i]->type == PBRT_FLOAT || param[i]->type == PBRT_INTEGER)
                to[0] = to[1] = to[2] = param[i]->numbers[0];
            else
                TRY(pbrt_color_of(p, param[i], m->params->color_space, USE_UNBOUNDED, to));
        }
    }
    for (int i = 0; i < 3; i++) {
        eta[i] = eta[i] > 1e-3 ? eta[i] < 1e3 ? eta[i] : 1e3 : 1e-3;
        k[i] = k[i] > 0 ? k[i] < 1e4 ? k[i] : 1e4 : 0;
    }
    return STATUS_OK;
}

/* A metal of a given reflectance r at normal incidence: eta 1 and this k, as in pbrt. */
static double k_of_reflectance(double r)
{
    r = r > 0 ? r < 0.9999 ? r : 0.9999 : 0;
    return 2 * sqrt(r) / sqrt(1 - r);
}

/* ---- kinds -------------------------------------------------------------------------------- */

static status color_or(struct pbrt *p, struct pbrt_material *m, const char *name, double otherwise,
                       const struct pbrt_texture **out)
{
    TRY(pbrt_color_texture(p, m->params, name, USE_REFLECTANCE, out));
    if (!*out)
        *out = pbrt_constant(p, otherwise, otherwise, otherwise);
    return *out ? STATUS_OK : error_no_memory(p->err, "a material");
}

static void be_matte(struct pbrt_material *m)
{
    m->base.metallic = 0;
    m->base.specular = 0;
    m->base.roughness = 1;
}

static status read_diffuse(struct pbrt *p, struct pbrt_material *m)
{
    be_matte(m);
    return color_or(p, m, "reflectance", 0.5, &m->color);
}

static status read_matte(struct pbrt *p, struct pbrt_material *m)
{
    const struct pbrt_texture *sigma;

    be_matte(m);
    TRY(pbrt_float_texture(p, m->params, "sigma", &sigma));
    if (sigma && (sigma->op != TEXTURE_CONSTANT || sigma->value[0] != 0))
        pbrt_warn(p, &m->at, "matte sigma",
                  "material \"%.60s\": Oren and Nayar's \"sigma\" is not supported: perfectly "
                  "matte",
                  m->name);
    return color_or(p, m, "Kd", 0.5, &m->color);
}

/* What pbrt's layered materials say about the space between coat and base. */
static status read_layers(struct pbrt *p, struct pbrt_material *m)
{
    static const char *const walk[] = {"maxdepth", "nsamples", "g", "thickness", NULL};
    const struct pbrt_texture *albedo;

    pbrt_ignore(m->params, walk);
    TRY(pbrt_color_texture(p, m->params, "albedo", USE_REFLECTANCE, &albedo));
    if (albedo && (albedo->op != TEXTURE_CONSTANT || albedo->value[0] != 0 ||
                   albedo->value[1] != 0 || albedo->value[2] != 0))
        pbrt_warn(p, &m->at, "layer albedo",
                  "material \"%.60s\": a medium between coat and base (\"albedo\") is not "
                  "supported: clear",
                  m->name);
    return STATUS_OK;
}

static status read_coated_diffuse(struct pbrt *p, struct pbrt_material *m)
{
    struct roughness rough;
    double index, abbe;

    m->base.metallic = 0;
    TRY(color_or(p, m, "reflectance", 0.5, &m->color));
    TRY(read_roughness(p, m, "", 0, 0, &rough));
    TRY(read_index(p, m, "eta", 1.5, &index, &abbe));
    m->base.ior = (float)index;
    m->base.base_interreflection = (float)fmin(inner_reflectance(index), 0.999);
    TRY(read_layers(p, m));
    return put_roughness(p, m, &rough);
}

static status read_conductor(struct pbrt *p, struct pbrt_material *m, const char *prefix,
                             double relative_to)
{
    const struct pbrt_texture *reflectance;
    double eta[3], k[3];

    m->base.metallic = 1;
    TRY(pbrt_color_texture(p, m->params, "reflectance", USE_REFLECTANCE, &reflectance));
    if (reflectance && reflectance->op != TEXTURE_CONSTANT) {
        m->color = reflectance; /* glTF's metal: Schlick's curve from that colour */
        return STATUS_OK;
    }
    m->base.kind = MATERIAL_CONDUCTOR;
    if (reflectance)
        for (int i = 0; i < 3; i++) {
            eta[i] = 1;
            k[i] = k_of_reflectance(reflectance->value[i]);
        }
    else
        TRY(read_metal(p, m, prefix, eta, k));
    for (int i = 0; i < 3; i++) {
        m->base.conductor_eta[i] = (float)(eta[i] / relative_to);
        m->base.conductor_k[i] = (float)(k[i] / relative_to);
    }
    return STATUS_OK;
}

static status read_plain_conductor(struct pbrt *p, struct pbrt_material *m)
{
    struct roughness rough;

    TRY(read_conductor(p, m, "", 1));
    TRY(read_roughness(p, m, "", 0, 0, &rough));
    return put_roughness(p, m, &rough);
}

static status read_coated_conductor(struct pbrt *p, struct pbrt_material *m)
{
    struct roughness coat, metal;
    double index, abbe;

    TRY(read_index(p, m, "interface.eta", 1.5, &index, &abbe));
    TRY(read_conductor(p, m, "conductor.", index));
    TRY(read_roughness(p, m, "interface.", 0, 0, &coat));
    TRY(read_roughness(p, m, "conductor.", 0, 0, &metal));
    TRY(read_layers(p, m));
    m->base.clearcoat = 1;
    m->base.clearcoat_ior = (float)index;
    TRY(put_coat_roughness(p, m, &coat));
    return put_roughness(p, m, &metal);
}

static void be_glass(struct pbrt_material *m, double index, double abbe)
{
    m->base.metallic = 0;
    m->base.transmission = 1;
    m->base.refractive = 1;
    m->base.ior = (float)index;
    m->base.dispersion = abbe > 0 ? (float)(20 / abbe) : 0;
}

static status read_dielectric(struct pbrt *p, struct pbrt_material *m)
{
    struct roughness rough;
    double index, abbe;

    TRY(read_index(p, m, "eta", 1.5, &index, &abbe));
    be_glass(m, index, abbe);
    TRY(read_roughness(p, m, "", 0, 0, &rough));
    return put_roughness(p, m, &rough);
}

static status read_thin_dielectric(struct pbrt *p, struct pbrt_material *m)
{
    double index, abbe;

    TRY(read_index(p, m, "eta", 1.5, &index, &abbe));
    be_glass(m, index, 0);
    m->base.refractive = 0;
    m->base.thin_slab = 1;
    m->base.roughness = 0;
    return STATUS_OK;
}

/* r / pi and t / pi become (1 - w) c / pi and w d / pi: w so that neither colour exceeds 1. */
static status put_two_sides(struct pbrt *p, struct pbrt_material *m,
                            const struct pbrt_texture *r, const struct pbrt_texture *t)
{
    const int constant = r->op == TEXTURE_CONSTANT && t->op == TEXTURE_CONSTANT;
    double rmax = 0, tmax = 0, w = 0.5;
    const struct pbrt_texture *to_r, *to_t;

    be_matte(m);
    for (int i = 0; i < 3 && constant; i++) {
        rmax = fmax(rmax, r->value[i]);
        tmax = fmax(tmax, t->value[i]);
    }
    if (constant && rmax + tmax > 0)
        w = tmax / (rmax + tmax);
    if (rmax + tmax > 1.0001)
        pbrt_warn(p, &m->at, "more light than comes in",
                  "material \"%.60s\": reflects and transmits more light than falls on it: "
                  "darkened",
                  m->name);
    to_r = pbrt_constant(p, w < 1 ? 1 / (1 - w) : 0, w < 1 ? 1 / (1 - w) : 0,
                         w < 1 ? 1 / (1 - w) : 0);
    to_t = pbrt_constant(p, w > 0 ? 1 / w : 0, w > 0 ? 1 / w : 0, w > 0 ? 1 / w : 0);
    if (!to_r || !to_t)
        return error_no_memory(p->err, "a material");
    m->base.diffuse_transmission = (float)w;
    m->color = pbrt_product(p, r, to_r);
    t = pbrt_product(p, t, to_t);
    if (!m->color || !t)
        return error_no_memory(p->err, "a material");
    return pbrt_color_slot(p, t, NULL, 1, m->base.diffuse_transmission_color,
                           &m->base.diffuse_transmission_color_texture);
}

static status read_diffuse_transmission(struct pbrt *p, struct pbrt_material *m)
{
    const struct pbrt_texture *r, *t, *scale;
    double s = pbrt_float(m->params, "scale", 1);

    TRY(color_or(p, m, "reflectance", 0.25, &r));
    TRY(color_or(p, m, "transmittance", 0.25, &t));
    scale = pbrt_constant(p, s, s, s);
    r = scale ? pbrt_product(p, r, scale) : NULL;
    t = scale ? pbrt_product(p, t, scale) : NULL;
    if (!r || !t)
        return error_no_memory(p->err, "a material");
    return put_two_sides(p, m, r, t);
}

static status read_translucent(struct pbrt *p, struct pbrt_material *m)
{
    const struct pbrt_texture *kd, *r, *t, *ks;

    TRY(color_or(p, m, "Kd", 0.25, &kd));
    TRY(color_or(p, m, "Ks", 0.25, &ks));
    TRY(color_or(p, m, "reflect", 0.5, &r));
    TRY(color_or(p, m, "transmit", 0.5, &t));
    pbrt_warn(p, &m->at, "translucent",
              "material \"%.60s\": the glossy part of \"translucent\" is not supported: diffuse "
              "alone",
              m->name);
    (void)pbrt_param(m->params, "roughness", ~0u);
    (void)pbrt_param(m->params, "remaproughness", ~0u);
    r = pbrt_product(p, kd, r);
    t = pbrt_product(p, kd, t);
    if (!r || !t)
        return error_no_memory(p->err, "a material");
    return put_two_sides(p, m, r, t);
}

static double identity(double value, double unused)
{
    (void)unused;
    return value;
}

static double one_minus(double value, double unused)
{
    (void)unused;
    return 1 - value;
}

static status read_mix(struct pbrt *p, struct pbrt_material *m, unsigned depth)
{
    const struct pbrt_param *names = pbrt_param(m->params, "materials", PBRT_BIT(PBRT_STRING));
    const struct pbrt_texture *amount;
    const char *name[2];
    int version3 = 0;

    if (names && names->string_count == 2) {
        name[0] = names->strings[0];
        name[1] = names->strings[1];
    } else {
        name[0] = pbrt_string(m->params, "namedmaterial1", NULL);
        name[1] = pbrt_string(m->params, "namedmaterial2", NULL);
        version3 = 1;
    }
    if (!name[0] || !name[1])
        return pbrt_fail(p, STATUS_ERR_INPUT, &m->at,
                         "material \"%.60s\": a mix names two \"string materials\"", m->name);
    if (version3)
        TRY(color_or(p, m, "amount", 0.5, &amount));
    else
        TRY(pbrt_float_texture(p, m->params, "amount", &amount));
    if (!amount)
        amount = pbrt_constant(p, 0.5, 0.5, 0.5);
    if (!amount)
        return error_no_memory(p->err, "a material");
    m->base.kind = MATERIAL_MIX;
    for (int i = 0; i < 2; i++) {
        m->mix[i] = pbrt_name_find(&p->materials, name[i]);
        if (!m->mix[i] || m->mix[i] == m)
            return pbrt_fail(p, STATUS_ERR_INPUT, &m->at,
                             "material \"%.60s\": its part \"%.60s\" is not known: define it above",
                             m->name, name[i]);
        TRY(pbrt_material_resolve(p, m->mix[i], depth + 1));
    }
    /* pbrt-v4's amount is the second one's share, pbrt-v3's the first one's. */
    return pbrt_scalar_slot(p, amount, version3 ? one_minus : identity, 0, &m->base.mix_amount,
                            &m->base.mix_texture);
}

/* Specular light of strength Ks times Fresnel's. */
static status put_specular(struct pbrt *p, struct pbrt_material *m, const struct pbrt_texture *ks,
                           double unit)
{
    double largest = 0;

    if (ks->op != TEXTURE_CONSTANT)
        return pbrt_color_slot(p, ks, NULL, 1, m->base.specular_color,
                               &m->base.specular_color_texture);
    for (int i = 0; i < 3; i++)
        largest = fmax(largest, ks->value[i]);
    m->base.specular = unit < 1 ? 1.0f : (float)fmin(largest, 1);
    for (int i = 0; i < 3 && largest > 0; i++)
        m->base.specular_color[i] = (float)(ks->value[i] / (unit < 1 ? unit : largest));
    if (largest == 0)
        m->base.specular = 0;
    return STATUS_OK;
}

static status read_plastic(struct pbrt *p, struct pbrt_material *m)
{
    const struct pbrt_texture *ks;
    struct roughness rough;

    m->base.metallic = 0;
    TRY(color_or(p, m, "Kd", 0.25, &m->color));
    TRY(color_or(p, m, "Ks", 0.25, &ks));
    TRY(put_specular(p, m, ks, 1));
    TRY(read_roughness(p, m, "", 0.1, 1, &rough));
    return put_roughness(p, m, &rough);
}

/* Ashikhmin and Shirley's: Ks is the reflectance at normal incidence. */
static status read_substrate(struct pbrt *p, struct pbrt_material *m)
{
    const struct pbrt_texture *ks;
    struct roughness rough;

    m->base.metallic = 0;
    m->base.ior = 1.5f;
    TRY(color_or(p, m, "Kd", 0.5, &m->color));
    TRY(color_or(p, m, "Ks", 0.5, &ks));
    TRY(put_specular(p, m, ks, 0.04));
    TRY(read_roughness(p, m, "", 0.1, 1, &rough));
    return put_roughness(p, m, &rough);
}

static status read_uber(struct pbrt *p, struct pbrt_material *m)
{
    static const char *const missing[] = {"Kr", "Kt"};
    const struct pbrt_texture *t;
    double index, abbe;

    TRY(read_plastic(p, m));
    TRY(read_index(p, m, pbrt_has(m->params, "index") ? "index" : "eta", 1.5, &index, &abbe));
    m->base.ior = (float)index;
    for (int i = 0; i < 2; i++) {
        TRY(pbrt_color_texture(p, m->params, missing[i], USE_REFLECTANCE, &t));
        if (t && (t->op != TEXTURE_CONSTANT || t->value[0] > 0 || t->value[1] > 0 ||
                  t->value[2] > 0))
            pbrt_warn(p, &m->at, "uber",
                      "material \"%.60s\": \"%s\" of \"uber\" is not supported: left out", m->name,
                      missing[i]);
    }
    return pbrt_color_texture(p, m->params, "opacity", USE_REFLECTANCE, &m->opacity);
}

static status read_metal_v3(struct pbrt *p, struct pbrt_material *m)
{
    struct roughness rough;

    TRY(read_conductor(p, m, "", 1));
    TRY(read_roughness(p, m, "", 0.01, 1, &rough));
    return put_roughness(p, m, &rough);
}

static status read_mirror(struct pbrt *p, struct pbrt_material *m)
{
    m->base.metallic = 1;
    m->base.roughness = 0;
    m->base.ior = 0; /* Fresnel exactly 1 */
    return color_or(p, m, "Kr", 0.9, &m->color);
}

static status read_glass(struct pbrt *p, struct pbrt_material *m)
{
    const struct pbrt_texture *kr;
    struct roughness rough;
    double index, abbe;

    TRY(read_index(p, m, pbrt_has(m->params, "index") ? "index" : "eta", 1.5, &index, &abbe));
    be_glass(m, index, abbe);
    TRY(color_or(p, m, "Kt", 1, &m->color));
    TRY(color_or(p, m, "Kr", 1, &kr));
    TRY(put_specular(p, m, kr, 1));
    TRY(read_roughness(p, m, "", 0, 1, &rough));
    if (same_constant(rough.u, rough.v) && rough.u->op == TEXTURE_CONSTANT &&
        rough.u->value[0] == 0) {
        m->base.roughness = 0; /* no remapping of smooth glass */
        return STATUS_OK;
    }
    return put_roughness(p, m, &rough);
}

/* Burley's principled model, of which glTF's is the core. */
static status read_disney(struct pbrt *p, struct pbrt_material *m)
{
    struct pbrt_params *a = m->params;
    const struct pbrt_texture *t;
    double sheen = pbrt_float(a, "sheen", 0), index, abbe, tint;

    TRY(color_or(p, m, "color", 0.5, &m->color));
    TRY(pbrt_float_texture(p, a, "metallic", &t));
    m->base.metallic = t ? (float)fmin(fmax(t->value[0], 0), 1) : 0;
    if (t && t->op != TEXTURE_CONSTANT)
        pbrt_warn(p, &m->at, "metallic texture",
                  "material \"%.60s\": a texture for \"metallic\" is not supported: 0", m->name);
    TRY(pbrt_float_texture(p, a, "roughness", &t));
    m->base.roughness = 0.5f;
    if (t)
        TRY(pbrt_scalar_slot(p, t, identity, 0, &m->base.roughness,
                             &m->base.metallic_roughness_texture));
    TRY(read_index(p, m, "eta", 1.5, &index, &abbe));
    m->base.ior = (float)index;
    m->base.transmission = (float)fmin(fmax(pbrt_float(a, "spectrans", 0), 0), 1);
    m->base.refractive = !pbrt_bool(a, "thin", 0);
    m->base.clearcoat = (float)fmin(fmax(pbrt_float(a, "clearcoat", 0) / 4, 0), 1);
    m->base.clearcoat_roughness =
        (float)sqrt(0.1 - 0.099 * fmin(fmax(pbrt_float(a, "clearcoatgloss", 1), 0), 1));
    tint = pbrt_float(a, "sheentint", 0.5);
    for (int i = 0; i < 3; i++) {
        double c = m->color->op == TEXTURE_CONSTANT ? m->color->value[i] : 1;
        m->base.sheen_color[i] = (float)fmin(fmax(sheen * (1 - tint + tint * c), 0), 1);
    }
    m->base.sheen_roughness = 0.5f;
    m->base.anisotropy = (float)fmin(fmax(pbrt_float(a, "anisotropic", 0), 0), 1);
    m->wants_tangents = m->base.anisotropy > 0;
    return STATUS_OK;
}

static status read_interface(struct pbrt *p, struct pbrt_material *m)
{
    (void)p;
    m->base.kind = MATERIAL_INTERFACE;
    return STATUS_OK;
}

static const struct {
    const char *kind;
    status (*read)(struct pbrt *p, struct pbrt_material *m);
} kinds[] = {
    {"diffuse", read_diffuse},
    {"coateddiffuse", read_coated_diffuse},
    {"conductor", read_plain_conductor},
    {"coatedconductor", read_coated_conductor},
    {"dielectric", read_dielectric},
    {"thindielectric", read_thin_dielectric},
    {"diffusetransmission", read_diffuse_transmission},
    {"interface", read_interface},
    {"none", read_interface},
    {"", read_interface},
    {"matte", read_matte},
    {"plastic", read_plastic},
    {"substrate", read_substrate},
    {"uber", read_uber},
    {"metal", read_metal_v3},
    {"mirror", read_mirror},
    {"glass", read_glass},
    {"translucent", read_translucent},
    {"disney", read_disney},
};

static status refuse_kind(struct pbrt *p, struct pbrt_material *m)
{
    char kind[128];

    snprintf(kind, sizeof kind, "material %.60s", m->kind);
    pbrt_warn(p, &m->at, kind,
              "material \"%.60s\": the kind \"%.60s\" is not supported: matte grey instead",
              m->name, m->kind);
    for (size_t i = 0; i < m->params->count; i++)
        m->params->items[i].used = 1;
    be_matte(m);
    m->color = pbrt_constant(p, 0.5, 0.5, 0.5);
    return m->color ? STATUS_OK : error_no_memory(p->err, "a material");
}

/* ---- what all kinds share ----------------------------------------------------------------- */

static status read_relief(struct pbrt *p, struct pbrt_material *m)
{
    const char *name = pbrt_string(m->params, "normalmap", NULL);
    struct pbrt_image *image;

    if (pbrt_param(m->params, "displacement", ~0u) || pbrt_param(m->params, "bumpmap", ~0u))
        pbrt_warn(p, &m->at, "displacement",
                  "material \"%.60s\": displacement (bump mapping) is not supported: smooth",
                  m->name);
    if (!name || !*name)
        return STATUS_OK;
    TRY(pbrt_image(p, name, &m->at, &image));
    if (!image)
        return STATUS_OK;
    m->wants_tangents = 1;
    return pbrt_image_slot(p, image, ENCODING_LINEAR, WRAP_REPEAT, 0, &m->base.normal_texture);
}

status pbrt_material_resolve(struct pbrt *p, struct pbrt_material *m, unsigned depth)
{
    char what[128];
    int found = 0;

    if (m->resolved)
        return STATUS_OK;
    if (depth > PBRT_MATERIAL_DEPTH_MAX)
        return pbrt_fail(p, STATUS_ERR_LIMIT, &m->at, "materials are mixed more than %d deep",
                         PBRT_MATERIAL_DEPTH_MAX);
    scene_material_default(&m->base);
    m->base.name = builder_name(p->b, m->name);
    m->base.double_sided = 1;
    for (size_t i = 0; i < sizeof kinds / sizeof *kinds && !found; i++)
        if (strcmp(kinds[i].kind, m->kind) == 0) {
            found = 1;
            TRY(kinds[i].read(p, m));
        }
    if (!found && strcmp(m->kind, "mix") == 0)
        TRY(read_mix(p, m, depth));
    else if (!found)
        TRY(refuse_kind(p, m));
    TRY(read_relief(p, m));
    (void)pbrt_string(m->params, "type", NULL);
    snprintf(what, sizeof what, "material \"%.60s\"", m->kind);
    pbrt_params_report(m->params, p->b, what);
    m->resolved = 1;
    return STATUS_OK;
}

static int slot_used(const struct scene_texture_slot *slot)
{
    return slot->texture >= 0;
}

/* Mixes refer to earlier materials only, at most PBRT_MATERIAL_DEPTH_MAX deep; `left` bounds the
 * walk where the same part is reached in many ways. */
static int any_part(const struct pbrt_material *m, int (*asks)(const struct pbrt_material *),
                    int *left)
{
    if (--*left < 0 || asks(m))
        return 1;
    for (int i = 0; i < 2; i++)
        if (m->mix[i] && any_part(m->mix[i], asks, left))
            return 1;
    return 0;
}

static int asks_uv(const struct pbrt_material *m)
{
    const struct scene_material *b = &m->base;

    return (m->color && m->color->op != TEXTURE_CONSTANT) || m->wants_tangents ||
           slot_used(&b->metallic_roughness_texture) || slot_used(&b->normal_texture) ||
           slot_used(&b->specular_color_texture) || slot_used(&b->clearcoat_roughness_texture) ||
           slot_used(&b->diffuse_transmission_color_texture) || slot_used(&b->mix_texture) ||
           (m->opacity && m->opacity->op != TEXTURE_CONSTANT);
}

static int asks_tangents(const struct pbrt_material *m)
{
    return m->wants_tangents;
}

int pbrt_material_uses_uv(const struct pbrt_material *m)
{
    int left = 64;

    return any_part(m, asks_uv, &left);
}

int pbrt_material_wants_tangents(const struct pbrt_material *m)
{
    int left = 64;

    return any_part(m, asks_tangents, &left);
}

/* ---- rows --------------------------------------------------------------------------------- */

static status put_color(struct pbrt *p, struct pbrt_material *m, const struct pbrt_texture *alpha,
                        struct scene_material *out)
{
    const struct pbrt_texture *color = m->color, *cut = alpha;

    *out = m->base;
    if (m->opacity) {
        cut = alpha ? pbrt_product(p, alpha, m->opacity) : m->opacity;
        if (!cut)
            return error_no_memory(p->err, "a material");
    }
    if (!color)
        color = m->color = pbrt_constant(p, 1, 1, 1);
    if (!color)
        return error_no_memory(p->err, "a material");
    if (cut && cut->op == TEXTURE_CONSTANT) {
        double a = (cut->value[0] + cut->value[1] + cut->value[2]) / 3;
        out->base_color[3] = (float)fmin(fmax(a, 0), 1);
        if (out->base_color[3] < 1)
            out->alpha_mode = ALPHA_BLEND;
        cut = NULL;
    }
    if (!cut) {
        if (!m->color_in_slot)
            TRY(pbrt_color_slot(p, color, NULL, 1, m->base.base_color,
                                &m->base.base_color_texture));
        m->color_in_slot = 1;
        memcpy(out->base_color, m->base.base_color, 3 * sizeof(float));
        out->base_color_texture = m->base.base_color_texture;
        return STATUS_OK;
    }
    out->alpha_mode = ALPHA_BLEND;
    return pbrt_color_slot(p, color, cut, 1, out->base_color, &out->base_color_texture);
}

static status put_light(struct pbrt *p, const struct pbrt_surface *s, struct scene_material *out)
{
    const struct pbrt_area_light *light = s->light;
    double scale = 1;

    if (!light)
        return STATUS_OK;
    if (out->kind == MATERIAL_INTERFACE) {
        pbrt_warn(p, &light->at, "light without a surface",
                  "an area light on the material \"interface\" is not supported: it does not "
                  "shine");
        return STATUS_OK;
    }
    if (light->power > 0) {
        double known = light->mean_luminance * (light->two_sided ? 2 : 1) * s->area * PI_D;
        scale = known > 0 ? light->power / known : 0;
    }
    for (int i = 0; i < 3; i++)
        out->emission[i] = (float)fmin(fmax(light->radiance[i] * scale, 0), 1e30);
    if (light->image)
        return pbrt_image_slot(p, light->image, ENCODING_BY_SLOT, WRAP_CLAMP, 1,
                               &out->emission_texture);
    return STATUS_OK;
}

static int bounds_volume(const struct scene_material *m)
{
    return m->kind == MATERIAL_INTERFACE || m->kind == MATERIAL_MIX ||
           (m->kind == MATERIAL_SURFACE && m->refractive && m->transmission > 0);
}

static status make_row(struct pbrt *p, const struct pbrt_surface *s, unsigned depth,
                       uint32_t *row);

static status find_or_make(struct pbrt *p, const struct pbrt_surface *s, unsigned depth,
                           uint32_t *row)
{
    struct pbrt_variant **list = s->light ? &s->light->variants : &s->material->variants, *v;
    double area = s->light && s->light->power > 0 ? s->area : 0;

    for (v = *list; v; v = v->next)
        if (v->material == s->material && v->light == s->light && v->alpha == s->alpha &&
            v->medium == s->medium && v->one_sided == s->one_sided && v->area == area) {
            *row = v->row;
            return STATUS_OK;
        }
    TRY(make_row(p, s, depth, row));
    v = ARENA_NEW(&p->arena, struct pbrt_variant);
    if (!v)
        return error_no_memory(p->err, "a material");
    *v = (struct pbrt_variant){*list,     s->material, s->light,     s->alpha,
                               area,      s->medium,   s->one_sided, *row};
    *list = v;
    return STATUS_OK;
}

static status make_row(struct pbrt *p, const struct pbrt_surface *s, unsigned depth, uint32_t *row)
{
    struct pbrt_material *m = s->material;
    struct scene_material out;

    if (depth > PBRT_MATERIAL_DEPTH_MAX)
        return pbrt_fail(p, STATUS_ERR_LIMIT, &m->at, "materials are mixed more than %d deep",
                         PBRT_MATERIAL_DEPTH_MAX);
    TRY(put_color(p, m, s->alpha, &out));
    TRY(put_light(p, s, &out));
    if (bounds_volume(&out))
        out.medium = s->medium;
    if (s->one_sided)
        out.double_sided = 0;
    for (int i = 0; i < 2 && out.kind == MATERIAL_MIX; i++) {
        struct pbrt_surface part = *s;
        part.material = m->mix[i];
        TRY(find_or_make(p, &part, depth + 1, &out.mix_material[i]));
    }
    return builder_add_material(p->b, &out, row);
}

/* Constant alphas of one value are one. */
status pbrt_material_row(struct pbrt *p, const struct pbrt_surface *s, uint32_t *row)
{
    TRY(pbrt_material_resolve(p, s->material, 0));
    if (s->light)
        TRY(pbrt_area_light_resolve(p, s->light));
    return find_or_make(p, s, 0, row);
}
