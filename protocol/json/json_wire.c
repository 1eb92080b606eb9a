/* Messages as JSON; json_wire_read.c is the other way. */
#include "protocol/json/json_wire.h"

#include <ctype.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/json_quote.h"
#include "common/scene/settings.h"
#include "common/tonemap/tonemap.h"
#include "protocol/json/json_wire_parts.h"

/* ---- descriptors ------------------------------------------------------------------------------ */

/* protobuf-c has a map as an array of messages of two fields. */
int json_wire_is_map(const ProtobufCFieldDescriptor *field)
{
    const ProtobufCMessageDescriptor *d = field->descriptor;
    size_t length;

    if (field->label != PROTOBUF_C_LABEL_REPEATED || field->type != PROTOBUF_C_TYPE_MESSAGE || d->n_fields != 2)
        return 0;
    length = strlen(d->short_name);
    return length > 5 && strcmp(d->short_name + length - 5, "Entry") == 0 && strcmp(d->fields[0].name, "key") == 0 &&
           strcmp(d->fields[1].name, "value") == 0 && d->fields[0].type == PROTOBUF_C_TYPE_STRING;
}

/* How much all names of the enum begin with, up to an '_'. */
static size_t common_prefix(const ProtobufCEnumDescriptor *d)
{
    const char *first = d->values[0].name;
    size_t common = strlen(first);

    for (unsigned i = 1; i < d->n_values; i++)
        for (size_t at = 0; at < common; at++)
            if (d->values[i].name[at] != first[at])
                common = at;
    while (common > 0 && first[common - 1] != '_')
        common--;
    return common;
}

const char *json_wire_word(const ProtobufCEnumDescriptor *descriptor, int value, char out[64])
{
    const ProtobufCEnumValue *v = protobuf_c_enum_descriptor_get_value(descriptor, value);

    if (!v)
        return NULL;
    snprintf(out, 64, "%s", v->name + common_prefix(descriptor));
    for (char *c = out; *c; c++)
        *c = (char)tolower((unsigned char)*c);
    return out;
}

/* ---- words ------------------------------------------------------------------------------------- */

const struct setting *json_wire_choice(const ProtobufCMessageDescriptor *message, const ProtobufCFieldDescriptor *field)
{
    static const struct {
        const ProtobufCMessageDescriptor *message;
        struct setting row;
    } fields[] = {
#define ROW(of, field, word, what)                                                                                     \
    {&azulejo__wire__##of##__descriptor, {.name = #field, .kind = SETTING_KIND_##what, .choice = CHOICE_##word}},
#define FIELD(message, field, choice) ROW(message, field, choice, CHOICE)
#define SET(message, field, choice) ROW(message, field, choice, SET)
        CHOICE_FIELDS(FIELD, SET)
#undef FIELD
#undef SET
#undef ROW
    };

    for (int i = 0; message == &azulejo__wire__render_settings__descriptor && i < SETTING_COUNT; i++) {
        const struct setting *row = &render_settings_rows[i];
        if (strcmp(row->name, field->name) == 0)
            return row->kind == SETTING_KIND_CHOICE || row->kind == SETTING_KIND_SET ? row : NULL;
    }
    for (size_t i = 0; i < sizeof fields / sizeof *fields; i++)
        if (fields[i].message == message && strcmp(fields[i].row.name, field->name) == 0)
            return &fields[i].row;
    return NULL;
}

void json_put_word(struct buffer *out, const char *word)
{
    buffer_puts(out, "\"");
    for (; *word; word++)
        buffer_append(out, *word == ' ' ? "-" : word, 1);
    buffer_puts(out, "\"");
}

static void put_word(struct buffer *out, enum choice_name choice, uint64_t number)
{
    const char *word = choice_word(choice, number);

    if (word)
        json_put_word(out, word);
    else
        json_put_u64(out, number); /* of a newer release */
}

static void put_choice(struct buffer *out, const struct setting *choice, uint64_t value)
{
    const char *comma = "";

    if (choice->kind != SETTING_KIND_SET) {
        put_word(out, choice->choice, value);
        return;
    }
    buffer_puts(out, "[");
    for (unsigned bit = 0; bit < 64; bit++)
        if (value >> bit & 1) {
            buffer_puts(out, comma);
            put_word(out, choice->choice, bit);
            comma = ",";
        }
    buffer_puts(out, "]");
}

/* ---- values ----------------------------------------------------------------------------------- */

void json_put_text(struct buffer *out, const char *text)
{
    size_t length = text ? strlen(text) : 0;
    char *at = (char *)buffer_append_space(out, JSON_QUOTE_SIZE(length));

    if (at)
        out->size -= JSON_QUOTE_SIZE(length) - json_quote(at, text ? text : "", length);
}

/* The shortest digits that are read as the same number. */
static void put_digits(struct buffer *out, double value, int is_float)
{
    char text[40];

    if (isnan(value)) {
        buffer_puts(out, "null");
        return;
    }
    if (isinf(value)) {
        buffer_puts(out, value < 0 ? "\"-inf\"" : "\"inf\"");
        return;
    }
    for (int digits = is_float ? 6 : 15; digits <= 17; digits++) {
        snprintf(text, sizeof text, "%.*g", digits, value);
        if (is_float ? strtof(text, NULL) == (float)value : strtod(text, NULL) == value)
            break;
    }
    buffer_puts(out, text);
    if (value == 0 && signbit(value)) /* "-0" would be read as an integer, which has no sign */
        buffer_puts(out, ".0");
}

void json_put_number(struct buffer *out, double value) { put_digits(out, value, 0); }

void json_put_u64(struct buffer *out, uint64_t value)
{
    buffer_printf(out, value > JSON_WIRE_EXACT ? "\"%" PRIu64 "\"" : "%" PRIu64, value);
}

static void put_i64(struct buffer *out, int64_t value)
{
    int exact = value <= (int64_t)JSON_WIRE_EXACT && value >= -(int64_t)JSON_WIRE_EXACT;

    buffer_printf(out, exact ? "%" PRId64 : "\"%" PRId64 "\"", value);
}

static void put_hex(struct buffer *out, const ProtobufCBinaryData *bytes)
{
    static const char digits[] = "0123456789abcdef";
    uint8_t *at = buffer_append_space(out, 2 * bytes->len + 2);

    if (!at)
        return;
    *at++ = '"';
    for (size_t i = 0; i < bytes->len; i++) {
        *at++ = (uint8_t)digits[bytes->data[i] >> 4];
        *at++ = (uint8_t)digits[bytes->data[i] & 15];
    }
    *at = '"';
}

static void put_enum(struct buffer *out, const ProtobufCEnumDescriptor *descriptor, int value)
{
    char word[64];

    if (json_wire_word(descriptor, value, word))
        json_put_text(out, word);
    else
        buffer_printf(out, "%d", value); /* of a newer release */
}

static void put_value(struct buffer *out, const ProtobufCFieldDescriptor *field, const void *at)
{
    switch (field->type) {
    case PROTOBUF_C_TYPE_UINT32:
    case PROTOBUF_C_TYPE_FIXED32: buffer_printf(out, "%" PRIu32, *(const uint32_t *)at); break;
    case PROTOBUF_C_TYPE_INT32:
    case PROTOBUF_C_TYPE_SINT32:
    case PROTOBUF_C_TYPE_SFIXED32: buffer_printf(out, "%" PRId32, *(const int32_t *)at); break;
    case PROTOBUF_C_TYPE_UINT64:
    case PROTOBUF_C_TYPE_FIXED64: json_put_u64(out, *(const uint64_t *)at); break;
    case PROTOBUF_C_TYPE_INT64:
    case PROTOBUF_C_TYPE_SINT64:
    case PROTOBUF_C_TYPE_SFIXED64: put_i64(out, *(const int64_t *)at); break;
    case PROTOBUF_C_TYPE_FLOAT: put_digits(out, (double)*(const float *)at, 1); break;
    case PROTOBUF_C_TYPE_DOUBLE: put_digits(out, *(const double *)at, 0); break;
    case PROTOBUF_C_TYPE_BOOL: buffer_puts(out, *(const protobuf_c_boolean *)at ? "true" : "false"); break;
    case PROTOBUF_C_TYPE_ENUM: put_enum(out, field->descriptor, *(const int *)at); break;
    case PROTOBUF_C_TYPE_STRING: json_put_text(out, *(const char *const *)at); break;
    case PROTOBUF_C_TYPE_BYTES: put_hex(out, at); break;
    case PROTOBUF_C_TYPE_MESSAGE: json_wire_put(out, *(const ProtobufCMessage *const *)at); break;
    }
}

void json_put_field(struct buffer *out, const ProtobufCMessageDescriptor *of, const ProtobufCFieldDescriptor *field,
                    const void *at)
{
    const struct setting *choice = json_wire_choice(of, field);

    if (choice)
        put_choice(out, choice, field_bytes(field) == 8 ? *(const uint64_t *)at : *(const uint32_t *)at);
    else
        put_value(out, field, at);
}

/* The word of an operator's parameter that is a choice; NULL: this value is none. */
static const char *parameter_word(const ProtobufCMessage *message, const char *key, const void *value)
{
    if (message->descriptor != &azulejo__wire__output_settings__descriptor)
        return NULL;
    return tonemap_choice_word(((const Azulejo__Wire__OutputSettings *)(const void *)message)->tonemap, key,
                               *(const double *)value);
}

static void put_map(struct buffer *out, const ProtobufCMessage *message, const ProtobufCMessage *const *entries,
                    size_t count)
{
    buffer_puts(out, "{");
    for (size_t i = 0; i < count; i++) {
        const ProtobufCFieldDescriptor *fields = entries[i]->descriptor->fields;
        const char *key = *(const char *const *)((const char *)entries[i] + fields[0].offset);
        const void *value = (const char *)entries[i] + fields[1].offset;
        const char *word = parameter_word(message, key, value);

        buffer_puts(out, i ? "," : "");
        json_put_text(out, key);
        buffer_puts(out, ":");
        if (word)
            json_put_text(out, word);
        else
            put_value(out, &fields[1], value);
    }
    buffer_puts(out, "}");
}

static void put_repeated(struct buffer *out, const ProtobufCMessage *message, const ProtobufCFieldDescriptor *field,
                         const void *values, size_t count)
{
    if (json_wire_is_map(field)) {
        put_map(out, message, values, count);
        return;
    }
    buffer_puts(out, "[");
    for (size_t i = 0; i < count; i++) {
        buffer_puts(out, i ? "," : "");
        put_value(out, field, (const char *)values + i * field_bytes(field));
    }
    buffer_puts(out, "]");
}

static int is_absent(const ProtobufCMessage *message, const ProtobufCFieldDescriptor *field)
{
    if ((field->flags & PROTOBUF_C_FIELD_FLAG_ONEOF) &&
        *(const uint32_t *)((const char *)message + field->quantifier_offset) != field->id)
        return 1;
    return field->label != PROTOBUF_C_LABEL_REPEATED && field->type == PROTOBUF_C_TYPE_MESSAGE &&
           !*(const void *const *)((const char *)message + field->offset);
}

void json_wire_put(struct buffer *out, const ProtobufCMessage *message)
{
    const ProtobufCMessageDescriptor *d = message->descriptor;
    const char *comma = "";

    buffer_puts(out, "{");
    for (unsigned i = 0; i < d->n_fields; i++) {
        const ProtobufCFieldDescriptor *field = &d->fields[i];
        const char *at = (const char *)message + field->offset;

        if (is_absent(message, field))
            continue;
        buffer_printf(out, "%s\"%s\":", comma, field->name);
        comma = ",";
        if (field->label == PROTOBUF_C_LABEL_REPEATED)
            put_repeated(out, message, field, *(const void *const *)at,
                         *(const size_t *)((const char *)message + field->quantifier_offset));
        else
            json_put_field(out, d, field, at);
    }
    buffer_puts(out, "}");
}
