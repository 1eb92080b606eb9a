/* A level has half the sides of the level below, rounded down. Each of its texels is the mean of the area that it
 * covers there; for odd sides that is three texels of unequal weight. Means are of decoded values in float on all
 * levels: only what is stored is rounded to the image's depth, so roundings do not accumulate. Colour is averaged as it
 * is, not weighted by alpha, since lookups do not weight it either; normals are averaged as data and not normalised.
 * Rows are passed on as they become complete, so the work needs only a few rows of memory. */
#include <float.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/base/safeguard.h"
#include "common/image/color.h"
#include "worker/render/texture/texture_data.h"

enum { GUESSES = 4096 };

/* Accumulates a level's next rows. */
struct level_sums {
    float32 *narrow;  /* the row above, made as wide as this level */
    float32 *rows[2]; /* row i in rows[i & 1] */
};

struct maker {
    const struct texture_image *image;
    int color;
    struct level_sums sums[TEXTURE_LEVELS_MAX]; /* [0] is unused */
    float32 border[256];                        /* decoded value above which the 8-bit sRGB code is larger than i */
    uint8_t guess[GUESSES];                     /* code of i / GUESSES: a lower bound where the search starts */
};

void texture_levels(struct texture_image *image)
{
    uint32_t width = image->width, height = image->height, level = 0;
    size_t first = 0;

    for (;;) {
        image->levels[level] = (struct texture_level){width, height, first};
        if (width == 1 && height == 1)
            break;
        if (level > 0)
            first += (size_t)width * height;
        width = width > 1 ? width / 2 : 1;
        height = height > 1 ? height / 2 : 1;
        level++;
    }
    image->last_level = level;
    image->longest = (float32)(image->width > image->height ? image->width : image->height);
}

static int is_alpha(const struct texture_image *image, uint32_t channel)
{
    return image->channels % 2 == 0 && channel + 1 == image->channels;
}

/* Is the channel averaged as light, not as the file's codes? */
static int is_light(const struct maker *m, uint32_t channel)
{
    return m->color && !is_alpha(m->image, channel) && SAFEGUARD(MIP_LIGHT);
}

/* ---- values in and out -------------------------------------------------------------------- */

static void decode_row(const struct maker *m, uint32_t y, float32 *row)
{
    const struct texture_image *image = m->image;
    size_t count = (size_t)image->width * image->channels, start = y * count;
    const uint8_t *bytes = (const uint8_t *)image->texels + start;
    const uint16_t *words = (const uint16_t *)image->texels + start;

    if (image->layout == TEXTURE_FLOAT) {
        memcpy(row, (const float32 *)image->texels + start, count * sizeof *row);
        return;
    }
    for (uint32_t c = 0; c < image->channels; c++) {
        int color = is_light(m, c);

        if (image->layout == TEXTURE_16)
            for (size_t i = c; i < count; i += image->channels)
                row[i] = color ? image->srgb16[words[i]] : (float32)words[i] / 65535.0f;
        else
            for (size_t i = c; i < count; i += image->channels)
                row[i] = color ? image->srgb8[bytes[i]] : (float32)bytes[i] / 255.0f;
    }
}

static uint8_t encode_srgb8(const struct maker *m, float32 x)
{
    unsigned code = m->guess[x < 1.0f ? (unsigned)(x * GUESSES) : GUESSES - 1];

    while (code < 255 && x > m->border[code])
        code++;
    return (uint8_t)code;
}

static void set_encoding(struct maker *m)
{
    unsigned code = 0;

    for (int i = 0; i < 255; i++)
        m->border[i] = srgb_decode(((float32)i + 0.5f) / 255.0f);
    for (int i = 0; i < GUESSES; i++) {
        while (code < 255 && (float32)i / GUESSES > m->border[code])
            code++;
        m->guess[i] = (uint8_t)code;
    }
}

/* 0..1 as an integer up to `top`. */
static uint32_t quantized(float32 value, float32 top)
{
    float32 scaled = value * top;

    return (uint32_t)(scaled + 0.5f);
}

static void store_row(const struct maker *m, uint32_t level, uint32_t y, const float32 *row)
{
    const struct texture_image *image = m->image;
    const struct texture_level *to = &image->levels[level];
    size_t count = (size_t)to->width * image->channels;
    size_t start = (to->first + (size_t)y * to->width) * image->channels;
    uint8_t *bytes = (uint8_t *)image->pyramid[m->color] + start;
    uint16_t *words = (uint16_t *)image->pyramid[m->color] + start;
    float32 *floats = (float32 *)image->pyramid[m->color] + start;

    for (uint32_t c = 0; c < image->channels; c++) {
        int color = is_light(m, c);

        for (size_t i = c; i < count; i += image->channels)
            switch (image->layout) {
            case TEXTURE_FLOAT:
                floats[i] = float_min(row[i], FLT_MAX);
                break;
            case TEXTURE_16:
                words[i] = (uint16_t)quantized(
                    color ? srgb_encode(row[i]) : float_min(row[i], 1.0f), 65535);
                break;
            default:
                bytes[i] = color ? encode_srgb8(m, row[i])
                                 : (uint8_t)quantized(float_min(row[i], 1.0f), 255);
            }
    }
}

/* ---- one row down ------------------------------------------------------------------------- */

/* How much of source cell i of `from` falls into target cell k of `to`, as a share of the latter. */
static float32 overlap(uint64_t i, uint64_t k, uint64_t from, uint64_t to)
{
    uint64_t begin = i * to > k * from ? i * to : k * from;
    uint64_t end = (i + 1) * to < (k + 1) * from ? (i + 1) * to : (k + 1) * from;

    return (float32)(end - begin) / (float32)from;
}

static void narrow_row(const float32 *row, uint32_t from, uint32_t to, uint32_t channels, float32 *out)
{
    if (from == to) {
        memcpy(out, row, (size_t)to * channels * sizeof *out);
        return;
    }
    for (uint32_t k = 0; k < to; k++, out += channels) {
        uint64_t first = (uint64_t)k * from / to;
        uint64_t last = ((uint64_t)(k + 1) * from - 1) / to;
        const float32 *in = row + first * channels;

        if (from == 2 * to) {
            for (uint32_t c = 0; c < channels; c++)
                out[c] = 0.5f * in[c] + 0.5f * in[channels + c];
            continue;
        }
        memset(out, 0, channels * sizeof *out);
        for (uint64_t i = first; i <= last; i++, in += channels) {
            float32 weight = overlap(i, k, from, to);

            for (uint32_t c = 0; c < channels; c++)
                out[c] += weight * in[c];
        }
    }
}

/* Row y of `level` is complete: add it to the rows of the next level that it overlaps, and continue
 * with those that it completes. Recursion ends with the levels, after at most 17. */
static void push_row(const struct maker *m, uint32_t level, uint32_t y, const float32 *row)
{
    const struct texture_level *from = &m->image->levels[level], *to = from + 1;
    const struct level_sums *sums = &m->sums[level + 1];
    size_t count = (size_t)to->width * m->image->channels;
    uint64_t rows = to->height, last;

    if (level == m->image->last_level)
        return;
    narrow_row(row, from->width, to->width, m->image->channels, sums->narrow);
    last = ((y + 1) * rows - 1) / from->height;
    for (uint64_t k = y * rows / from->height; k <= last; k++) {
        float32 *sum = sums->rows[k & 1];
        float32 weight = overlap(y, k, from->height, rows);

        if (y * rows <= k * from->height)
            memset(sum, 0, count * sizeof *sum);
        for (size_t i = 0; i < count; i++)
            sum[i] += weight * sums->narrow[i];
        if ((y + 1) * rows >= (k + 1) * from->height) {
            store_row(m, level + 1, (uint32_t)k, sum);
            push_row(m, level + 1, (uint32_t)k, sum);
        }
    }
}

status texture_pyramid_make(struct texture_image *image, int color, struct error *err)
{
    const struct texture_level *last = &image->levels[image->last_level];
    size_t row_floats = (size_t)image->width * image->channels, total = row_floats;
    struct maker *m = mem_calloc(1, sizeof *m);
    float32 *rows = NULL, *at;
    status st = STATUS_OK;

    for (uint32_t level = 1; level <= image->last_level; level++)
        total += 3 * (size_t)image->levels[level].width * image->channels;
    rows = mem_alloc_array(total, sizeof *rows);
    image->pyramid[color] = mem_alloc_array(last->first + 1, image->channels * texture_value_bytes(image));
    if (!m || !rows || !image->pyramid[color]) {
        mem_free(image->pyramid[color]);
        image->pyramid[color] = NULL;
        st = error_no_memory(err, "a texture's smaller copies");
        goto done;
    }
    mem_advise_large_pages(image->pyramid[color], (last->first + 1) * image->texel_bytes);
    m->image = image;
    m->color = color;
    set_encoding(m);
    at = rows + row_floats;
    for (uint32_t level = 1; level <= image->last_level; level++) {
        size_t count = (size_t)image->levels[level].width * image->channels;

        m->sums[level] = (struct level_sums){at, {at + count, at + 2 * count}};
        at += 3 * count;
    }
    for (uint32_t y = 0; y < image->height; y++) {
        decode_row(m, y, rows);
        push_row(m, 0, y, rows);
    }
done:
    mem_free(rows);
    mem_free(m);
    return st;
}
