/* Writing OpenEXR, through OpenEXRCore to memory. */
#include <math.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/image/exr_context.h"
#include "common/image/half.h"
#include "common/image/image.h"

/* In the order of the file, which is alphabetical. */
static const struct {
    const char *name;
    uint32_t channel; /* of struct image */
} exr_channels[] = {{"A", 3}, {"B", 2}, {"G", 1}, {"R", 0}};

struct exr_writer {
    exr_context_t context;
    struct exr_stream stream;
    const struct image *image;
    int half;
    uint64_t clamped;
    void *lines; /* one chunk of samples, channel after channel, as they are stored */
};

/* A finite half: what is beyond its range becomes its largest value, and is counted. */
static uint16_t to_finite_half(float value, uint64_t *clamped)
{
    if (value > HALF_MAX || value < -HALF_MAX) {
        (*clamped)++;
        value = copysignf(HALF_MAX, value);
    }
    return half_from_float(value);
}

static exr_result_t declare_attributes(struct exr_writer *w, const struct exr_options *options)
{
    static const exr_attr_chromaticities_t rec709 = {0.64f, 0.33f, 0.30f,   0.60f,
                                                     0.15f, 0.06f, 0.3127f, 0.3290f};
    exr_result_t result = exr_attr_set_chromaticities(w->context, 0, "chromaticities", &rec709);

    for (size_t i = 0; result == EXR_ERR_SUCCESS && i < options->attribute_count; i++) {
        const struct exr_attribute *a = &options->attributes[i];

        if (a->text)
            result = exr_attr_set_string(w->context, 0, a->name, a->text);
        else
            result = exr_attr_set_double(w->context, 0, a->name, a->number);
    }
    return result;
}

static exr_result_t write_header(struct exr_writer *w, const struct exr_options *options)
{
    int part = 0;
    exr_result_t result = exr_add_part(w->context, NULL, EXR_STORAGE_SCANLINE, &part);

    if (result == EXR_ERR_SUCCESS)
        result = exr_initialize_required_attr_simple(w->context, part, (int32_t)w->image->width,
                                                     (int32_t)w->image->height,
                                                     EXR_COMPRESSION_ZIP);
    for (size_t i = 0; i < sizeof exr_channels / sizeof *exr_channels; i++)
        if (result == EXR_ERR_SUCCESS && exr_channels[i].channel < w->image->channels)
            result = exr_add_channel(w->context, part, exr_channels[i].name,
                                     w->half ? EXR_PIXEL_HALF : EXR_PIXEL_FLOAT,
                                     EXR_PERCEPTUALLY_LOGARITHMIC, 1, 1);
    if (result == EXR_ERR_SUCCESS)
        result = declare_attributes(w, options);
    if (result == EXR_ERR_SUCCESS)
        result = exr_write_header(w->context);
    return result;
}

/* Gather one channel's samples of `height` lines from line `y` on into plane `plane`. */
static void gather_plane(struct exr_writer *w, uint32_t channel, int plane, int32_t y,
                         int32_t height)
{
    const struct image *image = w->image;
    size_t count = (size_t)image->width * (size_t)height;
    const float *from = image->pixels + (size_t)y * image->width * image->channels + channel;

    for (size_t i = 0; i < count; i++) {
        float value = from[i * image->channels];
        size_t at = (size_t)plane * count + i;

        if (w->half)
            ((uint16_t *)w->lines)[at] = to_finite_half(value, &w->clamped);
        else
            ((float *)w->lines)[at] = value;
    }
}

static exr_result_t write_chunk(struct exr_writer *w, exr_encode_pipeline_t *pipeline, int32_t y,
                                int *started)
{
    exr_chunk_info_t chunk;
    size_t sample_bytes = w->half ? 2 : 4, line_bytes = w->image->width * sample_bytes;
    exr_result_t result = exr_write_scanline_chunk_info(w->context, 0, y, &chunk);
    int plane = 0;

    if (result != EXR_ERR_SUCCESS)
        return result;
    result = *started ? exr_encoding_update(w->context, 0, &chunk, pipeline)
                      : exr_encoding_initialize(w->context, 0, &chunk, pipeline);
    if (result != EXR_ERR_SUCCESS)
        return result;
    for (size_t i = 0; i < sizeof exr_channels / sizeof *exr_channels; i++) {
        exr_coding_channel_info_t *info = &pipeline->channels[plane];

        if (exr_channels[i].channel >= w->image->channels)
            continue;
        gather_plane(w, exr_channels[i].channel, plane, y, chunk.height);
        info->user_bytes_per_element = (int16_t)sample_bytes;
        info->user_data_type = info->data_type;
        info->user_pixel_stride = (int32_t)sample_bytes;
        info->user_line_stride = (int32_t)line_bytes;
        info->encode_from_ptr = (const uint8_t *)w->lines +
                                (size_t)plane * line_bytes * (size_t)chunk.height;
        plane++;
    }
    if (!*started) {
        *started = 1;
        result = exr_encoding_choose_default_routines(w->context, 0, pipeline);
        if (result != EXR_ERR_SUCCESS)
            return result;
    }
    return exr_encoding_run(w->context, 0, pipeline);
}

static exr_result_t write_pixels(struct exr_writer *w)
{
    exr_encode_pipeline_t pipeline = EXR_ENCODE_PIPELINE_INITIALIZER;
    int32_t lines = 0;
    int started = 0;
    exr_result_t result = exr_get_scanlines_per_chunk(w->context, 0, &lines);

    if (result != EXR_ERR_SUCCESS)
        return result;
    w->lines = mem_alloc_array((size_t)w->image->width * (size_t)lines,
                               w->image->channels * (w->half ? sizeof(uint16_t) : sizeof(float)));
    if (!w->lines)
        return EXR_ERR_OUT_OF_MEMORY;
    for (uint32_t y = 0; result == EXR_ERR_SUCCESS && y < w->image->height; y += (uint32_t)lines)
        result = write_chunk(w, &pipeline, (int32_t)y, &started);
    if (started)
        exr_encoding_destroy(w->context, &pipeline);
    return result;
}

status exr_encode(struct buffer *out, const struct image *image, const struct exr_options *options,
                  struct error *err)
{
    static const struct exr_options plain;
    struct buffer file = BUFFER_INIT;
    struct exr_writer w = {.stream = {.out = &file}, .image = image};
    exr_context_initializer_t init = exr_stream_initializer(&w.stream);
    exr_result_t result, finished;

    if (!options)
        options = &plain;
    w.half = options->half;
    if (options->clamped)
        *options->clamped = 0;
    if (image->channels < 3)
        return error_set(err, STATUS_ERR_INTERNAL, "an EXR is made of 3 or 4 channels, not of %u",
                         (unsigned)image->channels);
    /* The name is only for the library's messages; the bytes go to stream_write. */
    result = exr_start_write(&w.context, "picture.exr", EXR_WRITE_FILE_DIRECTLY, &init);
    if (result == EXR_ERR_SUCCESS)
        result = write_header(&w, options);
    if (result == EXR_ERR_SUCCESS)
        result = write_pixels(&w);
    finished = exr_stream_finish(&w.context);
    if (result == EXR_ERR_SUCCESS)
        result = finished;
    mem_free(w.lines);
    if (result == EXR_ERR_SUCCESS && buffer_ok(&file))
        buffer_append(out, file.data, file.size);
    if (result == EXR_ERR_SUCCESS && options->clamped)
        *options->clamped = w.clamped;
    if (result == EXR_ERR_OUT_OF_MEMORY || !buffer_ok(&file) || !buffer_ok(out)) {
        buffer_release(&file);
        return error_no_memory(err, "an EXR");
    }
    buffer_release(&file);
    if (result != EXR_ERR_SUCCESS)
        return error_set(err, STATUS_ERR_INTERNAL, "the EXR cannot be written: %s",
                         w.stream.message[0] ? w.stream.message
                                             : exr_get_error_code_as_string(result));
    return STATUS_OK;
}
