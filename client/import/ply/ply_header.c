/* The header of a PLY file. */
#include <stdio.h>
#include <string.h>

#include "client/import/builder/scan.h"
#include "client/import/ply/ply_parts.h"
#include "client/terminal/must.h"

struct word {
    const char *text;
    size_t length;
};

/* The line at p->at without its end, which may be any of LF, CR LF and CR. */
static status next_line(struct ply *p, struct word *out)
{
    const uint8_t *end = p->at;
    size_t room = (size_t)(p->end - p->at);

    while (end < p->end && *end != '\n' && *end != '\r')
        if ((size_t)(++end - p->at) > PLY_HEADER_LINE_BYTES_MAX)
            return error_set(p->err, STATUS_ERR_LIMIT, "line %zu of the header is longer than %d bytes", p->line + 1,
                             PLY_HEADER_LINE_BYTES_MAX);
    if (room == 0 || end == p->end)
        return error_set(p->err, STATUS_ERR_INPUT, "the PLY header has no end_header: the file is cut short");
    *out = (struct word){(const char *)p->at, (size_t)(end - p->at)};
    p->at = end + 1;
    if (*end == '\r' && p->at < p->end && *p->at == '\n')
        p->at++;
    p->line++;
    return STATUS_OK;
}

/* Cut the first word off `line`. */
static struct word next_word(struct word *line)
{
    struct word out;

    while (line->length && (*line->text == ' ' || *line->text == '\t'))
        line->text++, line->length--;
    out.text = line->text;
    while (line->length && *line->text != ' ' && *line->text != '\t')
        line->text++, line->length--;
    out.length = (size_t)(line->text - out.text);
    return out;
}

static int word_is(struct word w, const char *text)
{
    return w.length == strlen(text) && memcmp(w.text, text, w.length) == 0;
}

static enum ply_type parse_type(struct word w)
{
    static const struct {
        const char *old_name, *new_name;
        enum ply_type type;
    } types[] = {{"char", "int8", TYPE_I8},      {"uchar", "uint8", TYPE_U8},
                 {"short", "int16", TYPE_I16},   {"ushort", "uint16", TYPE_U16},
                 {"int", "int32", TYPE_I32},     {"uint", "uint32", TYPE_U32},
                 {"float", "float32", TYPE_F32}, {"double", "float64", TYPE_F64}};

    for (size_t i = 0; i < sizeof types / sizeof *types; i++)
        if (word_is(w, types[i].old_name) || word_is(w, types[i].new_name))
            return types[i].type;
    return TYPE_NONE;
}

static enum ply_role parse_role(struct word w)
{
    static const struct {
        const char *name;
        enum ply_role role;
    } names[] = {{"x", ROLE_X},
                 {"y", ROLE_Y},
                 {"z", ROLE_Z},
                 {"nx", ROLE_NX},
                 {"ny", ROLE_NY},
                 {"nz", ROLE_NZ},
                 {"u", ROLE_U},
                 {"v", ROLE_V},
                 {"s", ROLE_U},
                 {"t", ROLE_V},
                 {"texture_u", ROLE_U},
                 {"texture_v", ROLE_V},
                 {"texture_s", ROLE_U},
                 {"texture_t", ROLE_V},
                 {"red", ROLE_RED},
                 {"green", ROLE_GREEN},
                 {"blue", ROLE_BLUE},
                 {"alpha", ROLE_ALPHA},
                 {"r", ROLE_RED},
                 {"g", ROLE_GREEN},
                 {"b", ROLE_BLUE},
                 {"diffuse_red", ROLE_RED},
                 {"diffuse_green", ROLE_GREEN},
                 {"diffuse_blue", ROLE_BLUE}};

    for (size_t i = 0; i < sizeof names / sizeof *names; i++)
        if (word_is(w, names[i].name))
            return names[i].role;
    return ROLE_NONE;
}

static status parse_format(struct ply *p, struct word line)
{
    struct word name = next_word(&line), version = next_word(&line);

    p->format = word_is(name, "ascii")                  ? FORMAT_ASCII
                : word_is(name, "binary_little_endian") ? FORMAT_LITTLE
                : word_is(name, "binary_big_endian")    ? FORMAT_BIG
                                                        : FORMAT_NONE;
    if (p->format == FORMAT_NONE || !word_is(version, "1.0"))
        return error_set(p->err, STATUS_ERR_UNSUPPORTED,
                         "line %zu: the format \"%.*s %.*s\" is unknown: ascii, "
                         "binary_little_endian and binary_big_endian 1.0 are read",
                         p->line, (int)(name.length < 40 ? name.length : 40), name.text,
                         (int)(version.length < 40 ? version.length : 40), version.text);
    return STATUS_OK;
}

/* Note what no picture shows: a property of the element, or an element. */
static void note_unread(struct ply *p, const char *what, struct word name, const char *of)
{
    char *unread = p->report.unread, more[64];
    size_t used = strlen(unread);
    int length = snprintf(more, sizeof more, "%s%s%.*s%s", used ? ", " : "", what,
                          (int)(name.length < 32 ? name.length : 32), name.text, of);

    if (used + (size_t)length + strlen(", ...") <= PLY_UNREAD_BYTES_MAX)
        memcpy(unread + used, more, (size_t)length + 1);
    else if (used < 3 || strcmp(unread + used - 3, "...") != 0)
        memcpy(unread + used, ", ...", sizeof ", ...");
}

static status parse_element(struct ply *p, struct word line)
{
    struct word name = next_word(&line), number = next_word(&line);
    struct element *element = &p->elements[p->element_count];
    int64_t count = -1;

    if (p->element_count == PLY_ELEMENTS_MAX)
        return error_set(p->err, STATUS_ERR_LIMIT, "line %zu: more than %d elements", p->line, PLY_ELEMENTS_MAX);
    if (name.length == 0 || number.length == 0 ||
        scan_integer(number.text, number.text + number.length, &count) != number.length ||
        count < 0)
        return error_set(p->err, STATUS_ERR_INPUT,
                         "line %zu: an element needs a name and how many there are", p->line);
    *element = (struct element){.kind = ELEMENT_OTHER,
                                .count = (uint64_t)count,
                                .first_property = (uint32_t)p->property_count};
    if (word_is(name, "vertex") && !p->has_vertices) {
        element->kind = ELEMENT_VERTEX;
        p->has_vertices = 1;
        if (count >= UINT32_MAX)
            return error_set(p->err, STATUS_ERR_LIMIT, "line %zu: %lld vertices are too many", p->line,
                             (long long)count);
    } else if (word_is(name, "face") && !p->has_faces) {
        element->kind = ELEMENT_FACE;
        p->has_faces = 1;
    } else if (word_is(name, "tristrips") && !p->has_strips) {
        element->kind = ELEMENT_STRIPS;
        p->has_strips = 1;
    }
    if (element->kind == ELEMENT_OTHER && count > 0)
        note_unread(p, "element ", name, "");
    p->element_count++;
    return STATUS_OK;
}

static enum ply_role role_of(enum element_kind kind, struct word name, int is_list)
{
    enum ply_role role = is_list ? ROLE_NONE : parse_role(name);

    if (kind == ELEMENT_VERTEX)
        return role;
    if (kind == ELEMENT_OTHER)
        return ROLE_NONE;
    if (is_list && (word_is(name, "vertex_indices") || word_is(name, "vertex_index")))
        return ROLE_CORNERS;
    if (kind == ELEMENT_STRIPS)
        return ROLE_NONE;
    if (word_is(name, is_list ? "texcoord" : "texnumber"))
        return is_list ? ROLE_TEXCOORDS : ROLE_TEXNUMBER;
    return role >= ROLE_RED && role < ROLE_COUNT ? role : ROLE_NONE;
}

/* "comment TextureFile NAME", as photogrammetry writes; the first one counts. */
static void parse_comment(struct ply *p, struct word line)
{
    if (!word_is(next_word(&line), "TextureFile"))
        return;
    while (line.length && (*line.text == ' ' || *line.text == '\t'))
        line.text++, line.length--;
    while (line.length && (line.text[line.length - 1] == ' ' || line.text[line.length - 1] == '\t'))
        line.length--;
    if (line.length && !p->report.texture[0] && line.length <= PLY_TEXTURE_BYTES_MAX)
        memcpy(p->report.texture, line.text, line.length);
}

static status parse_property(struct ply *p, struct word line)
{
    struct element *element;
    struct property property = {.role = ROLE_NONE};
    struct word type = next_word(&line), name;
    int is_list = word_is(type, "list");

    if (p->element_count == 0)
        return error_set(p->err, STATUS_ERR_INPUT, "line %zu: a property before any element", p->line);
    element = &p->elements[p->element_count - 1];
    if (is_list) {
        property.count_type = parse_type(next_word(&line));
        type = next_word(&line);
    }
    property.type = parse_type(type);
    name = next_word(&line);
    if (property.type == TYPE_NONE || name.length == 0 ||
        (is_list && (property.count_type == TYPE_NONE || property.count_type >= TYPE_F32)))
        return error_set(p->err, STATUS_ERR_INPUT, "line %zu: a property needs a known type and a name", p->line);
    if (element->property_count == PLY_PROPERTIES_MAX)
        return error_set(p->err, STATUS_ERR_LIMIT, "line %zu: more than %d properties", p->line, PLY_PROPERTIES_MAX);
    property.role = role_of(element->kind, name, is_list);
    if (property.role != ROLE_CORNERS && element->kind != ELEMENT_VERTEX && p->origin && p->origin->vertices_only)
        property.role = ROLE_NONE;
    /* Of several properties with one role, the first one counts. */
    for (uint32_t i = 0; i < element->property_count; i++)
        if (p->properties[element->first_property + i].role == property.role)
            property.role = ROLE_NONE;
    if (property.role == ROLE_NONE && element->kind != ELEMENT_OTHER && element->count > 0)
        note_unread(p, "", name, element->kind == ELEMENT_VERTEX ? " of vertex" : element->kind == ELEMENT_FACE ? " of face" : " of tristrips");
    MUST_GROW(p->properties, p->property_capacity, p->property_count + 1);
    p->properties[p->property_count++] = property;
    element->property_count++;
    return STATUS_OK;
}

status ply_header_read(struct ply *p)
{
    struct word line, word;

    TRY(next_line(p, &line));
    if (!word_is(next_word(&line), "ply"))
        return error_set(p->err, STATUS_ERR_INPUT, "is not a PLY file: it does not begin with ply");
    for (;;) {
        TRY(next_line(p, &line));
        word = next_word(&line);
        if (word_is(word, "end_header"))
            break;
        if (word_is(word, "format"))
            TRY(parse_format(p, line));
        else if (word_is(word, "element"))
            TRY(parse_element(p, line));
        else if (word_is(word, "property"))
            TRY(parse_property(p, line));
        else if (word_is(word, "comment"))
            parse_comment(p, line);
        else if (word.length && !word_is(word, "obj_info"))
            return error_set(p->err, STATUS_ERR_INPUT, "line %zu: \"%.*s\" is not a PLY keyword", p->line,
                             (int)(word.length < 40 ? word.length : 40), word.text);
    }
    if (p->format == FORMAT_NONE)
        return error_set(p->err, STATUS_ERR_INPUT, "the PLY header has no format line");
    if (!p->has_vertices)
        return error_set(p->err, STATUS_ERR_INPUT, "the PLY header has no element vertex");
    return STATUS_OK;
}
