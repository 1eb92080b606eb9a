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
#include "worker/render/base/sampler.h"
#include "worker/render/texture/texture.h"
#include "worker/render/texture/texture_dark.h"

static void png_append(png_structp png, png_bytep data, size_t size_bytes)
{
    buffer_append(png_get_io_ptr(png), data, size_bytes);
}

static void png_flush_nothing(png_structp png) { (void)png; }

/* A PNG file of `channels` and `bits`; pixels big-endian when 16-bit, as PNG has it. */
static void make_png(struct buffer *out, uint32_t width, uint32_t height, int channels, int bits, const uint8_t *pixels)
{
    static const int types[4] = {PNG_COLOR_TYPE_GRAY, PNG_COLOR_TYPE_GRAY_ALPHA, PNG_COLOR_TYPE_RGB,
                                 PNG_COLOR_TYPE_RGBA};
    png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, NULL, NULL, NULL);
    png_infop info = png_create_info_struct(png);

    png_set_write_fn(png, out, png_append, png_flush_nothing);
    png_set_IHDR(png, info, width, height, bits, types[channels - 1], PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT,
                 PNG_FILTER_TYPE_DEFAULT);
    png_write_info(png, info);
    for (uint32_t y = 0; y < height; y++)
        png_write_row(png, pixels + (size_t)y * width * (size_t)channels * (size_t)(bits / 8));
    png_write_end(png, info);
    png_destroy_write_struct(&png, &info);
}

static struct texture_image *texture_from_pixels(uint32_t width, uint32_t height, int channels, int bits,
                                                 const uint8_t *pixels)
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

    if (wrap == WRAP_CLAMP || wrap == WRAP_BLACK)
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
                int clamp_u = wrap_u == WRAP_CLAMP || wrap_u == WRAP_BLACK;
                int clamp_v = wrap_v == WRAP_CLAMP || wrap_v == WRAP_BLACK;
                double uc = clamp_u ? fmin(fmax(u, 0), 1) : u;
                double vc = clamp_v ? fmin(fmax(v, 0), 1) : v;
                double px = uc * W - 0.5, py = vc * H - 0.5;
                double fx = px - floor(px), fy = py - floor(py);
                int x0 = wrapped_index((long)floor(px), W, wrap_u);
                int x1 = wrapped_index((long)floor(px) + 1, W, wrap_u);
                int y0 = wrapped_index((long)floor(py), H, wrap_v);
                int y1 = wrapped_index((long)floor(py) + 1, H, wrap_v);
                double want[3];

                if ((wrap_u == WRAP_BLACK && uc != u) || (wrap_v == WRAP_BLACK && vc != v)) {
                    assert_true(t.r == 0 && t.g == 0 && t.b == 0 && t.a == 0);
                    assert_memory_equal(&t, &n, sizeof t);
                    continue;
                }
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
    static const uint8_t grey16[2] = {0x40, 0x00}, grey_alpha16[4] = {0x40, 0x00, 0x80, 0x01},
                         rgb16[6] = {0x10, 0x20, 0x40, 0x00, 0xff, 0xff},
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
        {2, 16, grey_alpha16, {16384 / 65535.0, 16384 / 65535.0, 16384 / 65535.0, 0x8001 / 65535.0}, 0},
        {3, 16, rgb16, {0x1020 / 65535.0, 16384 / 65535.0, 1, 1}, 1},
        {4, 16, rgba16, {0x1020 / 65535.0, 16384 / 65535.0, 1, 0x8001 / 65535.0}, 0},
    };

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct texture_image *image = texture_from_pixels(1, 1, cases[i].channels, cases[i].bits, cases[i].pixels);
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
        struct error err = {0};

        assert_int_equal(texture_image_filter(image, TEXTURE_AS_DATA, "x", &err), STATUS_OK);
        for (int mode = 0; mode < 2 * WRAP_COUNT; mode++) {
            struct scene_texture texture = texture_as(mode / 2, mode / 2, mode % 2);
            struct texel origin = texture_lookup(image, &texture, 0, 0, 0, 0);
            struct texel far = texture_lookup(image, &texture, 0, 0, INFINITY, 0);

            for (int a = 0; a < COUNT; a++)
                for (int b = 0; b < COUNT; b++) {
                    struct texel t = texture_lookup(image, &texture, extremes[a], extremes[b], a % 3 ? 0 : INFINITY, 0);
                    int black = texture.wrap_u == WRAP_BLACK && t.a == 0.0f;

                    assert_true(black || (t.r >= 0.39f && t.r <= 0.79f && t.b >= 0.39f && t.b <= 0.79f));
                    if (!isfinite(extremes[a]) && !isfinite(extremes[b]))
                        assert_memory_equal(&t, a % 3 ? &origin : &far, sizeof t);
                }
        }
        texture_image_free(image);
    }
}

/* Float images are neither clamped nor decoded. The file is Radiance HDR without runs. */
static void test_float_image(void **state)
{
    static const uint8_t file[] = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n"
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

/* ---- MIP maps ------------------------------------------------------------------------------- */

/* Level by level in double: each texel the mean of the area it covers in the level above. */
static double *halved(const double *in, uint32_t w, uint32_t h, uint32_t nw, uint32_t nh)
{
    double *out = mem_calloc((size_t)nw * nh, sizeof *out);

    for (uint32_t y = 0; y < nh; y++)
        for (uint32_t x = 0; x < nw; x++)
            for (uint32_t j = 0; j < h; j++)
                for (uint32_t i = 0; i < w; i++) {
                    double left = fmax(i, (double)x * w / nw), top = fmax(j, (double)y * h / nh);
                    double right = fmin(i + 1.0, (x + 1.0) * w / nw);
                    double bottom = fmin(j + 1.0, (y + 1.0) * h / nh);

                    if (right > left && bottom > top)
                        out[y * nw + x] +=
                            in[j * w + i] * (right - left) * (bottom - top) * ((double)nw * nh / ((double)w * h));
                }
    return out;
}

/* Value of channel c of texel i of the random pictures below: the code. */
static uint32_t code_of(size_t i, int c, int bits)
{
    uint32_t h = hash_u32((uint32_t)(i * 5 + (size_t)c));

    return bits == 8 ? h & 255 : h & 65535;
}

/* All levels of all layouts, as colour and as data, at their texels' centres. */
static void test_levels_are_means(void **state)
{
    static const uint32_t sizes[][2] = {{16, 16}, {13, 7}, {31, 1}, {2, 9}, {24, 5}, {3, 3}};
    uint8_t pixels[16 * 16 * 4 * 2];

    (void)state;
    for (size_t s = 0; s < sizeof sizes / sizeof *sizes; s++)
        for (int kind = 0; kind < 8; kind++) {
            uint32_t w = sizes[s][0], h = sizes[s][1], level = 0;
            int channels = 1 + kind % 4, bits = kind < 4 ? 8 : 16;
            double most = bits == 8 ? 255 : 65535;
            struct scene_texture texture = texture_as(WRAP_CLAMP, WRAP_CLAMP, 0);
            struct texture_image *image;
            struct error err = {0};
            double *mean[2];

            for (size_t i = 0; i < (size_t)w * h; i++)
                for (int c = 0; c < channels; c++) {
                    uint32_t code = code_of(i, c, bits);
                    uint8_t *at = pixels + (i * (size_t)channels + (size_t)c) * (size_t)(bits / 8);

                    at[0] = (uint8_t)(bits == 8 ? code : code >> 8);
                    if (bits == 16)
                        at[1] = (uint8_t)code;
                }
            image = texture_from_pixels(w, h, channels, bits, pixels);
            size_t bytes = texture_image_bytes(image);
            assert_int_equal(texture_image_filter(image, TEXTURE_AS_DATA | TEXTURE_AS_COLOR, "x", &err), STATUS_OK);
            assert_true(texture_image_bytes(image) > bytes);
            for (int srgb = 0; srgb < 2; srgb++) {
                int c = channels < 3 ? 0 : 1; /* of the texel: g */

                mean[srgb] = mem_calloc((size_t)w * h, sizeof **mean);
                for (size_t i = 0; i < (size_t)w * h; i++) {
                    float value = (float)(code_of(i, c, bits) / most);

                    mean[srgb][i] = (double)(srgb ? srgb_decode(value) : value);
                }
            }
            while (w > 1 || h > 1) {
                uint32_t nw = w > 1 ? w / 2 : 1, nh = h > 1 ? h / 2 : 1;
                uint32_t longest = sizes[s][0] > sizes[s][1] ? sizes[s][0] : sizes[s][1];

                level++;
                for (int srgb = 0; srgb < 2; srgb++) {
                    double *next = halved(mean[srgb], w, h, nw, nh);

                    mem_free(mean[srgb]);
                    mean[srgb] = next;
                    for (uint32_t i = 0; i < nw * nh; i++) {
                        float u = ((float)(i % nw) + 0.5f) / (float)nw;
                        float v = ((float)(i / nw) + 0.5f) / (float)nh;
                        /* A hair wider than 2^level texels, or it could round to less. */
                        float footprint = (float)(1u << level) / (float)longest * 1.000001f;
                        struct texel t = texture_lookup(image, &texture, u, v, footprint, srgb);
                        float want = (float)mean[srgb][i];
                        double codes = srgb ? fabs((double)srgb_encode(t.g) - (double)srgb_encode(want))
                                            : fabs((double)t.g - (double)want);

                        assert_near((float)(codes * most), 0, bits == 8 ? 0.505 : 0.7);
                        assert_true(channels % 2 == 0 || t.a == 1.0f);
                    }
                }
                w = nw;
                h = nh;
            }
            mem_free(mean[0]);
            mem_free(mean[1]);
            texture_image_free(image);
        }
}

/* Up to a texel's width the finest level alone, to the bit; then without a jump ever coarser;
 * from the whole image on the mean. */
static void test_footprint(void **state)
{
    enum { W = 32, H = 20 };
    uint8_t pixels[W * H * 4];
    struct scene_texture texture = texture_as(WRAP_REPEAT, WRAP_MIRROR, 0);
    struct scene_texture nearest = texture_as(WRAP_REPEAT, WRAP_MIRROR, 1);
    struct texture_image *image, *plain;
    struct error err = {0};

    (void)state;
    for (int i = 0; i < W * H * 4; i++)
        pixels[i] = i % 4 == 3 ? 255 : (uint8_t)hash_u32((uint32_t)i);
    image = texture_from_pixels(W, H, 4, 8, pixels);
    plain = texture_from_pixels(W, H, 4, 8, pixels);
    assert_int_equal(texture_image_filter(image, TEXTURE_AS_COLOR, "x", &err), STATUS_OK);
    size_t bytes = texture_image_bytes(image);
    assert_int_equal(texture_image_filter(image, TEXTURE_AS_COLOR, "x", &err), STATUS_OK);
    assert_int_equal(texture_image_bytes(image), bytes);
    assert_true(bytes - texture_image_bytes(plain) < W * H * 4 * 0.36);
    for (uint32_t k = 0; k < 3000; k++) {
        float u = (float)hash_u32(k) * 0x1p-30f, v = (float)hash_u32(k + 9) * 0x1p-30f;
        struct texel finest = texture_lookup(plain, &texture, u, v, 0, 1);
        struct texel point = texture_lookup(plain, &nearest, u, v, 0, 1);
        struct texel last = finest, t;

        t = texture_lookup(image, &texture, u, v, 0, 1);
        assert_memory_equal(&t, &finest, sizeof t);
        t = texture_lookup(image, &texture, u, v, 1.0f / W, 1);
        assert_memory_equal(&t, &finest, sizeof t);
        t = texture_lookup(image, &texture, u, v, NAN, 1);
        assert_memory_equal(&t, &finest, sizeof t);
        t = texture_lookup(plain, &texture, u, v, 0.7f, 1); /* no pyramid was made */
        assert_memory_equal(&t, &finest, sizeof t);
        t = texture_lookup(image, &nearest, u, v, 0.7f, 1);
        assert_memory_equal(&t, &point, sizeof t);
        for (float f = 1.0f / W; f < 3; f *= 1.01f) {
            t = texture_lookup(image, &texture, u, v, f, 1);
            assert_true(t.a == 1.0f);
            assert_near(t.r, (double)last.r, 0.03);
            last = t;
        }
        t = texture_lookup(image, &texture, u + 0.3f, v + 0.1f, INFINITY, 1);
        assert_memory_equal(&t, &last, sizeof t);
    }
    texture_image_free(image);
    texture_image_free(plain);
}

/* The slot says colour or data, unless the texture knows better; so does the pyramid's use. */
static void test_encoding_overrides_slot(void **state)
{
    static const uint8_t pixels[2] = {0, 188};
    struct texture_image *image = texture_from_pixels(2, 1, 1, 8, pixels);
    struct scene_texture texture = texture_as(WRAP_CLAMP, WRAP_CLAMP, 0);
    double encoded = 188 / 255.0, linear = (double)srgb_decode(188 / 255.0f);
    struct error err = {0};

    (void)state;
    for (int encoding = 0; encoding < ENCODING_COUNT; encoding++)
        for (int slot = 0; slot < 2; slot++) {
            int srgb = encoding == ENCODING_BY_SLOT ? slot : encoding == ENCODING_SRGB;

            texture.encoding = (enum scene_encoding)encoding;
            assert_near(texture_lookup(image, &texture, 1, 0.5f, 0, slot).r, srgb ? linear : encoded, 1e-6);
            assert_int_equal(texture_use_of(&texture, slot), srgb ? TEXTURE_AS_COLOR : TEXTURE_AS_DATA);
            assert_int_equal(texture_image_filter(image, texture_use_of(&texture, slot), "x", &err), STATUS_OK);
            assert_near(texture_lookup(image, &texture, 1, 0.5f, 1, slot).r, srgb ? linear / 2 : encoded / 2, 3e-3);
        }
    texture_image_free(image);
}

/* A constant image is one texel, whatever its depth, and answers as the whole would. */
static void test_constant_collapses(void **state)
{
    enum { W = 64, H = 32 };
    static uint8_t pixels[W * H * 8];

    (void)state;
    for (int channels = 1; channels <= 4; channels++)
        for (int bits = 8; bits <= 16; bits += 8) {
            size_t count = (size_t)(W * H * channels * (bits / 8));
            struct scene_texture texture = texture_as(WRAP_MIRROR, WRAP_REPEAT, 0);
            struct texture_image *image;
            struct texel t;
            struct error err = {0};

            memset(pixels, 0x5b, sizeof pixels);
            image = texture_from_pixels(W, H, channels, bits, pixels);
            assert_true(texture_image_bytes(image) < 3000 + (bits == 16 ? 65536 * 4 : 0));
            assert_int_equal(texture_image_filter(image, 3, "x", &err), STATUS_OK);
            for (uint32_t k = 0; k < 100; k++) {
                t = texture_lookup(image, &texture, (float)k * 0.17f, (float)k * -0.3f, (float)k * 0.01f, 0);
                assert_near(t.b, (double)(0x5b / 255.0f), 1e-7);
                assert_near(t.a, channels % 2 ? 1 : (double)(0x5b / 255.0f), 1e-7);
            }
            assert_int_equal(texture_image_is_opaque(image), channels % 2);
            texture_image_free(image);
            pixels[count - 1] ^= 1;
            image = texture_from_pixels(W, H, channels, bits, pixels);
            assert_true(texture_image_bytes(image) > count);
            texture_image_free(image);
        }
}

/* OpenEXR with alpha as a texture: straight colour, alpha filtered beside it, levels in float. */
static void test_exr_with_alpha(void **state)
{
    enum { W = 6, H = 3 };
    struct image picture;
    struct buffer file = BUFFER_INIT;
    struct scene_texture texture = texture_as(WRAP_CLAMP, WRAP_CLAMP, 0);
    struct texture_image *image;
    double mean[4] = {0};
    struct error err = {0};
    struct texel t;

    (void)state;
    assert_int_equal(image_init(&picture, W, H, 4, &err), STATUS_OK);
    for (size_t i = 0; i < W * H; i++) {
        float alpha = (float)(i % 4) * 0.25f + 0.25f;

        for (size_t c = 0; c < 4; c++) {
            float value = c == 3 ? alpha : (float)(100 * i + c);

            picture.pixels[4 * i + c] = c == 3 ? alpha : value * alpha;
            mean[c] += (double)value / (W * H);
        }
    }
    assert_int_equal(exr_encode(&file, &picture, NULL, &err), STATUS_OK);
    if (texture_image_new(&image, file.data, file.size, "leaf.exr", &err) != STATUS_OK)
        fail_msg("%s", err.text);
    assert_int_equal(texture_image_is_opaque(image), 0);
    assert_int_equal(texture_image_filter(image, TEXTURE_AS_COLOR, "x", &err), STATUS_OK);
    t = texture_lookup(image, &texture, 1.5f / W, 1.5f / H, 0, 1);
    assert_near(t.g, 701, 1e-3);
    assert_near(t.a, 1.0, 1e-6);
    t = texture_lookup(image, &texture, 0.1f, 0.1f, 5, 1);
    assert_near(t.b, mean[2], 1e-3);
    assert_near(t.a, mean[3], 1e-6);
    texture_image_free(image);
    image_release(&picture);
    buffer_release(&file);
}

static void test_filter_out_of_memory(void **state)
{
    static const uint8_t pixels[3 * 3] = {1, 2, 3, 4, 5, 6, 7, 8, 9};
    struct texture_image *image = texture_from_pixels(3, 3, 1, 8, pixels);
    struct scene_texture texture = texture_as(WRAP_CLAMP, WRAP_CLAMP, 0);
    struct error err = {0};
    int succeeded = 0;

    (void)state;
    for (long n = 0; n < 20 && !succeeded; n++) {
        mem_fault_arm(n, 1);
        if (texture_image_filter(image, 3, "big.png", &err) == STATUS_OK)
            succeeded = 1;
        else
            assert_non_null(strstr(err.text, "big.png"));
        mem_fault_arm(-1, 0);
        assert_true(texture_lookup(image, &texture, 0.5f, 0.5f, 1, 1).r > 0);
    }
    assert_true(succeeded);
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
    assert_int_equal(texture_image_new(&image, (const uint8_t *)text, sizeof text, "wood.svg", &err), STATUS_ERR_INPUT);
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

/* Between `low` and `high`, both possible, by the i-th hashed number. */
static float between(float low, float high, uint32_t i)
{
    float t = (float)(hash_u32(i) >> 8) / 16777215.0f;

    return t < 1 ? low + (high - low) * t : high;
}

/* What is called dark gives exactly black wherever it is looked up; what is plainly dark is
 * called so. */
static void test_dark(void **state)
{
    enum { W = 60, H = 35, BOXES = 400, LOOKUPS = 150, WIDE = 2000 };
    static const enum scene_wrap wraps[4] = {WRAP_REPEAT, WRAP_CLAMP, WRAP_MIRROR, WRAP_BLACK};
    static uint8_t pixels[W * H * 4 * 2], wide[WIDE];
    const double inside_u[2] = {0.55, 0.8}, inside_v[2] = {0.4, 0.6}, never[2] = {0, INFINITY};
    struct texture_image *image;
    struct texture_dark *dark;
    struct error err = {0};
    int said = 0;

    (void)state;
    for (uint32_t kind = 0; kind < 8; kind++) {
        int channels = 1 + (int)kind % 4, bits = kind < 4 ? 8 : 16;
        size_t texel = (size_t)channels * (size_t)bits / 8;

        memset(pixels, 0, sizeof pixels);
        if (channels % 2 == 0) /* alpha is no light */
            for (size_t i = texel - 1; i < (size_t)W * H * texel / 2; i += texel)
                pixels[i] = 255;
        pixels[0] = pixels[(12 * W + 20) * texel] = 1;
        image = texture_from_pixels(W, H, channels, bits, pixels);
        assert_int_equal(texture_dark_new(&dark, image, &err), STATUS_OK);
        for (uint32_t box = 0; box < BOXES; box++) {
            struct scene_texture texture = texture_as(wraps[box % 4], wraps[box / 4 % 4], box % 7 == 0);
            uint32_t seed = (kind * BOXES + box) * 1000;
            float reach = box % 5 == 0 ? 300.0f : 1.6f;
            float u0 = between(-reach, reach, seed), v0 = between(-reach, reach, seed + 1);
            float u1 = u0 + between(0, 0.5f, seed + 2), v1 = v0 + between(0, 0.5f, seed + 3);
            const double u[2] = {(double)u0, (double)u1}, v[2] = {(double)v0, (double)v1};

            if (!texture_dark_in(dark, &texture, u, v))
                continue;
            said++;
            for (uint32_t i = 0; i < LOOKUPS; i++) {
                struct texel t = texture_lookup(image, &texture, between(u0, u1, seed + 4 + 2 * i),
                                                between(v0, v1, seed + 5 + 2 * i), 0, 1);
                assert_true(t.r == 0 && t.g == 0 && t.b == 0);
            }
        }
        for (int wrap = 0; wrap < 4; wrap++) {
            struct scene_texture texture = texture_as(wraps[wrap], wraps[3 - wrap], 0);

            assert_true(texture_dark_in(dark, &texture, inside_u, inside_v));
            assert_false(texture_dark_in(dark, &texture, never, inside_v));
        }
        texture_dark_free(dark);
        texture_image_free(image);
    }
    assert_true(said > BOXES);

    /* Wider than the table has blocks. */
    wide[777] = 9;
    image = texture_from_pixels(WIDE, 1, 1, 8, wide);
    assert_int_equal(texture_dark_new(&dark, image, &err), STATUS_OK);
    for (int i = 0; i < 100; i++) {
        struct scene_texture texture = texture_as(WRAP_CLAMP, WRAP_CLAMP, 0);
        const double u[2] = {i / 100.0, (i + 1) / 100.0};

        assert_int_equal(texture_dark_in(dark, &texture, u, inside_v),
                         u[1] < 776.0 / WIDE - 0.004 || u[0] > 779.0 / WIDE + 0.004);
    }
    texture_dark_free(dark);
    mem_fault_arm(1, 1);
    assert_int_equal(texture_dark_new(&dark, image, &err), STATUS_ERR_NO_MEMORY);
    mem_fault_arm(-1, 0);
    assert_null(dark);
    texture_image_free(image);
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
        cmocka_unit_test(test_levels_are_means),
        cmocka_unit_test(test_footprint),
        cmocka_unit_test(test_encoding_overrides_slot),
        cmocka_unit_test(test_constant_collapses),
        cmocka_unit_test(test_exr_with_alpha),
        cmocka_unit_test(test_filter_out_of_memory),
        cmocka_unit_test(test_dark),
        cmocka_unit_test(test_damaged_files),
        cmocka_unit_test(test_out_of_memory),
    };

    return cmocka_run_group_tests_name("texture", tests, NULL, NULL);
}
