#include "common/accuracy/figures.h"

#include <math.h>
#include <string.h>

#include "common/accuracy/quantile.h"
#include "common/accuracy/word.h"
#include "common/base/memory.h"
#include "common/math/elementary.h"

enum { CONTRASTS = 3, TILE = 16 };

/* The share of pixels that the display error leaves out, two-sided 95 % of a normal distribution. */
#define BEYOND 0.05
#define NORMAL_95 1.959963984540054
/* What the three contrasts' variance is of the variance of their mean less the real error. */
#define UNKNOWN_SHARE (4.0 / 3)
/* What the display error's model may be wrong by beside chance, as a standard deviation of its
 * logarithm: measured (docs/ACCURACY.md). */
#define MODEL_SPREAD 0.05
/* The share of the pixels whose part of the squared error is told. */
#define TOP 0.001

static const float signs[CONTRASTS][ACCURACY_REPLICATES] = {
    {0.25f, -0.25f, 0.25f, -0.25f},
    {0.25f, -0.25f, -0.25f, 0.25f},
    {0.25f, 0.25f, -0.25f, -0.25f},
};

/* One picture, and room for what its contrasts look like. */
struct view {
    const struct accuracy_picture *picture;
    const struct accuracy_transform *transform;
    uint32_t across;
    float *half;      /* [pixels][3]: the mean with a contrast added, or taken away */
    float *codes[2];  /* of both */
};

static size_t pixel_count(const struct accuracy_picture *p)
{
    return (size_t)p->width * p->height;
}

/* The replicates' values at pixel value `at`: those of a group that the tile lacks are the other's,
 * so that the mean is that group's mean and the first contrast its error. */
static void values_at(const struct view *v, size_t at, float out[ACCURACY_REPLICATES])
{
    const struct accuracy_picture *p = v->picture;

    for (int r = 0; r < ACCURACY_REPLICATES; r++)
        out[r] = p->replicates[r][at];
    if (p->samples) {
        size_t pixel = at / 3;
        size_t tile = pixel / p->width / TILE * v->across + pixel % p->width / TILE;
        if (p->samples[tile * 2] == 0)
            memcpy(out, out + 2, 2 * sizeof *out);
        else if (p->samples[tile * 2 + 1] == 0)
            memcpy(out + 2, out, 2 * sizeof *out);
    }
}

/* Is there an error to be told: does every tile have two replicates of a group? */
static int is_known(const struct accuracy_picture *p)
{
    size_t tiles = (size_t)((p->width + TILE - 1) / TILE) * ((p->height + TILE - 1) / TILE);

    for (size_t i = 0; p->samples && i < tiles; i++) {
        const uint32_t *n = p->samples + i * 2;
        if ((n[0] < 2 && n[1] < 2) || n[0] == 1 || n[1] == 1)
            return 0;
    }
    return 1;
}

static float mean_of(const float values[ACCURACY_REPLICATES])
{
    return (values[0] + values[1] + values[2] + values[3]) / 4;
}

static float contrast_of(const float values[ACCURACY_REPLICATES], int k)
{
    float sum = 0;

    for (int r = 0; r < ACCURACY_REPLICATES; r++)
        sum += signs[k][r] * values[r];
    return sum;
}

/* Where a group is missing the other contrasts tell nothing; the first stands for all. */
static int contrast_at(const struct view *v, size_t pixel, int k)
{
    const struct accuracy_picture *p = v->picture;
    size_t tile = pixel / p->width / TILE * v->across + pixel % p->width / TILE;

    return p->samples && (p->samples[tile * 2] == 0 || p->samples[tile * 2 + 1] == 0) ? 0 : k;
}

static void view_release(struct view *v)
{
    mem_free(v->half);
    mem_free(v->codes[0]);
    mem_free(v->codes[1]);
}

static status view_init(struct view *v, const struct accuracy_picture *picture,
                        const struct accuracy_transform *transform, struct error *err)
{
    size_t values = pixel_count(picture) * 3;

    *v = (struct view){.picture = picture,
                       .transform = transform,
                       .across = (picture->width + TILE - 1) / TILE,
                       .half = mem_alloc_array(values, sizeof(float)),
                       .codes = {mem_alloc_array(values, sizeof(float)),
                                 mem_alloc_array(values, sizeof(float))}};
    if (v->half && v->codes[0] && v->codes[1])
        return STATUS_OK;
    view_release(v);
    return error_no_memory(err, "the figures of a picture's error");
}

/* The codes of the mean with contrast k added, and taken away. */
static status view_halves(struct view *v, int k, struct error *err)
{
    size_t values = pixel_count(v->picture) * 3;
    status s = STATUS_OK;

    for (int side = 0; side < 2 && s == STATUS_OK; side++) {
        for (size_t i = 0; i < values; i++) {
            float r[ACCURACY_REPLICATES], c;
            values_at(v, i, r);
            c = contrast_of(r, contrast_at(v, i / 3, k));
            v->half[i] = mean_of(r) + (side ? -c : c);
        }
        s = v->transform->apply(v->transform->user, v->half, v->picture->width, v->picture->height,
                                v->codes[side], err);
    }
    return s;
}

/* ---- what is gathered ------------------------------------------------------------------------ */

struct gathered {
    size_t pixels;
    double mean;                            /* of the frame's channels */
    double linear, linear_variance;         /* sum of the pixels' squared errors; of that less the real */
    double mean_variance;                   /* of the frame's mean */
    double codes, codes_variance;
    double groups[2];                       /* the groups' own sums of squared errors */
    float *errors[CONTRASTS];               /* [pixels]: largest channel's error in codes */
    float *squared;                         /* [pixels]: linear */
};

static void gathered_release(struct gathered *g)
{
    for (int k = 0; k < CONTRASTS; k++)
        mem_free(g->errors[k]);
    mem_free(g->squared);
}

static status gathered_init(struct gathered *g, size_t pixels, struct error *err)
{
    *g = (struct gathered){.pixels = pixels, .squared = mem_alloc_array(pixels, sizeof(float))};
    for (int k = 0; k < CONTRASTS; k++)
        g->errors[k] = mem_alloc_array(pixels, sizeof(float));
    if (g->squared && g->errors[0] && g->errors[1] && g->errors[2])
        return STATUS_OK;
    gathered_release(g);
    return error_no_memory(err, "the figures of a picture's error");
}

static double mean3(const double x[CONTRASTS])
{
    return (x[0] + x[1] + x[2]) / 3;
}

static double variance3(const double x[CONTRASTS])
{
    double m = mean3(x);

    return ((x[0] - m) * (x[0] - m) + (x[1] - m) * (x[1] - m) + (x[2] - m) * (x[2] - m)) / 2;
}

/* Errors in linear radiance, of the difference a - b; b may be NULL. */
static void gather_linear(struct gathered *g, const struct view *a, const struct view *b)
{
    double means[CONTRASTS] = {0};

    for (size_t p = 0; p < g->pixels; p++) {
        double squares[CONTRASTS] = {0};
        for (size_t i = p * 3; i < p * 3 + 3; i++) {
            float ra[ACCURACY_REPLICATES], rb[ACCURACY_REPLICATES] = {0};
            values_at(a, i, ra);
            if (b)
                values_at(b, i, rb);
            g->mean += b ? ((double)mean_of(ra) + (double)mean_of(rb)) / 2 : (double)mean_of(ra);
            for (int k = 0; k < CONTRASTS; k++) {
                double c = (double)contrast_of(ra, contrast_at(a, p, k)) -
                           (b ? (double)contrast_of(rb, contrast_at(b, p, k)) : 0);
                squares[k] += c * c;
                means[k] += c;
            }
            for (int group = 0; group < 2; group++) {
                double d = ((double)ra[group * 2] - (double)ra[group * 2 + 1] -
                            ((double)rb[group * 2] - (double)rb[group * 2 + 1])) / 2;
                g->groups[group] += d * d;
            }
        }
        g->squared[p] = (float)mean3(squares);
        g->linear += mean3(squares);
        g->linear_variance += UNKNOWN_SHARE * variance3(squares);
    }
    g->mean /= (double)g->pixels * 3;
    for (int k = 0; k < CONTRASTS; k++)
        g->mean_variance += means[k] * means[k] / ((double)g->pixels * 3 * (double)g->pixels * 3) / 3;
}

/* Errors in display codes, of the difference a - b. */
static status gather_codes(struct gathered *g, struct view *a, struct view *b, struct error *err)
{
    float *squares[CONTRASTS] = {NULL};
    status s = STATUS_OK;

    for (int k = 0; k < CONTRASTS && s == STATUS_OK; k++) {
        squares[k] = mem_alloc_array(g->pixels, sizeof(float));
        s = squares[k] ? view_halves(a, k, err) : error_no_memory(err, "a picture's error");
        if (s == STATUS_OK && b)
            s = view_halves(b, k, err);
        for (size_t p = 0; p < g->pixels && s == STATUS_OK; p++) {
            float largest = 0, sum = 0;
            for (size_t i = p * 3; i < p * 3 + 3; i++) {
                float d = (a->codes[0][i] - a->codes[1][i]) / 2;
                if (b)
                    d -= (b->codes[0][i] - b->codes[1][i]) / 2;
                largest = fabsf(d) > largest ? fabsf(d) : largest;
                sum += d * d;
            }
            g->errors[k][p] = largest;
            squares[k][p] = sum;
        }
    }
    for (size_t p = 0; p < g->pixels && s == STATUS_OK; p++) {
        double x[CONTRASTS] = {(double)squares[0][p], (double)squares[1][p], (double)squares[2][p]};
        g->codes += mean3(x);
        g->codes_variance += UNKNOWN_SHARE * variance3(x);
    }
    for (int k = 0; k < CONTRASTS; k++)
        mem_free(squares[k]);
    return s;
}

/* ---- figures --------------------------------------------------------------------------------- */

/* The mean over the contrasts of a pixel's squared error in codes. */
static double pixel_square(const struct gathered *g, size_t p)
{
    double sum = 0;

    for (int k = 0; k < CONTRASTS; k++)
        sum += (double)g->errors[k][p] * (double)g->errors[k][p];
    return sum / CONTRASTS;
}

/* Each pixel's error is normal with a standard deviation that it shares with its neighbours: a pixel
 * that the light was found in by no sample, or by chance in all of them, tells little of its own. */
static void spread_pixels(const struct gathered *g, uint32_t width, uint32_t height,
                          struct spreads *spreads)
{
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++) {
            double sum = 0;
            uint32_t count = 0;
            for (uint32_t v = y > 0 ? y - 1 : 0; v <= y + 1 && v < height; v++)
                for (uint32_t u = x > 0 ? x - 1 : 0; u <= x + 1 && u < width; u++, count++)
                    sum += pixel_square(g, (size_t)v * width + u);
            spreads_add(spreads, (float)sqrt(sum / count));
        }
}

/* How far the share of pixels beyond the display error may be off: the standard deviation of the
 * contrasts' mean share less the real one. */
static double share_deviation(const struct gathered *g)
{
    double variance = 0;
    float limit[CONTRASTS];

    for (int k = 0; k < CONTRASTS; k++)
        limit[k] = quantile_select(g->errors[k], g->pixels,
                                   (size_t)((double)(g->pixels - 1) * (1 - BEYOND)));
    for (size_t p = 0; p < g->pixels; p++) {
        double x[CONTRASTS];
        for (int k = 0; k < CONTRASTS; k++)
            x[k] = g->errors[k][p] > limit[k];
        variance += UNKNOWN_SHARE * variance3(x);
    }
    return sqrt(variance) / (double)g->pixels;
}

static status figure_display(struct accuracy_figures *out, const struct gathered *g, uint32_t width,
                             uint32_t height, struct error *err)
{
    struct spreads *spreads = mem_calloc(1, sizeof *spreads);
    double off, factor, model = NORMAL_95 * MODEL_SPREAD;

    if (!spreads)
        return error_no_memory(err, "a picture's error");
    spread_pixels(g, width, height, spreads);
    off = NORMAL_95 * share_deviation(g);
    out->display_error = spreads_quantile(spreads, BEYOND);
    out->display_lo = spreads_quantile(spreads, BEYOND + off);
    out->display_hi = spreads_quantile(spreads, BEYOND > off ? BEYOND - off : BEYOND / 2);
    mem_free(spreads);
    if (!(out->display_error > 0))
        return STATUS_OK;
    /* Chance and the model are independent: their logarithms' deviations add up as squares. */
    factor = det_log_d(out->display_hi / out->display_error);
    out->display_hi = out->display_error * det_exp_d(sqrt(factor * factor + model * model));
    factor = out->display_lo > 0 ? det_log_d(out->display_error / out->display_lo) : 10;
    out->display_lo = out->display_error * det_exp_d(-sqrt(factor * factor + model * model));
    return STATUS_OK;
}

static void figure_psnr(struct accuracy_figures *out, const struct gathered *g)
{
    double scale = 10 / 2.302585092994045684, mean = g->codes / ((double)g->pixels * 3), spread;

    if (!(g->codes > 0)) {
        out->psnr_db = out->psnr_lo = out->psnr_hi = INFINITY;
        return;
    }
    spread = NORMAL_95 * sqrt(g->codes_variance) / g->codes;
    out->psnr_db = scale * det_log_d(255.0 * 255.0 / mean);
    out->psnr_lo = out->psnr_db - scale * spread;
    out->psnr_hi = out->psnr_db + scale * spread;
}

static void figure_rmse(struct accuracy_figures *out, const struct gathered *g)
{
    double spread;

    out->mean = g->mean;
    if (!(g->linear > 0)) {
        out->rmse_percent = out->rmse_lo = out->rmse_hi = 0;
        return;
    }
    /* Of the logarithm: half of that of the mean square's, and the frame's mean's. */
    spread = NORMAL_95 * sqrt(g->linear_variance / (4 * g->linear * g->linear) +
                              g->mean_variance / (g->mean * g->mean));
    out->rmse_percent = 100 * sqrt(g->linear / ((double)g->pixels * 3)) / fabs(g->mean);
    out->rmse_lo = out->rmse_percent * det_exp_d(-spread);
    out->rmse_hi = out->rmse_percent * det_exp_d(spread);
}

static double top_share(const struct gathered *g)
{
    size_t top = (size_t)ceil((double)g->pixels * TOP);
    float limit = quantile_select(g->squared, g->pixels, g->pixels - top);
    double sum = 0;
    size_t above = 0;

    for (size_t p = 0; p < g->pixels; p++)
        if (g->squared[p] > limit) {
            sum += (double)g->squared[p];
            above++;
        }
    sum += (double)limit * (double)(top - above); /* of equal ones as many as are left */
    return g->linear > 0 ? sum / g->linear : 0;
}

static void figure_evidence(struct accuracy_figures *out, const struct gathered *g,
                            const struct accuracy_evidence *e)
{
    double a = g->groups[0], b = g->groups[1];

    out->top_share = top_share(g);
    out->disagreement = a > 0 && b > 0 ? fabs(det_log_d(a / b)) : a > 0 || b > 0 ? INFINITY : 0;
    out->tail_index = e && e->tails ? accuracy_tails_index(e->tails) : NAN;
    out->unseen = e ? word_unseen(e, g->linear) : 0;
    word_choose(out, e);
}

static void map_tiles(const struct gathered *g, uint32_t width, uint32_t height,
                      struct accuracy_map *map)
{
    size_t tile = 0;

    for (uint32_t top = 0; top < height; top += TILE)
        for (uint32_t left = 0; left < width; left += TILE, tile++) {
            double codes = 0, linear = 0;
            uint32_t count = 0;
            for (uint32_t y = top; y < top + TILE && y < height; y++)
                for (uint32_t x = left; x < left + TILE && x < width; x++, count++) {
                    codes += pixel_square(g, (size_t)y * width + x);
                    linear += (double)g->squared[(size_t)y * width + x];
                }
            if (map->display)
                map->display[tile] = (float)sqrt(codes / count);
            if (map->linear)
                map->linear[tile] = (float)sqrt(linear / (count * 3.0));
        }
}

static void figures_unknown(struct accuracy_figures *out)
{
    *out = (struct accuracy_figures){
        .display_error = NAN, .display_lo = NAN, .display_hi = NAN, .psnr_db = NAN, .psnr_lo = NAN,
        .psnr_hi = NAN, .rmse_percent = NAN, .rmse_lo = NAN, .rmse_hi = NAN, .mean = NAN,
        .top_share = NAN, .disagreement = NAN, .unseen = NAN, .tail_index = NAN};
}

static status figures_make(struct accuracy_figures *out, struct view *a, struct view *b,
                           const struct accuracy_evidence *evidence, struct accuracy_map *map,
                           struct error *err)
{
    uint32_t width = a->picture->width, height = a->picture->height;
    struct gathered g;
    status s = gathered_init(&g, pixel_count(a->picture), err);

    if (s != STATUS_OK)
        return s;
    out->known = 1;
    gather_linear(&g, a, b);
    s = gather_codes(&g, a, b, err);
    if (s == STATUS_OK)
        s = figure_display(out, &g, width, height, err);
    if (s == STATUS_OK) {
        figure_psnr(out, &g);
        figure_rmse(out, &g);
        figure_evidence(out, &g, evidence);
        if (map)
            map_tiles(&g, width, height, map);
    }
    gathered_release(&g);
    return s;
}

status accuracy_figures_of(struct accuracy_figures *out, const struct accuracy_picture *picture,
                           const struct accuracy_transform *transform,
                           const struct accuracy_evidence *evidence, struct accuracy_map *map,
                           struct error *err)
{
    struct view view;
    status s;

    figures_unknown(out);
    if (!is_known(picture))
        return STATUS_OK;
    s = view_init(&view, picture, transform, err);
    if (s != STATUS_OK)
        return s;
    s = figures_make(out, &view, NULL, evidence, map, err);
    view_release(&view);
    return s;
}

status accuracy_figures_between(struct accuracy_figures *out, const struct accuracy_picture *a,
                                const struct accuracy_transform *transform_a,
                                const struct accuracy_picture *b,
                                const struct accuracy_transform *transform_b, struct error *err)
{
    struct view views[2];
    status s;

    figures_unknown(out);
    if (a->width != b->width || a->height != b->height)
        return error_set(err, STATUS_ERR_INPUT, "frames of %ux%u and %ux%u cannot be compared",
                         a->width, a->height, b->width, b->height);
    if (!is_known(a) || !is_known(b))
        return STATUS_OK;
    s = view_init(&views[0], a, transform_a, err);
    if (s != STATUS_OK)
        return s;
    s = view_init(&views[1], b, transform_b, err);
    if (s == STATUS_OK) {
        s = figures_make(out, &views[0], &views[1], NULL, NULL, err);
        view_release(&views[1]);
    }
    view_release(&views[0]);
    return s;
}
