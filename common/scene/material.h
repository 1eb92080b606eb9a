/* material: the rows of material_fields.h as tables, and functions derived from them.
 *
 * material_values[] and material_textures[] describe each member of struct scene_material; code
 * that treats all fields alike iterates over them instead of naming them.
 */
#pragma once

#include <float.h>
#include <stddef.h>
#include <stdint.h>

#include "common/scene/scene.h"

#define ABOVE_0 FLT_TRUE_MIN
#define BELOW_1 0x1.fffffep-1f

enum material_type {
    TYPE_FLAG,
    TYPE_NUMBER,
    TYPE_RGB,
    TYPE_RGBA,
    TYPE_INTEGER,
    TYPE_KIND,
    TYPE_ALPHA_MODE,
    TYPE_MEDIUM,
    TYPE_MATERIALS,
};

enum material_message {
#define MESSAGE_ENUM(name, number) MESSAGE_##name,
    MATERIAL_MESSAGES(MESSAGE_ENUM)
#undef MESSAGE_ENUM
        MATERIAL_MESSAGE_COUNT
};
extern const uint32_t material_message_numbers[MATERIAL_MESSAGE_COUNT];

/* A row VALUE. Every element takes four bytes: float, or an integer. */
struct material_value {
    const char *name;
    enum material_type type;
    size_t offset; /* in struct scene_material */
    int count;     /* elements */
    float initial; /* of each */
    float least, most;
    uint64_t effect; /* set of enum effect_bit */
    enum material_message message;
    uint32_t number;
};

enum material_value_number {
#define VALUE_NUMBER(type, name, ...) MATERIAL_VALUE_##name,
    MATERIAL_FIELDS(VALUE_NUMBER, MATERIAL_SKIP)
#undef VALUE_NUMBER
        MATERIAL_VALUES /* rows VALUE */
};

/* How a material is shaded decides which textures it reads. */
enum material_role {
    ROLE_UNLIT = 1,
    ROLE_METAL = 2,         /* MATERIAL_SURFACE that is metal everywhere */
    ROLE_DIELECTRIC = 4,    /* any other MATERIAL_SURFACE */
    ROLE_CONDUCTOR = 8,
    ROLE_MIX = 16,
    ROLE_INTERFACE = 32,
};

enum material_meaning { MEANS_FACTOR, MEANS_NORMAL, MEANS_DIRECTION, MEANS_BETWEEN };

enum material_channel { CHANNEL_RED, CHANNEL_GREEN, CHANNEL_BLUE, CHANNEL_ALPHA, CHANNELS };

/* CHANNEL_OF_roughness: the channel of the texture that acts on this number. */
enum material_channel_of {
#define PART(value, channel) CHANNEL_OF_##value = CHANNEL_##channel
#define RGB_OF(value) CHANNEL_OF_##value = CHANNEL_RED
#define ALPHA_OF(value) CHANNEL_OF_##value##_alpha = CHANNEL_ALPHA
#define TEXTURE_CHANNELS(name, encoding, lookup, readers, needs, message, number, meaning, ...) \
    __VA_ARGS__,
    MATERIAL_FIELDS(MATERIAL_SKIP, TEXTURE_CHANNELS)
#undef TEXTURE_CHANNELS
#undef ALPHA_OF
#undef RGB_OF
#undef PART
};

/* One float of a material, and the channel of the texture that acts on it. */
struct material_part {
    enum material_value_number value;
    size_t offset;
    enum material_channel channel;
};

/* A row TEXTURE. */
struct material_texture_row {
    const char *name;
    int color;        /* holds colours: sRGB unless the texture says otherwise */
    int filtered;     /* looked up by footprint */
    unsigned readers; /* set of enum material_role */
    int needs;        /* number of the value that it needs; MATERIAL_ALONE: none */
    enum material_message message;
    uint32_t number;
    enum material_meaning meaning;
    int parts;
    struct material_part part[CHANNELS];
};
enum { MATERIAL_ALONE = -1 };

extern const struct material_value material_values[MATERIAL_VALUES];
extern const struct material_texture_row material_textures[MATERIAL_TEXTURES];

/* The first element of a value of numbers. */
static inline float *material_floats(struct scene_material *m, size_t offset)
{
    return (float *)(void *)((char *)m + offset);
}

static inline const float *material_floats_const(const struct scene_material *m, size_t offset)
{
    return (const float *)(const void *)((const char *)m + offset);
}

int material_is_float(enum material_type type);
/* By value: -0 is 0, as on the wire. */
int material_value_is_default(const struct scene_material *m, const struct material_value *row);
void material_value_reset(struct scene_material *m, const struct material_value *row);
/* Is any element other than 0? */
int material_value_is_set(const struct scene_material *m, const struct material_value *row);

enum material_role material_role_of(const struct scene_material *m);

/* Is any surface behind it visible, as through a thin wall or a refracting body? */
int material_transmits(const struct scene_material *m);

/* Does the material read this factor at all? */
int material_reads_part(const struct scene_material *m, const struct material_part *part);

/* Would a texture in this slot have an effect with the present factors? */
int material_texture_acts(const struct scene_material *m, enum material_texture slot);

/* Is there a texture in this slot, and does it have an effect? */
static inline int material_has_texture(const struct scene_material *m, enum material_texture slot)
{
    return m->textures[slot].texture >= 0 && material_texture_acts(m, slot);
}
