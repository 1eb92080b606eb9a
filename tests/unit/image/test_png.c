/* PNG: every kind that libpng writes comes back expanded; our encoder's dither is bounded
 * and keeps code values. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <png.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/buffer.h"
#include "common/base/memory.h"
#include "common/image/image.h"

static void write_bytes(png_structp png, png_bytep data, size_t size)
{
    buffer_append(png_get_io_ptr(png), data, size);
}

static void flush_nothing(png_structp png) { (void)png; }

/* What a packed sample (x, y, c) of `depth` bits holds. */
static unsigned sample(uint32_t x, uint32_t y, uint32_t c, int depth)
{
    return (x * 7 + y * 13 + c * 29 + 1) * 2654435761u >> 8 & ((1u << depth) - 1);
}

/* Write a picture of `sample` with libpng; palettes get entry i = (i, 255 - i, i / 2). */
static void write_png(struct buffer *out, uint32_t width, uint32_t height, int depth, int type, int interlaced,
                      int with_trns)
{
    png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, NULL, NULL, NULL);
    png_infop info = png_create_info_struct(png);
    uint32_t channels = type == PNG_COLOR_TYPE_RGB          ? 3
                        : type == PNG_COLOR_TYPE_RGB_ALPHA  ? 4
                        : type == PNG_COLOR_TYPE_GRAY_ALPHA ? 2
                                                            : 1;
    size_t row_bytes = ((size_t)width * channels * (size_t)depth + 7) / 8;
    uint8_t *pixels = calloc(height, row_bytes);
    png_bytep *rows = malloc(height * sizeof *rows);

    buffer_clear(out);
    assert_int_equal(setjmp(png_jmpbuf(png)), 0);
    png_set_write_fn(png, out, write_bytes, flush_nothing);
    png_set_IHDR(png, info, width, height, depth, type, interlaced ? PNG_INTERLACE_ADAM7 : PNG_INTERLACE_NONE,
                 PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
    png_set_gAMA(png, info, 1.0); /* to be ignored */
    if (type == PNG_COLOR_TYPE_PALETTE) {
        png_color palette[256];
        uint8_t alpha[256];
        for (int i = 0; i < 256; i++) {
            palette[i] = (png_color){(uint8_t)i, (uint8_t)(255 - i), (uint8_t)(i / 2)};
            alpha[i] = (uint8_t)(i * 3);
        }
        png_set_PLTE(png, info, palette, 1 << depth);
        if (with_trns)
            png_set_tRNS(png, info, alpha, 1 << depth, NULL);
    } else if (with_trns) {
        png_color_16 key = {0, (uint16_t)sample(0, 0, 0, depth), (uint16_t)sample(0, 0, 1, depth),
                            (uint16_t)sample(0, 0, 2, depth), (uint16_t)sample(0, 0, 0, depth)};
        png_set_tRNS(png, info, NULL, 0, &key);
    }
    for (uint32_t y = 0; y < height; y++) {
        rows[y] = pixels + y * row_bytes;
        for (uint32_t x = 0; x < width; x++)
            for (uint32_t c = 0; c < channels; c++) {
                size_t bit = ((size_t)x * channels + c) * (size_t)depth;
                unsigned v = sample(x, y, c, depth);

                if (depth == 16) {
                    rows[y][bit / 8] = (uint8_t)(v >> 8);
                    rows[y][bit / 8 + 1] = (uint8_t)v;
                } else {
                    rows[y][bit / 8] |= (uint8_t)(v << (8 - depth - (int)(bit % 8)));
                }
            }
    }
    png_write_info(png, info);
    png_write_image(png, rows);
    png_write_end(png, info);
    png_destroy_write_struct(&png, &info);
    free(rows);
    free(pixels);
}

static unsigned value_at(const struct image8 *image, uint32_t x, uint32_t y, uint32_t c)
{
    size_t at = ((size_t)y * image->width + x) * image->channels + c;
    uint16_t wide;

    if (image->bits == 8)
        return image->pixels[at];
    memcpy(&wide, image->pixels + 2 * at, 2);
    return wide;
}

static void check_kind(uint32_t width, uint32_t height, int depth, int type, int interlaced, int with_trns)
{
    struct buffer file = BUFFER_INIT;
    struct image8 image;
    struct error err = {0};
    uint32_t colors = type & PNG_COLOR_MASK_COLOR ? 3 : 1;
    int has_alpha = (type & PNG_COLOR_MASK_ALPHA) || with_trns;
    unsigned top = depth == 16 ? 65535 : 255;

    write_png(&file, width, height, depth, type, interlaced, with_trns);
    assert_int_equal(image_decode_8(&image, file.data, file.size, "x.png", &err), STATUS_OK);
    assert_int_equal(image.width, width);
    assert_int_equal(image.height, height);
    assert_int_equal(image.bits, depth == 16 ? 16 : 8);
    assert_int_equal(image.channels, colors + (has_alpha ? 1 : 0));
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++) {
            unsigned first = sample(x, y, 0, depth);
            int keyed = 1;

            for (uint32_t c = 0; c < colors; c++) {
                unsigned v = sample(x, y, c, depth), wanted;

                if (type == PNG_COLOR_TYPE_PALETTE)
                    wanted = c == 0 ? first : c == 1 ? 255 - first : first / 2;
                else
                    wanted = depth < 8 ? v * 255 / ((1u << depth) - 1) : v;
                assert_int_equal(value_at(&image, x, y, c), wanted);
                keyed = keyed && v == sample(0, 0, c, depth);
            }
            if (!has_alpha)
                continue;
            if (type == PNG_COLOR_TYPE_PALETTE)
                assert_int_equal(value_at(&image, x, y, 3), first * 3 & 255);
            else if (with_trns)
                assert_int_equal(value_at(&image, x, y, colors), keyed ? 0 : top);
            else
                assert_int_equal(value_at(&image, x, y, colors), sample(x, y, colors, depth));
        }
    image8_release(&image);
    buffer_release(&file);
}

static void test_every_kind(void **state)
{
    static const struct {
        int type, depths[6];
    } kinds[] = {{PNG_COLOR_TYPE_GRAY, {1, 2, 4, 8, 16}},
                 {PNG_COLOR_TYPE_PALETTE, {1, 2, 4, 8}},
                 {PNG_COLOR_TYPE_RGB, {8, 16}},
                 {PNG_COLOR_TYPE_GRAY_ALPHA, {8, 16}},
                 {PNG_COLOR_TYPE_RGB_ALPHA, {8, 16}}};
    static const uint32_t sizes[][2] = {{1, 1}, {1, 11}, {13, 1}, {37, 21}};

    (void)state;
    for (size_t k = 0; k < sizeof kinds / sizeof *kinds; k++)
        for (int d = 0; kinds[k].depths[d]; d++)
            for (size_t s = 0; s < 4; s++)
                for (int interlaced = 0; interlaced <= 1; interlaced++) {
                    check_kind(sizes[s][0], sizes[s][1], kinds[k].depths[d], kinds[k].type, interlaced, 0);
                    if (!(kinds[k].type & PNG_COLOR_MASK_ALPHA))
                        check_kind(sizes[s][0], sizes[s][1], kinds[k].depths[d], kinds[k].type, interlaced, 1);
                }
}

static struct image8 encode_and_decode(const struct image *in, struct buffer *file)
{
    struct image8 out;
    struct error err = {0};

    buffer_clear(file);
    assert_int_equal(png_encode(file, in, &err), STATUS_OK);
    assert_int_equal(png_decode(&out, file->data, file->size, "x.png", &err), STATUS_OK);
    assert_int_equal(out.channels, 3);
    assert_int_equal(out.bits, 8);
    return out;
}

/* Values that are codes already are not touched, wherever they stand. */
static void test_codes_survive(void **state)
{
    struct image in;
    struct buffer file = BUFFER_INIT;
    struct image8 out;

    (void)state;
    assert_int_equal(image_init(&in, 256, 67, 3, NULL), STATUS_OK);
    for (size_t i = 0; i < 256 * 67 * 3; i++)
        in.pixels[i] = (float)((i / 3 + i % 3 * 50) % 256) / 255.0f;
    out = encode_and_decode(&in, &file);
    for (size_t i = 0; i < 256 * 67 * 3; i++)
        assert_int_equal(out.pixels[i], (i / 3 + i % 3 * 50) % 256);
    image8_release(&out);
    image_release(&in);
    buffer_release(&file);
}

/* Between two codes both occur, in the right proportion, and never another one. */
static void test_dither(void **state)
{
    struct image in;
    struct buffer file = BUFFER_INIT;

    (void)state;
    assert_int_equal(image_init(&in, 64, 64, 3, NULL), STATUS_OK);
    for (int part = 1; part < 10; part++) {
        struct image8 out;
        double sum = 0;

        for (size_t i = 0; i < 64 * 64 * 3; i++)
            in.pixels[i] = (float)((100.0 + part / 10.0) / 255.0);
        out = encode_and_decode(&in, &file);
        for (size_t i = 0; i < 64 * 64 * 3; i++) {
            assert_in_range(out.pixels[i], 100, 101);
            assert_int_equal(out.pixels[i], out.pixels[i - i % 3]); /* grey stays grey */
            sum += out.pixels[i];
        }
        assert_true(fabs(sum / (64 * 64 * 3) - (100.0 + part / 10.0)) < 0.01);
        image8_release(&out);
    }
    image_release(&in);
    buffer_release(&file);
}

/* 16 bits keep what 8 cannot; rounding gives the nearest code. */
static void test_sixteen_bits_and_rounding(void **state)
{
    static const struct picture_options ways[] = {{.bits = 16}, {.bits = 16, .plain = 1},
                                                  {.plain = 1}};
    struct buffer file = BUFFER_INIT;
    struct image in;

    (void)state;
    assert_int_equal(image_init(&in, 61, 31, 3, NULL), STATUS_OK);
    for (size_t i = 0; i < 61 * 31 * 3; i++)
        in.pixels[i] = (float)i / (61 * 31 * 3 - 1);
    for (size_t w = 0; w < sizeof ways / sizeof *ways; w++) {
        double most = ways[w].bits == 16 ? 65535 : 255, allowed = ways[w].plain ? 0.5 : 1;
        struct image8 out;

        buffer_clear(&file);
        assert_int_equal(png_encode_as(&file, &in, &ways[w], NULL), STATUS_OK);
        assert_int_equal(png_decode(&out, file.data, file.size, "x.png", NULL), STATUS_OK);
        assert_int_equal(out.bits, ways[w].bits == 16 ? 16 : 8);
        for (size_t i = 0; i < 61 * 31 * 3; i++) {
            uint16_t code = out.pixels[i * out.bits / 8];
            if (out.bits == 16)
                memcpy(&code, out.pixels + 2 * i, 2);
            assert_true(fabs(code - (double)in.pixels[i] * most) <= allowed + 1e-6);
        }
        image8_release(&out);
    }
    image_release(&in);
    buffer_release(&file);
}

/* A fast file has the same pixels; texts stand in it, and change nothing else. */
static void test_fast_files_and_texts(void **state)
{
    static const struct picture_text texts[] = {{"azulejo:covered", "0.5"}, {"Comment", "two"}};
    static const struct picture_options usual, ways[] = {
        {.fast = 1}, {.texts = texts, .text_count = 2}, {.bits = 16, .fast = 1}};
    struct image in;
    struct buffer first = BUFFER_INIT, file = BUFFER_INIT;

    (void)state;
    assert_int_equal(image_init(&in, 61, 31, 3, NULL), STATUS_OK);
    for (size_t i = 0; i < 61 * 31 * 3; i++)
        in.pixels[i] = (float)(i % 97) / 97;
    for (size_t w = 0; w < sizeof ways / sizeof *ways; w++) {
        struct picture_options slow = usual;
        struct image8 one, other;
        slow.bits = ways[w].bits;
        buffer_clear(&first);
        buffer_clear(&file);
        assert_int_equal(png_encode_as(&first, &in, &slow, NULL), STATUS_OK);
        assert_int_equal(png_encode_as(&file, &in, &ways[w], NULL), STATUS_OK);
        assert_int_equal(png_decode(&one, first.data, first.size, "x.png", NULL), STATUS_OK);
        assert_int_equal(png_decode(&other, file.data, file.size, "x.png", NULL), STATUS_OK);
        assert_int_equal(one.bits, other.bits);
        assert_memory_equal(one.pixels, other.pixels, (size_t)61 * 31 * 3 * one.bits / 8);
        assert_int_equal(memmem(file.data, file.size, "tEXtazulejo:covered\0" "0.5", 23) != NULL,
                         ways[w].text_count > 0);
        image8_release(&one);
        image8_release(&other);
    }
    image_release(&in);
    buffer_release(&first);
    buffer_release(&file);
}

/* Rows for which each filter is the best one come back, also where several threads filter them. */
static void test_every_filter(void **state)
{
    enum { WIDTH = 1024, HEIGHT = 300, ROW = WIDTH * 3 };
    struct image8 in, out;
    struct buffer file = BUFFER_INIT;
    uint32_t random = 1;

    (void)state;
    assert_int_equal(image8_init(&in, WIDTH, HEIGHT, 3, 8, NULL), STATUS_OK);
    for (size_t i = 0; i < (size_t)HEIGHT * ROW; i++) {
        size_t y = i / ROW, x = i % ROW;
        uint8_t left = x >= 3 ? in.pixels[i - 3] : 0, up = y ? in.pixels[i - ROW] : 0;
        uint8_t corner = x >= 3 && y ? in.pixels[i - ROW - 3] : 0;
        const uint8_t likely[5] = {0, left, up, (uint8_t)((left + up) / 2), (uint8_t)(left + up - corner)};
        random = random * 1664525 + 1013904223;
        in.pixels[i] = (uint8_t)(likely[y / 7 % 5] + (random >> 24 & 3));
    }
    assert_int_equal(png_encode_8(&file, &in, 0, NULL), STATUS_OK);
    assert_true(file.size < (size_t)HEIGHT * ROW * 2 / 5); /* two bits a byte are random */
    assert_int_equal(png_decode(&out, file.data, file.size, "x.png", NULL), STATUS_OK);
    assert_memory_equal(out.pixels, in.pixels, (size_t)HEIGHT * ROW);
    image8_release(&out);
    image8_release(&in);
    buffer_release(&file);
}

static void test_hostile_values_and_repeatability(void **state)
{
    static const float values[] = {NAN, INFINITY, -INFINITY, -1.0f, 2.0f, 1e30f, 0.0f, 1.0f, 0.5f};
    static const int wanted[] = {0, 255, 0, 0, 255, 255, 0, 255, -1};
    struct image in;
    struct buffer file = BUFFER_INIT, again = BUFFER_INIT;
    struct image8 out;

    (void)state;
    assert_int_equal(image_init(&in, 3, 1, 3, NULL), STATUS_OK);
    memcpy(in.pixels, values, sizeof values);
    out = encode_and_decode(&in, &file);
    for (int i = 0; i < 9; i++)
        if (wanted[i] >= 0)
            assert_int_equal(out.pixels[i], wanted[i]);
    assert_in_range(out.pixels[8], 127, 128);
    assert_int_equal(png_encode(&again, &in, NULL), STATUS_OK);
    assert_int_equal(file.size, again.size);
    assert_memory_equal(file.data, again.data, file.size);
    /* An sRGB chunk says how the codes are meant. */
    assert_memory_equal(file.data + 37, "sRGB", 4);
    image8_release(&out);
    image_release(&in);
    buffer_release(&file);
    buffer_release(&again);
}

static void test_damage(void **state)
{
    struct buffer file = BUFFER_INIT;

    (void)state;
    for (int interlaced = 0; interlaced <= 1; interlaced++) {
        write_png(&file, 9, 7, 8, PNG_COLOR_TYPE_PALETTE, interlaced, 1);
        for (size_t length = 0; length < file.size; length++) {
            uint8_t *copy = mem_memdup(file.data, length);
            struct image8 image;
            struct error err = {0};

            assert_int_not_equal(png_decode(&image, copy, length, "cut.png", &err), STATUS_OK);
            assert_null(image.pixels);
            assert_non_null(strstr(err.text, "cut.png"));
            mem_free(copy);
        }
        for (size_t at = 0; at < file.size; at++) {
            uint8_t *copy = mem_memdup(file.data, file.size);
            struct image8 image;

            copy[at] ^= 0x55;
            if (png_decode(&image, copy, file.size, "bad.png", NULL) == STATUS_OK)
                image8_release(&image);
            mem_free(copy);
        }
    }
    buffer_release(&file);
}

/* A header that claims 100 000 x 100 000 pixels, checksum and all. */
static void test_size_bomb(void **state)
{
    static const uint8_t bomb[] = {
        0x89, 'P', 'N', 'G', 13, 10, 26, 10, 0, 0, 0, 13, 'I', 'H', 'D', 'R', 0, 1, 0x86, 0xa0,
        0, 1, 0x86, 0xa0, 8, 2, 0, 0, 0, 0x89, 0x8a, 0x34, 0x26, 0, 0, 0, 0, 'I', 'D', 'A', 'T',
        0x35, 0xaf, 0x06, 0x1e};
    uint8_t file[sizeof bomb];
    uint32_t crc = 0xffffffffu;
    struct image8 image;
    struct error err = {0};

    (void)state;
    memcpy(file, bomb, sizeof bomb);
    for (int i = 12; i < 29; i++) { /* the right checksum of IHDR */
        crc ^= file[i];
        for (int bit = 0; bit < 8; bit++)
            crc = crc >> 1 ^ (crc & 1 ? 0xedb88320u : 0);
    }
    crc = ~crc;
    for (int i = 0; i < 4; i++)
        file[29 + i] = (uint8_t)(crc >> (24 - 8 * i));
    assert_int_equal(png_decode(&image, file, sizeof file, "bomb.png", &err), STATUS_ERR_INPUT);
    assert_non_null(strstr(err.text, "100000 x 100000"));
    assert_null(image.pixels);
}

static void test_out_of_memory(void **state)
{
    struct buffer file = BUFFER_INIT;
    struct image8 image;
    struct image plain;
    long n, failed;
    status st;

    (void)state;
    write_png(&file, 9, 7, 8, PNG_COLOR_TYPE_PALETTE, 1, 1);
    for (n = 0;; n++) {
        mem_fault_arm(n, 1);
        st = png_decode(&image, file.data, file.size, "x.png", NULL);
        failed = mem_fault_count();
        mem_fault_arm(-1, 0);
        if (st == STATUS_OK)
            image8_release(&image);
        if (failed == 0)
            break;
    }
    assert_int_equal(st, STATUS_OK);
    assert_true(n > 3);
    assert_int_equal(image_init(&plain, 20, 20, 3, NULL), STATUS_OK);
    for (n = 0;; n++) {
        buffer_release(&file);
        mem_fault_arm(n, 1);
        st = png_encode(&file, &plain, NULL);
        failed = mem_fault_count();
        mem_fault_arm(-1, 0);
        if (failed == 0)
            break;
        assert_int_equal(st, STATUS_ERR_NO_MEMORY);
    }
    assert_int_equal(st, STATUS_OK);
    assert_true(n > 3);
    image_release(&plain);
    buffer_release(&file);
}

/* Textures keep their channels, and their codes to the bit, and claim no colour space. */
static void test_textures_survive(void **state)
{
    struct error err = {0};

    (void)state;
    for (uint32_t channels = 1; channels <= 4; channels++)
        for (uint32_t bits = 8; bits <= 16; bits += 8) {
            const uint32_t top = bits == 16 ? 65535 : 255, count = 7 * 5 * channels;
            struct image in;
            struct image8 first, second;
            struct buffer file = BUFFER_INIT, again = BUFFER_INIT;
            assert_int_equal(image_init(&in, 7, 5, channels, NULL), STATUS_OK);
            for (uint32_t i = 0; i < count; i++)
                in.pixels[i] = (float)(i * 5077 % (top + 1)) / (float)top;
            in.pixels[1] = NAN;
            in.pixels[2] = -1;
            in.pixels[3] = 2;
            assert_int_equal(png_encode_texture(&file, &in, (int)bits, &err), STATUS_OK);
            assert_null(memmem(file.data, file.size, "sRGB", 4));
            assert_int_equal(png_decode(&first, file.data, file.size, "x", &err), STATUS_OK);
            assert_true(first.channels == channels && first.bits == bits);
            assert_int_equal(png_encode_8(&again, &first, 0, &err), STATUS_OK);
            assert_int_equal(png_decode(&second, again.data, again.size, "x", &err), STATUS_OK);
            for (uint32_t i = 0; i < count; i++) {
                uint32_t expected = i == 1 || i == 2 ? 0 : i == 3 ? top : i * 5077 % (top + 1);
                uint16_t deep;
                memcpy(&deep, first.pixels + (bits == 16 ? 2 * i : 0), sizeof deep);
                assert_int_equal(bits == 16 ? deep : first.pixels[i], expected);
            }
            assert_memory_equal(first.pixels, second.pixels, count * bits / 8);
            image_release(&in);
            image8_release(&first);
            image8_release(&second);
            buffer_release(&file);
            buffer_release(&again);
        }
}

/* Every way to write a picture with alpha: its colours are those of the picture without, and its alpha is the nearest
 * code, whatever the bits and whether colours are dithered; at 16 bits both bytes count. */
static void test_alpha_beside_colours(void **state)
{
    enum { W = 257, H = 5, COUNT = W * H };
    struct image with, without;

    (void)state;
    assert_int_equal(image_init(&with, W, H, 4, NULL), STATUS_OK);
    assert_int_equal(image_init(&without, W, H, 3, NULL), STATUS_OK);
    for (size_t i = 0; i < COUNT * 4; i++) {
        with.pixels[i] = (float)(i * 7919 % 65521) / 65520;
        if (i % 4 < 3)
            without.pixels[i / 4 * 3 + i % 4] = with.pixels[i];
    }
    with.pixels[3] = 1;
    with.pixels[7] = 0;
    with.pixels[11] = 1.0f / 256;
    with.pixels[15] = NAN;
    for (unsigned way = 0; way < 8; way++) {
        const struct picture_options how = {.bits = way & 1 ? 16 : 8, .plain = way >> 1 & 1, .fast = way >> 2 & 1};
        const size_t bytes = way & 1 ? 2 : 1;
        struct buffer files[2] = {BUFFER_INIT, BUFFER_INIT};
        struct image8 a, b;
        assert_int_equal(png_encode_as(&files[0], &with, &how, NULL), STATUS_OK);
        assert_int_equal(png_encode_as(&files[1], &without, &how, NULL), STATUS_OK);
        assert_int_equal(png_decode(&a, files[0].data, files[0].size, "x", NULL), STATUS_OK);
        assert_int_equal(png_decode(&b, files[1].data, files[1].size, "x", NULL), STATUS_OK);
        assert_true(a.channels == 4 && b.channels == 3 && a.bits == bytes * 8 && b.bits == bytes * 8);
        for (size_t i = 0; i < COUNT; i++) {
            float alpha = i == 3 ? 0 : with.pixels[4 * i + 3];
            uint16_t code = a.pixels[4 * i + 3];
            assert_memory_equal(a.pixels + 4 * i * bytes, b.pixels + 3 * i * bytes, 3 * bytes);
            if (bytes == 2)
                memcpy(&code, a.pixels + 8 * i + 6, 2);
            assert_true(fabs(code - (double)alpha * (bytes == 2 ? 65535 : 255)) < 0.51);
        }
        image8_release(&a);
        image8_release(&b);
        buffer_release(&files[0]);
        buffer_release(&files[1]);
    }
    image_release(&with);
    image_release(&without);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_every_kind),
        cmocka_unit_test(test_codes_survive),
        cmocka_unit_test(test_textures_survive),
        cmocka_unit_test(test_alpha_beside_colours),
        cmocka_unit_test(test_dither),
        cmocka_unit_test(test_sixteen_bits_and_rounding),
        cmocka_unit_test(test_fast_files_and_texts),
        cmocka_unit_test(test_every_filter), cmocka_unit_test(test_hostile_values_and_repeatability),
        cmocka_unit_test(test_damage),
        cmocka_unit_test(test_size_bomb),
        cmocka_unit_test(test_out_of_memory),
    };
    return cmocka_run_group_tests_name("png", tests, NULL, NULL);
}
