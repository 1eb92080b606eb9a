#include "client/import/gltf/gltf.h"
#include "client/import/builder/uri.h"
#include "client/import/gltf/compressed/meshopt.h"
#include "client/terminal/must.h"
#include "common/base/memory.h"

#include <string.h>

status gltf_read_uri(struct gltf *g, const char *uri, const struct gltf_place *at, struct buffer *out)
{
    struct error inner = {0};
    char *path = NULL;
    status result;

    if (uri_is_data(uri)) {
        result = uri_decode_data(uri, IMPORT_FILE_BYTES_MAX, out, &inner);
    } else if (!g->folder) {
        result = error_set(&inner, STATUS_ERR_INPUT, "names another file, which cannot be read here");
    } else {
        result = uri_to_path(uri, g->folder, g->b->files, &path, &inner);
        THEN(result, input_files_read(g->b->files, path, IMPORT_FILE_BYTES_MAX, out, &inner));
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

    THEN(result, gltf_size(g, row, &at, "byteLength", &length));
    THEN(result, gltf_text(g, row, &at, "uri", &uri));
    if (result != STATUS_OK)
        return result;
    if (uri) {
        TRY(gltf_read_uri(g, uri, &at, &buffer->owned));
        buffer->data = buffer->owned.data;
        buffer->size_bytes = buffer->owned.size;
    } else if (index == 0 && g->bin) {
        buffer->data = g->bin;
        buffer->size_bytes = g->bin_bytes;
    } else {
        return gltf_fail(g, STATUS_ERR_INPUT, &at, "has no uri, and the file has no binary chunk for it");
    }
    if (length == 0)
        return gltf_fail(g, STATUS_ERR_INPUT, &at, "byteLength must be at least 1");
    if (buffer->size_bytes < length)
        return gltf_fail(g, STATUS_ERR_INPUT, &at,
                         "%.200s%sholds %zu bytes, but byteLength is %llu: the file is cut short",
                         uri && !uri_is_data(uri) ? uri : "", uri && !uri_is_data(uri) ? " " : "", buffer->size_bytes,
                         (unsigned long long)length);
    buffer->size_bytes = (size_t)length;
    buffer->loaded = 1;
    return STATUS_OK;
}

/* The bytes that a view, or the extension of a view, names. */
static status view_bytes(struct gltf *g, json_t *row, const struct gltf_place *at, const uint8_t **data, size_t *size_bytes)
{
    uint64_t offset = 0, length = 0;
    struct gltf_buffer *buffer;
    int64_t index = -1;

    TRY(gltf_index(g, row, at, "buffer", g->buffers, &index));
    TRY(gltf_size(g, row, at, "byteOffset", &offset));
    TRY(gltf_size(g, row, at, "byteLength", &length));
    if (index < 0)
        return gltf_fail(g, STATUS_ERR_INPUT, at, "names no buffer");
    buffer = &g->buffer_data[index];
    if (!buffer->loaded)
        TRY(load_buffer(g, (size_t)index, buffer));
    if (length == 0 || offset > buffer->size_bytes || length > buffer->size_bytes - offset)
        return gltf_fail(g, STATUS_ERR_INPUT, at, "bytes %llu to %llu do not lie in buffers[%lld], which has %zu",
                         (unsigned long long)offset, (unsigned long long)(offset + length), (long long)index,
                         buffer->size_bytes);
    *data = buffer->data + offset;
    *size_bytes = (size_t)length;
    return STATUS_OK;
}

/* The word's number, -1: it is none of them. */
static int word_of(const char *word, const char *const *words, int count)
{
    for (int i = 0; i < count; i++)
        if (strcmp(word, words[i]) == 0)
            return i;
    return -1;
}

/* Decode a view's compressed form. */
static status decompress(struct gltf *g, json_t *extension, const struct gltf_place *at, uint64_t length,
                         struct buffer *out)
{
    const char *mode_word = "", *filter_word = "NONE", *wrong;
    const uint8_t *stream = NULL;
    size_t stream_bytes = 0, size;
    uint64_t stride = 0, count = 0;
    int mode, filter;

    TRY(view_bytes(g, extension, at, &stream, &stream_bytes));
    TRY(gltf_size(g, extension, at, "byteStride", &stride));
    TRY(gltf_size(g, extension, at, "count", &count));
    TRY(gltf_text(g, extension, at, "mode", &mode_word));
    TRY(gltf_text(g, extension, at, "filter", &filter_word));
    mode = word_of(mode_word, meshopt_mode_names, MESHOPT_MODES);
    filter = word_of(filter_word, meshopt_filter_names, MESHOPT_FILTERS);
    if (mode < 0 || filter < 0)
        return gltf_fail(g, STATUS_ERR_INPUT, at, "mode \"%.20s\" or filter \"%.20s\" is unknown", mode_word, filter_word);
    wrong = meshopt_check((enum meshopt_mode)mode, (enum meshopt_filter)filter, (size_t)count, (size_t)stride,
                          stream_bytes);
    if (wrong)
        return gltf_fail(g, STATUS_ERR_INPUT, at, "%s", wrong);
    if (!mem_size_mul((size_t)count, (size_t)stride, &size) || size != length)
        return gltf_fail(g, STATUS_ERR_INPUT, at, "%llu elements of %llu bytes are not the byteLength of the view, %llu",
                         (unsigned long long)count, (unsigned long long)stride, (unsigned long long)length);
    if (size > IMPORT_FILE_BYTES_MAX - g->decompressed_bytes)
        return gltf_fail(g, STATUS_ERR_LIMIT, at, "what is compressed takes more than %lld bytes",
                         (long long)IMPORT_FILE_BYTES_MAX);
    g->decompressed_bytes += size;
    buffer_reserve(out, size);
    must_hold(out);
    wrong = meshopt_decode((enum meshopt_mode)mode, (enum meshopt_filter)filter, (size_t)count, (size_t)stride, stream,
                           stream_bytes, out->data);
    if (wrong)
        return gltf_fail(g, STATUS_ERR_INPUT, at, "%s", wrong);
    out->size = size;
    return STATUS_OK;
}

status gltf_view(struct gltf *g, size_t view, const uint8_t **data, size_t *size_bytes, size_t *stride_bytes)
{
    static const char *const names[] = {"EXT_meshopt_compression", "KHR_meshopt_compression"};
    const struct gltf_place at = gltf_at("bufferViews", view, "");
    uint64_t stride = 0, length = 0;
    json_t *row;

    TRY(gltf_row(g, g->views, &at, &row));
    TRY(gltf_size(g, row, &at, "byteStride", &stride));
    *stride_bytes = (size_t)stride;
    for (int i = 0; i < 2; i++) {
        const struct gltf_place inner = gltf_within(&at, ".%s", names[i]);
        json_t *extension = gltf_extension(row, names[i]);
        if (!extension)
            continue;
        TRY(gltf_size(g, row, &at, "byteLength", &length));
        if (!g->view_data[view].size)
            TRY(decompress(g, extension, &inner, length, &g->view_data[view]));
        *data = g->view_data[view].data;
        *size_bytes = g->view_data[view].size;
        return STATUS_OK;
    }
    return view_bytes(g, row, &at, data, size_bytes);
}

status gltf_read_bytes(struct gltf *g, json_t *row, const struct gltf_place *at, const char *uri, struct buffer *out)
{
    const uint8_t *data = NULL;
    size_t size = 0, stride;
    int64_t view = -1;

    if (uri)
        return gltf_read_uri(g, uri, at, out);
    TRY(gltf_index(g, row, at, "bufferView", g->views, &view));
    if (view < 0)
        return gltf_fail(g, STATUS_ERR_INPUT, at, "has neither a uri nor a bufferView");
    TRY(gltf_view(g, (size_t)view, &data, &size, &stride));
    buffer_append(out, data, size);
    must_hold(out);
    return STATUS_OK;
}
