/* OpenEXR: our encoder's round trips, and files written by OpenEXR itself in every
 * compression and layout that our decoder promises to read. */
#include <setjmp.h>
#include <stdatomic.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include <ImfCRgbaFile.h>
#include <openexr.h>

#include "common/base/buffer.h"
#include "common/base/memory.h"
#include "common/image/half.h"
#include "common/image/image.h"
#include "tests/support/exr_channels.h"

/* A value that differs for every pixel and channel, exact in half, smooth enough for the
 * lossy codes. */
static float pattern(uint32_t x, uint32_t y, uint32_t c)
{
    return (float)(1 + c) * 0.25f + (float)(x % 64) * 0x1p-6f + (float)(y % 32) * 0x1p-5f;
}

static struct image make_image(uint32_t width, uint32_t height, uint32_t channels)
{
    struct image image;

    assert_int_equal(image_init(&image, width, height, channels, NULL), STATUS_OK);
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++)
            for (uint32_t c = 0; c < channels; c++)
                image.pixels[(y * width + x) * channels + c] = pattern(x, y, c);
    return image;
}

static struct image decode(const struct buffer *file)
{
    struct image image;
    struct error err = {0};
    status st = exr_decode(&image, file->data, file->size, "test.exr", &err);

    if (st != STATUS_OK)
        print_error("%s\n", err.text);
    assert_int_equal(st, STATUS_OK);
    return image;
}

/* Largest difference to the pattern. */
static float worst(const struct image *image)
{
    float difference = 0;

    assert_int_equal(image->channels, 3);
    for (uint32_t y = 0; y < image->height; y++)
        for (uint32_t x = 0; x < image->width; x++)
            for (uint32_t c = 0; c < 3; c++)
                difference = fmaxf(difference, fabsf(image->pixels[(y * image->width + x) * 3 + c] - pattern(x, y, c)));
    return difference;
}

/* ---- our own encoder --------------------------------------------------------------------- */

static void test_round_trip(void **state)
{
    static const uint32_t sizes[][2] = {{1, 1}, {1, 17}, {19, 1}, {16, 16}, {33, 35}, {257, 3}};

    (void)state;
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++)
        for (uint32_t channels = 3; channels <= 4; channels++)
            for (int half = 0; half <= 1; half++) {
                struct image in = make_image(sizes[i][0], sizes[i][1], channels), out;
                struct buffer file = BUFFER_INIT, again = BUFFER_INIT;
                struct exr_options options = {.half = half};

                assert_int_equal(exr_encode(&file, &in, &options, NULL), STATUS_OK);
                assert_int_equal(exr_encode(&again, &in, &options, NULL), STATUS_OK);
                assert_int_equal(file.size, again.size);
                assert_memory_equal(file.data, again.data, file.size);
                assert_int_equal(image_format_of(file.data, file.size), IMAGE_EXR);
                out = decode(&file);
                assert_int_equal(out.width, in.width);
                assert_int_equal(out.height, in.height);
                assert_true(worst(&out) == 0.0f);
                image_release(&in);
                image_release(&out);
                buffer_release(&file);
                buffer_release(&again);
            }
}

/* A texture's alpha: divided out of the colour; a channel of ones is none. */
static void test_alpha(void **state)
{
    (void)state;
    for (int opaque = 0; opaque <= 1; opaque++) {
        struct image in = make_image(23, 9, 4), out;
        struct buffer file = BUFFER_INIT;
        struct error err = {0};

        for (size_t i = 0; i < 23 * 9; i++) {
            float alpha = opaque ? 1.0f : (float)(i % 5) * 0.25f;

            for (int c = 0; c < 3; c++)
                in.pixels[4 * i + (size_t)c] = (float)(i + (size_t)c) * alpha;
            in.pixels[4 * i + 3] = alpha;
        }
        assert_int_equal(exr_encode(&file, &in, NULL, NULL), STATUS_OK);
        if (image_decode_float(&out, file.data, file.size, "a.exr", NULL, &err) != STATUS_OK)
            fail_msg("%s", err.text);
        assert_int_equal(out.channels, opaque ? 3 : 4);
        for (size_t i = 0; i < 23 * 9; i++)
            for (size_t c = 0; c < out.channels; c++) {
                float alpha = opaque ? 1.0f : (float)(i % 5) * 0.25f;
                float want = c == 3 ? alpha : alpha > 0 ? (float)(i + c) : 0.0f;

                assert_true(out.pixels[out.channels * i + c] == want);
            }
        image_release(&out);
        out = decode(&file); /* asked for light alone */
        assert_int_equal(out.channels, 3);
        assert_true(out.pixels[3 * 4 + 1] == in.pixels[4 * 4 + 1]);
        image_release(&out);
        image_release(&in);
        buffer_release(&file);
    }
}

/* Floats keep their bits, NaN included: the file shows what was rendered. */
static void test_float_bits_kept(void **state)
{
    static const uint32_t bits[] = {0x00000001u, 0x807fffffu, 0x7f800000u, 0xff800000u,
                                    0x7fc12345u, 0x7f7fffffu, 0x80000000u, 0x3f800001u};
    struct image in = make_image(8, 3, 3), out;
    struct buffer file = BUFFER_INIT;

    (void)state;
    for (size_t i = 0; i < 72; i++)
        in.pixels[i] = float_from_bits(bits[i % 8]);
    assert_int_equal(exr_encode(&file, &in, NULL, NULL), STATUS_OK);
    out = decode(&file);
    assert_memory_equal(in.pixels, out.pixels, 72 * sizeof(float));
    image_release(&in);
    image_release(&out);
    buffer_release(&file);
}

/* Pixels that compress to about their own length: a chunk of just that length must be stored
 * as it is, for readers take it so. Some of these thousands meet that length. */
static void test_incompressible(void **state)
{
    enum { SIDE = 8, VALUES = SIDE * SIDE * 3 };
    uint32_t random = 1;

    (void)state;
    for (uint32_t run = 0; run < 150; run++)
        for (uint32_t zeros = 0; zeros <= 40; zeros++) {
            struct image image = make_image(SIDE, SIDE, 3), out;
            struct buffer file = BUFFER_INIT;
            struct exr_options options = {0};

            for (uint32_t i = 0; i < VALUES; i++) {
                uint32_t bits;
                random = random * 1664525u + 1013904223u;
                bits = random & 0xbf7fffffu; /* finite */
                if (i < zeros)
                    bits = 0x3f800000u | run;
                memcpy(&image.pixels[i], &bits, sizeof bits);
            }
            assert_int_equal(exr_encode(&file, &image, &options, NULL), STATUS_OK);
            out = decode(&file);
            for (uint32_t i = 0; i < VALUES; i++) {
                uint32_t want, got;
                memcpy(&want, &image.pixels[i], sizeof want);
                memcpy(&got, &out.pixels[i], sizeof got);
                if (want != got && image.pixels[i] >= 0) /* the decoder mends negative values */
                    fail_msg("run %u, %u equal values: value %u is %08x, not %08x", run, zeros, i, got, want);
            }
            image_release(&out);
            image_release(&image);
            buffer_release(&file);
        }
}

static void test_half_clamps_and_counts(void **state)
{
    static const float values[] = {65504.0f, 65505.0f, 1e30f, INFINITY, -1e9f, 1.0f};
    struct image in = make_image(2, 1, 3), out;
    uint64_t clamped = 99;
    struct exr_options options = {.half = 1, .clamped = &clamped};
    struct buffer file = BUFFER_INIT;

    (void)state;
    memcpy(in.pixels, values, sizeof values);
    assert_int_equal(exr_encode(&file, &in, &options, NULL), STATUS_OK);
    assert_int_equal(clamped, 4);
    out = decode(&file);
    assert_true(out.pixels[0] == 65504.0f && out.pixels[1] == 65504.0f);
    assert_true(out.pixels[2] == 65504.0f && out.pixels[3] == 65504.0f);
    assert_true(out.pixels[4] == -65504.0f && out.pixels[5] == 1.0f);
    image_release(&in);
    image_release(&out);
    buffer_release(&file);
}

struct memory_file {
    const struct buffer *bytes;
};

static int64_t read_memory(exr_const_context_t context, void *user, void *out, uint64_t size, uint64_t offset,
                           exr_stream_error_func_ptr_t complain)
{
    const struct buffer *b = ((struct memory_file *)user)->bytes;

    (void)context;
    (void)complain;
    if (offset >= b->size)
        return 0;
    if (size > b->size - offset)
        size = b->size - offset;
    memcpy(out, b->data + offset, size);
    return (int64_t)size;
}

static void test_attributes(void **state)
{
    static const double origin[3] = {500000.125, -1e-300, 3};
    static const struct exr_attribute attributes[] = {{.name = "software", .text = "azulejo"},
                                                      {.name = "relativeError", .number = 0.125},
                                                      {.name = "origin", .point = origin}};
    struct exr_options options = {.attributes = attributes, .attribute_count = 3};
    struct image in = make_image(4, 4, 3);
    struct buffer file = BUFFER_INIT;
    struct memory_file memory = {&file};
    exr_context_initializer_t init = EXR_DEFAULT_CONTEXT_INITIALIZER;
    exr_context_t context;
    exr_attr_chromaticities_t chroma;
    exr_compression_t compression;
    exr_attr_v3d_t point;
    const char *text;
    double number;
    int32_t length;

    (void)state;
    assert_int_equal(exr_encode(&file, &in, &options, NULL), STATUS_OK);
    init.read_fn = read_memory;
    init.user_data = &memory;
    assert_int_equal(exr_start_read(&context, "memory", &init), EXR_ERR_SUCCESS);
    assert_int_equal(exr_attr_get_string(context, 0, "software", &length, &text), EXR_ERR_SUCCESS);
    assert_int_equal(length, 7);
    assert_memory_equal(text, "azulejo", 7);
    assert_int_equal(exr_attr_get_double(context, 0, "relativeError", &number), EXR_ERR_SUCCESS);
    assert_true(number == 0.125);
    assert_int_equal(exr_attr_get_v3d(context, 0, "origin", &point), EXR_ERR_SUCCESS);
    assert_memory_equal(point.arr, origin, sizeof origin);
    assert_int_equal(exr_attr_get_chromaticities(context, 0, "chromaticities", &chroma), EXR_ERR_SUCCESS);
    assert_true(chroma.red_x == 0.64f && chroma.white_y == 0.329f);
    assert_int_equal(exr_get_compression(context, 0, &compression), EXR_ERR_SUCCESS);
    assert_int_equal(compression, EXR_COMPRESSION_ZIP);
    exr_finish(&context);
    image_release(&in);
    buffer_release(&file);
}

/* ---- files written by OpenEXR's older API: halves in every compression ---------------------- */

static void read_back(int fd, struct buffer *file)
{
    off_t size = lseek(fd, 0, SEEK_END);

    assert_true(size > 0);
    buffer_clear(file);
    assert_non_null(buffer_append_space(file, (size_t)size));
    assert_int_equal(pread(fd, file->data, (size_t)size, 0), size);
}

/* The pattern (its Y is not the pattern) at offset (x0, y0) of the display window. */
static void write_rgba(struct buffer *file, int width, int height, int x0, int y0, int channels, int compression,
                       int line_order)
{
    int fd = memfd_create("test-exr", MFD_CLOEXEC);
    ImfRgba *pixels = calloc((size_t)(width * height), sizeof *pixels);
    ImfHeader *header = ImfNewHeader();
    ImfOutputFile *out;
    char path[64];

    assert_true(fd >= 0);
    for (int y = 0; y < height; y++)
        for (int x = 0; x < width; x++) {
            ImfRgba *p = &pixels[y * width + x];
            p->r = half_from_float(pattern((uint32_t)x, (uint32_t)y, 0));
            p->g = half_from_float(pattern((uint32_t)x, (uint32_t)y, 1));
            p->b = half_from_float(pattern((uint32_t)x, (uint32_t)y, 2));
            p->a = half_from_float(1.0f);
        }
    snprintf(path, sizeof path, "/proc/self/fd/%d", fd);
    ImfHeaderSetDisplayWindow(header, 0, 0, 99, 99);
    ImfHeaderSetDataWindow(header, x0, y0, x0 + width - 1, y0 + height - 1);
    ImfHeaderSetCompression(header, compression);
    ImfHeaderSetLineOrder(header, line_order);
    out = ImfOpenOutputFile(path, header, channels);
    assert_non_null(out);
    assert_true(ImfOutputSetFrameBuffer(out, pixels - x0 - y0 * width, 1, (size_t)width));
    assert_true(ImfOutputWritePixels(out, height));
    assert_true(ImfCloseOutputFile(out));
    ImfDeleteHeader(header);
    free(pixels);
    read_back(fd, file);
    close(fd);
}

static void test_every_compression(void **state)
{
    static const int sizes[][4] = {
        {1, 1, 0, 0}, {5, 3, 0, 0}, {109, 65, -7, 12}, {64, 300, 3, -40}};

    (void)state;
    for (int compression = IMF_NO_COMPRESSION; compression <= IMF_DWAB_COMPRESSION; compression++)
        for (size_t i = 0; i < 4; i++)
            for (int order = IMF_INCREASING_Y; order <= IMF_DECREASING_Y; order++) {
                int lossy = compression >= IMF_B44_COMPRESSION;
                struct buffer file = BUFFER_INIT;
                struct image out;

                write_rgba(&file, sizes[i][0], sizes[i][1], sizes[i][2], sizes[i][3], IMF_WRITE_RGBA, compression,
                           order);
                out = decode(&file);
                assert_int_equal(out.width, sizes[i][0]);
                assert_int_equal(out.height, sizes[i][1]);
                assert_true(worst(&out) <= (lossy ? 0.13f : 0.0f));
                image_release(&out);
                buffer_release(&file);
            }
}

static void test_luminance_and_chroma(void **state)
{
    struct buffer file = BUFFER_INIT;
    struct image out;

    (void)state;
    write_rgba(&file, 40, 30, 4, 6, IMF_WRITE_Y, IMF_ZIP_COMPRESSION, IMF_INCREASING_Y);
    out = decode(&file);
    for (size_t i = 0; i < 40 * 30; i++) {
        const float *p = out.pixels + 3 * i;
        float y = 0.2126f * pattern(i % 40, (uint32_t)i / 40, 0) + 0.7152f * pattern(i % 40, (uint32_t)i / 40, 1) +
                  0.0722f * pattern(i % 40, (uint32_t)i / 40, 2);
        assert_true(p[0] == p[1] && p[1] == p[2]);
        assert_true(fabsf(p[0] - y) < 2e-3f);
    }
    image_release(&out);
    /* Chroma at half resolution: away from the borders the pattern comes back nearly. */
    write_rgba(&file, 40, 30, 4, 6, IMF_WRITE_YC, IMF_PIZ_COMPRESSION, IMF_INCREASING_Y);
    out = decode(&file);
    for (uint32_t y = 4; y < 26; y++)
        for (uint32_t x = 4; x < 36; x++)
            for (uint32_t c = 0; c < 3; c++)
                assert_true(fabsf(out.pixels[(y * 40 + x) * 3 + c] - pattern(x, y, c)) < 0.03f);
    image_release(&out);
    buffer_release(&file);
}

static void test_tiles_and_levels(void **state)
{
    (void)state;
    for (int mode = IMF_ONE_LEVEL; mode <= IMF_MIPMAP_LEVELS; mode++)
        for (int compression = IMF_NO_COMPRESSION; compression <= IMF_DWAA_COMPRESSION; compression++) {
            enum { W = 45, H = 31, TILE = 16 };
            int fd = memfd_create("test-exr", MFD_CLOEXEC);
            static ImfRgba pixels[W * H];
            ImfHeader *header = ImfNewHeader();
            struct buffer file = BUFFER_INIT;
            struct image result;
            ImfTiledOutputFile *out;
            char path[64];

            for (int i = 0; i < W * H; i++) {
                pixels[i].r = half_from_float(pattern((uint32_t)i % W, (uint32_t)i / W, 0));
                pixels[i].g = half_from_float(pattern((uint32_t)i % W, (uint32_t)i / W, 1));
                pixels[i].b = half_from_float(pattern((uint32_t)i % W, (uint32_t)i / W, 2));
            }
            snprintf(path, sizeof path, "/proc/self/fd/%d", fd);
            ImfHeaderSetDisplayWindow(header, 0, 0, W - 1, H - 1);
            ImfHeaderSetDataWindow(header, 0, 0, W - 1, H - 1);
            ImfHeaderSetCompression(header, compression);
            out = ImfOpenTiledOutputFile(path, header, IMF_WRITE_RGB, TILE, TILE, mode, IMF_ROUND_DOWN);
            assert_non_null(out);
            assert_true(ImfTiledOutputSetFrameBuffer(out, pixels, 1, W));
            for (int level = 0; level <= (mode == IMF_ONE_LEVEL ? 0 : 5); level++) {
                int w = W >> level, h = H >> level;

                w = w < 1 ? 1 : w;
                h = h < 1 ? 1 : h;
                for (int y = 0; y * TILE < h; y++)
                    for (int x = 0; x * TILE < w; x++)
                        assert_true(ImfTiledOutputWriteTile(out, x, y, level, level));
            }
            assert_true(ImfCloseTiledOutputFile(out));
            ImfDeleteHeader(header);
            read_back(fd, &file);
            close(fd);
            result = decode(&file);
            assert_int_equal(result.width, W);
            assert_int_equal(result.height, H);
            assert_true(worst(&result) <= (compression >= IMF_B44_COMPRESSION ? 0.13f : 0.0f));
            image_release(&result);
            buffer_release(&file);
        }
}

/* ---- files written by OpenEXRCore: any channels, any types ---------------------------------- */

struct part_spec {
    const char *name;
    exr_storage_t storage;
    const char *channels[8]; /* in alphabetical order */
    exr_pixel_type_t types[8];
    int values[8]; /* the pattern's channel that it holds */
};

static int64_t write_memory(exr_const_context_t context, void *user, const void *data, uint64_t size, uint64_t offset,
                            exr_stream_error_func_ptr_t complain)
{
    struct buffer *b = user;

    (void)context;
    (void)complain;
    if (offset + size > b->size) {
        size_t old = b->size;
        assert_non_null(buffer_append_space(b, offset + size - old));
        memset(b->data + old, 0, offset + size - old);
    }
    memcpy(b->data + offset, data, size);
    return (int64_t)size;
}

/* What a channel of this type holds: integers are the pattern times 64, which is whole. */
static float stored_value(exr_pixel_type_t type, uint32_t x, uint32_t y, int c)
{
    return type == EXR_PIXEL_UINT ? pattern(x, y, (uint32_t)c) * 64.0f : pattern(x, y, (uint32_t)c);
}

static void write_chunks(exr_context_t context, int part, const struct part_spec *spec, int width, int height)
{
    int32_t lines;

    assert_int_equal(exr_get_scanlines_per_chunk(context, part, &lines), EXR_ERR_SUCCESS);
    for (int y = 0; y < height; y += lines) {
        exr_encode_pipeline_t pipeline = EXR_ENCODE_PIPELINE_INITIALIZER;
        exr_chunk_info_t chunk;
        uint8_t *planes[8] = {0};

        assert_int_equal(exr_write_scanline_chunk_info(context, part, y, &chunk), EXR_ERR_SUCCESS);
        assert_int_equal(exr_encoding_initialize(context, part, &chunk, &pipeline), EXR_ERR_SUCCESS);
        for (int c = 0; c < pipeline.channel_count; c++) {
            exr_coding_channel_info_t *info = &pipeline.channels[c];
            size_t size = spec->types[c] == EXR_PIXEL_HALF ? 2 : 4;

            planes[c] = calloc((size_t)(width * chunk.height), size);
            for (int i = 0; i < width * chunk.height; i++) {
                float v =
                    stored_value(spec->types[c], (uint32_t)(i % width), (uint32_t)(y + i / width), spec->values[c]);
                uint32_t whole = (uint32_t)v;
                uint16_t half = half_from_float(v);
                const void *from = spec->types[c] == EXR_PIXEL_HALF    ? (const void *)&half
                                   : spec->types[c] == EXR_PIXEL_FLOAT ? (const void *)&v
                                                                       : (const void *)&whole;
                memcpy(planes[c] + (size_t)i * size, from, size);
            }
            info->user_bytes_per_element = (int16_t)size;
            info->user_data_type = info->data_type;
            info->user_pixel_stride = (int32_t)size;
            info->user_line_stride = (int32_t)size * width;
            info->encode_from_ptr = planes[c];
        }
        assert_int_equal(exr_encoding_choose_default_routines(context, part, &pipeline), EXR_ERR_SUCCESS);
        assert_int_equal(exr_encoding_run(context, part, &pipeline), EXR_ERR_SUCCESS);
        exr_encoding_destroy(context, &pipeline);
        for (int c = 0; c < 8; c++)
            free(planes[c]);
    }
}

static void write_parts(struct buffer *file, const struct part_spec *parts, int part_count, int width, int height,
                        exr_compression_t compression, const exr_attr_chromaticities_t *chroma, int cube)
{
    exr_context_initializer_t init = EXR_DEFAULT_CONTEXT_INITIALIZER;
    exr_context_t context;

    buffer_clear(file);
    init.write_fn = write_memory;
    init.user_data = file;
    assert_int_equal(exr_start_write(&context, "memory", EXR_WRITE_FILE_DIRECTLY, &init), EXR_ERR_SUCCESS);
    for (int p = 0; p < part_count; p++) {
        int index;

        assert_int_equal(exr_add_part(context, parts[p].name, parts[p].storage, &index),
                         EXR_ERR_SUCCESS);
        assert_int_equal(
            exr_initialize_required_attr_simple(context, index, width, height, compression),
            EXR_ERR_SUCCESS);
        for (int c = 0; c < 8 && parts[p].channels[c]; c++)
            assert_int_equal(exr_add_channel(context, index, parts[p].channels[c], parts[p].types[c],
                                             EXR_PERCEPTUALLY_LOGARITHMIC, 1, 1),
                             EXR_ERR_SUCCESS);
        if (chroma)
            assert_int_equal(exr_attr_set_chromaticities(context, index, "chromaticities", chroma), EXR_ERR_SUCCESS);
        if (cube)
            assert_int_equal(exr_attr_set_envmap(context, index, "envmap", EXR_ENVMAP_CUBE), EXR_ERR_SUCCESS);
    }
    assert_int_equal(exr_write_header(context), EXR_ERR_SUCCESS);
    for (int p = 0; p < part_count; p++)
        write_chunks(context, p, &parts[p], width, height);
    assert_int_equal(exr_finish(&context), EXR_ERR_SUCCESS);
}

static const struct part_spec mixed = {
    NULL, EXR_STORAGE_SCANLINE, {"A", "B", "G", "R", "Z"},
    {EXR_PIXEL_HALF, EXR_PIXEL_FLOAT, EXR_PIXEL_UINT, EXR_PIXEL_HALF, EXR_PIXEL_FLOAT},
    {3, 2, 1, 0, 4}};

static void test_mixed_types(void **state)
{
    static const exr_compression_t compressions[] = {
        EXR_COMPRESSION_NONE, EXR_COMPRESSION_RLE, EXR_COMPRESSION_ZIPS,
        EXR_COMPRESSION_ZIP,  EXR_COMPRESSION_PIZ, EXR_COMPRESSION_PXR24};
    struct buffer file = BUFFER_INIT;

    (void)state;
    for (size_t i = 0; i < sizeof compressions / sizeof *compressions; i++) {
        struct image out;

        write_parts(&file, &mixed, 1, 37, 41, compressions[i], NULL, 0);
        out = decode(&file);
        for (uint32_t y = 0; y < 41; y++)
            for (uint32_t x = 0; x < 37; x++) {
                const float *p = out.pixels + (y * 37 + x) * 3;
                assert_true(p[0] == pattern(x, y, 0));
                assert_true(p[1] == pattern(x, y, 1) * 64.0f);
                assert_true(p[2] == pattern(x, y, 2));
            }
        image_release(&out);
    }
    buffer_release(&file);
}

#define FLOATS {EXR_PIXEL_FLOAT, EXR_PIXEL_FLOAT, EXR_PIXEL_FLOAT, EXR_PIXEL_FLOAT, \
                EXR_PIXEL_FLOAT, EXR_PIXEL_FLOAT, EXR_PIXEL_FLOAT, EXR_PIXEL_FLOAT}

static void test_layers_and_parts(void **state)
{
    static const struct part_spec layers = {
        NULL, EXR_STORAGE_SCANLINE,
        {"View.AO.B", "View.AO.G", "View.AO.R", "View.Combined.B", "View.Combined.G",
         "View.Combined.R"},
        FLOATS, {5, 5, 5, 2, 1, 0}};
    static const struct part_spec other_layer = {
        NULL, EXR_STORAGE_SCANLINE, {"a.B", "a.G", "a.R", "b.R"}, FLOATS, {2, 1, 0, 5}};
    static const struct part_spec parts[2] = {
        {"depth", EXR_STORAGE_SCANLINE, {"Z"}, FLOATS, {5}},
        {"light", EXR_STORAGE_SCANLINE, {"B", "G", "R"}, FLOATS, {2, 1, 0}}};
    static const struct part_spec green = {NULL, EXR_STORAGE_SCANLINE, {"A", "G"}, FLOATS, {2, 1}};
    static const struct part_spec depth = {NULL, EXR_STORAGE_SCANLINE, {"Z", "id"}, FLOATS, {1, 2}};
    struct buffer file = BUFFER_INIT;
    struct error err = {0};
    struct image out;

    (void)state;
    write_parts(&file, &layers, 1, 9, 5, EXR_COMPRESSION_ZIP, NULL, 0);
    out = decode(&file);
    assert_true(worst(&out) == 0.0f);
    image_release(&out);
    write_parts(&file, &other_layer, 1, 9, 5, EXR_COMPRESSION_ZIP, NULL, 0);
    out = decode(&file);
    assert_true(worst(&out) == 0.0f);
    image_release(&out);
    write_parts(&file, parts, 2, 9, 5, EXR_COMPRESSION_ZIP, NULL, 0);
    out = decode(&file);
    assert_true(worst(&out) == 0.0f);
    image_release(&out);
    write_parts(&file, &green, 1, 9, 5, EXR_COMPRESSION_ZIP, NULL, 0);
    out = decode(&file);
    assert_true(out.pixels[0] == 0.0f && out.pixels[2] == 0.0f);
    assert_true(out.pixels[1] == pattern(0, 0, 1));
    image_release(&out);
    write_parts(&file, &depth, 1, 9, 5, EXR_COMPRESSION_ZIP, NULL, 0);
    assert_int_equal(exr_decode(&out, file.data, file.size, "depth.exr", &err), STATUS_ERR_UNSUPPORTED);
    assert_non_null(strstr(err.text, "depth.exr"));
    assert_null(out.pixels);
    write_parts(&file, &parts[1], 1, 9, 5, EXR_COMPRESSION_ZIP, NULL, 1);
    assert_int_equal(exr_decode(&out, file.data, file.size, "cube.exr", &err), STATUS_ERR_UNSUPPORTED);
    assert_non_null(strstr(err.text, "cube"));
    buffer_release(&file);
}

/* One channel is grey, whatever its name, and small letters are capitals. */
static void test_names_of_channels(void **state)
{
    static const char *const lone[] = {"R", "G", "A", "Z", "Y", "y", "r", "height", "layer.R", "layer.mask"};
    static const struct part_spec small = {NULL, EXR_STORAGE_SCANLINE, {"b", "g", "r"}, FLOATS, {2, 1, 0}};
    static const struct part_spec small_layer = {NULL, EXR_STORAGE_SCANLINE, {"l.b", "l.g", "l.r"}, FLOATS, {2, 1, 0}};
    struct buffer file = BUFFER_INIT;
    struct image out;

    (void)state;
    for (size_t i = 0; i < sizeof lone / sizeof *lone; i++) {
        const struct part_spec one = {NULL, EXR_STORAGE_SCANLINE, {lone[i]}, FLOATS, {1}};

        write_parts(&file, &one, 1, 9, 5, EXR_COMPRESSION_ZIP, NULL, 0);
        out = decode(&file);
        for (uint32_t p = 0; p < 9 * 5; p++)
            for (uint32_t c = 0; c < 3; c++)
                assert_true(out.pixels[3 * p + c] == pattern(p % 9, p / 9, 1));
        image_release(&out);
    }
    write_parts(&file, &small, 1, 9, 5, EXR_COMPRESSION_ZIP, NULL, 0);
    out = decode(&file);
    assert_true(worst(&out) == 0.0f);
    image_release(&out);
    write_parts(&file, &small_layer, 1, 9, 5, EXR_COMPRESSION_ZIP, NULL, 0);
    out = decode(&file);
    assert_true(worst(&out) == 0.0f);
    image_release(&out);
    buffer_release(&file);
}

/* Rec. 709 (0.25, 0.5, 0.75) as XYZ comes back as it was. */
static void test_chromaticities(void **state)
{
    static const exr_attr_chromaticities_t xyz = {1, 0, 0, 1, 0, 0, 1 / 3.0f, 1 / 3.0f};
    static const exr_attr_chromaticities_t flat = {0.5f, 0.5f, 0.5f, 0.5f, 0.5f, 0.5f, 0.3f, 0.3f};
    static const struct part_spec rgb = {
        NULL, EXR_STORAGE_SCANLINE, {"B", "G", "R"}, FLOATS, {2, 1, 0}};
    static const struct part_spec rgba = {
        NULL, EXR_STORAGE_SCANLINE, {"A", "B", "G", "R"}, FLOATS, {3, 2, 1, 0}};
    /* IEC 61966-2-1's inverse matrix. */
    static const double m[3][3] = {{3.2406, -1.5372, -0.4986}, {-0.9689, 1.8758, 0.0415},
                                   {0.0557, -0.2040, 1.0570}};
    struct buffer file = BUFFER_INIT;
    struct error err = {0};
    struct image out, clear;

    (void)state;
    write_parts(&file, &rgb, 1, 3, 2, EXR_COMPRESSION_ZIP, &xyz, 0);
    out = decode(&file);
    for (int c = 0; c < 3; c++) {
        double wanted = 0;
        for (uint32_t k = 0; k < 3; k++)
            wanted += m[c][k] * (double)pattern(0, 0, k);
        assert_true(fabs((double)out.pixels[c] - wanted) < 1e-3);
    }
    image_release(&out);
    /* With alpha the same colours, and alpha as it is. */
    write_parts(&file, &rgba, 1, 3, 2, EXR_COMPRESSION_ZIP, &xyz, 0);
    out = decode(&file);
    assert_int_equal(exr_decode_alpha(&clear, file.data, file.size, "x.exr", &err), STATUS_OK);
    assert_int_equal(clear.channels, 4);
    for (uint32_t i = 0; i < 6; i++) {
        assert_memory_equal(clear.pixels + 4 * i, out.pixels + 3 * i, 3 * sizeof(float));
        assert_true(clear.pixels[4 * i + 3] == pattern(i % 3, i / 3, 3));
    }
    image_release(&clear);
    image_release(&out);
    write_parts(&file, &rgb, 1, 3, 2, EXR_COMPRESSION_ZIP, &flat, 0);
    assert_int_equal(exr_decode(&out, file.data, file.size, "x.exr", &err), STATUS_ERR_INPUT);
    buffer_release(&file);
}

/* ---- damage ------------------------------------------------------------------------------ */

/* Every prefix of a file is refused; every changed byte is survived, and what is wrong is the file,
 * never the program or the machine's memory. */
static void damage(const struct buffer *file)
{
    uint8_t *copy;
    struct image out;
    struct error err;
    status st;

    for (size_t length = 0; length < file->size; length++) {
        copy = mem_memdup(file->data, length); /* exact size: the sanitizer sees over-reads */
        memset(&err, 0, sizeof err);
        assert_int_not_equal(exr_decode(&out, copy, length, "cut.exr", &err), STATUS_OK);
        assert_null(out.pixels);
        assert_non_null(strstr(err.text, "cut.exr"));
        mem_free(copy);
    }
    for (size_t at = 0; at < file->size; at++)
        for (int change = 0; change < 3; change++) {
            static const uint8_t changes[] = {0xff, 0x01, 0x80};

            copy = mem_memdup(file->data, file->size);
            copy[at] ^= changes[change];
            st = exr_decode(&out, copy, file->size, "bad.exr", NULL);
            if (st == STATUS_OK)
                image_release(&out);
            else
                assert_int_equal(status_exit_code(st), 3);
            mem_free(copy);
        }
}

static void test_damage(void **state)
{
    static const int compressions[] = {IMF_NO_COMPRESSION,  IMF_RLE_COMPRESSION,
                                       IMF_ZIP_COMPRESSION, IMF_PIZ_COMPRESSION,
                                       IMF_B44_COMPRESSION, IMF_PXR24_COMPRESSION};
    struct buffer file = BUFFER_INIT;

    (void)state;
    for (size_t i = 0; i < sizeof compressions / sizeof *compressions; i++) {
        write_rgba(&file, 9, 5, 0, 0, IMF_WRITE_RGB, compressions[i], IMF_INCREASING_Y);
        damage(&file);
    }
    buffer_release(&file);
}

static void test_damage_older_api(void **state)
{
    struct buffer file = BUFFER_INIT;

    (void)state;
    write_rgba(&file, 5, 3, 0, 0, IMF_WRITE_RGB, IMF_DWAA_COMPRESSION, IMF_INCREASING_Y);
    damage(&file);
    buffer_release(&file);
}

/* OpenEXRCore says that it is out of memory where a chunk's Huffman codes are damaged. A smaller
 * picture would be stored as it is. */
static void test_damaged_codes(void **state)
{
    struct buffer file = BUFFER_INIT;
    struct image out;
    int refused = 0;

    (void)state;
    write_rgba(&file, 61, 47, 0, 0, IMF_WRITE_RGB, IMF_PIZ_COMPRESSION, IMF_INCREASING_Y);
    for (size_t at = 330; at < file.size; at++) {
        uint8_t kept = file.data[at];
        status st;

        file.data[at] ^= 0xff;
        st = exr_decode(&out, file.data, file.size, "bad.exr", NULL);
        if (st == STATUS_OK)
            image_release(&out);
        else
            assert_int_equal(status_exit_code(st), 3);
        refused += st != STATUS_OK;
        file.data[at] = kept;
    }
    assert_true(refused > 100);
    buffer_release(&file);
}

/* A header that claims a gigapixel in a few hundred bytes costs no memory. */
static void test_size_bomb(void **state)
{
    struct image in = make_image(4, 4, 3), out;
    struct buffer file = BUFFER_INIT;
    struct error err = {0};
    uint8_t *window = NULL;
    const int32_t huge = 46339;

    (void)state;
    assert_int_equal(exr_encode(&file, &in, NULL, NULL), STATUS_OK);
    for (size_t i = 0; i + 40 < file.size && !window; i++)
        if (memcmp(file.data + i, "dataWindow\0box2i", 16) == 0)
            window = file.data + i + 17 + 4 + 8;
    assert_non_null(window);
    memcpy(window, &huge, 4);
    memcpy(window + 4, &huge, 4);
    assert_int_equal(exr_decode(&out, file.data, file.size, "bomb.exr", &err), STATUS_ERR_INPUT);
    assert_null(out.pixels);
    image_release(&in);
    buffer_release(&file);
}

/* Every allocation that fails is reported, and nothing leaks (the sanitizer looks). */
static void test_out_of_memory(void **state)
{
    struct image in = make_image(20, 20, 3), out;
    struct buffer file = BUFFER_INIT;
    long n;

    (void)state;
    for (n = 0;; n++) {
        status st;
        long failed;

        buffer_release(&file);
        mem_fault_arm(n, 1);
        st = exr_encode(&file, &in, NULL, NULL);
        failed = mem_fault_count();
        mem_fault_arm(-1, 0);
        if (failed == 0) {
            assert_int_equal(st, STATUS_OK);
            break;
        }
        assert_int_not_equal(st, STATUS_OK);
    }
    assert_true(n > 3);
    for (n = 0;; n++) {
        status st;
        long failed;

        mem_fault_arm(n, 1);
        st = exr_decode(&out, file.data, file.size, "x.exr", NULL);
        failed = mem_fault_count();
        mem_fault_arm(-1, 0);
        if (st == STATUS_OK) {
            image_release(&out);
            if (failed == 0)
                break;
        } else {
            assert_int_equal(st, STATUS_ERR_NO_MEMORY);
        }
    }
    assert_true(n > 3);
    image_release(&in);
    buffer_release(&file);
}

/* ---- more channels than the picture ------------------------------------------------------- */

enum { MORE_WIDTH = 21, MORE_HEIGHT = 37, MORE_COUNT = 4 };

static float more_value(uint32_t x, uint32_t y, uint32_t c)
{
    return 100000.5f * (float)c + (float)x + 0x1p-10f * (float)y;
}

static void fill_more(void *user UNUSED, uint32_t y, uint32_t height, float *planes)
{
    for (uint32_t c = 0; c < MORE_COUNT; c++)
        for (uint32_t line = 0; line < height; line++)
            for (uint32_t x = 0; x < MORE_WIDTH; x++)
                *planes++ = more_value(x, y + line, c);
}

static void more_lines(void *user, uint32_t y, uint32_t height, float *planes)
{
    atomic_uint *lines = user;

    assert_true(y % EXR_LINES == 0 && (height == EXR_LINES || y + height == MORE_HEIGHT));
    atomic_fetch_add(lines, height);
    fill_more(NULL, y, height, planes);
}

static void test_more_channels(void **state)
{
    static const struct exr_channel channels[MORE_COUNT] = {
        {"Z", 1}, {"albedo.R", 0}, {"Aa.X", 1}, {"P.X", 0}};

    (void)state;
    for (int half = 0; half < 2; half++) {
        struct image in = make_image(MORE_WIDTH, MORE_HEIGHT, 3), out;
        struct buffer file = BUFFER_INIT;
        atomic_uint lines = 0;
        uint64_t clamped;
        struct exr_channels more = {channels, MORE_COUNT, more_lines, &lines};
        struct exr_options options = {.half = half, .more = &more, .clamped = &clamped};
        struct error err = {0};
        assert_int_equal(exr_encode(&file, &in, &options, &err), STATUS_OK);
        assert_int_equal(lines, MORE_HEIGHT);
        assert_int_equal(exr_channel_count(file.data, file.size), 3 + MORE_COUNT);
        for (uint32_t c = 0; c < MORE_COUNT; c++) {
            int is_half;
            float *values = exr_channel_read(file.data, file.size, channels[c].name, &is_half);
            assert_non_null(values);
            assert_int_equal(is_half, half && !channels[c].precise);
            for (uint32_t y = 0; y < MORE_HEIGHT; y++)
                for (uint32_t x = 0; x < MORE_WIDTH; x++) {
                    float wanted = more_value(x, y, c);
                    assert_true(values[y * MORE_WIDTH + x] == (is_half ? fminf(wanted, 65504.0f) : wanted));
                }
            free(values);
        }
        /* Only the two that are halves and beyond their range. */
        assert_int_equal(clamped, half ? 2 * MORE_WIDTH * MORE_HEIGHT : 0);
        /* The picture is still found, and is what it was. */
        out = decode(&file);
        assert_memory_equal(out.pixels, in.pixels, MORE_WIDTH * MORE_HEIGHT * 3 * sizeof(float));
        image_release(&out);
        image_release(&in);
        buffer_release(&file);
    }
}

/* Higher than a batch of chunks, with values that are clamped: the same file for any number of threads. */
static void test_threads(void **state)
{
    static const struct exr_channel channels[MORE_COUNT] = {{"Z", 1}, {"albedo.R", 0}, {"Aa.X", 1}, {"P.X", 0}};
    enum { WIDTH = MORE_WIDTH, HEIGHT = 64 * EXR_LINES + MORE_HEIGHT };
    struct buffer first = BUFFER_INIT;
    struct image in = make_image(WIDTH, HEIGHT, 3);

    (void)state;
    for (unsigned threads = 1; threads < 8; threads += 3) {
        struct buffer file = BUFFER_INIT;
        uint64_t clamped;
        struct exr_channels more = {channels, MORE_COUNT, fill_more, NULL};
        struct exr_options options = {.half = 1, .more = &more, .clamped = &clamped, .threads = threads};
        assert_int_equal(exr_encode(&file, &in, &options, NULL), STATUS_OK);
        assert_int_equal(clamped, 2 * WIDTH * HEIGHT);
        if (threads == 1)
            buffer_append(&first, file.data, file.size);
        assert_int_equal(file.size, first.size);
        assert_memory_equal(file.data, first.data, file.size);
        buffer_release(&file);
    }
    buffer_release(&first);
    image_release(&in);
}

/* ---- a layer that is replaced ---------------------------------------------------------------- */

enum { LAYERED = 5, LAYER_WIDTH = 37, LAYER_HEIGHT = 2 * EXR_LINES + 5 };
static const struct exr_channel layered[LAYERED] = {{"Z", 1}, {"clean.R", 0}, {"clean.G", 0}, {"clean.B", 0}, {"P.X", 1}};
static const char *const layer_names[3] = {"clean.R", "clean.G", "clean.B"};

static float layer_value(int version, size_t pixel, uint32_t c) { return (float)(pixel % 91) * (version ? 0.37f : -1.9f) + (float)c; }

static void fill_layered(void *user, uint32_t y, uint32_t height, float *planes)
{
    const size_t pixels = (size_t)LAYER_WIDTH * height, first = (size_t)y * LAYER_WIDTH;

    for (size_t i = 0; i < pixels; i++) {
        planes[i] = 1 / (float)(first + i + 3);
        for (uint32_t c = 0; c < 3; c++)
            planes[(1 + c) * pixels + i] = layer_value(*(const int *)user, first + i, c);
        planes[4 * pixels + i] = (float)(first + i) * 1e7f; /* beyond a half */
    }
}

/* With what is replaced before and after what stays, or at the end. */
static void encode_layered(struct buffer *out, const struct image *image, int half, const struct exr_window *window, int version)
{
    static const double origin[3] = {1e300, -2, 3};
    static const float matrix[16] = {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 0.1f};
    static const int32_t rate[2] = {30000, 1001};
    const struct exr_attribute mine[2] = {{.name = "clean:error", .number = version ? 2.5 : 7}, {.name = "clean:by", .text = "means"}};
    const struct exr_attribute stays[4] = {{.name = "text", .text = "of two\nlines"}, {.name = "origin", .point = origin},
                                           {.name = "toWorld", .matrix = matrix}, {.name = "rate", .fraction = rate}};
    struct exr_attribute all[6];
    const struct exr_channels more = {layered, LAYERED, fill_layered, &version};
    const struct exr_options options = {.half = half, .window = window, .more = &more, .attributes = all, .attribute_count = 6};

    for (int i = 0; i < 4; i++)
        all[version ? i : i + 1] = stays[i];
    all[version ? 4 : 0] = mine[0];
    all[5] = mine[1];
    assert_int_equal(exr_encode(out, image, &options, NULL), STATUS_OK);
}

/* The file is to the bit what it would have been. */
static void test_replace(void **state)
{
    static const struct exr_window window = {LAYER_WIDTH + 20, LAYER_HEIGHT + 9, 13, 4};
    const struct exr_attribute attributes[2] = {{.name = "clean:error", .number = 2.5}, {.name = "clean:by", .text = "means"}};
    struct image layer = make_image(LAYER_WIDTH, LAYER_HEIGHT, 3);
    struct error err = {0};

    (void)state;
    for (size_t i = 0; i < (size_t)LAYER_WIDTH * LAYER_HEIGHT * 3; i++)
        layer.pixels[i] = layer_value(1, i / 3, i % 3);
    for (int kind = 0; kind < 8; kind++) {
        struct buffer before = BUFFER_INIT, after = BUFFER_INIT, wanted = BUFFER_INIT;
        struct image image = make_image(LAYER_WIDTH, LAYER_HEIGHT, kind & 4 ? 4 : 3);
        encode_layered(&before, &image, kind & 1, kind & 2 ? &window : NULL, 0);
        encode_layered(&wanted, &image, kind & 1, kind & 2 ? &window : NULL, 1);
        if (exr_replace(&after, before.data, before.size, "x", layer_names, &layer, "clean:", attributes, 2, &err) != STATUS_OK)
            fail_msg("%s", err.text);
        assert_int_equal(after.size, wanted.size);
        assert_memory_equal(after.data, wanted.data, after.size);
        buffer_clear(&after);
        assert_int_equal(exr_replace(&after, before.data, before.size / 2, "x", layer_names, &layer, "", NULL, 0, &err),
                         STATUS_ERR_INPUT);
        image_release(&image);
        buffer_release(&wanted);
        buffer_release(&after);
        buffer_release(&before);
    }
    image_release(&layer);
}

static void test_nothing_to_replace(void **state)
{
    struct image image = make_image(LAYER_WIDTH, LAYER_HEIGHT, 3), small = make_image(LAYER_WIDTH, LAYER_HEIGHT - 1, 3);
    struct buffer file = BUFFER_INIT, out = BUFFER_INIT;
    struct error err = {0};
    long n;

    (void)state;
    assert_int_equal(exr_encode(&file, &image, NULL, NULL), STATUS_OK);
    assert_int_equal(exr_replace(&out, file.data, file.size, "x", layer_names, &image, "", NULL, 0, &err), STATUS_ERR_NOT_FOUND);
    assert_non_null(strstr(err.text, "clean.R"));
    buffer_clear(&file);
    encode_layered(&file, &image, 0, NULL, 0);
    assert_int_equal(exr_replace(&out, file.data, file.size, "x", layer_names, &small, "", NULL, 0, &err), STATUS_ERR_INPUT);
    assert_int_equal(exr_replace(&out, file.data, 20, "x", layer_names, &image, "", NULL, 0, &err), STATUS_ERR_INPUT);
    assert_int_equal(out.size, 0);
    for (n = 0;; n++) { /* no memory anywhere */
        struct buffer into = BUFFER_INIT;
        status st;
        long failed;
        mem_fault_arm(n, 1);
        st = exr_replace(&into, file.data, file.size, "x", layer_names, &image, "", NULL, 0, NULL);
        failed = mem_fault_count();
        mem_fault_arm(-1, 0);
        buffer_release(&into);
        assert_true((st == STATUS_OK) == (failed == 0));
        if (failed == 0)
            break;
    }
    assert_true(n > 20);
    buffer_release(&file);
    image_release(&small);
    image_release(&image);
}

/* ---- halves, repairs --------------------------------------------------------------------- */

static void test_half_conversion(void **state)
{
    (void)state;
    for (uint32_t bits = 0; bits < 0x10000; bits++) {
        float value = half_to_float((uint16_t)bits);
        ImfHalf theirs;

        if (isnan(value)) {
            assert_true((bits & 0x7c00) == 0x7c00 && (bits & 0x3ff) != 0);
            continue;
        }
        assert_true(value == ImfHalfToFloat((ImfHalf)bits));
        assert_int_equal(half_from_float(value), bits);
        /* Halfway to the next, and a hair to either side of it: as OpenEXR rounds. */
        if ((bits & 0x7fff) < 0x7bff) {
            float next = half_to_float((uint16_t)(bits + 1)), middle = (value + next) / 2;
            const float probes[3] = {nextafterf(middle, value), middle, nextafterf(middle, next)};

            for (int i = 0; i < 3; i++) {
                ImfFloatToHalf(probes[i], &theirs);
                assert_int_equal(half_from_float(probes[i]), theirs);
            }
        }
    }
    assert_int_equal(half_from_float(65519.0f), 0x7bff);
    assert_int_equal(half_from_float(65520.0f), 0x7c00);
    assert_true(isnan(half_to_float(half_from_float(NAN))));
}

static void test_repairs(void **state)
{
    struct image in = make_image(5, 1, 3), out;
    struct image_repairs repairs = {0};
    struct buffer file = BUFFER_INIT;

    (void)state;
    in.pixels[0] = NAN;
    in.pixels[1] = NAN; /* one pixel, counted once */
    in.pixels[3] = -2.0f;
    in.pixels[7] = INFINITY;
    in.pixels[10] = -INFINITY;
    in.pixels[12] = 1234.0f;
    assert_int_equal(exr_encode(&file, &in, NULL, NULL), STATUS_OK);
    assert_int_equal(image_decode_hdr(&out, file.data, file.size, "x", &repairs, NULL), STATUS_OK);
    assert_int_equal(repairs.nan_pixels, 1);
    assert_int_equal(repairs.negative_pixels, 2);
    assert_int_equal(repairs.infinite_pixels, 1);
    assert_true(out.pixels[0] == 0 && out.pixels[1] == 0 && out.pixels[2] == in.pixels[2]);
    assert_true(out.pixels[3] == 0 && out.pixels[10] == 0);
    assert_true(out.pixels[7] == 1234.0f);
    image_release(&out);
    for (int i = 0; i < 15; i++)
        in.pixels[i] = i == 4 ? INFINITY : 0.0f;
    buffer_clear(&file);
    assert_int_equal(exr_encode(&file, &in, NULL, NULL), STATUS_OK);
    assert_int_equal(image_decode_hdr(&out, file.data, file.size, "x", NULL, NULL), STATUS_OK);
    assert_true(out.pixels[4] == 65504.0f);
    image_release(&out);
    image_release(&in);
    buffer_release(&file);
}

static void test_limits(void **state)
{
    struct image image;
    struct error err = {0};

    (void)state;
    assert_int_equal(image_init(&image, IMAGE_SIDE_MAX + 1, 1, 3, &err), STATUS_ERR_LIMIT);
    assert_int_equal(image_init(&image, IMAGE_SIDE_MAX, IMAGE_SIDE_MAX, 4, &err), STATUS_ERR_LIMIT);
    assert_int_equal(image_init(&image, 0, 5, 3, &err), STATUS_ERR_INPUT);
    assert_null(image.pixels);
    assert_int_equal(image_format_of((const uint8_t *)"", 0), IMAGE_UNKNOWN);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_round_trip),
        cmocka_unit_test(test_alpha),
        cmocka_unit_test(test_float_bits_kept),
        cmocka_unit_test(test_incompressible),
        cmocka_unit_test(test_half_clamps_and_counts),
        cmocka_unit_test(test_attributes),
        cmocka_unit_test(test_replace),
        cmocka_unit_test(test_nothing_to_replace),
        cmocka_unit_test(test_every_compression),
        cmocka_unit_test(test_luminance_and_chroma),
        cmocka_unit_test(test_tiles_and_levels),
        cmocka_unit_test(test_mixed_types),
        cmocka_unit_test(test_layers_and_parts),
        cmocka_unit_test(test_names_of_channels),
        cmocka_unit_test(test_chromaticities),
        cmocka_unit_test(test_damage),
        cmocka_unit_test(test_damage_older_api),
        cmocka_unit_test(test_damaged_codes),
        cmocka_unit_test(test_size_bomb),
        cmocka_unit_test(test_out_of_memory),
        cmocka_unit_test(test_more_channels),
        cmocka_unit_test(test_threads),
        cmocka_unit_test(test_half_conversion),
        cmocka_unit_test(test_repairs),
        cmocka_unit_test(test_limits),
    };
    return cmocka_run_group_tests_name("exr", tests, NULL, NULL);
}
