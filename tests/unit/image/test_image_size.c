/* The size of an image by its header, for every format, and of headers that are cut or wrong. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <cmocka.h>

#include "common/base/buffer.h"
#include "common/base/memory.h"
#include "common/image/image.h"
#include "common/image/image_size.h"

static void expect(const void *data, size_t size, uint32_t width, uint32_t height, uint32_t pixel_bytes)
{
    struct image_size got;

    assert_int_equal(image_size_of(data, size, &got), 1);
    assert_int_equal(got.width, width);
    assert_int_equal(got.height, height);
    assert_int_equal(got.pixel_bytes, pixel_bytes);
    /* Cut anywhere it is refused or right, and nothing behind the end is read. */
    for (size_t n = 0; n < size; n++) {
        uint8_t *cut = mem_memdup(data, n ? n : 1);
        assert_non_null(cut);
        if (image_size_of(cut, n, &got))
            assert_int_equal(got.width, width);
        mem_free(cut);
    }
}

static void test_written(void **state)
{
    struct exr_options options = {0};
    struct buffer out = BUFFER_INIT;
    struct image image;
    struct error err = {0};

    (void)state;
    assert_int_equal(image_init(&image, 37, 21, 3, &err), STATUS_OK);
    assert_int_equal(exr_encode(&out, &image, &options, &err), STATUS_OK);
    expect(out.data, out.size < 600 ? out.size : 600, 37, 21, 12);
    buffer_release(&out);
    assert_int_equal(png_encode(&out, &image, &err), STATUS_OK);
    expect(out.data, out.size, 37, 21, 3);
    buffer_release(&out);
    image_release(&image);
}

/* A part of a larger picture, as --region writes it; damaged headers never end outside. */
static void test_part(void **state)
{
    static const struct exr_window window = {100, 60, 40, 39};
    struct exr_options options = {.window = &window};
    struct buffer out = BUFFER_INIT;
    struct image_size got;
    struct image image;
    struct error err = {0};

    (void)state;
    assert_int_equal(image_init(&image, 37, 21, 3, &err), STATUS_OK);
    assert_int_equal(exr_encode(&out, &image, &options, &err), STATUS_OK);
    assert_int_equal(image_size_of(out.data, out.size, &got), 1);
    assert_true(got.width == 37 && got.height == 21 && got.whole_width == 100 && got.whole_height == 60);
    assert_true(got.x == 40 && got.y == 39);
    for (size_t at = 8; at < 330; at++) { /* each byte of the header turned */
        out.data[at] ^= 0xff;
        if (image_size_of(out.data, out.size, &got) && got.whole_width)
            assert_true((uint64_t)got.x + got.width <= got.whole_width && (uint64_t)got.y + got.height <= got.whole_height);
        out.data[at] ^= 0xff;
    }
    options.window = NULL;
    buffer_clear(&out);
    assert_int_equal(exr_encode(&out, &image, &options, &err), STATUS_OK);
    assert_true(image_size_of(out.data, out.size, &got) && got.whole_width == 0);
    buffer_release(&out);
    image_release(&image);
}

static void test_headers(void **state)
{
    static const uint8_t jpeg[] = {0xff, 0xd8, 0xff, 0xe0, 0, 4, 1, 2, 0xff, 0xff, 0xc2, 0, 11, 8,
                                   0x01, 0x02, 0x03, 0x04, 3, 0};
    static const uint8_t grey_jpeg[] = {0xff, 0xd8, 0xff, 0xc4, 0, 2, 0xff, 0xc0, 0, 11, 8,
                                        0, 5, 0, 9, 1, 0};
    static const uint8_t png16[] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n', 0, 0, 0, 13,
                                    'I', 'H', 'D', 'R', 0, 0, 1, 0, 0, 0, 2, 0, 16, 6, 0, 0, 0};
    static const uint8_t lossless[] = {'R', 'I', 'F', 'F', 0, 0, 0, 0, 'W', 'E', 'B', 'P',
                                       'V', 'P', '8', 'L', 0, 0, 0, 0, 0x2f, 99, 0x40, 0x0c, 0,
                                       0, 0, 0, 0, 0, 0};
    static const uint8_t lossy[] = {'R', 'I', 'F', 'F', 0, 0, 0, 0, 'W', 'E', 'B', 'P',
                                    'V', 'P', '8', ' ', 0, 0, 0, 0, 0, 0, 0, 0x9d, 0x01, 0x2a,
                                    0x10, 0x01, 0x20, 0x40};
    static const uint8_t extended[] = {'R', 'I', 'F', 'F', 0, 0, 0, 0, 'W', 'E', 'B', 'P',
                                       'V', 'P', '8', 'X', 10, 0, 0, 0, 0x10, 0, 0, 0,
                                       0xff, 0x03, 0, 0xff, 0x01, 0};
    static const char hdr[] = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 512 +X 1024\n";
    static const char crlf[] = "#?RADIANCE\r\nFORMAT=32-bit_rle_rgbe\r\n\r\n-Y 5 +X 6\r\n";
    /* What libjpeg passes over: bytes between segments, a marker without a length. */
    static const uint8_t odd_jpeg[] = {0xff, 0xd8, 0, 7, 0xff, 0xd0, 0xff, 0, 0xff, 0xc0, 0, 11, 8,
                                       0, 5, 0, 9, 1, 1, 0x11, 0};
    static const char turned[] = "#?RGBE\n\n+X 12 -Y 34\n";

    (void)state;
    expect(jpeg, sizeof jpeg, 0x304, 0x102, 3);
    expect(grey_jpeg, sizeof grey_jpeg, 9, 5, 1);
    expect(odd_jpeg, sizeof odd_jpeg, 9, 5, 1);
    expect(png16, sizeof png16, 256, 512, 8);
    expect(lossless, sizeof lossless, 100, 50, 4);
    expect(lossy, sizeof lossy, 272, 32, 3);
    expect(extended, sizeof extended, 1024, 512, 4);
    {
        struct image_size got;
        assert_int_equal(image_size_of((const uint8_t *)hdr, sizeof hdr - 1, &got), 1);
        assert_int_equal(got.width, 1024);
        assert_int_equal(got.height, 512);
        assert_int_equal(got.pixel_bytes, 12);
        assert_int_equal(image_size_of((const uint8_t *)turned, sizeof turned - 1, &got), 1);
        assert_int_equal(got.width, 12);
        assert_int_equal(got.height, 34);
        assert_int_equal(image_size_of((const uint8_t *)crlf, sizeof crlf - 1, &got), 1);
        assert_true(got.width == 6 && got.height == 5);
        assert_int_equal(image_size_of((const uint8_t *)"GIF89a", 6, &got), 0);
        assert_int_equal(got.width, 0);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_written),
        cmocka_unit_test(test_part),
        cmocka_unit_test(test_headers),
    };
    return cmocka_run_group_tests_name("image size", tests, NULL, NULL);
}
