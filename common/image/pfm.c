/* PFM: the portable float map, one or three channels, either byte order, bottom row first.
 * Source: Debevec, "PFM Portable FloatMap Image Format". */
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/buffer.h"
#include "common/base/bytes.h"
#include "common/base/safeguard.h"
#include "common/image/image.h"
#include "common/math/elementary.h"

static int is_space(uint8_t c) { return c == ' ' || c == '\t' || c == '\r' || c == '\n'; }

/* The next number of the header; *at moves past the single white space that ends it. 0: not a plain decimal number. */
static int pfm_number(const uint8_t *data, size_t size_bytes, size_t *at, double *out)
{
    char word[32], *end;
    size_t length = 0;

    while (*at < size_bytes && is_space(data[*at]))
        ++*at;
    while (*at < size_bytes && !is_space(data[*at]) && length + 1 < sizeof word)
        word[length++] = (char)data[(*at)++];
    word[length] = 0;
    ++*at;
    /* strtod would also accept "inf", "nan" and hexadecimal. */
    if (!length || word[strspn(word, "+-.0123456789eE")])
        return 0;
    *out = strtod(word, &end);
    return *end == 0 && fabs(*out) <= 3e38;
}

struct pfm {
    uint32_t width, height, channels;
    int little;
    size_t at; /* of the pixels */
};

static int pfm_open(const uint8_t *data, size_t size_bytes, struct pfm *p)
{
    double width = 0, height = 0, scale = 0;
    size_t at = 2;

    if (size_bytes <= 8 || data[0] != 'P' || (data[1] != 'F' && data[1] != 'f') || data[2] > ' ' ||
        !pfm_number(data, size_bytes, &at, &width) || !pfm_number(data, size_bytes, &at, &height) ||
        !pfm_number(data, size_bytes, &at, &scale) || !(width >= 1 && width <= IMAGE_SIDE_MAX) ||
        !(height >= 1 && height <= IMAGE_SIDE_MAX) || scale == 0)
        return 0;
    *p = (struct pfm){(uint32_t)width, (uint32_t)height, data[1] == 'F' ? 3 : 1, scale < 0, at};
    return 1;
}

int pfm_size(const uint8_t *data, size_t size_bytes, uint32_t *width, uint32_t *height)
{
    struct pfm p;

    if (!pfm_open(data, size_bytes, &p))
        return 0;
    *width = p.width;
    *height = p.height;
    return 1;
}

static float finite_light(float v) { return (v > 0 && v <= FLT_MAX) || !SAFEGUARD(PFM_FINITE) ? v : 0; }

status pfm_decode(struct image *out, const uint8_t *data, size_t size_bytes, const char *name, struct error *err)
{
    size_t row_values;
    struct pfm p;

    memset(out, 0, sizeof *out);
    if (!pfm_open(data, size_bytes, &p))
        return error_set(err, STATUS_ERR_INPUT, "%s: is not a PFM picture", name);
    row_values = (size_t)p.width * p.channels;
    if (p.at > size_bytes || (size_bytes - p.at) / 4 < row_values * p.height)
        return error_set(err, STATUS_ERR_INPUT, "%s: the PFM picture is cut short", name);
    TRY(image_init(out, p.width, p.height, 3, err));
    for (size_t y = 0; y < p.height; y++) {
        const uint8_t *row = data + p.at + 4 * (p.height - 1 - y) * row_values;
        float *to = out->pixels + 3 * p.width * y;

        for (size_t i = 0; i < 3 * (size_t)p.width; i++) {
            const uint8_t *b = row + 4 * (p.channels == 3 ? i : i / 3);
            to[i] = finite_light(p.little ? bytes_get_float(b) : float_from_bits(bytes_get32_big(b)));
        }
    }
    return STATUS_OK;
}

status pfm_encode(struct buffer *out, const struct image *image, struct error *err)
{
    const size_t values = 3 * (size_t)image->width;
    uint8_t *to;

    if (image->channels < 3)
        return error_set(err, STATUS_ERR_INTERNAL, "a PFM is made of 3 channels, not of %u", (unsigned)image->channels);
    buffer_printf(out, "PF\n%u %u\n-1\n", (unsigned)image->width, (unsigned)image->height);
    to = buffer_append_space(out, 4 * values * image->height);
    NEED(to, err, "a PFM");
    for (size_t y = image->height; y-- > 0;)
        for (size_t i = 0; i < values; i++, to += 4)
            bytes_put32(to, float_bits(image->pixels[(y * image->width + i / 3) * image->channels + i % 3]));
    return STATUS_OK;
}
