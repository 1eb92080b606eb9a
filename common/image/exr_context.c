#include "common/image/exr_context.h"

#include <stdio.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/image/image.h"

/* No single block of the library's is larger: a chunk holds at most 32 scan lines. */
#define EXR_BLOCK_BYTES_MAX ((size_t)1 << 30)

/* The stream that this thread works on. The library may hold the context's lock while it reports an
 * error, so asking the context for its user data would deadlock. */
static _Thread_local struct exr_stream *current_stream;

/* Zeroed, so that a damaged chunk that decodes to too little shows black, not old memory. The
 * library continues without some of its blocks: remember that one is missing, and why. */
static void *stream_alloc(size_t size_bytes)
{
    int too_large = size_bytes > EXR_BLOCK_BYTES_MAX;
    void *block = too_large ? NULL : mem_calloc(size_bytes, 1);

    if (!block && current_stream && too_large)
        current_stream->oversized = 1;
    else if (!block && current_stream)
        current_stream->starved = 1;
    return block;
}

static void stream_free(void *block) { mem_free(block); }

static void stream_complain(exr_const_context_t context UNUSED, exr_result_t code UNUSED, const char *text)
{
    struct exr_stream *stream = current_stream;

    if (!stream || stream->message[0] != 0)
        return;
    snprintf(stream->message, sizeof stream->message, "%s", text);
    for (char *c = stream->message; *c; c++) /* it may quote names from the file */
        if (*c < ' ' || *c > '~')
            *c = '?';
}

static int64_t stream_read(exr_const_context_t context UNUSED, void *user, void *out, uint64_t size_bytes,
                           uint64_t offset, exr_stream_error_func_ptr_t complain UNUSED)
{
    const struct exr_stream *stream = user;
    size_t left;

    if (offset >= stream->size_bytes)
        return 0;
    left = stream->size_bytes - (size_t)offset;
    if (size_bytes > left)
        size_bytes = left;
    memcpy(out, stream->data + offset, size_bytes);
    return (int64_t)size_bytes;
}

static int64_t stream_size(exr_const_context_t context UNUSED, void *user)
{
    const struct exr_stream *stream = user;

    return (int64_t)stream->size_bytes;
}

/* The library returns to the offset table, so not all writes are at the end. */
static int64_t stream_write(exr_const_context_t context UNUSED, void *user, const void *data, uint64_t size_bytes,
                            uint64_t offset, exr_stream_error_func_ptr_t complain UNUSED)
{
    struct exr_stream *stream = user;
    size_t end;

    if (__builtin_add_overflow(offset, size_bytes, &end))
        return -1;
    if (end > stream->out->size) {
        size_t old = stream->out->size;

        if (!buffer_append_space(stream->out, end - old))
            return -1;
        memset(stream->out->data + old, 0, end - old);
    }
    memcpy(stream->out->data + offset, data, size_bytes);
    return (int64_t)size_bytes;
}

exr_context_initializer_t exr_stream_initializer(struct exr_stream *stream)
{
    exr_context_initializer_t init = EXR_DEFAULT_CONTEXT_INITIALIZER;

    current_stream = stream;
    init.error_handler_fn = stream_complain;
    init.alloc_fn = stream_alloc;
    init.free_fn = stream_free;
    init.user_data = stream;
    if (stream->out) {
        init.write_fn = stream_write;
    } else {
        init.read_fn = stream_read;
        init.size_fn = stream_size;
    }
    init.max_image_width = IMAGE_SIDE_MAX;
    init.max_image_height = IMAGE_SIDE_MAX;
    init.max_tile_width = IMAGE_SIDE_MAX;
    init.max_tile_height = IMAGE_SIDE_MAX;
    init.zip_level = 4; /* the library's own choice since 3.1.3; fixed, so that bytes repeat */
    /* Refuse a file whose offset table is damaged instead of guessing. */
    init.flags = EXR_CONTEXT_FLAG_DISABLE_CHUNK_RECONSTRUCTION;
    return init;
}

exr_result_t exr_stream_finish(exr_context_t *context)
{
    exr_result_t result = *context ? exr_finish(context) : EXR_ERR_SUCCESS;

    current_stream = NULL;
    return result;
}

status exr_stream_error(const struct exr_stream *stream, exr_result_t result, const char *name, struct error *err)
{
    const char *why = stream->message[0] ? stream->message : exr_get_error_code_as_string(result);

    if (stream->starved)
        return error_no_memory(err, name);
    if (stream->oversized)
        return error_set(err, STATUS_ERR_LIMIT,
                         "%s: a block of more than %zu MiB: the OpenEXR file is damaged, or its "
                         "tiles are too large",
                         name, EXR_BLOCK_BYTES_MAX >> 20);
    switch (result) {
    case EXR_ERR_FEATURE_NOT_IMPLEMENTED:
        return error_set(err, STATUS_ERR_UNSUPPORTED, "%s: OpenEXR cannot read this kind of file (%s)", name, why);
    default: return error_set(err, STATUS_ERR_INPUT, "%s: the OpenEXR file is damaged or cut short (%s)", name, why);
    }
}
