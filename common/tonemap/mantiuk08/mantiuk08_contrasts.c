/* The conditional contrast densities of mantiuk08 (section 4.4 of the paper): for every pixel, in
 * every band of an undecimated Laplacian pyramid of log10 luminance, the contrast is counted under
 * the background on which it lies. Two planes are held: a level and the next one. */
#include <math.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/system/parallel.h"
#include "common/base/safeguard.h"
#include "common/math/elementary.h"
#include "common/math/quick.h"
#include "common/tonemap/mantiuk08/mantiuk08.h"
#include "common/tonemap/operators.h"

/* A picture is always divided into the same pieces, whatever the number of threads. */
enum { STRIPES = 64, TAPS = 5, TAPS_SIDE = TAPS / 2 };

/* P. Burt, E. Adelson 1983, with a = 0.4. */
static const float tap[TAPS] = {0.05f, 0.25f, 0.4f, 0.25f, 0.05f};

/* In log10 luminance: the invisible contrasts, and those of the first bin. */
static const float THRESHOLD = 0.0043f, FIRST_BIN = 0.05f;
static const float CONTRAST_MAX = 0.7f; /* of the bins' centres */
/* The authors' program rounds to the nearest bin but towards 0 below it, so the darkest bin
 * receives more than the others; their curves show it. */
static const float CONTRAST_MOST = 0.75f, CONTRAST_LEAST = -0.85f;
static const double LOWEST_FREQUENCY = 3.0; /* no band below this is needed */

typedef uint32_t bins[M08_NODES][M08_BINS];

struct pyramid {
    const struct tonemap_frame *frame;
    uint32_t width, height;
    size_t spacing; /* of the taps */
    size_t stripes;
    const float *fine; /* [height][width], a level */
    float *coarse;     /* the next one */
    float *lines;      /* [stripes][width] */
    bins *counts;      /* [stripes] */
};

/* The index in 0..count-1 that mirrors show at `at`; the border itself appears once. */
static size_t mirrored(int64_t at, uint32_t count)
{
    int64_t period = 2 * ((int64_t)count - 1);

    if (period == 0)
        return 0;
    at %= period;
    if (at < 0)
        at += period;
    return (size_t)(at < (int64_t)count ? at : period - at);
}

static void blur_down(const struct pyramid *p, size_t y, float *out)
{
    const float *rows[TAPS];

    for (int t = 0; t < TAPS; t++)
        rows[t] = p->fine + p->width * mirrored((int64_t)y + (t - TAPS_SIDE) * (int64_t)p->spacing, p->height);
    for (size_t x = 0; x < p->width; x++)
        out[x] = (tap[0] * (rows[0][x] + rows[4][x]) + tap[1] * (rows[1][x] + rows[3][x])) + tap[2] * rows[2][x];
}

static float blur_at(const float *line, const size_t at[TAPS])
{
    return (tap[0] * (line[at[0]] + line[at[4]]) + tap[1] * (line[at[1]] + line[at[3]])) + tap[2] * line[at[2]];
}

static void blur_across(const struct pyramid *p, const float *line, float *out)
{
    size_t reach = TAPS_SIDE * p->spacing, s = p->spacing;

    for (size_t x = 0; x < p->width; x++) {
        size_t at[TAPS];

        if (x == reach && p->width > 2 * reach) { /* the inner part without mirrors */
            for (; x < p->width - reach; x++)
                out[x] = blur_at(line, (const size_t[TAPS]){x - 2 * s, x - s, x, x + s, x + 2 * s});
        }
        for (int t = 0; t < TAPS; t++)
            at[t] = mirrored((int64_t)x + (t - TAPS_SIDE) * (int64_t)s, p->width);
        out[x] = blur_at(line, at);
    }
}

/* The nearest node or bin, for a place that is not negative. */
static int nearest(float place) { return (int)(place + 0.5f); }

static void count_line(const float *fine, const float *coarse, uint32_t width, bins counts)
{
    for (size_t x = 0; x < width; x++) {
        float contrast = fine[x] - coarse[x], size = fabsf(contrast);
        int node = nearest((coarse[x] - (float)M08_X_MIN) * (float)(1.0 / M08_STEP));
        int bin = M08_CENTRE;

        if (!(contrast < CONTRAST_MOST && contrast > CONTRAST_LEAST))
            continue;
        if (size > THRESHOLD && size < FIRST_BIN)
            bin += contrast > 0.0f ? 1 : -1;
        else
            bin = nearest(fmaxf(contrast + CONTRAST_MAX, 0.0f) * (float)(1.0 / M08_STEP));
        node = node < 0 ? 0 : node < M08_NODES ? node : M08_NODES - 1; /* rounding */
        counts[node][bin]++;
    }
}

static void do_stripes(void *user, size_t begin, size_t end)
{
    const struct pyramid *p = user;

    for (size_t s = begin; s < end; s++) {
        size_t last = p->height * (s + 1) / p->stripes;
        float *line = p->lines + s * p->width;

        memset(p->counts[s], 0, sizeof p->counts[s]);
        for (size_t y = p->height * s / p->stripes; y < last; y++) {
            float *coarse = p->coarse + y * p->width;

            blur_down(p, y, line);
            blur_across(p, line, coarse);
            count_line(p->fine + y * p->width, coarse, p->width, p->counts[s]);
        }
    }
}

/* A background with only invisible contrasts would leave its part of the curve undetermined, so it gets a little of the
 * smallest visible one. The authors' program does so for all backgrounds, as their curves show. */
static void mend_singular(uint64_t counts[M08_BINS])
{
    if (counts[M08_CENTRE] > 0 && SAFEGUARD(MANTIUK08_SINGULAR)) {
        counts[M08_CENTRE - 1]++;
        counts[M08_CENTRE + 1]++;
    }
}

static void measure_band(struct m08_contrasts *out, struct pyramid *p)
{
    uint64_t(*counts)[M08_BINS] = out->counts[out->bands];

    p->spacing = (size_t)1 << out->bands;
    parallel_for(p->frame->threads, p->stripes, 1, do_stripes, p);
    for (size_t s = 0; s < p->stripes; s++)
        for (int i = 0; i < M08_NODES * M08_BINS; i++)
            counts[i / M08_BINS][i % M08_BINS] += p->counts[s][i / M08_BINS][i % M08_BINS];
    for (int i = 0; i < M08_NODES; i++)
        mend_singular(counts[i]);
    out->bands++;
}

double m08_log(double luminance)
{
    double log = luminance > 0.0 ? det_log_d(luminance) * M08_INV_LN10 : M08_X_MIN;

    return fmax(M08_X_MIN, fmin(log, -M08_X_MIN));
}

struct logs {
    float *plane;
    const struct image *image;
    float darkest;
    struct quick quick;
};

static void log_lines(void *user, size_t begin, size_t end)
{
    const struct logs *l = user;

    for (size_t i = begin * l->image->width; i < end * l->image->width; i++) {
        double luminance = tonemap_luminance(l->image->pixels + 3 * i);
        float log10_l = l->darkest;

        if (luminance > 0.0)
            log10_l = (float)(quick_log2(&l->quick, luminance) * M08_LOG10_2);
        log10_l = log10_l < (float)-M08_X_MIN ? log10_l : (float)-M08_X_MIN;
        l->plane[i] = log10_l > l->darkest ? log10_l : l->darkest;
    }
}

void m08_log_plane(float *plane, const struct tonemap_frame *frame)
{
    struct logs l = {.plane = plane, .image = frame->image,
                     .darkest = (float)m08_log(frame->statistics.min)};

    quick_init(&l.quick);
    parallel_for(frame->threads, frame->image->height, 8, log_lines, &l);
}

status m08_contrasts_measure(struct m08_contrasts *out, const struct tonemap_frame *frame, double ppd,
                             struct error *err)
{
    uint32_t width = frame->image->width, height = frame->image->height;
    size_t pixels = (size_t)width * height, stripes = height < STRIPES ? height : STRIPES;
    float *fine = mem_alloc_array(pixels, sizeof *fine);
    float *coarse = mem_alloc_array(pixels, sizeof *coarse);
    struct pyramid p = {.frame = frame, .width = width, .height = height, .stripes = stripes};
    status st = STATUS_OK;

    memset(out, 0, sizeof *out);
    p.lines = mem_alloc_array(stripes * width, sizeof *p.lines);
    p.counts = mem_alloc_array(stripes, sizeof *p.counts);
    if (!fine || !coarse || !p.lines || !p.counts)
        st = error_no_memory(err, "the contrasts of a picture");
    else
        m08_log_plane(fine, frame);
    for (double frequency = 0.5 * ppd; st == STATUS_OK; frequency *= 0.5) {
        float *swap = fine;

        p.fine = fine;
        p.coarse = coarse;
        out->frequency[out->bands] = frequency;
        measure_band(out, &p);
        fine = coarse;
        coarse = swap;
        if (frequency <= LOWEST_FREQUENCY || out->bands == M08_BANDS_MAX)
            break;
    }
    mem_free(p.counts);
    mem_free(p.lines);
    mem_free(coarse);
    mem_free(fine);
    return st;
}
