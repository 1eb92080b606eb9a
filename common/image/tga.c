/* TGA: Truevision's format, colour-mapped, RGB or grey, with or without run lengths.
 * Source: Truevision TGA File Format Specification, version 2.0 (1991). */
#include <string.h>

#include "common/base/bytes.h"
#include "common/image/image.h"

struct tga {
    const uint8_t *at, *end;
    uint32_t width, height;
    unsigned kind, bytes, map_bytes, map_first, map_count;
    const uint8_t *map;
    int from_top, from_right;
};

/* TGA has no signature: the header must be plausible. */
static int tga_open(const uint8_t *data, size_t size_bytes, struct tga *t)
{
    const uint8_t *h = data;
    size_t skip;

    memset(t, 0, sizeof *t);
    if (size_bytes < 18)
        return 0;
    t->kind = h[2];
    t->map_first = bytes_get16(h + 3);
    t->map_count = h[1] == 1 ? bytes_get16(h + 5) : 0;
    t->map_bytes = (unsigned)(h[7] + 7) / 8;
    t->width = bytes_get16(h + 12);
    t->height = bytes_get16(h + 14);
    t->bytes = (unsigned)(h[16] + 7) / 8;
    t->from_top = h[17] >> 5 & 1;
    t->from_right = h[17] >> 4 & 1;
    if (h[1] > 1 || !t->width || !t->height || (h[17] & 0xc0))
        return 0;
    switch (t->kind & 7u) {
    case 1:
        if (!t->map_count || t->bytes != 1 || t->map_bytes < 2 || t->map_bytes > 4)
            return 0;
        break;
    case 2:
        if (t->bytes < 2 || t->bytes > 4)
            return 0;
        break;
    case 3:
        if (t->bytes != 1)
            return 0;
        break;
    default: return 0;
    }
    if (t->kind & ~0xbu)
        return 0;
    skip = 18 + (size_t)h[0];
    if (skip + (size_t)t->map_count * t->map_bytes > size_bytes)
        return 0;
    t->map = h + skip;
    t->at = t->map + (size_t)t->map_count * t->map_bytes;
    t->end = h + size_bytes;
    return 1;
}

/* One stored colour of 2, 3 or 4 bytes, or grey. */
static void tga_color(const uint8_t *p, unsigned bytes, unsigned channels, uint8_t *out)
{
    if (channels == 1) {
        out[0] = p[0];
        return;
    }
    if (bytes == 2) {
        unsigned v = bytes_get16(p);
        for (unsigned c = 0; c < 3; c++)
            out[c] = (uint8_t)(((v >> (10 - 5 * c) & 31) * 255 + 15) / 31);
        return;
    }
    for (unsigned c = 0; c < 3; c++)
        out[c] = p[2 - c];
    if (channels == 4)
        out[3] = p[3];
}

static unsigned tga_channels(const struct tga *t)
{
    if ((t->kind & 7u) == 3)
        return 1;
    return ((t->kind & 7u) == 1 ? t->map_bytes : t->bytes) == 4 ? 4 : 3;
}

int tga_size(const uint8_t *data, size_t size_bytes, uint32_t *width, uint32_t *height, uint32_t *channels)
{
    struct tga t;

    if (!tga_open(data, size_bytes, &t))
        return 0;
    *width = t.width;
    *height = t.height;
    *channels = tga_channels(&t);
    return 1;
}

status tga_decode(struct image8 *out, const uint8_t *data, size_t size_bytes, const char *name, struct error *err)
{
    unsigned run = 0, repeat = 0, channels;
    const uint8_t *color = NULL;
    struct tga t;

    memset(out, 0, sizeof *out);
    if (!tga_open(data, size_bytes, &t))
        return error_set(err, STATUS_ERR_INPUT, "%s: is not a TGA picture", name);
    channels = tga_channels(&t);
    /* A packet of 1 + bytes stands for at most 128 texels. */
    if ((uint64_t)t.width * t.height > (uint64_t)(t.end - t.at) * 128)
        return error_set(err, STATUS_ERR_INPUT, "%s: the TGA picture is cut short", name);
    TRY(image8_init(out, t.width, t.height, channels, 8, err));
    for (size_t i = 0; i < (size_t)t.width * t.height; i++) {
        size_t x = i % t.width, y = i / t.width;
        const uint8_t *shown;
        if (run == 0 && (t.kind & 8u)) {
            if (t.at >= t.end)
                goto cut_short;
            run = (*t.at & 127u) + 1;
            repeat = *t.at++ >> 7;
            color = NULL;
        }
        if (!(t.kind & 8u) || !repeat || !color) {
            if ((size_t)(t.end - t.at) < t.bytes)
                goto cut_short;
            color = t.at;
            t.at += t.bytes;
        }
        if (run)
            run--;
        shown = color;
        if ((t.kind & 7u) == 1) {
            unsigned index = color[0] - t.map_first;
            if (color[0] < t.map_first || index >= t.map_count)
                index = 0;
            shown = t.map + (size_t)index * t.map_bytes;
        }
        x = t.from_right ? t.width - 1 - x : x;
        y = t.from_top ? y : t.height - 1 - y;
        tga_color(shown, (t.kind & 7u) == 1 ? t.map_bytes : t.bytes, channels,
                  out->pixels + (y * t.width + x) * channels);
    }
    return STATUS_OK;
cut_short:
    image8_release(out);
    return error_set(err, STATUS_ERR_INPUT, "%s: the TGA picture is cut short", name);
}
