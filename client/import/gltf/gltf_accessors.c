#include <math.h>
#include <string.h>

#include "client/import/gltf/gltf.h"
#include "client/terminal/must.h"
#include "common/base/memory.h"

enum component_type {
    TYPE_BYTE = 5120,
    TYPE_UBYTE = 5121,
    TYPE_SHORT = 5122,
    TYPE_USHORT = 5123,
    TYPE_UINT = 5125,
    TYPE_FLOAT = 5126,
};

/* Bytes of one component; 0: unknown. */
static size_t type_bytes(int type)
{
    switch (type) {
    case TYPE_BYTE:
    case TYPE_UBYTE: return 1;
    case TYPE_SHORT:
    case TYPE_USHORT: return 2;
    case TYPE_UINT:
    case TYPE_FLOAT: return 4;
    default: return 0;
    }
}

static int components_of(const char *type)
{
    static const char *const names[] = {"SCALAR", "VEC2", "VEC3", "VEC4"};

    for (int i = 0; i < 4; i++)
        if (strcmp(type, names[i]) == 0)
            return i + 1;
    return strcmp(type, "MAT4") == 0 ? 16 : 0;
}

/* A run of `count` elements of `element_bytes` at `offset` of a view. */
static status open_run(struct gltf *g, const struct gltf_place *at, json_t *in, size_t count, size_t element_bytes,
                       int may_stride, const uint8_t **data, size_t *stride_bytes)
{
    const uint8_t *view_data = NULL;
    size_t view_bytes = 0, stride = 0, last;
    uint64_t offset = 0;
    int64_t view = -1;
    status result = gltf_index(g, in, at, "bufferView", g->views, &view);

    THEN(result, gltf_size(g, in, at, "byteOffset", &offset));
    if (result != STATUS_OK)
        return result;
    if (view < 0) {
        *data = NULL;
        return STATUS_OK;
    }
    TRY(gltf_view(g, (size_t)view, &view_data, &view_bytes, &stride));
    if (!may_stride || stride == 0)
        stride = element_bytes;
    if (stride < element_bytes)
        return gltf_fail(g, STATUS_ERR_INPUT, at,
                         "the elements take %zu bytes, but bufferViews[%lld].byteStride is %zu", element_bytes,
                         (long long)view, stride);
    if (!mem_size_mul(stride, count - 1, &last) || last > view_bytes || offset > view_bytes - last ||
        element_bytes > view_bytes - last - offset)
        return gltf_fail(g, STATUS_ERR_INPUT, at,
                         "%zu elements from byte %llu on do not fit into bufferViews[%lld], which "
                         "has %zu bytes",
                         count, (unsigned long long)offset, (long long)view, view_bytes);
    *data = view_data + offset;
    *stride_bytes = stride;
    return STATUS_OK;
}

static status open_sparse(struct gltf *g, const struct gltf_place *at, json_t *sparse, struct gltf_accessor *out)
{
    const struct gltf_place at_indices = gltf_within(at, ".sparse.indices");
    const struct gltf_place at_values = gltf_within(at, ".sparse.values");
    json_t *indices = NULL, *values = NULL;
    uint64_t count = 0, type = 0;
    size_t stride;
    status result = gltf_size(g, sparse, at, "count", &count);

    THEN(result, gltf_object(g, sparse, at, "indices", &indices));
    THEN(result, gltf_object(g, sparse, at, "values", &values));
    if (result == STATUS_OK && indices)
        result = gltf_size(g, indices, &at_indices, "componentType", &type);
    if (result != STATUS_OK)
        return result;
    if (!indices || !values || count < 1 || count > out->count)
        return gltf_fail(g, STATUS_ERR_INPUT, at, "sparse needs indices, values and a count from 1 to %zu", out->count);
    if (type != TYPE_UBYTE && type != TYPE_USHORT && type != TYPE_UINT)
        return gltf_fail(g, STATUS_ERR_INPUT, &at_indices, "componentType must be 5121, 5123 or 5125");
    out->sparse_index_type = (int)type;
    out->sparse_count = (size_t)count;
    result =
        open_run(g, &at_indices, indices, out->sparse_count, type_bytes((int)type), 0, &out->sparse_indices, &stride);
    THEN(result, open_run(g, &at_values, values, out->sparse_count,
                          type_bytes(out->component_type) * (size_t)out->components, 0, &out->sparse_values, &stride));
    if (result == STATUS_OK && (!out->sparse_indices || !out->sparse_values))
        result = gltf_fail(g, STATUS_ERR_INPUT, at, "sparse indices and values need a bufferView");
    return result;
}

status gltf_accessor_shape(struct gltf *g, size_t index, struct gltf_accessor *out)
{
    const struct gltf_place at = gltf_at("accessors", index, "");
    const char *type = "";
    uint64_t count = 0, component_type = 0;
    json_t *row;
    status result = gltf_row(g, g->accessors, &at, &row);

    memset(out, 0, sizeof *out);
    THEN(result, gltf_size(g, row, &at, "count", &count));
    THEN(result, gltf_size(g, row, &at, "componentType", &component_type));
    THEN(result, gltf_text(g, row, &at, "type", &type));
    THEN(result, gltf_flag(g, row, &at, "normalized", &out->normalized));
    if (result != STATUS_OK)
        return result;
    if (count < 1 || count > UINT32_MAX - 1)
        return gltf_fail(g, STATUS_ERR_INPUT, &at, "count must be 1 to %u", UINT32_MAX - 1);
    if (component_type > TYPE_FLOAT || type_bytes((int)component_type) == 0)
        return gltf_fail(g, STATUS_ERR_INPUT, &at, "componentType %llu is unknown", (unsigned long long)component_type);
    out->count = (size_t)count;
    out->component_type = (int)component_type;
    out->components = components_of(type);
    if (out->components == 0)
        return gltf_fail(g, STATUS_ERR_INPUT, &at,
                         "type \"%.16s\" is not of use here: SCALAR, VEC2, VEC3, VEC4 or MAT4 is needed", type);
    return STATUS_OK;
}

status gltf_accessor_open(struct gltf *g, size_t index, struct gltf_accessor *out)
{
    const struct gltf_place at = gltf_at("accessors", index, "");
    json_t *row = json_array_get(g->accessors, index), *sparse = NULL;
    size_t element_bytes;

    TRY(gltf_accessor_shape(g, index, out));
    TRY(gltf_object(g, row, &at, "sparse", &sparse));
    element_bytes = type_bytes(out->component_type) * (size_t)out->components;
    if (g->accessor_data[index]) {
        out->data = g->accessor_data[index];
        out->stride_bytes = element_bytes;
    } else {
        TRY(open_run(g, &at, row, out->count, element_bytes, 1, &out->data, &out->stride_bytes));
    }
    if (!out->data && out->count > GLTF_ZERO_ELEMENTS_MAX)
        return gltf_fail(g, STATUS_ERR_LIMIT, &at, "%zu elements without a bufferView: at most %d are taken",
                         out->count, GLTF_ZERO_ELEMENTS_MAX);
    return sparse ? open_sparse(g, &at, sparse, out) : STATUS_OK;
}

static float component(const uint8_t *at, int type, int normalized)
{
    switch (type) {
    case TYPE_BYTE: {
        int8_t v = (int8_t)*at;
        return normalized ? fmaxf((float)v / 127.0f, -1.0f) : (float)v;
    }
    case TYPE_UBYTE: return normalized ? (float)*at / 255.0f : (float)*at;
    case TYPE_SHORT: {
        int16_t v;
        memcpy(&v, at, sizeof v);
        return normalized ? fmaxf((float)v / 32767.0f, -1.0f) : (float)v;
    }
    case TYPE_USHORT: {
        uint16_t v;
        memcpy(&v, at, sizeof v);
        return normalized ? (float)v / 65535.0f : (float)v;
    }
    case TYPE_UINT: {
        uint32_t v;
        memcpy(&v, at, sizeof v);
        return normalized ? (float)((double)v / 4294967295.0) : (float)v;
    }
    default: {
        float v;
        memcpy(&v, at, sizeof v);
        return v;
    }
    }
}

static uint32_t integer(const uint8_t *at, int type)
{
    uint16_t half;
    uint32_t word;

    switch (type) {
    case TYPE_UBYTE: return *at;
    case TYPE_USHORT: memcpy(&half, at, sizeof half); return half;
    default: memcpy(&word, at, sizeof word); return word;
    }
}

/* The element that the sparse entry `i` replaces; it must rise and be in range. */
static status sparse_target(struct gltf *g, size_t index, const struct gltf_accessor *a, size_t i, int64_t *previous,
                            size_t *target)
{
    const uint8_t *at = a->sparse_indices + i * type_bytes(a->sparse_index_type);
    const struct gltf_place place = gltf_at("accessors", index, ".sparse.indices");
    uint32_t found = integer(at, a->sparse_index_type);

    if (found >= a->count || (int64_t)found <= *previous)
        return gltf_fail(g, STATUS_ERR_INPUT, &place,
                         "index %u is out of range or out of order (the accessor has %zu elements)", found, a->count);
    *previous = (int64_t)found;
    *target = found;
    return STATUS_OK;
}

status gltf_accessor_floats(struct gltf *g, size_t index, const struct gltf_accessor *a, int any, float **out)
{
    const struct gltf_place place = gltf_at("accessors", index, "");
    size_t components = (size_t)a->components, width = type_bytes(a->component_type);
    float *values = must(mem_alloc_array(a->count, components * sizeof *values));
    int64_t previous = -1;

    *out = NULL;
    for (size_t i = 0; i < a->count; i++)
        for (size_t c = 0; c < components; c++)
            values[i * components + c] =
                a->data ? component(a->data + i * a->stride_bytes + c * width, a->component_type, a->normalized) : 0.0f;
    for (size_t i = 0; i < a->sparse_count; i++) {
        size_t target = 0;
        status result = sparse_target(g, index, a, i, &previous, &target);
        if (result != STATUS_OK) {
            mem_free(values);
            return result;
        }
        for (size_t c = 0; c < components; c++)
            values[target * components + c] =
                component(a->sparse_values + (i * components + c) * width, a->component_type, a->normalized);
    }
    if (a->component_type == TYPE_FLOAT && !any)
        for (size_t i = 0; i < a->count * components; i++)
            if (!isfinite(values[i])) {
                mem_free(values);
                return gltf_fail(g, STATUS_ERR_INPUT, &place, "element %zu is not a finite number", i / components);
            }
    *out = values;
    return STATUS_OK;
}

status gltf_accessor_indices(struct gltf *g, size_t index, const struct gltf_accessor *a, uint32_t **out)
{
    const struct gltf_place place = gltf_at("accessors", index, "");
    int64_t previous = -1;
    uint32_t *values;

    *out = NULL;
    if (a->components != 1 || a->normalized ||
        (a->component_type != TYPE_UBYTE && a->component_type != TYPE_USHORT && a->component_type != TYPE_UINT))
        return gltf_fail(g, STATUS_ERR_INPUT, &place, "indices must be SCALAR and of componentType 5121, 5123 or 5125");
    values = must(mem_alloc_array(a->count, sizeof *values));
    for (size_t i = 0; i < a->count; i++)
        values[i] = a->data ? integer(a->data + i * a->stride_bytes, a->component_type) : 0;
    for (size_t i = 0; i < a->sparse_count; i++) {
        size_t target = 0;
        status result = sparse_target(g, index, a, i, &previous, &target);
        if (result != STATUS_OK) {
            mem_free(values);
            return result;
        }
        values[target] = integer(a->sparse_values + i * type_bytes(a->component_type), a->component_type);
    }
    *out = values;
    return STATUS_OK;
}

status gltf_attribute(struct gltf *g, json_t *attributes, const struct gltf_place *at, const char *key, int components,
                      int most, int any, size_t vertices, float **out, int *found)
{
    struct gltf_accessor accessor;
    int64_t index = -1;

    TRY(gltf_index(g, attributes, at, key, g->accessors, &index));
    if (index < 0)
        return STATUS_OK;
    TRY(gltf_accessor_open(g, (size_t)index, &accessor));
    if (accessor.components < components || accessor.components > most)
        return gltf_fail(g, STATUS_ERR_INPUT, at, "%s must have %d components, it has %d", key, components,
                         accessor.components);
    if (vertices && accessor.count != vertices)
        return gltf_fail(g, STATUS_ERR_INPUT, at, "%s has %zu elements, POSITION has %zu", key, accessor.count,
                         vertices);
    if (found)
        *found = accessor.components;
    return gltf_accessor_floats(g, (size_t)index, &accessor, any, out);
}
