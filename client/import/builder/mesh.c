#include "client/import/builder/mesh.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "client/terminal/must.h"
#include "common/base/memory.h"
#include "common/base/safeguard.h"
#include "common/math/vec.h"

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__,
               "mesh blobs are little-endian and are written as they lie in memory");

/* Beyond this distance in metres, float has too few digits for ordinary detail. */
#define ORIGIN_FAR 1024.0

void mesh_origin_choose(const double first[3], double origin[3])
{
    int far = 0;

    for (int c = 0; c < 3; c++)
        far |= fabs(first[c]) >= ORIGIN_FAR && SAFEGUARD(VERTEX_ORIGIN);
    for (int c = 0; c < 3; c++)
        origin[c] = far ? first[c] : 0;
}

/* Own origins lie on a grid of this many metres. A float holds multiples of the step up to there. */
#define ORIGIN_GRID 64.0
#define ORIGIN_STEP (ORIGIN_GRID * 0x1p-24)
enum { MEDIAN_POINTS = 2048 };

static int by_value(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;

    return (x > y) - (x < y);
}

/* The median of some of the coordinates, and the median deviation from it. */
static double median_of(const double *points, size_t count, int axis, double *spread)
{
    double sorted[MEDIAN_POINTS], middle;
    size_t stride = count / MEDIAN_POINTS + 1, n = 0;

    for (size_t i = 0; i < count; i += stride)
        if (isfinite(points[3 * i + (size_t)axis]))
            sorted[n++] = points[3 * i + (size_t)axis];
    *spread = 0;
    if (n == 0)
        return 0;
    qsort(sorted, n, sizeof *sorted, by_value);
    middle = sorted[n / 2];
    for (size_t i = 0; i < n; i++)
        sorted[i] = fabs(sorted[i] - middle);
    qsort(sorted, n, sizeof *sorted, by_value);
    *spread = sorted[n / 2];
    return middle;
}

void mesh_origin_near(const double *points, size_t count, const double shared[3], double metre, struct mesh_origin *out)
{
    const double grid = ORIGIN_GRID * metre;
    double own[3], away = 0, extent = 0;

    memcpy(out->at, shared, sizeof out->at);
    out->step = 0;
    if (!SAFEGUARD(VERTEX_ORIGIN))
        return;
    for (int c = 0; c < 3; c++) {
        double spread;
        own[c] = shared[c] + grid * rint((median_of(points, count, c, &spread) - shared[c]) / grid);
        away = fmax(away, fabs(own[c] - shared[c]));
        extent = fmax(extent, spread);
    }
    if (away < ORIGIN_FAR * metre || extent > away)
        return;
    memcpy(out->at, own, sizeof own);
    out->step = ORIGIN_STEP * metre;
}

/* + 0.0f: one zero only, so that equal positions are equal in their bits. */
float mesh_place(const struct mesh_origin *origin, double value, int axis)
{
    double from = value - origin->at[axis];

    return (float)(origin->step > 0 ? origin->step * rint(from / origin->step) : from) + 0.0f;
}

void mesh_source_release(struct mesh_source *mesh)
{
    mem_free(mesh->positions);
    mem_free(mesh->normals);
    mem_free(mesh->tangents);
    mem_free(mesh->uv[0]);
    mem_free(mesh->uv[1]);
    mem_free(mesh->colors);
    mem_free(mesh->indices);
    mem_free(mesh->influences);
    for (size_t i = 0; mesh->morphs && i < mesh->morph_count; i++) {
        mem_free(mesh->morphs[i].positions);
        mem_free(mesh->morphs[i].normals);
    }
    mem_free(mesh->morphs);
    memset(mesh, 0, sizeof *mesh);
}

float mesh_color_range(const float *values, size_t count)
{
    float most = 0;

    for (size_t i = 0; i < count; i++) {
        if (values[i] < 0 || values[i] > floorf(values[i]))
            return 1;
        most = fmaxf(most, values[i]);
    }
    return most <= 4 || most > 65535 ? 1 : most > 255 ? 65535 : 255;
}

static int deforms(const struct mesh_source *mesh) { return mesh->influences || mesh->morph_count; }

static void gather_bytes(void **array, size_t row_bytes, const uint32_t *from, size_t count)
{
    uint8_t *gathered;

    if (!*array)
        return;
    gathered = must(mem_alloc_array(count, row_bytes));
    for (size_t i = 0; i < count; i++)
        memcpy(gathered + i * row_bytes, (const uint8_t *)*array + (size_t)from[i] * row_bytes, row_bytes);
    mem_free(*array);
    *array = gathered;
}

static void gather_array(float **array, size_t width, const uint32_t *from, size_t count)
{
    gather_bytes((void **)array, width * sizeof **array, from, count);
}

void mesh_source_gather(struct mesh_source *mesh, const uint32_t *from, size_t count)
{
    gather_array(&mesh->positions, 3, from, count);
    gather_array(&mesh->normals, 3, from, count);
    gather_array(&mesh->tangents, 4, from, count);
    gather_array(&mesh->uv[0], 2, from, count);
    gather_array(&mesh->uv[1], 2, from, count);
    gather_array(&mesh->colors, 4, from, count);
    gather_bytes((void **)&mesh->influences, sizeof *mesh->influences, from, count);
    for (size_t i = 0; i < mesh->morph_count; i++) {
        gather_array(&mesh->morphs[i].positions, 3, from, count);
        gather_array(&mesh->morphs[i].normals, 3, from, count);
    }
    mesh->vertex_count = count;
}

static struct vec3 position(const struct mesh_source *mesh, uint32_t v)
{
    const float *p = mesh->positions + 3 * (size_t)v;

    return (struct vec3){p[0], p[1], p[2]};
}

/* Twice the area times the normal, in the arithmetic that the renderer uses: a triangle without a
 * normal there has none here. */
static struct vec3 area_vector(const struct mesh_source *mesh, size_t t)
{
    const uint32_t *i = mesh->indices + 3 * t;
    struct vec3 a = position(mesh, i[0]);

    return vec3_cross(vec3_sub(position(mesh, i[1]), a), vec3_sub(position(mesh, i[2]), a));
}

static size_t drop_degenerate(struct mesh_source *mesh)
{
    size_t kept = 0;

    for (size_t t = 0; t < mesh->triangle_count; t++) {
        const uint32_t *i = mesh->indices + 3 * t;
        struct vec3 n = vec3_normalize(area_vector(mesh, t));
        if (i[0] == i[1] || i[1] == i[2] || i[2] == i[0] || (vec3_is_black(n) && !deforms(mesh)))
            continue;
        memmove(mesh->indices + 3 * kept++, mesh->indices + 3 * t, 3 * sizeof *mesh->indices);
    }
    return mesh->triangle_count - kept;
}

/* Primitives of one mesh often share one long vertex buffer: keep only the used vertices. */
static void drop_unused_vertices(struct mesh_source *mesh)
{
    uint32_t *to = must(mem_calloc(mesh->vertex_count, sizeof *to));
    uint32_t *from = must(mem_alloc_array(mesh->vertex_count, sizeof *from));
    size_t kept = 0;

    for (size_t i = 0; i < mesh->triangle_count * 3; i++)
        to[mesh->indices[i]] = 1;
    for (size_t v = 0; v < mesh->vertex_count; v++)
        if (to[v]) {
            from[kept] = (uint32_t)v;
            to[v] = (uint32_t)kept++;
        }
    if (kept == mesh->vertex_count)
        goto done;
    for (size_t i = 0; i < mesh->triangle_count * 3; i++)
        mesh->indices[i] = to[mesh->indices[i]];
    mesh_source_gather(mesh, from, kept);
done:
    mem_free(from);
    mem_free(to);
}

/* Unit normals; those without a direction get the normal of a triangle that uses them. */
static size_t repair_normals(struct mesh_source *mesh)
{
    size_t bad = 0;

    if (!mesh->normals)
        return 0;
    for (size_t v = 0; v < mesh->vertex_count; v++) {
        float *n = mesh->normals + 3 * v;
        struct vec3 unit = vec3_normalize((struct vec3){n[0], n[1], n[2]});
        int good = vec3_is_finite(unit) && !vec3_is_black(unit);
        bad += !good;
        /* NaN marks normals that the loop below must repair. + 0.0f: negative zeros would make
         * equal normals differ in their bits. */
        n[0] = good ? unit.x + 0.0f : NAN;
        n[1] = unit.y + 0.0f;
        n[2] = unit.z + 0.0f;
    }
    for (size_t t = 0; bad && t < mesh->triangle_count; t++)
        for (size_t i = 0; i < 3; i++) {
            float *n = mesh->normals + 3 * (size_t)mesh->indices[3 * t + i];
            if (isnan(n[0])) {
                struct vec3 unit = vec3_normalize(area_vector(mesh, t));
                if (vec3_is_black(unit)) /* of a mesh that deforms: any direction will do */
                    unit.y = 1;
                n[0] = unit.x, n[1] = unit.y, n[2] = unit.z;
            }
        }
    return bad;
}

/* Unit tangents with a hand of exactly +1 or -1; 0 when one has no direction. */
static int mend_tangents(struct mesh_source *mesh)
{
    for (size_t v = 0; v < mesh->vertex_count; v++) {
        float *t = mesh->tangents + 4 * v;
        struct vec3 unit = vec3_normalize((struct vec3){t[0], t[1], t[2]});
        if (!vec3_is_finite(unit) || vec3_is_black(unit) || !isfinite(t[3]) || t[3] == 0)
            return 0;
        t[0] = unit.x, t[1] = unit.y, t[2] = unit.z;
        t[3] = t[3] < 0 ? -1.0f : 1.0f;
    }
    return 1;
}

static void prepare_tangents(struct builder *b, struct mesh_source *mesh, const char *name,
                             const struct mesh_tangents *wanted)
{
    if (!wanted->wanted || !mesh->normals) {
        /* Flat shading ignores supplied tangents (glTF 2.0, 3.7.2.1). */
        mem_free(mesh->tangents);
        mesh->tangents = NULL;
    }
    if (!wanted->wanted || (mesh->tangents && mend_tangents(mesh)))
        return;
    if (mesh->tangents)
        builder_warn(b, "tangents", "%s: a tangent has no direction: new ones were made", name);
    if (!mesh->uv[wanted->uv_set]) {
        builder_warn(b, "no texture coordinates for a normal map",
                     "%s: has a normal map or anisotropy but no texture coordinates for it: "
                     "rendered without",
                     name);
        mem_free(mesh->tangents);
        mesh->tangents = NULL;
        return;
    }
    tangents_generate(mesh, wanted);
}

static void find_bounds(const struct mesh_source *mesh, struct scene_mesh *out)
{
    for (int c = 0; c < 3; c++) {
        out->bounds_min[c] = INFINITY;
        out->bounds_max[c] = -INFINITY;
    }
    for (size_t v = 0; v < mesh->vertex_count; v++)
        for (int c = 0; c < 3; c++) {
            float at = mesh->positions[3 * v + (size_t)c];
            out->bounds_min[c] = fminf(out->bounds_min[c], at);
            out->bounds_max[c] = fmaxf(out->bounds_max[c], at);
        }
}

static void copy_array(uint8_t *blob, size_t offset, const float *array, size_t floats)
{
    if (array)
        memcpy(blob + offset, array, floats * sizeof *array);
}

static void write_morphs(uint8_t *blob, const struct scene_mesh_layout *layout, const struct mesh_source *mesh)
{
    size_t bytes = mesh->vertex_count * 3 * sizeof(float);

    for (size_t i = 0; i < mesh->morph_count; i++) {
        uint8_t *at = blob + layout->morphs + i * layout->morph_stride;
        memcpy(at, mesh->morphs[i].positions, bytes);
        if (mesh->normals && mesh->morphs[i].normals)
            memcpy(at + bytes, mesh->morphs[i].normals, bytes);
        else if (mesh->normals)
            memset(at + bytes, 0, bytes);
    }
}

static status write_blob(struct builder *b, const struct mesh_source *mesh, struct scene_mesh *row, uint8_t **data,
                         size_t *size_bytes)
{
    struct scene_mesh_layout layout;
    size_t vertices = mesh->vertex_count;

    scene_mesh_layout(row, &layout);
    if (layout.total_bytes > SCENE_BLOB_BYTES_MAX)
        return error_set(b->err, STATUS_ERR_LIMIT, "%s: the mesh is too large", row->name);
    *data = must(mem_alloc(layout.total_bytes));
    *size_bytes = layout.total_bytes;
    copy_array(*data, layout.positions, mesh->positions, vertices * 3);
    copy_array(*data, layout.normals, mesh->normals, vertices * 3);
    copy_array(*data, layout.tangents, mesh->tangents, vertices * 4);
    copy_array(*data, layout.uv0, mesh->uv[0], vertices * 2);
    copy_array(*data, layout.uv1, mesh->uv[1], vertices * 2);
    copy_array(*data, layout.colors, mesh->colors, vertices * 4);
    if (mesh->influences)
        memcpy(*data + layout.skin, mesh->influences, vertices * sizeof *mesh->influences);
    write_morphs(*data, &layout, mesh);
    memcpy(*data + layout.indices, mesh->indices, mesh->triangle_count * 3 * sizeof(uint32_t));
    memset(*data + layout.total_bytes - SCENE_MESH_PADDING_BYTES, 0, SCENE_MESH_PADDING_BYTES);
    return STATUS_OK;
}

status mesh_finish(struct builder *b, struct mesh_source *mesh, const char *name, const struct mesh_tangents *tangents,
                   int64_t *row)
{
    struct scene_mesh out = {.name = name};
    uint8_t *data = NULL;
    size_t size_bytes = 0, dropped, repaired;
    uint32_t added = 0;
    status result = STATUS_OK;

    *row = BUILDER_NO_ROW;
    dropped = drop_degenerate(mesh);
    mesh->triangle_count -= dropped;
    b->out->degenerate_triangles += dropped;
    if (mesh->triangle_count == 0)
        goto done;
    if (mesh->triangle_count > SCENE_TRIANGLES_MAX) {
        result = error_set(b->err, STATUS_ERR_LIMIT, "%s: has %zu triangles: at most %d are taken", name,
                           mesh->triangle_count, SCENE_TRIANGLES_MAX);
        goto done;
    }
    if (mesh->morph_count > SCENE_MORPHS_MAX) {
        result = error_set(b->err, STATUS_ERR_LIMIT, "%s: has %zu morph targets: at most %d are taken", name,
                           mesh->morph_count, SCENE_MORPHS_MAX);
        goto done;
    }
    drop_unused_vertices(mesh);
    repaired = repair_normals(mesh);
    if (repaired)
        builder_warn(b, "normals", "%s: %zu normals have no direction: made from the triangles", name, repaired);
    prepare_tangents(b, mesh, name, tangents);
    out.closed = mesh_is_closed(mesh);
    if (deforms(mesh) && out.closed > 0)
        out.closed = 0;
    out.vertex_count = (uint32_t)mesh->vertex_count;
    out.triangle_count = (uint32_t)mesh->triangle_count;
    out.arrays = (mesh->normals ? MESH_NORMALS : 0u) | (mesh->tangents ? MESH_TANGENTS : 0u) |
                 (mesh->uv[0] ? MESH_UV0 : 0u) | (mesh->uv[1] ? MESH_UV1 : 0u) | (mesh->colors ? MESH_COLORS : 0u) |
                 (mesh->influences ? MESH_SKIN : 0u) | mesh->stands_in;
    out.morph_count = (uint32_t)mesh->morph_count;
    find_bounds(mesh, &out);
    result = write_blob(b, mesh, &out, &data, &size_bytes);
    THEN(result, builder_add_mesh(b, &out, data, size_bytes, &added));
    if (result == STATUS_OK)
        *row = added;
done:
    mesh_source_release(mesh);
    return result;
}
