#include "worker/render/texture.h"

#include <inttypes.h>
#include <string.h>

#include "common/base/log.h"
#include "common/base/memory.h"
#include "common/image/color.h"
#include "common/image/image.h"

enum { LEVELS_16 = 1 << 16 };

enum layout {
    LAYOUT_GREY8,
    LAYOUT_GREY_ALPHA8,
    LAYOUT_RGB8,
    LAYOUT_RGBA8,
    LAYOUT_16,
    LAYOUT_FLOAT
};

struct texture_image {
    uint32_t width, height, channels;
    enum layout layout;
    int opaque;
    const uint8_t *bytes;    /* integer layouts; points into `integers` */
    const uint16_t *words;   /* LAYOUT_16; the same */
    const float *floats;     /* LAYOUT_FLOAT, 3 channels; points into `hdr` */
    const float *srgb8;      /* decoding table of 8-bit values, static */
    float *srgb16;           /* decoding table of 16-bit values; LAYOUT_16 only, owned */
    struct image8 integers;
    struct image hdr;
};

#define LINEAR_4(i) (i) / 255.0f, ((i) + 1) / 255.0f, ((i) + 2) / 255.0f, ((i) + 3) / 255.0f
#define LINEAR_16(i) LINEAR_4(i), LINEAR_4((i) + 4), LINEAR_4((i) + 8), LINEAR_4((i) + 12)
#define LINEAR_64(i) LINEAR_16(i), LINEAR_16((i) + 16), LINEAR_16((i) + 32), LINEAR_16((i) + 48)
static const float linear8[256] = {LINEAR_64(0), LINEAR_64(64), LINEAR_64(128), LINEAR_64(192)};

/* ---- making ------------------------------------------------------------------------------- */

static int integers_are_opaque(const struct image8 *image)
{
    size_t count = (size_t)image->width * image->height, channels = image->channels;
    const uint16_t *words = (const uint16_t *)(const void *)image->pixels;

    if (channels == 1 || channels == 3)
        return 1;
    for (size_t i = 1; i <= count; i++) {
        size_t alpha = i * channels - 1;

        if (image->bits == 16 ? words[alpha] != 65535 : image->pixels[alpha] != 255)
            return 0;
    }
    return 1;
}

static status decode_integers(struct texture_image *image, const uint8_t *data, size_t size_bytes,
                              const char *name, struct error *err)
{
    static const enum layout layouts[4] = {LAYOUT_GREY8, LAYOUT_GREY_ALPHA8, LAYOUT_RGB8,
                                           LAYOUT_RGBA8};
    struct image8 *pixels = &image->integers;
    status st = image_decode_8(pixels, data, size_bytes, name, err);

    if (st != STATUS_OK)
        return st;
    image->width = pixels->width;
    image->height = pixels->height;
    image->channels = pixels->channels;
    image->opaque = integers_are_opaque(pixels);
    image->bytes = pixels->pixels;
    image->srgb8 = srgb_decode_table();
    if (pixels->bits == 8) {
        image->layout = layouts[pixels->channels - 1];
        return STATUS_OK;
    }
    image->layout = LAYOUT_16;
    image->words = (const uint16_t *)(const void *)pixels->pixels;
    /* A power function per channel of every lookup would cost more than the ray. */
    image->srgb16 = mem_alloc_array(LEVELS_16, sizeof *image->srgb16);
    if (!image->srgb16)
        return error_no_memory(err, "a texture's sRGB table");
    for (int i = 0; i < LEVELS_16; i++)
        image->srgb16[i] = srgb_decode((float)i / 65535.0f);
    return STATUS_OK;
}

static status decode_floats(struct texture_image *image, const uint8_t *data, size_t size_bytes,
                            const char *name, struct error *err)
{
    struct image_repairs repairs = {0};
    status st = image_decode_hdr(&image->hdr, data, size_bytes, name, &repairs, err);

    if (st != STATUS_OK)
        return st;
    if (repairs.nan_pixels || repairs.negative_pixels || repairs.infinite_pixels)
        log_warn("texture %s: %" PRIu64 " NaN and %" PRIu64 " negative pixels read as 0, %" PRIu64
                 " infinite ones as the largest finite value",
                 name, repairs.nan_pixels, repairs.negative_pixels, repairs.infinite_pixels);
    image->layout = LAYOUT_FLOAT;
    image->width = image->hdr.width;
    image->height = image->hdr.height;
    image->channels = 3;
    image->floats = image->hdr.pixels;
    image->opaque = 1;
    return STATUS_OK;
}

status texture_image_new(struct texture_image **out, const uint8_t *data, size_t size_bytes,
                         const char *name, struct error *err)
{
    struct texture_image *image = mem_calloc(1, sizeof *image);
    status st;

    *out = NULL;
    if (!image)
        return error_no_memory(err, "a texture");
    switch (image_format_of(data, size_bytes)) {
    case IMAGE_PNG:
    case IMAGE_JPEG:
        st = decode_integers(image, data, size_bytes, name, err);
        break;
    case IMAGE_HDR:
    case IMAGE_EXR:
        st = decode_floats(image, data, size_bytes, name, err);
        break;
    default:
        st = error_set(
            err, STATUS_ERR_INPUT,
            "%s: not an image that can be read: its first bytes are none of PNG's, JPEG's, "
            "Radiance HDR's or OpenEXR's; convert it to PNG or EXR",
            name);
    }
    if (st != STATUS_OK) {
        texture_image_free(image);
        return st;
    }
    *out = image;
    return STATUS_OK;
}

void texture_image_free(struct texture_image *image)
{
    if (!image)
        return;
    mem_free(image->srgb16);
    image8_release(&image->integers);
    image_release(&image->hdr);
    mem_free(image);
}

size_t texture_image_bytes(const struct texture_image *image)
{
    size_t texels = (size_t)image->width * image->height * image->channels;

    switch (image->layout) {
    case LAYOUT_16:
        return sizeof *image + texels * sizeof(uint16_t) + LEVELS_16 * sizeof(float);
    case LAYOUT_FLOAT:
        return sizeof *image + texels * sizeof(float);
    default:
        return sizeof *image + texels;
    }
}

int texture_image_is_opaque(const struct texture_image *image)
{
    return image->opaque;
}

/* ---- coordinates -------------------------------------------------------------------------- */

/* floorf without a call into libm; from 2^23 on every float is an integer. */
static inline float floor_small(float x)
{
    float whole;

    if (!(fabsf(x) < 8388608.0f))
        return x;
    whole = (float)(int32_t)x;
    return whole > x ? whole - 1.0f : whole;
}

/* A coordinate of any size into 0..1 of the image, both ends possible: -1e-9 modulo 1 rounds
 * to 1. A coordinate that is not finite becomes 0. */
static inline float wrap_coordinate(float x, enum scene_wrap wrap)
{
    if (!(fabsf(x) <= 3.4e38f))
        return 0.0f;
    switch (wrap) {
    case WRAP_CLAMP:
        return x < 0.0f ? 0.0f : x > 1.0f ? 1.0f : x;
    case WRAP_MIRROR:
        x -= 2.0f * floor_small(0.5f * x);
        return x > 1.0f ? 2.0f - x : x;
    default:
        return x - floor_small(x);
    }
}

/* The two texels whose centres (at half integers) enclose the coordinate, and the weight of
 * the second. Clamped and mirrored images meet themselves at an edge, so that the texel
 * beyond it is the edge texel again. */
struct texel_pair {
    uint32_t first, second;
    float weight; /* 0..1, below 1 */
};

static inline struct texel_pair pair_of(float x, uint32_t size, enum scene_wrap wrap)
{
    float position = wrap_coordinate(x, wrap) * (float)size - 0.5f;
    float whole = floor_small(position);
    int32_t first = (int32_t)whole, second = first + 1, last = (int32_t)size - 1;
    int periodic = wrap != WRAP_CLAMP && wrap != WRAP_MIRROR;

    if (first < 0)
        first = periodic ? last : 0;
    if (second > last)
        second = periodic ? 0 : last;
    return (struct texel_pair){(uint32_t)first, (uint32_t)second, position - whole};
}

static inline uint32_t nearest_of(float x, uint32_t size, enum scene_wrap wrap)
{
    uint32_t i = (uint32_t)(wrap_coordinate(x, wrap) * (float)size);

    if (i < size)
        return i;
    return wrap == WRAP_CLAMP || wrap == WRAP_MIRROR ? size - 1 : 0;
}

/* ---- lookups ------------------------------------------------------------------------------ */

/* The texel number `index`, colour decoded. `layout` is a constant where this is inlined. */
static inline __attribute__((always_inline)) struct texel
fetch(const struct texture_image *image, enum layout layout, size_t index, const float *color)
{
    const uint8_t *b;
    const float *f;

    switch (layout) {
    case LAYOUT_GREY8: {
        float grey = color[image->bytes[index]];
        return (struct texel){grey, grey, grey, 1.0f};
    }
    case LAYOUT_GREY_ALPHA8: {
        float grey = color[image->bytes[2 * index]];
        return (struct texel){grey, grey, grey, linear8[image->bytes[2 * index + 1]]};
    }
    case LAYOUT_RGB8:
        b = image->bytes + 3 * index;
        return (struct texel){color[b[0]], color[b[1]], color[b[2]], 1.0f};
    case LAYOUT_RGBA8:
        b = image->bytes + 4 * index;
        return (struct texel){color[b[0]], color[b[1]], color[b[2]], linear8[b[3]]};
    case LAYOUT_16: {
        uint32_t channels = image->channels;
        const uint16_t *w = image->words + channels * index;
        uint16_t g = channels < 3 ? w[0] : w[1], bl = channels < 3 ? w[0] : w[2];
        float alpha = channels == 2 || channels == 4 ? (float)w[channels - 1] / 65535.0f : 1.0f;

        if (color)
            return (struct texel){color[w[0]], color[g], color[bl], alpha};
        return (struct texel){(float)w[0] / 65535.0f, (float)g / 65535.0f, (float)bl / 65535.0f,
                              alpha};
    }
    default:
        f = image->floats + 3 * index;
        return (struct texel){f[0], f[1], f[2], 1.0f};
    }
}

/* Equal ends give exactly that value, so that an opaque texture stays opaque. */
static inline float lerp(float a, float b, float t)
{
    return a + (b - a) * t;
}

static inline struct texel texel_lerp(struct texel a, struct texel b, float t)
{
    return (struct texel){lerp(a.r, b.r, t), lerp(a.g, b.g, t), lerp(a.b, b.b, t),
                          lerp(a.a, b.a, t)};
}

static inline __attribute__((always_inline)) struct texel
filter(const struct texture_image *image, enum layout layout, struct texel_pair x,
       struct texel_pair y, const float *color)
{
    size_t row0 = (size_t)y.first * image->width, row1 = (size_t)y.second * image->width;
    struct texel a = fetch(image, layout, row0 + x.first, color);
    struct texel b = fetch(image, layout, row0 + x.second, color);
    struct texel c = fetch(image, layout, row1 + x.first, color);
    struct texel d = fetch(image, layout, row1 + x.second, color);

    return texel_lerp(texel_lerp(a, b, x.weight), texel_lerp(c, d, x.weight), y.weight);
}

struct texel texture_lookup(const struct texture_image *image, const struct scene_texture *texture,
                            float u, float v, float footprint,
                            int srgb)
{
    (void)footprint;
    const float *color8 = srgb ? image->srgb8 : linear8;
    const float *color16 = srgb ? image->srgb16 : NULL;
    struct texel_pair x, y;

    if (texture->nearest) {
        x.first = x.second = nearest_of(u, image->width, texture->wrap_u);
        y.first = y.second = nearest_of(v, image->height, texture->wrap_v);
        x.weight = y.weight = 0.0f;
    } else {
        x = pair_of(u, image->width, texture->wrap_u);
        y = pair_of(v, image->height, texture->wrap_v);
    }
    /* One branch on the layout, then straight code for it. */
    switch (image->layout) {
    case LAYOUT_RGB8: return filter(image, LAYOUT_RGB8, x, y, color8);
    case LAYOUT_RGBA8: return filter(image, LAYOUT_RGBA8, x, y, color8);
    case LAYOUT_GREY8: return filter(image, LAYOUT_GREY8, x, y, color8);
    case LAYOUT_GREY_ALPHA8: return filter(image, LAYOUT_GREY_ALPHA8, x, y, color8);
    case LAYOUT_16: return filter(image, LAYOUT_16, x, y, color16);
    default: return filter(image, LAYOUT_FLOAT, x, y, NULL);
    }
}
