#include "common/accuracy/figures.h"

#include <math.h>

#include "common/accuracy/contrasts.h"
#include "common/accuracy/quantile.h"
#include "common/accuracy/word.h"
#include "common/base/memory.h"
#include "common/base/safeguard.h"
#include "common/math/elementary.h"

/* Two-sided 95 % of a normal distribution. */
#define NORMAL_95 1.959963984540054
/* The error of the display error's model, besides chance, as a standard deviation of its logarithm:
 * measured (docs/ACCURACY.md). */
#define MODEL_SPREAD 0.05
/* The share of the pixels whose part of the squared error is reported. */
#define TOP 0.001
/* A pixel counts among those that make the display error from this fraction of it on. It is dark if
 * it shows less than this fraction of its neighbourhood's error. */
#define NOISY 3
#define DARK 5

/* ---- figures --------------------------------------------------------------------------------- */

/* Each pixel's error is normal with a standard deviation that it shares with its neighbours: a
 * pixel in which no sample found the light, or all did by chance, says little by itself. */
static void spread_pixels(struct gathered *g, uint32_t width, uint32_t height,
                          struct spreads *spreads)
{
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++) {
            double sum = 0;
            uint32_t count = 0;
            for (uint32_t v = y > 0 ? y - 1 : 0; v <= y + 1 && v < height; v++)
                for (uint32_t u = x > 0 ? x - 1 : 0; u <= x + 1 && u < width; u++, count++)
                    sum += gathered_square(g, (size_t)v * width + u);
            g->spread[(size_t)y * width + x] = (float)sqrt(sum / count);
            spreads_add(spreads, g->spread[(size_t)y * width + x], 1);
        }
}

/* The uncertainty of the share of pixels beyond the display error: the standard deviation of (the
 * contrasts' mean share - the real one). */
static double share_deviation(const struct gathered *g)
{
    double variance = 0;
    float limit[CONTRASTS];

    for (int k = 0; k < CONTRASTS; k++)
        limit[k] = quantile_select(g->errors[k], g->pixels,
                                   (size_t)((double)(g->pixels - 1) * (1 - DISPLAY_BEYOND)));
    for (size_t p = 0; p < g->pixels; p++) {
        double x[CONTRASTS];
        for (int k = 0; k < CONTRASTS; k++)
            x[k] = g->errors[k][p] > limit[k];
        variance += contrasts_variance(x);
    }
    return sqrt(variance) / (double)g->pixels;
}

static status figure_display(struct accuracy_figures *out, struct gathered *g, uint32_t width,
                             uint32_t height, struct error *err)
{
    struct spreads *spreads = mem_calloc(1, sizeof *spreads);
    double off, factor, model = NORMAL_95 * MODEL_SPREAD;

    if (!spreads)
        return error_no_memory(err, "a picture's error");
    spread_pixels(g, width, height, spreads);
    off = NORMAL_95 * share_deviation(g);
    out->display_error = spreads_quantile(spreads, DISPLAY_BEYOND);
    out->display_lo = spreads_quantile(spreads, DISPLAY_BEYOND + off);
    out->display_hi = spreads_quantile(spreads, DISPLAY_BEYOND > off ? DISPLAY_BEYOND - off : DISPLAY_BEYOND / 2);
    mem_free(spreads);
    if (!(out->display_error > 0) && SAFEGUARD(DISPLAY_OF_EQUAL))
        return STATUS_OK; /* its logarithm is none */
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

    if (!(g->codes > 0) && SAFEGUARD(PSNR_OF_EQUAL)) {
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
    if (!(g->linear > 0) && SAFEGUARD(RMSE_OF_BLACK)) {
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

/* Of the pixels that make the display error: how far a single replicate makes it, and how many show
 * no error themselves beside neighbours that do. */
static void figure_sparse(struct accuracy_figures *out, const struct gathered *g)
{
    double lone = 0;
    size_t count = 0, dark = 0;

    for (size_t p = 0; p < g->pixels; p++)
        if ((double)g->spread[p] > out->display_error / NOISY) {
            double share = (double)g->spread[p] / DARK;
            count++;
            lone += (double)g->lone[p];
            dark += gathered_square(g, p) < share * share;
        }
    out->lone = count ? lone / (double)count : 0;
    out->dark = count ? (double)dark / (double)count : 0;
}

static void figure_evidence(struct accuracy_figures *out, const struct gathered *g,
                            const struct accuracy_evidence *e)
{
    double a = g->groups[0], b = g->groups[1];

    figure_sparse(out, g);
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

    for (uint32_t top = 0; top < height; top += ACCURACY_TILE)
        for (uint32_t left = 0; left < width; left += ACCURACY_TILE, tile++) {
            double codes = 0, linear = 0;
            uint32_t count = 0;
            for (uint32_t y = top; y < top + ACCURACY_TILE && y < height; y++)
                for (uint32_t x = left; x < left + ACCURACY_TILE && x < width; x++, count++) {
                    codes += gathered_square(g, (size_t)y * width + x);
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
        .lone = NAN, .dark = NAN, .top_share = NAN, .disagreement = NAN, .unseen = NAN, .tail_index = NAN};
}

static status figures_make(struct accuracy_figures *out, struct view *a,
                           const struct accuracy_evidence *evidence, struct accuracy_map *map,
                           struct error *err)
{
    uint32_t width = a->picture->width, height = a->picture->height;
    struct gathered g;
    status s = gathered_init(&g, (size_t)width * height, err);

    if (s != STATUS_OK)
        return s;
    out->known = 1;
    gather_linear(&g, a);
    s = gather_codes(&g, a, err);
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
    if (!view_is_known(picture))
        return STATUS_OK;
    s = view_init(&view, picture, transform, err);
    if (s != STATUS_OK)
        return s;
    s = figures_make(out, &view, evidence, map, err);
    view_release(&view);
    return s;
}
