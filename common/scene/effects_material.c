#include "common/scene/effects_material.h"

#include "common/scene/material.h"

void scene_material_reduce(struct scene_material *m, uint64_t without)
{
    if (!without)
        return;
    for (int i = 0; i < MATERIAL_VALUES; i++)
        if (material_values[i].effect & without)
            material_value_reset(m, &material_values[i]);
    for (int i = 0; i < MATERIAL_TEXTURES; i++)
        if ((without & EFFECT_TEXTURE) ||
            ((without & EFFECT_NORMAL_MAP) && material_textures[i].meaning == MEANS_NORMAL))
            m->textures[i].texture = -1;
}

/* Can the surface let a ray through by its alpha? And is it invisible everywhere? */
static int alpha_acts(const struct scene_material *m, const struct scene_mesh *mesh, int *invisible)
{
    int varies = material_has_texture(m, MATERIAL_TEXTURE_base_color) || (mesh->arrays & MESH_COLORS);
    float alpha = m->base_color[3];

    *invisible = 0;
    if (m->alpha_mode == ALPHA_OPAQUE)
        return 0;
    if (m->alpha_mode == ALPHA_MASK) {
        if (m->alpha_cutoff <= 0)
            return 0;
        /* Textures and vertex colours can only lower alpha. */
        *invisible = alpha < m->alpha_cutoff;
        return varies || *invisible;
    }
    *invisible = alpha == 0;
    return varies || alpha < 1;
}

/* A value that differs from its default needs its row's effect, with these exceptions. */
static uint64_t called_by_values(const struct scene_material *m)
{
    uint64_t set = 0;

    for (int i = 0; i < MATERIAL_VALUES; i++)
        if (material_values[i].effect && !material_value_is_default(m, &material_values[i]))
            set |= material_values[i].effect;
    set &= ~(EFFECT_ALPHA | EFFECT_MEDIUM); /* alpha_acts and the scene's media decide */
    if (!(m->roughness < 1))
        set &= ~EFFECT_ANISOTROPY; /* nothing to stretch */
    if (scene_color_is(m->diffuse_transmission_color, 0))
        set &= ~EFFECT_DIFFUSE_TRANSMISSION;
    if (!material_transmits(m) || !m->refractive)
        set &= ~(EFFECT_DISPERSION | EFFECT_ABSORPTION);
    if (scene_color_is(m->attenuation_color, 1))
        set &= ~EFFECT_ABSORPTION;
    return set;
}

/* Can a texture that lowers the roughness make a mirror somewhere? Filtering rounds: hence the hundredth. */
static int may_be_smooth(const struct scene_material *m, enum material_texture slot, float least)
{
    return material_has_texture(m, slot) && least < 1.01f * EFFECT_MIRROR_ROUGHNESS;
}

/* Lobes of a reflecting surface, by how rough it can be. A stretched mirror is rough along one
 * axis, if the mesh has tangents and the texture stretches it. */
static uint64_t by_roughness(const struct scene_material *m, uint64_t smooth, uint64_t rough)
{
    if (m->roughness < EFFECT_MIRROR_ROUGHNESS)
        return m->anisotropy > 0 ? smooth | rough : smooth;
    return may_be_smooth(m, MATERIAL_TEXTURE_metallic_roughness, m->least_roughness) ? smooth | rough : rough;
}

static uint64_t coat_lobes(const struct scene_material *m)
{
    uint64_t set = 0;

    if (m->clearcoat_roughness < EFFECT_MIRROR_ROUGHNESS ||
        may_be_smooth(m, MATERIAL_TEXTURE_clearcoat_roughness, m->clearcoat_least_roughness))
        set |= EFFECT_MIRROR;
    if (m->clearcoat_roughness >= EFFECT_MIRROR_ROUGHNESS)
        set |= EFFECT_GLOSSY;
    return set;
}

static uint64_t transmission_lobes(const struct scene_material *m)
{
    uint64_t set;

    if (!m->refractive)
        return EFFECT_THIN_TRANSMISSION;
    /* From inside there is total reflection for any `specular`. */
    set = by_roughness(m, EFFECT_MIRROR | EFFECT_DIELECTRIC, EFFECT_GLOSSY | EFFECT_ROUGH_DIELECTRIC);
    /* Without a change of index there is no blur. */
    return m->ior == 1 ? set | EFFECT_DIELECTRIC : set;
}

/* Metal, plastic and glass. */
static uint64_t base_lobes(const struct scene_material *m)
{
    int all_transmission = m->transmission == 1 && !material_has_texture(m, MATERIAL_TEXTURE_transmission);
    uint64_t set = 0;

    if (m->metallic > 0)
        set |= by_roughness(m, EFFECT_MIRROR, EFFECT_GLOSSY);
    if (material_role_of(m) == ROLE_METAL)
        return set;
    if (!all_transmission && !scene_color_is(m->base_color, 0))
        set |= EFFECT_DIFFUSE;
    if (m->specular > 0)
        set |= by_roughness(m, EFFECT_MIRROR, EFFECT_GLOSSY);
    return material_transmits(m) ? set | transmission_lobes(m) : set;
}

static uint64_t lobes(const struct scene_material *m)
{
    uint64_t set;

    switch (material_role_of(m)) {
    case ROLE_UNLIT: return EFFECT_UNLIT;
    case ROLE_INTERFACE: return EFFECT_INTERFACE;
    case ROLE_CONDUCTOR: set = EFFECT_CONDUCTOR | by_roughness(m, EFFECT_MIRROR, EFFECT_GLOSSY); break;
    default: set = base_lobes(m);
    }
    set |= called_by_values(m);
    if (!(set & EFFECT_DIFFUSE))
        set &= ~EFFECT_ROUGH_DIFFUSE; /* no base that could be rough */
    return set & EFFECT_CLEARCOAT ? set | coat_lobes(m) : set;
}

/* The effects of all values that the texture acts on or needs: without one of them it has no effect. */
static uint64_t texture_serves(const struct material_texture_row *row)
{
    uint64_t set = row->needs == MATERIAL_ALONE ? 0 : material_values[row->needs].effect;

    for (int i = 0; i < row->parts; i++)
        set |= material_values[row->part[i].value].effect;
    return set;
}

/* Textures that can change what the lobes do. */
static uint64_t textures(const struct scene_material *m, const struct scene_mesh *mesh, uint64_t set)
{
    uint64_t found = 0;

    for (int i = 0; i < MATERIAL_TEXTURES; i++) {
        const struct material_texture_row *row = &material_textures[i];
        int normal = row->meaning == MEANS_NORMAL;

        if (!material_has_texture(m, i) || (texture_serves(row) & ~set) ||
            (normal && (!(mesh->arrays & MESH_TANGENTS) || set == 0)))
            continue;
        found |= normal ? EFFECT_TEXTURE | EFFECT_NORMAL_MAP : EFFECT_TEXTURE;
    }
    return found;
}

void effects_of_material(const struct scene_material *m, const struct scene_mesh *mesh, struct material_effects *out)
{
    int alpha = alpha_acts(m, mesh, &out->invisible);
    uint64_t set = lobes(m);

    set |= textures(m, mesh, set);
    if ((mesh->arrays & MESH_COLORS) && (alpha || !scene_color_is(m->base_color, 0)))
        set |= EFFECT_VERTEX_COLOR;
    if (alpha)
        set |= EFFECT_ALPHA;
    if (set & (EFFECT_GLOSSY | EFFECT_ROUGH_DIELECTRIC))
        set |= EFFECT_MULTIPLE_SCATTERING;
    /* This is all that a ray can see of an invisible material. */
    out->set = out->invisible ? EFFECT_ALPHA : set;
    out->transmits = material_transmits(m);
    out->bounds_volume = m->kind == MATERIAL_INTERFACE || (out->transmits && m->refractive);
}
