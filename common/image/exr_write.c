/* Writing OpenEXR, through OpenEXRCore to memory. Its ZIP is made here, by a faster deflate. */
#include <math.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/system/parallel.h"
#include "common/base/safeguard.h"
#include "common/image/deflate.h"
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
    unsigned threads;
    int32_t top;            /* the number of the picture's first line */
    exr_chunk_info_t chunk; /* the first */
};

/* A chunk as it is written. */
struct exr_packed {
    struct buffer bytes;
    uint64_t clamped;
    exr_result_t result;
};

/* Makes chunks, one after the other; each thread has one. */
struct exr_packer {
    const struct exr_writer *writer;
    exr_encode_pipeline_t pipeline;
    int started;
    uint8_t *lines;    /* one chunk of samples, channel after channel, as they are stored */
    float *more_lines; /* one chunk of the additional channels */
    uint8_t *prepared; /* one chunk, for deflate */
    struct deflater *deflater;
    struct exr_packed *out;
};

/* Chunks that are made by all threads, then written in their order. */
enum { BATCH_CHUNKS = 64, PIECE_CHUNKS = 2, ALONE_MAX = 1 << 16 /* pixels: more are for all threads */ };
struct exr_batch {
    const struct exr_writer *writer;
    uint32_t first; /* chunk */
    struct exr_packed packed[BATCH_CHUNKS];
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
        } else if (a->matrix) {
            exr_attr_m44f_t matrix;
            memcpy(matrix.m, a->matrix, sizeof matrix.m);
            result = exr_attr_set_m44f(w->context, 0, a->name, &matrix);
        } else if (a->fraction) {
            const exr_attr_rational_t fraction = {a->fraction[0], (uint32_t)a->fraction[1]};
            result = exr_attr_set_rational(w->context, 0, a->name, &fraction);
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
    static const char *const plain[] = {"R", "G", "B", "A"};
    const char *const *names = options->names ? options->names : plain;

    for (uint32_t c = 0; c < w->image->channels; c++)
        add_plane(w, (struct exr_plane){names[c], options->half, 0, c});
    for (uint32_t c = 0; w->more && c < w->more->count; c++)
        add_plane(w,
                  (struct exr_plane){w->more->channels[c].name, options->half && !w->more->channels[c].precise, 1, c});
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
                                                     (int32_t)w->image->height, EXR_COMPRESSION_ZIP);
    for (int i = 0; result == EXR_ERR_SUCCESS && i < w->plane_count; i++)
        result = exr_add_channel(w->context, part, w->planes[i].name,
                                 w->planes[i].half ? EXR_PIXEL_HALF : EXR_PIXEL_FLOAT, treatment(&w->planes[i]), 1, 1);
    if (result == EXR_ERR_SUCCESS)
        result = declare_attributes(w, options);
    if (result == EXR_ERR_SUCCESS)
        result = exr_write_header(w->context);
    return result;
}

/* Gather one channel's samples of `height` lines from line `y` on. */
static void gather_plane(struct exr_packer *p, const struct exr_plane *plane, int32_t y, int32_t height, uint8_t *to)
{
    const struct image *image = p->writer->image;
    size_t count = (size_t)image->width * (size_t)height;
    size_t step = plane->more ? 1 : image->channels;
    const float *from = plane->more ? p->more_lines + plane->channel * count
                                    : image->pixels + (size_t)y * image->width * step + plane->channel;

    for (size_t i = 0; i < count; i++) {
        float value = from[i * step];
        if (plane->half)
            ((uint16_t *)(void *)to)[i] = to_finite_half(value, &p->out->clamped);
        else
            ((float *)(void *)to)[i] = value;
    }
}

/* The library's ZIP (ImfZip.cpp): the even bytes, then the odd ones; each as its difference to the one before. */
static void prepare_zip(const uint8_t *from, size_t count, uint8_t *out)
{
    const size_t half = (count + 1) / 2;
    uint8_t before = 0;

    for (size_t i = 0; i < count / 2; i++) {
        out[i] = from[2 * i];
        out[half + i] = from[2 * i + 1];
    }
    if (count & 1)
        out[half - 1] = from[count - 1];
    before = count ? out[0] : 0;
    for (size_t i = 1; i < count; i++) {
        uint8_t byte = out[i];
        out[i] = (uint8_t)(byte - before + 128);
        before = byte;
    }
}

/* In place of the library's step that compresses. Readers take a chunk whose length is that of its pixels as not
 * compressed, so only what becomes shorter is stored compressed. */
static exr_result_t zip_chunk(exr_encode_pipeline_t *pipeline)
{
    struct exr_packer *p = pipeline->encoding_user_data;
    struct buffer *out = &p->out->bytes;

    prepare_zip(pipeline->packed_buffer, pipeline->packed_bytes, p->prepared);
    deflater_append(p->deflater, p->prepared, pipeline->packed_bytes, out);
    if (buffer_ok(out) && out->size >= pipeline->packed_bytes) {
        buffer_clear(out);
        buffer_append(out, pipeline->packed_buffer, pipeline->packed_bytes);
    }
    return buffer_ok(out) ? EXR_ERR_SUCCESS : EXR_ERR_OUT_OF_MEMORY;
}

/* In place of the library's step that writes: chunks are written in their order, later. */
static exr_result_t keep_chunk(exr_encode_pipeline_t *pipeline UNUSED) { return EXR_ERR_SUCCESS; }

static exr_result_t packer_begin(struct exr_packer *p, const exr_chunk_info_t *chunk)
{
    const struct exr_writer *w = p->writer;
    exr_result_t result = EXR_ERR_SUCCESS;

    if (p->started)
        return exr_encoding_update(w->context, 0, chunk, &p->pipeline);
    p->lines = mem_alloc_array((size_t)w->image->width * EXR_LINES, (size_t)w->plane_count * sizeof(float));
    p->prepared = mem_alloc_array((size_t)w->image->width * EXR_LINES, (size_t)w->plane_count * sizeof(float));
    if (w->more)
        p->more_lines = mem_alloc_array((size_t)w->image->width * EXR_LINES, w->more->count * sizeof(float));
    p->deflater = deflater_new(DEFLATE_FLOATS);
    if (!p->lines || !p->prepared || !p->deflater || (w->more && !p->more_lines))
        return EXR_ERR_OUT_OF_MEMORY;
    result = exr_encoding_initialize(w->context, 0, chunk, &p->pipeline);
    p->started = result == EXR_ERR_SUCCESS;
    return result;
}

static void packer_end(struct exr_packer *p)
{
    if (p->started)
        exr_encoding_destroy(p->writer->context, &p->pipeline);
    deflater_free(p->deflater);
    mem_free(p->prepared);
    mem_free(p->more_lines);
    mem_free(p->lines);
}

/* The chunk from line y on. The library names only the next to be written. */
static exr_chunk_info_t chunk_at(const struct exr_writer *w, int32_t y)
{
    exr_chunk_info_t chunk = w->chunk;
    int32_t left = (int32_t)w->image->height - y;

    chunk.idx += y / EXR_LINES;
    chunk.start_y += y;
    chunk.unpacked_size /= (uint64_t)chunk.height;
    chunk.height = left < EXR_LINES ? left : EXR_LINES;
    chunk.unpacked_size *= (uint64_t)chunk.height;
    return chunk;
}

static exr_result_t pack_chunk(struct exr_packer *p, int32_t y)
{
    const struct exr_writer *w = p->writer;
    exr_encode_pipeline_t *pipeline = &p->pipeline;
    int is_first = !p->started;
    const exr_chunk_info_t chunk = chunk_at(w, y);
    exr_result_t result = packer_begin(p, &chunk);
    uint8_t *to;

    if (result != EXR_ERR_SUCCESS)
        return result;
    to = p->lines;
    if (w->more)
        w->more->lines(w->more->user, (uint32_t)y, (uint32_t)chunk.height, p->more_lines);
    for (int i = 0; i < w->plane_count; i++) {
        exr_coding_channel_info_t *info = &pipeline->channels[i];
        size_t sample_bytes = w->planes[i].half ? sizeof(uint16_t) : sizeof(float);
        size_t line_bytes = w->image->width * sample_bytes;

        gather_plane(p, &w->planes[i], y, chunk.height, to);
        info->user_bytes_per_element = (int16_t)sample_bytes;
        info->user_data_type = info->data_type;
        info->user_pixel_stride = (int32_t)sample_bytes;
        info->user_line_stride = (int32_t)line_bytes;
        info->encode_from_ptr = to;
        to += w->image->width * sizeof(float) * (size_t)chunk.height; /* aligned for both kinds */
    }
    if (is_first) {
        result = exr_encoding_choose_default_routines(w->context, 0, pipeline);
        if (result != EXR_ERR_SUCCESS)
            return result;
        pipeline->encoding_user_data = p;
        pipeline->compress_fn = zip_chunk;
        pipeline->write_fn = keep_chunk;
        pipeline->yield_until_ready_fn = NULL; /* it is not this chunk's turn, nor need it be */
    }
    return exr_encoding_run(w->context, 0, pipeline);
}

/* Pack the batch's chunks begin..end-1. */
static void pack_chunks(void *user, size_t begin, size_t end)
{
    struct exr_batch *batch = user;
    struct exr_packer p = {.writer = batch->writer, .pipeline = EXR_ENCODE_PIPELINE_INITIALIZER};
    exr_result_t result = EXR_ERR_SUCCESS;

    for (size_t i = begin; i < end; i++) {
        p.out = &batch->packed[i];
        buffer_clear(&p.out->bytes);
        if (result == EXR_ERR_SUCCESS)
            result = pack_chunk(&p, (int32_t)((batch->first + i) * EXR_LINES));
        p.out->result = result;
    }
    packer_end(&p);
}

static exr_result_t write_batch(const struct exr_writer *w, struct exr_batch *batch, uint32_t count)
{
    exr_result_t result = EXR_ERR_SUCCESS;

    parallel_for(w->threads, count, PIECE_CHUNKS, pack_chunks, batch);
    for (uint32_t i = 0; i < count && result == EXR_ERR_SUCCESS; i++) {
        const struct exr_packed *packed = &batch->packed[i];
        int32_t y = (int32_t)((batch->first + i) * EXR_LINES) + w->top;

        result = packed->result;
        if (result == EXR_ERR_SUCCESS)
            result = exr_write_scanline_chunk(w->context, 0, y, packed->bytes.data, packed->bytes.size);
    }
    return result;
}

static exr_result_t write_pixels(struct exr_writer *w, uint64_t *clamped)
{
    uint32_t chunks = (w->image->height + EXR_LINES - 1) / EXR_LINES;
    struct exr_batch batch = {.writer = w};
    int32_t lines = 0;
    exr_result_t result = exr_get_scanlines_per_chunk(w->context, 0, &lines);

    if (result == EXR_ERR_SUCCESS && lines != EXR_LINES)
        result = EXR_ERR_INVALID_ATTR; /* a ZIP file always has these */
    if (result == EXR_ERR_SUCCESS)
        result = exr_write_scanline_chunk_info(w->context, 0, w->top, &w->chunk);
    for (; batch.first < chunks && result == EXR_ERR_SUCCESS; batch.first += BATCH_CHUNKS)
        result = write_batch(w, &batch, chunks - batch.first < BATCH_CHUNKS ? chunks - batch.first : BATCH_CHUNKS);
    for (int i = 0; i < BATCH_CHUNKS; i++) {
        *clamped += batch.packed[i].clamped;
        buffer_release(&batch.packed[i].bytes);
    }
    return result;
}

status exr_encode(struct buffer *out, const struct image *image, const struct exr_options *options, struct error *err)
{
    static const struct exr_options plain;
    struct buffer file = BUFFER_INIT;
    struct exr_writer w = {.stream = {.out = out->size == 0 ? out : &file}, .image = image}; /* without a copy, mostly */
    exr_context_initializer_t init = exr_stream_initializer(&w.stream);
    exr_result_t result, finished;
    uint64_t clamped = 0;

    if (!options)
        options = &plain;
    w.threads = options->threads > 0                             ? options->threads
                : (size_t)image->width * image->height <= ALONE_MAX ? 1
                                                                    : 0;
    w.more = options->more && options->more->count ? options->more : NULL;
    if (options->window)
        w.top = (int32_t)options->window->y;
    if (image->channels < 3)
        return error_set(err, STATUS_ERR_INTERNAL, "an EXR is made of 3 or 4 channels, not of %u",
                         (unsigned)image->channels);
    if (w.more && w.more->count > EXR_CHANNELS_MAX)
        return error_set(err, STATUS_ERR_INTERNAL, "an EXR of %zu more channels: at most %d", w.more->count,
                         EXR_CHANNELS_MAX);
    list_planes(&w, options);
    /* The name is only for the library's messages; the bytes go to stream_write. */
    result = exr_start_write(&w.context, "picture.exr", EXR_WRITE_FILE_DIRECTLY, &init);
    if (result == EXR_ERR_SUCCESS)
        result = write_header(&w, options);
    if (result == EXR_ERR_SUCCESS)
        result = write_pixels(&w, &clamped);
    finished = exr_stream_finish(&w.context);
    if (result == EXR_ERR_SUCCESS)
        result = finished;
    if (result == EXR_ERR_SUCCESS && buffer_ok(&file) && w.stream.out == &file)
        buffer_append(out, file.data, file.size);
    else if (result != EXR_ERR_SUCCESS && w.stream.out == out)
        buffer_clear(out);
    if (result == EXR_ERR_SUCCESS && options->clamped)
        *options->clamped = clamped;
    if (result == EXR_ERR_OUT_OF_MEMORY || !buffer_ok(&file) || !buffer_ok(out)) {
        buffer_release(&file);
        return error_no_memory(err, "an EXR");
    }
    buffer_release(&file);
    if (result != EXR_ERR_SUCCESS)
        return error_set(err, STATUS_ERR_INTERNAL, "the EXR cannot be written: %s",
                         w.stream.message[0] ? w.stream.message : exr_get_error_code_as_string(result));
    return STATUS_OK;
}
