/* Writing PNG to memory: rows are filtered by all threads, then deflated in one piece. The chunks are those of the PNG
 * specification (third edition), sections 5 and 11. */
#include <stdlib.h>
#include <string.h>

#include "common/base/buffer.h"
#include "common/base/bytes.h"
#include "common/base/memory.h"
#include "common/image/deflate.h"
#include "common/image/image.h"
#include "common/image/quantize.h"
#include "common/system/parallel.h"

enum {
    IDAT_BYTES_MAX = 1 << 30,  /* the format allows 2^31 - 1 */
    ROWS_EACH = 32,            /* a thread filters at a time */
    THREADS_FROM = 512 * 1024, /* bytes: less is filtered sooner than a thread begins */
    FILTERS = 5
};

/* The source of a file: a row is filled when its turn comes, most significant byte first. */
struct png_rows {
    uint32_t width, height, channels;
    int bits, is_srgb; /* is_srgb: an sRGB chunk says so */
    const void *source;
    int plain, level; /* of deflate */
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

/* ---- filters (specification, section 9) ------------------------------------------------------ */

static inline uint8_t paeth(int left, int up, int corner)
{
    int a = abs(up - corner), b = abs(left - corner), c = abs(left + up - 2 * corner);

    return (uint8_t)(a <= b && a <= c ? left : b <= c ? up : corner);
}

/* Row `row`, under `above`, both with `step` zeros before them, by filter `kind`. */
static void filter_row(int kind, const uint8_t *row, const uint8_t *above, size_t step, size_t count, uint8_t *out)
{
    const uint8_t *left = row - step, *corner = above - step;

    switch (kind) {
    case 1:
        for (size_t i = 0; i < count; i++)
            out[i] = (uint8_t)(row[i] - left[i]);
        return;
    case 2:
        for (size_t i = 0; i < count; i++)
            out[i] = (uint8_t)(row[i] - above[i]);
        return;
    case 3:
        for (size_t i = 0; i < count; i++)
            out[i] = (uint8_t)(row[i] - (left[i] + above[i]) / 2);
        return;
    case 4:
        for (size_t i = 0; i < count; i++)
            out[i] = (uint8_t)(row[i] - paeth(left[i], above[i], corner[i]));
        return;
    default: memcpy(out, row, count);
    }
}

/* How well it may deflate: the sum of the bytes' distances from 0. */
static uint64_t weight_of(const uint8_t *bytes, size_t count)
{
    uint64_t sum = 0;

    for (size_t begin = 0; begin < count; begin += 1 << 16) {
        size_t end = count - begin < 1 << 16 ? count : begin + (1 << 16);
        uint32_t part = 0;
        for (size_t i = begin; i < end; i++)
            part += (uint32_t)abs((int8_t)bytes[i]);
        sum += part;
    }
    return sum;
}

struct filtering {
    const struct png_rows *rows;
    size_t step, bytes; /* of a pixel, of a row */
    uint8_t *out;       /* each row after the number of its filter */
    _Atomic int starved;
};

/* What is not deflated here is compressed on the wire, by zstd, which does best after UP. */
static void pick_filter(const struct filtering *f, const uint8_t *row, const uint8_t *above, uint8_t *trial,
                        uint8_t *out)
{
    uint64_t least = UINT64_MAX;

    if (f->rows->level != DEFLATE_USUAL) {
        out[0] = f->rows->level == DEFLATE_STORED ? 2 : 1;
        filter_row(out[0], row, above, f->step, f->bytes, out + 1);
        return;
    }
    for (uint8_t kind = 0; kind < FILTERS; kind++) {
        uint64_t weight;
        filter_row(kind, row, above, f->step, f->bytes, trial);
        weight = weight_of(trial, f->bytes);
        if (weight >= least)
            continue;
        least = weight;
        out[0] = kind;
        memcpy(out + 1, trial, f->bytes);
    }
}

static void filter_rows(void *user, size_t begin, size_t end)
{
    struct filtering *f = user;
    size_t each = f->step + f->bytes;
    uint8_t *memory = mem_calloc(3, each), *row, *above, *trial;

    if (!memory) {
        f->starved = 1;
        return;
    }
    row = memory + f->step;
    above = row + each;
    trial = memory + 2 * each;
    if (begin > 0)
        f->rows->fill(f->rows, (uint32_t)begin - 1, above);
    for (size_t y = begin; y < end; y++) {
        uint8_t *swap = above;
        f->rows->fill(f->rows, (uint32_t)y, row);
        pick_filter(f, row, above, trial, f->out + y * (f->bytes + 1));
        above = row;
        row = swap;
    }
    mem_free(memory);
}

/* ---- chunks ---------------------------------------------------------------------------------- */

static void append_chunk(struct buffer *out, const char type[4], const void *data, size_t size)
{
    uint8_t word[4];
    size_t start;

    bytes_put32_big(word, (uint32_t)size);
    buffer_append(out, word, 4);
    start = out->size;
    buffer_append(out, type, 4);
    buffer_append(out, data, size);
    if (!buffer_ok(out))
        return;
    bytes_put32_big(word, deflate_crc32(0, out->data + start, out->size - start));
    buffer_append(out, word, 4);
}

static void append_header(struct buffer *out, const struct png_rows *rows)
{
    static const uint8_t signature[8] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
    static const uint8_t kinds[5] = {0, 0, 4, 2, 6}; /* grey, with alpha, RGB, with alpha */
    uint8_t header[13] = {0}, perceptual = 0;

    bytes_put32_big(header, rows->width);
    bytes_put32_big(header + 4, rows->height);
    header[8] = (uint8_t)rows->bits;
    header[9] = kinds[rows->channels];
    buffer_append(out, signature, sizeof signature);
    append_chunk(out, "IHDR", header, sizeof header);
    if (rows->is_srgb)
        append_chunk(out, "sRGB", &perceptual, 1);
}

static void append_texts(struct buffer *out, const struct png_rows *rows)
{
    for (size_t i = 0; i < rows->text_count; i++) {
        struct buffer text = BUFFER_INIT;
        buffer_append(&text, rows->texts[i].keyword, strlen(rows->texts[i].keyword) + 1);
        buffer_puts(&text, rows->texts[i].text);
        append_chunk(out, "tEXt", text.data, text.size);
        out->failed |= text.failed;
        buffer_release(&text);
    }
}

static void append_file(struct buffer *out, const struct png_rows *rows, const struct buffer *packed)
{
    append_header(out, rows);
    append_texts(out, rows);
    for (size_t at = 0; at < packed->size; at += IDAT_BYTES_MAX)
        append_chunk(out, "IDAT", packed->data + at,
                     packed->size - at < IDAT_BYTES_MAX ? packed->size - at : IDAT_BYTES_MAX);
    append_chunk(out, "IEND", NULL, 0);
}

static status encode_rows(struct buffer *out, const struct png_rows *rows, struct error *err)
{
    struct filtering f = {.rows = rows, .step = rows->channels * (size_t)rows->bits / 8};
    struct buffer packed = BUFFER_INIT;
    struct deflater *deflater = deflater_new(rows->level);
    size_t start = out->size;
    int ok;

    f.bytes = f.step * rows->width;
    f.out = mem_alloc_array(rows->height, f.bytes + 1);
    ok = f.out && deflater;
    if (ok) {
        parallel_for(f.bytes * rows->height < THREADS_FROM ? 1 : 0, rows->height, ROWS_EACH, filter_rows, &f);
        deflater_append(deflater, f.out, rows->height * (f.bytes + 1), &packed);
    }
    deflater_free(deflater);
    mem_free(f.out);
    ok = ok && !f.starved && buffer_ok(&packed);
    if (ok)
        append_file(out, rows, &packed);
    buffer_release(&packed);
    if (ok && buffer_ok(out))
        return STATUS_OK;
    if (out->data && !out->failed) {
        out->size = start; /* keep what was there before */
        out->data[start] = 0;
    }
    return error_no_memory(err, "a PNG");
}

status png_encode_as(struct buffer *out, const struct image *image, const struct picture_options *how,
                     struct error *err)
{
    const struct png_rows rows = {.width = image->width,
                                  .height = image->height,
                                  .channels = image->channels < 4 ? 3 : 4,
                                  .bits = how->bits == 16 ? 16 : 8,
                                  .is_srgb = 1,
                                  .plain = how->plain,
                                  .level = how->fast ? DEFLATE_FAST : DEFLATE_USUAL,
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

status png_encode_texture(struct buffer *out, const struct image *image, int bits, struct error *err)
{
    const struct png_rows rows = {.width = image->width,
                                  .height = image->height,
                                  .channels = image->channels,
                                  .bits = bits,
                                  .source = image,
                                  .fill = fill_texture};

    return encode_rows(out, &rows, err);
}

status png_encode_8(struct buffer *out, const struct image8 *image, int raw, struct error *err)
{
    const struct png_rows rows = {.width = image->width,
                                  .height = image->height,
                                  .channels = image->channels,
                                  .bits = (int)image->bits,
                                  .level = raw ? DEFLATE_STORED : DEFLATE_USUAL,
                                  .source = image,
                                  .fill = fill_bytes};

    return encode_rows(out, &rows, err);
}
