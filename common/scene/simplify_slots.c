/* The texture slots of a material: which there are, and which cannot act. */
#include "common/scene/simplify_parts.h"

#define RGB(field) {{AT(field[0]), RED}, {AT(field[1]), GREEN}, {AT(field[2]), BLUE}}

const struct simplify_rule simplify_rules[SIMPLIFY_RULES] = {
    {AT(base_color_texture), 1, 1, 4,
     {{AT(base_color[0]), RED}, {AT(base_color[1]), GREEN}, {AT(base_color[2]), BLUE},
      {AT(base_color[3]), ALPHA}}},
    {AT(metallic_roughness_texture), 0, 1, 2, {{AT(roughness), GREEN}, {AT(metallic), BLUE}}},
    {AT(emission_texture), 1, 1e30f, 3, RGB(emission)},
    {AT(specular_texture), 0, 1, 1, {{AT(specular), ALPHA}}},
    {AT(specular_color_texture), 1, 1e30f, 3, RGB(specular_color)},
    {AT(transmission_texture), 0, 1, 1, {{AT(transmission), RED}}},
    {AT(clearcoat_texture), 0, 1, 1, {{AT(clearcoat), RED}}},
    {AT(clearcoat_roughness_texture), 0, 1, 1, {{AT(clearcoat_roughness), GREEN}}},
    {AT(sheen_color_texture), 1, 1, 3, RGB(sheen_color)},
    {AT(sheen_roughness_texture), 0, 1, 1, {{AT(sheen_roughness), ALPHA}}},
    {AT(iridescence_texture), 0, 1, 1, {{AT(iridescence), RED}}},
    {AT(diffuse_transmission_texture), 0, 1, 1, {{AT(diffuse_transmission), ALPHA}}},
    {AT(diffuse_transmission_color_texture), 1, 1, 3, RGB(diffuse_transmission_color)},
    {AT(mix_texture), 0, 1, 1, {{AT(mix_amount), RED}}},
};
/* The others. */
static const size_t special_slots[] = {AT(normal_texture), AT(clearcoat_normal_texture),
                                       AT(anisotropy_texture), AT(iridescence_thickness_texture)};
_Static_assert(SIMPLIFY_RULES + sizeof special_slots / sizeof *special_slots == SIMPLIFY_SLOTS,
               "every slot is counted");

struct scene_texture_slot *simplify_slot_at(struct scene_material *m, size_t offset)
{
    return (struct scene_texture_slot *)(void *)((char *)m + offset);
}

struct scene_texture_slot *simplify_slot(struct scene_material *m, int i)
{
    return simplify_slot_at(m, i < SIMPLIFY_RULES ? simplify_rules[i].slot
                                                  : special_slots[i - SIMPLIFY_RULES]);
}

static int is_black(const float color[3])
{
    return color[0] == 0 && color[1] == 0 && color[2] == 0;
}

static void drop(struct simplifier *w, struct scene_texture_slot *slot)
{
    if (slot->texture < 0)
        return;
    slot->texture = -1;
    w->report->unseen++;
}

static void drop_dielectric(struct simplifier *w, struct scene_material *m)
{
    drop(w, &m->specular_texture);
    drop(w, &m->specular_color_texture);
    drop(w, &m->transmission_texture);
    drop(w, &m->diffuse_transmission_texture);
    drop(w, &m->diffuse_transmission_color_texture);
}

/* What neither metals by their index nor surfaces without light of their own have. */
static void drop_layers(struct simplifier *w, struct scene_material *m)
{
    drop_dielectric(w, m);
    drop(w, &m->sheen_color_texture);
    drop(w, &m->sheen_roughness_texture);
    drop(w, &m->iridescence_texture);
    drop(w, &m->iridescence_thickness_texture);
}

static void drop_clearcoat(struct simplifier *w, struct scene_material *m)
{
    drop(w, &m->clearcoat_texture);
    drop(w, &m->clearcoat_roughness_texture);
    drop(w, &m->clearcoat_normal_texture);
}

/* A factor of 0 is 0 whatever its texture, and so are the weights that it scales. */
static void drop_weightless(struct simplifier *w, struct scene_material *m)
{
    if (is_black(m->base_color) && (m->alpha_mode == ALPHA_OPAQUE || m->base_color[3] == 0))
        drop(w, &m->base_color_texture);
    if (m->roughness == 0 && m->metallic == 0)
        drop(w, &m->metallic_roughness_texture);
    if (m->normal_scale == 0)
        drop(w, &m->normal_texture);
    if (is_black(m->emission))
        drop(w, &m->emission_texture);
    if (m->specular == 0) {
        drop(w, &m->specular_texture);
        drop(w, &m->specular_color_texture);
    }
    if (is_black(m->specular_color))
        drop(w, &m->specular_color_texture);
    if (m->transmission == 0)
        drop(w, &m->transmission_texture);
    if (m->anisotropy == 0)
        drop(w, &m->anisotropy_texture);
    if (m->clearcoat == 0)
        drop_clearcoat(w, m);
    if (m->clearcoat_roughness == 0)
        drop(w, &m->clearcoat_roughness_texture);
    if (m->clearcoat_normal_scale == 0)
        drop(w, &m->clearcoat_normal_texture);
    if (is_black(m->sheen_color)) {
        drop(w, &m->sheen_color_texture);
        drop(w, &m->sheen_roughness_texture);
    }
    if (m->sheen_roughness == 0)
        drop(w, &m->sheen_roughness_texture);
    if (m->iridescence == 0) {
        drop(w, &m->iridescence_texture);
        drop(w, &m->iridescence_thickness_texture);
    }
    if (m->iridescence_thickness_min_nm == m->iridescence_thickness_max_nm)
        drop(w, &m->iridescence_thickness_texture);
    if (m->diffuse_transmission == 0) {
        drop(w, &m->diffuse_transmission_texture);
        drop(w, &m->diffuse_transmission_color_texture);
    }
    if (is_black(m->diffuse_transmission_color))
        drop(w, &m->diffuse_transmission_color_texture);
    if (m->mix_amount == 0)
        drop(w, &m->mix_texture);
}

void simplify_drop_unseen(struct simplifier *w, struct scene_material *m)
{
    switch (m->kind) {
    case MATERIAL_INTERFACE:
        for (int i = 0; i < SIMPLIFY_SLOTS; i++)
            drop(w, simplify_slot(m, i));
        return;
    case MATERIAL_CONDUCTOR:
        drop_layers(w, m);
        if (m->roughness == 0)
            drop(w, &m->metallic_roughness_texture);
        break;
    case MATERIAL_SURFACE:
        if (m->metallic == 1 && m->metallic_roughness_texture.texture < 0)
            drop_dielectric(w, m);
        break;
    default:
        break;
    }
    if (m->kind != MATERIAL_MIX)
        drop(w, &m->mix_texture);
    if (m->unlit && m->kind == MATERIAL_SURFACE) {
        drop_layers(w, m);
        drop_clearcoat(w, m);
        drop(w, &m->metallic_roughness_texture);
        drop(w, &m->anisotropy_texture);
    }
    drop_weightless(w, m);
}
