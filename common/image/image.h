/* image: pixels in memory. Row 0 is the top. `image_release` frees the pixels.
 *
 * struct image holds float channels, interleaved; linear Rec. 709 when RGB. 8-bit textures stay
 * 8-bit in struct image8, to save memory.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/base/status.h"

enum {
    IMAGE_SIDE_MAX = 1 << 17,        /* pixels */
};
#define IMAGE_BYTES_MAX ((size_t)8 << 30) /* decoded */

struct image {
    uint32_t width, height, channels; /* channels 1..4 */
    float *pixels;                    /* [height][width][channels] */
};

struct image8 {
    uint32_t width, height, channels; /* channels 1..4: grey, grey+alpha, RGB, RGBA */
    uint32_t bits;                    /* 8 or 16 per channel (16: native-endian uint16) */
    uint8_t *pixels;
};

/* ERR_LIMIT if a side, or the whole, is too large; ERR_NO_MEMORY; both messages say how much it
 * needs. Pixels are zeroed. */
status image_init(struct image *image, uint32_t width, uint32_t height, uint32_t channels,
                  struct error *err) MUST_CHECK;
void image_release(struct image *image);
/* Replace every pixel by the mean of those within `radius` columns and lines of it, at the borders of those that
 * there are. ERR_NO_MEMORY: the image is unchanged. */
status image_smooth(struct image *image, uint32_t radius, struct error *err) MUST_CHECK;
/* `bits` is 8 or 16. */
status image8_init(struct image8 *image, uint32_t width, uint32_t height, uint32_t channels, uint32_t bits,
                   struct error *err) MUST_CHECK;
void image8_release(struct image8 *image);

enum image_format {
    IMAGE_UNKNOWN, IMAGE_PNG, IMAGE_JPEG, IMAGE_HDR, IMAGE_EXR, IMAGE_WEBP, IMAGE_TGA, IMAGE_PFM
};

/* By the first bytes, not by the name. A TGA, which has no signature, is what has a plausible header
 * and is nothing else. */
enum image_format image_format_of(const uint8_t *data, size_t size_bytes);
/* Are its values linear light, as floats? image_decode_hdr and image_decode_float read these formats,
 * image_decode_8 the others. */
int image_format_is_float(enum image_format format);

/* What was repaired while reading HDR pixels; zero-initialise. */
struct image_repairs {
    uint64_t nan_pixels, negative_pixels, infinite_pixels;
    uint64_t factors; /* EXPOSURE and COLORCORR lines of a Radiance file that are not positive: taken as 1 */
};
enum { IMAGE_REPAIRS_TEXT = 300 };
/* In words, without the file's name. 0: nothing was repaired, and the text is empty. */
int image_repairs_say(const struct image_repairs *repairs, char text[IMAGE_REPAIRS_TEXT]);

/* Decode an HDR (Radiance), EXR or PFM file to 3 float channels (RGB; luminance files are replicated). Header sizes are
 * checked before memory is allocated. NaN becomes 0, negative 0, +Inf the largest finite value in the image (or 65504
 * if there is none). `name` is for messages. ERR_INPUT, ERR_LIMIT, ERR_UNSUPPORTED (deep EXR, ...), ERR_NO_MEMORY. */
status image_decode_hdr(struct image *out, const uint8_t *data, size_t size_bytes, const char *name,
                        struct image_repairs *repairs, struct error *err) MUST_CHECK;

/* The same for a texture. An EXR's channel A becomes a fourth channel (straight, 0..1: EXR files
 * hold colour times alpha, which is divided out if alpha is above 0), unless it is 1 everywhere. */
status image_decode_float(struct image *out, const uint8_t *data, size_t size_bytes, const char *name,
                          struct image_repairs *repairs, struct error *err) MUST_CHECK;

/* Decode a PNG (8 or 16 bits kept; palette and low depths expanded; gamma and ICC ignored as glTF
 * requires), JPEG, WebP (one picture, not an animation) or TGA. */
status image_decode_8(struct image8 *out, const uint8_t *data, size_t size_bytes, const char *name,
                      struct error *err) MUST_CHECK;

/* ---- the single formats (image_decode_* dispatch to these) ---- */
status exr_decode(struct image *out, const uint8_t *data, size_t size_bytes, const char *name,
                  struct error *err) MUST_CHECK;
/* With the alpha channel, if there is one: 4 channels, as stored. */
status exr_decode_alpha(struct image *out, const uint8_t *data, size_t size_bytes, const char *name,
                        struct error *err) MUST_CHECK;
/* One channel by its whole name, for example "samples.Y", in all three of `out`; ERR_NOT_FOUND. */
status exr_decode_channel(struct image *out, const uint8_t *data, size_t size_bytes, const char *name,
                          const char *channel, struct error *err) MUST_CHECK;
/* Append a text of the first part's header. ERR_NOT_FOUND: none has that name. */
struct buffer;
status exr_read_text(struct buffer *out, const uint8_t *data, size_t size_bytes, const char *name,
                     const char *attribute, struct error *err) MUST_CHECK;
status exr_read_number(double *out, const uint8_t *data, size_t size_bytes, const char *name, const char *attribute,
                       struct error *err) MUST_CHECK;
/* Adds to repairs->factors. */
status hdr_decode(struct image *out, const uint8_t *data, size_t size_bytes, const char *name,
                  struct image_repairs *repairs, struct error *err) MUST_CHECK;
status png_decode(struct image8 *out, const uint8_t *data, size_t size_bytes, const char *name,
                  struct error *err) MUST_CHECK;
status jpeg_decode(struct image8 *out, const uint8_t *data, size_t size_bytes, const char *name,
                   struct error *err) MUST_CHECK;
status webp_decode(struct image8 *out, const uint8_t *data, size_t size_bytes, const char *name,
                   struct error *err) MUST_CHECK;

/* Values that are negative or not finite become 0. */
status pfm_decode(struct image *out, const uint8_t *data, size_t size_bytes, const char *name,
                  struct error *err) MUST_CHECK;
/* The header's size; 0: it is no PFM file. */
int pfm_size(const uint8_t *data, size_t size_bytes, uint32_t *width, uint32_t *height);
/* 1, 3 or 4 channels of 8 bits; 5 bits become the nearest 8. */
status tga_decode(struct image8 *out, const uint8_t *data, size_t size_bytes, const char *name,
                  struct error *err) MUST_CHECK;
/* Size and channels of the header; 0: it is not plausible. */
int tga_size(const uint8_t *data, size_t size_bytes, uint32_t *width, uint32_t *height, uint32_t *channels);

/* ---- writing ---- */

/* One text, point, matrix, fraction or number for an EXR header. */
struct exr_attribute {
    const char *name;
    const char *text;        /* a string attribute, or NULL */
    const double *point;     /* [3] a v3d attribute, or NULL */
    const float *matrix;     /* [16] an m44f attribute, or NULL */
    const int32_t *fraction; /* [2] a rational attribute, the second above 0, or NULL */
    double number;           /* else a double attribute */
};

/* More channels for an EXR file, beside the picture's. */
struct exr_channel {
    const char *name; /* "N.X"; no two alike, and none of the picture's */
    int precise;      /* float even where the picture is half */
};
struct exr_channels {
    const struct exr_channel *channels;
    size_t count; /* up to EXR_CHANNELS_MAX */
    /* Fill planes[count][height][image width] with the lines from y on. Called once for each run of EXR_LINES (the
     * last may be shorter), in any order, by several threads at once. */
    void (*lines)(void *user, uint32_t y, uint32_t height, float *planes);
    void *user;
};
enum { EXR_CHANNELS_MAX = 96, EXR_LINES = 16 };

/* Where a picture lies in a larger one, which is the display window. */
struct exr_window {
    uint32_t width, height, x, y;
};

struct exr_options {
    const struct exr_window *window; /* NULL: the picture is all of it */
    const char *const *names;        /* [4] of the picture's channels; NULL: R, G, B, A */
    int half;                        /* HALF channels: values are clamped to +-65504 and counted */
    const struct exr_attribute *attributes;
    size_t attribute_count;
    const struct exr_channels *more; /* NULL: none */
    uint64_t *clamped;               /* may be NULL: how many values were clamped */
    unsigned threads;                /* 0: parallel_processors(); the file is the same for any number */
};

/* Encode RGB (3) or RGBA (4) to an OpenEXR file in memory: scan lines, ZIP, with the
 * chromaticities of Rec. 709. Deterministic: same input, same bytes. */
status exr_encode(struct buffer *out, const struct image *image, const struct exr_options *options,
                  struct error *err) MUST_CHECK;
/* A file of exr_encode again, with the picture `layer` (3 channels) in place of these channels' and with these attributes in place of
 * those whose names begin with `prefix`; everything else to the bit. ERR_NOT_FOUND: it has no such channels; ERR_INPUT,
 * ERR_LIMIT, ERR_NO_MEMORY. */
status exr_replace(struct buffer *out, const uint8_t *data, size_t size_bytes, const char *name,
                   const char *const channels[3], const struct image *layer, const char *prefix,
                   const struct exr_attribute *attributes, size_t attribute_count, struct error *err) MUST_CHECK;

/* Encode display values 0..1 (already transfer-encoded) as 8-bit RGB PNG, rounding after adding a fixed blue-noise-like
 * dither of at most half a step; an sRGB chunk says how the values are meant. Deterministic. */
status png_encode(struct buffer *out, const struct image *image, struct error *err) MUST_CHECK;

/* How display values become a file. All zero: the defaults. */
struct picture_options {
    int bits;    /* of a PNG's channel: 8 (0 too) or 16 */
    int plain;   /* round instead of dithering */
    int quality; /* of a JPEG, 1..100; 0: JPEG_QUALITY_DEFAULT */
    int fast;    /* a PNG is made several times faster, and is larger; the same pixels */
    /* Texts of a PNG (tEXt): Latin-1, keywords of 1 to 79 characters. */
    const struct picture_text *texts;
    size_t text_count;
};
struct picture_text {
    const char *keyword, *text;
};
enum { JPEG_QUALITY_DEFAULT = 92 };

/* A fourth channel becomes the file's alpha (straight). */
status png_encode_as(struct buffer *out, const struct image *image, const struct picture_options *how,
                     struct error *err) MUST_CHECK;
/* A texture of 1 to 4 channels of values 0..1, already encoded, rounded to 8 or 16 bits. The file
 * makes no statement about colour, and is not compressed: so it is made and read at the speed of a
 * copy, and what sends it compresses it. */
status png_encode_texture(struct buffer *out, const struct image *image, int bits, struct error *err) MUST_CHECK;
/* The same from whole numbers; compressed unless `raw`. */
status png_encode_8(struct buffer *out, const struct image8 *image, int raw, struct error *err) MUST_CHECK;
/* Three channels of floats, not compressed; a fourth is left out. */
status pfm_encode(struct buffer *out, const struct image *image, struct error *err) MUST_CHECK;
/* A baseline JPEG with colours in full resolution. ERR_LIMIT: a side above 65500. */
status jpeg_encode(struct buffer *out, const struct image *image, const struct picture_options *how,
                   struct error *err) MUST_CHECK;
