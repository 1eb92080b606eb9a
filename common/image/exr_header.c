
#include "common/image/exr_context.h"
#include "common/image/image.h"

status exr_read_text(struct buffer *out, const uint8_t *data, size_t size_bytes, const char *name,
                     const char *attribute, struct error *err)
{
    struct exr_stream stream = {.data = data, .size_bytes = size_bytes};
    exr_context_initializer_t init = exr_stream_initializer(&stream);
    exr_context_t context = NULL;
    const char *text = NULL;
    int32_t length = 0;
    exr_result_t result = exr_start_read(&context, name, &init);
    status s = STATUS_OK;

    if (result != EXR_ERR_SUCCESS)
        s = exr_stream_error(&stream, result, name, err);
    else if (exr_attr_get_string(context, 0, attribute, &length, &text) != EXR_ERR_SUCCESS)
        s = error_set(err, STATUS_ERR_NOT_FOUND, "%s: has no %s", name, attribute);
    else
        buffer_append(out, text, (size_t)length);
    exr_stream_finish(&context);
    if (s == STATUS_OK && !buffer_ok(out))
        s = error_no_memory(err, name);
    return s;
}

status exr_read_number(double *out, const uint8_t *data, size_t size_bytes, const char *name, const char *attribute,
                       struct error *err)
{
    struct exr_stream stream = {.data = data, .size_bytes = size_bytes};
    exr_context_initializer_t init = exr_stream_initializer(&stream);
    exr_context_t context = NULL;
    exr_result_t result = exr_start_read(&context, name, &init);
    status s = STATUS_OK;

    if (result != EXR_ERR_SUCCESS)
        s = exr_stream_error(&stream, result, name, err);
    else if (exr_attr_get_double(context, 0, attribute, out) != EXR_ERR_SUCCESS)
        s = error_set(err, STATUS_ERR_NOT_FOUND, "%s: has no %s", name, attribute);
    exr_stream_finish(&context);
    return s;
}
