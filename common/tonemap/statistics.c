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

struct line_sum {
    double log_sum, max, min;
    size_t counted;
};

struct measuring {
    const struct image *in;
    const double (*matrix)[3]; /* NULL: none */
    struct line_sum *lines;
};

static int is_identity(const double matrix[3][3])
{
    for (int i = 0; i < 9; i++)
        if (matrix[i / 3][i % 3] != (i % 4 == 0))
            return 0;
    return 1;
}

/* The luminance of a pixel after the matrix (NULL: none); 0 when it does not count. */
static double counted_luminance(const float rgb[3], const double (*matrix)[3])
{
    float positive[3];
    double sum = 0.0;

    if ((!isfinite(rgb[0]) || !isfinite(rgb[1]) || !isfinite(rgb[2])) && SAFEGUARD(INFINITE_PIXEL))
        return 0.0;
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

static void measure_lines(void *user, size_t begin, size_t end)
{
    const struct measuring *m = user;

    for (size_t y = begin; y < end; y++) {
        struct line_sum line = {0};
        struct log_sum logs = {1.0, 0};
        const float *p = m->in->pixels + y * m->in->width * 3;

        for (uint32_t x = 0; x < m->in->width; x++, p += 3) {
            double luminance = counted_luminance(p, m->matrix);

            if (!(luminance > 0.0) && SAFEGUARD(BLACK_PIXEL))
                continue;
            log_sum_add(&logs, luminance);
            line.counted++;
            if (luminance > line.max)
                line.max = luminance;
            if (luminance < line.min || line.min == 0.0)
                line.min = luminance;
        }
        line.log_sum = log_sum_result(&logs);
        m->lines[y] = line;
    }
}

status statistics_measure(struct tonemap_statistics *out, const struct image *in, const double matrix[3][3],
                          unsigned threads, struct error *err)
{
    struct measuring m = {in, is_identity(matrix) ? NULL : matrix,
                          mem_alloc_array(in->height, sizeof *m.lines)};
    double log_sum = 0.0;

    *out = (struct tonemap_statistics){.log_mean = 1.0};
    NEED(m.lines, err, "the picture's statistics");
    parallel_for(threads, in->height, 8, measure_lines, &m);
    for (uint32_t y = 0; y < in->height; y++) {
        const struct line_sum *line = &m.lines[y];

        if (line->counted == 0)
            continue;
        log_sum += line->log_sum;
        out->counted += line->counted;
        out->max = fmax(out->max, line->max);
        out->min = out->min > 0.0 ? fmin(out->min, line->min) : line->min;
    }
    if (out->counted > 0)
        out->log_mean = det_exp_d(log_sum / (double)out->counted);
    mem_free(m.lines);
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
