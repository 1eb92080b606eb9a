#include "client/import/ply/ply.h"

#include <assert.h>
#include <math.h>
#include <string.h>

#include "client/import/builder/polygon.h"
#include "client/import/builder/scan.h"
#include "client/import/builder/try.h"
#include "common/base/memory.h"
#include "common/image/color.h"

enum ply_format { FORMAT_NONE, FORMAT_ASCII, FORMAT_LITTLE, FORMAT_BIG };
enum ply_type {
    TYPE_NONE,
    TYPE_I8,
    TYPE_U8,
    TYPE_I16,
    TYPE_U16,
    TYPE_I32,
    TYPE_U32,
    TYPE_F32,
    TYPE_F64
};
static const size_t type_bytes[] = {0, 1, 1, 2, 2, 4, 4, 4, 8};

/* What a vertex property is to us. */
enum ply_role {
    ROLE_X,
    ROLE_Y,
    ROLE_Z,
    ROLE_NX,
    ROLE_NY,
    ROLE_NZ,
    ROLE_U,
    ROLE_V,
    ROLE_RED,
    ROLE_GREEN,
    ROLE_BLUE,
    ROLE_ALPHA,
    ROLE_COUNT,
    ROLE_CORNERS,
    ROLE_NONE
};

struct property {
    enum ply_type type;
    enum ply_type count_type; /* TYPE_NONE: not a list */
    enum ply_role role;
};

enum element_kind { ELEMENT_VERTEX, ELEMENT_FACE, ELEMENT_OTHER };

struct element {
    enum element_kind kind;
    uint64_t count;
    uint32_t first_property, property_count;
};

struct ply {
    const uint8_t *at, *start, *end;
    struct error *err;
    enum ply_format format;
    struct element elements[PLY_ELEMENTS_MAX];
    size_t element_count;
    struct property *properties; /* of all elements */
    size_t property_count, property_capacity;
    size_t line; /* 1..: of the header, then of ascii data */

    struct mesh_source *out;
    const struct ply_origin *origin; /* NULL: mesh_origin_choose */
    struct ply_report report;
    int has_vertices, has_faces;
    uint32_t *corners; /* of all faces */
    size_t corner_count, corner_capacity;
    uint32_t *sizes; /* corners of each face */
    size_t face_count, face_capacity;
};

int ply_recognise(const void *data, size_t size_bytes)
{
    const uint8_t *bytes = data;

    return size_bytes >= 4 && memcmp(bytes, "ply", 3) == 0 &&
           (bytes[3] == '\n' || bytes[3] == '\r' || bytes[3] == ' ' || bytes[3] == '\t');
}

void mesh_source_flip_v(struct mesh_source *mesh)
{
    for (int set = 0; set < 2; set++)
        for (size_t v = 0; mesh->uv[set] && v < mesh->vertex_count; v++)
            mesh->uv[set][2 * v + 1] = 1 - mesh->uv[set][2 * v + 1];
}

/* ---- the header
 * ----------------------------------------------------------------------------
 */

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
            return error_set(p->err, STATUS_ERR_LIMIT,
                             "line %zu of the header is longer than %d bytes", p->line + 1,
                             PLY_HEADER_LINE_BYTES_MAX);
    if (room == 0 || end == p->end)
        return error_set(p->err, STATUS_ERR_INPUT,
                         "the PLY header has no end_header: the file is cut short");
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

static status parse_element(struct ply *p, struct word line)
{
    struct word name = next_word(&line), number = next_word(&line);
    struct element *element = &p->elements[p->element_count];
    int64_t count = -1;

    if (p->element_count == PLY_ELEMENTS_MAX)
        return error_set(p->err, STATUS_ERR_LIMIT, "line %zu: more than %d elements", p->line,
                         PLY_ELEMENTS_MAX);
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
            return error_set(p->err, STATUS_ERR_LIMIT, "line %zu: %lld vertices are too many",
                             p->line, (long long)count);
    } else if (word_is(name, "face") && !p->has_faces) {
        element->kind = ELEMENT_FACE;
        p->has_faces = 1;
    } else if (word_is(name, "tristrips")) {
        p->report.has_strips = 1;
    }
    p->element_count++;
    return STATUS_OK;
}

static status parse_property(struct ply *p, struct word line)
{
    struct element *element;
    struct property property = {.role = ROLE_NONE};
    struct word type = next_word(&line), name;
    int is_list = word_is(type, "list");

    if (p->element_count == 0)
        return error_set(p->err, STATUS_ERR_INPUT, "line %zu: a property before any element",
                         p->line);
    element = &p->elements[p->element_count - 1];
    if (is_list) {
        property.count_type = parse_type(next_word(&line));
        type = next_word(&line);
    }
    property.type = parse_type(type);
    name = next_word(&line);
    if (property.type == TYPE_NONE || name.length == 0 ||
        (is_list && (property.count_type == TYPE_NONE || property.count_type >= TYPE_F32)))
        return error_set(p->err, STATUS_ERR_INPUT,
                         "line %zu: a property needs a known type and a name", p->line);
    if (element->property_count == PLY_PROPERTIES_MAX)
        return error_set(p->err, STATUS_ERR_LIMIT, "line %zu: more than %d properties", p->line,
                         PLY_PROPERTIES_MAX);
    if (element->kind == ELEMENT_VERTEX && !is_list)
        property.role = parse_role(name);
    if (element->kind == ELEMENT_FACE && is_list &&
        (word_is(name, "vertex_indices") || word_is(name, "vertex_index")))
        property.role = ROLE_CORNERS;
    /* The first of each name or of its synonyms counts. */
    for (uint32_t i = 0; i < element->property_count; i++)
        if (p->properties[element->first_property + i].role == property.role)
            property.role = ROLE_NONE;
    if (!MEM_GROW(p->properties, p->property_capacity, p->property_count + 1))
        return error_no_memory(p->err, "a PLY header");
    p->properties[p->property_count++] = property;
    element->property_count++;
    return STATUS_OK;
}

static status parse_header(struct ply *p)
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
        else if (word.length && !word_is(word, "comment") && !word_is(word, "obj_info"))
            return error_set(p->err, STATUS_ERR_INPUT, "line %zu: \"%.*s\" is no PLY keyword",
                             p->line, (int)(word.length < 40 ? word.length : 40), word.text);
    }
    if (p->format == FORMAT_NONE)
        return error_set(p->err, STATUS_ERR_INPUT, "the PLY header has no format line");
    if (!p->has_vertices)
        return error_set(p->err, STATUS_ERR_INPUT, "the PLY header has no element vertex");
    return STATUS_OK;
}

/* ---- values
 * --------------------------------------------------------------------------------
 */

static status cut_short(const struct ply *p)
{
    return error_set(p->err, STATUS_ERR_INPUT, "the data is cut short after %zu bytes",
                     (size_t)(p->end - p->start));
}

static status read_ascii(struct ply *p, double *out)
{
    const char *end = (const char *)p->end;
    size_t length;

    while (p->at < p->end && (*p->at == ' ' || (*p->at >= '\t' && *p->at <= '\r'))) {
        p->line += *p->at == '\n';
        p->at++;
    }
    if (p->at == p->end)
        return cut_short(p);
    length = scan_double((const char *)p->at, end, out);
    p->at += length;
    if (length == 0 || (p->at<p->end && * p->at> ' '))
        return error_set(p->err, STATUS_ERR_INPUT, "line %zu: is not a number", p->line);
    return STATUS_OK;
}

/* The next value; p->format and `type` say how it is written. */
static status read_value(struct ply *p, enum ply_type type, double *out)
{
    size_t size = type_bytes[type];
    uint64_t bits = 0;
    float single;

    if (p->format == FORMAT_ASCII)
        return read_ascii(p, out);
    if ((size_t)(p->end - p->at) < size)
        return cut_short(p);
    for (size_t i = 0; i < size; i++)
        bits |= (uint64_t)p->at[p->format == FORMAT_LITTLE ? i : size - 1 - i] << 8 * i;
    p->at += size;
    switch (type) {
    case TYPE_I8: *out = (int8_t)bits; break;
    case TYPE_I16: *out = (int16_t)bits; break;
    case TYPE_I32: *out = (int32_t)bits; break;
    case TYPE_F32: {
        uint32_t low = (uint32_t)bits;
        memcpy(&single, &low, sizeof single);
        *out = (double)single;
        break;
    }
    case TYPE_F64: memcpy(out, &bits, sizeof *out); break;
    default: *out = (double)bits; break;
    }
    return STATUS_OK;
}

/* How many values a list holds: no more than there are bytes left. */
static status read_list_size(struct ply *p, const struct property *property, size_t *out)
{
    size_t least = p->format == FORMAT_ASCII ? 2 : type_bytes[property->type];
    size_t left;
    double count;

    TRY(read_value(p, property->count_type, &count));
    left = (size_t)(p->end - p->at);
    if (!(count >= 0 && count == floor(count)))
        return error_set(p->err, STATUS_ERR_INPUT, "a list has %g values: line or byte %zu", count,
                         p->format == FORMAT_ASCII ? p->line : (size_t)(p->at - p->start));
    if (count > (double)left / (double)least)
        return cut_short(p);
    *out = (size_t)count;
    return STATUS_OK;
}

static status skip_property(struct ply *p, const struct property *property)
{
    size_t count = 1;
    double value;

    if (property->count_type != TYPE_NONE)
        TRY(read_list_size(p, property, &count));
    if (p->format != FORMAT_ASCII) {
        size_t bytes = count * type_bytes[property->type];
        if ((size_t)(p->end - p->at) < bytes)
            return cut_short(p);
        p->at += bytes;
        return STATUS_OK;
    }
    for (size_t i = 0; i < count; i++)
        TRY(read_value(p, property->type, &value));
    return STATUS_OK;
}

/* Are there bytes enough for the elements, if each is as short as it can be? */
static status check_room(struct ply *p, const struct element *element)
{
    size_t least = 0;

    for (uint32_t i = 0; i < element->property_count; i++) {
        const struct property *property = &p->properties[element->first_property + i];
        least += p->format == FORMAT_ASCII           ? 2
                 : property->count_type != TYPE_NONE ? type_bytes[property->count_type]
                                                     : type_bytes[property->type];
    }
    /* + 1: the last value of a text needs no space after it. */
    if (least && element->count > ((size_t)(p->end - p->at) + 1) / least)
        return cut_short(p);
    return STATUS_OK;
}

/* ---- vertices
 * ------------------------------------------------------------------------------
 */

/* A colour channel 0..1, linear. */
static float color_value(const struct property *property, double value)
{
    float scaled;

    if (!(value > 0))
        return 0;
    if (property->type >= TYPE_F32)
        return value < 1 ? (float)value : 1.0f;
    scaled = (float)(value / (property->type == TYPE_U16 ? 65535.0 : 255.0));
    scaled = scaled < 1 ? scaled : 1.0f;
    return property->role == ROLE_ALPHA ? scaled : srgb_decode(scaled);
}

static status store_position(struct ply *p, size_t vertex, int axis, double value)
{
    if (!(fabs(value) <= (double)SCENE_COORDINATE_MAX))
        return error_set(p->err, STATUS_ERR_INPUT,
                         "vertex %zu has the coordinate %g: only finite ones up to "
                         "1e15 are taken",
                         vertex, value);
    /* One zero only, so that equal positions are equal in their bits. */
    p->out->positions[3 * vertex + (size_t)axis] = (float)(value - p->out->origin[axis]) + 0.0f;
    return STATUS_OK;
}

static float finite_or_zero(double value)
{
    float f = (float)value;

    return isfinite(f) ? f : 0.0f;
}

static status read_vertex(struct ply *p, const struct element *element, size_t vertex)
{
    struct mesh_source *out = p->out;
    double value, position[3] = {0, 0, 0};

    for (uint32_t i = 0; i < element->property_count; i++) {
        const struct property *property = &p->properties[element->first_property + i];
        if (property->role >= ROLE_COUNT) {
            TRY(skip_property(p, property));
            continue;
        }
        TRY(read_value(p, property->type, &value));
        if (property->role <= ROLE_Z)
            position[property->role - ROLE_X] = value;
        else if (property->role <= ROLE_NZ && out->normals)
            out->normals[3 * vertex + property->role - ROLE_NX] = finite_or_zero(value);
        else if (property->role >= ROLE_U && property->role <= ROLE_V && out->uv[0])
            out->uv[0][2 * vertex + property->role - ROLE_U] = finite_or_zero(value);
        else if (property->role >= ROLE_RED && out->colors)
            out->colors[4 * vertex + property->role - ROLE_RED] = color_value(property, value);
    }
    if (vertex == 0 && p->origin)
        p->origin->choose(p->origin->user, position, out->origin);
    else if (vertex == 0)
        mesh_origin_choose(position, out->origin);
    for (int axis = 0; axis < 3; axis++)
        TRY(store_position(p, vertex, axis, position[axis]));
    return STATUS_OK;
}

static status make_array(struct ply *p, float **array, uint64_t count, size_t width)
{
    *array = mem_calloc((size_t)count, width * sizeof **array);
    return *array ? STATUS_OK : error_no_memory(p->err, "PLY vertices");
}

static status read_vertices(struct ply *p, const struct element *element)
{
    struct mesh_source *out = p->out;
    int has[ROLE_COUNT] = {0};

    for (uint32_t i = 0; i < element->property_count; i++) {
        enum ply_role role = p->properties[element->first_property + i].role;
        if (role < ROLE_COUNT)
            has[role] = 1;
    }
    if (!has[ROLE_X] || !has[ROLE_Y] || !has[ROLE_Z])
        return error_set(p->err, STATUS_ERR_INPUT, "the element vertex lacks x, y or z");
    TRY(make_array(p, &out->positions, element->count, 3));
    if (has[ROLE_NX] && has[ROLE_NY] && has[ROLE_NZ])
        TRY(make_array(p, &out->normals, element->count, 3));
    if (has[ROLE_U] && has[ROLE_V])
        TRY(make_array(p, &out->uv[0], element->count, 2));
    if (has[ROLE_RED] && has[ROLE_GREEN] && has[ROLE_BLUE])
        TRY(make_array(p, &out->colors, element->count, 4));
    out->vertex_count = (size_t)element->count;
    for (size_t v = 0; out->colors && v < out->vertex_count; v++)
        out->colors[4 * v + 3] = 1;
    for (size_t v = 0; v < out->vertex_count; v++)
        TRY(read_vertex(p, element, v));
    return STATUS_OK;
}

/* White vertex colours change nothing: leave them out. */
static void drop_white(struct mesh_source *mesh)
{
    for (size_t i = 0; mesh->colors && i < 4 * mesh->vertex_count; i++)
        if (mesh->colors[i] != 1)
            return;
    mem_free(mesh->colors);
    mesh->colors = NULL;
}

/* ---- faces
 * ---------------------------------------------------------------------------------
 */

/* Corners wait as they are: the vertices may follow the faces. */
static status read_corners(struct ply *p, const struct property *property)
{
    size_t count;

    TRY(read_list_size(p, property, &count));
    if (count > POLYGON_CORNERS_MAX)
        return error_set(p->err, STATUS_ERR_LIMIT, "face %zu has %zu corners: at most %d are taken",
                         p->face_count, count, POLYGON_CORNERS_MAX);
    if (!MEM_GROW(p->corners, p->corner_capacity, p->corner_count + count) ||
        !MEM_GROW(p->sizes, p->face_capacity, p->face_count + 1))
        return error_no_memory(p->err, "PLY faces");
    for (size_t i = 0; i < count; i++) {
        double value;
        TRY(read_value(p, property->type, &value));
        /* What is no vertex number becomes one that no mesh has. */
        p->corners[p->corner_count + i] = value >= 0 && value < UINT32_MAX && value == floor(value)
                                              ? (uint32_t)value
                                              : UINT32_MAX;
    }
    p->corner_count += count;
    p->sizes[p->face_count++] = (uint32_t)count;
    return STATUS_OK;
}

static status read_faces(struct ply *p, const struct element *element)
{
    int has_corners = 0;

    for (uint32_t i = 0; i < element->property_count; i++)
        has_corners |= p->properties[element->first_property + i].role == ROLE_CORNERS;
    if (element->count && !has_corners)
        return error_set(p->err, STATUS_ERR_INPUT,
                         "the element face lacks the list vertex_indices");
    for (uint64_t f = 0; f < element->count; f++)
        for (uint32_t i = 0; i < element->property_count; i++) {
            const struct property *property = &p->properties[element->first_property + i];
            if (property->role == ROLE_CORNERS)
                TRY(read_corners(p, property));
            else
                TRY(skip_property(p, property));
        }
    return STATUS_OK;
}

static int face_is_valid(const uint32_t *corners, size_t count, size_t vertex_count)
{
    for (size_t i = 0; i < count; i++)
        if (corners[i] >= vertex_count)
            return 0;
    return count >= 3;
}

static status make_triangles(struct ply *p)
{
    struct polygon_scratch scratch = {0};
    struct mesh_source *out = p->out;
    size_t triangles = 0, first = 0;
    status result = STATUS_OK;

    assert(p->sizes || p->face_count == 0);
    for (size_t f = 0; f < p->face_count; f++)
        triangles += p->sizes[f] >= 3 ? p->sizes[f] - 2 : 0;
    if (triangles > SCENE_TRIANGLES_MAX)
        return error_set(p->err, STATUS_ERR_LIMIT, "has %zu triangles: at most %d are taken",
                         triangles, SCENE_TRIANGLES_MAX);
    out->indices = mem_alloc_array(triangles, 3 * sizeof *out->indices);
    if (!out->indices)
        return error_no_memory(p->err, "PLY faces");
    for (size_t f = 0; f < p->face_count && result == STATUS_OK; first += p->sizes[f++]) {
        uint32_t *indices = out->indices + 3 * out->triangle_count;
        size_t count = p->sizes[f];
        const uint32_t *corners = count ? p->corners + first : NULL;
        if (!face_is_valid(corners, count, out->vertex_count)) {
            p->report.faces_invalid++;
            continue;
        }
        result = polygon_triangulate(&scratch, out->positions, corners, count, indices, p->err);
        for (size_t i = 0; result == STATUS_OK && i < 3 * (count - 2); i++)
            indices[i] = corners[indices[i]];
        out->triangle_count += count - 2;
    }
    p->report.faces_fanned = scratch.fans;
    polygon_scratch_release(&scratch);
    return result;
}

/* ---- the whole
 * -----------------------------------------------------------------------------
 */

static status read_other(struct ply *p, const struct element *element)
{
    if (element->property_count == 0)
        return STATUS_OK;
    for (uint64_t n = 0; n < element->count; n++)
        for (uint32_t i = 0; i < element->property_count; i++)
            TRY(skip_property(p, &p->properties[element->first_property + i]));
    return STATUS_OK;
}

static status read_all(struct ply *p)
{
    TRY(parse_header(p));
    p->line++; /* from lines read to the line that is being read */
    for (size_t i = 0; i < p->element_count; i++) {
        const struct element *element = &p->elements[i];
        TRY(check_room(p, element));
        switch (element->kind) {
        case ELEMENT_VERTEX: TRY(read_vertices(p, element)); break;
        case ELEMENT_FACE: TRY(read_faces(p, element)); break;
        case ELEMENT_OTHER:
            /* What is behind the last element that counts is of no use. */
            if (p->out->positions && (p->sizes || !p->has_faces))
                return make_triangles(p);
            TRY(read_other(p, element));
            break;
        }
    }
    return make_triangles(p);
}

status ply_read(const void *data, size_t size_bytes, const struct ply_origin *origin,
                struct mesh_source *out, struct ply_report *report, struct error *err)
{
    struct ply p = {.at = data, .start = data, .err = err, .out = out, .origin = origin};
    status result;

    p.end = p.start + size_bytes;
    memset(out, 0, sizeof *out);
    result = read_all(&p);
    drop_white(out);
    mem_free(p.properties);
    mem_free(p.corners);
    mem_free(p.sizes);
    if (result != STATUS_OK)
        mesh_source_release(out);
    if (report)
        *report = p.report;
    return result;
}
