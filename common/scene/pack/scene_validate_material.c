/* Materials: every field against its row's range (material_fields.h), and checks across fields. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "common/scene/material.h"
#include "common/scene/pack/scene_validate_parts.h"

static status refuse_number(const struct check_place *at, const char *field, float value, float least, float most)
{
    char low[32] = "above 0", high[40] = "";

    if (least != ABOVE_0)
        snprintf(low, sizeof low, "%g", (double)least);
    if (most == BELOW_1)
        snprintf(high, sizeof high, " or more and below 1");
    else if (most != INFINITY)
        snprintf(high, sizeof high, "%s %g", least == ABOVE_0 ? " and at most" : " to", (double)most);
    return check_complain(at, field, "is %g: must be %s%s", (double)value, low, high);
}

static status check_numbers(const struct check_place *at, const struct scene_material *m,
                            const struct material_value *row, float least)
{
    const float *values = material_floats_const(m, row->offset);

    for (int i = 0; i < row->count; i++)
        if (!(values[i] >= least && values[i] <= row->most))
            return refuse_number(at, row->name, values[i], least, row->most);
    return STATUS_OK;
}

/* An ior of 0 means Fresnel 1; a value below 1 is that of the back over that of the front. */
static status check_ior(const struct check_place *at, const struct scene *scene, const struct scene_material *m,
                        const struct material_value *row)
{
    if (m->ior == 0)
        return STATUS_OK;
    return check_numbers(at, m, row, scene->volume_rule == VOLUMES_BOUNDARIES ? 1e-3f : row->least);
}

/* The fields of other kinds have no meaning. */
static status check_parts(const struct check_place *at, const struct scene_material *m)
{
    for (int i = 0; i < 2 && m->kind == MATERIAL_MIX; i++)
        if (m->mix_material[i] >= at->row)
            return check_complain(at, "mix_material", "must come before the mix itself");
    return STATUS_OK;
}

static status check_value(const struct check_place *at, const struct scene *scene, const struct scene_material *m,
                          const struct material_value *row)
{
    int32_t value;

    memcpy(&value, (const char *)m + row->offset, sizeof value);
    switch (row->type) {
    case TYPE_NUMBER:
    case TYPE_RGB:
    case TYPE_RGBA:
        return row->offset == offsetof(struct scene_material, ior) ? check_ior(at, scene, m, row)
                                                                   : check_numbers(at, m, row, row->least);
    case TYPE_FLAG: return check_flag(at, row->name, value);
    case TYPE_KIND:
    case TYPE_ALPHA_MODE: return check_enum(at, row->name, (unsigned)value, (unsigned)row->most + 1);
    case TYPE_INTEGER:
        return value >= (int32_t)row->least && value <= (int32_t)row->most
                   ? STATUS_OK
                   : refuse_number(at, row->name, (float)value, row->least, row->most);
    case TYPE_MEDIUM: return check_reference(at, row->name, value, scene->medium_count);
    case TYPE_MATERIALS: return check_parts(at, m);
    }
    return STATUS_OK;
}

static status check_slot(const struct check_place *at, const struct scene *scene, const struct scene_material *m,
                         int number)
{
    const struct scene_texture_slot *slot = &m->textures[number];
    const char *field = material_textures[number].name;

    TRY(check_reference(at, field, slot->texture, scene->texture_count));
    if (slot->texture < 0)
        return STATUS_OK;
    if (slot->uv_set > 1)
        return check_complain(at, field, "names a texture coordinate set other than 0 and 1");
    /* A texture coordinate times this stays far below the limit of float. */
    return check_ranges(at, field, &slot->uv_transform[0][0], 6, -1e6f, 1e6f);
}

status check_material(const struct check_place *row, const struct scene *scene, const struct scene_material *m)
{
    struct check_place at = *row;

    TRY(check_name(&at, m->name));
    at.material = m->name;
    for (int i = 0; i < MATERIAL_VALUES; i++)
        TRY(check_value(&at, scene, m, &material_values[i]));
    for (int i = 0; i < MATERIAL_TEXTURES; i++)
        TRY(check_slot(&at, scene, m, i));
    return STATUS_OK;
}
