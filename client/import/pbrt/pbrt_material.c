/* Materials: resolves Material directives, and makes the rows for their shapes. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "client/import/pbrt/pbrt_material_parts.h"
#include "client/terminal/must.h"
#include "common/math/elementary.h"

/* A finished row: a material as one kind of shape needs it. */
struct pbrt_variant {
    struct pbrt_variant *next;
    const struct pbrt_material *material;
    const struct pbrt_area_light *light;
    const struct pbrt_texture *alpha;
    double area;
    int32_t medium, medium_outside;
    int one_sided;
    uint32_t row;
};

static const struct pbrt_kind *kind_find(const char *name)
{
    static const struct pbrt_kind *const lists[] = {pbrt_kinds_v4, pbrt_kinds_v3};

    for (size_t i = 0; i < sizeof lists / sizeof *lists; i++)
        for (const struct pbrt_kind *kind = lists[i]; kind->kind; kind++)
            if (strcmp(kind->kind, name) == 0)
                return kind;
    return NULL;
}

static void refuse_kind(struct pbrt *p, struct pbrt_material *m)
{
    char kind[128];

    snprintf(kind, sizeof kind, "material %.60s", m->kind);
    pbrt_warn(p, &m->at, kind, "material \"%.60s\": the kind \"%.60s\" is not supported: matte grey instead", m->name,
              m->kind);
    for (size_t i = 0; i < m->params->count; i++)
        m->params->items[i].used = 1;
    pbrt_be_matte(m);
    m->color = pbrt_constant(p, 0.5, 0.5, 0.5);
}

/* ---- what all kinds share ----------------------------------------------------------------- */

static status read_relief(struct pbrt *p, struct pbrt_material *m)
{
    static const char *const bumps[] = {"displacement", "bumpmap"}; /* pbrt-v4's and pbrt-v3's */
    const char *name = pbrt_string(m->params, "normalmap", NULL);
    struct pbrt_image *image;

    for (int i = 0; i < 2; i++)
        if (pbrt_param(m->params, bumps[i], ~0u))
            pbrt_warn(p, &m->at, bumps[i], "material \"%.60s\": bump mapping (\"%s\") is not supported: smooth", m->name, bumps[i]);
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
    const struct pbrt_kind *kind;
    char what[128];

    if (m->resolved)
        return STATUS_OK;
    if (!m->kind)
        return pbrt_fail(p, STATUS_ERR_INPUT, &m->at,
                         "the material \"%.80s\" is not known: define it with MakeNamedMaterial", m->name);
    if (depth > PBRT_MATERIAL_DEPTH_MAX)
        return pbrt_fail(p, STATUS_ERR_LIMIT, &m->at, "materials are mixed more than %d deep", PBRT_MATERIAL_DEPTH_MAX);
    scene_material_default(&m->base);
    m->base.name = builder_name(p->b, m->name);
    m->base.double_sided = 1;
    kind = kind_find(m->kind);
    if (kind)
        TRY(kind->read(p, m));
    else if (strcmp(m->kind, "mix") == 0)
        TRY(pbrt_read_mix(p, m, depth));
    else
        refuse_kind(p, m);
    TRY(read_relief(p, m));
    (void)pbrt_string(m->params, "type", NULL);
    snprintf(what, sizeof what, "material \"%.60s\"", m->kind);
    pbrt_params_report(m->is_derived ? m->params->defaults : m->params, p->b, what);
    m->resolved = 1;
    return STATUS_OK;
}

static int slot_used(const struct scene_texture_slot *slot) { return slot->texture >= 0; }

/* Resolved mixes have no cycles, and are at most PBRT_MATERIAL_DEPTH_MAX deep; `left` bounds the
 * walk if the same part is reached in many ways. */
static int any_part(const struct pbrt_material *m, int (*asks)(const struct pbrt_material *), int *left)
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

static int asks_tangents(const struct pbrt_material *m) { return m->wants_tangents; }

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
    }
    if (!color)
        color = m->color = pbrt_constant(p, 1, 1, 1);
    if (cut && cut->op == TEXTURE_CONSTANT) {
        double a = (cut->value[0] + cut->value[1] + cut->value[2]) / 3;
        out->base_color[3] = (float)fmin(fmax(a, 0), 1);
        if (out->base_color[3] < 1)
            out->alpha_mode = ALPHA_BLEND;
        cut = NULL;
    }
    if (!cut) {
        if (!m->color_in_slot)
            TRY(pbrt_color_slot(p, color, NULL, 1, m->base.base_color, &m->base.base_color_texture));
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
        return pbrt_image_slot(p, light->image, ENCODING_BY_SLOT, WRAP_CLAMP, 1, &out->emission_texture);
    return STATUS_OK;
}

static int lets_through(const struct scene_material *m)
{
    return m->kind == MATERIAL_INTERFACE || m->kind == MATERIAL_MIX ||
           (m->kind == MATERIAL_SURFACE && (m->transmission > 0 || m->diffuse_transmission > 0));
}

static status make_row(struct pbrt *p, const struct pbrt_surface *s, unsigned depth, uint32_t *row);

static status find_or_make(struct pbrt *p, const struct pbrt_surface *s, unsigned depth, uint32_t *row)
{
    struct pbrt_variant **list = s->light ? &s->light->variants : &s->material->variants, *v;
    double area = s->light && s->light->power > 0 ? s->area : 0;

    for (v = *list; v; v = v->next)
        if (v->material == s->material && v->light == s->light && v->alpha == s->alpha &&
            v->medium == s->medium && v->medium_outside == s->medium_outside && v->one_sided == s->one_sided && v->area == area) {
            *row = v->row;
            return STATUS_OK;
        }
    TRY(make_row(p, s, depth, row));
    v = must(ARENA_NEW(&p->arena, struct pbrt_variant));
    *v = (struct pbrt_variant){*list,     s->material,       s->light,     s->alpha, area,
                               s->medium, s->medium_outside, s->one_sided, *row};
    *list = v;
    return STATUS_OK;
}

static status make_row(struct pbrt *p, const struct pbrt_surface *s, unsigned depth, uint32_t *row)
{
    struct pbrt_material *m = s->material;
    struct scene_material out;

    if (depth > PBRT_MATERIAL_DEPTH_MAX)
        return pbrt_fail(p, STATUS_ERR_LIMIT, &m->at, "materials are mixed more than %d deep", PBRT_MATERIAL_DEPTH_MAX);
    TRY(put_color(p, m, s->alpha, &out));
    TRY(put_light(p, s, &out));
    if (lets_through(&out)) {
        out.medium = s->medium;
        out.medium_outside = s->medium_outside;
    }
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
