/* glTF: materials, without what extensions add (gltf_extensions.c). */
#include <string.h>

#include "client/import/gltf/gltf.h"

static status read_pbr(struct gltf *g, json_t *in, const struct gltf_place *at, struct scene_material *m)
{
    const struct gltf_place inner = gltf_within(at, ".pbrMetallicRoughness");
    json_t *pbr = NULL;

    TRY(gltf_object(g, in, at, "pbrMetallicRoughness", &pbr));
    if (!pbr)
        return STATUS_OK;
    TRY(gltf_color(g, pbr, &inner, "baseColorFactor", 4, 1, m->base_color));
    TRY(gltf_slot(g, pbr, &inner, "baseColorTexture", &m->base_color_texture, NULL));
    if (m->unlit)
        return STATUS_OK;
    TRY(gltf_factor(g, pbr, &inner, "metallicFactor", 1, &m->metallic));
    TRY(gltf_factor(g, pbr, &inner, "roughnessFactor", 1, &m->roughness));
    return gltf_slot(g, pbr, &inner, "metallicRoughnessTexture", &m->metallic_roughness_texture, NULL);
}

static status read_emission(struct gltf *g, json_t *in, const struct gltf_place *at, struct scene_material *m)
{
    json_t *extension = gltf_extension(in, "KHR_materials_emissive_strength");
    const struct gltf_place inner = gltf_within(at, ".KHR_materials_emissive_strength");
    json_t *texture;
    float strength = 1;

    TRY(gltf_color(g, in, at, "emissiveFactor", 3, 1e15, m->emission));
    if (extension)
        TRY(gltf_factor(g, extension, &inner, "emissiveStrength", 1e15, &strength));
    for (int i = 0; i < 3; i++)
        m->emission[i] *= strength;
    if (m->emission[0] == 0 && m->emission[1] == 0 && m->emission[2] == 0)
        return STATUS_OK; /* black times any texture is black */
    TRY(gltf_slot(g, in, at, "emissiveTexture", &m->emission_texture, &texture));
    if (texture && m->emission_texture.texture < 0)
        memset(m->emission, 0, sizeof m->emission); /* it may say which small part glows */
    return STATUS_OK;
}

static status read_alpha(struct gltf *g, json_t *in, const struct gltf_place *at, struct scene_material *m)
{
    const char *mode = "OPAQUE";

    TRY(gltf_text(g, in, at, "alphaMode", &mode));
    if (strcmp(mode, "MASK") == 0)
        m->alpha_mode = ALPHA_MASK;
    else if (strcmp(mode, "BLEND") == 0)
        m->alpha_mode = ALPHA_BLEND;
    else if (strcmp(mode, "OPAQUE") != 0)
        builder_warn(g->b, "alpha mode", "materials[%zu]: alphaMode \"%.32s\" is unknown: opaque", at->row, mode);
    return gltf_factor(g, in, at, "alphaCutoff", 1e6, &m->alpha_cutoff);
}

static status read_material(struct gltf *g, size_t index, struct scene_material *m)
{
    const struct gltf_place at = gltf_at("materials", index, "");
    const char *name = "";
    json_t *in, *old;

    TRY(gltf_row(g, g->materials, &at, &in));
    TRY(gltf_text(g, in, &at, "name", &name));
    m->name = builder_name(g->b, name);
    m->unlit = gltf_extension(in, "KHR_materials_unlit") != NULL;
    TRY(gltf_flag(g, in, &at, "doubleSided", &m->double_sided));
    TRY(read_alpha(g, in, &at, m));
    old = gltf_extension(in, "KHR_materials_pbrSpecularGlossiness");
    if (old && !m->unlit)
        TRY(gltf_specular_glossiness(g, old, &at, m));
    else
        TRY(read_pbr(g, in, &at, m));
    if (m->unlit)
        return STATUS_OK; /* nothing below is seen */
    TRY(gltf_normal_slot(g, in, &at, "normalTexture", &m->normal_texture, &m->normal_scale));
    TRY(read_emission(g, in, &at, m));
    return gltf_material_extensions(g, in, &at, m);
}

status gltf_material(struct gltf *g, int64_t index, uint32_t *row)
{
    size_t slot = index < 0 ? json_array_size(g->materials) : (size_t)index;
    struct scene_material material;

    if (g->material_rows[slot] == GLTF_ROW_UNREAD) {
        uint32_t added;
        scene_material_default(&material);
        if (index >= 0)
            TRY(read_material(g, (size_t)index, &material));
        else
            material.name = builder_name(g->b, "default");
        TRY(builder_add_material(g->b, &material, &added));
        g->material_rows[slot] = added;
    }
    *row = (uint32_t)g->material_rows[slot];
    return STATUS_OK;
}
