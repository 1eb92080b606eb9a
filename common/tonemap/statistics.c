/* Measures a whole picture, in an order that does not depend on the number of threads. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/system/parallel.h"
#include "common/base/safeguard.h"
#include "common/math/elementary.h"
#include "common/tonemap/operators.h"
#include "common/tonemap/statistics.h"

static int is_identity(const double matrix[3][3])
{
    for (int i = 0; i < 9; i++)
        if (matrix[i / 3][i % 3] != (i % 4 == 0))
            return 0;
    return 1;
}

/* The luminance of a pixel after the matrix (NULL: none); negative: it is not finite. */
static inline double counted_luminance(const float rgb[3], const double (*matrix)[3])
{
    const double all = (double)rgb[0] + (double)rgb[1] + (double)rgb[2];
    float positive[3];
    double sum = 0.0;

    if (!isfinite(all) && SAFEGUARD(INFINITE_PIXEL))
        return -1.0;
    for (int i = 0; i < 3; i++)
        positive[i] = rgb[i] > 0.0f ? rgb[i] : 0.0f;
    if (!matrix)
        return tonemap_luminance(positive);
    for (int i = 0; i < 3; i++)
        sum += tonemap_weights[i] * fmax(matrix[i][0] * (double)positive[0] + matrix[i][1] * (double)positive[1] +
                                             matrix[i][2] * (double)positive[2],
                                         0.0);
    return sum;
}

/* The sum of the logarithms of many numbers, by a product whose exponent is split off now and then,
 * at the cost of one logarithm. Each factor rounds by 1e-16. */
struct log_sum {
    double product;
    int64_t exponent;
};

/* `x` is a normal number: even a denormal float's luminance is one in double. */
static void log_sum_add(struct log_sum *sum, double x)
{
    uint64_t bits;

    sum->product *= x;
    if (!SAFEGUARD(LOG_SUM_RANGE))
        return;
    memcpy(&bits, &sum->product, sizeof bits);
    sum->exponent += (int64_t)(bits >> 52) - 1023;
    bits = (bits & 0xfffffffffffffull) | 0x3ff0000000000000ull;
    memcpy(&sum->product, &bits, sizeof bits);
}

static double log_sum_result(const struct log_sum *sum)
{
    return det_log_d(sum->product) + (double)sum->exponent * det_log_d(2.0);
}

/* ---- log-mean, largest and smallest ---------------------------------------------------------- */

/* The log-mean is that of the means of windows around the pixels that are lit. That of single pixels follows the number of
 * samples: where few of them find light, pixels without any would not count, and the others are too bright. */
enum {
    REACH = STATISTICS_WINDOW / 2,
    MARGIN = 2 * REACH, /* of a patch, for the windows of its pixels and of the pixels in these */
    /* A patch's lines stay in the processor's cache. */
    PATCH_WIDTH = 512,
    PATCH_HEIGHT = 128,
    LINE = PATCH_WIDTH + 2 * MARGIN,
    RING = 16, /* at least a window and the lines that follow until one of its own is complete */
    /* A double's upper bits are its log2, in steps of 2^-12 and within .09. */
    LOG_SHIFT = 40,
    LOG_UNIT = 1 << 12,
    BRIGHTEST = 6, /* log2 of how many times its window's log-mean a pixel counts at most: a firefly is no light */
};

struct rectangle {
    uint32_t left, top, right, bottom; /* right and bottom are outside */
};

struct patch_sum {
    double log_sum, max, min;
    size_t counted;
};

struct measuring {
    const struct image *in;
    const double (*matrix)[3]; /* NULL: none */
    uint32_t apart;            /* 0, or the side of tiles, which are patches, and which no window leaves */
    struct patch_sum *patches;
};

/* A patch's lines with their margins, `width` pixels; what is not in the picture is 0. */
struct lines {
    size_t width, first, last; /* [first, last) of a line is in the picture */
    double light[RING][LINE];  /* luminances, limited once the pixel's window is known */
    /* Finite pixels << 16 | lit ones, and the logarithms of these; and their sums over a window's lines. */
    int32_t counts[STATISTICS_WINDOW][LINE], logs[STATISTICS_WINDOW][LINE];
    int32_t column_counts[LINE], column_logs[LINE];
    int32_t windows[RING][LINE]; /* counts, of the window around pixel [i + 4] */
};

static int is_lit(double luminance) { return luminance > 0.0 || !SAFEGUARD(BLACK_PIXEL); }

static int32_t rough_log(double x)
{
    uint64_t bits;

    memcpy(&bits, &x, sizeof bits);
    return (int32_t)(bits >> LOG_SHIFT);
}

static double rough_exp(int32_t log)
{
    const uint64_t bits = (uint64_t)log << LOG_SHIFT;
    double x;

    memcpy(&x, &bits, sizeof x);
    return x;
}

static void lines_begin(struct lines *lines, const struct rectangle *area, const struct rectangle *patch)
{
    const uint32_t before = patch->left - area->left, after = area->right - patch->right;

    lines->width = patch->right - patch->left + 2 * MARGIN;
    lines->first = before < MARGIN ? MARGIN - before : 0;
    lines->last = lines->width - (after < MARGIN ? MARGIN - after : 0);
    for (int k = 0; k < STATISTICS_WINDOW; k++) {
        memset(lines->counts[k], 0, lines->width * sizeof *lines->counts[k]);
        memset(lines->logs[k], 0, lines->width * sizeof *lines->logs[k]);
    }
    memset(lines->column_counts, 0, lines->width * sizeof *lines->column_counts);
    memset(lines->column_logs, 0, lines->width * sizeof *lines->column_logs);
}

/* Line `y` of the patch and its margins, from 0 on; `rgb` is its pixel at `first`, NULL: it is outside. */
static void take_line(struct lines *lines, const struct measuring *m, uint32_t y, const float *rgb)
{
    double *light = lines->light[y % RING];
    int32_t *counts = lines->counts[y % STATISTICS_WINDOW], *logs = lines->logs[y % STATISTICS_WINDOW];

    for (size_t i = 0; i < lines->width; i++)
        light[i] = -1.0;
    if (rgb && m->matrix)
        for (size_t i = lines->first; i < lines->last; i++, rgb += 3)
            light[i] = counted_luminance(rgb, m->matrix);
    else if (rgb)
        for (size_t i = lines->first; i < lines->last; i++, rgb += 3)
            light[i] = counted_luminance(rgb, NULL);
    for (size_t i = 0; i < lines->width; i++) {
        const int lit = light[i] >= 0.0 && is_lit(light[i]);
        const int32_t count = (light[i] >= 0.0) << 16 | lit, log = lit ? rough_log(light[i]) : 0;

        lines->column_counts[i] += count - counts[i];
        lines->column_logs[i] += log - logs[i];
        counts[i] = count;
        logs[i] = log;
        light[i] = light[i] > 0.0 ? light[i] : 0.0;
    }
}

static void find_ends(struct patch_sum *sum, const double *light, size_t count)
{
    double max[4] = {0}, min[4] = {DBL_MAX, DBL_MAX, DBL_MAX, DBL_MAX};

    for (size_t i = 0; i < count; i++) { /* four at once */
        const double dark = is_lit(light[i]) ? light[i] : DBL_MAX;

        max[i % 4] = light[i] > max[i % 4] ? light[i] : max[i % 4];
        min[i % 4] = dark < min[i % 4] ? dark : min[i % 4];
    }
    for (int k = 0; k < 4; k++) {
        sum->max = fmax(sum->max, max[k]);
        sum->min = fmin(sum->min, min[k]);
    }
}

_Static_assert(STATISTICS_WINDOW == 9, "sum_nine and sum_windows have nine");

/* out[i] is the sum of in[i] to in[i + 8]. */
static void sum_nine(int32_t out[LINE], const int32_t in[LINE], size_t width)
{
    int32_t two[LINE], four[LINE];

    for (size_t i = 0; i < width - 1; i++)
        two[i] = in[i] + in[i + 1];
    for (size_t i = 0; i < width - 3; i++)
        four[i] = two[i] + two[i + 2];
    for (size_t i = 0; i < width - 8; i++)
        out[i] = four[i] + four[i + 4] + in[i + 8];
}

/* Once the lines of its pixels' windows are there. */
static void limit_line(struct lines *lines, uint32_t y)
{
    double *light = lines->light[y % RING] + REACH;
    const int32_t *logs = lines->logs[y % STATISTICS_WINDOW] + REACH;
    int32_t *counts = lines->windows[y % RING], sums[LINE];
    int above = 0;

    sum_nine(counts, lines->column_counts, lines->width);
    sum_nine(sums, lines->column_logs, lines->width);
    for (size_t i = 0; i < lines->width - 2 * REACH; i++)
        above |= (float)(logs[i] - BRIGHTEST * LOG_UNIT) * (float)(counts[i] & 0xffff) > (float)sums[i];
    for (size_t i = 0; above && i < lines->width - 2 * REACH; i++)
        if ((float)(logs[i] - BRIGHTEST * LOG_UNIT) * (float)(counts[i] & 0xffff) > (float)sums[i])
            light[i] = rough_exp(sums[i] / (counts[i] & 0xffff) + BRIGHTEST * LOG_UNIT);
}

/* Of a window's lines, and then of 9 of these sums beside each other: without differences, which would lose dark pixels
 * beside bright ones. */
static void sum_windows(const struct lines *lines, uint32_t y, double sums[LINE])
{
    const double *line[STATISTICS_WINDOW];
    double two[LINE], four[LINE], nine[LINE];

    for (uint32_t k = 0; k < STATISTICS_WINDOW; k++)
        line[k] = lines->light[(y - REACH + k) % RING];
    for (size_t i = 0; i < lines->width; i++)
        nine[i] = ((line[0][i] + line[1][i]) + (line[2][i] + line[3][i])) +
                  ((line[4][i] + line[5][i]) + (line[6][i] + line[7][i])) + line[8][i];
    for (size_t i = 0; i < lines->width - 1; i++)
        two[i] = nine[i] + nine[i + 1];
    for (size_t i = 0; i < lines->width - 3; i++)
        four[i] = two[i] + two[i + 2];
    for (size_t i = 0; i < lines->width - 8; i++)
        sums[i] = four[i] + four[i + 4] + nine[i + 8];
}

/* Once the lines of its pixels' windows are limited. */
static void sum_line(struct patch_sum *out, struct log_sum *logs, const struct lines *lines, uint32_t y)
{
    const double *light = lines->light[y % RING] + MARGIN;
    const int32_t *counts = lines->windows[y % RING] + REACH;
    const size_t width = lines->width - 2 * MARGIN;
    double sums[LINE + 4], *means = sums + REACH;
    size_t counted = 0;

    sum_windows(lines, y, sums);
    for (size_t i = 0; i < width; i++) {
        const int lit = counts[i] >= 1 << 16 && is_lit(light[i]);

        means[i] = lit ? means[i] / (counts[i] >> 16) : 1.0;
        counted += (size_t)lit;
    }
    for (size_t i = width; i % 4; i++)
        means[i] = 1.0;
    for (size_t i = 0; i < width; i += 4) /* the exponents of four floats' product fit a double */
        log_sum_add(logs, (means[i] * means[i + 1]) * (means[i + 2] * means[i + 3]));
    out->counted += counted;
}

/* Windows stay in the area. */
static void measure_patch(struct patch_sum *out, const struct measuring *m, const struct rectangle *area,
                          const struct rectangle *patch)
{
    const uint32_t height = patch->bottom - patch->top;
    struct log_sum logs = {1.0, 0};
    struct lines lines;

    *out = (struct patch_sum){.min = DBL_MAX};
    lines_begin(&lines, area, patch);
    for (uint32_t y = 0; y < height + 2 * MARGIN; y++) {
        const int64_t at = (int64_t)patch->top + y - MARGIN;
        const int inside = at >= area->top && at < area->bottom;

        take_line(&lines, m, y,
                  inside ? m->in->pixels + ((size_t)at * m->in->width + patch->left + lines.first - MARGIN) * 3 : NULL);
        if (y >= MARGIN && y < height + MARGIN)
            find_ends(out, lines.light[y % RING] + MARGIN, lines.width - 2 * MARGIN);
        if (y >= 2 * REACH)
            limit_line(&lines, y - REACH);
        if (y >= 2 * MARGIN)
            sum_line(out, &logs, &lines, y - MARGIN);
    }
    out->log_sum = log_sum_result(&logs);
}

static uint32_t pieces(uint32_t pixels, uint32_t size) { return (pixels + size - 1) / size; }

static uint32_t smaller(uint32_t a, uint32_t b) { return a < b ? a : b; }

static void measure_patches(void *user, size_t begin, size_t end)
{
    const struct measuring *m = user;
    const struct rectangle picture = {0, 0, m->in->width, m->in->height};
    const uint32_t width = m->apart ? m->apart : PATCH_WIDTH, height = m->apart ? m->apart : PATCH_HEIGHT;
    const uint32_t across = pieces(picture.right, width);

    for (size_t i = begin; i < end; i++) {
        const uint32_t left = (uint32_t)(i % across) * width, top = (uint32_t)(i / across) * height;
        const struct rectangle patch = {left, top, smaller(left + width, picture.right),
                                        smaller(top + height, picture.bottom)};

        measure_patch(&m->patches[i], m, m->apart ? &patch : &picture, &patch);
    }
}

status statistics_measure(struct tonemap_statistics *out, const struct image *in, const double matrix[3][3],
                          uint32_t apart, unsigned threads, struct error *err)
{
    const size_t count =
        (size_t)pieces(in->width, apart ? apart : PATCH_WIDTH) * pieces(in->height, apart ? apart : PATCH_HEIGHT);
    struct measuring m = {in, is_identity(matrix) ? NULL : matrix, apart, mem_alloc_array(count, sizeof *m.patches)};
    double log_sum = 0.0;

    *out = (struct tonemap_statistics){.log_mean = 1.0};
    NEED(m.patches, err, "the picture's statistics");
    parallel_for(threads, count, 1, measure_patches, &m);
    for (size_t i = 0; i < count; i++) {
        const struct patch_sum *patch = &m.patches[i];

        if (patch->counted == 0)
            continue;
        log_sum += patch->log_sum;
        out->counted += patch->counted;
        out->max = fmax(out->max, patch->max);
        out->min = out->min > 0.0 ? fmin(out->min, patch->min) : patch->min;
    }
    if (out->counted > 0)
        out->log_mean = det_exp_d(log_sum / (double)out->counted);
    mem_free(m.patches);
    return STATUS_OK;
}

/* ---- percentiles: the exact one, by counting the halves of the floats' bits ------------------ */

enum { HALF_VALUES = 1 << 16, HISTOGRAM_STRIPES = 16 };

struct counting {
    const struct image *image;
    enum tonemap_of of;
    const double (*matrix)[3];       /* of the raw picture's white balance; NULL: none */
    uint32_t (*counts)[HALF_VALUES]; /* [HISTOGRAM_STRIPES] */
    int lower;                       /* count by the lower half of the bits, of those with: */
    uint32_t upper;
};

/* The value of a pixel to be counted, as a float above 0 and below FLT_MAX; others do not count. */
static double counted_value(const struct counting *c, const float rgb[3])
{
    if (c->matrix)
        return counted_luminance(rgb, c->matrix);
    if (!(rgb[0] < FLT_MAX && rgb[1] < FLT_MAX && rgb[2] < FLT_MAX))
        return 0.0;
    if (c->of == TONEMAP_LARGEST_CHANNEL)
        return (double)fmaxf(rgb[0], fmaxf(rgb[1], rgb[2]));
    return counted_luminance(rgb, NULL);
}

static void count_stripes(void *user, size_t begin, size_t end)
{
    const struct counting *c = user;

    for (size_t s = begin; s < end; s++) {
        uint64_t height = c->image->height;
        size_t first = (size_t)(height * s / HISTOGRAM_STRIPES);
        size_t last = (size_t)(height * (s + 1) / HISTOGRAM_STRIPES);
        const float *p = c->image->pixels + first * c->image->width * 3;

        memset(c->counts[s], 0, sizeof c->counts[s]);
        for (size_t left = (last - first) * c->image->width; left > 0; left--, p += 3) {
            float value = (float)fmin(counted_value(c, p), (double)FLT_MAX);
            uint32_t bits = float_bits(value);

            if (!(value > 0.0f))
                continue;
            if (!c->lower)
                c->counts[s][bits >> 16]++;
            else if (bits >> 16 == c->upper)
                c->counts[s][bits & 0xffff]++;
        }
    }
}

static uint64_t count_of(const struct counting *c, uint32_t value)
{
    uint64_t sum = 0;

    for (int s = 0; s < HISTOGRAM_STRIPES; s++)
        sum += c->counts[s][value];
    return sum;
}

/* The value at which `*rank` is used up; *rank becomes the remainder within that value. */
static uint32_t find_rank(const struct counting *c, uint64_t *rank)
{
    for (uint32_t value = 0; value < HALF_VALUES; value++) {
        uint64_t count = count_of(c, value);
        if (*rank < count)
            return value;
        *rank -= count;
    }
    return HALF_VALUES - 1;
}

static status percentile(double *out, struct counting *c, double percent, unsigned threads, struct error *err)
{
    uint64_t total = 0, rank;

    *out = 0.0;
    c->counts = mem_alloc_array(HISTOGRAM_STRIPES, sizeof *c->counts);
    NEED(c->counts, err, "a histogram");
    parallel_for(threads, HISTOGRAM_STRIPES, 1, count_stripes, c);
    for (uint32_t value = 0; value < HALF_VALUES; value++)
        total += count_of(c, value);
    if (total > 0) {
        rank = (uint64_t)(percent / 100.0 * (double)(total - 1) + 0.5);
        rank = rank < total ? rank : total - 1;
        c->upper = find_rank(c, &rank);
        c->lower = 1;
        parallel_for(threads, HISTOGRAM_STRIPES, 1, count_stripes, c);
        *out = (double)float_from_bits(c->upper << 16 | find_rank(c, &rank));
    }
    mem_free(c->counts);
    return STATUS_OK;
}

status tonemap_percentile_of(double *out, const struct image *image, enum tonemap_of of, double percent,
                             unsigned threads, struct error *err)
{
    struct counting c = {.image = image, .of = of};

    return percentile(out, &c, percent, threads, err);
}

status statistics_percentile(double *out, const struct image *in, const double matrix[3][3], double percent,
                             unsigned threads, struct error *err)
{
    struct counting c = {.image = in, .matrix = matrix};

    return percentile(out, &c, percent, threads, err);
}
