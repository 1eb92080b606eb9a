/* Values shared by the kinds of materials: roughnesses, indices, colours. */
#include <math.h>
#include <stdio.h>

#include "client/import/pbrt/pbrt_material_parts.h"
#include "common/math/elementary.h"

/* ---- roughness ---------------------------------------------------------------------------- */

static double alpha_of(double roughness, enum pbrt_remap remap)
{
    double x;

    if (remap == REMAP_V4)
        return roughness > 0 ? sqrt(roughness) : 0;
    if (remap == REMAP_NONE)
        return roughness > 0 ? roughness : 0;
    x = det_log_d(roughness > 1e-3 ? roughness : 1e-3);
    return 1.62142 + x * (0.819955 + x * (0.1734 + x * (0.0171201 + x * 0.000640711)));
}

static double perceptual(double roughness, double remap)
{
    double alpha = alpha_of(roughness, (enum pbrt_remap)(int)remap);

    return sqrt(alpha > 0 ? alpha < 1 ? alpha : 1 : 0);
}

status pbrt_read_roughness(struct pbrt *p, struct pbrt_material *m, const char *prefix, double otherwise, int version3,
                           struct pbrt_roughness *out)
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
    out->u = out->u ? out->u : both;
    out->v = out->v ? out->v : both;
    out->remap = !pbrt_bool(m->params, "remaproughness", 1) ? REMAP_NONE
                 : version3                                 ? REMAP_V3
                                                            : REMAP_V4;
    return STATUS_OK;
}

int pbrt_same_constant(const struct pbrt_texture *a, const struct pbrt_texture *b)
{
    return a == b || (a->op == TEXTURE_CONSTANT && b->op == TEXTURE_CONSTANT && a->value[0] == b->value[0]);
}

static double unit_alpha(const struct pbrt_texture *t, enum pbrt_remap remap)
{
    double a = alpha_of(t->value[0], remap);

    return a > 0 ? a < 1 ? a : 1 : 0;
}

status pbrt_put_roughness(struct pbrt *p, struct pbrt_material *m, const struct pbrt_roughness *r)
{
    double u, v, low, high;

    if (!pbrt_same_constant(r->u, r->v) && (r->u->op != TEXTURE_CONSTANT || r->v->op != TEXTURE_CONSTANT))
        pbrt_warn(p, &m->at, "roughness by two textures",
                  "material \"%.60s\": two roughnesses are supported as numbers only: that along u "
                  "counts",
                  m->name);
    else if (!pbrt_same_constant(r->u, r->v)) {
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

status pbrt_own_roughness(struct pbrt *p, struct pbrt_material *m, double otherwise, int version3)
{
    struct pbrt_roughness rough;

    TRY(pbrt_read_roughness(p, m, "", otherwise, version3, &rough));
    return pbrt_put_roughness(p, m, &rough);
}

status pbrt_put_coat_roughness(struct pbrt *p, struct pbrt_material *m, const struct pbrt_roughness *r)
{
    if (!pbrt_same_constant(r->u, r->v))
        pbrt_warn(p, &m->at, "anisotropic coat", "material \"%.60s\": a coat has one roughness: that along u counts, not \"interface.vroughness\"", m->name);
    return pbrt_scalar_slot(p, r->u, perceptual, (double)r->remap, &m->base.clearcoat_roughness,
                            &m->base.clearcoat_roughness_texture);
}

#define INDEX_DEFAULT 1.5

/* ---- indices of refraction ---------------------------------------------------------------- */

status pbrt_read_index(struct pbrt *p, struct pbrt_material *m, const char *name, double least, double *index,
                       double *abbe)
{
    const struct pbrt_param *param = pbrt_param(m->params, name, PBRT_NUMBERS | PBRT_COLORS);

    *index = INDEX_DEFAULT;
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
    if (!(*index >= least && *index <= 1e3)) {
        pbrt_warn(p, &param->at, "index of refraction",
                  "material \"%.60s\": an index of refraction of %g is not supported (%g to 1000): "
                  "%g is used",
                  m->name, *index, least, *index < least ? least : INDEX_DEFAULT);
        *index = *index < least ? least : INDEX_DEFAULT;
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

double pbrt_inner_reflectance(double eta)
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

status pbrt_read_metal(struct pbrt *p, struct pbrt_material *m, const char *prefix, double eta[3], double k[3])
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

double pbrt_k_of_reflectance(double r)
{
    r = r > 0 ? r < 0.9999 ? r : 0.9999 : 0;
    return 2 * sqrt(r) / sqrt(1 - r);
}

/* ---- colours ------------------------------------------------------------------------------ */

status pbrt_color_or(struct pbrt *p, struct pbrt_material *m, const char *name, double otherwise,
                     const struct pbrt_texture **out)
{
    TRY(pbrt_color_texture(p, m->params, name, USE_REFLECTANCE, out));
    if (!*out)
        *out = pbrt_constant(p, otherwise, otherwise, otherwise);
    return STATUS_OK;
}

void pbrt_be_matte(struct pbrt_material *m)
{
    m->base.metallic = 0;
    m->base.specular = 0;
    m->base.roughness = 1;
}

void pbrt_be_glass(struct pbrt_material *m, double index, double abbe)
{
    m->base.metallic = 0;
    m->base.transmission = 1;
    m->base.refractive = 1;
    m->base.ior = (float)index;
    m->base.dispersion = abbe > 0 ? (float)(20 / abbe) : 0;
}
