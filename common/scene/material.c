#include "common/scene/material.h"

#include <string.h>

#include "common/scene/effects.h"

const uint32_t material_message_numbers[MATERIAL_MESSAGE_COUNT] = {
#define MESSAGE_NUMBER(name, number) number,
    MATERIAL_MESSAGES(MESSAGE_NUMBER)
#undef MESSAGE_NUMBER
};

#define AT(field) offsetof(struct scene_material, field)
#define MEMBER_BYTES(field) sizeof(((struct scene_material *)0)->field)

#define SET_NONE 0
#define EFFECT_SET(name, text) SET_##name = (uint64_t)1 << EFFECT_BIT_##name,
enum effect_set { EFFECT_MAP(EFFECT_SET) };

const struct material_value material_values[MATERIAL_VALUES] = {
#define VALUE_ROW(type, name, initial, least, most, effect, message, number)                    \
    {#name, TYPE_##type, AT(name), MEMBER_BYTES(name) / sizeof(float), initial, least, most,    \
     SET_##effect, MESSAGE_##message, number},
    MATERIAL_FIELDS(VALUE_ROW, MATERIAL_SKIP)
#undef VALUE_ROW
};

/* The words of the rows TEXTURE. */
enum { ENCODING_IS_DATA = 0, ENCODING_IS_COLOR = 1, LOOKUP_FINEST = 0, LOOKUP_FILTERED = 1 };
enum {
    READ_BY_MIX = ROLE_MIX,
    READ_BY_DIELECTRIC = ROLE_DIELECTRIC,
    READ_BY_SURFACE = ROLE_METAL | ROLE_DIELECTRIC,
    READ_BY_LIT = READ_BY_SURFACE | ROLE_CONDUCTOR,
    READ_BY_ALL = READ_BY_LIT | ROLE_UNLIT | ROLE_MIX,
};
#define ALONE MATERIAL_ALONE
#define WITH(value) MATERIAL_VALUE_##value
#define PART(value, channel) {MATERIAL_VALUE_##value, AT(value), CHANNEL_##channel}
#define ELEMENT(value, i, channel) {MATERIAL_VALUE_##value, AT(value[i]), CHANNEL_##channel}
#define RGB_OF(value) ELEMENT(value, 0, RED), ELEMENT(value, 1, GREEN), ELEMENT(value, 2, BLUE)
#define ALPHA_OF(value) ELEMENT(value, 3, ALPHA)

const struct material_texture_row material_textures[MATERIAL_TEXTURES] = {
#define TEXTURE_ROW(name, encoding, lookup, readers, needs, message, number, meaning, ...)       \
    {#name "_texture", ENCODING_IS_##encoding, LOOKUP_##lookup, readers, needs,                 \
     MESSAGE_##message, number, MEANS_##meaning,                                                \
     sizeof((struct material_part[]){__VA_ARGS__}) / sizeof(struct material_part), {__VA_ARGS__}},
    MATERIAL_FIELDS(MATERIAL_SKIP, TEXTURE_ROW)
#undef TEXTURE_ROW
};

int material_is_float(enum material_type type) { return type == TYPE_NUMBER || type == TYPE_RGB || type == TYPE_RGBA; }

/* Are all elements this value? */
static int all_are(const struct scene_material *m, const struct material_value *row, float value)
{
    const char *at = (const char *)m + row->offset;
    const float *numbers = (const float *)(const void *)at;
    int32_t integer;

    for (int i = 0; i < row->count; i++) {
        if (material_is_float(row->type)) {
            if (numbers[i] != value)
                return 0;
            continue;
        }
        memcpy(&integer, at + 4 * i, sizeof integer);
        if (integer != (int32_t)value)
            return 0;
    }
    return 1;
}

int material_value_is_default(const struct scene_material *m, const struct material_value *row)
{
    return all_are(m, row, row->initial);
}

int material_value_is_set(const struct scene_material *m, const struct material_value *row)
{
    return !all_are(m, row, 0);
}

void material_value_reset(struct scene_material *m, const struct material_value *row)
{
    const int32_t integer = material_is_float(row->type) ? 0 : (int32_t)row->initial;
    const void *element = material_is_float(row->type) ? (const void *)&row->initial : &integer;

    for (int i = 0; i < row->count; i++)
        memcpy((char *)m + row->offset + 4 * i, element, 4);
}

void scene_material_default(struct scene_material *material)
{
    memset(material, 0, sizeof *material);
    material->name = "";
    for (int i = 0; i < MATERIAL_VALUES; i++)
        material_value_reset(material, &material_values[i]);
    for (int i = 0; i < MATERIAL_TEXTURES; i++)
        material->textures[i] = (struct scene_texture_slot){.texture = -1, .uv_transform = {{1, 0, 0}, {0, 1, 0}}};
}

/* ---- which textures act --------------------------------------------------------------------- */

enum material_role material_role_of(const struct scene_material *m)
{
    if (m->kind == MATERIAL_MIX)
        return ROLE_MIX;
    if (m->kind == MATERIAL_INTERFACE)
        return ROLE_INTERFACE;
    if (m->unlit)
        return ROLE_UNLIT;
    if (m->kind == MATERIAL_CONDUCTOR)
        return ROLE_CONDUCTOR;
    return m->metallic == 1 && m->metallic_roughness_texture.texture < 0 ? ROLE_METAL : ROLE_DIELECTRIC;
}

int material_transmits(const struct scene_material *m)
{
    return m->transmission > 0 && material_role_of(m) == ROLE_DIELECTRIC;
}

int material_reads_part(const struct scene_material *m, const struct material_part *part)
{
    if (part->offset == AT(base_color[3]))
        return m->alpha_mode != ALPHA_OPAQUE;
    if (part->offset == AT(metallic))
        return m->kind != MATERIAL_CONDUCTOR;
    return 1;
}

int material_texture_acts(const struct scene_material *m, enum material_texture slot)
{
    const struct material_texture_row *row = &material_textures[slot];

    if (!(row->readers & material_role_of(m)))
        return 0;
    if (row->needs != MATERIAL_ALONE && !material_value_is_set(m, &material_values[row->needs]))
        return 0;
    if (row->meaning == MEANS_BETWEEN)
        return *material_floats_const(m, row->part[0].offset) != *material_floats_const(m, row->part[1].offset);
    for (int i = 0; i < row->parts; i++)
        if (*material_floats_const(m, row->part[i].offset) != 0 && material_reads_part(m, &row->part[i]))
            return 1;
    return 0;
}
