/* Materials of a packed scene, by the rows of material_fields.h. */
#include <assert.h>
#include <string.h>

#include "common/scene/material.h"
#include "common/scene/pack/scene_unpack_parts.h"

/* The field of a row's message with a given number, and its descriptor. */
static const void *member_of(const ProtobufCMessage *message, uint32_t number, const ProtobufCFieldDescriptor **field)
{
    *field = protobuf_c_message_descriptor_get_field(message->descriptor, number);
    assert(*field);
    return (const char *)message + (*field)->offset;
}

static status unpack_value(struct scene_reader *r, const ProtobufCMessage *message, const struct material_value *row,
                           struct scene_material *to)
{
    const ProtobufCFieldDescriptor *field;
    const void *from = member_of(message, row->number, &field);
    char *at = (char *)to + row->offset;
    const float *floats;
    uint32_t index;

    switch (row->type) {
    case TYPE_RGB:
    case TYPE_RGBA:
        memcpy(&floats, from, sizeof floats);
        return unpack_floats(r, row->name, floats,
                             *(const size_t *)(const void *)((const char *)message + field->quantifier_offset),
                             (float *)(void *)at, (size_t)row->count);
    case TYPE_MEDIUM:
        memcpy(&index, from, sizeof index);
        return unpack_index(r, row->name, index, (uint32_t)row->most + 1, (int32_t *)(void *)at);
    default:
        for (int i = 0; i < row->count; i++)
            memcpy(at + 4 * i, member_of(message, row->number + (uint32_t)i, &field), 4);
        return STATUS_OK;
    }
}

/* The material's messages; NULL for an absent group: all its fields have their defaults. */
static status find_messages(struct scene_reader *r, const ProtobufCMessage *material,
                            const ProtobufCMessage *found[MATERIAL_MESSAGE_COUNT])
{
    found[MESSAGE_MATERIAL] = material;
    for (int i = 1; i < MATERIAL_MESSAGE_COUNT; i++) {
        const ProtobufCFieldDescriptor *field;

        memcpy(&found[i], member_of(material, material_message_numbers[i], &field), sizeof found[i]);
        if (found[i] && found[i]->n_unknown_fields)
            return error_set(r->err, STATUS_ERR_INPUT,
                             "the packed scene is damaged: a material's %s has an unknown field", field->name);
    }
    return STATUS_OK;
}

status unpack_material(struct scene_reader *r, const ProtobufCMessage *message, uint32_t number)
{
    struct scene_material *to = &r->scene->materials[number];
    const ProtobufCMessage *found[MATERIAL_MESSAGE_COUNT];
    const ProtobufCFieldDescriptor *field;

    scene_material_default(to);
    TAKE(unpack_name(r, ((const Azulejo__Scene__Material *)message)->name, &to->name));
    TAKE(find_messages(r, message, found));
    for (int i = 0; i < MATERIAL_VALUES; i++)
        if (found[material_values[i].message])
            TAKE(unpack_value(r, found[material_values[i].message], &material_values[i], to));
    for (int i = 0; i < MATERIAL_TEXTURES; i++) {
        const struct material_texture_row *row = &material_textures[i];
        const Azulejo__Scene__TextureSlot *slot;

        if (!found[row->message])
            continue;
        memcpy(&slot, member_of(found[row->message], row->number, &field), sizeof slot);
        TAKE(unpack_slot(r, slot, &to->textures[i]));
    }
    return STATUS_OK;
}
