/* KHR_draco_mesh_compression: the accessors of a primitive get their elements of its stream. */
#include "client/import/gltf/compressed/draco.h"
#include "client/import/gltf/gltf_mesh_parts.h"
#include "client/terminal/must.h"
#include "common/base/memory.h"

enum {
    MODE_TRIANGLES = 4,
    TRIANGLES_MAX = 1 << 26,   /* of one primitive */
    TRIANGLES_A_BYTE_MAX = 1024, /* of a stream */
};

/* How an accessor's elements come out of the stream; the element's bytes, 0: not at all. */
static size_t element_of(const struct gltf_accessor *a, enum draco_type *type)
{
    static const struct {
        int component_type;
        enum draco_type type;
        size_t bytes;
    } types[] = {{5120, DRACO_INT8, 1},   {5121, DRACO_UINT8, 1},  {5122, DRACO_INT16, 2},
                 {5123, DRACO_UINT16, 2}, {5125, DRACO_UINT32, 4}, {5126, DRACO_FLOAT, 4}};

    for (size_t i = 0; i < sizeof types / sizeof *types; i++)
        if (types[i].component_type == a->component_type) {
            *type = types[i].type;
            return types[i].bytes * (size_t)a->components;
        }
    return 0;
}

/* Room for the elements of an accessor in place of those of its view. */
static uint8_t *take_place(struct gltf *g, int64_t accessor, size_t count, size_t element_bytes)
{
    uint8_t **place = &g->accessor_data[accessor];

    mem_free(*place);
    return *place = must(mem_alloc_array(count, element_bytes));
}

static status read_attribute(struct gltf *g, json_t *attributes, const struct gltf_place *at, const char *name,
                             json_t *id, size_t points, const struct draco_mesh *mesh)
{
    struct gltf_accessor accessor;
    enum draco_type type = DRACO_FLOAT;
    const char *wrong;
    int64_t index = -1;
    size_t bytes;

    TRY(gltf_index(g, attributes, at, name, g->accessors, &index));
    if (index < 0 || !json_is_integer(id) || json_integer_value(id) < 0 || json_integer_value(id) > UINT32_MAX)
        return gltf_fail(g, STATUS_ERR_INPUT, at, "attributes.%.40s must be a number, and the primitive's, too", name);
    TRY(gltf_accessor_shape(g, (size_t)index, &accessor));
    bytes = element_of(&accessor, &type);
    if (accessor.count != points || bytes == 0)
        return gltf_fail(g, STATUS_ERR_INPUT, at, "%.40s has %zu elements, POSITION has %zu", name, accessor.count,
                         points);
    wrong = draco_mesh_attribute(mesh, (uint32_t)json_integer_value(id), accessor.components, type,
                                 take_place(g, index, points, bytes));
    return wrong ? gltf_fail(g, STATUS_ERR_INPUT, at, "%.40s: %s", name, wrong) : STATUS_OK;
}

static status read_indices(struct gltf *g, const struct gltf_place *at, int64_t index, const struct gltf_accessor *a,
                           const struct draco_mesh *mesh)
{
    uint32_t *values = must(mem_alloc_array(a->count, sizeof *values));
    enum draco_type type = DRACO_UINT32;
    size_t bytes = element_of(a, &type);
    uint8_t *out;

    if (a->components != 1 || (type != DRACO_UINT8 && type != DRACO_UINT16 && type != DRACO_UINT32)) {
        mem_free(values);
        return gltf_fail(g, STATUS_ERR_INPUT, at, "indices must be SCALAR and of componentType 5121, 5123 or 5125");
    }
    draco_mesh_indices(mesh, values);
    out = take_place(g, index, a->count, bytes);
    for (size_t i = 0; i < a->count; i++)
        for (size_t b = 0; b < bytes; b++)
            out[i * bytes + b] = (uint8_t)(values[i] >> 8 * b);
    mem_free(values);
    return STATUS_OK;
}

static status read_stream(struct gltf *g, json_t *extension, json_t *primitive, json_t *attributes,
                          const struct gltf_place *at)
{
    struct gltf_accessor positions, indices;
    int64_t view = -1, position = -1, index = -1;
    const uint8_t *stream = NULL;
    size_t size = 0, stride;
    struct draco_mesh *mesh;
    json_t *ids = NULL, *id;
    const char *wrong, *name;
    status result;

    TRY(gltf_index(g, extension, at, "bufferView", g->views, &view));
    TRY(gltf_object(g, extension, at, "attributes", &ids));
    TRY(gltf_index(g, attributes, at, "POSITION", g->accessors, &position));
    TRY(gltf_index(g, primitive, at, "indices", g->accessors, &index));
    if (view < 0 || !ids || position < 0 || index < 0)
        return gltf_fail(g, STATUS_ERR_INPUT, at, "needs a bufferView, attributes, POSITION and indices");
    TRY(gltf_view(g, (size_t)view, &stream, &size, &stride));
    TRY(gltf_accessor_shape(g, (size_t)position, &positions));
    TRY(gltf_accessor_shape(g, (size_t)index, &indices));
    if (indices.count % 3 != 0)
        return gltf_fail(g, STATUS_ERR_INPUT, at, "has %zu indices, not a multiple of 3", indices.count);
    if (indices.count / 3 > TRIANGLES_MAX || indices.count / 3 / TRIANGLES_A_BYTE_MAX > size ||
        positions.count > indices.count)
        return gltf_fail(g, STATUS_ERR_LIMIT, at,
                         "has %zu triangles of %zu points in %zu bytes: at most %d triangles, %d a byte and three "
                         "points each are read",
                         indices.count / 3, positions.count, size, TRIANGLES_MAX, TRIANGLES_A_BYTE_MAX);
    wrong = draco_mesh_open(stream, size, positions.count, indices.count / 3, &mesh);
    if (wrong)
        return gltf_fail(g, STATUS_ERR_INPUT, at, "%s", wrong);
    result = read_indices(g, at, index, &indices, mesh);
    json_object_foreach(ids, name, id) THEN(result, read_attribute(g, attributes, at, name, id, positions.count, mesh));
    draco_mesh_free(mesh);
    return result;
}

status gltf_draco_read(struct gltf *g, json_t *primitive, json_t *attributes, const struct gltf_place *at,
                       uint64_t mode)
{
    const struct gltf_place inner = gltf_within(at, ".KHR_draco_mesh_compression");
    json_t *extension = gltf_extension(primitive, "KHR_draco_mesh_compression");

    if (!extension)
        return STATUS_OK;
    if (mode != MODE_TRIANGLES)
        return gltf_fail(g, STATUS_ERR_UNSUPPORTED, &inner, "mode must be 4 (triangles), it is %llu",
                         (unsigned long long)mode);
    return read_stream(g, extension, primitive, attributes, &inner);
}

static void give_back(struct gltf *g, json_t *accessor)
{
    size_t index = (size_t)json_integer_value(accessor);

    if (!json_is_integer(accessor) || index >= json_array_size(g->accessors))
        return;
    mem_free(g->accessor_data[index]);
    g->accessor_data[index] = NULL;
}

void gltf_draco_release(struct gltf *g, json_t *primitive, json_t *attributes)
{
    const char *name;
    json_t *accessor;

    if (!gltf_extension(primitive, "KHR_draco_mesh_compression"))
        return;
    give_back(g, json_object_get(primitive, "indices"));
    json_object_foreach(attributes, name, accessor) give_back(g, accessor);
}
