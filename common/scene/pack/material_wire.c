#include "common/scene/pack/material_wire.h"

#include <assert.h>
#include <string.h>

/* The struct of a row's message; the group's own, whether it will be written or not. */
static ProtobufCMessage *message_of(struct material_wire *wire, enum material_message message)
{
    return message == MESSAGE_MATERIAL ? &wire->material.base : (ProtobufCMessage *)(void *)wire->group[message].bytes;
}

static const ProtobufCFieldDescriptor *field_of(const ProtobufCMessage *message, uint32_t number)
{
    const ProtobufCFieldDescriptor *field = protobuf_c_message_descriptor_get_field(message->descriptor, number);

    assert(field);
    return field;
}

static void *member_of(ProtobufCMessage *message, uint32_t number)
{
    return (char *)message + field_of(message, number)->offset;
}

static void groups_init(struct material_wire *wire)
{
    azulejo__scene__material__init(&wire->material);
    for (int i = 1; i < MATERIAL_MESSAGE_COUNT; i++) {
        const ProtobufCMessageDescriptor *group =
            field_of(&wire->material.base, material_message_numbers[i])->descriptor;

        assert(group->sizeof_message <= MATERIAL_GROUP_BYTES);
        protobuf_c_message_init(group, wire->group[i].bytes);
    }
}

static void value_fill(ProtobufCMessage *message, const struct scene_material *m, const struct material_value *row)
{
    /* protobuf-c's structs are not const-correct; packing does not write through them. */
    char *from = (char *)(uintptr_t)m + row->offset;
    int32_t index;

    switch (row->type) {
    case TYPE_RGB:
    case TYPE_RGBA:
        *(size_t *)(void *)((char *)message + field_of(message, row->number)->quantifier_offset) = (size_t)row->count;
        memcpy(member_of(message, row->number), &from, sizeof from);
        break;
    case TYPE_MEDIUM: /* plus one, so that -1 takes no bytes */
        memcpy(&index, from, sizeof index);
        index++;
        memcpy(member_of(message, row->number), &index, sizeof index);
        break;
    default:
        for (int i = 0; i < row->count; i++)
            memcpy(member_of(message, row->number + (uint32_t)i), from + 4 * i, 4);
    }
}

/* NULL for a slot without a texture, so that its other fields take no bytes. */
static Azulejo__Scene__TextureSlot *slot_fill(Azulejo__Scene__TextureSlot *out, const struct scene_texture_slot *slot)
{
    if (slot->texture < 0)
        return NULL;
    azulejo__scene__texture_slot__init(out);
    out->texture = (uint32_t)slot->texture;
    out->uv_set = slot->uv_set;
    out->n_uv_transform = 6;
    out->uv_transform = (float *)(uintptr_t)slot->uv_transform;
    return out;
}

void material_wire_fill(struct material_wire *wire, const struct scene_material *m)
{
    int written[MATERIAL_MESSAGE_COUNT] = {0};

    groups_init(wire);
    wire->material.name = (char *)(uintptr_t)m->name;
    for (int i = 0; i < MATERIAL_VALUES; i++) {
        const struct material_value *row = &material_values[i];

        value_fill(message_of(wire, row->message), m, row);
        written[row->message] |= !material_value_is_default(m, row);
    }
    for (int i = 0; i < MATERIAL_TEXTURES; i++) {
        const struct material_texture_row *row = &material_textures[i];
        void *slot = slot_fill(&wire->slots[i], &m->textures[i]);

        memcpy(member_of(message_of(wire, row->message), row->number), &slot, sizeof slot);
        written[row->message] |= slot != NULL;
    }
    for (int i = 1; i < MATERIAL_MESSAGE_COUNT; i++) {
        void *group = written[i] ? wire->group[i].bytes : NULL;

        memcpy(member_of(&wire->material.base, material_message_numbers[i]), &group, sizeof group);
    }
}
