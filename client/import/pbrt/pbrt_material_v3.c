/* The kinds of materials that only pbrt-v3 has. */
#include <math.h>

#include "client/import/pbrt/pbrt_material_parts.h"
#include "common/math/elementary.h"

/* Oren and Nayar's sigma (degrees) as the roughness r of the energy-preserving model. Theirs is A +
 * B s/t (1994, qualitative model), with A and B of sigma; ours is proportional to 1 + r s/t: the
 * same shape for r = B / A, without pbrt's loss of energy. */
static double oren_nayar_roughness(double sigma_deg, double unused UNUSED)
{
    double sigma = fmin(fmax(sigma_deg, 0), 90) * (double)PI_F / 180, sigma2 = sigma * sigma;
    double a = 1 - sigma2 / (2 * (sigma2 + 0.33)), b = 0.45 * sigma2 / (sigma2 + 0.09);

    return b / a;
}

static status read_matte(struct pbrt *p, struct pbrt_material *m)
{
    const struct pbrt_texture *sigma;

    pbrt_be_matte(m);
    TRY(pbrt_float_texture(p, m->params, "sigma", &sigma));
    if (sigma)
        TRY(pbrt_scalar_slot(p, sigma, oren_nayar_roughness, 0, &m->base.diffuse_roughness,
                             &m->base.diffuse_roughness_texture));
    return pbrt_color_or(p, m, "Kd", 0.5, &m->color);
}

static status read_translucent(struct pbrt *p, struct pbrt_material *m)
{
    const struct pbrt_texture *kd, *r, *t, *ks;

    TRY(pbrt_color_or(p, m, "Kd", 0.25, &kd));
    TRY(pbrt_color_or(p, m, "Ks", 0.25, &ks));
    TRY(pbrt_color_or(p, m, "reflect", 0.5, &r));
    TRY(pbrt_color_or(p, m, "transmit", 0.5, &t));
    pbrt_warn(p, &m->at, "translucent",
              "material \"%.60s\": the glossy part of \"translucent\" is not supported: diffuse "
              "alone",
              m->name);
    (void)pbrt_param(m->params, "roughness", ~0u);
    (void)pbrt_param(m->params, "remaproughness", ~0u);
    r = pbrt_product(p, kd, r);
    t = pbrt_product(p, kd, t);
    return pbrt_put_two_sides(p, m, r, t);
}

/* Specular light of strength Ks times Fresnel's. */
static status put_specular(struct pbrt *p, struct pbrt_material *m, const struct pbrt_texture *ks, double unit)
{
    double largest = 0;

    if (ks->op != TEXTURE_CONSTANT)
        return pbrt_color_slot(p, ks, NULL, 1, m->base.specular_color, &m->base.specular_color_texture);
    for (int i = 0; i < 3; i++)
        largest = fmax(largest, ks->value[i]);
    m->base.specular = unit < 1 ? 1.0f : (float)fmin(largest, 1);
    for (int i = 0; i < 3 && largest > 0; i++)
        m->base.specular_color[i] = (float)(ks->value[i] / (unit < 1 ? unit : largest));
    if (largest == 0)
        m->base.specular = 0;
    return STATUS_OK;
}

/* Of plastic and uber. */
static status read_gloss(struct pbrt *p, struct pbrt_material *m, struct pbrt_roughness *rough)
{
    const struct pbrt_texture *ks;

    m->base.metallic = 0;
    TRY(pbrt_color_or(p, m, "Kd", 0.25, &m->color));
    TRY(pbrt_color_or(p, m, "Ks", 0.25, &ks));
    TRY(put_specular(p, m, ks, 1));
    return pbrt_read_roughness(p, m, "", 0.1, 1, rough);
}

static status read_plastic(struct pbrt *p, struct pbrt_material *m)
{
    struct pbrt_roughness rough;

    TRY(read_gloss(p, m, &rough));
    return pbrt_put_roughness(p, m, &rough);
}

/* "uroughness" and "vroughness": glass and substrate have no "roughness". */
static status read_two_roughnesses(struct pbrt *p, struct pbrt_material *m, double otherwise, struct pbrt_roughness *out)
{
    const struct pbrt_texture *const given = pbrt_constant(p, otherwise, otherwise, otherwise);

    TRY(pbrt_float_texture(p, m->params, "uroughness", &out->u));
    TRY(pbrt_float_texture(p, m->params, "vroughness", &out->v));
    out->u = out->u ? out->u : given;
    out->v = out->v ? out->v : given;
    out->remap = pbrt_bool(m->params, "remaproughness", 1) ? REMAP_V3 : REMAP_NONE;
    return STATUS_OK;
}

/* Ashikhmin and Shirley's: Ks is the reflectance at normal incidence. */
static status read_substrate(struct pbrt *p, struct pbrt_material *m)
{
    const struct pbrt_texture *ks;
    struct pbrt_roughness rough;

    m->base.metallic = 0;
    m->base.ior = 1.5f;
    TRY(pbrt_color_or(p, m, "Kd", 0.5, &m->color));
    TRY(pbrt_color_or(p, m, "Ks", 0.5, &ks));
    TRY(put_specular(p, m, ks, 0.04));
    TRY(read_two_roughnesses(p, m, 0.1, &rough));
    return pbrt_put_roughness(p, m, &rough);
}

static status read_uber(struct pbrt *p, struct pbrt_material *m)
{
    static const char *const missing[] = {"Kr", "Kt"};
    const struct pbrt_texture *t;
    struct pbrt_roughness rough;
    double index, abbe;

    TRY(read_gloss(p, m, &rough));
    if (!pbrt_has(m->params, "vroughness"))
        rough.v = rough.u; /* metal's would be "roughness" */
    TRY(pbrt_put_roughness(p, m, &rough));
    TRY(pbrt_read_index(p, m, pbrt_has(m->params, "eta") ? "eta" : "index", 1, &index, &abbe));
    m->base.ior = (float)index;
    for (int i = 0; i < 2; i++) {
        TRY(pbrt_color_texture(p, m->params, missing[i], USE_REFLECTANCE, &t));
        if (t && (t->op != TEXTURE_CONSTANT || t->value[0] > 0 || t->value[1] > 0 || t->value[2] > 0))
            pbrt_warn(p, &m->at, "uber", "material \"%.60s\": \"%s\" of \"uber\" is not supported: left out", m->name,
                      missing[i]);
    }
    return pbrt_color_texture(p, m->params, "opacity", USE_REFLECTANCE, &m->opacity);
}

static status read_metal_v3(struct pbrt *p, struct pbrt_material *m)
{
    TRY(pbrt_read_conductor(p, m, "", 1));
    return pbrt_own_roughness(p, m, 0.01, 1);
}

static status read_mirror(struct pbrt *p, struct pbrt_material *m)
{
    m->base.metallic = 1;
    m->base.roughness = 0;
    m->base.ior = 0; /* Fresnel exactly 1 */
    return pbrt_color_or(p, m, "Kr", 0.9, &m->color);
}

static status read_glass(struct pbrt *p, struct pbrt_material *m)
{
    const struct pbrt_texture *kr;
    struct pbrt_roughness rough;
    double index, abbe;

    TRY(pbrt_read_index(p, m, pbrt_has(m->params, "eta") ? "eta" : "index", PBRT_INDEX_MIN, &index, &abbe));
    pbrt_be_glass(m, index, abbe);
    TRY(pbrt_color_or(p, m, "Kt", 1, &m->color));
    TRY(pbrt_color_or(p, m, "Kr", 1, &kr));
    TRY(put_specular(p, m, kr, 1));
    TRY(read_two_roughnesses(p, m, 0, &rough));
    if (pbrt_same_constant(rough.u, rough.v) && rough.u->op == TEXTURE_CONSTANT &&
        rough.u->value[0] == 0) {
        m->base.roughness = 0; /* no remapping of smooth glass */
        return STATUS_OK;
    }
    return pbrt_put_roughness(p, m, &rough);
}

/* Burley's principled model, whose core is glTF's. */
static status read_disney(struct pbrt *p, struct pbrt_material *m)
{
    struct pbrt_params *a = m->params;
    const struct pbrt_texture *t;
    double sheen = pbrt_float(a, "sheen", 0), index, abbe, tint;

    TRY(pbrt_color_or(p, m, "color", 0.5, &m->color));
    TRY(pbrt_float_texture(p, a, "metallic", &t));
    m->base.metallic = t ? (float)fmin(fmax(t->value[0], 0), 1) : 0;
    if (t && t->op != TEXTURE_CONSTANT)
        pbrt_warn(p, &m->at, "metallic texture", "material \"%.60s\": a texture for \"metallic\" is not supported: 0",
                  m->name);
    TRY(pbrt_float_texture(p, a, "roughness", &t));
    m->base.roughness = 0.5f;
    if (t)
        TRY(pbrt_scalar_slot(p, t, pbrt_unchanged, 0, &m->base.roughness, &m->base.metallic_roughness_texture));
    TRY(pbrt_read_index(p, m, "eta", 1, &index, &abbe));
    m->base.ior = (float)index;
    m->base.transmission = (float)fmin(fmax(pbrt_float(a, "spectrans", 0), 0), 1);
    m->base.refractive = !pbrt_bool(a, "thin", 0);
    m->base.clearcoat = (float)fmin(fmax(pbrt_float(a, "clearcoat", 0) / 4, 0), 1);
    m->base.clearcoat_roughness = (float)sqrt(0.1 - 0.099 * fmin(fmax(pbrt_float(a, "clearcoatgloss", 1), 0), 1));
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

const struct pbrt_kind pbrt_kinds_v3[] = {
    {"matte", read_matte},
    {"plastic", read_plastic},
    {"substrate", read_substrate},
    {"uber", read_uber},
    {"metal", read_metal_v3},
    {"mirror", read_mirror},
    {"glass", read_glass},
    {"translucent", read_translucent},
    {"disney", read_disney},
    {NULL, NULL},
};
