/* TGA and PFM: each kind of file, and damaged ones. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <string.h>

#include <cmocka.h>

#include "common/base/buffer.h"
#include "common/image/image.h"
#include "common/image/image_size.h"

struct tga_file {
    uint8_t bytes[128];
    size_t size;
};

static struct tga_file tga_make(const uint8_t header[18], const uint8_t *rest, size_t rest_size)
{
    struct tga_file file = {.size = 18 + rest_size};

    memcpy(file.bytes, header, 18);
    memcpy(file.bytes + 18, rest, rest_size);
    return file;
}

static void check_tga(const struct tga_file *file, uint32_t channels, const uint8_t *codes)
{
    struct error err = {0};
    struct image8 image;
    struct image_size size_of;

    assert_int_equal(image_format_of(file->bytes, file->size), IMAGE_TGA);
    assert_true(image_size_of(file->bytes, file->size, &size_of));
    assert_true(size_of.width == 2 && size_of.height == 2 && size_of.pixel_bytes == channels);
    assert_int_equal(image_decode_8(&image, file->bytes, file->size, "x.tga", &err), STATUS_OK);
    assert_int_equal(image.channels, channels);
    for (uint32_t i = 0; i < 4 * channels; i++)
        assert_int_equal(image.pixels[i], codes[i]);
    image8_release(&image);
    for (size_t size = 0; size < file->size; size++) {
        struct image8 cut = {0};
        assert_int_equal(tga_decode(&cut, file->bytes, size, "x.tga", &err), STATUS_ERR_INPUT);
        assert_non_null(strstr(err.text, "x.tga"));
    }
}

static void every_kind_of_tga(void **state)
{
    static const uint8_t colors[12] = {255, 0, 0, 0, 255, 0, 0, 0, 255, 255, 255, 255};
    static const uint8_t bgr_up[12] = {255, 0, 0, 255, 255, 255, 0, 0, 255, 0, 255, 0};
    static const uint8_t bgr_down[12] = {0, 0, 255, 0, 255, 0, 255, 0, 0, 255, 255, 255};
    static const uint8_t bgra[16] = {1, 2, 3, 4, 1, 2, 3, 4, 1, 2, 3, 4, 1, 2, 3, 4};
    static const uint8_t rgba[16] = {3, 2, 1, 4, 3, 2, 1, 4, 3, 2, 1, 4, 3, 2, 1, 4};
    static const uint8_t run[5] = {0x83, 1, 2, 3, 4};
    static const uint8_t mapped[10] = {9, 8, 7, 0, 0, 255, 1, 0, 0, 1};
    static const uint8_t mapped_colors[12] = {255, 0, 0, 7, 8, 9, 7, 8, 9, 255, 0, 0};
    static const uint8_t mirrored_colors[12] = {7, 8, 9, 255, 0, 0, 255, 0, 0, 7, 8, 9};
    static const uint8_t grey[4] = {10, 20, 30, 40};
    static const uint8_t up[18] = {0, 0, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 2, 0, 2, 0, 24, 0};
    uint8_t header[18];
    struct tga_file file;

    (void)state;
    memcpy(header, up, sizeof header);
    file = tga_make(header, bgr_up, sizeof bgr_up);
    check_tga(&file, 3, colors);
    header[17] = 0x20; /* the top row first */
    file = tga_make(header, bgr_down, sizeof bgr_down);
    check_tga(&file, 3, colors);
    header[16] = 32;
    file = tga_make(header, bgra, sizeof bgra);
    check_tga(&file, 4, rgba);
    header[2] = 10; /* run lengths */
    file = tga_make(header, run, sizeof run);
    check_tga(&file, 4, rgba);
    header[2] = 3;
    header[16] = 8;
    file = tga_make(header, grey, sizeof grey);
    check_tga(&file, 1, grey);
    header[1] = header[2] = 1;
    header[5] = 2;
    header[7] = 24;
    file = tga_make(header, mapped, sizeof mapped);
    check_tga(&file, 3, mapped_colors);
    header[17] = 0x30; /* from the right */
    file = tga_make(header, mapped, sizeof mapped);
    check_tga(&file, 3, mirrored_colors);
}

static size_t pfm_make(uint8_t *out, const char *header, int big, const float *values, size_t count)
{
    size_t at = strlen(header);

    memcpy(out, header, at);
    for (size_t i = 0; i < count; i++) {
        uint32_t bits;
        memcpy(&bits, &values[i], sizeof bits);
        for (int b = 0; b < 4; b++)
            out[at++] = (uint8_t)(bits >> 8 * (big ? 3 - b : b));
    }
    return at;
}

static void every_kind_of_pfm(void **state)
{
    static const float stored[4] = {3, 4, 1, -2}; /* the bottom row first */
    static const float expected[12] = {1, 1, 1, 0, 0, 0, 3, 3, 3, 4, 4, 4};
    static const char *const wrong[] = {"Pf\n0 2\n-1\n", "Pf\n2 2\n0\n", "Pf\n2 inf\n1\n",
                                        "Pf\n0x2 2\n1\n", "Pf\n2 2e9\n1\n", "Pf\n\n"};
    uint8_t file[256];
    struct error err = {0};

    (void)state;
    for (int big = 0; big <= 1; big++) {
        size_t size = pfm_make(file, big ? "Pf\n2 2\n1.0\n" : "Pf\n2 2\n-1.0\n", big, stored, 4);
        struct image image, again;
        struct image_size size_of;
        struct buffer made = BUFFER_INIT;
        assert_int_equal(image_format_of(file, size), IMAGE_PFM);
        assert_true(image_size_of(file, size, &size_of));
        assert_true(size_of.width == 2 && size_of.height == 2 && size_of.pixel_bytes == 12);
        assert_int_equal(image_decode_hdr(&image, file, size, "x.pfm", NULL, &err), STATUS_OK);
        assert_true(image.width == 2 && image.height == 2 && image.channels == 3);
        assert_memory_equal(image.pixels, expected, sizeof expected);
        assert_int_equal(pfm_encode(&made, &image, &err), STATUS_OK);
        assert_int_equal(image_decode_float(&again, made.data, made.size, "made", NULL, &err), STATUS_OK);
        assert_memory_equal(again.pixels, expected, sizeof expected);
        image_release(&again);
        buffer_release(&made);
        image_release(&image);
        for (size_t cut = 0; cut < size; cut++)
            assert_int_equal(pfm_decode(&image, file, cut, "x.pfm", &err), STATUS_ERR_INPUT);
    }
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        struct image image;
        size_t size = pfm_make(file, wrong[i], 0, stored, 4);
        assert_int_equal(pfm_decode(&image, file, size, "x.pfm", &err), STATUS_ERR_INPUT);
        assert_non_null(strstr(err.text, "x.pfm"));
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_kind_of_tga),
        cmocka_unit_test(every_kind_of_pfm),
    };
    return cmocka_run_group_tests_name("tga and pfm", tests, NULL, NULL);
}
