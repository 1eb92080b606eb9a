#include "client/import/obj/obj.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>

#include "client/import/builder/polygon.h"
#include "client/import/builder/scan.h"
#include "client/terminal/must.h"
#include "common/system/file.h"
#include "common/base/memory.h"
#include "common/image/color.h"

/* ---- statements ----------------------------------------------------------------------------- */

/* The state that applies to the next faces. */
struct state {
    struct obj *o;
    uint32_t group, material, smooth;
    uint32_t part; /* OBJ_NONE: look it up at the next face */
};

static status read_vertex(struct obj *o, struct obj_line *line)
{
    double x[8];
    size_t count = obj_numbers(line, 8, x);
    int good = count >= 3;

    if (o->v_count >= OBJ_BAD)
        return error_set(o->err, STATUS_ERR_LIMIT, "line %u: too many vertices", line->number);
    MUST_GROW(o->v, o->v_capacity, 3 * (o->v_count + 1));
    for (size_t c = 0; c < 3 && good; c++)
        good = fabs(x[c]) <= (double)SCENE_COORDINATE_MAX;
    if (!good)
        builder_warn_at(o->b, o->name, line->number, "vertex",
                        "a vertex needs three finite numbers up to 1e15: its faces are left out");
    if (good && !o->has_origin) {
        mesh_origin_choose(x, o->origin);
        o->has_origin = 1;
    }
    for (size_t c = 0; c < 3; c++)
        o->v[3 * o->v_count + c] = good ? x[c] : (double)NAN;
    /* x y z r g b, or x y z w r g b: display colours, as ZBrush and MeshLab write them. */
    if (count >= 6 && !o->colors) {
        MUST_GROW(o->colors, o->color_capacity, 4 * (o->v_count + 1));
        for (size_t i = 0; i < 4 * o->v_count; i++)
            o->colors[i] = NAN;
    }
    if (o->colors) {
        const double *rgb = count >= 7 ? x + 4 : x + 3;
        MUST_GROW(o->colors, o->color_capacity, 4 * (o->v_count + 1));
        for (size_t c = 0; c < 4; c++)
            o->colors[4 * o->v_count + c] = c < 3 && count >= 6 ? (float)rgb[c] : NAN;
    }
    o->v_count++;
    return STATUS_OK;
}

/* vt and vn: numbers that are missing or not finite are 0. */
static status read_attribute(struct obj *o, struct obj_line *line, size_t width, float **array, size_t *count,
                             size_t *capacity)
{
    double x[3] = {0, 0, 0};
    size_t found = obj_numbers(line, 3, x);

    if (*count >= OBJ_BAD)
        return error_set(o->err, STATUS_ERR_LIMIT, "line %u: too many vertices", line->number);
    MUST_GROW(*array, *capacity, width * (*count + 1));
    for (size_t c = 0; c < width; c++)
        (*array)[width * *count + c] = c < found && fabs(x[c]) <= 1e30 ? (float)x[c] + 0.0f : 0.0f;
    ++*count;
    return STATUS_OK;
}

/* An index as written: from 1, or negative from the last; OBJ_BAD if it is invalid. */
static uint32_t resolve(int64_t index, size_t count)
{
    if (index > 0 && index < OBJ_BAD)
        return (uint32_t)(index - 1);
    if (index < 0 && index >= -(int64_t)count)
        return (uint32_t)((int64_t)count + index);
    return OBJ_BAD;
}

/* v, v/t, v//n or v/t/n. */
static struct obj_corner parse_corner(const struct obj *o, struct obj_word word)
{
    struct obj_corner corner = {OBJ_BAD, OBJ_NONE, OBJ_NONE};
    const char *at = word.text, *end = word.text + word.length;
    uint32_t *fields[3] = {&corner.v, &corner.t, &corner.n};
    const size_t counts[3] = {o->v_count, o->vt_count, o->vn_count};

    for (int i = 0; i < 3; i++) {
        int64_t index;
        size_t length = scan_integer(at, end, &index);
        if (length)
            *fields[i] = resolve(index, counts[i]);
        at += length;
        if (at == end)
            break;
        if (*at++ != '/') { /* "1,001" is no index */
            corner.v = OBJ_BAD;
            break;
        }
    }
    return corner;
}

static void find_part(struct state *s, uint32_t line)
{
    struct obj *o = s->o;
    char key[32];
    int length = snprintf(key, sizeof key, "%u %u", s->group, s->material);
    uint32_t part = obj_intern(&o->part_keys, key, (size_t)length);

    MUST_GROW(o->parts, o->part_capacity, (size_t)part + 1);
    if (part == o->part_count)
        o->parts[o->part_count++] = (struct obj_part){s->group, s->material, line};
    s->part = part;
}

static status read_face(struct state *s, struct obj_line *line)
{
    struct obj *o = s->o;
    struct obj_face face = {.first = o->corner_count, .smooth = s->smooth, .line = line->number};
    struct obj_word word;

    while ((word = obj_next_word(line)).length) {
        if (face.count == POLYGON_CORNERS_MAX)
            return error_set(o->err, STATUS_ERR_LIMIT, "line %u: a face of more than %d corners", line->number,
                             POLYGON_CORNERS_MAX);
        MUST_GROW(o->corners, o->corner_capacity, o->corner_count + 1);
        o->corners[o->corner_count++] = parse_corner(o, word);
        face.count++;
    }
    if (face.count < 3) {
        builder_warn_at(o->b, o->name, line->number, "face of two", "a face needs three corners: left out");
        o->corner_count = face.first;
        return STATUS_OK;
    }
    if (s->part == OBJ_NONE)
        find_part(s, line->number);
    face.part = s->part;
    if (o->face_count >= OBJ_BAD)
        return error_set(o->err, STATUS_ERR_LIMIT, "has more than %u faces", OBJ_BAD);
    MUST_GROW(o->faces, o->face_capacity, o->face_count + 1);
    o->faces[o->face_count++] = face;
    return STATUS_OK;
}

static void read_name(struct state *s, struct obj_line *line, struct obj_names *names, uint32_t *out)
{
    struct obj_word name = obj_rest(line);

    *out = obj_intern(names, name.text, name.length);
    s->part = OBJ_NONE;
}

static void read_smooth(struct state *s, struct obj_line *line)
{
    struct obj_word word = obj_next_word(line);
    int64_t group = 0;

    s->o->says_smooth = 1;
    if (obj_word_is(word, "on"))
        group = 1;
    else
        scan_integer(word.text, word.text + word.length, &group);
    s->smooth = group > 0 && group < OBJ_NONE ? (uint32_t)group : 0;
}

/* One file whose name may contain spaces, or several. They are read after the OBJ file. */
static void read_library(struct state *s, struct obj_line *line)
{
    struct obj *o = s->o;
    struct obj_word name = obj_rest(line);
    size_t before = o->libraries.count;

    if (name.length == 0)
        return;
    if (before == OBJ_LIBRARIES_MAX) {
        builder_warn_at(o->b, o->name, line->number, "material libraries",
                        "only the first %d material libraries are read", OBJ_LIBRARIES_MAX);
        return;
    }
    obj_intern(&o->libraries, name.text, name.length);
    if (o->libraries.count > before)
        o->library_lines[before] = line->number;
}

static int is_one_of(struct obj_word word, const char *const *list, size_t count)
{
    for (size_t i = 0; i < count; i++)
        if (obj_word_is(word, list[i]))
            return 1;
    return 0;
}
#define IS_ONE_OF(word, list) is_one_of(word, list, sizeof(list) / sizeof *(list))

static void warn_of_statement(struct obj *o, struct obj_word word, struct obj_line *rest)
{
    static const char *const free_form[] = {"vp",    "cstype", "deg",  "bmat",  "step", "curv",
                                            "curv2", "surf",   "parm", "trim",  "hole", "scrv",
                                            "sp",    "end",    "con",  "ctech", "stech"};
    static const char *const unread[] = {"bevel", "c_interp", "d_interp", "maplib", "usemap", "shadow_obj", "trace_obj"};
    static const char *const display[] = {"lod", "mg"};
    const uint32_t line = rest->number;
    char kind[64];

    if (IS_ONE_OF(word, unread) && obj_word_is(obj_next_word(rest), "off"))
        return;
    if (IS_ONE_OF(word, free_form)) {
        builder_warn_at(o->b, o->name, line, "free-form",
                        "free-form curves and surfaces are not read: left out (tessellate them "
                        "where the file was made)");
    } else if (obj_word_is(word, "p") || obj_word_is(word, "l")) {
        builder_warn_at(o->b, o->name, line, "points and lines", "points and lines are not rendered");
    } else if (obj_word_is(word, "call") || obj_word_is(word, "csh")) {
        builder_warn_at(o->b, o->name, line, "call", "call and csh are not carried out");
    } else if (!IS_ONE_OF(word, display)) {
        snprintf(kind, sizeof kind, "statement %.*s", (int)(word.length < 24 ? word.length : 24), word.text);
        builder_warn_at(o->b, o->name, line, kind, "the statement \"%.*s\" is %s",
                        (int)(word.length < 24 ? word.length : 24), word.text, IS_ONE_OF(word, unread) ? "not read" : "unknown");
    }
}

static status read_statement(struct state *s, struct obj_line *line)
{
    struct obj *o = s->o;
    struct obj_word word = obj_next_word(line);

    if (word.length == 0)
        return STATUS_OK;
    if (obj_word_is(word, "v"))
        return read_vertex(o, line);
    if (obj_word_is(word, "vt"))
        return read_attribute(o, line, 2, &o->vt, &o->vt_count, &o->vt_capacity);
    if (obj_word_is(word, "vn"))
        return read_attribute(o, line, 3, &o->vn, &o->vn_count, &o->vn_capacity);
    if (obj_word_is(word, "f") || obj_word_is(word, "fo"))
        return read_face(s, line);
    if (obj_word_is(word, "o") || obj_word_is(word, "g"))
        read_name(s, line, &o->words, &s->group);
    else if (obj_word_is(word, "usemtl"))
        read_name(s, line, &o->materials, &s->material);
    else if (obj_word_is(word, "mtllib"))
        read_library(s, line);
    else if (obj_word_is(word, "s"))
        read_smooth(s, line);
    else
        warn_of_statement(o, word, line);
    return STATUS_OK;
}

static status read_text(struct obj *o, const char *data, size_t size)
{
    struct state s = {.o = o, .material = OBJ_NONE, .part = OBJ_NONE};
    struct obj_text text = {data, data + size, 1};
    struct obj_line line;

    if (size >= 2 && (memcmp(data, "\xfe\xff", 2) == 0 || memcmp(data, "\xff\xfe", 2) == 0))
        return error_set(o->err, STATUS_ERR_UNSUPPORTED, "is UTF-16 text: save it as UTF-8");
    if (size >= 3 && memcmp(data, "\xef\xbb\xbf", 3) == 0)
        text.at += 3;
    s.group = obj_intern(&o->words, "", 0);
    while (obj_next_line(&text, &line)) {
        TRY(read_statement(&s, &line));
        obj_warn_of_odd(o, o->name, &line);
    }
    return STATUS_OK;
}

/* ---- the whole ------------------------------------------------------------------------------ */

static void obj_release(struct obj *o)
{
    mem_free(o->corner_face);
    mem_free(o->around_corners);
    mem_free(o->around);
    mem_free(o->face_normals);
    for (size_t i = 0; i < o->image_count; i++)
        mem_free(o->images[i].key);
    mem_free(o->images);
    mem_free(o->definition);
    for (size_t i = 0; i < o->defined_count; i++)
        obj_material_release(&o->defined[i]);
    mem_free(o->defined);
    obj_names_release(&o->files);
    obj_names_release(&o->libraries);
    mem_free(o->parts);
    obj_names_release(&o->part_keys);
    obj_names_release(&o->materials);
    obj_names_release(&o->words);
    mem_free(o->faces);
    mem_free(o->corners);
    mem_free(o->vn);
    mem_free(o->vt);
    mem_free(o->colors);
    mem_free(o->v);
}

/* Display colours become linear; where a vertex has none, white. */
static void decode_colors(struct obj *o)
{
    size_t count = o->colors ? 4 * o->v_count : 0;
    float range = mesh_color_range(o->colors, count);

    if (range > 1)
        builder_warn_at(o->b, o->name, 0, "vertex colours", "its vertex colours go up to %g, not 1: read as such",
                        (double)range);
    for (size_t i = 0; i < count; i++)
        o->colors[i] = isnan(o->colors[i]) ? 1.0f : srgb_decode(o->colors[i] / range) + 0.0f;
}

static int obj_recognise(const void *data, size_t size_bytes, const char *name)
{
    static const char *const first_words[] = {"v", "vn", "vt", "mtllib", "usemtl", "o", "g"};
    const char *bytes = data;
    struct obj_text text = {bytes, bytes + (size_bytes < 65536 ? size_bytes : 65536), 1};
    struct obj_line line;

    if (strcasecmp(file_extension(name), "obj") == 0)
        return 1;
    while (obj_next_line(&text, &line)) {
        struct obj_word word = obj_next_word(&line);
        if (word.length)
            return IS_ONE_OF(word, first_words);
    }
    return 0;
}

static status obj_import(const void *data, size_t size_bytes, const char *name, const char *folder,
                         const struct import_options *options, struct builder *b)
{
    struct obj o = {.b = b,
                    .err = b->err,
                    .name = name,
                    .folder = folder,
                    .plain_row = BUILDER_NO_ROW,
                    .plain_colored_row = BUILDER_NO_ROW};
    status result = read_text(&o, data, size_bytes);

    THEN(result, obj_read_libraries(&o));
    decode_colors(&o);
    THEN(result, obj_make_meshes(&o));
    if (result == STATUS_OK && b->instance_count == 0) {
        char why[64];
        snprintf(why, sizeof why, "%zu vertices, but no face that can be drawn", o.v_count);
        result = builder_nothing(b, why);
    }
    THEN(result, builder_finish(b, file_basename(name), options));
    obj_release(&o);
    return result;
}

const struct import_format format_obj = {"Wavefront OBJ (.obj)", obj_recognise, obj_import};
