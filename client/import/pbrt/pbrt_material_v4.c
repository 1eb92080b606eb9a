/* The kinds of materials of pbrt-v4, and mixes, whose parts are materials. */
#include <math.h>

#include "client/import/pbrt/pbrt_material_parts.h"

static status read_diffuse(struct pbrt *p, struct pbrt_material *m)
{
    pbrt_be_matte(m);
    return pbrt_color_or(p, m, "reflectance", 0.5, &m->color);
}

/* The medium between coat and base of pbrt's layered materials. */
static status read_layers(struct pbrt *p, struct pbrt_material *m)
{
    static const char *const walk[] = {"maxdepth", "nsamples", "g", "thickness", "interface.thickness", NULL};
    const struct pbrt_texture *albedo;

    pbrt_ignore(m->params, walk);
    TRY(pbrt_color_texture(p, m->params, "albedo", USE_REFLECTANCE, &albedo));
    if (albedo &&
        (albedo->op != TEXTURE_CONSTANT || albedo->value[0] != 0 || albedo->value[1] != 0 || albedo->value[2] != 0))
        pbrt_warn(p, &m->at, "layer albedo",
                  "material \"%.60s\": a medium between coat and base (\"albedo\") is not "
                  "supported: clear",
                  m->name);
    return STATUS_OK;
}

static status read_coated_diffuse(struct pbrt *p, struct pbrt_material *m)
{
    struct pbrt_roughness rough;
    double index, abbe;

    m->base.metallic = 0;
    TRY(pbrt_color_or(p, m, "reflectance", 0.5, &m->color));
    TRY(pbrt_read_roughness(p, m, "", 0, 0, &rough));
    TRY(pbrt_read_index(p, m, "eta", 1, &index, &abbe));
    m->base.ior = (float)index;
    m->base.base_interreflection = (float)fmin(pbrt_inner_reflectance(index), 0.999);
    TRY(read_layers(p, m));
    return pbrt_put_roughness(p, m, &rough);
}

status pbrt_read_conductor(struct pbrt *p, struct pbrt_material *m, const char *prefix, double relative_to)
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
            k[i] = pbrt_k_of_reflectance(reflectance->value[i]);
        }
    else
        TRY(pbrt_read_metal(p, m, prefix, eta, k));
    for (int i = 0; i < 3; i++) {
        m->base.conductor_eta[i] = (float)(eta[i] / relative_to);
        m->base.conductor_k[i] = (float)(k[i] / relative_to);
    }
    return STATUS_OK;
}

static status read_plain_conductor(struct pbrt *p, struct pbrt_material *m)
{
    TRY(pbrt_read_conductor(p, m, "", 1));
    return pbrt_own_roughness(p, m, 0, 0);
}

static status read_coated_conductor(struct pbrt *p, struct pbrt_material *m)
{
    struct pbrt_roughness coat, metal;
    double index, abbe;

    TRY(pbrt_read_index(p, m, "interface.eta", 1, &index, &abbe));
    TRY(pbrt_read_conductor(p, m, "conductor.", index));
    TRY(pbrt_read_roughness(p, m, "interface.", 0, 0, &coat));
    TRY(pbrt_read_roughness(p, m, "conductor.", 0, 0, &metal));
    TRY(read_layers(p, m));
    m->base.clearcoat = 1;
    m->base.clearcoat_ior = (float)index;
    m->base.base_interreflection = (float)((index - 1) / (index + 1) * ((index - 1) / (index + 1)));
    TRY(pbrt_put_coat_roughness(p, m, &coat));
    return pbrt_put_roughness(p, m, &metal);
}

static status read_dielectric(struct pbrt *p, struct pbrt_material *m)
{
    double index, abbe;

    TRY(pbrt_read_index(p, m, "eta", PBRT_INDEX_MIN, &index, &abbe));
    pbrt_be_glass(m, index, abbe);
    return pbrt_own_roughness(p, m, 0, 0);
}

static status read_thin_dielectric(struct pbrt *p, struct pbrt_material *m)
{
    double index, abbe;

    TRY(pbrt_read_index(p, m, "eta", 1, &index, &abbe));
    pbrt_be_glass(m, index, 0);
    m->base.refractive = 0;
    m->base.thin_slab = 1;
    m->base.roughness = 0;
    return STATUS_OK;
}

status pbrt_put_two_sides(struct pbrt *p, struct pbrt_material *m, const struct pbrt_texture *r,
                          const struct pbrt_texture *t)
{
    const int constant = r->op == TEXTURE_CONSTANT && t->op == TEXTURE_CONSTANT;
    double rmax = 0, tmax = 0, w = 0.5;
    const struct pbrt_texture *to_r, *to_t;

    pbrt_be_matte(m);
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
    to_r = pbrt_constant(p, w < 1 ? 1 / (1 - w) : 0, w < 1 ? 1 / (1 - w) : 0, w < 1 ? 1 / (1 - w) : 0);
    to_t = pbrt_constant(p, w > 0 ? 1 / w : 0, w > 0 ? 1 / w : 0, w > 0 ? 1 / w : 0);
    m->base.diffuse_transmission = (float)w;
    m->color = pbrt_product(p, r, to_r);
    t = pbrt_product(p, t, to_t);
    return pbrt_color_slot(p, t, NULL, 1, m->base.diffuse_transmission_color,
                           &m->base.diffuse_transmission_color_texture);
}

static status read_diffuse_transmission(struct pbrt *p, struct pbrt_material *m)
{
    const struct pbrt_texture *r, *t, *scale;
    double s = pbrt_float(m->params, "scale", 1);

    TRY(pbrt_color_or(p, m, "reflectance", 0.25, &r));
    TRY(pbrt_color_or(p, m, "transmittance", 0.25, &t));
    scale = pbrt_constant(p, s, s, s);
    r = scale ? pbrt_product(p, r, scale) : NULL;
    t = scale ? pbrt_product(p, t, scale) : NULL;
    return pbrt_put_two_sides(p, m, r, t);
}

double pbrt_unchanged(double value, double unused UNUSED) { return value; }

static double one_minus(double value, double unused UNUSED) { return 1 - value; }

/* By "materials", pbrt-v4's, or else by pbrt-v3's two names. */
static int names_both(const struct pbrt_material *m, const struct pbrt_param **names)
{
    *names = pbrt_param(m->params, "materials", PBRT_BIT(PBRT_STRING));
    return *names && (*names)->string_count == 2;
}

int pbrt_mix_parts(const struct pbrt_material *m, const char *part[2])
{
    const struct pbrt_param *names;
    const int both = names_both(m, &names);

    part[0] = both ? names->strings[0] : pbrt_string(m->params, "namedmaterial1", NULL);
    part[1] = both ? names->strings[1] : pbrt_string(m->params, "namedmaterial2", NULL);
    return part[0] && part[1];
}

status pbrt_read_mix(struct pbrt *p, struct pbrt_material *m, unsigned depth)
{
    const struct pbrt_param *names;
    const struct pbrt_texture *amount;
    const char *name[2];
    const int version3 = !names_both(m, &names);

    if (!pbrt_mix_parts(m, name))
        return pbrt_fail(p, STATUS_ERR_INPUT, &m->at, "material \"%.60s\": a mix names two \"string materials\"",
                         m->name);
    if (version3)
        TRY(pbrt_color_or(p, m, "amount", 0.5, &amount));
    else
        TRY(pbrt_float_texture(p, m->params, "amount", &amount));
    if (!amount)
        amount = pbrt_constant(p, 0.5, 0.5, 0.5);
    if (amount->op == TEXTURE_CONSTANT &&
        (amount->value[0] != amount->value[1] || amount->value[0] != amount->value[2]))
        pbrt_warn(p, &m->at, "amount by colour",
                  "material \"%.60s\": a mix by a colour is not supported: the mean of its channels counts", m->name);
    m->base.kind = MATERIAL_MIX;
    for (int i = 0; i < 2; i++) {
        if (!m->mix[i])
            m->mix[i] = pbrt_name_find(&p->materials, name[i]);
        if (!m->mix[i] || !m->mix[i]->kind || m->mix[i] == m)
            return pbrt_fail(p, STATUS_ERR_INPUT, &m->at, "material \"%.60s\": its part \"%.60s\" is not known: define it%s",
                             m->name, name[i], p->version3 ? " above" : "");
        TRY(pbrt_material_resolve(p, m->mix[i], depth + 1));
    }
    /* In pbrt-v4 the amount is the share of the second material, in pbrt-v3 of the first. */
    return pbrt_scalar_slot(p, amount, version3 ? one_minus : pbrt_unchanged, 0, &m->base.mix_amount,
                            &m->base.mix_texture);
}

static status read_interface(struct pbrt *p UNUSED, struct pbrt_material *m)
{
    m->base.kind = MATERIAL_INTERFACE;
    return STATUS_OK;
}

const struct pbrt_kind pbrt_kinds_v4[] = {
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
    {NULL, NULL},
};
