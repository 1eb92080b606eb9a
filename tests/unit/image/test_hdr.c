/* Radiance pictures, written here byte by byte: all three codings, all eight orientations,
 * exposure, XYZ, and damage. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "common/base/buffer.h"
#include "common/base/memory.h"
#include "common/image/image.h"

/* A pixel that tells where it is: the mantissas begin at 3, because a pixel
 * that begins with (2, 2) announces the new run-length code. */
static void encoded(uint32_t x, uint32_t y, uint8_t out[4])
{
    out[0] = (uint8_t)(x % 120 + 3);
    out[1] = (uint8_t)(y % 120 + 3);
    out[2] = (uint8_t)((x / 7) % 3 * 50);
    out[3] = 136; /* mantissa * 1 */
}

static void check(const struct image *image)
{
    for (uint32_t y = 0; y < image->height; y++)
        for (uint32_t x = 0; x < image->width; x++) {
            const float *p = image->pixels + ((size_t)y * image->width + x) * 3;
            uint8_t e[4];

            encoded(x, y, e);
            assert_true(p[0] == (float)e[0] && p[1] == (float)e[1] && p[2] == (float)e[2]);
        }
}

static struct image decode(const struct buffer *file)
{
    struct image_repairs repairs = {0};
    struct image image;
    struct error err = {0};
    status st = hdr_decode(&image, file->data, file->size, "test.hdr", &repairs, &err);

    if (st != STATUS_OK)
        print_error("%s\n", err.text);
    assert_int_equal(st, STATUS_OK);
    return image;
}

enum coding { FLAT, OLD_RLE, NEW_RLE };

static void append_flat(struct buffer *b, const uint8_t *line, uint32_t length)
{
    buffer_append(b, line, (size_t)length * 4);
}

/* Runs of equal pixels as (1, 1, 1, n), long ones in several digits of 256. */
static void append_old(struct buffer *b, const uint8_t *line, uint32_t length)
{
    for (uint32_t x = 0; x < length;) {
        uint32_t run = 1, rest;

        while (x + run < length && memcmp(line + 4 * x, line + 4 * (x + run), 4) == 0)
            run++;
        buffer_append(b, line + 4 * x, 4);
        for (rest = run - 1; rest > 0; rest >>= 8) {
            const uint8_t code[4] = {1, 1, 1, (uint8_t)rest};
            buffer_append(b, code, 4);
        }
        x += run;
    }
}

static void append_new(struct buffer *b, const uint8_t *line, uint32_t length)
{
    const uint8_t start[4] = {2, 2, (uint8_t)(length >> 8), (uint8_t)length};

    buffer_append(b, start, 4);
    for (uint32_t c = 0; c < 4; c++)
        for (uint32_t x = 0; x < length;) {
            uint32_t run = 1;

            while (x + run < length && run < 127 && line[4 * (x + run) + c] == line[4 * x + c])
                run++;
            if (run > 2) {
                const uint8_t code[2] = {(uint8_t)(128 + run), line[4 * x + c]};
                buffer_append(b, code, 2);
                x += run;
            } else { /* one literal at a time: legal, and exercises that path */
                const uint8_t code[2] = {1, line[4 * x + c]};
                buffer_append(b, code, 2);
                x++;
            }
        }
}

/* The picture of `encoded` with a given header and resolution line. */
static void write_file(struct buffer *b, const char *header, const char *order, uint32_t width, uint32_t height,
                       enum coding coding)
{
    int y_major = order[1] == 'Y';
    uint32_t lines = y_major ? height : width, length = y_major ? width : height;
    uint8_t *line = mem_alloc_array(length, 4);

    buffer_clear(b);
    /* `order` is like "-Y+X". */
    buffer_printf(b, "#?RADIANCE\n%s\n%.2s %u %.2s %u\n", header, order, lines, order + 2, length);
    for (uint32_t i = 0; i < lines; i++) {
        for (uint32_t j = 0; j < length; j++) {
            uint32_t x = y_major ? j : i, y = y_major ? i : j;

            if (strstr(order, "-X"))
                x = width - 1 - x;
            if (strstr(order, "+Y"))
                y = height - 1 - y;
            encoded(x, y, line + 4 * j);
        }
        if (coding == FLAT)
            append_flat(b, line, length);
        else if (coding == OLD_RLE)
            append_old(b, line, length);
        else
            append_new(b, line, length);
    }
    mem_free(line);
}

#define RGBE_HEADER "FORMAT=32-bit_rle_rgbe\n"

static void test_codings_and_sizes(void **state)
{
    static const uint32_t sizes[][2] = {{1, 1}, {1, 9}, {9, 1}, {7, 5}, {8, 3}, {130, 4}, {600, 2}};
    struct buffer b = BUFFER_INIT;

    (void)state;
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++)
        for (int coding = FLAT; coding <= NEW_RLE; coding++) {
            struct image image;

            if (coding == NEW_RLE && sizes[i][0] < 8)
                continue; /* not defined for short lines */
            write_file(&b, RGBE_HEADER, "-Y+X", sizes[i][0], sizes[i][1], (enum coding)coding);
            image = decode(&b);
            assert_int_equal(image.width, sizes[i][0]);
            assert_int_equal(image.height, sizes[i][1]);
            check(&image);
            image_release(&image);
        }
    buffer_release(&b);
}

static void test_orientations(void **state)
{
    static const char *const orders[] = {"-Y+X", "-Y-X", "+Y+X", "+Y-X",
                                         "+X-Y", "+X+Y", "-X-Y", "-X+Y"};
    struct buffer b = BUFFER_INIT;

    (void)state;
    for (size_t i = 0; i < 8; i++)
        for (int coding = FLAT; coding <= NEW_RLE; coding++) {
            struct image image;

            write_file(&b, RGBE_HEADER, orders[i], 13, 9, (enum coding)coding);
            image = decode(&b);
            assert_int_equal(image.width, 13);
            assert_int_equal(image.height, 9);
            check(&image);
            image_release(&image);
        }
    buffer_release(&b);
}

/* A run longer than 255 pixels takes two run codes. */
static void test_long_old_run(void **state)
{
    struct buffer b = BUFFER_INIT;
    struct image image;
    const uint8_t codes[12] = {9, 8, 7, 136, 1, 1, 1, 0x2b, 1, 1, 1, 2}; /* 1 + 0x22b = 556 */

    (void)state;
    buffer_puts(&b, "#?RADIANCE\n\n-Y 1 +X 556\n");
    buffer_append(&b, codes, sizeof codes);
    image = decode(&b);
    for (int i = 0; i < 556; i++)
        assert_true(image.pixels[3 * i] == 9 && image.pixels[3 * i + 2] == 7);
    image_release(&image);
    buffer_release(&b);
}

static void test_exposure_and_correction(void **state)
{
    struct buffer b = BUFFER_INIT;
    struct image image;

    (void)state;
    write_file(&b, RGBE_HEADER "EXPOSURE=2.0\nEXPOSURE= 4\nCOLORCORR= 1 2 0.5\n# note\n", "-Y+X", 9, 2, NEW_RLE);
    image = decode(&b);
    /* Pixel (0, 0) is (3, 3, 0), pixel (7, 0) is (10, 3, 50). */
    assert_true(image.pixels[0] == 3.0f / 8.0f && image.pixels[1] == 3.0f / 16.0f);
    assert_true(image.pixels[23] == 50.0f / 4.0f);
    image_release(&image);
    buffer_release(&b);
}

/* FreeImage writes EXPOSURE=0. Such a line counts as 1, whole, and is counted. */
static void test_factors_that_are_none(void **state)
{
    static const char *const lines[] = {"EXPOSURE=0",   "EXPOSURE=-1",      "EXPOSURE=nan",       "EXPOSURE=inf",
                                        "EXPOSURE=off", "COLORCORR=0 1 1", "COLORCORR=2 2 -0.5", "COLORCORR=2 2"};

    (void)state;
    for (size_t i = 0; i < sizeof lines / sizeof *lines; i++) {
        struct buffer b = BUFFER_INIT;
        struct image_repairs repairs = {0};
        struct image image;
        struct error err = {0};

        buffer_printf(&b, "#?RADIANCE\nEXPOSURE=4\n%s\n\n-Y 1 +X 1\n\200\200\200\201", lines[i]);
        assert_int_equal(hdr_decode(&image, b.data, b.size, "some.hdr", &repairs, &err), STATUS_OK);
        for (int c = 0; c < 3; c++)
            assert_true(image.pixels[c] == 0.25f);
        assert_int_equal(repairs.factors, 1);
        image_release(&image);
        buffer_release(&b);
    }
}

static void test_values(void **state)
{
    const uint8_t pixels[5][4] = {
        {128, 64, 32, 129}, {0, 0, 0, 0}, {255, 255, 255, 255}, {255, 1, 0, 1}, {77, 77, 77, 0}};
    struct buffer b = BUFFER_INIT;
    struct image image;

    (void)state;
    buffer_puts(&b, "#?RGBE\r\nFORMAT=32-bit_rle_rgbe\r\n\r\n-Y 1 +X 5\n");
    buffer_append(&b, pixels, sizeof pixels);
    image = decode(&b);
    assert_true(image.pixels[0] == 1.0f && image.pixels[1] == 0.5f && image.pixels[2] == 0.25f);
    assert_true(image.pixels[3] == 0.0f);
    assert_true(image.pixels[6] == (float)ldexp(255, 119));
    assert_true(image.pixels[9] == (float)ldexp(255, -135));
    assert_true(image.pixels[12] == 0.0f); /* exponent 0 is black whatever the mantissas */
    image_release(&image);
    buffer_release(&b);
}

static void test_xyz(void **state)
{
    /* The white of Rec. 709, (0.9505, 1, 1.089), in units of 1/200: comes out neutral. */
    const uint8_t white[4] = {190, 200, 218, 136};
    struct buffer b = BUFFER_INIT;
    struct image image;

    (void)state;
    buffer_puts(&b, "#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 1 +X 1\n");
    buffer_append(&b, white, 4);
    image = decode(&b);
    for (int c = 0; c < 3; c++)
        assert_true(fabsf(image.pixels[c] - 200.0f) < 2.0f);
    image_release(&image);
    buffer_release(&b);
}

static void test_refused(void **state)
{
    static const struct {
        const char *text;
        status expected;
    } files[] = {
        {"", STATUS_ERR_INPUT},
        {"#?RADIANCE", STATUS_ERR_INPUT},
        {"#?RADIANCE\n", STATUS_ERR_INPUT},
        {"#?RADIANCE\n\n", STATUS_ERR_INPUT},
        {"#?RADIANCE\nFORMAT=32-bit_rle_cmyk\n\n-Y 1 +X 1\nabcd", STATUS_ERR_UNSUPPORTED},
        {"#?RADIANCE\n\n-Y 0 +X 1\nabcd", STATUS_ERR_INPUT},
        {"#?RADIANCE\n\n-Y 1 -Y 1\nabcd", STATUS_ERR_INPUT},
        {"#?RADIANCE\n\n-Z 1 +X 1\nabcd", STATUS_ERR_INPUT},
        {"#?RADIANCE\n\nY 1 X 1\nabcd", STATUS_ERR_INPUT},
        {"#?RADIANCE\n\n-Y 1\nabcd", STATUS_ERR_INPUT},
        {"#?RADIANCE\n\n-\nabcd", STATUS_ERR_INPUT},
        {"#?RADIANCE\n\n-Y -1 +X 1\nabcd", STATUS_ERR_INPUT},
        {"#?RADIANCE\n\n-Y 99999999999 +X 1\nabcd", STATUS_ERR_LIMIT},
        {"#?RADIANCE\n\n-Y 99999999999999999999999 +X 1\nabcd", STATUS_ERR_LIMIT},
        {"#?RADIANCE\n\n-Y 40000 +X 40000\nabcd", STATUS_ERR_INPUT},
        {"#?RADIANCE\n\n-Y 1 +X 1\n\1\1\1\1", STATUS_ERR_INPUT},                  /* a run of nothing */
        {"#?RADIANCE\n\n-Y 1 +X 2\nabcd\1\1\1\2", STATUS_ERR_INPUT},              /* past the end */
        {"#?RADIANCE\n\n-Y 1 +X 8\n\2\2\1\10abcdefghabcdefgh", STATUS_ERR_INPUT}, /* length */
    };

    (void)state;
    for (size_t i = 0; i < sizeof files / sizeof *files; i++) {
        size_t length = strlen(files[i].text);
        uint8_t *copy = mem_memdup(files[i].text, length);
        struct image_repairs repairs = {0};
        struct image image;
        struct error err = {0};

        assert_int_equal(hdr_decode(&image, copy, length, "bad.hdr", &repairs, &err), files[i].expected);
        assert_null(image.pixels);
        assert_non_null(strstr(err.text, "bad.hdr"));
        mem_free(copy);
    }
}

static void test_damage(void **state)
{
    struct buffer b = BUFFER_INIT;
    struct image_repairs repairs = {0};

    (void)state;
    for (int coding = FLAT; coding <= NEW_RLE; coding++) {
        write_file(&b, RGBE_HEADER, "-Y+X", 11, 3, (enum coding)coding);
        for (size_t length = 0; length < b.size; length++) {
            uint8_t *copy = mem_memdup(b.data, length);
            struct image image;

            assert_int_not_equal(hdr_decode(&image, copy, length, "cut.hdr", &repairs, NULL), STATUS_OK);
            assert_null(image.pixels);
            mem_free(copy);
        }
        for (size_t at = 0; at < b.size; at++)
            for (int bit = 0; bit < 8; bit++) {
                uint8_t *copy = mem_memdup(b.data, b.size);
                struct image image;

                copy[at] ^= (uint8_t)(1 << bit);
                if (hdr_decode(&image, copy, b.size, "bad.hdr", &repairs, NULL) == STATUS_OK)
                    image_release(&image);
                mem_free(copy);
            }
    }
    buffer_release(&b);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_codings_and_sizes),
        cmocka_unit_test(test_orientations),
        cmocka_unit_test(test_long_old_run),
        cmocka_unit_test(test_exposure_and_correction),
        cmocka_unit_test(test_factors_that_are_none),
        cmocka_unit_test(test_values),
        cmocka_unit_test(test_xyz),
        cmocka_unit_test(test_refused),
        cmocka_unit_test(test_damage),
    };
    return cmocka_run_group_tests_name("hdr", tests, NULL, NULL);
}
