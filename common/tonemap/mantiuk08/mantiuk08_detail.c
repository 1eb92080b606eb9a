/* The base layer for mantiuk08's detail: the guided filter of K. He, J. Sun, X. Tang, "Guided Image Filtering", IEEE
 * PAMI 35(6), 2013, of log10 luminance guided by itself. In every window the base is a line a value + b with a =
 * variance / (variance + FLAT), so it follows edges, whose variance is large (across a step of h decades about 2 FLAT /
 * h remains, the halo), and smooths fainter structure. Its cost does not depend on the window: sums run along columns
 * and lines. Windows end at the picture's border. */
#include <string.h>

#include "common/base/memory.h"
#include "common/system/parallel.h"
#include "common/tonemap/mantiuk08/mantiuk08.h"

/* A picture is always divided into the same pieces, whatever the number of threads: sums restart in each. */
enum { STRIPES = 16, RADIUS_MAX = 64 };

static const double FLAT = 0.01; /* variance of a contrast of 0.1 in log10 luminance */

/* A pass: sums of two planes over windows. */
struct pass {
    const struct m08_base *base;
    const float *p, *q; /* planes; q NULL: the square of p */
    double *sums;       /* [STRIPES][2][width] of the columns */
    float *lines;       /* [STRIPES][width] */
    void (*row)(const void *user, size_t y, const float *layer);
    const void *user;
};

static void add_line(const struct pass *pass, size_t y, double sign, double *sum_p, double *sum_q)
{
    size_t width = pass->base->width;
    const float *p = pass->p + y * width, *q = pass->q ? pass->q + y * width : p;

    for (size_t x = 0; x < width; x++) {
        double value = (double)p[x];

        sum_p[x] += sign * value;
        sum_q[x] += sign * (pass->q ? (double)q[x] : value * value);
    }
}

/* The means over the windows around the pixels of line y: what pass 1 makes of them, and 2. */
static void use_line(const struct pass *pass, size_t y, size_t lines, const double *sum_p, const double *sum_q,
                     float *layer)
{
    const struct m08_base *b = pass->base;
    size_t width = b->width, radius = (size_t)b->radius, count = 0;
    double p = 0.0, q = 0.0;

    for (size_t x = 0; x < width && x < radius; x++, count++)
        p += sum_p[x], q += sum_q[x];
    for (size_t x = 0; x < width; x++) {
        double mean_p, mean_q, share;

        if (x + radius < width)
            p += sum_p[x + radius], q += sum_q[x + radius], count++;
        if (x > radius)
            p -= sum_p[x - radius - 1], q -= sum_q[x - radius - 1], count--;
        mean_p = p / (double)(count * lines);
        mean_q = q / (double)(count * lines);
        if (layer) {
            layer[x] = (float)(mean_p * (double)b->value[y * width + x] + mean_q);
            continue;
        }
        mean_q -= mean_p * mean_p;
        share = mean_q > 0.0 ? mean_q / (mean_q + FLAT) : 0.0;
        b->a[y * width + x] = (float)share;
        b->b[y * width + x] = (float)((1.0 - share) * mean_p);
    }
}

static void do_stripes(void *user, size_t begin, size_t end)
{
    const struct pass *pass = user;
    size_t width = pass->base->width, height = pass->base->height;
    size_t radius = (size_t)pass->base->radius;

    for (size_t s = begin; s < end; s++) {
        size_t first = height * s / STRIPES, last = height * (s + 1) / STRIPES, lines = 0;
        size_t top = first > radius ? first - radius : 0;
        double *sum_p = pass->sums + 2 * s * width, *sum_q = sum_p + width;
        float *layer = pass->row ? pass->lines + s * width : NULL;

        memset(sum_p, 0, 2 * width * sizeof *sum_p);
        for (size_t y = top; y < first + radius && y < height; y++, lines++)
            add_line(pass, y, 1.0, sum_p, sum_q);
        for (size_t y = first; y < last; y++) {
            if (y + radius < height) {
                add_line(pass, y + radius, 1.0, sum_p, sum_q);
                lines++;
            }
            if (y > first && y > radius) {
                add_line(pass, y - radius - 1, -1.0, sum_p, sum_q);
                lines--;
            }
            use_line(pass, y, lines, sum_p, sum_q, layer);
            if (layer)
                pass->row(pass->user, y, layer);
        }
    }
}

static status run_pass(struct pass *pass, unsigned threads, struct error *err)
{
    size_t width = pass->base->width;
    status st = STATUS_OK;

    pass->sums = mem_alloc_array(2 * STRIPES * width, sizeof *pass->sums);
    pass->lines = mem_alloc_array(STRIPES * width, sizeof *pass->lines);
    if (pass->sums && pass->lines)
        parallel_for(threads, STRIPES, 1, do_stripes, pass);
    else
        st = error_no_memory(err, "the base layer of a picture");
    mem_free(pass->lines);
    mem_free(pass->sums);
    return st;
}

status m08_base_init(struct m08_base *base, const struct tonemap_frame *frame, double ppd, struct error *err)
{
    uint32_t width = frame->image->width, height = frame->image->height;
    size_t pixels = (size_t)width * height;
    struct pass pass = {.base = base};
    int radius = (int)(0.5 * ppd + 0.5); /* half a degree */

    *base = (struct m08_base){
        .width = width, .height = height,
        .radius = radius < 1 ? 1 : radius < RADIUS_MAX ? radius : RADIUS_MAX,
        .value = mem_alloc_array(pixels, sizeof *base->value),
        .a = mem_alloc_array(pixels, sizeof *base->a),
        .b = mem_alloc_array(pixels, sizeof *base->b),
    };
    NEED(base->value && base->a && base->b, err, "the base layer of a picture");
    m08_log_plane(base->value, frame);
    pass.p = base->value;
    return run_pass(&pass, frame->threads, err);
}

void m08_base_release(struct m08_base *base)
{
    mem_free(base->b);
    mem_free(base->a);
    mem_free(base->value);
    memset(base, 0, sizeof *base);
}

status m08_base_each_row(const struct m08_base *base, unsigned threads,
                         void (*row)(const void *user, size_t y, const float *layer), const void *user,
                         struct error *err)
{
    struct pass pass = {.base = base, .p = base->a, .q = base->b, .row = row, .user = user};

    return run_pass(&pass, threads, err);
}
