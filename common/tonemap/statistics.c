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

/* The log-mean is that of blocks of so many by so many pixels, which count by their pixels that are lit. That of single
 * pixels follows the number of samples: where few of them find light, pixels without any would not count, and the others
 * are too bright. A tile is whole blocks: a sample of a picture's tiles has the same statistics. */
enum { BLOCK = 8 };
/* A pixel counts at most as so many times its block's log-mean: a firefly is no light of the block. */
#define BRIGHTEST 64.0

struct row_sum {
    double log_sum, max, min;
    size_t counted;
};

struct measuring {
    const struct image *in;
    const double (*matrix)[3]; /* NULL: none */
    struct row_sum *rows;      /* of blocks */
};

static int is_identity(const double matrix[3][3])
{
    for (int i = 0; i < 9; i++)
        if (matrix[i / 3][i % 3] != (i % 4 == 0))
            return 0;
    return 1;
}

/* The luminance of a pixel after the matrix (NULL: none); negative: it is not finite. */
static double counted_luminance(const float rgb[3], const double (*matrix)[3])
{
    float positive[3];
    double sum = 0.0;

    if ((!isfinite(rgb[0]) || !isfinite(rgb[1]) || !isfinite(rgb[2])) && SAFEGUARD(INFINITE_PIXEL))
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

/* One block's luminances that are finite; of those above 0 how many, their sum, the largest and the smallest. */
struct block {
    double light[BLOCK * BLOCK];
    uint32_t pixels, lit;
    double sum, max, min;
};

static void take_block(struct block *out, const struct measuring *m, uint32_t left, uint32_t top)
{
    out->pixels = out->lit = 0;
    out->sum = out->max = 0.0;
    out->min = DBL_MAX;
    for (uint32_t y = top; y < top + BLOCK && y < m->in->height; y++) {
        const float *p = m->in->pixels + ((size_t)y * m->in->width + left) * 3;

        for (uint32_t x = left; x < left + BLOCK && x < m->in->width; x++, p += 3) {
            const double luminance = counted_luminance(p, m->matrix);

            if (luminance < 0.0)
                continue;
            out->light[out->pixels++] = luminance;
            if (!(luminance > 0.0) && SAFEGUARD(BLACK_PIXEL))
                continue;
            out->lit++;
            out->sum += luminance;
            out->max = luminance > out->max ? luminance : out->max;
            out->min = luminance < out->min ? luminance : out->min;
        }
    }
}

/* The sum with pixels of at most BRIGHTEST log-means. */
static double limited_sum(const struct block *block)
{
    struct log_sum logs = {1.0, 0};
    double most, sum = 0.0;

    for (uint32_t i = 0; i < block->pixels; i++)
        if (block->light[i] > 0.0 || !SAFEGUARD(BLACK_PIXEL))
            log_sum_add(&logs, block->light[i]);
    most = BRIGHTEST * det_exp_d(log_sum_result(&logs) / block->lit);
    for (uint32_t i = 0; i < block->pixels; i++)
        sum += block->light[i] < most ? block->light[i] : most;
    return sum;
}

static void add_block(struct row_sum *sum, const struct block *block)
{
    double light = block->sum;

    if (block->lit == 0)
        return;
    if (block->max > BRIGHTEST * block->min) /* the log-mean is no less than the smallest */
        light = limited_sum(block);
    sum->log_sum += block->lit * det_log_d(light / block->pixels);
    sum->counted += block->lit;
    sum->max = block->max > sum->max ? block->max : sum->max;
    sum->min = block->min < sum->min || sum->min == 0.0 ? block->min : sum->min;
}

static void measure_rows(void *user, size_t begin, size_t end)
{
    const struct measuring *m = user;
    struct block block;

    for (size_t row = begin; row < end; row++) {
        m->rows[row] = (struct row_sum){0};
        for (uint32_t left = 0; left < m->in->width; left += BLOCK) {
            take_block(&block, m, left, (uint32_t)row * BLOCK);
            add_block(&m->rows[row], &block);
        }
    }
}

status statistics_measure(struct tonemap_statistics *out, const struct image *in, const double matrix[3][3],
                          unsigned threads, struct error *err)
{
    const uint32_t rows = (in->height + BLOCK - 1) / BLOCK;
    struct measuring m = {in, is_identity(matrix) ? NULL : matrix, mem_alloc_array(rows, sizeof *m.rows)};
    double log_sum = 0.0;

    *out = (struct tonemap_statistics){.log_mean = 1.0};
    NEED(m.rows, err, "the picture's statistics");
    parallel_for(threads, rows, 1, measure_rows, &m);
    for (uint32_t y = 0; y < rows; y++) {
        const struct row_sum *row = &m.rows[y];

        if (row->counted == 0)
            continue;
        log_sum += row->log_sum;
        out->counted += row->counted;
        out->max = fmax(out->max, row->max);
        out->min = out->min > 0.0 ? fmin(out->min, row->min) : row->min;
    }
    if (out->counted > 0)
        out->log_mean = det_exp_d(log_sum / (double)out->counted);
    mem_free(m.rows);
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
