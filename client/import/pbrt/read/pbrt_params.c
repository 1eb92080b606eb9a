#include "client/import/pbrt/read/pbrt_params.h"

#include <stdio.h>
#include <string.h>

#include "client/terminal/must.h"
#include "common/base/memory.h"

/* A type's name, the count of numbers in one value, and its enum. */
static const struct {
    const char *word;
    enum pbrt_type type;
    unsigned width;
} types[] = {
    {"bool", PBRT_BOOL, 1},          {"integer", PBRT_INTEGER, 1},
    {"float", PBRT_FLOAT, 1},        {"point2", PBRT_POINT2, 2},
    {"vector2", PBRT_VECTOR2, 2},    {"point3", PBRT_POINT3, 3},
    {"vector3", PBRT_VECTOR3, 3},    {"point", PBRT_POINT3, 3},
    {"vector", PBRT_VECTOR3, 3},     {"normal", PBRT_NORMAL, 3},
    {"normal3", PBRT_NORMAL, 3},     {"rgb", PBRT_RGB, 3},
    {"color", PBRT_RGB, 3},          {"xyz", PBRT_RGB, 3},
    {"blackbody", PBRT_BLACKBODY, 1}, {"spectrum", PBRT_SPECTRUM, 1},
    {"string", PBRT_STRING, 1},      {"texture", PBRT_TEXTURE, 1},
};
static const char *const type_words[PBRT_TYPE_COUNT] = {
    "bool",    "integer", "float", "point2",    "vector2",  "point3", "vector3",
    "normal",  "rgb",     "blackbody", "spectrum", "string", "texture"};

void pbrt_params_release(struct pbrt_params *p)
{
    mem_free(p->items);
    mem_free(p->numbers);
    mem_free(p->strings);
    mem_free(p->string_offsets);
    buffer_release(&p->text);
    memset(p, 0, sizeof *p);
}

/* ---- reading ------------------------------------------------------------------------------ */

/* "type name" */
static int parse_declaration(const char *text, size_t *type, const char **name)
{
    size_t skip = strspn(text, " \t"), length = strcspn(text + skip, " \t");

    for (size_t i = 0; i < sizeof types / sizeof *types; i++)
        if (strlen(types[i].word) == length && memcmp(types[i].word, text + skip, length) == 0) {
            *type = i;
            *name = text + skip + length + strspn(text + skip + length, " \t");
            return **name != 0;
        }
    return 0;
}

static void keep_text(struct pbrt_params *p, const char *text, size_t *offset)
{
    *offset = p->text.size;
    buffer_append(&p->text, text, strlen(text) + 1);
    must_hold(&p->text);
}

static void add_number(struct pbrt_params *p, double value)
{
    MUST_GROW(p->numbers, p->number_capacity, p->number_count + 1);
    p->numbers[p->number_count++] = value;
}

static status add_value(struct pbrt_params *p, struct pbrt_param *param, enum pbrt_type type,
                        const struct pbrt_token *t, struct builder *b)
{
    const int words = type == PBRT_STRING || type == PBRT_TEXTURE;
    double value;

    if (type == PBRT_BOOL && (strcmp(t->text, "true") == 0 || strcmp(t->text, "false") == 0)) {
        param->number_count++;
        add_number(p, t->text[0] == 't');
        return STATUS_OK;
    }
    if (t->kind == TOKEN_STRING && (words || type == PBRT_SPECTRUM)) {
        MUST_GROW(p->string_offsets, p->offset_capacity, p->string_count + 1);
        param->string_count++;
        keep_text(p, t->text, &p->string_offsets[p->string_count++]);
        return STATUS_OK;
    }
    if (t->kind == TOKEN_STRING || words || type == PBRT_BOOL || !pbrt_number(t->text, &value))
        return pbrt_error(b->err, STATUS_ERR_INPUT, &t->at, "\"%s %.60s\" cannot have the value %s%.60s%s",
                          type_words[type], (const char *)p->text.data + param->name_offset,
                          t->kind == TOKEN_STRING ? "\"" : "", t->text, t->kind == TOKEN_STRING ? "\"" : "");
    param->number_count++;
    add_number(p, value);
    return STATUS_OK;
}

static status read_values(struct pbrt_params *p, struct pbrt_param *param, size_t type, struct pbrt_reader *r,
                          struct builder *b)
{
    struct pbrt_token t;
    status result = pbrt_next(r, &t, b->err);
    unsigned width = types[type].width;

    if (result != STATUS_OK)
        return result;
    if (t.kind == TOKEN_OPEN) {
        for (;;) {
            TRY(pbrt_next(r, &t, b->err));
            if (t.kind == TOKEN_CLOSE)
                break;
            if (t.kind == TOKEN_END || t.kind == TOKEN_OPEN)
                return pbrt_error(b->err, STATUS_ERR_INPUT, &param->at, "a list of values has no closing bracket");
            TRY(add_value(p, param, param->type, &t, b));
        }
    } else if (t.kind == TOKEN_WORD || t.kind == TOKEN_STRING) {
        result = add_value(p, param, param->type, &t, b);
    } else {
        result = pbrt_error(b->err, STATUS_ERR_INPUT, &t.at, "a value is missing");
    }
    if (result != STATUS_OK)
        return result;
    /* A spectrum is pairs of wavelength and value, a blackbody in pbrt-v3 two numbers. */
    if (param->type == PBRT_SPECTRUM && param->string_count == 0)
        width = 2;
    if (param->number_count % width != 0 || (!param->number_count && !param->string_count))
        return pbrt_error(b->err, STATUS_ERR_INPUT, &param->at, "\"%s %.60s\" has %zu numbers: it takes them by %u",
                          types[type].word, (const char *)p->text.data + param->name_offset, param->number_count,
                          width);
    if (strcmp(types[type].word, "xyz") == 0) {
        static const double m[3][3] = {{3.2404542, -1.5371385, -0.4985314},
                                       {-0.9692660, 1.8760108, 0.0415560},
                                       {0.0556434, -0.2040259, 1.0572252}};
        for (size_t i = 0; i < param->number_count; i += 3) {
            double *n = p->numbers + param->first_number + i, rgb[3];
            for (int c = 0; c < 3; c++)
                rgb[c] = m[c][0] * n[0] + m[c][1] * n[1] + m[c][2] * n[2];
            memcpy(n, rgb, sizeof rgb);
        }
    }
    return STATUS_OK;
}

/* Turn offsets into pointers once the buffers no longer move. */
static void settle(struct pbrt_params *p)
{
    MUST_GROW(p->strings, p->string_capacity, p->string_count + 1);
    for (size_t i = 0; i < p->string_count; i++)
        p->strings[i] = (const char *)p->text.data + p->string_offsets[i];
    for (size_t i = 0; i < p->count; i++) {
        struct pbrt_param *param = &p->items[i];
        param->name = (const char *)p->text.data + param->name_offset;
        param->numbers = p->numbers ? p->numbers + param->first_number : NULL;
        param->strings = p->strings + param->first_string;
    }
}

status pbrt_params_read(struct pbrt_params *p, struct pbrt_reader *r, struct builder *b)
{
    p->count = p->number_count = p->string_count = 0;
    p->defaults = NULL;
    buffer_clear(&p->text);
    for (;;) {
        struct pbrt_param *param;
        struct pbrt_token t;
        const char *name;
        size_t type;
        status result;

        TRY(pbrt_peek(r, &t, b->err));
        if (t.kind != TOKEN_STRING) {
            settle(p);
            return STATUS_OK;
        }
        if (!parse_declaration(t.text, &type, &name))
            return pbrt_error(b->err, STATUS_ERR_INPUT, &t.at,
                              "\"%.80s\" is not a parameter: a type and a name are expected, as "
                              "\"float radius\"",
                              t.text);
        if (p->count >= PBRT_PARAMS_MAX)
            return pbrt_error(b->err, STATUS_ERR_LIMIT, &t.at, "more than %d parameters for one directive",
                              PBRT_PARAMS_MAX);
        MUST_GROW(p->items, p->capacity, p->count + 1);
        param = &p->items[p->count];
        *param = (struct pbrt_param){.type = types[type].type,
                                     .at = t.at,
                                     .first_number = p->number_count,
                                     .first_string = p->string_count};
        keep_text(p, name, &param->name_offset);
        result = pbrt_next(r, &t, b->err); /* the one that was peeked */
        THEN(result, read_values(p, param, type, r, b));
        if (result != STATUS_OK)
            return result;
        p->count++;
    }
}

struct pbrt_params *pbrt_params_copy(const struct pbrt_params *p, struct arena *arena)
{
    struct pbrt_params *copy = must(ARENA_NEW(arena, struct pbrt_params));

    copy->count = p->count;
    copy->defaults = p->defaults;
    copy->color_space = p->color_space;
    copy->items = must(ARENA_ARRAY(arena, struct pbrt_param, p->count + 1));
    for (size_t i = 0; i < p->count; i++) {
        const struct pbrt_param *from = &p->items[i];
        double *numbers = must(ARENA_ARRAY(arena, double, from->number_count + 1));
        const char **strings = must(ARENA_ARRAY(arena, const char *, from->string_count + 1));
        copy->items[i] = *from;
        copy->items[i].name = must(arena_strdup(arena, from->name));
        if (from->number_count)
            memcpy(numbers, from->numbers, from->number_count * sizeof *numbers);
        for (size_t s = 0; s < from->string_count; s++)
            strings[s] = must(arena_strdup(arena, from->strings[s]));
        copy->items[i].numbers = numbers;
        copy->items[i].strings = strings;
    }
    return copy;
}

/* ---- asking ------------------------------------------------------------------------------- */

const struct pbrt_param *pbrt_param(struct pbrt_params *p, const char *name, unsigned mask)
{
    for (; p; p = p->defaults)
        for (size_t i = 0; i < p->count; i++)
            if (strcmp(p->items[i].name, name) == 0 && (mask & PBRT_BIT(p->items[i].type))) {
                p->items[i].used = 1;
                return &p->items[i];
            }
    return NULL;
}

int pbrt_has(const struct pbrt_params *p, const char *name)
{
    for (; p; p = p->defaults)
        for (size_t i = 0; i < p->count; i++)
            if (strcmp(p->items[i].name, name) == 0)
                return 1;
    return 0;
}

void pbrt_ignore(struct pbrt_params *p, const char *const *names)
{
    for (; *names; names++)
        (void)pbrt_param(p, *names, ~0u);
}

double pbrt_float(struct pbrt_params *p, const char *name, double otherwise)
{
    const struct pbrt_param *param = pbrt_param(p, name, PBRT_NUMBERS);

    return param ? param->numbers[0] : otherwise;
}

long pbrt_integer(struct pbrt_params *p, const char *name, long otherwise)
{
    double value = pbrt_float(p, name, (double)otherwise);

    return value > -1e15 && value < 1e15 ? (long)value : otherwise;
}

int pbrt_bool(struct pbrt_params *p, const char *name, int otherwise)
{
    const struct pbrt_param *param = pbrt_param(p, name, PBRT_BIT(PBRT_BOOL));

    return param ? param->numbers[0] != 0 : otherwise;
}

const char *pbrt_string(struct pbrt_params *p, const char *name, const char *otherwise)
{
    const struct pbrt_param *param = pbrt_param(p, name, PBRT_BIT(PBRT_STRING));

    return param ? param->strings[0] : otherwise;
}

int pbrt_triple(struct pbrt_params *p, const char *name, double out[3])
{
    const struct pbrt_param *param = pbrt_param(p, name, PBRT_TRIPLES);

    if (!param)
        return 0;
    memcpy(out, param->numbers, 3 * sizeof *out);
    return 1;
}

void pbrt_params_report(struct pbrt_params *p, struct builder *b, const char *what)
{
    for (size_t i = 0; i < p->count; i++) {
        struct pbrt_param *param = &p->items[i];
        char kind[PBRT_STRING_BYTES_MAX];
        if (param->used)
            continue;
        param->used = 1; /* reported once */
        snprintf(kind, sizeof kind, "parameter %s %.100s %s", what, param->name, type_words[param->type]);
        builder_warn_at(b, param->at.file, param->at.line, kind,
                        "%s: the parameter \"%s %.100s\" is not known or not supported here: "
                        "ignored",
                        what, type_words[param->type], param->name);
    }
}

void pbrt_params_untaken(const struct pbrt_params *p, struct builder *b)
{
    for (size_t i = 0; i < p->count; i++) {
        const struct pbrt_param *param = &p->items[i];
        char kind[PBRT_STRING_BYTES_MAX];
        if (param->used)
            continue;
        snprintf(kind, sizeof kind, "attribute %.100s %s", param->name, type_words[param->type]);
        builder_warn_at(b, param->at.file, param->at.line, kind, "Attribute: nothing that follows takes the parameter \"%s %.100s\": ignored",
                        type_words[param->type], param->name);
    }
}
