/* JSON as messages. */
#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <jansson.h>

#include "common/base/memory.h"
#include "common/tonemap/tonemap.h"
#include "protocol/json/json_wire_parts.h"

/* Where a value stands, for errors: "settings.width", "frames[3]". */
struct place {
    const struct place *up;
    const char *name; /* NULL: it is number `index` of an array */
    size_t index;
};

struct reading {
    size_t items;
    struct error *err;
};

static void *plain_alloc(void *user UNUSED, size_t size) { return mem_alloc(size); }

static void plain_free(void *user UNUSED, void *block) { mem_free(block); }

void json_wire_free(ProtobufCMessage *message)
{
    ProtobufCAllocator allocator = {plain_alloc, plain_free, NULL};

    protobuf_c_message_free_unpacked(message, &allocator);
}

/* ---- errors ----------------------------------------------------------------------------------- */

static void put_place(struct buffer *out, const struct place *place)
{
    if (place->up)
        put_place(out, place->up);
    if (place->name)
        buffer_printf(out, "%s%.64s", out->size ? "." : "", place->name);
    else
        buffer_printf(out, "[%zu]", place->index);
}

__attribute__((format(printf, 4, 5))) static status refuse(const struct reading *r, const struct place *place,
                                                           status code, const char *format, ...)
{
    struct buffer where = BUFFER_INIT;
    char text[700];
    va_list args;

    va_start(args, format);
    vsnprintf(text, sizeof text, format, args);
    va_end(args);
    if (place)
        put_place(&where, place);
    error_set(r->err, code, "%.200s%s%s", buffer_text(&where), where.size ? ": " : "", text);
    buffer_release(&where);
    return code;
}

static status out_of_memory(const struct reading *r) { return error_no_memory(r->err, "a message"); }

static const char *kind_word(const json_t *value)
{
    switch (json_typeof(value)) {
    case JSON_OBJECT: return "an object";
    case JSON_ARRAY: return "an array";
    case JSON_STRING: return "a text";
    case JSON_INTEGER: return "a whole number";
    case JSON_REAL: return "a number";
    case JSON_NULL: return "null";
    default: return "true or false";
    }
}

/* The value itself where it is short. */
static const char *what_instead(const json_t *value, char out[64])
{
    if (json_is_integer(value))
        snprintf(out, 64, "%" JSON_INTEGER_FORMAT, json_integer_value(value));
    else if (json_is_string(value))
        snprintf(out, 64, "'%.40s'", json_string_value(value));
    else
        snprintf(out, 64, "%s", kind_word(value));
    return out;
}

/* ---- single values ----------------------------------------------------------------------------- */

/* A whole number from JSON or from text of digits, as sign and magnitude; 0: it is none. */
static int whole_number(const json_t *value, int *negative, uint64_t *magnitude)
{
    const char *text = json_string_value(value);
    char *end;

    if (json_is_integer(value)) {
        json_int_t number = json_integer_value(value);
        *negative = number < 0;
        *magnitude = number < 0 ? 0 - (uint64_t)number : (uint64_t)number;
        return 1;
    }
    if (!text)
        return 0;
    *negative = text[0] == '-';
    text += *negative;
    if (text[0] < '0' || text[0] > '9')
        return 0;
    errno = 0;
    *magnitude = strtoull(text, &end, 10);
    return errno == 0 && *end == 0;
}

static status get_unsigned(const struct reading *r, const struct place *place, const json_t *value, uint64_t most,
                           uint64_t *out)
{
    char instead[64];
    int negative = 0;

    if (whole_number(value, &negative, out) && *out <= most && !(negative && *out > 0))
        return STATUS_OK;
    return refuse(r, place, STATUS_ERR_INPUT, "must be a whole number from 0 to %" PRIu64 ", not %s", most,
                  what_instead(value, instead));
}

static status get_signed(const struct reading *r, const struct place *place, const json_t *value, int64_t least,
                         int64_t most, int64_t *out)
{
    uint64_t magnitude = 0;
    char instead[64];
    int negative = 0;

    if (whole_number(value, &negative, &magnitude) &&
        magnitude <= (negative ? (uint64_t)most + 1 : (uint64_t)most)) {
        *out = negative ? (int64_t)(0 - magnitude) : (int64_t)magnitude;
        return STATUS_OK;
    }
    return refuse(r, place, STATUS_ERR_INPUT, "must be a whole number from %" PRId64 " to %" PRId64 ", not %s", least,
                  most, what_instead(value, instead));
}

static status get_real(const struct reading *r, const struct place *place, const json_t *value, double *out)
{
    const char *text = json_string_value(value);

    if (json_is_null(value))
        *out = NAN;
    else if (json_is_number(value))
        *out = json_number_value(value);
    else if (text && strcmp(text, "inf") == 0)
        *out = INFINITY;
    else if (text && strcmp(text, "-inf") == 0)
        *out = -INFINITY;
    else
        return refuse(r, place, STATUS_ERR_INPUT, "must be a number, null, \"inf\" or \"-inf\", not %s",
                      kind_word(value));
    return STATUS_OK;
}

static status get_enum(const struct reading *r, const struct place *place, const json_t *value,
                       const ProtobufCEnumDescriptor *d, int *out)
{
    const char *text = json_string_value(value);
    char words[512] = "", word[64];

    for (unsigned i = 0; i < d->n_values; i++) {
        if (!json_wire_word(d, d->values[i].value, word))
            continue;
        if (text && strcmp(text, word) == 0) {
            *out = d->values[i].value;
            return STATUS_OK;
        }
        snprintf(words + strlen(words), sizeof words - strlen(words), "%s%s", words[0] ? ", " : "", word);
    }
    if (text)
        return refuse(r, place, STATUS_ERR_INPUT, "'%.40s' is not known; it may be %s", text, words);
    return refuse(r, place, STATUS_ERR_INPUT, "must be one of %s, not %s", words, kind_word(value));
}

static status get_text(const struct reading *r, const struct place *place, const json_t *value, char **out)
{
    char *copy;

    if (!json_is_string(value))
        return refuse(r, place, STATUS_ERR_INPUT, "must be a text, not %s", kind_word(value));
    copy = mem_strdup(json_string_value(value));
    if (!copy)
        return out_of_memory(r);
    *out = copy;
    return STATUS_OK;
}

static int hex_digit(char c) { return c >= '0' && c <= '9' ? c - '0' : c >= 'a' && c <= 'f' ? c - 'a' + 10 : -1; }

static status get_bytes(const struct reading *r, const struct place *place, const json_t *value,
                        ProtobufCBinaryData *out)
{
    const char *text = json_string_value(value);
    size_t length = text ? json_string_length(value) : 1;
    uint8_t *bytes;

    if (length % 2 == 0 && length == strspn(text, "0123456789abcdef")) {
        if (length == 0)
            return STATUS_OK;
        bytes = mem_alloc(length / 2);
        if (!bytes)
            return out_of_memory(r);
        for (size_t i = 0; i < length / 2; i++)
            bytes[i] = (uint8_t)(hex_digit(text[2 * i]) << 4 | hex_digit(text[2 * i + 1]));
        *out = (ProtobufCBinaryData){length / 2, bytes};
        return STATUS_OK;
    }
    return refuse(r, place, STATUS_ERR_INPUT, "must be bytes as a text of lower-case hexadecimal digits, two a byte%s%s",
                  text ? "" : ", not ", text ? "" : kind_word(value));
}

static status get_message(struct reading *r, const struct place *place, const json_t *value,
                          const ProtobufCMessageDescriptor *d, int depth, ProtobufCMessage **out);

/* The numbers, which are copied into the struct. */
static status get_number(const struct reading *r, const struct place *place, const json_t *value,
                         const ProtobufCFieldDescriptor *field, void *at)
{
    uint64_t u = 0;
    int64_t i = 0;
    double d = 0;
    status s;

    switch (field->type) {
    case PROTOBUF_C_TYPE_UINT32:
    case PROTOBUF_C_TYPE_FIXED32:
        if ((s = get_unsigned(r, place, value, UINT32_MAX, &u)) == STATUS_OK)
            *(uint32_t *)at = (uint32_t)u;
        return s;
    case PROTOBUF_C_TYPE_UINT64:
    case PROTOBUF_C_TYPE_FIXED64:
        if ((s = get_unsigned(r, place, value, UINT64_MAX, &u)) == STATUS_OK)
            *(uint64_t *)at = u;
        return s;
    case PROTOBUF_C_TYPE_INT32:
    case PROTOBUF_C_TYPE_SINT32:
    case PROTOBUF_C_TYPE_SFIXED32:
        if ((s = get_signed(r, place, value, INT32_MIN, INT32_MAX, &i)) == STATUS_OK)
            *(int32_t *)at = (int32_t)i;
        return s;
    case PROTOBUF_C_TYPE_INT64:
    case PROTOBUF_C_TYPE_SINT64:
    case PROTOBUF_C_TYPE_SFIXED64:
        if ((s = get_signed(r, place, value, INT64_MIN, INT64_MAX, &i)) == STATUS_OK)
            *(int64_t *)at = i;
        return s;
    default:
        TRY(get_real(r, place, value, &d));
        if (field->type == PROTOBUF_C_TYPE_DOUBLE)
            *(double *)at = d;
        else if (isfinite(d) && !isfinite((float)d))
            return refuse(r, place, STATUS_ERR_INPUT, "%g is too large", d);
        else
            *(float *)at = (float)d;
        return STATUS_OK;
    }
}

static status get_value(struct reading *r, const struct place *place, const json_t *value,
                        const ProtobufCFieldDescriptor *field, int depth, void *at)
{
    switch (field->type) {
    case PROTOBUF_C_TYPE_BOOL:
        if (!json_is_boolean(value))
            return refuse(r, place, STATUS_ERR_INPUT, "must be true or false, not %s", kind_word(value));
        *(protobuf_c_boolean *)at = json_is_true(value);
        return STATUS_OK;
    case PROTOBUF_C_TYPE_ENUM: return get_enum(r, place, value, field->descriptor, at);
    case PROTOBUF_C_TYPE_STRING: return get_text(r, place, value, at);
    case PROTOBUF_C_TYPE_BYTES: return get_bytes(r, place, value, at);
    case PROTOBUF_C_TYPE_MESSAGE: return get_message(r, place, value, field->descriptor, depth + 1, at);
    default: return get_number(r, place, value, field, at);
    }
}

/* ---- words ------------------------------------------------------------------------------------- */

static status unknown_word(const struct reading *r, const struct place *place, const char *text,
                           const char *(*word_of)(const void *words, unsigned i), const void *list)
{
    char words[640] = "";
    const char *word;

    for (unsigned i = 0; (word = word_of(list, i)) != NULL; i++)
        snprintf(words + strlen(words), sizeof words - strlen(words), "%s%s", i ? ", " : "", word);
    return refuse(r, place, STATUS_ERR_INPUT, "'%.40s' is not known; it may be %s", text, words);
}

static const char *word_of_choice(const void *choice, unsigned i)
{
    return choice_word(*(const enum choice_name *)choice, i);
}

static const char *word_of_parameter(const void *words, unsigned i) { return ((const char *const *)words)[i]; }

/* A word, or a number to `most`. */
static status get_word(const struct reading *r, const struct place *place, const json_t *value, enum choice_name choice,
                       uint64_t most, uint64_t *out)
{
    const char *text = json_string_value(value);
    int number = text ? choice_find(choice, text) : -1;

    if (number >= 0) {
        *out = (uint64_t)number;
        return STATUS_OK;
    }
    if (text && (text[0] < '0' || text[0] > '9'))
        return unknown_word(r, place, text, word_of_choice, &choice);
    return get_unsigned(r, place, value, most, out);
}

static status get_choice(struct reading *r, const struct place *place, const json_t *value,
                         const ProtobufCFieldDescriptor *field, const struct setting *choice, void *at)
{
    unsigned bits = 8 * (unsigned)field_bytes(field);
    uint64_t most = UINT64_MAX >> (64 - bits), got = 0, one = 0;
    status s = STATUS_OK;

    if (choice->kind == SETTING_KIND_SET && json_is_array(value)) {
        for (size_t i = 0; s == STATUS_OK && i < json_array_size(value); i++) {
            struct place item = {place, NULL, i};
            s = get_word(r, &item, json_array_get(value, i), choice->choice, bits - 1, &one);
            got |= s == STATUS_OK ? (uint64_t)1 << one : 0;
        }
    } else if (choice->kind == SETTING_KIND_SET) {
        s = json_is_integer(value) || json_is_string(value)
                ? get_unsigned(r, place, value, most, &got)
                : refuse(r, place, STATUS_ERR_INPUT, "must be an array of words, not %s", kind_word(value));
    } else {
        s = get_word(r, place, value, choice->choice, most, &got);
    }
    if (s == STATUS_OK && bits == 64)
        *(uint64_t *)at = got;
    else if (s == STATUS_OK)
        *(uint32_t *)at = (uint32_t)got;
    return s;
}

/* Of a parameter of the operator that the OutputSettings name; NULL: it is a number. */
static const char *const *parameter_words(const ProtobufCMessage *message, const char *key)
{
    if (message->descriptor != &azulejo__wire__output_settings__descriptor)
        return NULL;
    return tonemap_choices(((const Azulejo__Wire__OutputSettings *)(const void *)message)->tonemap, key);
}

/* The value of an operator's parameter that is a choice; numbers are read as those of others. */
static status get_parameter(const struct reading *r, const struct place *place, const char *text,
                            const char *const *choices, double *out)
{
    for (size_t i = 0; choices[i]; i++)
        if (strcmp(choices[i], text) == 0) {
            *out = (double)i;
            return STATUS_OK;
        }
    return unknown_word(r, place, text, word_of_parameter, choices);
}

/* ---- arrays, maps, messages --------------------------------------------------------------------- */

/* Zeroed room for the values; *count grows as they are read. */
static status make_room(struct reading *r, const struct place *place, const ProtobufCFieldDescriptor *field,
                        ProtobufCMessage *message, size_t count, char **values)
{
    *values = NULL;
    if (count > JSON_WIRE_ITEMS_MAX - r->items)
        return refuse(r, place, STATUS_ERR_LIMIT, "there are more than %d values in arrays", JSON_WIRE_ITEMS_MAX);
    r->items += count;
    if (count == 0)
        return STATUS_OK;
    *values = mem_calloc(count, field_bytes(field));
    if (!*values)
        return out_of_memory(r);
    *(void **)((char *)message + field->offset) = *values;
    return STATUS_OK;
}

static status get_array(struct reading *r, const struct place *place, const json_t *value,
                        const ProtobufCFieldDescriptor *field, int depth, ProtobufCMessage *message)
{
    size_t *count = (size_t *)((char *)message + field->quantifier_offset), length = json_array_size(value);
    size_t each = field_bytes(field);
    char *values = NULL;
    status s;

    if (!json_is_array(value))
        return refuse(r, place, STATUS_ERR_INPUT, "must be an array, not %s", kind_word(value));
    s = make_room(r, place, field, message, length, &values);
    for (size_t i = 0; s == STATUS_OK && i < length; i++) {
        struct place item = {place, NULL, i};
        *count = i + 1; /* what is there of it is freed with the message */
        s = get_value(r, &item, json_array_get(value, i), field, depth, values + i * each);
    }
    return s;
}

static status get_map(struct reading *r, const struct place *place, json_t *value,
                      const ProtobufCFieldDescriptor *field, int depth, ProtobufCMessage *message)
{
    size_t *count = (size_t *)((char *)message + field->quantifier_offset);
    const ProtobufCMessageDescriptor *d = field->descriptor;
    ProtobufCMessage **entries;
    const char *key;
    json_t *item;
    char *values = NULL;
    status s;

    if (!json_is_object(value))
        return refuse(r, place, STATUS_ERR_INPUT, "must be an object, not %s", kind_word(value));
    TRY(make_room(r, place, field, message, json_object_size(value), &values));
    entries = (ProtobufCMessage **)(void *)values;
    json_object_foreach (value, key, item) {
        const char *const *choices = json_is_string(item) ? parameter_words(message, key) : NULL;
        struct place named = {place, key, 0};
        ProtobufCMessage *entry = mem_alloc(d->sizeof_message);
        char *copy = mem_strdup(key);
        if (!entry || !copy) {
            mem_free(entry);
            mem_free(copy);
            return out_of_memory(r);
        }
        d->message_init(entry);
        *(char **)((char *)entry + d->fields[0].offset) = copy;
        entries[(*count)++] = entry;
        copy = (char *)entry + d->fields[1].offset;
        s = choices ? get_parameter(r, &named, json_string_value(item), choices, (double *)(void *)copy)
                    : get_value(r, &named, item, &d->fields[1], depth + 1, copy);
        if (s != STATUS_OK)
            return s;
    }
    return STATUS_OK;
}

static status unknown_key(const struct reading *r, const struct place *place, const ProtobufCMessageDescriptor *d,
                          const char *key)
{
    char known[600] = "";

    for (unsigned i = 0; i < d->n_fields; i++)
        snprintf(known + strlen(known), sizeof known - strlen(known), "%s%s", i ? ", " : "", d->fields[i].name);
    return refuse(r, place, STATUS_ERR_INPUT, "there is no field '%.64s'; the fields are: %s", key,
                  known[0] ? known : "none");
}

static status get_field(struct reading *r, const struct place *place, json_t *value,
                        const ProtobufCFieldDescriptor *field, int depth, ProtobufCMessage *message)
{
    const struct setting *choice = json_wire_choice(message->descriptor, field);

    if (choice)
        return get_choice(r, place, value, field, choice, (char *)message + field->offset);
    if (json_wire_is_map(field))
        return get_map(r, place, value, field, depth, message);
    if (field->label == PROTOBUF_C_LABEL_REPEATED)
        return get_array(r, place, value, field, depth, message);
    if (field->flags & PROTOBUF_C_FIELD_FLAG_ONEOF) {
        uint32_t *which = (uint32_t *)((char *)message + field->quantifier_offset);
        if (*which)
            return refuse(r, place, STATUS_ERR_INPUT, "excludes another field that is given");
        *which = field->id;
    }
    return get_value(r, place, value, field, depth, (char *)message + field->offset);
}

/* *out is set as soon as there is something to free. */
static status get_message(struct reading *r, const struct place *place, const json_t *value,
                          const ProtobufCMessageDescriptor *d, int depth, ProtobufCMessage **out)
{
    const char *key;
    json_t *item;

    if (!json_is_object(value))
        return refuse(r, place, STATUS_ERR_INPUT, "must be an object, not %s", kind_word(value));
    if (depth > JSON_WIRE_DEPTH_MAX)
        return refuse(r, place, STATUS_ERR_LIMIT, "more than %d objects in each other", JSON_WIRE_DEPTH_MAX);
    *out = mem_alloc(d->sizeof_message);
    if (!*out)
        return out_of_memory(r);
    d->message_init(*out);
    /* Maps last: what their words mean is in other fields. */
    for (int maps = 0; maps < 2; maps++)
        json_object_foreach ((json_t *)(uintptr_t)value, key, item) {
            const ProtobufCFieldDescriptor *field = protobuf_c_message_descriptor_get_field_by_name(d, key);
            struct place named = {place, key, 0};
            if (!field)
                return unknown_key(r, place, d, key);
            TRY(json_wire_is_map(field) == maps ? get_field(r, &named, item, field, depth, *out) : STATUS_OK);
        }
    return STATUS_OK;
}

status json_wire_get(ProtobufCMessage **out, const ProtobufCMessageDescriptor *descriptor, const char *text,
                     size_t size, struct error *err)
{
    struct reading r = {0, err};
    json_error_t why;
    json_t *root;
    status s;

    *out = NULL;
    root = size ? json_loadb(text, size, JSON_REJECT_DUPLICATES, &why) : json_object();
    if (!root && (size == 0 || json_error_code(&why) == json_error_out_of_memory))
        return error_no_memory(err, "JSON");
    if (!root)
        return error_set(err, STATUS_ERR_INPUT, "the JSON in line %d, column %d: %s", why.line, why.column, why.text);
    s = get_message(&r, NULL, root, descriptor, 1, out);
    json_decref(root);
    if (s != STATUS_OK) {
        json_wire_free(*out);
        *out = NULL;
    }
    return s;
}

/* ---- plain text ---------------------------------------------------------------------------------- */

/* What stands for the text in JSON, by the field's type; NULL: it is not UTF-8, or memory is out. */
static json_t *as_json(const ProtobufCFieldDescriptor *field, const char *text)
{
    char *end;
    double number;

    if (field->type == PROTOBUF_C_TYPE_BOOL) {
        if (strcmp(text, "1") == 0 || strcmp(text, "true") == 0)
            return json_true();
        if (strcmp(text, "0") == 0 || strcmp(text, "false") == 0)
            return json_false();
    }
    if (field->type == PROTOBUF_C_TYPE_FLOAT || field->type == PROTOBUF_C_TYPE_DOUBLE) {
        number = strtod(text, &end);
        if (end != text && *end == 0 && isfinite(number))
            return json_real(number);
    }
    return json_string(text);
}

/* What the field holds is replaced. */
static void drop_value(const ProtobufCFieldDescriptor *field, char *at)
{
    if (field->type == PROTOBUF_C_TYPE_STRING && *(char **)at != field->default_value) {
        mem_free(*(char **)at);
        *(const char **)at = field->default_value;
    } else if (field->type == PROTOBUF_C_TYPE_BYTES) {
        mem_free(((ProtobufCBinaryData *)at)->data);
        *(ProtobufCBinaryData *)at = (ProtobufCBinaryData){0};
    }
}

status json_wire_set(ProtobufCMessage *message, const char *field_name, const char *text, struct error *err)
{
    const ProtobufCFieldDescriptor *field =
        protobuf_c_message_descriptor_get_field_by_name(message->descriptor, field_name);
    struct reading r = {0, err};
    struct place place = {NULL, field_name, 0};
    json_t *value;
    status s;

    if (!field || field->label == PROTOBUF_C_LABEL_REPEATED || field->type == PROTOBUF_C_TYPE_MESSAGE)
        return refuse(&r, &place, STATUS_ERR_INTERNAL, "is no single value of %s", message->descriptor->short_name);
    value = as_json(field, text);
    if (!value)
        return refuse(&r, &place, STATUS_ERR_INPUT, "is not UTF-8");
    drop_value(field, (char *)message + field->offset);
    s = get_value(&r, &place, value, field, 1, (char *)message + field->offset);
    json_decref(value);
    return s;
}
