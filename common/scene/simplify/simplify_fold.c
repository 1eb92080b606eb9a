/* Drops textures without effect, turns constant ones into factors, and removes alpha that is 1 everywhere. */
#include "common/scene/simplify/simplify_parts.h"

#include <math.h>

void simplify_drop_unseen(struct simplifier *w, struct scene_material *m)
{
    for (int i = 0; i < MATERIAL_TEXTURES; i++)
        if (m->textures[i].texture >= 0 && !material_texture_acts(m, i)) {
            m->textures[i].texture = -1;
            w->report->unseen++;
        }
}

static int is_srgb(const struct scene_texture *texture, int srgb)
{
    return texture->encoding == ENCODING_BY_SLOT ? srgb : texture->encoding == ENCODING_SRGB;
}

/* Outside the image it would be black. */
static int has_border(const struct scene_texture *texture)
{
    return texture->wrap_u == WRAP_BLACK || texture->wrap_v == WRAP_BLACK;
}

/* What is known of the slot's texture; *s is NULL if there is none that could be folded. */
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

/* The factors now contain what the texture said. */
static status fold(struct simplifier *w, struct scene_texture_slot *slot)
{
    slot->texture = -1;
    w->report->folded++;
    return STATUS_OK;
}

/* Multiply the factors by the textures' constants, if all of them stay in range. */
static status fold_factor(struct simplifier *w, struct scene_material *m, const struct material_texture_row *row,
                          struct scene_texture_slot *slot)
{
    const struct scene_texture *texture;
    float product[CHANNELS];
    const struct survey *s;
    status st = survey_foldable(w, slot, &texture, &s);

    if (!s)
        return st;
    for (int i = 0; i < row->parts; i++) {
        const struct material_part *part = &row->part[i];
        float factor = *material_floats(m, part->offset);

        product[i] = factor;
        if (factor == 0 || !material_reads_part(m, part))
            continue;
        if (!survey_is_constant(s, part->channel))
            return STATUS_OK;
        product[i] = factor * survey_least(s, part->channel, is_srgb(texture, row->color));
        if (!(product[i] <= material_values[part->value].most))
            return STATUS_OK;
    }
    for (int i = 0; i < row->parts; i++)
        *material_floats(m, row->part[i].offset) = product[i];
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

/* Only the strength, if the direction is exactly the tangent's, or does not matter. */
static status fold_direction(struct simplifier *w, struct scene_material *m, const struct material_texture_row *row,
                             struct scene_texture_slot *slot)
{
    float *strength = material_floats(m, row->part[0].offset);
    const struct scene_texture *texture;
    float x, y, product;
    const struct survey *s;
    status st = survey_foldable(w, slot, &texture, &s);
    int srgb;

    if (!s || !survey_is_constant(s, row->part[0].channel))
        return st;
    srgb = is_srgb(texture, 0);
    product = *strength * survey_least(s, row->part[0].channel, srgb);
    if (product != 0) {
        if (!survey_is_constant(s, CHANNEL_RED) || !survey_is_constant(s, CHANNEL_GREEN) || !(product <= 1))
            return STATUS_OK;
        x = survey_least(s, CHANNEL_RED, srgb) * 2 - 1;
        y = survey_least(s, CHANNEL_GREEN, srgb) * 2 - 1;
        if (x != 1 || y != 0)
            return STATUS_OK;
    }
    *strength = product;
    return fold(w, slot);
}

static status fold_between(struct simplifier *w, struct scene_material *m, const struct material_texture_row *row,
                           struct scene_texture_slot *slot)
{
    float *from = material_floats(m, row->part[0].offset), *to = material_floats(m, row->part[1].offset), value;
    const struct material_value *range = &material_values[row->part[0].value];
    const struct scene_texture *texture;
    const struct survey *s;
    status st = survey_foldable(w, slot, &texture, &s);

    if (!s || !survey_is_constant(s, row->part[0].channel))
        return st;
    value = *from + (*to - *from) * survey_least(s, row->part[0].channel, is_srgb(texture, row->color));
    if (!(value >= range->least && value <= range->most))
        return STATUS_OK;
    *from = *to = value;
    return fold(w, slot);
}

status simplify_fold_slot(struct simplifier *w, struct scene_material *m, enum material_texture number)
{
    const struct material_texture_row *row = &material_textures[number];
    struct scene_texture_slot *slot = &m->textures[number];

    switch (row->meaning) {
    case MEANS_NORMAL: return fold_normal(w, slot);
    case MEANS_DIRECTION: return fold_direction(w, m, row, slot);
    case MEANS_BETWEEN: return fold_between(w, m, row, slot);
    case MEANS_FACTOR: break;
    }
    return fold_factor(w, m, row, slot);
}

status simplify_fold(struct simplifier *w, struct scene_material *m)
{
    status st = STATUS_OK;

    for (int i = 0; i < MATERIAL_TEXTURES && st == STATUS_OK; i++)
        st = simplify_fold_slot(w, m, i);
    return st;
}

/* The least value of a factor times a texture that varies; 0: not known. */
static status least_of(struct simplifier *w, const struct scene_material *m, enum material_texture number,
                       enum material_value_number value, float *least)
{
    const struct material_texture_row *row = &material_textures[number];
    const struct scene_texture *texture;
    const struct survey *s;

    *least = 0;
    TRY(survey_foldable(w, &m->textures[number], &texture, &s));
    for (int i = 0; i < row->parts && s; i++)
        if (row->part[i].value == value)
            *least = *material_floats_const(m, row->part[i].offset) *
                     survey_least(s, row->part[i].channel, is_srgb(texture, row->color));
    *least = fminf(fmaxf(*least, 0), 1);
    return STATUS_OK;
}

status simplify_least_roughness(struct simplifier *w, struct scene_material *m)
{
    TRY(least_of(w, m, MATERIAL_TEXTURE_metallic_roughness, MATERIAL_VALUE_roughness, &m->least_roughness));
    return least_of(w, m, MATERIAL_TEXTURE_clearcoat_roughness, MATERIAL_VALUE_clearcoat_roughness,
                    &m->clearcoat_least_roughness);
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
        TRY(simplify_survey(w, slot, &s));
        one = one && !has_border(&w->scene->textures[slot->texture]) && survey_is_constant(s, CHANNEL_ALPHA) &&
              survey_least(s, CHANNEL_ALPHA, 0) == 1;
    } else if (m->alpha_mode == ALPHA_MASK && !w->alpha_colors[index]) {
        always = always || m->base_color[3] >= m->alpha_cutoff;
    }
    if (!always && !(one && (m->alpha_mode == ALPHA_BLEND || m->alpha_cutoff <= 1)))
        return STATUS_OK;
    m->alpha_mode = ALPHA_OPAQUE;
    w->report->made_opaque++;
    return STATUS_OK;
}
