/* Radiance pictures, after Ward's description in the Radiance reference manual ("Picture file
 * format"): a text header, a resolution line that also gives the orientation, then scan lines:
 * flat, in the old run-length code, or in the new one.
 *
 * Mantissas are read as m / 256 * 2^(e - 128), without the half step that Radiance itself adds. The
 * tools that write environment maps today expect this, and it keeps black black. A PRIMARIES= line
 * is ignored, because hardly any map that has one means it.
 */
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/base/safeguard.h"
#include "common/image/color.h"
#include "common/image/image.h"

enum {
    HEADER_LINE_MAX = 2048, /* bytes */
    HEADER_LINES_MAX = 1000,
    NEW_RLE_WIDTH_MIN = 8, /* the new code is not used outside these */
    NEW_RLE_WIDTH_MAX = 0x7fff,
    NEW_RLE_RUN_MAX = 127,
};

struct hdr_reader {
    const uint8_t *data;
    size_t size, at;
    const char *name;
    int xyz;              /* XYZE instead of RGBE */
    double exposure;      /* the product of all EXPOSURE= lines */
    double correction[3]; /* the product of all COLORCORR= lines */
    uint64_t ignored;     /* such lines without a positive number: FreeImage writes EXPOSURE=0 */
    int y_major;          /* scan lines run along X: the usual case */
    int flip_x, flip_y;   /* X decreases, Y increases (row 0 of the file is the bottom) */
    uint32_t width, height;
};

static status bad(const struct hdr_reader *r, struct error *err, const char *what)
{
    return error_set(err, STATUS_ERR_INPUT, "%s: %s; make the Radiance file again", r->name, what);
}

/* The next line without its end; NULL at the end of the file or when it is too long. */
static const char *next_line(struct hdr_reader *r, char line[HEADER_LINE_MAX])
{
    const uint8_t *start = r->data + r->at;
    size_t left = r->size - r->at;
    const uint8_t *end = left ? memchr(start, '\n', left) : NULL;
    size_t length;

    if (!end || (length = (size_t)(end - start)) >= HEADER_LINE_MAX)
        return NULL;
    r->at += length + 1;
    if (length && start[length - 1] == '\r')
        length--;
    memcpy(line, start, length);
    line[length] = 0;
    return line;
}

/* Multiply by the line's numbers. A line that lacks a positive one changes nothing. */
static void read_factors(struct hdr_reader *r, const char *text, double *factors, int count)
{
    double values[3];

    for (int i = 0; i < count; i++) {
        char *end;

        values[i] = strtod(text, &end);
        if ((end == text || !(isfinite(values[i]) && values[i] > 0.0)) && SAFEGUARD(HDR_FACTOR)) {
            r->ignored++;
            return;
        }
        text = end;
    }
    for (int i = 0; i < count; i++)
        factors[i] *= values[i];
}

static status read_header_line(struct hdr_reader *r, const char *line, struct error *err)
{
    if (strncmp(line, "FORMAT=", 7) == 0) {
        const char *format = line + 7 + strspn(line + 7, " \t");

        if (strncmp(format, "32-bit_rle_xyze", 15) == 0)
            r->xyz = 1;
        else if (strncmp(format, "32-bit_rle_rgbe", 15) == 0)
            r->xyz = 0;
        else
            return error_set(err, STATUS_ERR_UNSUPPORTED, "%s: FORMAT is neither 32-bit_rle_rgbe nor 32-bit_rle_xyze",
                             r->name);
    } else if (strncmp(line, "EXPOSURE=", 9) == 0) {
        read_factors(r, line + 9, &r->exposure, 1);
    } else if (strncmp(line, "COLORCORR=", 10) == 0) {
        read_factors(r, line + 10, r->correction, 3);
    }
    return STATUS_OK;
}

/* "-Y 512 +X 1024": the first axis is the slow one; "+Y" starts at the bottom. */
static status read_resolution(struct hdr_reader *r, const char *line, struct error *err)
{
    char sign[2], axis[2];
    unsigned long long size[2];

    for (int i = 0; i < 2; i++) {
        char *end;

        line += strspn(line, " \t");
        sign[i] = line[0];
        if (sign[i] != '+' && sign[i] != '-')
            return bad(r, err, "the resolution line is not like \"-Y 512 +X 1024\"");
        axis[i] = line[1];
        line += axis[i] ? 2 : 1;
        line += strspn(line, " \t");
        if (line[0] < '0' || line[0] > '9')
            return bad(r, err, "the resolution line is not like \"-Y 512 +X 1024\"");
        errno = 0;
        size[i] = strtoull(line, &end, 10);
        if (errno == ERANGE || size[i] > UINT32_MAX)
            return error_set(err, STATUS_ERR_LIMIT, "%s: the picture is too large", r->name);
        line = end;
    }
    if (!((axis[0] == 'Y' && axis[1] == 'X') || (axis[0] == 'X' && axis[1] == 'Y')))
        return bad(r, err, "the resolution line does not name X and Y");
    r->y_major = axis[0] == 'Y';
    r->height = (uint32_t)size[r->y_major ? 0 : 1];
    r->width = (uint32_t)size[r->y_major ? 1 : 0];
    r->flip_y = sign[r->y_major ? 0 : 1] == '+';
    r->flip_x = sign[r->y_major ? 1 : 0] == '-';
    return STATUS_OK;
}

static status read_header(struct hdr_reader *r, struct error *err)
{
    char line[HEADER_LINE_MAX];

    if (!next_line(r, line) || strncmp(line, "#?", 2) != 0)
        return bad(r, err, "it does not begin with \"#?\" and a line's end");
    for (int count = 0;; count++) {
        if (count == HEADER_LINES_MAX || !next_line(r, line))
            return bad(r, err, "the header has no end");
        if (line[0] == 0)
            break;
        TRY(read_header_line(r, line, err));
    }
    if (!next_line(r, line))
        return bad(r, err, "the resolution line is missing");
    return read_resolution(r, line, err);
}

static int uses_new_code(const struct hdr_reader *r, uint32_t length)
{
    const uint8_t *p = r->data + r->at;

    return length >= NEW_RLE_WIDTH_MIN && length <= NEW_RLE_WIDTH_MAX && r->size - r->at >= 4 && p[0] == 2 &&
           p[1] == 2 && p[2] < 128;
}

/* Can the remaining bytes hold this many scan lines at all? Refuses size bombs before memory is allocated. */
static int plausible(const struct hdr_reader *r, uint32_t lines, uint32_t length)
{
    size_t least = 4; /* one pixel */

    if (uses_new_code(r, length))
        least = 4 + 4 * 2 * (((size_t)length + NEW_RLE_RUN_MAX - 1) / NEW_RLE_RUN_MAX);
    else if (length > 1)
        least = 8; /* one pixel and one run, or more */
    return (r->size - r->at) / least >= lines;
}

/* One scan line of the new code: the four components one after the other. */
static status read_new_line(struct hdr_reader *r, uint8_t *line, uint32_t length, struct error *err)
{
    const uint8_t *p = r->data + r->at;

    if ((uint32_t)p[2] << 8 != (length & 0xff00) || p[3] != (length & 0xff))
        return bad(r, err, "a scan line's length differs from the header's");
    r->at += 4;
    for (int component = 0; component < 4; component++) {
        uint32_t x = 0;

        while (x < length) {
            uint32_t count;

            if (r->size - r->at < 2)
                return bad(r, err, "the file ends inside a scan line");
            count = r->data[r->at++];
            if (count > 128) { /* a run */
                uint8_t value = r->data[r->at++];

                count -= 128;
                if (count > length - x)
                    return bad(r, err, "a run goes past the end of its scan line");
                while (count--)
                    line[4 * x++ + component] = value;
            } else {
                if (count == 0 || count > length - x)
                    return bad(r, err, "a run goes past the end of its scan line");
                if (count > r->size - r->at)
                    return bad(r, err, "the file ends inside a scan line");
                while (count--)
                    line[4 * x++ + component] = r->data[r->at++];
            }
        }
    }
    return STATUS_OK;
}

/* One scan line that is flat or in the old code: (1, 1, 1, n) repeats the pixel before n
 * times, and further such pixels count in higher bytes of n. */
static status read_old_line(struct hdr_reader *r, uint8_t *line, uint32_t length, struct error *err)
{
    uint32_t x = 0;
    int shift = 0;

    while (x < length) {
        const uint8_t *p = r->data + r->at;

        if (r->size - r->at < 4)
            return bad(r, err, "the file ends inside a scan line");
        r->at += 4;
        if (p[0] == 1 && p[1] == 1 && p[2] == 1) {
            uint64_t count;

            if (shift > 24)
                return bad(r, err, "a run goes past the end of its scan line");
            count = (uint64_t)p[3] << shift;
            if (x == 0 && count > 0)
                return bad(r, err, "a scan line begins with a run");
            if (count > length - x)
                return bad(r, err, "a run goes past the end of its scan line");
            for (; count > 0; count--, x++)
                memcpy(line + 4 * (size_t)x, line + 4 * (size_t)x - 4, 4);
            shift += 8;
        } else {
            memcpy(line + 4 * (size_t)x, p, 4);
            x++;
            shift = 0;
        }
    }
    return STATUS_OK;
}

/* Decode RGBE at `encoded` to radiance, undoing exposure and colour correction. */
static void convert_pixel(const struct hdr_reader *r, const double to_rgb[3][3], const uint8_t encoded[4], float *rgb)
{
    double scale = encoded[3] ? ldexp(1.0, (int)encoded[3] - (128 + 8)) : 0.0;
    double v[3];

    for (int i = 0; i < 3; i++)
        v[i] = encoded[i] * scale / (r->exposure * r->correction[i]);
    for (int i = 0; i < 3; i++)
        rgb[i] = (float)(r->xyz ? to_rgb[i][0] * v[0] + to_rgb[i][1] * v[1] + to_rgb[i][2] * v[2] : v[i]);
}

static status read_pixels(struct hdr_reader *r, struct image *out, uint8_t *line, uint32_t lines, uint32_t length,
                          struct error *err)
{
    double to_rgb[3][3];

    if (!color_to_rec709(&color_xyz, to_rgb))
        return error_set(err, STATUS_ERR_INTERNAL, "XYZ cannot be converted");
    for (uint32_t i = 0; i < lines; i++) {
        TRY(uses_new_code(r, length) ? read_new_line(r, line, length, err) : read_old_line(r, line, length, err));
        for (uint32_t j = 0; j < length; j++) {
            uint32_t x = r->y_major ? j : i, y = r->y_major ? i : j;

            if (r->flip_x)
                x = out->width - 1 - x;
            if (r->flip_y)
                y = out->height - 1 - y;
            convert_pixel(r, to_rgb, line + 4 * (size_t)j, out->pixels + 3 * ((size_t)y * out->width + x));
        }
    }
    return STATUS_OK;
}

status hdr_decode(struct image *out, const uint8_t *data, size_t size_bytes, const char *name,
                  struct image_repairs *repairs, struct error *err)
{
    struct hdr_reader r = {.data = data, .size = size_bytes, .name = name, .exposure = 1.0,
                           .correction = {1.0, 1.0, 1.0}};
    uint8_t *line = NULL;
    uint32_t lines, length;
    status st;

    memset(out, 0, sizeof *out);
    TRY(read_header(&r, err));
    repairs->factors += r.ignored;
    lines = r.y_major ? r.height : r.width;
    length = r.y_major ? r.width : r.height;
    if (lines > 0 && length > 0 && !plausible(&r, lines, length))
        return error_set(err, STATUS_ERR_INPUT,
                         "%s: %zu bytes cannot hold the %u x %u pixels that the header claims; "
                         "the file is damaged or cut short",
                         name, size_bytes, (unsigned)r.width, (unsigned)r.height);
    st = image_init(out, r.width, r.height, 3, err);
    if (st != STATUS_OK) {
        error_prefix(err, "%s", name);
        return st;
    }
    line = mem_alloc_array(length, 4);
    st = line ? read_pixels(&r, out, line, lines, length, err) : error_no_memory(err, "a scan line");
    mem_free(line);
    if (st != STATUS_OK)
        image_release(out);
    return st;
}
