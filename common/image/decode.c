/* Recognises, decodes and repairs pictures of every format that the farm reads. */
#include <float.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/base/safeguard.h"
#include "common/image/half.h"
#include "common/image/image.h"

static int starts_with(const uint8_t *data, size_t size_bytes, const void *magic, size_t length)
{
    return size_bytes >= length && memcmp(data, magic, length) == 0;
}

enum image_format image_format_of(const uint8_t *data, size_t size_bytes)
{
    uint32_t size[3];

    if (starts_with(data, size_bytes, "\x89PNG\r\n\x1a\n", 8))
        return IMAGE_PNG;
    if (starts_with(data, size_bytes, "\xff\xd8\xff", 3))
        return IMAGE_JPEG;
    if (starts_with(data, size_bytes, "#?", 2))
        return IMAGE_HDR;
    if (starts_with(data, size_bytes, "\x76\x2f\x31\x01", 4))
        return IMAGE_EXR;
    if (starts_with(data, size_bytes, "RIFF", 4) && size_bytes >= 12 && memcmp(data + 8, "WEBP", 4) == 0)
        return IMAGE_WEBP;
    if (pfm_size(data, size_bytes, &size[0], &size[1]))
        return IMAGE_PFM;
    return tga_size(data, size_bytes, &size[0], &size[1], &size[2]) ? IMAGE_TGA : IMAGE_UNKNOWN;
}

int image_format_is_float(enum image_format format)
{
    return format == IMAGE_HDR || format == IMAGE_EXR || format == IMAGE_PFM;
}

/* Two passes, because the replacement for infinity is known only after the first. */
static void repair_pixels(struct image *image, struct image_repairs *repairs)
{
    size_t count = (size_t)image->width * image->height;
    float largest = 0.0f;
    const uint64_t infinite_before = repairs->infinite_pixels;

    if (!SAFEGUARD(PICTURE_REPAIR))
        return;
    for (size_t i = 0; i < count; i++) {
        float *p = image->pixels + i * image->channels;
        int nan = 0, negative = 0, infinite = 0;

        for (uint32_t c = 0; c < image->channels; c++) {
            if (isnan(p[c])) {
                nan = 1;
                p[c] = 0.0f;
            } else if (p[c] < 0.0f) {
                negative = 1;
                p[c] = 0.0f;
            } else if (isinf(p[c])) {
                infinite = 1;
            } else if (p[c] > largest) {
                largest = p[c];
            }
        }
        repairs->nan_pixels += (uint64_t)nan;
        repairs->negative_pixels += (uint64_t)negative;
        repairs->infinite_pixels += (uint64_t)infinite;
    }
    if (repairs->infinite_pixels == infinite_before)
        return;
    if (largest == 0.0f)
        largest = HALF_MAX;
    for (size_t i = 0; i < count * image->channels; i++)
        if (isinf(image->pixels[i]))
            image->pixels[i] = largest;
}

int image_repairs_say(const struct image_repairs *r, char text[IMAGE_REPAIRS_TEXT])
{
    int pixels = r->nan_pixels || r->negative_pixels || r->infinite_pixels, length = 0;

    text[0] = 0;
    if (r->factors)
        length = snprintf(text, IMAGE_REPAIRS_TEXT,
                          "its EXPOSURE or COLORCORR line is not a positive number: taken as 1%s", pixels ? "; " : "");
    if (pixels)
        snprintf(text + length, IMAGE_REPAIRS_TEXT - (size_t)length,
                 "%" PRIu64 " pixels are not numbers, %" PRIu64 " negative and %" PRIu64
                 " infinite: they count as black, black and the brightest finite value",
                 r->nan_pixels, r->negative_pixels, r->infinite_pixels);
    return text[0] != 0;
}

static status decode_floats(struct image *out, const uint8_t *data, size_t size_bytes, const char *name, int alpha,
                            struct image_repairs *repairs, struct error *err)
{
    struct image_repairs here = {0};
    status st;

    if (!repairs)
        repairs = &here;

    memset(out, 0, sizeof *out);
    switch (image_format_of(data, size_bytes)) {
    case IMAGE_EXR:
        st = alpha ? exr_decode_alpha(out, data, size_bytes, name, err) : exr_decode(out, data, size_bytes, name, err);
        break;
    case IMAGE_HDR: st = hdr_decode(out, data, size_bytes, name, repairs, err); break;
    case IMAGE_PFM: st = pfm_decode(out, data, size_bytes, name, err); break;
    case IMAGE_PNG:
    case IMAGE_JPEG:
    case IMAGE_WEBP:
    case IMAGE_TGA:
        return error_set(err, STATUS_ERR_UNSUPPORTED,
                         "%s: this is a PNG, JPEG, WebP or TGA, which cannot hold light; "
                         "give an OpenEXR (.exr) or Radiance (.hdr) file",
                         name);
    default:
        return error_set(err, STATUS_ERR_INPUT, "%s: neither an OpenEXR nor a Radiance file (its first bytes say so)",
                         name);
    }
    if (st != STATUS_OK)
        return st;
    repair_pixels(out, repairs);
    return STATUS_OK;
}

status image_decode_hdr(struct image *out, const uint8_t *data, size_t size_bytes, const char *name,
                        struct image_repairs *repairs, struct error *err)
{
    return decode_floats(out, data, size_bytes, name, 0, repairs, err);
}

/* What is seen through entirely keeps its colour. */
static float unmultiplied(float value, float alpha)
{
    return alpha > 0.0f || !SAFEGUARD(CLEAR_TEXEL) ? fminf(value / alpha, FLT_MAX) : value;
}

/* Colour times alpha to colour, in place. 1 when alpha is 1 everywhere. */
static int divide_by_alpha(struct image *image)
{
    size_t count = (size_t)image->width * image->height;
    int opaque = 1;

    for (size_t i = 0; i < count; i++) {
        float *p = image->pixels + 4 * i;

        p[3] = p[3] < 1.0f ? p[3] : 1.0f;
        if (p[3] == 1.0f)
            continue;
        opaque = 0;
        for (int c = 0; c < 3; c++)
            p[c] = unmultiplied(p[c], p[3]);
    }
    return opaque;
}

/* Four channels to three, in place; the rest of the memory is released. */
static void drop_alpha(struct image *image)
{
    size_t count = (size_t)image->width * image->height;
    float *less;

    for (size_t i = 0; i < count; i++)
        memmove(image->pixels + 3 * i, image->pixels + 4 * i, 3 * sizeof(float));
    image->channels = 3;
    less = mem_realloc_array(image->pixels, 3 * count, sizeof(float));
    if (less)
        image->pixels = less;
}

status image_decode_float(struct image *out, const uint8_t *data, size_t size_bytes, const char *name,
                          struct image_repairs *repairs, struct error *err)
{
    status st = decode_floats(out, data, size_bytes, name, 1, repairs, err);

    if (st == STATUS_OK && out->channels == 4 && divide_by_alpha(out))
        drop_alpha(out);
    return st;
}

status image_decode_8(struct image8 *out, const uint8_t *data, size_t size_bytes, const char *name, struct error *err)
{
    memset(out, 0, sizeof *out);
    switch (image_format_of(data, size_bytes)) {
    case IMAGE_PNG: return png_decode(out, data, size_bytes, name, err);
    case IMAGE_JPEG: return jpeg_decode(out, data, size_bytes, name, err);
    case IMAGE_WEBP: return webp_decode(out, data, size_bytes, name, err);
    case IMAGE_TGA: return tga_decode(out, data, size_bytes, name, err);
    default:
        return error_set(err, STATUS_ERR_INPUT, "%s: none of PNG, JPEG, WebP and TGA (its first bytes say so)", name);
    }
}
