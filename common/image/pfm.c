/* PFM: the portable float map, one or three channels, either byte order, bottom row first.
 * Source: Debevec, "PFM Portable FloatMap Image Format". */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/bytes.h"
#include "common/base/safeguard.h"
#include "common/image/image.h"
#include "common/math/elementary.h"

static int is_space(uint8_t c)
{
    return c == ' ' || c == '\t' || c == '\r' || c == '\n';
}

/* The next number of the header; *at moves past the single white space that ends it. 0: not a plain
 * decimal number. */
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

int pfm_recognise(const uint8_t *data, size_t size_bytes)
{
    return size_bytes > 8 && data[0] == 'P' && (data[1] == 'F' || data[1] == 'f') &&
           data[2] <= ' ';
}

static float finite_light(float v)
{
    return (v > 0 && v < 3e38f) || !SAFEGUARD(PFM_FINITE) ? v : 0;
}

status pfm_decode(struct image *out, const uint8_t *data, size_t size_bytes, const char *name,
                  struct error *err)
{
    double width = 0, height = 0, scale = 0;
    size_t at = 2, row_values;
    status st;

    memset(out, 0, sizeof *out);
    if (!pfm_recognise(data, size_bytes) || !pfm_number(data, size_bytes, &at, &width) ||
        !pfm_number(data, size_bytes, &at, &height) ||
        !pfm_number(data, size_bytes, &at, &scale) || !(width >= 1 && width <= IMAGE_SIDE_MAX) ||
        !(height >= 1 && height <= IMAGE_SIDE_MAX) || scale == 0)
        return error_set(err, STATUS_ERR_INPUT, "%s: is not a PFM picture", name);
    row_values = (size_t)width * (data[1] == 'F' ? 3 : 1);
    if (at > size_bytes || (size_bytes - at) / 4 < row_values * (size_t)height)
        return error_set(err, STATUS_ERR_INPUT, "%s: the PFM picture is cut short", name);
    st = image_init(out, (uint32_t)width, (uint32_t)height, data[1] == 'F' ? 3 : 1, err);
    if (st != STATUS_OK)
        return st;
    for (size_t i = 0; i < row_values * (size_t)height; i++) {
        size_t row = (size_t)height - 1 - i / row_values;
        const uint8_t *b = data + at + 4 * i;
        float v = scale < 0 ? bytes_get_float(b) : float_from_bits(bytes_get32_big(b));
        out->pixels[row * row_values + i % row_values] = finite_light(v);
    }
    return STATUS_OK;
}
