#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "client/import/gltf/gltf.h"

struct gltf_place gltf_at(const char *table, size_t row, const char *part)
{
    struct gltf_place place = {.table = table, .row = row};

    snprintf(place.part, sizeof place.part, "%s", part);
    return place;
}

struct gltf_place gltf_within(const struct gltf_place *place, const char *format, ...)
{
    struct gltf_place inner = *place;
    size_t length = strlen(inner.part);
    va_list args;

    va_start(args, format);
    vsnprintf(inner.part + length, sizeof inner.part - length, format, args);
    va_end(args);
    return inner;
}

status gltf_fail(struct gltf *g, status code, const struct gltf_place *place, const char *format, ...)
{
    char text[512];
    va_list args;

    va_start(args, format);
    vsnprintf(text, sizeof text, format, args);
    va_end(args);
    if (!*place->table)
        return error_set(g->err, code, "%s", text);
    return error_set(g->err, code, "%s[%zu]%s: %s", place->table, place->row, place->part, text);
}

static status wrong_kind(struct gltf *g, const struct gltf_place *at, const char *key, const char *wanted)
{
    return gltf_fail(g, STATUS_ERR_INPUT, at, "%s must be %s", key, wanted);
}

status gltf_object(struct gltf *g, json_t *in, const struct gltf_place *at, const char *key, json_t **out)
{
    json_t *value = json_object_get(in, key);

    if (value && !json_is_object(value))
        return wrong_kind(g, at, key, "an object");
    if (value)
        *out = value;
    return STATUS_OK;
}

status gltf_array(struct gltf *g, json_t *in, const struct gltf_place *at, const char *key, json_t **out)
{
    json_t *value = json_object_get(in, key);

    if (value && !json_is_array(value))
        return wrong_kind(g, at, key, "an array");
    if (value)
        *out = value;
    return STATUS_OK;
}

status gltf_text(struct gltf *g, json_t *in, const struct gltf_place *at, const char *key, const char **out)
{
    json_t *value = json_object_get(in, key);

    if (value && !json_is_string(value))
        return wrong_kind(g, at, key, "a string");
    if (value)
        *out = json_string_value(value);
    return STATUS_OK;
}

status gltf_flag(struct gltf *g, json_t *in, const struct gltf_place *at, const char *key, int *out)
{
    json_t *value = json_object_get(in, key);

    if (value && !json_is_boolean(value))
        return wrong_kind(g, at, key, "true or false");
    if (value)
        *out = json_is_true(value);
    return STATUS_OK;
}

status gltf_number(struct gltf *g, json_t *in, const struct gltf_place *at, const char *key, double *out)
{
    json_t *value = json_object_get(in, key);

    if (value && (!json_is_number(value) || !isfinite(json_number_value(value))))
        return wrong_kind(g, at, key, "a number");
    if (value)
        *out = json_number_value(value);
    return STATUS_OK;
}

status gltf_numbers(struct gltf *g, json_t *in, const struct gltf_place *at, const char *key, size_t count, double *out)
{
    json_t *value = json_object_get(in, key);

    if (!value)
        return STATUS_OK;
    if (!json_is_array(value) || json_array_size(value) != count)
        return gltf_fail(g, STATUS_ERR_INPUT, at, "%s must be an array of %zu numbers", key, count);
    for (size_t i = 0; i < count; i++) {
        json_t *item = json_array_get(value, i);
        if (!json_is_number(item) || !isfinite(json_number_value(item)))
            return gltf_fail(g, STATUS_ERR_INPUT, at, "%s must be an array of %zu numbers", key, count);
        out[i] = json_number_value(item);
    }
    return STATUS_OK;
}

status gltf_size(struct gltf *g, json_t *in, const struct gltf_place *at, const char *key, uint64_t *out)
{
    json_t *value = json_object_get(in, key);
    double number;

    if (!value)
        return STATUS_OK;
    /* Some writers spell integers as 3.0. */
    number = json_is_number(value) ? json_number_value(value) : -1;
    if (!(number >= 0 && number <= 9007199254740992.0) || number != floor(number))
        return wrong_kind(g, at, key, "an integer that is not negative");
    *out = (uint64_t)number;
    return STATUS_OK;
}

status gltf_index(struct gltf *g, json_t *in, const struct gltf_place *at, const char *key, json_t *table, int64_t *out)
{
    uint64_t index = UINT64_MAX;
    status result = gltf_size(g, in, at, key, &index);

    if (result != STATUS_OK || index == UINT64_MAX)
        return result;
    if (index >= json_array_size(table))
        return gltf_fail(g, STATUS_ERR_INPUT, at, "%s is %llu, but the file has %zu of these", key,
                         (unsigned long long)index, json_array_size(table));
    *out = (int64_t)index;
    return STATUS_OK;
}

status gltf_row(struct gltf *g, json_t *table, const struct gltf_place *at, json_t **out)
{
    *out = json_array_get(table, at->row);
    if (!json_is_object(*out))
        return gltf_fail(g, STATUS_ERR_INPUT, at, "must be an object");
    return STATUS_OK;
}

json_t *gltf_extension(json_t *in, const char *name)
{
    json_t *extension = json_object_get(json_object_get(in, "extensions"), name);

    return json_is_object(extension) ? extension : NULL;
}
