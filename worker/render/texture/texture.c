#include "worker/render/texture/texture.h"

#include <string.h>

#include "common/system/log.h"
#include "common/base/memory.h"
#include "common/base/safeguard.h"
#include "common/image/color.h"
#include "common/image/image.h"
#include "common/math/elementary.h"
#include "worker/render/texture/texture_data.h"

#define LINEAR_4(i) (i) / 255.0f, ((i) + 1) / 255.0f, ((i) + 2) / 255.0f, ((i) + 3) / 255.0f
#define LINEAR_16(i) LINEAR_4(i), LINEAR_4((i) + 4), LINEAR_4((i) + 8), LINEAR_4((i) + 12)
#define LINEAR_64(i) LINEAR_16(i), LINEAR_16((i) + 16), LINEAR_16((i) + 32), LINEAR_16((i) + 48)
static const float32 linear8[256] = {LINEAR_64(0), LINEAR_64(64), LINEAR_64(128), LINEAR_64(192)};

/* ---- making ------------------------------------------------------------------------------- */

static int is_opaque(const struct texture_image *image)
{
    size_t count = (size_t)image->width * image->height, channels = image->channels;
    const uint16_t *words = image->texels;
    const uint8_t *bytes = image->texels;

    if (channels % 2 == 1)
        return 1;
    if (image->layout == TEXTURE_FLOAT)
        return 0; /* image_decode_float drops alpha that is 1 everywhere */
    for (size_t i = 1; i <= count; i++) {
        size_t alpha = i * channels - 1;

        if (image->layout == TEXTURE_16 ? words[alpha] != 65535 : bytes[alpha] != 255)
            return 0;
    }
    return 1;
}

static status decode_integers(struct texture_image *image, const uint8_t *data, size_t size_bytes, const char *name,
                              struct error *err)
{
    static const enum texture_layout layouts[4] = {TEXTURE_GREY8, TEXTURE_GREY_ALPHA8,
                                                   TEXTURE_RGB8, TEXTURE_RGBA8};
    struct image8 *pixels = &image->integers;
    TRY(image_decode_8(pixels, data, size_bytes, name, err));
    image->width = pixels->width;
    image->height = pixels->height;
    image->channels = pixels->channels;
    image->texels = pixels->pixels;
    image->srgb8 = srgb_decode_table();
    image->layout = pixels->bits == 8 ? layouts[pixels->channels - 1] : TEXTURE_16;
    if (image->layout != TEXTURE_16)
        return STATUS_OK;
    /* A power function per channel in every lookup would cost more than tracing the ray. */
    image->srgb16 = mem_alloc_array(TEXTURE_CODES_16, sizeof *image->srgb16);
    NEED(image->srgb16, err, "a texture's sRGB table");
    for (int i = 0; i < TEXTURE_CODES_16; i++)
        image->srgb16[i] = srgb_decode((float32)i / 65535.0f);
    return STATUS_OK;
}

static status decode_floats(struct texture_image *image, const uint8_t *data, size_t size_bytes, const char *name,
                            struct error *err)
{
    struct image_repairs repairs = {0};
    char said[IMAGE_REPAIRS_TEXT];

    TRY(image_decode_float(&image->floats, data, size_bytes, name, &repairs, err));
    if (image_repairs_say(&repairs, said))
        log_warn("texture %s: %s", name, said);
    image->layout = TEXTURE_FLOAT;
    image->width = image->floats.width;
    image->height = image->floats.height;
    image->channels = image->floats.channels;
    image->texels = image->floats.pixels;
    return STATUS_OK;
}

/* An image whose texels are all equal is stored as one texel. */
static void collapse_constant(struct texture_image *image)
{
    size_t texel = image->channels * texture_value_bytes(image);
    size_t rest = ((size_t)image->width * image->height - 1) * texel;
    const uint8_t *bytes = image->texels;
    void *less;

    if (rest == 0 || memcmp(bytes, bytes + texel, rest) != 0)
        return;
    image->width = image->height = 1;
    less = mem_realloc_array((void *)(uintptr_t)image->texels, 1, texel);
    if (!less)
        return; /* the allocation stays larger than needed */
    image->texels = less;
    if (image->layout == TEXTURE_FLOAT)
        image->floats.pixels = less;
    else
        image->integers.pixels = less;
}

status texture_image_new(struct texture_image **out, const uint8_t *data, size_t size_bytes, const char *name,
                         struct error *err)
{
    struct texture_image *image = mem_calloc(1, sizeof *image);
    enum image_format format;
    status st;

    *out = NULL;
    NEED(image, err, "a texture");
    format = image_format_of(data, size_bytes);
    if (image_format_is_float(format))
        st = decode_floats(image, data, size_bytes, name, err);
    else if (format != IMAGE_UNKNOWN)
        st = decode_integers(image, data, size_bytes, name, err);
    else
        st = error_set(err, STATUS_ERR_INPUT,
                       "%s: not a readable image: it does not begin like PNG, JPEG, WebP, TGA, Radiance HDR, "
                       "OpenEXR or PFM; convert it to PNG or EXR",
                       name);
    if (st != STATUS_OK) {
        texture_image_free(image);
        return st;
    }
    collapse_constant(image);
    image->opaque = is_opaque(image);
    image->texel_bytes = image->channels * texture_value_bytes(image);
    texture_levels(image);
    *out = image;
    return STATUS_OK;
}

status texture_image_filter(struct texture_image *image, unsigned uses, const char *name, struct error *err)
{
    int floats = image->layout == TEXTURE_FLOAT;

    for (int color = 0; color < 2 && image->last_level > 0; color++) {
        unsigned use = color ? TEXTURE_AS_COLOR : TEXTURE_AS_DATA;
        status st;

        if (floats ? color == 1 || uses == 0 : !(uses & use))
            continue;
        if (image->pyramid[color])
            continue;
        st = texture_pyramid_make(image, color, err);
        if (st != STATUS_OK) {
            error_prefix(err, "%s", name);
            return st;
        }
    }
    return STATUS_OK;
}

void texture_image_free(struct texture_image *image)
{
    if (!image)
        return;
    mem_free(image->pyramid[1]);
    mem_free(image->pyramid[0]);
    mem_free(image->srgb16);
    image8_release(&image->integers);
    image_release(&image->floats);
    mem_free(image);
}

size_t texture_image_bytes(const struct texture_image *image)
{
    size_t texels = (size_t)image->width * image->height;
    size_t smaller = image->last_level ? image->levels[image->last_level].first + 1 : 0;

    for (int color = 0; color < 2; color++)
        if (image->pyramid[color])
            texels += smaller;
    return sizeof *image + texels * image->channels * texture_value_bytes(image) +
           (image->srgb16 ? TEXTURE_CODES_16 * sizeof(float32) : 0);
}

int texture_image_is_opaque(const struct texture_image *image) { return image->opaque; }

/* ---- coordinates -------------------------------------------------------------------------- */

/* floorf without a call to libm; from 2^23 on every float is an integer. */
static inline real floor_small(real x)
{
    real whole;

    if (!(real_abs(x) < 8388608.0f))
        return x;
    whole = (real)(int32_t)x;
    return whole > x ? whole - 1.0f : whole;
}

/* May it be wrapped? Overflowing transforms of texture coordinates give infinities. */
static inline int is_coordinate(real x) { return real_abs(x) <= REAL(3.4e38) || !SAFEGUARD(TEXTURE_COORDINATE); }

/* Wrap a coordinate of any size into 0..1 of the image, both ends possible: -1e-9 modulo 1 rounds
 * to 1. A coordinate that is not finite becomes 0. */
static inline real wrap_coordinate(real x, enum scene_wrap wrap)
{
    if (!is_coordinate(x))
        return 0.0f;
    switch (wrap) {
    case WRAP_BLACK: /* inside; the outside is handled before */
    case WRAP_CLAMP: return x < 0.0f ? 0.0f : x > 1.0f ? 1.0f : x;
    case WRAP_MIRROR: x -= 2.0f * floor_small(0.5f * x); return x > 1.0f ? 2.0f - x : x;
    default: return x - floor_small(x);
    }
}

/* The two texels whose centres (at half integers) enclose the coordinate, and the weight of the
 * second. Except for repeated images, the texel beyond an edge is the edge texel again. */
struct texel_pair {
    uint32_t first, second;
    real weight; /* 0..1, below 1 */
};

/* `x` is wrapped already. */
static inline struct texel_pair pair_of(real x, uint32_t size, enum scene_wrap wrap)
{
    real position = x * (real)size - 0.5f;
    real whole = floor_small(position);
    int32_t first = (int32_t)whole, second = first + 1, last = (int32_t)size - 1;
    int periodic = wrap == WRAP_REPEAT;

    if (first < 0)
        first = periodic ? last : 0;
    if (second > last)
        second = periodic ? 0 : last;
    return (struct texel_pair){(uint32_t)first, (uint32_t)second, position - whole};
}

static inline uint32_t nearest_of(real x, uint32_t size, enum scene_wrap wrap)
{
    uint32_t i = (uint32_t)(wrap_coordinate(x, wrap) * (real)size);

    if (i < size)
        return i;
    return wrap == WRAP_REPEAT ? 0 : size - 1;
}

/* ---- places ------------------------------------------------------------------------------- */

/* Is a finite coordinate outside the image? */
static inline int is_outside(real x, enum scene_wrap wrap)
{
    return wrap == WRAP_BLACK && real_abs(x) <= REAL(3.4e38) && !(x >= 0.0f && x <= 1.0f);
}

static inline void place_in(struct texture_taps *taps, uint32_t width, struct texel_pair x, struct texel_pair y)
{
    size_t row0 = (size_t)y.first * width, row1 = (size_t)y.second * width;

    taps->index[0] = row0 + x.first;
    taps->index[1] = row0 + x.second;
    taps->index[2] = row1 + x.first;
    taps->index[3] = row1 + x.second;
    taps->x = x.weight;
    taps->y = y.weight;
}

/* `u` and `v` are wrapped already. */
static inline void place_in_level(struct texture_taps *taps, const struct texture_image *image,
                                  const struct scene_texture *texture, uint32_t level, real u, real v)
{
    const struct texture_level *at = &image->levels[level];

    place_in(taps, at->width, pair_of(u, at->width, texture->wrap_u), pair_of(v, at->height, texture->wrap_v));
}

/* Rare: outside the image, or not interpolated. */
static __attribute__((noinline)) void place_special(struct texture_place *out, const struct texture_image *image,
                                                    const struct scene_texture *texture, real u, real v)
{
    struct texel_pair x = {0, 0, 0.0f}, y = {0, 0, 0.0f};

    x.first = x.second = nearest_of(u, image->width, texture->wrap_u);
    y.first = y.second = nearest_of(v, image->height, texture->wrap_v);
    out->levels = 1;
    out->level = 0;
    place_in(&out->taps[0], image->width, x, y);
}

/* Interpolate between the two levels whose texel widths enclose the beam's width. Level and weight
 * are the exponent and fraction of a float: log2, with straight lines between the powers of two. */
static inline __attribute__((always_inline)) void place_of(struct texture_place *out, const struct texture_image *image,
                                                           const struct scene_texture *texture, int filtered, real u,
                                                           real v, real footprint)
{
    real texels_wide = footprint * image->longest;

    if (is_outside(u, texture->wrap_u) || is_outside(v, texture->wrap_v)) {
        out->levels = 0;
        return;
    }
    if (texture->nearest) {
        place_special(out, image, texture, u, v);
        return;
    }
    u = wrap_coordinate(u, texture->wrap_u);
    v = wrap_coordinate(v, texture->wrap_v);
    out->levels = 1;
    out->level = 0;
    if (filtered && texels_wide > 1.0f) {
        out->level = real_binade(texels_wide, &out->blend);
        if (out->level >= image->last_level) {
            out->level = image->last_level;
        } else {
            out->levels = 2;
            place_in_level(&out->taps[1], image, texture, out->level + 1, u, v);
        }
    }
    place_in_level(&out->taps[0], image, texture, out->level, u, v);
}

/* The pyramid for lookups of this use; NULL: the finest level only. */
static inline const uint8_t *pyramid_of(const struct texture_image *image, int srgb)
{
    return image->pyramid[srgb && image->layout != TEXTURE_FLOAT];
}

static inline int is_srgb(const struct scene_texture *texture, int srgb)
{
    return texture->encoding == ENCODING_BY_SLOT ? srgb : texture->encoding == ENCODING_SRGB;
}

void texture_place(struct texture_place *out, const struct texture_image *image, const struct scene_texture *texture,
                   real u, real v, real footprint, int srgb)
{
    place_of(out, image, texture, pyramid_of(image, is_srgb(texture, srgb)) != NULL, u, v, footprint);
}

int texture_shares_place(const struct texture_image *a, const struct scene_texture *texture_a, int srgb_a,
                         const struct texture_image *b, const struct scene_texture *texture_b, int srgb_b)
{
    return a->width == b->width && a->height == b->height && texture_a->wrap_u == texture_b->wrap_u &&
           texture_a->wrap_v == texture_b->wrap_v && texture_a->nearest == texture_b->nearest &&
           !pyramid_of(a, is_srgb(texture_a, srgb_a)) == !pyramid_of(b, is_srgb(texture_b, srgb_b));
}

/* ---- lookups ------------------------------------------------------------------------------ */

/* A texel's channels side by side, for arithmetic on all of them at once. */
typedef real lanes __attribute__((vector_size(4 * sizeof(real))));

/* The texel number `index`, colour decoded. `layout` is a constant where this is inlined. */
static inline __attribute__((always_inline)) lanes fetch(const void *texels, enum texture_layout layout,
                                                         uint32_t channels, size_t index, const float32 *color)
{
    const uint8_t *b = texels;
    const float32 *f = texels;

    switch (layout) {
    case TEXTURE_GREY8: {
        real grey = color[b[index]];
        return (lanes){grey, grey, grey, 1.0f};
    }
    case TEXTURE_GREY_ALPHA8: {
        real grey = color[b[2 * index]];
        return (lanes){grey, grey, grey, linear8[b[2 * index + 1]]};
    }
    case TEXTURE_RGB8: b += 3 * index; return (lanes){color[b[0]], color[b[1]], color[b[2]], 1.0f};
    case TEXTURE_RGBA8: b += 4 * index; return (lanes){color[b[0]], color[b[1]], color[b[2]], linear8[b[3]]};
    case TEXTURE_16: {
        const uint16_t *w = (const uint16_t *)texels + channels * index;
        uint16_t g = channels < 3 ? w[0] : w[1], bl = channels < 3 ? w[0] : w[2];
        real alpha = channels == 2 || channels == 4 ? (real)w[channels - 1] / 65535.0f : 1.0f;

        if (color)
            return (lanes){color[w[0]], color[g], color[bl], alpha};
        return (lanes){(real)w[0] / 65535.0f, (real)g / 65535.0f, (real)bl / 65535.0f, alpha};
    }
    default: f += channels * index; return (lanes){f[0], f[1], f[2], channels == 4 ? f[3] : 1.0f};
    }
}

/* Equal ends give exactly that value, so an opaque texture stays opaque. */
static inline lanes lerp(lanes a, lanes b, real t) { return a + (b - a) * t; }

/* `texels` are those of the taps' level. */
static inline __attribute__((always_inline)) lanes filter(const void *texels, enum texture_layout layout,
                                                          uint32_t channels, const struct texture_taps *taps,
                                                          const float32 *color)
{
    lanes a = fetch(texels, layout, channels, taps->index[0], color);
    lanes b = fetch(texels, layout, channels, taps->index[1], color);
    lanes c = fetch(texels, layout, channels, taps->index[2], color);
    lanes d = fetch(texels, layout, channels, taps->index[3], color);

    return lerp(lerp(a, b, taps->x), lerp(c, d, taps->x), taps->y);
}

static inline __attribute__((always_inline)) lanes
filter_levels(const void *const texels[2], enum texture_layout layout, uint32_t channels,
              const struct texture_place *place, const float32 *color)
{
    lanes fine = filter(texels[0], layout, channels, &place->taps[0], color);

    if (place->levels == 1)
        return fine;
    return lerp(fine, filter(texels[1], layout, channels, &place->taps[1], color), place->blend);
}

struct texel texture_read(const struct texture_image *image, const struct scene_texture *texture,
                          const struct texture_place *place, int srgb)
{
    int decoded = is_srgb(texture, srgb);
    const float32 *color8 = decoded ? image->srgb8 : linear8;
    const float32 *color16 = decoded ? image->srgb16 : NULL;
    const uint8_t *pyramid = pyramid_of(image, decoded);
    const struct texture_level *level;
    const void *texels[2] = {image->texels, NULL};
    uint32_t channels = image->channels;
    lanes result;

    if (place->levels == 0) /* no other field of the place is set */
        return (struct texel){0, 0, 0, 0};
    level = &image->levels[place->level];
    if (place->level > 0)
        texels[0] = pyramid + level->first * image->texel_bytes;
    if (place->levels == 2)
        texels[1] = pyramid + level[1].first * image->texel_bytes;
    /* One branch on the layout, then straight code for it. */
    switch (image->layout) {
    case TEXTURE_RGB8: result = filter_levels(texels, TEXTURE_RGB8, 3, place, color8); break;
    case TEXTURE_RGBA8: result = filter_levels(texels, TEXTURE_RGBA8, 4, place, color8); break;
    case TEXTURE_GREY8: result = filter_levels(texels, TEXTURE_GREY8, 1, place, color8); break;
    case TEXTURE_GREY_ALPHA8: result = filter_levels(texels, TEXTURE_GREY_ALPHA8, 2, place, color8); break;
    case TEXTURE_16: result = filter_levels(texels, TEXTURE_16, channels, place, color16); break;
    default: result = filter_levels(texels, TEXTURE_FLOAT, channels, place, NULL); break;
    }
    return (struct texel){result[0], result[1], result[2], result[3]};
}

struct texel texture_lookup(const struct texture_image *image, const struct scene_texture *texture, real u, real v,
                            real footprint, int srgb)
{
    struct texture_place place;

    texture_place(&place, image, texture, u, v, footprint, srgb);
    return texture_read(image, texture, &place, srgb);
}
