#include "client/import/gltf/gltf.h"
#include "client/import/builder/uri.h"
#include "common/base/memory.h"

status gltf_read_uri(struct gltf *g, const char *uri, const struct gltf_place *at,
                     struct buffer *out)
{
    struct error inner = {0};
    char *path = NULL;
    status result;

    if (uri_is_data(uri)) {
        result = uri_decode_data(uri, IMPORT_FILE_BYTES_MAX, out, &inner);
    } else if (!g->folder) {
        result = error_set(&inner, STATUS_ERR_INPUT,
                           "names another file, which cannot be read here");
    } else {
        result = uri_to_path(uri, g->folder, g->b->files, &path, &inner);
        if (result == STATUS_OK)
            result = input_files_read(g->b->files, path, IMPORT_FILE_BYTES_MAX, out, &inner);
    }
    mem_free(path);
    if (result == STATUS_ERR_NO_MEMORY)
        return error_no_memory(g->err, "a file");
    return result == STATUS_OK ? result : gltf_fail(g, result, at, "%s", inner.text);
}

static status load_buffer(struct gltf *g, size_t index, struct gltf_buffer *buffer)
{
    const struct gltf_place at = gltf_at("buffers", index, "");
    const char *uri = NULL;
    uint64_t length = 0;
    json_t *row;
    status result = gltf_row(g, g->buffers, &at, &row);

    if (result == STATUS_OK)
        result = gltf_size(g, row, &at, "byteLength", &length);
    if (result == STATUS_OK)
        result = gltf_text(g, row, &at, "uri", &uri);
    if (result != STATUS_OK)
        return result;
    if (uri) {
        result = gltf_read_uri(g, uri, &at, &buffer->owned);
        if (result != STATUS_OK)
            return result;
        buffer->data = buffer->owned.data;
        buffer->size_bytes = buffer->owned.size;
    } else if (index == 0 && g->bin) {
        buffer->data = g->bin;
        buffer->size_bytes = g->bin_bytes;
    } else {
        if (gltf_extension(row, "EXT_meshopt_compression") ||
            gltf_extension(row, "KHR_meshopt_compression"))
            return gltf_fail(g, STATUS_ERR_UNSUPPORTED, &at,
                             "its data are only there in meshopt-compressed form: decompress the "
                             "file first, for example with \"gltf-transform copy in.glb out.glb\"");
        return gltf_fail(g, STATUS_ERR_INPUT, &at,
                         "has no uri, and the file has no binary chunk for it");
    }
    if (length == 0)
        return gltf_fail(g, STATUS_ERR_INPUT, &at, "byteLength must be at least 1");
    if (buffer->size_bytes < length)
        return gltf_fail(g, STATUS_ERR_INPUT, &at,
                         "%.200s%sholds %zu bytes, but byteLength is %llu: the file is cut short",
                         uri && !uri_is_data(uri) ? uri : "", uri && !uri_is_data(uri) ? " " : "",
                         buffer->size_bytes, (unsigned long long)length);
    buffer->size_bytes = (size_t)length;
    buffer->loaded = 1;
    return STATUS_OK;
}

status gltf_view(struct gltf *g, size_t view, const uint8_t **data, size_t *size_bytes,
                 size_t *stride_bytes)
{
    const struct gltf_place at = gltf_at("bufferViews", view, "");
    uint64_t offset = 0, length = 0, stride = 0;
    struct gltf_buffer *buffer;
    int64_t index = -1;
    json_t *row;
    status result = gltf_row(g, g->views, &at, &row);

    if (result == STATUS_OK)
        result = gltf_index(g, row, &at, "buffer", g->buffers, &index);
    if (result == STATUS_OK)
        result = gltf_size(g, row, &at, "byteOffset", &offset);
    if (result == STATUS_OK)
        result = gltf_size(g, row, &at, "byteLength", &length);
    if (result == STATUS_OK)
        result = gltf_size(g, row, &at, "byteStride", &stride);
    if (result != STATUS_OK)
        return result;
    if (index < 0)
        return gltf_fail(g, STATUS_ERR_INPUT, &at, "names no buffer");
    buffer = &g->buffer_data[index];
    if (!buffer->loaded) {
        result = load_buffer(g, (size_t)index, buffer);
        if (result != STATUS_OK)
            return result;
    }
    if (length == 0 || offset > buffer->size_bytes || length > buffer->size_bytes - offset)
        return gltf_fail(g, STATUS_ERR_INPUT, &at,
                         "bytes %llu to %llu do not lie in buffers[%lld], which has %zu",
                         (unsigned long long)offset, (unsigned long long)(offset + length),
                         (long long)index, buffer->size_bytes);
    *data = buffer->data + offset;
    *size_bytes = (size_t)length;
    *stride_bytes = (size_t)stride;
    return STATUS_OK;
}
