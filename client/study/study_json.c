/* Writes and reads a study as JSON, by the tables of study_fields.h. */
#include <math.h>
#include <openssl/evp.h>
#include <stdio.h>
#include <string.h>

#include "client/terminal/json.h"
#include "client/study/data/study_fields.h"
#include "client/terminal/must.h"
#include "common/base/memory.h"
#include "common/image/image.h"

enum { FORMAT_VERSION = 1, PLACE_SIZE = 256 };
#define FORMAT_KEY "azulejo_study"

/* ---- writing ------------------------------------------------------------------------------- */

static json_t *part_json(const void *part, const struct study_shape *shape, struct error *err);

static json_t *interval_json(const char *at)
{
    struct study_interval v;

    memcpy(&v, at, sizeof v);
    return json_pack("[o, o, o]", json_number(v.value), json_number(v.low), json_number(v.high));
}

static json_t *picture_json(const char *at, struct error *err)
{
    struct study_picture picture;
    struct buffer png = BUFFER_INIT, text = BUFFER_INIT;
    json_t *value = NULL;

    memcpy(&picture, at, sizeof picture);
    if (!picture.rgb)
        return json_null();
    if (study_picture_png(&png, &picture, err) == STATUS_OK) {
        study_base64(&text, png.data, png.size);
        must_hold(&text);
        value = json_string(buffer_text(&text));
    }
    buffer_release(&text);
    buffer_release(&png);
    return value;
}

static json_t *list_json(const struct study_field *f, const char *at, struct error *err)
{
    struct study_any_list list;
    json_t *array = json_array();

    memcpy(&list, at, sizeof list);
    for (size_t i = 0; i < list.count; i++) {
        const char *item = list.items;
        json_t *value;
        if (f->kind == STUDY_NUMBERS) {
            double number;
            memcpy(&number, item + i * sizeof number, sizeof number);
            value = json_number(number);
        } else {
            value = part_json(item + i * f->shape->size_bytes, f->shape, err);
        }
        if (json_array_append_new(array, value) != 0) {
            json_decref(array);
            return NULL;
        }
    }
    return array;
}

static json_t *field_json(const struct study_field *f, const char *at, struct error *err)
{
    double number;
    int flag;
    char *text;

    switch (f->kind) {
    case STUDY_NUMBER: memcpy(&number, at, sizeof number); return json_number(number);
    case STUDY_FLAG: memcpy(&flag, at, sizeof flag); return json_boolean(flag);
    case STUDY_TEXT: memcpy(&text, at, sizeof text); return text ? json_text(text) : json_null();
    case STUDY_INTERVAL: return interval_json(at);
    case STUDY_PIXELS: return picture_json(at, err);
    case STUDY_PART: return part_json(at, f->shape, err);
    case STUDY_NUMBERS:
    case STUDY_ITEMS: return list_json(f, at, err);
    }
    return NULL;
}

static json_t *part_json(const void *part, const struct study_shape *shape, struct error *err)
{
    json_t *object = json_object();

    for (const struct study_field *f = shape->fields; f->name; f++)
        if (json_object_set_new(object, f->name, field_json(f, (const char *)part + f->offset,
                                                            err)) != 0) {
            json_decref(object);
            return NULL;
        }
    return object;
}

status study_write(struct buffer *out, const struct study *s, struct error *err)
{
    struct error inner = {0};
    json_t *body = part_json(s, &study_shape_study, &inner);
    json_t *whole = body ? json_pack("{s:i}", FORMAT_KEY, FORMAT_VERSION) : NULL;
    status result = STATUS_OK;

    if (!whole || json_object_update(whole, body) != 0)
        result = error_set(err, inner.code, "%s", inner.text);
    else
        json_write(out, whole);
    buffer_puts(out, "\n");
    must_hold(out);
    json_decref(whole);
    json_decref(body);
    return result;
}

/* ---- reading ------------------------------------------------------------------------------- */

struct reader {
    const char *name;
    char place[PLACE_SIZE]; /* "questions[2].choices[0].gain" */
    struct error *err;
};

static status part_read(struct reader *r, void *part, const struct study_shape *shape, const json_t *object);

static status refuse(struct reader *r, const char *wanted)
{
    return error_set(r->err, STATUS_ERR_INPUT, "%s: %s is not %s; make the study again, or correct the file", r->name,
                     r->place[0] ? r->place : "the document", wanted);
}

static int number_read(const json_t *value, double *out)
{
    *out = json_is_number(value) ? json_number_value(value) : NAN;
    return json_is_number(value) || json_is_null(value);
}

static status interval_read(struct reader *r, char *at, const json_t *value)
{
    struct study_interval v;

    if (json_array_size(value) != 3 || !number_read(json_array_get(value, 0), &v.value) ||
        !number_read(json_array_get(value, 1), &v.low) || !number_read(json_array_get(value, 2), &v.high) ||
        v.low > v.high)
        return refuse(r, "[value, low, high]");
    memcpy(at, &v, sizeof v);
    return STATUS_OK;
}

static status text_read(struct reader *r, char *at, const json_t *value)
{
    char *text = NULL;

    if (json_is_null(value))
        return STATUS_OK;
    if (!json_is_string(value) || json_string_length(value) > STUDY_TEXT_MAX)
        return refuse(r, "a text of at most 4096 bytes");
    text = must(mem_strdup(json_string_value(value)));
    memcpy(at, &text, sizeof text);
    return STATUS_OK;
}

/* Decode base64; *size_bytes is set. NULL: invalid, or out of memory. */
static uint8_t *base64_read(const char *text, size_t length, size_t *size_bytes)
{
    uint8_t *bytes = length % 4 == 0 && length < 1 << 28 ? must(mem_alloc(length / 4 * 3 + 1)) : NULL;
    int got = bytes ? EVP_DecodeBlock(bytes, (const uint8_t *)text, (int)length) : -1;

    if (got < 0) {
        mem_free(bytes);
        return NULL;
    }
    *size_bytes = (size_t)got; /* padding remains at the end, which PNG ignores */
    return bytes;
}

static status picture_read(struct reader *r, char *at, const json_t *value)
{
    struct study_picture picture = {0};
    struct image8 image = {0};
    size_t size_bytes;
    uint8_t *png;
    status result;

    if (json_is_null(value))
        return STATUS_OK;
    png = json_is_string(value) ? base64_read(json_string_value(value), json_string_length(value), &size_bytes) : NULL;
    if (!png)
        return refuse(r, "a PNG file in base64");
    result = png_decode(&image, png, size_bytes, r->place, r->err);
    mem_free(png);
    if (result != STATUS_OK) {
        error_prefix(r->err, "%s", r->name);
    } else if (image.channels != 3 || image.bits != 8 || image.width > STUDY_PICTURE_SIDE_MAX ||
               image.height > STUDY_PICTURE_SIDE_MAX) {
        result = refuse(r, "an RGB picture of 8 bits and at most 1024 x 1024 pixels");
    } else {
        picture = (struct study_picture){image.width, image.height, image.pixels};
        image.pixels = NULL;
        memcpy(at, &picture, sizeof picture);
    }
    image8_release(&image);
    return result;
}

static status list_read(struct reader *r, const struct study_field *f, char *at, const json_t *value)
{
    const size_t most = f->kind == STUDY_NUMBERS ? STUDY_NUMBERS_MAX : STUDY_LIST_MAX;
    const size_t place = strlen(r->place);
    status result = STATUS_OK;

    if (!json_is_array(value))
        return refuse(r, "a list");
    if (json_array_size(value) > most)
        return error_set(r->err, STATUS_ERR_LIMIT, "%s: %s has %zu entries, more than %zu", r->name, r->place,
                         json_array_size(value), most);
    for (size_t i = 0; i < json_array_size(value) && result == STATUS_OK; i++) {
        const json_t *entry = json_array_get(value, i);

        snprintf(r->place + place, PLACE_SIZE - place, "[%zu]", i);
        if (f->kind == STUDY_NUMBERS) {
            double number;
            if (!number_read(entry, &number))
                result = refuse(r, "a number or null");
            else
                study_numbers_add(at, number);
        } else {
            result = part_read(r, study_list_add(at, f->shape, most), f->shape, entry);
        }
    }
    r->place[place] = 0;
    return result;
}

static status field_read(struct reader *r, const struct study_field *f, char *at, const json_t *value)
{
    double number;
    int flag;

    switch (f->kind) {
    case STUDY_NUMBER:
        if (!number_read(value, &number))
            return refuse(r, "a number or null");
        memcpy(at, &number, sizeof number);
        return STATUS_OK;
    case STUDY_FLAG:
        if (!json_is_boolean(value))
            return refuse(r, "true or false");
        flag = json_is_true(value);
        memcpy(at, &flag, sizeof flag);
        return STATUS_OK;
    case STUDY_TEXT: return text_read(r, at, value);
    case STUDY_INTERVAL: return interval_read(r, at, value);
    case STUDY_PIXELS: return picture_read(r, at, value);
    case STUDY_PART: return part_read(r, at, f->shape, value);
    case STUDY_NUMBERS:
    case STUDY_ITEMS: return list_read(r, f, at, value);
    }
    return STATUS_OK;
}

/* A missing field stays unknown, so files of an older release stay readable. */
static status part_read(struct reader *r, void *part, const struct study_shape *shape, const json_t *object)
{
    const size_t place = strlen(r->place);
    status result = STATUS_OK;

    if (!json_is_object(object))
        return refuse(r, "an object");
    for (const struct study_field *f = shape->fields; f->name && result == STATUS_OK; f++) {
        const json_t *value = json_object_get(object, f->name);

        if (!value)
            continue;
        snprintf(r->place + place, PLACE_SIZE - place, "%s%s", place ? "." : "", f->name);
        result = field_read(r, f, (char *)part + f->offset, value);
    }
    if (result == STATUS_OK)
        r->place[place] = 0;
    return result;
}

static status tail_check(const struct study *s, const char *name, struct error *err)
{
    if (s->tail.pixels.count == s->tail.error.count)
        return STATUS_OK;
    return error_set(err, STATUS_ERR_INPUT,
                     "%s: tail has %zu pixels for %zu errors; make the study again, or correct the file", name,
                     s->tail.pixels.count, s->tail.error.count);
}

static status maps_check(const struct study *s, const char *name, struct error *err)
{
    const struct study_map *maps[] = {&s->tile_error, &s->tile_samples};

    for (size_t i = 0; i < 2; i++) {
        const struct study_map *m = maps[i];
        if (m->values.count && !(m->columns >= 1 && m->rows >= 1 && m->columns == floor(m->columns) &&
                                 m->rows == floor(m->rows) && m->columns * m->rows == (double)m->values.count))
            return error_set(err, STATUS_ERR_INPUT,
                             "%s: %s has %zu values, which is not its columns times its rows; make "
                             "the study again, or correct the file",
                             name, i ? "tile_samples" : "tile_error", m->values.count);
    }
    return STATUS_OK;
}

status study_read(struct study *s, const char *json, size_t size_bytes, const char *name, struct error *err)
{
    struct reader r = {.name = name, .err = err};
    json_error_t where;
    json_t *whole = json_loadb(json, size_bytes, 0, &where);
    status result;

    if (!whole)
        return error_set(err, STATUS_ERR_INPUT, "%s: line %d: %s; it is not a study's JSON file", name, where.line,
                         where.text);
    if (json_integer_value(json_object_get(whole, FORMAT_KEY)) != FORMAT_VERSION)
        result = error_set(err, STATUS_ERR_INPUT,
                           "%s: it is not a study that this release of azulejo can read (\"%s\" is "
                           "not %d)",
                           name, FORMAT_KEY, FORMAT_VERSION);
    else
        result = part_read(&r, s, &study_shape_study, whole);
    THEN(result, maps_check(s, name, err));
    THEN(result, tail_check(s, name, err));
    json_decref(whole);
    return result;
}
