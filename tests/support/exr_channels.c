#include "tests/support/exr_channels.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <openexr.h>

struct bytes {
    const uint8_t *data;
    size_t size;
};

static int64_t read_bytes(exr_const_context_t context, void *user, void *buffer, uint64_t size, uint64_t offset,
                          exr_stream_error_func_ptr_t fail)
{
    const struct bytes *bytes = user;

    (void)context;
    (void)fail;
    if (offset >= bytes->size)
        return 0;
    size = size < bytes->size - offset ? size : bytes->size - offset;
    memcpy(buffer, bytes->data + offset, size);
    return (int64_t)size;
}

static int64_t count_bytes(exr_const_context_t context, void *user)
{
    const struct bytes *bytes = user;

    (void)context;
    return (int64_t)bytes->size;
}

static exr_context_t open_file(struct bytes *bytes)
{
    exr_context_initializer_t init = EXR_DEFAULT_CONTEXT_INITIALIZER;
    exr_context_t file;

    init.user_data = bytes;
    init.read_fn = read_bytes;
    init.size_fn = count_bytes;
    assert_int_equal(exr_start_read(&file, "memory.exr", &init), EXR_ERR_SUCCESS);
    return file;
}

int exr_channel_count(const void *data, size_t size)
{
    struct bytes bytes = {data, size};
    exr_context_t file = open_file(&bytes);
    const exr_attr_chlist_t *list;
    int count;

    assert_int_equal(exr_get_channels(file, 0, &list), EXR_ERR_SUCCESS);
    count = list->num_channels;
    exr_finish(&file);
    return count;
}

/* Decode the chunk at line y of a file that begins at line 0. */
static void read_chunk(exr_context_t file, int32_t y, int channel, size_t width, float *out)
{
    exr_decode_pipeline_t pipeline = EXR_DECODE_PIPELINE_INITIALIZER;
    exr_chunk_info_t chunk;

    assert_int_equal(exr_read_scanline_chunk_info(file, 0, y, &chunk), EXR_ERR_SUCCESS);
    assert_int_equal(exr_decoding_initialize(file, 0, &chunk, &pipeline), EXR_ERR_SUCCESS);
    for (int c = 0; c < pipeline.channel_count; c++) {
        exr_coding_channel_info_t *info = &pipeline.channels[c];
        info->decode_to_ptr = c == channel ? (uint8_t *)(out + (size_t)y * width) : NULL;
        info->user_bytes_per_element = 4;
        info->user_data_type = EXR_PIXEL_FLOAT;
        info->user_pixel_stride = 4;
        info->user_line_stride = (int32_t)(4 * width);
    }
    assert_int_equal(exr_decoding_choose_default_routines(file, 0, &pipeline), EXR_ERR_SUCCESS);
    assert_int_equal(exr_decoding_run(file, 0, &pipeline), EXR_ERR_SUCCESS);
    exr_decoding_destroy(file, &pipeline);
}

float *exr_channel_read(const void *data, size_t size, const char *name, int *half)
{
    struct bytes bytes = {data, size};
    exr_context_t file = open_file(&bytes);
    const exr_attr_chlist_t *list;
    exr_attr_box2i_t window;
    int32_t lines, height;
    int channel = -1;
    size_t width;
    float *out = NULL;

    assert_int_equal(exr_get_channels(file, 0, &list), EXR_ERR_SUCCESS);
    assert_int_equal(exr_get_data_window(file, 0, &window), EXR_ERR_SUCCESS);
    assert_int_equal(exr_get_scanlines_per_chunk(file, 0, &lines), EXR_ERR_SUCCESS);
    for (int c = 0; c < list->num_channels; c++)
        if (strcmp(list->entries[c].name.str, name) == 0)
            channel = c;
    width = (size_t)(window.max.x + 1);
    height = window.max.y + 1;
    if (channel >= 0) {
        *half = list->entries[channel].pixel_type == EXR_PIXEL_HALF;
        out = calloc(width * (size_t)height, sizeof *out);
        assert_non_null(out);
        for (int32_t y = 0; y < height; y += lines)
            read_chunk(file, y, channel, width, out);
    }
    exr_finish(&file);
    return out;
}
