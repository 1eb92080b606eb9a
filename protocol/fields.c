#include "protocol/fields.h"

#include <string.h>

#include "common/base/memory.h"

const ProtobufCMessage *message_body(const Azulejo__Wire__Envelope *envelope)
{
    const ProtobufCFieldDescriptor *field =
        protobuf_c_message_descriptor_get_field(&azulejo__wire__envelope__descriptor, (unsigned)envelope->body_case);

    return field && field->type == PROTOBUF_C_TYPE_MESSAGE
               ? *(const ProtobufCMessage *const *)((const char *)envelope + field->offset)
               : NULL;
}

ProtobufCMessage *message_new(Azulejo__Wire__Envelope *out, const char *name)
{
    const ProtobufCFieldDescriptor *field =
        protobuf_c_message_descriptor_get_field_by_name(&azulejo__wire__envelope__descriptor, name);
    const ProtobufCMessageDescriptor *descriptor = field->descriptor;
    ProtobufCMessage *message = mem_alloc(descriptor->sizeof_message);

    azulejo__wire__envelope__init(out);
    if (!message)
        return NULL;
    protobuf_c_message_init(descriptor, message);
    out->body_case = (Azulejo__Wire__Envelope__BodyCase)field->id;
    memcpy((char *)out + field->offset, &message, sizeof message);
    return message;
}

static const ProtobufCFieldDescriptor *find(const ProtobufCMessage *message, const char *name)
{
    return protobuf_c_message_descriptor_get_field_by_name(message->descriptor, name);
}

void *message_field(const ProtobufCMessage *message, const char *name, size_t **count)
{
    const ProtobufCFieldDescriptor *field = find(message, name);

    if (field && count)
        *count = (size_t *)((char *)message + field->quantifier_offset);
    return field ? (char *)message + field->offset : NULL;
}

int message_is_set(const ProtobufCMessage *message, const char *name)
{
    static const char zeros[sizeof(ProtobufCBinaryData)];
    const ProtobufCFieldDescriptor *field = find(message, name);
    const char *at = field ? (const char *)message + field->offset : NULL;

    if (!field)
        return 0;
    if (field->label == PROTOBUF_C_LABEL_REPEATED)
        return *(const size_t *)((const char *)message + field->quantifier_offset) > 0;
    if (field->type == PROTOBUF_C_TYPE_STRING)
        return (*(const char *const *)at)[0] != 0;
    return memcmp(at, zeros, field_bytes(field)) != 0;
}

uint64_t message_job(const ProtobufCMessage *message)
{
    const ProtobufCFieldDescriptor *field = find(message, "job");

    return field && field->type == PROTOBUF_C_TYPE_UINT64 && field->label != PROTOBUF_C_LABEL_REPEATED
               ? *(const uint64_t *)((const char *)message + field->offset)
               : 0;
}

size_t field_bytes(const ProtobufCFieldDescriptor *field)
{
    switch (field->type) {
    case PROTOBUF_C_TYPE_BOOL: return sizeof(protobuf_c_boolean);
    case PROTOBUF_C_TYPE_BYTES: return sizeof(ProtobufCBinaryData);
    case PROTOBUF_C_TYPE_STRING:
    case PROTOBUF_C_TYPE_MESSAGE: return sizeof(void *);
    case PROTOBUF_C_TYPE_UINT64:
    case PROTOBUF_C_TYPE_FIXED64:
    case PROTOBUF_C_TYPE_INT64:
    case PROTOBUF_C_TYPE_SINT64:
    case PROTOBUF_C_TYPE_SFIXED64:
    case PROTOBUF_C_TYPE_DOUBLE: return 8;
    default: return 4;
    }
}
