#include "common/image/image_size.h"

#include <string.h>

#include "common/base/bytes.h"
#include "common/image/image.h"

enum { FLOAT_RGB_BYTES = 12, HDR_HEADER_MAX = 1 << 21, EXR_NAME_MAX = 256 };

/* PNG (ISO 15948): IHDR is always the first chunk. */
static int png_size(const uint8_t *data, size_t size, struct image_size *out)
{
    static const uint8_t channels[7] = {1, 0, 3, 4 /* palette, perhaps with alpha */, 2, 0, 4};

    if (size < 26 || data[25] > 6)
        return 0;
    out->width = bytes_get32_big(data + 16);
    out->height = bytes_get32_big(data + 20);
    out->pixel_bytes = channels[data[25]] * (data[24] == 16 ? 2u : 1u);
    return 1;
}

/* JPEG (T.81 B.2.2): the first frame header SOFn among the marker segments. */
static int jpeg_size(const uint8_t *data, size_t size, struct image_size *out)
{
    size_t at = 2;

    while (at + 10 <= size) {
        uint8_t marker = data[at + 1];
        /* Fill bytes, and other bytes that libjpeg skips between segments. */
        if (data[at] != 0xff || marker == 0xff) {
            at++;
            continue;
        }
        if (marker == 0 || marker == 0x01 || (marker >= 0xd0 && marker <= 0xd8)) { /* no length */
            at += 2;
            continue;
        }
        if (marker == 0xd9 || marker == 0xda) /* the end, or a scan: no frame header came */
            return 0;
        if (marker >= 0xc0 && marker <= 0xcf && marker != 0xc4 && marker != 0xc8 &&
            marker != 0xcc) {
            out->height = bytes_get16_big(data + at + 5);
            out->width = bytes_get16_big(data + at + 7);
            out->pixel_bytes = data[at + 9] == 1 ? 1 : 3;
            return 1;
        }
        at += 2 + bytes_get16_big(data + at + 2);
    }
    return 0;
}

/* WebP (RFC 9649): the first chunk is VP8, VP8L or VP8X. */
static int webp_size(const uint8_t *data, size_t size, struct image_size *out)
{
    const uint8_t *p = data + 20;

    if (size < 30)
        return 0;
    out->pixel_bytes = 4;
    if (memcmp(data + 12, "VP8X", 4) == 0) {
        out->width = 1 + (bytes_get32(p + 4) & 0xffffff);
        out->height = 1 + (bytes_get32(p + 6) >> 8);
    } else if (memcmp(data + 12, "VP8L", 4) == 0) {
        uint32_t bits = bytes_get32(p + 1);
        out->width = 1 + (bits & 0x3fff);
        out->height = 1 + (bits >> 14 & 0x3fff);
    } else if (memcmp(data + 12, "VP8 ", 4) == 0) {
        out->width = bytes_get32(p + 6) & 0x3fff;
        out->height = bytes_get32(p + 6) >> 16 & 0x3fff;
        out->pixel_bytes = 3;
    } else {
        return 0;
    }
    return 1;
}

static int parse_number(const uint8_t *data, size_t size, size_t *at, uint32_t *out)
{
    uint64_t value = 0;
    size_t start = *at;

    while (*at < size && data[*at] >= '0' && data[*at] <= '9' && value < 1u << 30)
        value = value * 10 + (uint64_t)(data[(*at)++] - '0');
    *out = (uint32_t)value;
    return *at > start;
}

/* Radiance: header lines, an empty one, then "-Y height +X width" or another order of axes. */
static int hdr_size(const uint8_t *data, size_t size, struct image_size *out)
{
    size_t limit = size < HDR_HEADER_MAX ? size : HDR_HEADER_MAX, at = 0;
    uint32_t first, second;
    int rows_first;

    for (;;) { /* past the first empty line, with either line end */
        const uint8_t *end = memchr(data + at, '\n', limit - at);
        size_t length = end ? (size_t)(end - (data + at)) : 0;

        if (!end)
            return 0;
        at += length + 1;
        if (length == 0 || (length == 1 && end[-1] == '\r'))
            break;
    }
    if (at + 4 > limit)
        return 0;
    rows_first = data[at + 1] == 'Y';
    at += 3;
    if (!parse_number(data, limit, &at, &first) || at + 4 > limit)
        return 0;
    at += 4;
    if (!parse_number(data, limit, &at, &second))
        return 0;
    out->height = rows_first ? first : second;
    out->width = rows_first ? second : first;
    out->pixel_bytes = FLOAT_RGB_BYTES;
    return 1;
}

/* Of a box2i: x, y, width, height. */
static void read_box(const uint8_t *p, int64_t out[4])
{
    for (int i = 0; i < 2; i++) {
        out[i] = (int32_t)bytes_get32(p + 4 * i);
        out[2 + i] = (int32_t)bytes_get32(p + 8 + 4 * i) - out[i] + 1;
    }
}

static void note_part(const int64_t data[4], const int64_t display[4], struct image_size *out)
{
    for (int i = 0; i < 2; i++)
        if (data[2 + i] < 1 || data[i] < display[i] || data[i] + data[2 + i] > display[i] + display[2 + i])
            return;
    if (data[2] == display[2] && data[3] == display[3])
        return;
    out->whole_width = (uint32_t)display[2];
    out->whole_height = (uint32_t)display[3];
    out->x = (uint32_t)(data[0] - display[0]);
    out->y = (uint32_t)(data[1] - display[1]);
}

/* OpenEXR: attributes (name, type, size, value) up to an empty name. */
static int exr_size(const uint8_t *data, size_t size, struct image_size *out)
{
    int64_t window[4] = {0}, display[4] = {0};
    size_t at = 8;

    while (at < size && data[at] && (!window[2] || !display[2])) {
        const uint8_t *name = data + at;
        size_t length = strnlen((const char *)name, size - at < EXR_NAME_MAX ? size - at : EXR_NAME_MAX);
        size_t type, value;
        uint32_t bytes;
        if (at + length >= size || length == EXR_NAME_MAX)
            break;
        type = at + length + 1;
        length = strnlen((const char *)data + type, size - type < EXR_NAME_MAX ? size - type : EXR_NAME_MAX);
        value = type + length + 1 + 4;
        if (length == EXR_NAME_MAX || value > size)
            break;
        bytes = bytes_get32(data + value - 4);
        if (bytes > size - value)
            break;
        if (strcmp((const char *)name, "dataWindow") == 0 && bytes == 16)
            read_box(data + value, window);
        if (strcmp((const char *)name, "displayWindow") == 0 && bytes == 16)
            read_box(data + value, display);
        at = value + bytes;
    }
    if (!window[2])
        return 0;
    out->width = (uint32_t)window[2];
    out->height = (uint32_t)window[3];
    out->pixel_bytes = FLOAT_RGB_BYTES;
    note_part(window, display, out);
    return 1;
}

int image_size_of(const uint8_t *data, size_t size, struct image_size *out)
{
    static const uint8_t png[8] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
    static const uint8_t exr[4] = {0x76, 0x2f, 0x31, 0x01};

    memset(out, 0, sizeof *out);
    if (size >= 8 && memcmp(data, png, 8) == 0)
        return png_size(data, size, out);
    if (size >= 2 && data[0] == 0xff && data[1] == 0xd8)
        return jpeg_size(data, size, out);
    if (size >= 12 && memcmp(data, "RIFF", 4) == 0 && memcmp(data + 8, "WEBP", 4) == 0)
        return webp_size(data, size, out);
    if (size >= 4 && memcmp(data, exr, 4) == 0)
        return exr_size(data, size, out);
    if (size >= 2 && data[0] == '#' && data[1] == '?')
        return hdr_size(data, size, out);
    out->pixel_bytes = FLOAT_RGB_BYTES;
    return pfm_size(data, size, &out->width, &out->height) ||
           tga_size(data, size, &out->width, &out->height, &out->pixel_bytes);
}
