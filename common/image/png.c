/* Reading PNG through libpng, from memory. libpng's messages go to struct error, its memory comes
 * from common/base/memory. Gamma and colour profiles are ignored, as glTF requires. */
#include <png.h>
#include <setjmp.h>
#include <stdio.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/image/image.h"

enum {
    PNG_TEXT_CHUNKS_MAX = 64,
    PNG_CHUNK_BYTES_MAX = 8 << 20, /* of ancillary chunks: profiles, texts */
};
#define PNG_BLOCK_BYTES_MAX ((size_t)1 << 30)
#define DEFLATE_EXPANSION_MAX 1100.0 /* a byte of deflate becomes at most 1032 */

struct png_stream {
    const uint8_t *data;
    size_t size_bytes, at;
    char message[128];
    int no_memory;
};

static void png_fail(png_structp png, png_const_charp text)
{
    struct png_stream *stream = png_get_error_ptr(png);

    snprintf(stream->message, sizeof stream->message, "%s", text);
    png_longjmp(png, 1);
}

static void png_ignore_warning(png_structp png UNUSED, png_const_charp text UNUSED) {}

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

static void png_give_memory(png_structp png UNUSED, png_voidp block) { mem_free(block); }

static void png_read_bytes(png_structp png, png_bytep out, size_t size_bytes)
{
    struct png_stream *stream = png_get_io_ptr(png);

    if (size_bytes > stream->size_bytes - stream->at)
        png_error(png, "the file ends too early");
    memcpy(out, stream->data + stream->at, size_bytes);
    stream->at += size_bytes;
}

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

/* Everything that may longjmp; no variable here outlives the jump. `rows` is freed by the caller. */
static status read_png(png_structp png, png_infop info, struct png_stream *stream, struct image8 *out, png_bytep **rows,
                       const char *name, struct error *err)
{
    uint32_t width, height;
    size_t row_bytes;
    status st;

    if (setjmp(png_jmpbuf(png)))
        return stream->no_memory ? error_no_memory(err, "a PNG")
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
    if ((double)png_get_rowbytes(png, info) * height / DEFLATE_EXPANSION_MAX > (double)stream->size_bytes)
        return error_set(err, STATUS_ERR_INPUT,
                         "%s: %zu bytes cannot hold the %u x %u pixels that the header claims; "
                         "the file is damaged or cut short",
                         name, stream->size_bytes, (unsigned)width, (unsigned)height);
    set_transformations(png, info);
    row_bytes = png_get_rowbytes(png, info);
    st = image8_init(out, width, height, png_get_channels(png, info), png_get_bit_depth(png, info), err);
    if (st != STATUS_OK) {
        error_prefix(err, "%s", name);
        return st;
    }
    if (row_bytes != (size_t)width * out->channels * (out->bits / 8))
        return error_set(err, STATUS_ERR_INTERNAL, "%s: libpng's rows have another size", name);
    *rows = mem_alloc_array(height, sizeof **rows);
    NEED(*rows, err, "a texture's rows");
    for (uint32_t y = 0; y < height; y++)
        (*rows)[y] = out->pixels + y * row_bytes;
    png_read_image(png, *rows);
    png_read_end(png, NULL);
    return STATUS_OK;
}

status png_decode(struct image8 *out, const uint8_t *data, size_t size_bytes, const char *name, struct error *err)
{
    struct png_stream stream = {.data = data, .size_bytes = size_bytes};
    png_structp png;
    png_infop info;
    png_bytep *rows = NULL;
    status st;

    memset(out, 0, sizeof *out);
    png = png_create_read_struct_2(PNG_LIBPNG_VER_STRING, &stream, png_fail, png_ignore_warning, &stream,
                                   png_take_memory, png_give_memory);
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
