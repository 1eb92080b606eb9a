/* What is measured of a whole picture, in an order that no number of threads changes. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/base/parallel.h"
#include "common/math/elementary.h"
#include "common/tonemap/operators.h"
#include "common/tonemap/statistics.h"

struct line_sum {
    double log_sum, max, min;
    size_t counted;
};

struct measuring {
    const struct image *in;
    const double (*matrix)[3];
    struct line_sum *lines;
};

/* The luminance of a pixel after the matrix; 0 when it does not count. */
static double counted_luminance(const float rgb[3], const double matrix[3][3])
{
    static const double weights[3] = {0.212656, 0.715158, 0.072186};
    double sum = 0.0;

    if (!isfinite(rgb[0]) || !isfinite(rgb[1]) || !isfinite(rgb[2]))
        return 0.0;
    for (int i = 0; i < 3; i++) {
        double value = 0.0;
        for (int j = 0; j < 3; j++)
            value += matrix[i][j] * (rgb[j] > 0.0f ? (double)rgb[j] : 0.0);
        if (value > 0.0)
            sum += weights[i] * value;
    }
    return sum;
}

static void measure_lines(void *user, size_t begin, size_t end)
{
    const struct measuring *m = user;

    for (size_t y = begin; y < end; y++) {
        struct line_sum line = {0};
        const float *p = m->in->pixels + y * m->in->width * 3;

        for (uint32_t x = 0; x < m->in->width; x++, p += 3) {
            double luminance = counted_luminance(p, m->matrix);

            if (!(luminance > 0.0))
                continue;
            line.log_sum += det_log_d(luminance);
            line.counted++;
            if (luminance > line.max)
                line.max = luminance;
            if (luminance < line.min || line.min == 0.0)
                line.min = luminance;
        }
        m->lines[y] = line;
    }
}

status statistics_measure(struct tonemap_statistics *out, const struct image *in,
                          const double matrix[3][3], unsigned threads, struct error *err)
{
    struct measuring m = {in, matrix, mem_alloc_array(in->height, sizeof *m.lines)};
    double log_sum = 0.0;

    *out = (struct tonemap_statistics){.log_mean = 1.0};
    if (!m.lines)
        return error_no_memory(err, "the picture's statistics");
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
    uint32_t (*counts)[HALF_VALUES]; /* [HISTOGRAM_STRIPES] */
    uint32_t upper;                  /* of the values to count by their lower half; -1: all, by
                                      * their upper one */
    int lower;
};

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
            double luminance = tonemap_luminance(p);
            uint32_t bits;

            if (!(luminance > 0.0) || !isfinite(luminance))
                continue;
            bits = float_bits(luminance < (double)FLT_MAX ? (float)luminance : FLT_MAX);
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

/* The value at which `*rank` is used up; what is left of it within the value stays in it. */
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

status tonemap_percentile(double *out, const struct image *image, double percent,
                          unsigned threads, struct error *err)
{
    struct counting c = {.image = image};
    uint64_t total = 0, rank;

    *out = 0.0;
    c.counts = mem_alloc_array(HISTOGRAM_STRIPES, sizeof *c.counts);
    if (!c.counts)
        return error_no_memory(err, "a histogram");
    parallel_for(threads, HISTOGRAM_STRIPES, 1, count_stripes, &c);
    for (uint32_t value = 0; value < HALF_VALUES; value++)
        total += count_of(&c, value);
    if (total > 0) {
        rank = (uint64_t)(percent / 100.0 * (double)(total - 1) + 0.5);
        rank = rank < total ? rank : total - 1;
        c.upper = find_rank(&c, &rank);
        c.lower = 1;
        parallel_for(threads, HISTOGRAM_STRIPES, 1, count_stripes, &c);
        *out = (double)float_from_bits(c.upper << 16 | find_rank(&c, &rank));
    }
    mem_free(c.counts);
    return STATUS_OK;
}
