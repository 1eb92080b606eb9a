/* Constant textures into factors, and alpha that is 1 everywhere into none. */
#include "common/scene/simplify_parts.h"

static float *factor_at(struct scene_material *m, size_t offset)
{
    return (float *)(void *)((char *)m + offset);
}

static int is_srgb(const struct scene_texture *texture, int srgb)
{
    return texture->encoding == ENCODING_BY_SLOT ? srgb : texture->encoding == ENCODING_SRGB;
}

/* Outside of the image it would be black. */
static int has_border(const struct scene_texture *texture)
{
    return texture->wrap_u == WRAP_BLACK || texture->wrap_v == WRAP_BLACK;
}

/* Does the renderer read this factor at all? */
static int part_acts(const struct scene_material *m, size_t factor)
{
    if (factor == AT(base_color[3]))
        return m->alpha_mode != ALPHA_OPAQUE;
    if (factor == AT(metallic))
        return m->kind != MATERIAL_CONDUCTOR;
    return 1;
}

/* What is known of the slot's texture; *s is NULL where there is none that could be folded. */
static status survey_foldable(struct simplifier *w, const struct scene_texture_slot *slot,
                              const struct scene_texture **texture, const struct survey **s)
{
    status st;

    *s = NULL;
    *texture = NULL;
    if (slot->texture < 0)
        return STATUS_OK;
    *texture = &w->scene->textures[slot->texture];
    st = simplify_survey(w, slot, s);
    if (st != STATUS_OK || has_border(*texture))
        *s = NULL;
    return st;
}

/* The factors say all that the texture said. */
static status fold(struct simplifier *w, struct scene_texture_slot *slot)
{
    slot->texture = -1;
    w->report->folded++;
    return STATUS_OK;
}

status simplify_fold_rule(struct simplifier *w, struct scene_material *m,
                          const struct simplify_rule *rule)
{
    struct scene_texture_slot *slot = simplify_slot_at(m, rule->slot);
    const struct scene_texture *texture;
    float product[CHANNELS];
    const struct survey *s;
    status st = survey_foldable(w, slot, &texture, &s);

    if (!s)
        return st;
    for (int i = 0; i < rule->parts; i++) {
        float factor = *factor_at(m, rule->part[i].factor);
        int channel = rule->part[i].channel;

        product[i] = factor;
        if (factor == 0 || !part_acts(m, rule->part[i].factor))
            continue;
        if (!survey_is_constant(s, channel))
            return STATUS_OK;
        product[i] = factor * survey_constant(s, channel, is_srgb(texture, rule->srgb));
        if (!(product[i] <= rule->most))
            return STATUS_OK;
    }
    for (int i = 0; i < rule->parts; i++)
        *factor_at(m, rule->part[i].factor) = product[i];
    return fold(w, slot);
}

static status fold_normal(struct simplifier *w, struct scene_texture_slot *slot)
{
    const struct scene_texture *texture;
    const struct survey *s;
    status st = survey_foldable(w, slot, &texture, &s);

    if (!s || is_srgb(texture, 0) || !survey_is_flat(s))
        return st;
    slot->texture = -1;
    w->report->flat_normals++;
    return STATUS_OK;
}

/* The strength alone, where the direction is exactly the tangent's, or does not matter. */
static status fold_anisotropy(struct simplifier *w, struct scene_material *m)
{
    struct scene_texture_slot *slot = &m->anisotropy_texture;
    const struct scene_texture *texture;
    float x, y, strength;
    const struct survey *s;
    status st = survey_foldable(w, slot, &texture, &s);
    int srgb;

    if (!s || !survey_is_constant(s, BLUE))
        return st;
    srgb = is_srgb(texture, 0);
    strength = m->anisotropy * survey_constant(s, BLUE, srgb);
    if (strength != 0) {
        if (!survey_is_constant(s, RED) || !survey_is_constant(s, GREEN) || !(strength <= 1))
            return STATUS_OK;
        x = survey_constant(s, RED, srgb) * 2 - 1;
        y = survey_constant(s, GREEN, srgb) * 2 - 1;
        if (x != 1 || y != 0)
            return STATUS_OK;
    }
    m->anisotropy = strength;
    return fold(w, slot);
}

static status fold_thickness(struct simplifier *w, struct scene_material *m)
{
    struct scene_texture_slot *slot = &m->iridescence_thickness_texture;
    const struct scene_texture *texture;
    const struct survey *s;
    float thickness;
    status st = survey_foldable(w, slot, &texture, &s);

    if (!s || !survey_is_constant(s, GREEN))
        return st;
    thickness = m->iridescence_thickness_min_nm +
                (m->iridescence_thickness_max_nm - m->iridescence_thickness_min_nm) *
                    survey_constant(s, GREEN, is_srgb(texture, 0));
    if (!(thickness >= 0 && thickness <= 1e9f))
        return STATUS_OK;
    m->iridescence_thickness_min_nm = m->iridescence_thickness_max_nm = thickness;
    return fold(w, slot);
}

status simplify_fold(struct simplifier *w, struct scene_material *m)
{
    status st = STATUS_OK;

    for (int i = 0; i < SIMPLIFY_RULES && st == STATUS_OK; i++)
        st = simplify_fold_rule(w, m, &simplify_rules[i]);
    if (st == STATUS_OK)
        st = fold_normal(w, &m->normal_texture);
    if (st == STATUS_OK)
        st = fold_normal(w, &m->clearcoat_normal_texture);
    if (st == STATUS_OK)
        st = fold_anisotropy(w, m);
    if (st == STATUS_OK)
        st = fold_thickness(w, m);
    return st;
}

status simplify_make_opaque(struct simplifier *w, uint32_t index)
{
    struct scene_material *m = &w->scene->materials[index];
    struct scene_texture_slot *slot = &m->base_color_texture;
    int always = m->alpha_mode == ALPHA_MASK && m->alpha_cutoff <= 0;
    int one = m->base_color[3] == 1 && !w->alpha_colors[index];

    if (m->alpha_mode == ALPHA_OPAQUE)
        return STATUS_OK;
    if (slot->texture >= 0 && !always) {
        const struct survey *s;
        status st = simplify_survey(w, slot, &s);

        if (st != STATUS_OK)
            return st;
        one = one && !has_border(&w->scene->textures[slot->texture]) &&
              survey_is_constant(s, ALPHA) && survey_constant(s, ALPHA, 0) == 1;
    } else if (m->alpha_mode == ALPHA_MASK && !w->alpha_colors[index]) {
        always = always || m->base_color[3] >= m->alpha_cutoff;
    }
    if (!always && !(one && (m->alpha_mode == ALPHA_BLEND || m->alpha_cutoff <= 1)))
        return STATUS_OK;
    m->alpha_mode = ALPHA_OPAQUE;
    w->report->made_opaque++;
    return STATUS_OK;
}
