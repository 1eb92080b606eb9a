/* PNG through libpng, from and to memory. libpng's messages go to struct error, its memory comes
 * from common/base/memory. Gamma and colour profiles are ignored, as glTF requires. */
#include <png.h>
#include <setjmp.h>
#include <stdio.h>
#include <string.h>

#include "common/base/buffer.h"
#include "common/base/memory.h"
#include "common/image/image.h"
#include "common/image/quantize.h"

enum {
    PNG_TEXT_CHUNKS_MAX = 64,
    PNG_CHUNK_BYTES_MAX = 8 << 20, /* of ancillary chunks: profiles, texts */
    PNG_DEFLATE_LEVEL = 6,
    PNG_DEFLATE_LEVEL_FAST = 1,
};
#define PNG_BLOCK_BYTES_MAX ((size_t)1 << 30)
#define DEFLATE_EXPANSION_MAX 1100.0 /* a byte of deflate becomes at most 1032 */

struct png_stream {
    const uint8_t *data; /* reading */
    size_t size_bytes, at;
    struct buffer *out;  /* writing */
    char message[128];
    int no_memory;
};

static void png_fail(png_structp png, png_const_charp text)
{
    struct png_stream *stream = png_get_error_ptr(png);

    snprintf(stream->message, sizeof stream->message, "%s", text);
    png_longjmp(png, 1);
}

static void png_ignore_warning(png_structp png, png_const_charp text)
{
    (void)png;
    (void)text;
}

static png_voidp png_take_memory(png_structp png, png_alloc_size_t size_bytes)
{
    struct png_stream *stream = png_get_mem_ptr(png);
    void *block;

    if (size_bytes > PNG_BLOCK_BYTES_MAX)
        return NULL;
    block = mem_alloc(size_bytes);
    if (!block && stream)
        stream->no_memory = 1;
    return block;
}

static void png_give_memory(png_structp png, png_voidp block)
{
    (void)png;
    mem_free(block);
}

static void png_read_bytes(png_structp png, png_bytep out, size_t size_bytes)
{
    struct png_stream *stream = png_get_io_ptr(png);

    if (size_bytes > stream->size_bytes - stream->at)
        png_error(png, "the file ends too early");
    memcpy(out, stream->data + stream->at, size_bytes);
    stream->at += size_bytes;
}

static void png_write_bytes(png_structp png, png_bytep data, size_t size_bytes)
{
    struct png_stream *stream = png_get_io_ptr(png);

    buffer_append(stream->out, data, size_bytes);
    if (!buffer_ok(stream->out))
        png_error(png, "out of memory");
}

static void png_flush_nothing(png_structp png)
{
    (void)png;
}

/* ---- reading ----------------------------------------------------------------------------- */

static int host_is_little_endian(void)
{
    const uint16_t one = 1;
    uint8_t first;

    memcpy(&first, &one, 1);
    return first;
}

/* Ask for 8 or 16 bits a channel; palettes, low depths and tRNS expanded. */
static void set_transformations(png_structp png, png_infop info)
{
    png_set_expand(png);
    if (png_get_bit_depth(png, info) == 16 && host_is_little_endian())
        png_set_swap(png);
    png_set_interlace_handling(png);
    png_read_update_info(png, info);
}

/* Everything that may longjmp; no variable here outlives the jump. `rows` is freed by the
 * caller. */
static status read_png(png_structp png, png_infop info, struct png_stream *stream,
                       struct image8 *out, png_bytep **rows, const char *name, struct error *err)
{
    uint32_t width, height;
    size_t row_bytes;
    status st;

    if (setjmp(png_jmpbuf(png)))
        return stream->no_memory
                   ? error_no_memory(err, "a PNG")
                   : error_set(err, STATUS_ERR_INPUT, "%s: the PNG is damaged or cut short (%s)", name,
                         stream->message);
    png_set_user_limits(png, IMAGE_SIDE_MAX, IMAGE_SIDE_MAX);
    png_set_chunk_cache_max(png, PNG_TEXT_CHUNKS_MAX);
    png_set_chunk_malloc_max(png, PNG_CHUNK_BYTES_MAX);
    /* Skip texts, profiles and the like unread. */
    png_set_keep_unknown_chunks(png, PNG_HANDLE_CHUNK_NEVER, NULL, 0);
    png_set_read_fn(png, stream, png_read_bytes);
    png_read_info(png, info);
    width = png_get_image_width(png, info);
    height = png_get_image_height(png, info);
    if ((double)png_get_rowbytes(png, info) * height / DEFLATE_EXPANSION_MAX >
        (double)stream->size_bytes)
        return error_set(err, STATUS_ERR_INPUT,
                         "%s: %zu bytes cannot hold the %u x %u pixels that the header claims; "
                         "the file is damaged or cut short",
                         name, stream->size_bytes, (unsigned)width, (unsigned)height);
    set_transformations(png, info);
    row_bytes = png_get_rowbytes(png, info);
    st = image8_init(out, width, height, png_get_channels(png, info),
                     png_get_bit_depth(png, info), err);
    if (st != STATUS_OK) {
        error_prefix(err, "%s", name);
        return st;
    }
    if (row_bytes != (size_t)width * out->channels * (out->bits / 8))
        return error_set(err, STATUS_ERR_INTERNAL, "%s: libpng's rows have another size", name);
    *rows = mem_alloc_array(height, sizeof **rows);
    if (!*rows)
        return error_no_memory(err, "a texture's rows");
    for (uint32_t y = 0; y < height; y++)
        (*rows)[y] = out->pixels + y * row_bytes;
    png_read_image(png, *rows);
    png_read_end(png, NULL);
    return STATUS_OK;
}

status png_decode(struct image8 *out, const uint8_t *data, size_t size_bytes, const char *name,
                  struct error *err)
{
    struct png_stream stream = {.data = data, .size_bytes = size_bytes};
    png_structp png;
    png_infop info;
    png_bytep *rows = NULL;
    status st;

    memset(out, 0, sizeof *out);
    png = png_create_read_struct_2(PNG_LIBPNG_VER_STRING, &stream, png_fail, png_ignore_warning,
                                   &stream, png_take_memory, png_give_memory);
    info = png ? png_create_info_struct(png) : NULL;
    if (info)
        st = read_png(png, info, &stream, out, &rows, name, err);
    else
        st = error_no_memory(err, "libpng");
    mem_free(rows);
    if (png)
        png_destroy_read_struct(&png, &info, NULL);
    if (st != STATUS_OK)
        image8_release(out);
    return st;
}

/* ---- writing ----------------------------------------------------------------------------- */

/* The source of a file: a row is filled when its turn comes, most significant byte first. */
struct png_rows {
    uint32_t width, height, channels;
    int bits, is_srgb; /* is_srgb: an sRGB chunk says so */
    const void *source;
    int plain, fast;
    const struct picture_text *texts;
    size_t text_count;
    void (*fill)(const struct png_rows *rows, uint32_t y, uint8_t *row);
};

static void fill_picture(const struct png_rows *rows, uint32_t y, uint8_t *row)
{
    if (rows->bits == 16)
        quantize_row16(rows->source, y, rows->plain, row);
    else
        quantize_row8(rows->source, y, rows->plain, row);
}

/* Four channels: the colours as always, then alpha rounded. */
static void fill_picture_alpha(const struct png_rows *rows, uint32_t y, uint8_t *row)
{
    const struct image *image = rows->source;
    size_t bytes = (size_t)rows->bits / 8;

    fill_picture(rows, y, row);
    for (uint32_t x = rows->width; x-- > 0;) {
        float v = image->pixels[((size_t)y * image->width + x) * 4 + 3];
        uint32_t code = (uint32_t)((v > 0 ? v < 1 ? v : 1 : 0) * (bytes == 2 ? 65535.0f : 255.0f) + 0.5f);
        uint8_t *to = row + x * 4 * bytes;

        memmove(to, row + x * 3 * bytes, 3 * bytes);
        if (bytes == 2)
            to[6] = (uint8_t)(code >> 8);
        to[4 * bytes - 1] = (uint8_t)code;
    }
}

static void fill_texture(const struct png_rows *rows, uint32_t y, uint8_t *row)
{
    const struct image *image = rows->source;
    size_t count = (size_t)image->width * image->channels;
    const float *from = image->pixels + y * count;
    float top = rows->bits == 16 ? 65535.0f : 255.0f;

    for (size_t i = 0; i < count; i++) {
        float v = from[i] > 0 ? from[i] < 1 ? from[i] : 1 : 0; /* NaN: 0 */
        uint32_t code = (uint32_t)(v * top + 0.5f);
        if (rows->bits == 16)
            *row++ = (uint8_t)(code >> 8);
        *row++ = (uint8_t)code;
    }
}

static void fill_bytes(const struct png_rows *rows, uint32_t y, uint8_t *row)
{
    const struct image8 *image = rows->source;
    size_t count = (size_t)image->width * image->channels;

    if (image->bits == 8) {
        memcpy(row, image->pixels + y * count, count);
        return;
    }
    for (size_t i = 0; i < count; i++) {
        uint16_t value;
        memcpy(&value, image->pixels + 2 * (y * count + i), sizeof value);
        row[2 * i] = (uint8_t)(value >> 8);
        row[2 * i + 1] = (uint8_t)value;
    }
}

/* libpng copies the texts. */
static void add_texts(png_structp png, png_infop info, const struct png_rows *rows)
{
    for (size_t i = 0; i < rows->text_count; i++) {
        png_text text = {.compression = PNG_TEXT_COMPRESSION_NONE,
                         .key = (char *)rows->texts[i].keyword,
                         .text = (char *)rows->texts[i].text,
                         .text_length = strlen(rows->texts[i].text)};
        png_set_text(png, info, &text, 1);
    }
}

/* Everything that may longjmp. */
static status write_png(png_structp png, png_infop info, struct png_stream *stream,
                        const struct png_rows *rows, uint8_t *row, struct error *err)
{
    static const int kinds[5] = {0, PNG_COLOR_TYPE_GRAY, PNG_COLOR_TYPE_GRAY_ALPHA,
                                 PNG_COLOR_TYPE_RGB, PNG_COLOR_TYPE_RGB_ALPHA};

    if (setjmp(png_jmpbuf(png)))
        return buffer_ok(stream->out) && !stream->no_memory
                   ? error_set(err, STATUS_ERR_INTERNAL, "PNG: %s", stream->message)
                   : error_no_memory(err, "a PNG");
    png_set_user_limits(png, IMAGE_SIDE_MAX, IMAGE_SIDE_MAX);
    png_set_write_fn(png, stream, png_write_bytes, png_flush_nothing);
    png_set_compression_level(png, rows->fast ? PNG_DEFLATE_LEVEL_FAST : PNG_DEFLATE_LEVEL);
    png_set_filter(png, 0, rows->fast ? PNG_FILTER_SUB : PNG_ALL_FILTERS);
    png_set_IHDR(png, info, rows->width, rows->height, rows->bits, kinds[rows->channels],
                 PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
    if (rows->is_srgb)
        png_set_sRGB(png, info, PNG_sRGB_INTENT_PERCEPTUAL);
    add_texts(png, info, rows);
    png_write_info(png, info);
    for (uint32_t y = 0; y < rows->height; y++) {
        rows->fill(rows, y, row);
        png_write_row(png, row);
    }
    png_write_end(png, info);
    return STATUS_OK;
}

static status encode_rows(struct buffer *out, const struct png_rows *rows, struct error *err)
{
    struct png_stream stream = {.out = out};
    size_t start = out->size;
    png_structp png = NULL;
    png_infop info = NULL;
    uint8_t *row = mem_alloc_array(rows->width, rows->channels * (size_t)rows->bits / 8);
    status st;

    if (row)
        png = png_create_write_struct_2(PNG_LIBPNG_VER_STRING, &stream, png_fail,
                                        png_ignore_warning, &stream, png_take_memory,
                                        png_give_memory);
    info = png ? png_create_info_struct(png) : NULL;
    if (info)
        st = write_png(png, info, &stream, rows, row, err);
    else
        st = error_no_memory(err, "libpng");
    if (png)
        png_destroy_write_struct(&png, &info);
    mem_free(row);
    if (st != STATUS_OK && out->data && !out->failed) {
        out->size = start; /* keep what was there before */
        out->data[start] = 0;
    }
    return st;
}

status png_encode_as(struct buffer *out, const struct image *image,
                     const struct picture_options *how, struct error *err)
{
    const struct png_rows rows = {.width = image->width,
                                  .height = image->height,
                                  .channels = image->channels < 4 ? 3 : 4,
                                  .bits = how->bits == 16 ? 16 : 8,
                                  .is_srgb = 1,
                                  .plain = how->plain,
                                  .fast = how->fast,
                                  .texts = how->texts,
                                  .text_count = how->text_count,
                                  .source = image,
                                  .fill = image->channels < 4 ? fill_picture : fill_picture_alpha};

    if (image->channels < 3)
        return error_set(err, STATUS_ERR_INTERNAL, "a picture is made of 3 channels, not of %u",
                         (unsigned)image->channels);
    return encode_rows(out, &rows, err);
}

status png_encode(struct buffer *out, const struct image *image, struct error *err)
{
    static const struct picture_options usual;

    return png_encode_as(out, image, &usual, err);
}

status png_encode_texture(struct buffer *out, const struct image *image, int bits,
                          struct error *err)
{
    const struct png_rows rows = {.width = image->width,
                                  .height = image->height,
                                  .channels = image->channels,
                                  .bits = bits,
                                  .source = image,
                                  .fill = fill_texture};

    return encode_rows(out, &rows, err);
}

status png_encode_8(struct buffer *out, const struct image8 *image, struct error *err)
{
    const struct png_rows rows = {.width = image->width,
                                  .height = image->height,
                                  .channels = image->channels,
                                  .bits = (int)image->bits,
                                  .source = image,
                                  .fill = fill_bytes};

    return encode_rows(out, &rows, err);
}
