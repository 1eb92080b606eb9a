/* A PLY file's elements become a mesh. */
#include <assert.h>
#include <math.h>
#include <string.h>

#include "client/import/builder/polygon.h"
#include "client/import/ply/ply_parts.h"
#include "client/terminal/must.h"
#include "common/base/memory.h"
#include "common/image/color.h"

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
/* ---- vertices -------------------------------------------------------------------------------- */

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
    /* No negative zero, so that equal positions have equal bits. */
    p->out->positions[3 * vertex + (size_t)axis] = (float)(value - p->out->origin[axis]) + 0.0f;
    return STATUS_OK;
}

float ply_finite(double value)
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
            TRY(ply_property_skip(p, property));
            continue;
        }
        TRY(ply_value_read(p, property->type, &value));
        if (property->role <= ROLE_Z)
            position[property->role - ROLE_X] = value;
        else if (property->role <= ROLE_NZ && out->normals)
            out->normals[3 * vertex + property->role - ROLE_NX] = ply_finite(value);
        else if (property->role >= ROLE_U && property->role <= ROLE_V && out->uv[0])
            out->uv[0][2 * vertex + property->role - ROLE_U] = ply_finite(value);
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

static void make_array(float **array, uint64_t count, size_t width)
{
    *array = must(mem_calloc((size_t)count, width * sizeof **array));
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
    make_array(&out->positions, element->count, 3);
    if (has[ROLE_NX] && has[ROLE_NY] && has[ROLE_NZ])
        make_array(&out->normals, element->count, 3);
    if (has[ROLE_U] && has[ROLE_V])
        make_array(&out->uv[0], element->count, 2);
    if (has[ROLE_RED] && has[ROLE_GREEN] && has[ROLE_BLUE])
        make_array(&out->colors, element->count, 4);
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

/* ---- faces ----------------------------------------------------------------------------------- */

/* An invalid vertex number becomes one that no mesh has. */
static uint32_t corner_of(double value)
{
    return value >= 0 && value < UINT32_MAX && value == floor(value) ? (uint32_t)value : UINT32_MAX;
}

/* Corners are not checked yet: the vertices may follow the faces. */
static status read_corners(struct ply *p, const struct property *property)
{
    size_t count;

    TRY(ply_list_size(p, property, &count));
    if (count > POLYGON_CORNERS_MAX)
        return error_set(p->err, STATUS_ERR_LIMIT, "face %zu has %zu corners: at most %d are taken", p->face_count,
                         count, POLYGON_CORNERS_MAX);
    MUST_GROW(p->corners, p->corner_capacity, p->corner_count + count);
    MUST_GROW(p->sizes, p->face_capacity, p->face_count + 1);
    for (size_t i = 0; i < count; i++) {
        double value;
        TRY(ply_value_read(p, property->type, &value));
        p->corners[p->corner_count + i] = corner_of(value);
    }
    p->corner_count += count;
    p->sizes[p->face_count++] = (uint32_t)count;
    return STATUS_OK;
}

/* Each corner makes a triangle with the two before it, every other one the other way round. One with a corner twice only
 * leads on to the next. */
static status read_strip(struct ply *p, const struct property *property)
{
    uint32_t last[2] = {0, 0};
    size_t count, length = 0;

    TRY(ply_list_size(p, property, &count));
    for (size_t i = 0; i < count; i++) {
        double value;
        uint32_t corner;
        TRY(ply_value_read(p, property->type, &value));
        corner = corner_of(value);
        if (value < 0) {
            length = 0;
            continue;
        }
        if (++length >= 3 && last[0] != last[1] && last[0] != corner && last[1] != corner) {
            uint32_t *out;
            MUST_GROW(p->corners, p->corner_capacity, p->corner_count + 3);
            MUST_GROW(p->sizes, p->face_capacity, p->face_count + 1);
            out = p->corners + p->corner_count;
            out[0] = last[length % 2 == 0];
            out[1] = last[length % 2];
            out[2] = corner;
            p->corner_count += 3;
            p->sizes[p->face_count++] = 3;
        }
        last[0] = last[1];
        last[1] = corner;
    }
    return STATUS_OK;
}

static status read_face(struct ply *p, const struct element *element)
{
    const size_t first_corner = p->corner_count, first_face = p->face_count;
    float color[4] = {1, 1, 1, 1};
    int has_color = 0, has_texcoords = 0;
    double value;

    for (uint32_t i = 0; i < element->property_count; i++) {
        const struct property *property = &p->properties[element->first_property + i];
        switch (property->role) {
        case ROLE_CORNERS:
            TRY(element->kind == ELEMENT_FACE ? read_corners(p, property) : read_strip(p, property));
            break;
        case ROLE_TEXCOORDS:
            TRY(ply_texcoords_read(p, property, first_corner));
            has_texcoords = 1;
            break;
        case ROLE_TEXNUMBER:
            TRY(ply_value_read(p, property->type, &value));
            p->report.faces_elsewhere += value > 0;
            break;
        case ROLE_RED:
        case ROLE_GREEN:
        case ROLE_BLUE:
        case ROLE_ALPHA:
            TRY(ply_value_read(p, property->type, &value));
            color[property->role - ROLE_RED] = color_value(property, value);
            has_color = 1;
            break;
        default: TRY(ply_property_skip(p, property));
        }
    }
    if (has_texcoords)
        ply_texcoords_end(p);
    if (has_color && p->face_count > first_face)
        ply_face_color_add(p, color);
    return STATUS_OK;
}

static status read_faces(struct ply *p, const struct element *element)
{
    int has_corners = 0;

    for (uint32_t i = 0; i < element->property_count; i++)
        has_corners |= p->properties[element->first_property + i].role == ROLE_CORNERS;
    if (element->count && !has_corners)
        return error_set(p->err, STATUS_ERR_INPUT, "the element %s lacks the list vertex_indices",
                         element->kind == ELEMENT_FACE ? "face" : "tristrips");
    for (uint64_t f = 0; f < element->count; f++)
        TRY(read_face(p, element));
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

    assert(p->sizes || p->face_count == 0);
    for (size_t f = 0; f < p->face_count; f++)
        triangles += p->sizes[f] >= 3 ? p->sizes[f] - 2 : 0;
    if (triangles > SCENE_TRIANGLES_MAX)
        return error_set(p->err, STATUS_ERR_LIMIT, "has %zu triangles: at most %d are taken", triangles,
                         SCENE_TRIANGLES_MAX);
    out->indices = must(mem_alloc_array(triangles, 3 * sizeof *out->indices));
    for (size_t f = 0; f < p->face_count; first += p->sizes[f++]) {
        uint32_t *indices = out->indices + 3 * out->triangle_count;
        size_t count = p->sizes[f];
        const uint32_t *corners = count ? p->corners + first : NULL;
        if (!face_is_valid(corners, count, out->vertex_count)) {
            p->report.faces_invalid++;
            continue;
        }
        polygon_triangulate(&scratch, out->positions, corners, count, indices);
        for (size_t i = 0; i < 3 * (count - 2); i++)
            indices[i] = corners[indices[i]];
        out->triangle_count += count - 2;
    }
    p->report.faces_fanned = scratch.fans;
    polygon_scratch_release(&scratch);
    return STATUS_OK;
}

/* ---- the whole ------------------------------------------------------------------------------- */

static status read_other(struct ply *p, const struct element *element)
{
    if (element->property_count == 0)
        return STATUS_OK;
    for (uint64_t n = 0; n < element->count; n++)
        for (uint32_t i = 0; i < element->property_count; i++)
            TRY(ply_property_skip(p, &p->properties[element->first_property + i]));
    return STATUS_OK;
}

static status read_all(struct ply *p)
{
    size_t needed; /* elements; what follows them is not read */

    TRY(ply_header_read(p));
    p->line++; /* from the count of lines read to the present line */
    for (needed = p->element_count; p->elements[needed - 1].kind == ELEMENT_OTHER;)
        needed--; /* the header has vertices */
    for (size_t i = 0; i < needed; i++) {
        const struct element *element = &p->elements[i];
        TRY(ply_check_room(p, element));
        switch (element->kind) {
        case ELEMENT_VERTEX: TRY(read_vertices(p, element)); break;
        case ELEMENT_FACE:
        case ELEMENT_STRIPS: TRY(read_faces(p, element)); break;
        case ELEMENT_OTHER: TRY(read_other(p, element)); break;
        }
    }
    TRY(ply_corners_split(p));
    return make_triangles(p);
}

status ply_read(const void *data, size_t size_bytes, const struct ply_origin *origin, struct mesh_source *out,
                struct ply_report *report, struct error *err)
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
    mem_free(p.corner_uv.values);
    mem_free(p.face_colors.values);
    if (result != STATUS_OK)
        mesh_source_release(out);
    if (report)
        *report = p.report;
    return result;
}
