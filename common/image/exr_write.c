/* Writing OpenEXR, through OpenEXRCore to memory. */
#include <math.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/base/safeguard.h"
#include "common/image/exr_context.h"
#include "common/image/half.h"
#include "common/image/image.h"

/* One channel of the file. The file's order is alphabetical. */
struct exr_plane {
    const char *name;
    int half;
    int more;         /* of the additional ones ... */
    uint32_t channel; /* ... or else of the picture: which */
};

enum { PLANES_MAX = EXR_CHANNELS_MAX + 4 };

struct exr_writer {
    exr_context_t context;
    struct exr_stream stream;
    const struct image *image;
    const struct exr_channels *more;
    struct exr_plane planes[PLANES_MAX];
    int plane_count;
    uint64_t clamped;
    int32_t top;       /* the number of the picture's first line */
    uint8_t *lines;    /* one chunk of samples, channel after channel, as they are stored */
    float *more_lines; /* one chunk of the additional channels */
    exr_result_t (*compress)(exr_encode_pipeline_t *pipeline);
};

/* A finite half: a value beyond its range becomes its largest value, and is counted. */
static uint16_t to_finite_half(float value, uint64_t *clamped)
{
    if ((value > HALF_MAX || value < -HALF_MAX) && SAFEGUARD(HALF_RANGE)) {
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

        if (a->text) {
            result = exr_attr_set_string(w->context, 0, a->name, a->text);
        } else if (a->point) {
            const exr_attr_v3d_t point = {{{a->point[0], a->point[1], a->point[2]}}};
            result = exr_attr_set_v3d(w->context, 0, a->name, &point);
        } else {
            result = exr_attr_set_double(w->context, 0, a->name, a->number);
        }
    }
    return result;
}

static void add_plane(struct exr_writer *w, struct exr_plane plane)
{
    int at = w->plane_count++;

    for (; at > 0 && strcmp(w->planes[at - 1].name, plane.name) > 0; at--)
        w->planes[at] = w->planes[at - 1];
    w->planes[at] = plane;
}

static void list_planes(struct exr_writer *w, const struct exr_options *options)
{
    static const char *const names[] = {"R", "G", "B", "A"};

    for (uint32_t c = 0; c < w->image->channels; c++)
        add_plane(w, (struct exr_plane){names[c], options->half, 0, c});
    for (uint32_t c = 0; w->more && c < w->more->count; c++)
        add_plane(w, (struct exr_plane){w->more->channels[c].name,
                                        options->half && !w->more->channels[c].precise, 1, c});
}

/* Are the values of a channel colours, which the eye sees logarithmically? This says how lossy
 * compression may treat them if the file is ever saved that way. */
static exr_perceptual_treatment_t treatment(const struct exr_plane *plane)
{
    char last = plane->name[strlen(plane->name) - 1];

    return last == 'R' || last == 'G' || last == 'B' || last == 'A' ? EXR_PERCEPTUALLY_LOGARITHMIC
                                                                    : EXR_PERCEPTUALLY_LINEAR;
}

static exr_result_t declare_windows(struct exr_writer *w, const struct exr_window *window, int part)
{
    exr_attr_box2i_t data, display;
    exr_attr_v2f_t center;

    memset(&center, 0, sizeof center);
    memset(&display, 0, sizeof display);
    display.max.x = (int32_t)window->width - 1;
    display.max.y = (int32_t)window->height - 1;
    data.min.x = (int32_t)window->x;
    data.min.y = (int32_t)window->y;
    data.max.x = (int32_t)(window->x + w->image->width) - 1;
    data.max.y = (int32_t)(window->y + w->image->height) - 1;
    return exr_initialize_required_attr(w->context, part, &display, &data, 1.0f, &center, 1.0f,
                                        EXR_LINEORDER_INCREASING_Y, EXR_COMPRESSION_ZIP);
}

static exr_result_t write_header(struct exr_writer *w, const struct exr_options *options)
{
    int part = 0;
    exr_result_t result = exr_add_part(w->context, NULL, EXR_STORAGE_SCANLINE, &part);

    if (result == EXR_ERR_SUCCESS && options->window)
        result = declare_windows(w, options->window, part);
    else if (result == EXR_ERR_SUCCESS)
        result = exr_initialize_required_attr_simple(w->context, part, (int32_t)w->image->width,
                                                     (int32_t)w->image->height,
                                                     EXR_COMPRESSION_ZIP);
    for (int i = 0; result == EXR_ERR_SUCCESS && i < w->plane_count; i++)
        result = exr_add_channel(w->context, part, w->planes[i].name,
                                 w->planes[i].half ? EXR_PIXEL_HALF : EXR_PIXEL_FLOAT,
                                 treatment(&w->planes[i]), 1, 1);
    if (result == EXR_ERR_SUCCESS)
        result = declare_attributes(w, options);
    if (result == EXR_ERR_SUCCESS)
        result = exr_write_header(w->context);
    return result;
}

/* Gather one channel's samples of `height` lines from line `y` on. */
static void gather_plane(struct exr_writer *w, const struct exr_plane *plane, int32_t y,
                         int32_t height, uint8_t *to)
{
    size_t count = (size_t)w->image->width * (size_t)height;
    size_t step = plane->more ? 1 : w->image->channels;
    const float *from = plane->more
                            ? w->more_lines + plane->channel * count
                            : w->image->pixels + (size_t)y * w->image->width * step + plane->channel;

    for (size_t i = 0; i < count; i++) {
        float value = from[i * step];
        if (plane->half)
            ((uint16_t *)(void *)to)[i] = to_finite_half(value, &w->clamped);
        else
            ((float *)(void *)to)[i] = value;
    }
}

/* Readers take a chunk whose length is that of its pixels as not compressed. OpenEXRCore 3.1
 * nevertheless stores data that compresses to exactly that length compressed, and no reader can
 * tell. */
static exr_result_t compress_or_store(exr_encode_pipeline_t *pipeline)
{
    const struct exr_writer *w = pipeline->encoding_user_data;
    exr_result_t result = w->compress(pipeline);

    if (result == EXR_ERR_SUCCESS && pipeline->compressed_bytes >= pipeline->packed_bytes &&
        pipeline->compressed_buffer != pipeline->packed_buffer) {
        if (pipeline->compressed_alloc_size < pipeline->packed_bytes)
            return EXR_ERR_OUT_OF_MEMORY;
        memcpy(pipeline->compressed_buffer, pipeline->packed_buffer, pipeline->packed_bytes);
        pipeline->compressed_bytes = pipeline->packed_bytes;
    }
    return result;
}

static exr_result_t write_chunk(struct exr_writer *w, exr_encode_pipeline_t *pipeline, int32_t y,
                                int *started)
{
    exr_chunk_info_t chunk;
    exr_result_t result = exr_write_scanline_chunk_info(w->context, 0, y + w->top, &chunk);
    uint8_t *to = w->lines;

    if (result != EXR_ERR_SUCCESS)
        return result;
    result = *started ? exr_encoding_update(w->context, 0, &chunk, pipeline)
                      : exr_encoding_initialize(w->context, 0, &chunk, pipeline);
    if (result != EXR_ERR_SUCCESS)
        return result;
    if (w->more)
        w->more->lines(w->more->user, (uint32_t)y, (uint32_t)chunk.height, w->more_lines);
    for (int i = 0; i < w->plane_count; i++) {
        exr_coding_channel_info_t *info = &pipeline->channels[i];
        size_t sample_bytes = w->planes[i].half ? sizeof(uint16_t) : sizeof(float);
        size_t line_bytes = w->image->width * sample_bytes;

        gather_plane(w, &w->planes[i], y, chunk.height, to);
        info->user_bytes_per_element = (int16_t)sample_bytes;
        info->user_data_type = info->data_type;
        info->user_pixel_stride = (int32_t)sample_bytes;
        info->user_line_stride = (int32_t)line_bytes;
        info->encode_from_ptr = to;
        to += w->image->width * sizeof(float) * (size_t)chunk.height; /* aligned for both kinds */
    }
    if (!*started) {
        *started = 1;
        result = exr_encoding_choose_default_routines(w->context, 0, pipeline);
        if (result != EXR_ERR_SUCCESS)
            return result;
        if (pipeline->compress_fn) {
            w->compress = pipeline->compress_fn;
            pipeline->encoding_user_data = w;
            pipeline->compress_fn = compress_or_store;
        }
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
    if (lines != EXR_LINES)
        return EXR_ERR_INVALID_ATTR; /* a ZIP file always has these */
    w->lines = mem_alloc_array((size_t)w->image->width * EXR_LINES,
                               (size_t)w->plane_count * sizeof(float));
    if (w->more)
        w->more_lines = mem_alloc_array((size_t)w->image->width * EXR_LINES,
                                        w->more->count * sizeof(float));
    if (!w->lines || (w->more && !w->more_lines))
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
    w.more = options->more && options->more->count ? options->more : NULL;
    if (options->window)
        w.top = (int32_t)options->window->y;
    if (options->clamped)
        *options->clamped = 0;
    if (image->channels < 3)
        return error_set(err, STATUS_ERR_INTERNAL, "an EXR is made of 3 or 4 channels, not of %u",
                         (unsigned)image->channels);
    if (w.more && w.more->count > EXR_CHANNELS_MAX)
        return error_set(err, STATUS_ERR_INTERNAL, "an EXR of %zu more channels: at most %d",
                         w.more->count, EXR_CHANNELS_MAX);
    list_planes(&w, options);
    /* The name is only for the library's messages; the bytes go to stream_write. */
    result = exr_start_write(&w.context, "picture.exr", EXR_WRITE_FILE_DIRECTLY, &init);
    if (result == EXR_ERR_SUCCESS)
        result = write_header(&w, options);
    if (result == EXR_ERR_SUCCESS)
        result = write_pixels(&w);
    finished = exr_stream_finish(&w.context);
    if (result == EXR_ERR_SUCCESS)
        result = finished;
    mem_free(w.more_lines);
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
