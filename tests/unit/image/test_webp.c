/* WebP: files written by libwebp, lossless and lossy, with and without alpha; and damage. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <webp/encode.h>

#include "common/base/memory.h"
#include "common/image/image.h"

enum { W = 37, H = 19 };

struct webp_file {
    uint8_t *data;
    size_t size;
};

static void fill(uint8_t *pixels, int channels)
{
    for (int y = 0; y < H; y++)
        for (int x = 0; x < W; x++)
            for (int c = 0; c < channels; c++)
                pixels[(y * W + x) * channels + c] = (uint8_t)(c == 3 ? 255 - x * 5 : 40 + x * 3 + y * 2 + c * 30);
}

static struct webp_file write_webp(int channels, int lossless)
{
    uint8_t pixels[W * H * 4];
    struct webp_file file = {NULL, 0};
    int stride = W * channels;

    fill(pixels, channels);
    if (lossless && channels == 4)
        file.size = WebPEncodeLosslessRGBA(pixels, W, H, stride, &file.data);
    else if (lossless)
        file.size = WebPEncodeLosslessRGB(pixels, W, H, stride, &file.data);
    else if (channels == 4)
        file.size = WebPEncodeRGBA(pixels, W, H, stride, 97, &file.data);
    else
        file.size = WebPEncodeRGB(pixels, W, H, stride, 97, &file.data);
    assert_true(file.size > 0);
    return file;
}

static void test_lossless_and_lossy(void **state)
{
    (void)state;
    for (int channels = 3; channels <= 4; channels++)
        for (int lossless = 0; lossless < 2; lossless++) {
            struct webp_file file = write_webp(channels, lossless);
            uint8_t want[W * H * 4];
            struct image8 image;
            struct error err = {0};

            fill(want, channels);
            assert_int_equal(image_format_of(file.data, file.size), IMAGE_WEBP);
            if (image_decode_8(&image, file.data, file.size, "x.webp", &err) != STATUS_OK)
                fail_msg("%s", err.text);
            assert_int_equal(image.width, W);
            assert_int_equal(image.height, H);
            assert_int_equal(image.channels, channels);
            assert_int_equal(image.bits, 8);
            for (int i = 0; i < W * H; i++)
                for (int c = 0; c < channels; c++) {
                    int k = i * channels + c;
                    /* Alpha is kept whole even in a lossy file. */
                    int tolerance = lossless || c == 3 ? 0 : 12;
                    int hidden = channels == 4 && want[i * 4 + 3] == 0;

                    assert_true(hidden || abs(image.pixels[k] - want[k]) <= tolerance);
                }
            image8_release(&image);
            WebPFree(file.data);
        }
}

static void assert_refused(const uint8_t *data, size_t size, status code, const char *word)
{
    struct image8 image;
    struct error err = {0};

    assert_int_equal(image_decode_8(&image, data, size, "leaf.webp", &err), code);
    assert_null(image.pixels);
    assert_non_null(strstr(err.text, "leaf.webp"));
    assert_non_null(strstr(err.text, word));
}

static void test_animation_is_refused(void **state)
{
    /* RIFF header and VP8X chunk with the animation flag, canvas 1 x 1. */
    static const uint8_t file[] = "RIFF\x16\0\0\0WEBPVP8X\x0a\0\0\0\x02\0\0\0\0\0\0\0\0\0";

    (void)state;
    assert_refused(file, sizeof file - 1, STATUS_ERR_UNSUPPORTED, "animated");
}

static void test_damage(void **state)
{
    (void)state;
    for (int channels = 3; channels <= 4; channels++)
        for (int lossless = 0; lossless < 2; lossless++) {
            struct webp_file file = write_webp(channels, lossless);

            for (size_t size = 12; size + 1 < file.size; size++) {
                uint8_t *cut = mem_memdup(file.data, size);

                assert_refused(cut, size, STATUS_ERR_INPUT, "damaged or cut short");
                mem_free(cut);
            }
            for (size_t at = 12; at < file.size; at++)
                for (int bit = 0; bit < 8; bit++) {
                    uint8_t *bent = mem_memdup(file.data, file.size);
                    struct image8 image;

                    bent[at] ^= (uint8_t)(1 << bit);
                    if (image_decode_8(&image, bent, file.size, "bent.webp", NULL) == STATUS_OK)
                        image8_release(&image);
                    assert_null(image.pixels);
                    mem_free(bent);
                }
            WebPFree(file.data);
        }
}

static void test_out_of_memory(void **state)
{
    struct webp_file file = write_webp(3, 1);
    struct image8 image;
    struct error err = {0};

    (void)state;
    mem_fault_arm(0, 1);
    assert_int_equal(webp_decode(&image, file.data, file.size, "x.webp", &err), STATUS_ERR_NO_MEMORY);
    mem_fault_arm(-1, 0);
    assert_non_null(strstr(err.text, "x.webp"));
    assert_non_null(strstr(err.text, "37 x 19"));
    WebPFree(file.data);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_lossless_and_lossy),
        cmocka_unit_test(test_animation_is_refused),
        cmocka_unit_test(test_damage),
        cmocka_unit_test(test_out_of_memory),
    };

    return cmocka_run_group_tests_name("WebP", tests, NULL, NULL);
}
