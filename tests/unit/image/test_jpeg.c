/* JPEG: files written by libjpeg in every colour space that we promise to read. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <jpeglib.h>

#include "common/base/buffer.h"
#include "common/base/memory.h"
#include "common/image/image.h"

struct jpeg_file {
    unsigned char *data;
    unsigned long size;
};

/* A smooth picture; channel c of pixel (x, y). */
static uint8_t smooth(uint32_t x, uint32_t y, uint32_t c) { return (uint8_t)(40 + x * 3 + y * 2 + c * 30); }

static struct jpeg_file write_jpeg(uint32_t width, uint32_t height, J_COLOR_SPACE in, J_COLOR_SPACE stored,
                                   int progressive, int adobe, int arithmetic)
{
    struct jpeg_compress_struct c;
    struct jpeg_error_mgr errors;
    struct jpeg_file file = {NULL, 0};
    int components = in == JCS_GRAYSCALE ? 1 : in == JCS_RGB ? 3 : 4;
    uint8_t *row = malloc((size_t)width * (size_t)components);

    c.err = jpeg_std_error(&errors);
    jpeg_create_compress(&c);
    jpeg_mem_dest(&c, &file.data, &file.size);
    c.image_width = width;
    c.image_height = height;
    c.input_components = components;
    c.in_color_space = in;
    jpeg_set_defaults(&c);
    jpeg_set_colorspace(&c, stored);
    jpeg_set_quality(&c, 98, TRUE);
    c.write_Adobe_marker = adobe;
    c.arith_code = arithmetic;
    if (progressive)
        jpeg_simple_progression(&c);
    jpeg_start_compress(&c, TRUE);
    for (uint32_t y = 0; y < height; y++) {
        JSAMPROW rows[1] = {row};

        for (uint32_t x = 0; x < width; x++)
            for (int k = 0; k < components; k++)
                row[x * (uint32_t)components + (uint32_t)k] = smooth(x, y, (uint32_t)k);
        jpeg_write_scanlines(&c, rows, 1);
    }
    jpeg_finish_compress(&c);
    jpeg_destroy_compress(&c);
    free(row);
    return file;
}

static struct image8 decode(const struct jpeg_file *file)
{
    struct image8 image;
    struct error err = {0};
    status st = image_decode_8(&image, file->data, file->size, "x.jpg", &err);

    if (st != STATUS_OK)
        print_error("%s\n", err.text);
    assert_int_equal(st, STATUS_OK);
    assert_int_equal(image.bits, 8);
    return image;
}

static void test_grey_and_rgb(void **state)
{
    static const uint32_t sizes[][2] = {{1, 1}, {1, 9}, {17, 1}, {33, 21}};

    (void)state;
    for (size_t s = 0; s < 4; s++)
        for (int kind = 0; kind < 3; kind++)
            for (int progressive = 0; progressive <= 1; progressive++)
                for (int arithmetic = 0; arithmetic <= 1; arithmetic++) {
                    static const J_COLOR_SPACE spaces[3][2] = {{JCS_GRAYSCALE, JCS_GRAYSCALE},
                                                               {JCS_RGB, JCS_YCbCr},
                                                               {JCS_RGB, JCS_RGB}};
                    struct jpeg_file file =
                        write_jpeg(sizes[s][0], sizes[s][1], spaces[kind][0], spaces[kind][1],
                                   progressive, kind == 2, arithmetic);
                    struct image8 image = decode(&file);

                    assert_int_equal(image.width, sizes[s][0]);
                    assert_int_equal(image.height, sizes[s][1]);
                    assert_int_equal(image.channels, kind == 0 ? 1 : 3);
                    for (uint32_t y = 0; y < image.height; y++)
                        for (uint32_t x = 0; x < image.width; x++)
                            for (uint32_t c = 0; c < image.channels; c++) {
                                int have = image.pixels[(y * image.width + x) * image.channels + c];
                                assert_true(abs(have - smooth(x, y, c)) <= 6);
                            }
                    image8_release(&image);
                    free(file.data);
                }
}

/* Inks: with an Adobe marker the stored values are inverted. */
static void test_four_inks(void **state)
{
    (void)state;
    for (int ycck = 0; ycck <= 1; ycck++)
        for (int adobe = 0; adobe <= 1; adobe++) {
            struct jpeg_file file;
            struct image8 image;

            if (ycck && !adobe)
                continue; /* without the marker YCCK cannot be told from CMYK */
            file = write_jpeg(25, 17, JCS_CMYK, ycck ? JCS_YCCK : JCS_CMYK, 0, adobe, 0);
            image = decode(&file);
            assert_int_equal(image.channels, 3);
            for (uint32_t y = 0; y < 17; y++)
                for (uint32_t x = 0; x < 25; x++)
                    for (uint32_t c = 0; c < 3; c++) {
                        int ink = smooth(x, y, c), black = smooth(x, y, 3);
                        int wanted = adobe ? ink * black / 255 : (255 - ink) * (255 - black) / 255;
                        int have = image.pixels[(y * 25 + x) * 3 + c];
                        assert_true(abs(have - wanted) <= 8);
                    }
            image8_release(&image);
            free(file.data);
        }
}

static void test_damage(void **state)
{
    (void)state;
    for (int progressive = 0; progressive <= 1; progressive++) {
        struct jpeg_file file = write_jpeg(19, 13, JCS_RGB, JCS_YCbCr, progressive, 0, 0);

        for (size_t length = 0; length < file.size; length++) {
            uint8_t *copy = mem_memdup(file.data, length);
            struct image8 image;
            struct error err = {0};

            assert_int_not_equal(jpeg_decode(&image, copy, length, "cut.jpg", &err), STATUS_OK);
            assert_null(image.pixels);
            assert_non_null(strstr(err.text, "cut.jpg"));
            mem_free(copy);
        }
        for (size_t at = 0; at < file.size; at++) {
            uint8_t *copy = mem_memdup(file.data, file.size);
            struct image8 image;

            copy[at] ^= 0x41;
            if (jpeg_decode(&image, copy, file.size, "bad.jpg", NULL) == STATUS_OK)
                image8_release(&image);
            mem_free(copy);
        }
        free(file.data);
    }
}

/* The frame header's size is raised to 65500 x 65500: refused before memory is taken. */
static void test_size_bomb(void **state)
{
    struct jpeg_file file = write_jpeg(16, 16, JCS_RGB, JCS_YCbCr, 0, 0, 0);
    struct image8 image;
    struct error err = {0};
    size_t at = 0;

    (void)state;
    while (at + 9 < file.size && !(file.data[at] == 0xff && file.data[at + 1] == 0xc0))
        at++;
    assert_true(at + 9 < file.size);
    file.data[at + 5] = file.data[at + 7] = 0xff;
    file.data[at + 6] = file.data[at + 8] = 0xdc;
    assert_int_equal(jpeg_decode(&image, file.data, file.size, "bomb.jpg", &err), STATUS_ERR_INPUT);
    assert_non_null(strstr(err.text, "65500 x 65500"));
    free(file.data);
}

/* What is written reads back about the same, colours in full resolution; twice the same bytes; a
 * higher quality is closer; NaN and what is beyond 0..1 are cut off. */
static void test_writing(void **state)
{
    struct buffer file = BUFFER_INIT, again = BUFFER_INIT;
    double errors[2] = {0};
    struct image in;
    struct error err = {0};

    (void)state;
    assert_int_equal(image_init(&in, 40, 24, 3, NULL), STATUS_OK);
    for (uint32_t y = 0; y < 24; y++)
        for (uint32_t x = 0; x < 40; x++)
            for (uint32_t c = 0; c < 3; c++) /* a red and a green stripe, one pixel wide each */
                in.pixels[(y * 40 + x) * 3 + c] = c == x % 2 ? 0.8f : 0.3f;
    for (int i = 0; i < 2; i++) {
        struct picture_options how = {.quality = i ? 100 : 50};
        struct image8 out;

        buffer_clear(&file);
        buffer_clear(&again);
        assert_int_equal(jpeg_encode(&file, &in, &how, &err), STATUS_OK);
        assert_int_equal(jpeg_encode(&again, &in, &how, &err), STATUS_OK);
        assert_int_equal(file.size, again.size);
        assert_memory_equal(file.data, again.data, file.size);
        assert_int_equal(jpeg_decode(&out, file.data, file.size, "x.jpg", &err), STATUS_OK);
        assert_int_equal(out.width, 40);
        assert_int_equal(out.height, 24);
        for (size_t k = 0; k < 40 * 24 * 3; k++) {
            double off = out.pixels[k] - 255.0 * (double)in.pixels[k];
            errors[i] += off * off / (40 * 24 * 3);
        }
        image8_release(&out);
    }
    assert_true(errors[1] < 4); /* half the colours would be lost in 4:2:0 */
    assert_true(errors[0] > 2 * errors[1]);
    in.pixels[0] = -1;
    in.pixels[1] = 0.0f / 0.0f;
    in.pixels[2] = 1e30f;
    buffer_clear(&file);
    assert_int_equal(jpeg_encode(&file, &in, &(struct picture_options){0}, &err), STATUS_OK);
    image_release(&in);
    assert_int_equal(image_init(&in, 65501, 1, 3, NULL), STATUS_OK);
    assert_int_equal(jpeg_encode(&file, &in, &(struct picture_options){0}, &err), STATUS_ERR_LIMIT);
    assert_non_null(strstr(err.text, "65500"));
    image_release(&in);
    buffer_release(&file);
    buffer_release(&again);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_grey_and_rgb),
        cmocka_unit_test(test_four_inks),
        cmocka_unit_test(test_damage),
        cmocka_unit_test(test_size_bomb),
        cmocka_unit_test(test_writing),
    };
    return cmocka_run_group_tests_name("jpeg", tests, NULL, NULL);
}
