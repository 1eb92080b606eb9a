/* Pictures that a pbrt scene names: read once, brought into a form that workers read. */
#include <math.h>
#include <png.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "client/import/pbrt.h"
#include "common/base/file.h"
#include "common/base/memory.h"
#include "common/math/elementary.h"

/* ---- writing PNG -------------------------------------------------------------------------- */

static uint32_t quantise(float value, float top)
{
    float v = value > 0 ? value < 1 ? value : 1 : 0; /* NaN: 0 */

    return (uint32_t)(v * top + 0.5f);
}

struct png_output {
    struct buffer *out;
};

static void png_append(png_structp png, png_bytep data, size_t size_bytes)
{
    struct png_output *output = png_get_io_ptr(png);

    buffer_append(output->out, data, size_bytes);
}

static void png_flush_nothing(png_structp png)
{
    (void)png;
}

static void fill_row(const struct image *image, uint32_t y, int bits, uint8_t *row)
{
    const float *from = image->pixels + (size_t)y * image->width * image->channels;
    size_t count = (size_t)image->width * image->channels;

    for (size_t i = 0; i < count; i++) {
        uint32_t v = quantise(from[i], bits == 16 ? 65535.0f : 255.0f);
        if (bits == 16) {
            row[2 * i] = (uint8_t)(v >> 8);
            row[2 * i + 1] = (uint8_t)v;
        } else {
            row[i] = (uint8_t)v;
        }
    }
}

status pbrt_png(const struct image *image, int bits, struct buffer *out, struct error *err)
{
    static const int kinds[5] = {0, PNG_COLOR_TYPE_GRAY, PNG_COLOR_TYPE_GRAY_ALPHA,
                                 PNG_COLOR_TYPE_RGB, PNG_COLOR_TYPE_RGB_ALPHA};
    struct png_output output = {out};
    png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, NULL, NULL, NULL);
    png_infop info = png ? png_create_info_struct(png) : NULL;
    uint8_t *row = mem_alloc_array((size_t)image->width * image->channels, (size_t)bits / 8);

    if (!info || !row || setjmp(png_jmpbuf(png)))
        goto failed;
    png_set_write_fn(png, &output, png_append, png_flush_nothing);
    png_set_IHDR(png, info, image->width, image->height, bits, kinds[image->channels],
                 PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
    png_write_info(png, info);
    for (uint32_t y = 0; y < image->height; y++) {
        fill_row(image, y, bits, row);
        png_write_row(png, row);
    }
    png_write_end(png, NULL);
    png_destroy_write_struct(&png, &info);
    mem_free(row);
    return buffer_ok(out) ? STATUS_OK : error_no_memory(err, "a picture");
failed:
    png_destroy_write_struct(&png, &info);
    mem_free(row);
    return error_no_memory(err, "a picture");
}

/* ---- TGA ---------------------------------------------------------------------------------- */

struct tga {
    const uint8_t *at, *end;
    uint32_t width, height;
    unsigned kind, bytes, map_bytes, map_first, map_count;
    const uint8_t *map;
    int from_top, from_right;
};

static unsigned word_at(const uint8_t *p)
{
    return (unsigned)p[0] | (unsigned)p[1] << 8;
}

/* The TGA form has no mark at its start: the header must make sense. */
static int tga_open(const struct buffer *data, struct tga *t)
{
    const uint8_t *h = data->data;
    size_t skip;

    memset(t, 0, sizeof *t);
    if (data->size < 18)
        return 0;
    t->kind = h[2];
    t->map_first = word_at(h + 3);
    t->map_count = h[1] == 1 ? word_at(h + 5) : 0;
    t->map_bytes = (unsigned)(h[7] + 7) / 8;
    t->width = word_at(h + 12);
    t->height = word_at(h + 14);
    t->bytes = (unsigned)(h[16] + 7) / 8;
    t->from_top = h[17] >> 5 & 1;
    t->from_right = h[17] >> 4 & 1;
    if (h[1] > 1 || !t->width || !t->height || (h[17] & 0xc0))
        return 0;
    switch (t->kind & 7u) {
    case 1:
        if (!t->map_count || t->bytes != 1 || t->map_bytes < 2 || t->map_bytes > 4)
            return 0;
        break;
    case 2:
        if (t->bytes < 2 || t->bytes > 4)
            return 0;
        break;
    case 3:
        if (t->bytes != 1)
            return 0;
        break;
    default:
        return 0;
    }
    if (t->kind & ~0xbu)
        return 0;
    skip = 18 + (size_t)h[0];
    if (skip + (size_t)t->map_count * t->map_bytes > data->size)
        return 0;
    t->map = h + skip;
    t->at = t->map + (size_t)t->map_count * t->map_bytes;
    t->end = h + data->size;
    return 1;
}

/* One stored colour of 2, 3 or 4 bytes, or grey, as channels of 0..1. */
static void tga_color(const uint8_t *p, unsigned bytes, unsigned channels, float *out)
{
    if (channels == 1) {
        out[0] = (float)p[0] / 255;
        return;
    }
    if (bytes == 2) {
        unsigned v = word_at(p);
        out[0] = (float)(v >> 10 & 31) / 31;
        out[1] = (float)(v >> 5 & 31) / 31;
        out[2] = (float)(v & 31) / 31;
        return;
    }
    for (unsigned c = 0; c < 3; c++)
        out[c] = (float)p[2 - c] / 255;
    if (channels == 4)
        out[3] = (float)p[3] / 255;
}

static status tga_decode(const struct buffer *data, struct image *out, const char *name,
                         struct error *err)
{
    unsigned run = 0, repeat = 0, channels;
    const uint8_t *color = NULL;
    struct tga t;

    if (!tga_open(data, &t))
        return error_set(err, STATUS_ERR_INPUT, "%s: is not a TGA picture", name);
    channels = (t.kind & 7u) == 3                                            ? 1
               : ((t.kind & 7u) == 1 ? t.map_bytes : t.bytes) == 4 ? 4
                                                                             : 3;
    /* A packet of 1 + bytes stands for at most 128 texels. */
    if ((uint64_t)t.width * t.height > (uint64_t)(t.end - t.at) * 128)
        return error_set(err, STATUS_ERR_INPUT, "%s: the TGA picture is cut short", name);
    TRY(image_init(out, t.width, t.height, channels, err));
    for (size_t i = 0; i < (size_t)t.width * t.height; i++) {
        size_t x = i % t.width, y = i / t.width;
        const uint8_t *shown;
        if (run == 0 && (t.kind & 8u)) {
            if (t.at >= t.end)
                goto cut_short;
            run = (*t.at & 127u) + 1;
            repeat = *t.at++ >> 7;
            color = NULL;
        }
        if (!(t.kind & 8u) || !repeat || !color) {
            if ((size_t)(t.end - t.at) < t.bytes)
                goto cut_short;
            color = t.at;
            t.at += t.bytes;
        }
        if (run)
            run--;
        shown = color;
        if ((t.kind & 7u) == 1) {
            unsigned index = color[0] - t.map_first;
            if (color[0] < t.map_first || index >= t.map_count)
                index = 0;
            shown = t.map + (size_t)index * t.map_bytes;
        }
        x = t.from_right ? t.width - 1 - x : x;
        y = t.from_top ? y : t.height - 1 - y;
        tga_color(shown, (t.kind & 7u) == 1 ? t.map_bytes : t.bytes, channels,
                  out->pixels + (y * t.width + x) * channels);
    }
    return STATUS_OK;
cut_short:
    image_release(out);
    return error_set(err, STATUS_ERR_INPUT, "%s: the TGA picture is cut short", name);
}

/* ---- PFM ---------------------------------------------------------------------------------- */

/* A word of the header; the position after the one white space that ends it. */
static size_t pfm_word(const struct buffer *data, size_t at, char *word, size_t word_size)
{
    size_t length = 0;

    while (at < data->size && strchr(" \t\r\n", data->data[at]))
        at++;
    while (at < data->size && !strchr(" \t\r\n", data->data[at]) && length + 1 < word_size)
        word[length++] = (char)data->data[at++];
    word[length] = 0;
    return at + 1;
}

static int is_pfm(const struct buffer *data)
{
    return data->size > 8 && data->data[0] == 'P' &&
           (data->data[1] == 'F' || data->data[1] == 'f') && data->data[2] <= ' ';
}

static status pfm_decode(const struct buffer *data, struct image *out, const char *name,
                         struct error *err)
{
    unsigned channels = data->data[1] == 'F' ? 3 : 1;
    double width, height, scale;
    char word[32];
    size_t at = pfm_word(data, 2, word, sizeof word), count;
    int ok = pbrt_number(word, &width);

    at = pfm_word(data, at, word, sizeof word);
    ok = ok && pbrt_number(word, &height);
    at = pfm_word(data, at, word, sizeof word);
    ok = ok && pbrt_number(word, &scale);
    if (!ok || !(width >= 1 && width <= IMAGE_SIDE_MAX && height >= 1 && height <= IMAGE_SIDE_MAX) ||
        scale == 0)
        return error_set(err, STATUS_ERR_INPUT, "%s: is not a PFM picture", name);
    count = (size_t)width * (size_t)height * channels;
    if (at > data->size || (data->size - at) / 4 < count)
        return error_set(err, STATUS_ERR_INPUT, "%s: the PFM picture is cut short", name);
    TRY(image_init(out, (uint32_t)width, (uint32_t)height, channels, err));
    for (size_t i = 0; i < count; i++) {
        size_t row = i / ((size_t)width * channels), rest = i % ((size_t)width * channels);
        const uint8_t *b = data->data + at + 4 * i;
        uint32_t bits = scale < 0 ? word_at(b) | (uint32_t)word_at(b + 2) << 16
                                  : (uint32_t)b[0] << 24 | (uint32_t)b[1] << 16 |
                                        (uint32_t)b[2] << 8 | b[3];
        float v = float_from_bits(bits);
        v = v > 0 && v < 3e38f ? v : 0; /* the bottom row is the first */
        out->pixels[((size_t)height - 1 - row) * (size_t)width * channels + rest] = v;
    }
    return STATUS_OK;
}

/* ---- pictures ----------------------------------------------------------------------------- */

/* Make the file's bytes those of a PNG or EXR of the same texels. */
static status convert(struct pbrt *p, struct pbrt_image *image, struct image *pixels)
{
    struct buffer out = BUFFER_INIT;
    const struct exr_options options = {0};
    status result;

    if (image->is_float && pixels->channels == 1) {
        struct image rgb;
        result = image_init(&rgb, pixels->width, pixels->height, 3, p->err);
        if (result != STATUS_OK)
            return result;
        for (size_t i = 0; i < (size_t)rgb.width * rgb.height; i++)
            for (size_t c = 0; c < 3; c++)
                rgb.pixels[3 * i + c] = pixels->pixels[i];
        image_release(pixels);
        *pixels = rgb;
    }
    if (image->is_float)
        result = exr_encode(&out, pixels, &options, p->err);
    else
        result = pbrt_png(pixels, 8, &out, p->err);
    if (result != STATUS_OK) {
        buffer_release(&out);
        return result;
    }
    buffer_release(&image->bytes);
    image->bytes = out;
    return STATUS_OK;
}

/* Look at the bytes; *known is 0 when nobody reads them. */
static status recognise_image(struct pbrt *p, struct pbrt_image *image, const char *path,
                              int *known)
{
    enum image_format format = image_format_of(image->bytes.data, image->bytes.size);
    struct image pixels = {0};
    struct tga tga;
    status result = STATUS_OK;

    *known = 1;
    image->is_float = format == IMAGE_EXR || format == IMAGE_HDR;
    if (format != IMAGE_UNKNOWN)
        return builder_check_image(p->b, path, image->bytes.data, image->bytes.size);
    if (is_pfm(&image->bytes)) {
        image->is_float = 1;
        result = pfm_decode(&image->bytes, &pixels, path, p->err);
    } else if (tga_open(&image->bytes, &tga)) {
        TRY(builder_check_pixels(p->b, path, tga.width, tga.height));
        result = tga_decode(&image->bytes, &pixels, path, p->err);
    } else {
        *known = 0;
    }
    if (result == STATUS_OK && *known)
        result = convert(p, image, &pixels);
    image_release(&pixels);
    return result;
}

status pbrt_image(struct pbrt *p, const char *name, const struct pbrt_place *at,
                  struct pbrt_image **out)
{
    struct pbrt_image *image = pbrt_name_find(&p->images, name);
    char *path = NULL;
    int known = 0;
    status result;

    *out = image;
    if (image)
        return STATUS_OK;
    TRY(pbrt_resolve(&p->reader, name, at, &path, p->err));
    image = ARENA_NEW(&p->arena, struct pbrt_image);
    if (!image) {
        mem_free(path);
        return error_no_memory(p->err, "a picture");
    }
    image->row = BUILDER_NO_ROW;
    image->at = *at;
    image->name = pbrt_keep(p, name);
    result = image->name ? input_files_read(p->b->files, path, PBRT_FILE_BYTES_MAX, &image->bytes,
                                           p->err)
                         : error_no_memory(p->err, "a picture");
    if (result == STATUS_OK)
        result = recognise_image(p, image, path, &known);
    mem_free(path);
    if (result == STATUS_OK && known)
        result = pbrt_name_set(p, &p->images, name, image);
    if (result != STATUS_OK || !known)
        buffer_release(&image->bytes);
    if (result != STATUS_OK)
        return result;
    *out = known ? image : NULL;
    if (!known)
        pbrt_warn(p, at, "picture form",
                  "the picture \"%.200s\" has a form that is not read (PNG, JPEG, EXR, HDR, TGA "
                  "and PFM are): left out",
                  name);
    return STATUS_OK;
}

static status decode_8(struct pbrt *p, struct pbrt_image *image, struct image *out)
{
    struct image8 raw = {0};
    status result = image_decode_8(&raw, image->bytes.data, image->bytes.size, image->name, p->err);

    if (result == STATUS_OK)
        result = image_init(out, raw.width, raw.height, raw.channels, p->err);
    if (result == STATUS_OK) {
        size_t count = (size_t)raw.width * raw.height * raw.channels;
        for (size_t i = 0; i < count; i++) {
            uint16_t wide;
            memcpy(&wide, raw.pixels + (raw.bits == 16 ? 2 * i : 0), sizeof wide);
            out->pixels[i] = raw.bits == 16 ? (float)wide / 65535 : (float)raw.pixels[i] / 255;
        }
    }
    image8_release(&raw);
    return result;
}

status pbrt_image_decode(struct pbrt *p, struct pbrt_image *image)
{
    struct image_repairs repairs = {0};
    const struct import_result *result_so_far = p->b->out;
    struct buffer borrowed = image->bytes;
    status result;

    if (image->pixels.pixels)
        return STATUS_OK;
    if (image->row >= 0) { /* the builder has the bytes */
        const struct digest *digest = &p->b->images[image->row].blob.digest;
        for (size_t i = 0; i < result_so_far->blob_count; i++)
            if (digest_equal(&result_so_far->blobs[i].digest, digest)) {
                borrowed.data = result_so_far->blobs[i].data;
                borrowed.size = result_so_far->blobs[i].size_bytes;
            }
    }
    {
        struct buffer own = image->bytes;
        image->bytes = borrowed;
        result = image->is_float
                     ? image_decode_hdr(&image->pixels, image->bytes.data, image->bytes.size,
                                        image->name, &repairs, p->err)
                     : decode_8(p, image, &image->pixels);
        image->bytes = own;
    }
    if (result != STATUS_OK)
        return result;
    if (repairs.nan_pixels || repairs.infinite_pixels || repairs.negative_pixels)
        pbrt_warn(p, &image->at, "picture repairs",
                  "%s: %llu pixels are not numbers, %llu negative and %llu infinite: they count "
                  "as black, black and the brightest finite value",
                  image->name, (unsigned long long)repairs.nan_pixels,
                  (unsigned long long)repairs.negative_pixels,
                  (unsigned long long)repairs.infinite_pixels);
    image->width = image->pixels.width;
    image->height = image->pixels.height;
    image->channels = image->pixels.channels;
    p->image_bytes += (size_t)image->width * image->height * image->channels * sizeof(float);
    if (p->image_bytes > PBRT_IMAGES_BYTES_MAX)
        return pbrt_fail(p, STATUS_ERR_LIMIT, &image->at,
                         "textures that must be computed here need more than %d MiB of pictures",
                         PBRT_IMAGES_BYTES_MAX >> 20);
    return STATUS_OK;
}

status pbrt_image_row(struct pbrt *p, struct pbrt_image *image, uint32_t *row)
{
    uint8_t *data = image->bytes.data;
    size_t size = image->bytes.size;

    if (image->row < 0) {
        image->bytes = (struct buffer)BUFFER_INIT; /* the builder takes them over */
        TRY(builder_add_image(p->b, file_basename(image->name), data, size, row));
        image->row = *row;
    }
    *row = (uint32_t)image->row;
    return STATUS_OK;
}

void pbrt_image_forget(struct pbrt_image *image)
{
    buffer_release(&image->bytes);
    image_release(&image->pixels);
}

void pbrt_images_trim(struct pbrt *p)
{
    if (p->image_bytes <= PBRT_IMAGES_BYTES_KEPT)
        return;
    for (size_t i = 0; i < p->images.size; i++)
        if (p->images.entries[i].value)
            image_release(&((struct pbrt_image *)p->images.entries[i].value)->pixels);
    p->image_bytes = 0;
}

/* ---- maps of directions ------------------------------------------------------------------- */

/* Clarberg 2008, "Fast Equal-Area Mapping of the (Hemi)Sphere using SIMD": the unit square's
 * middle is +z, its corners -z. */
static void sphere_to_square(const double d[3], double *u, double *v)
{
    double x = fabs(d[0]), y = fabs(d[1]), z = fabs(d[2]);
    double r = sqrt(z < 1 ? 1 - z : 0);
    double phi = (double)det_atan2((float)y, (float)x) * (2 / PI_D); /* 0..1 */
    double b = phi * r, a = r - b;

    if (d[2] < 0) {
        double swap = a;
        a = 1 - b;
        b = 1 - swap;
    }
    *u = (copysign(a, d[0]) + 1) / 2;
    *v = (copysign(b, d[1]) + 1) / 2;
}

status pbrt_octahedral_to_latlong(const struct image *square, const double axes[3][3],
                                  struct image *out, struct error *err)
{
    enum { SUB = 4, HEIGHT_MIN = 16 }; /* rays along each side of a texel */
    uint32_t n = square->width, height = n > HEIGHT_MIN ? n : HEIGHT_MIN;
    size_t columns, rows;
    float *sines;

    TRY(image_init(out, 2 * height, height, 3, err));
    columns = (size_t)out->width * SUB;
    rows = (size_t)out->height * SUB;
    sines = mem_alloc_array(columns, 2 * sizeof *sines);
    if (!sines) {
        image_release(out);
        return error_no_memory(err, "an environment map");
    }
    for (size_t c = 0; c < columns; c++) /* u = 0.5 + atan2(z, x) / (2 pi) */
        det_sincos((float)(2 * PI_D * (((double)c + 0.5) / (double)columns - 0.5)),
                   &sines[2 * c], &sines[2 * c + 1]);
    for (size_t r = 0; r < rows; r++) {
        float sin_t, cos_t;
        det_sincos((float)(PI_D * ((double)r + 0.5) / (double)rows), &sin_t, &cos_t);
        for (size_t c = 0; c < columns; c++) {
            float *to = out->pixels + ((r / SUB) * out->width + c / SUB) * 3;
            const double m[3] = {(double)(sin_t * sines[2 * c + 1]), (double)cos_t,
                                 (double)(sin_t * sines[2 * c])};
            const float *from;
            double d[3], u, v;
            size_t x, y;
            for (int i = 0; i < 3; i++)
                d[i] = axes[i][0] * m[0] + axes[i][1] * m[1] + axes[i][2] * m[2];
            sphere_to_square(d, &u, &v);
            x = (size_t)(u * n);
            y = (size_t)(v * square->height);
            x = x < n ? x : n - 1;
            y = y < square->height ? y : square->height - 1;
            from = square->pixels + (y * n + x) * square->channels;
            for (unsigned i = 0; i < 3; i++)
                to[i] += from[square->channels >= 3 ? i : 0] / (SUB * SUB);
        }
    }
    mem_free(sines);
    return STATUS_OK;
}
