/* Materials of a packed scene. */
#include "common/scene/scene_unpack_parts.h"

static status unpack_anisotropy(struct scene_reader *r, const Azulejo__Scene__Anisotropy *m,
                                struct scene_material *to)
{
    if (!m)
        return STATUS_OK; /* here and below: as scene_material_default left it */
    KNOWN_FIELDS("an anisotropy")
    to->anisotropy = m->strength;
    to->anisotropy_rotation_rad = m->rotation_rad;
    return unpack_slot(r, m->texture, &to->anisotropy_texture);
}

static status unpack_clearcoat(struct scene_reader *r, const Azulejo__Scene__Clearcoat *m,
                               struct scene_material *to)
{
    if (!m)
        return STATUS_OK;
    KNOWN_FIELDS("a clearcoat")
    to->clearcoat = m->weight;
    TAKE(unpack_slot(r, m->texture, &to->clearcoat_texture));
    to->clearcoat_roughness = m->roughness;
    TAKE(unpack_slot(r, m->roughness_texture, &to->clearcoat_roughness_texture));
    to->clearcoat_ior = m->ior;
    to->clearcoat_normal_scale = m->normal_scale;
    return unpack_slot(r, m->normal_texture, &to->clearcoat_normal_texture);
}

static status unpack_sheen(struct scene_reader *r, const Azulejo__Scene__Sheen *m,
                           struct scene_material *to)
{
    if (!m)
        return STATUS_OK;
    KNOWN_FIELDS("a sheen")
    TAKE_FLOATS(color, to->sheen_color, 3);
    TAKE(unpack_slot(r, m->color_texture, &to->sheen_color_texture));
    to->sheen_roughness = m->roughness;
    return unpack_slot(r, m->roughness_texture, &to->sheen_roughness_texture);
}

static status unpack_iridescence(struct scene_reader *r, const Azulejo__Scene__Iridescence *m,
                                 struct scene_material *to)
{
    if (!m)
        return STATUS_OK;
    KNOWN_FIELDS("an iridescence")
    to->iridescence = m->weight;
    TAKE(unpack_slot(r, m->texture, &to->iridescence_texture));
    to->iridescence_ior = m->ior;
    to->iridescence_thickness_min_nm = m->thickness_min_nm;
    to->iridescence_thickness_max_nm = m->thickness_max_nm;
    return unpack_slot(r, m->thickness_texture, &to->iridescence_thickness_texture);
}

static status unpack_diffuse(struct scene_reader *r, const Azulejo__Scene__DiffuseTransmission *m,
                             struct scene_material *to)
{
    if (!m)
        return STATUS_OK;
    KNOWN_FIELDS("a diffuse transmission")
    to->diffuse_transmission = m->weight;
    TAKE(unpack_slot(r, m->texture, &to->diffuse_transmission_texture));
    TAKE_FLOATS(color, to->diffuse_transmission_color, 3);
    return unpack_slot(r, m->color_texture, &to->diffuse_transmission_color_texture);
}

static status unpack_conductor(struct scene_reader *r, const Azulejo__Scene__Conductor *m,
                               struct scene_material *to)
{
    if (!m)
        return STATUS_OK;
    KNOWN_FIELDS("a conductor")
    TAKE_FLOATS(eta, to->conductor_eta, 3);
    TAKE_FLOATS(k, to->conductor_k, 3);
    return STATUS_OK;
}

static status unpack_mix(struct scene_reader *r, const Azulejo__Scene__Mix *m,
                         struct scene_material *to)
{
    if (!m)
        return STATUS_OK;
    KNOWN_FIELDS("a mix")
    to->mix_material[0] = m->first;
    to->mix_material[1] = m->second;
    to->mix_amount = m->amount;
    return unpack_slot(r, m->texture, &to->mix_texture);
}

status unpack_material(struct scene_reader *r, const ProtobufCMessage *message, uint32_t row)
{
    const Azulejo__Scene__Material *m = (const Azulejo__Scene__Material *)message;
    struct scene_material *to = &r->scene->materials[row];

    scene_material_default(to);
    TAKE(unpack_name(r, m->name, &to->name));
    to->unlit = m->unlit != 0;
    to->double_sided = m->double_sided != 0;
    if (m->alpha_mode >= ALPHA_COUNT)
        return unpack_damaged(r, "a material's alpha mode is unknown");
    to->alpha_mode = (enum scene_alpha_mode)m->alpha_mode;
    to->alpha_cutoff = m->alpha_cutoff;
    TAKE_FLOATS(base_color, to->base_color, 4);
    TAKE(unpack_slot(r, m->base_color_texture, &to->base_color_texture));
    to->metallic = m->metallic;
    to->roughness = m->roughness;
    TAKE(unpack_slot(r, m->metallic_roughness_texture, &to->metallic_roughness_texture));
    to->normal_scale = m->normal_scale;
    TAKE(unpack_slot(r, m->normal_texture, &to->normal_texture));
    TAKE_FLOATS(emission, to->emission, 3);
    TAKE(unpack_slot(r, m->emission_texture, &to->emission_texture));
    to->ior = m->ior;
    to->specular = m->specular;
    TAKE(unpack_slot(r, m->specular_texture, &to->specular_texture));
    TAKE_FLOATS(specular_color, to->specular_color, 3);
    TAKE(unpack_slot(r, m->specular_color_texture, &to->specular_color_texture));
    to->transmission = m->transmission;
    TAKE(unpack_slot(r, m->transmission_texture, &to->transmission_texture));
    to->refractive = m->refractive != 0;
    TAKE_FLOATS(attenuation_color, to->attenuation_color, 3);
    to->attenuation_distance = m->attenuation_distance;
    if (m->kind >= MATERIAL_KIND_COUNT)
        return unpack_damaged(r, "a material's kind is unknown");
    to->kind = (enum scene_material_kind)m->kind;
    TAKE(unpack_anisotropy(r, m->anisotropy, to));
    TAKE(unpack_clearcoat(r, m->clearcoat, to));
    TAKE(unpack_sheen(r, m->sheen, to));
    TAKE(unpack_iridescence(r, m->iridescence, to));
    TAKE(unpack_diffuse(r, m->diffuse_transmission, to));
    to->dispersion = m->dispersion;
    TAKE(unpack_conductor(r, m->conductor, to));
    to->base_interreflection = m->base_interreflection;
    to->thin_slab = m->thin_slab != 0;
    to->priority = m->priority;
    TAKE(unpack_index(r, "a material's medium", m->medium, SCENE_MEDIA_MAX, &to->medium));
    TAKE(unpack_index(r, "a material's medium_outside", m->medium_outside, SCENE_MEDIA_MAX,
                      &to->medium_outside));
    return unpack_mix(r, m->mix, to);
}
