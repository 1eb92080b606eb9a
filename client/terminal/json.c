#include "client/terminal/json.h"

#include <math.h>
#include <stdio.h>

#include "client/terminal/must.h"
#include "common/base/number.h"
#include "protocol/json/json_wire.h"

json_t *json_number(double value) { return isfinite(value) ? json_real(value) : json_null(); }

json_t *json_number_float(float value) { return json_number(number_of_float(value)); }

json_t *json_text(const char *text)
{
    json_t *value = json_string(text);

    return value ? value : json_string("(not UTF-8)");
}

json_t *json_message(const ProtobufCMessage *message)
{
    struct buffer text = BUFFER_INIT;
    json_t *value;

    json_wire_put(&text, message);
    must_hold(&text);
    value = must(json_loadb(buffer_text(&text), text.size, 0, NULL));
    buffer_release(&text);
    return value;
}

static int append(const char *text, size_t size, void *out)
{
    buffer_append(out, text, size);
    return 0;
}

enum { ONE_LINE = -1 };          /* a level */

static int below(int level) { return level == ONE_LINE ? ONE_LINE : level + 1; }

static void new_line(struct buffer *out, int level)
{
    if (level != ONE_LINE)
        buffer_printf(out, "\n%*s", 2 * level, "");
}

static void write_value(struct buffer *out, const json_t *value, int level);

static void write_object(struct buffer *out, const json_t *object, int level)
{
    const char *between = "{", *key;
    json_t *member;

    json_object_foreach((json_t *)object, key, member) {
        json_t *name = json_text(key);

        buffer_puts(out, between);
        new_line(out, below(level));
        write_value(out, name, level);
        buffer_puts(out, ": ");
        write_value(out, member, below(level));
        between = level == ONE_LINE ? ", " : ",";
        json_decref(name);
    }
    if (json_object_size(object) > 0)
        new_line(out, level);
    buffer_puts(out, json_object_size(object) > 0 ? "}" : "{}");
}

static void write_array(struct buffer *out, const json_t *array, int level)
{
    for (size_t i = 0; i < json_array_size(array); i++) {
        buffer_puts(out, i ? (level == ONE_LINE ? ", " : ",") : "[");
        new_line(out, below(level));
        write_value(out, json_array_get(array, i), below(level));
    }
    if (json_array_size(array) > 0)
        new_line(out, level);
    buffer_puts(out, json_array_size(array) > 0 ? "]" : "[]");
}

static void write_value(struct buffer *out, const json_t *value, int level)
{
    char text[NUMBER_TEXT_SIZE];

    if (json_is_object(value))
        write_object(out, value, level);
    else if (json_is_array(value))
        write_array(out, value, level);
    else if (json_is_real(value))
        buffer_puts(out, number_text(text, json_real_value(value)));
    else
        must_(json_dump_callback(value, append, out, JSON_ENCODE_ANY) == 0);
}

void json_write(struct buffer *out, const json_t *value) { write_value(out, value, 0); }

static status print(json_t *value, int level, struct error *err)
{
    struct buffer text = BUFFER_INIT;
    status result = STATUS_OK;

    write_value(&text, value, level);
    buffer_puts(&text, "\n");
    must_hold(&text);
    if (fwrite(text.data, 1, text.size, stdout) != text.size)
        result = error_set(err, STATUS_ERR_IO, "standard output cannot be written");
    buffer_release(&text);
    json_decref(value);
    return result;
}

status json_print(json_t *value, struct error *err) { return print(value, 0, err); }

status json_print_line(json_t *value, struct error *err) { return print(value, ONE_LINE, err); }
