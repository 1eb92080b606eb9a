/* Textures: which texel a coordinate reaches under every wrap mode, the decode before the
 * filter, every pixel layout, and coordinates that no sane file holds. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>
#include <png.h>

#include "common/base/buffer.h"
#include "common/base/memory.h"
#include "common/image/color.h"
#include "common/image/image.h"
#include "worker/render/sampler.h"
#include "worker/render/texture.h"

static void png_append(png_structp png, png_bytep data, size_t size_bytes)
{
    buffer_append(png_get_io_ptr(png), data, size_bytes);
}

static void png_flush_nothing(png_structp png)
{
    (void)png;
}

/* A PNG file of `channels` and `bits`; pixels big-endian when 16-bit, as PNG has it. */
static void make_png(struct buffer *out, uint32_t width, uint32_t height, int channels, int bits,
                     const uint8_t *pixels)
{
    static const int types[4] = {PNG_COLOR_TYPE_GRAY, PNG_COLOR_TYPE_GRAY_ALPHA, PNG_COLOR_TYPE_RGB,
                                 PNG_COLOR_TYPE_RGBA};
    png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, NULL, NULL, NULL);
    png_infop info = png_create_info_struct(png);

    png_set_write_fn(png, out, png_append, png_flush_nothing);
    png_set_IHDR(png, info, width, height, bits, types[channels - 1], PNG_INTERLACE_NONE,
                 PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
    png_write_info(png, info);
    for (uint32_t y = 0; y < height; y++)
        png_write_row(png, pixels + (size_t)y * width * (size_t)channels * (size_t)(bits / 8));
    png_write_end(png, info);
    png_destroy_write_struct(&png, &info);
}

static struct texture_image *texture_from_pixels(uint32_t width, uint32_t height, int channels,
                                                 int bits, const uint8_t *pixels)
{
    struct buffer file = BUFFER_INIT;
    struct texture_image *image;
    struct error err = {0};

    make_png(&file, width, height, channels, bits, pixels);
    if (texture_image_new(&image, file.data, file.size, "test.png", &err) != STATUS_OK)
        fail_msg("%s", err.text);
    buffer_release(&file);
    return image;
}

static struct scene_texture texture_as(enum scene_wrap wrap_u, enum scene_wrap wrap_v, int nearest)
{
    return (struct scene_texture){0, wrap_u, wrap_v, nearest, ENCODING_BY_SLOT};
}

static void assert_near(float got, double want, double tolerance)
{
    if (!(fabs((double)got - want) <= tolerance))
        fail_msg("%.9g is not %.9g +- %g", (double)got, want, tolerance);
}

/* Texel i of a size-long row under a wrap mode, by the definition and not by the code. */
static int wrapped_index(long i, long size, enum scene_wrap wrap)
{
    long period;

    if (wrap == WRAP_CLAMP)
        return (int)(i < 0 ? 0 : i >= size ? size - 1 : i);
    period = wrap == WRAP_MIRROR ? 2 * size : size;
    i = ((i % period) + period) % period;
    return (int)(i < size ? i : 2 * size - 1 - i);
}

/* Every wrap mode, nearest and bilinear, on a 5 x 3 image of linear values, against a slow
 * reference in double. */
static void test_wrap_and_filter(void **state)
{
    enum { W = 5, H = 3 };
    uint8_t pixels[H][W][3];
    struct texture_image *image;

    (void)state;
    for (int y = 0; y < H; y++)
        for (int x = 0; x < W; x++)
            for (int c = 0; c < 3; c++)
                pixels[y][x][c] = (uint8_t)(hash_u32((uint32_t)(x + 10 * y + 100 * c)) & 255);
    image = texture_from_pixels(W, H, 3, 8, &pixels[0][0][0]);
    for (int wrap_u = 0; wrap_u < WRAP_COUNT; wrap_u++)
        for (int wrap_v = 0; wrap_v < WRAP_COUNT; wrap_v++)
            for (uint32_t k = 0; k < 4000; k++) {
                /* Multiples of 1/512 are exact in float, and hit centres and edges too. */
                double u = ((int)(hash_u32(k) % 4096) - 2048) / 512.0;
                double v = ((int)(hash_u32(k + 77777) % 4096) - 2048) / 512.0;
                struct scene_texture smooth = texture_as(wrap_u, wrap_v, 0);
                struct scene_texture nearest = texture_as(wrap_u, wrap_v, 1);
                struct texel t = texture_lookup(image, &smooth, (float)u, (float)v, 0, 0);
                struct texel n = texture_lookup(image, &nearest, (float)u, (float)v, 0, 0);
                double uc = wrap_u == WRAP_CLAMP ? fmin(fmax(u, 0), 1) : u;
                double vc = wrap_v == WRAP_CLAMP ? fmin(fmax(v, 0), 1) : v;
                double px = uc * W - 0.5, py = vc * H - 0.5;
                double fx = px - floor(px), fy = py - floor(py);
                int x0 = wrapped_index((long)floor(px), W, wrap_u);
                int x1 = wrapped_index((long)floor(px) + 1, W, wrap_u);
                int y0 = wrapped_index((long)floor(py), H, wrap_v);
                int y1 = wrapped_index((long)floor(py) + 1, H, wrap_v);
                double want[3];

                for (int c = 0; c < 3; c++)
                    want[c] = ((1 - fy) * ((1 - fx) * pixels[y0][x0][c] + fx * pixels[y0][x1][c]) +
                               fy * ((1 - fx) * pixels[y1][x0][c] + fx * pixels[y1][x1][c])) / 255;
                assert_near(t.r, want[0], 2e-6);
                assert_near(t.g, want[1], 2e-6);
                assert_near(t.b, want[2], 2e-6);
                assert_true(t.a == 1.0f);

                /* On a texel's very edge the mirrored image may round to either side. */
                if ((wrap_u == WRAP_MIRROR && uc * W == floor(uc * W)) ||
                    (wrap_v == WRAP_MIRROR && vc * H == floor(vc * H)))
                    continue;
                x0 = wrapped_index((long)floor(uc * W), W, wrap_u);
                y0 = wrapped_index((long)floor(vc * H), H, wrap_v);
                assert_near(n.r, pixels[y0][x0][0] / 255.0, 1e-7);
                assert_near(n.b, pixels[y0][x0][2] / 255.0, 1e-7);
            }
    texture_image_free(image);
}

/* Half-way between black and white is 0.5 in linear light: decoded first, then filtered. */
static void test_srgb_decoded_before_filtering(void **state)
{
    static const uint8_t pixels[2][4] = {{0, 128, 255, 0}, {255, 128, 255, 128}};
    struct texture_image *image = texture_from_pixels(2, 1, 4, 8, &pixels[0][0]);
    struct scene_texture texture = texture_as(WRAP_CLAMP, WRAP_CLAMP, 0);
    struct texel t = texture_lookup(image, &texture, 0.5f, 0.5f, 0, 1);

    (void)state;
    assert_near(t.r, 0.5, 1e-6);
    assert_near(t.g, 0.21586050, 1e-6); /* sRGB 128 */
    assert_true(t.b == 1.0f);
    assert_near(t.a, 64.0 / 255, 1e-6); /* alpha is never decoded */
    t = texture_lookup(image, &texture, 0.5f, 0.5f, 0, 0);
    assert_near(t.g, 128.0 / 255, 1e-6);
    texture_image_free(image);
}

static void test_layouts(void **state)
{
    static const uint8_t grey[1] = {51}, grey_alpha[2] = {51, 102}, rgb[3] = {51, 102, 204},
                         rgba[4] = {51, 102, 204, 255};
    static const uint8_t grey16[2] = {0x40, 0x00},
                         rgba16[8] = {0x10, 0x20, 0x40, 0x00, 0xff, 0xff, 0x80, 0x01};
    static const struct {
        int channels, bits;
        const uint8_t *pixels;
        double want[4];
        int opaque;
    } cases[] = {
        {1, 8, grey, {0.2, 0.2, 0.2, 1}, 1},
        {2, 8, grey_alpha, {0.2, 0.2, 0.2, 0.4}, 0},
        {3, 8, rgb, {0.2, 0.4, 0.8, 1}, 1},
        {4, 8, rgba, {0.2, 0.4, 0.8, 1}, 1},
        {1, 16, grey16, {16384 / 65535.0, 16384 / 65535.0, 16384 / 65535.0, 1}, 1},
        {4, 16, rgba16, {0x1020 / 65535.0, 16384 / 65535.0, 1, 0x8001 / 65535.0}, 0},
    };

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct texture_image *image =
            texture_from_pixels(1, 1, cases[i].channels, cases[i].bits, cases[i].pixels);
        struct scene_texture texture = texture_as(WRAP_REPEAT, WRAP_REPEAT, 0);
        struct texel linear = texture_lookup(image, &texture, 0.3f, 0.8f, 0, 0);
        struct texel decoded = texture_lookup(image, &texture, 0.3f, 0.8f, 0, 1);

        assert_near(linear.r, cases[i].want[0], 1e-7);
        assert_near(linear.g, cases[i].want[1], 1e-7);
        assert_near(linear.b, cases[i].want[2], 1e-7);
        assert_near(linear.a, cases[i].want[3], 1e-7);
        assert_near(decoded.r, srgb_decode((float)cases[i].want[0]), 1e-6);
        assert_near(decoded.g, srgb_decode((float)cases[i].want[1]), 1e-6);
        assert_near(decoded.b, srgb_decode((float)cases[i].want[2]), 1e-6);
        assert_true(decoded.a == linear.a);
        assert_int_equal(texture_image_is_opaque(image), cases[i].opaque);
        assert_true(texture_image_bytes(image) > (size_t)(cases[i].channels * cases[i].bits / 8));
        texture_image_free(image);
    }
}

/* One texel less than opaque, anywhere, makes the image not opaque. An opaque image reads
 * alpha exactly 1 everywhere, filtered or not. */
static void test_opaque(void **state)
{
    enum { W = 7, H = 5 };
    uint8_t pixels[H * W * 4];
    struct scene_texture texture = texture_as(WRAP_REPEAT, WRAP_MIRROR, 0);

    (void)state;
    for (int hole = -1; hole < W * H; hole++) {
        struct texture_image *image;

        for (int i = 0; i < W * H * 4; i++)
            pixels[i] = i % 4 == 3 ? 255 : (uint8_t)hash_u32((uint32_t)i);
        if (hole >= 0)
            pixels[hole * 4 + 3] = 254;
        image = texture_from_pixels(W, H, 4, 8, pixels);
        assert_int_equal(texture_image_is_opaque(image), hole < 0);
        for (uint32_t k = 0; hole < 0 && k < 10000; k++)
            assert_true(texture_lookup(image, &texture, (float)hash_u32(k) * 1e-8f,
                                       (float)hash_u32(k + 1) * 1e-8f, 0, 1).a == 1.0f);
        texture_image_free(image);
    }
}

/* Coordinates at the limits of float reach some texel of the image; what is not finite
 * reads as coordinate 0. */
static void test_extreme_coordinates(void **state)
{
    static const float extremes[] = {0.0f, -0.0f, 1.0f, -1.0f, 0x1p-149f, -0x1p-149f, -1e-9f,
                                     0x1.fffffep-1f, 1e9f, -1e9f, 3.4028235e38f, -3.4028235e38f,
                                     8388607.5f, -8388607.5f, 16777216.0f, 2147483648.0f, INFINITY,
                                     -INFINITY, NAN};
    enum { COUNT = sizeof extremes / sizeof *extremes };
    static const uint32_t sizes[][2] = {{1, 1}, {1, 9}, {9, 1}, {2, 3}, {640, 1}};
    uint8_t pixels[640 * 3];

    (void)state;
    for (int i = 0; i < (int)sizeof pixels; i++)
        pixels[i] = (uint8_t)(100 + i % 100);
    for (size_t s = 0; s < sizeof sizes / sizeof *sizes; s++) {
        struct texture_image *image = texture_from_pixels(sizes[s][0], sizes[s][1], 3, 8, pixels);

        for (int mode = 0; mode < 2 * WRAP_COUNT; mode++) {
            struct scene_texture texture = texture_as(mode / 2, mode / 2, mode % 2);
            struct texel origin = texture_lookup(image, &texture, 0, 0, 0, 0);

            for (int a = 0; a < COUNT; a++)
                for (int b = 0; b < COUNT; b++) {
                    struct texel t = texture_lookup(image, &texture, extremes[a], extremes[b], 0, 0);

                    assert_true(t.r >= 0.39f && t.r <= 0.79f && t.b >= 0.39f && t.b <= 0.79f);
                    if (!isfinite(extremes[a]) && !isfinite(extremes[b]))
                        assert_memory_equal(&t, &origin, sizeof t);
                }
        }
        texture_image_free(image);
    }
}

/* Float images are neither clamped nor decoded. The file is Radiance HDR without runs. */
static void test_float_image(void **state)
{
    static const uint8_t file[] =
        "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n"
        "\x80\x40\x20\x84\x80\x40\x20\x80"; /* (8, 4, 2), (1/2, 1/4, 1/8) */
    struct texture_image *image;
    struct scene_texture texture = texture_as(WRAP_CLAMP, WRAP_CLAMP, 0);
    struct error err = {0};
    struct texel t;

    (void)state;
    if (texture_image_new(&image, file, sizeof file - 1, "sky.hdr", &err) != STATUS_OK)
        fail_msg("%s", err.text);
    t = texture_lookup(image, &texture, 0.25f, 0.5f, 0, 1);
    assert_near(t.r, 8, 0.05); /* RGBE readers differ by half a step */
    assert_near(t.g, 4, 0.05);
    assert_near(t.b, 2, 0.05);
    assert_true(t.a == 1.0f);
    t = texture_lookup(image, &texture, 0.75f, 0.5f, 0, 0);
    assert_near(t.r, 0.5, 0.003);
    assert_int_equal(texture_image_is_opaque(image), 1);
    texture_image_free(image);
}

static void test_damaged_files(void **state)
{
    static const uint8_t pixels[3] = {1, 2, 3};
    static const char text[] = "<svg>not pixels</svg>";
    struct buffer file = BUFFER_INIT;
    struct texture_image *image = (struct texture_image *)(void *)1;
    struct error err = {0};

    (void)state;
    assert_int_equal(
        texture_image_new(&image, (const uint8_t *)text, sizeof text, "wood.svg", &err),
        STATUS_ERR_INPUT);
    assert_null(image);
    assert_non_null(strstr(err.text, "wood.svg"));
    assert_int_equal(texture_image_new(&image, NULL, 0, "empty", &err), STATUS_ERR_INPUT);
    make_png(&file, 1, 1, 3, 8, pixels);
    for (size_t size = 0; size < file.size - 12; size++) { /* without IEND it may still decode */
        if (texture_image_new(&image, file.data, size, "cut.png", &err) == STATUS_OK)
            texture_image_free(image);
        else
            assert_null(image);
    }
    assert_int_equal(texture_image_new(&image, file.data, 20, "cut.png", &err), STATUS_ERR_INPUT);
    assert_non_null(strstr(err.text, "cut.png"));
    buffer_release(&file);
}

/* Out of memory at every allocation: an error, no leak (the sanitizer build sees those). */
static void test_out_of_memory(void **state)
{
    static const uint8_t pixels[2] = {0x12, 0x34};
    struct buffer file = BUFFER_INIT;
    struct error err = {0};
    int succeeded = 0;

    (void)state;
    make_png(&file, 1, 1, 1, 16, pixels);
    for (long n = 0; n < 100 && !succeeded; n++) {
        struct texture_image *image;
        status st;

        mem_fault_arm(n, 1);
        st = texture_image_new(&image, file.data, file.size, "deep.png", &err);
        succeeded = mem_fault_count() == 0;
        mem_fault_arm(-1, 0);
        /* What fails inside libpng may come back as a file that could not be read. */
        if (st == STATUS_OK)
            texture_image_free(image);
        else
            assert_null(image);
        assert_true(succeeded == (st == STATUS_OK));
    }
    assert_true(succeeded);
    buffer_release(&file);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_wrap_and_filter),
        cmocka_unit_test(test_srgb_decoded_before_filtering),
        cmocka_unit_test(test_layouts),
        cmocka_unit_test(test_opaque),
        cmocka_unit_test(test_extreme_coordinates),
        cmocka_unit_test(test_float_image),
        cmocka_unit_test(test_damaged_files),
        cmocka_unit_test(test_out_of_memory),
    };

    return cmocka_run_group_tests_name("texture", tests, NULL, NULL);
}
