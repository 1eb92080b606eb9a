#include "common/accuracy/figures.h"

#include <math.h>
#include <stdlib.h>

#include "common/accuracy/contrast.h"
#include "common/accuracy/grain.h"
#include "common/accuracy/quantile.h"
#include "common/accuracy/sample.h"
#include "common/accuracy/word.h"
#include "common/base/memory.h"
#include "common/base/safeguard.h"
#include "common/math/elementary.h"

/* Two-sided 95 % of a normal distribution. */
#define NORMAL_95 1.959963984540054
#define SQRT_2 1.4142135623730951
/* The error of the display error's model, besides chance, as a standard deviation of its logarithm:
 * measured (docs/ACCURACY.md). */
#define MODEL_SPREAD 0.05
/* The share of the pixels whose part of the squared error is reported. */
#define TOP 0.001
/* The share of a picture's parts that are no worse than its worst part. */
#define WORST_SHARE 0.99
/* A pixel counts among those that make the display error from this fraction of it on. It is dark if
 * it shows less than this fraction of its neighbourhood's error. */
#define NOISY 3
#define DARK 20
/* From this much of `lone` on, a picture is compared with its neighbourhoods' means (grain.h), and the more of it the more
 * that counts: the raise to the power of (lone - LONE_GRAIN) * GRAIN_SLOPE, at most GRAIN_MOST. Where few samples are lone
 * the groups see most of the error, and grain is content, too; where most are, a pixel's neighbours have not met the light
 * either. Chosen on half of the scenes of `make accuracy`. A pixel is itself a ninth of its neighbourhood's mean, which
 * makes its noise smaller; less is added where content is much of the grain, and its part less certain. */
#define LONE_GRAIN 0.2
#define GRAIN_SLOPE 5
#define GRAIN_MOST 1.2
#define GRAIN_SELF (9.0 / 8)
/* Of one pixel's part of `lone`: one of 3x3 has all. */
#define LONE_LIMIT 9

/* ---- figures --------------------------------------------------------------------------------- */

/* What a pixel counts at most: shares of tiles are rounded to this part of a pixel. */
enum { PIXEL_ONE = 16 };

/* Of a tile, the pixels that count: as many as see the subject, the noisiest first. */
struct counted {
    float spreads[ACCURACY_TILE * ACCURACY_TILE];
    uint32_t pixels;
    uint64_t weight; /* of all of them, in PIXEL_ONE of a pixel */
    float least;     /* those above it count whole; of those at it, what is left */
};

static void count_tile(struct counted *out, const struct gathered *g, size_t tile, uint32_t left, uint32_t top)
{
    const float *subject = g->picture->subject;
    uint64_t whole;

    out->pixels = 0;
    for (uint32_t y = top; y < top + ACCURACY_TILE && y < g->height; y++)
        for (uint32_t x = left; x < left + ACCURACY_TILE && x < g->width; x++)
            out->spreads[out->pixels++] = g->spread[(size_t)y * g->width + x];
    whole = (uint64_t)out->pixels * PIXEL_ONE;
    out->weight = subject ? (uint64_t)((double)subject[tile] * (double)whole + 0.5) : whole;
    out->weight = out->weight < whole ? out->weight : whole;
    out->least = -1;
    if (out->weight < whole && out->weight > 0)
        out->least = quantile_select(out->spreads, out->pixels,
                                     out->pixels - (uint32_t)((out->weight + PIXEL_ONE - 1) / PIXEL_ONE));
}

/* A tile's error where it counts, and its weight. */
struct part {
    double error;
    uint64_t weight;
};

/* Add what counts of the tile to the spreads. */
static struct part add_tile(struct spreads *spreads, const struct counted *c)
{
    struct part part = {0, c->weight};
    uint64_t left = c->weight;

    for (uint32_t i = 0; i < c->pixels && c->weight > 0; i++)
        if (c->spreads[i] > c->least) {
            spreads_add(spreads, c->spreads[i], PIXEL_ONE);
            part.error += (double)c->spreads[i] * (double)c->spreads[i] * PIXEL_ONE;
            left -= PIXEL_ONE;
        }
    if (left > 0) {
        spreads_add(spreads, c->least, left);
        part.error += (double)c->least * (double)c->least * (double)left;
    }
    part.error = c->weight > 0 ? sqrt(part.error / (double)c->weight) : 0;
    return part;
}

static int compare_parts(const void *a, const void *b)
{
    const struct part *first = a, *second = b;

    return (first->error > second->error) - (first->error < second->error);
}

/* The error that WORST_SHARE of the weight stays within. */
static double worst_part(struct part *parts, size_t count, uint64_t weight)
{
    double below = 0;
    size_t i = 0;

    qsort(parts, count, sizeof *parts, compare_parts);
    for (; i + 1 < count; i++) {
        below += (double)parts[i].weight;
        if (below >= WORST_SHARE * (double)weight)
            break;
    }
    return count ? parts[i].error : 0;
}

/* Each pixel's error is normal with a standard deviation that it shares with its neighbours: a
 * pixel in which no sample found the light, or all did by chance, says little by itself. */
static void spread_pixels(struct gathered *g, struct spreads *all, double *line)
{
    size_t p = 0;

    for (uint32_t y = 0; y < g->height; y++) {
        means_of_line(g->error, 1, g, 0, y, line);
        for (uint32_t x = 0; x < g->width; x++, p++) {
            g->spread[p] = (float)sqrt(line[x]);
            spreads_add(all, g->spread[p], PIXEL_ONE);
        }
    }
}

/* Of the pixels that see the subject. ERR_NO_MEMORY. */
static status spread_subject(struct accuracy_figures *out, const struct gathered *g, struct spreads *seen,
                             struct error *err)
{
    struct part *parts = mem_alloc_array((g->pixels + ACCURACY_TILE - 1) / ACCURACY_TILE + 1, sizeof *parts);
    struct counted counted;
    size_t tile = 0;

    NEED(parts, err, "a picture's parts");
    for (uint32_t top = 0; top < g->height; top += ACCURACY_TILE)
        for (uint32_t left = 0; left < g->width; left += ACCURACY_TILE, tile++) {
            count_tile(&counted, g, tile, left, top);
            parts[tile] = add_tile(seen, &counted);
        }
    out->subject = (double)seen->count / ((double)g->pixels * PIXEL_ONE);
    out->worst_part = worst_part(parts, tile, seen->count);
    mem_free(parts);
    return STATUS_OK;
}

/* The standard deviation of (the share of the pixels beyond the display error that the contrast has - the
 * real one): both are binomial, at most. */
static double share_deviation(double pixels) { return sqrt(2 * DISPLAY_BEYOND * (1 - DISPLAY_BEYOND) / pixels); }

/* Nothing but background counts as a whole. ERR_NO_MEMORY. */
static status spread_counted(struct accuracy_figures *out, struct gathered *g, struct spreads *seen, struct error *err)
{
    status s = spread_subject(out, g, seen, err);

    if (s == STATUS_OK && seen->count == 0) {
        const struct accuracy_picture *picture = g->picture;
        struct accuracy_picture whole = *picture;
        whole.subject = NULL;
        g->picture = &whole;
        s = spread_subject(out, g, seen, err);
        g->picture = picture;
        out->subject = 0;
    }
    return s;
}

/* ERR_NO_MEMORY. */
static status gather_spreads(struct accuracy_figures *out, struct gathered *g, struct spreads **all,
                             struct spreads **seen, struct error *err)
{
    double *line = mem_alloc_array(g->width, sizeof *line);

    *all = mem_calloc(1, sizeof **all);
    *seen = mem_calloc(1, sizeof **seen);
    if (line && *all && *seen)
        spread_pixels(g, *all, line);
    mem_free(line);
    if (!line || !*all || !*seen)
        return error_no_memory(err, "a picture's error");
    return spread_counted(out, g, *seen, err);
}

/* The variance of the share of the subject's pixels beyond the display error, as a sample's tiles differ in it; 0: of the
 * whole picture. ERR_NO_MEMORY. */
static status share_of_sample(double *out, const struct gathered *g, double display_error, struct error *err)
{
    const struct accuracy_picture *picture = g->picture;
    size_t across = (g->width + ACCURACY_TILE - 1) / ACCURACY_TILE;
    size_t tiles = across * ((g->height + ACCURACY_TILE - 1) / ACCURACY_TILE);
    double *beyond, *pixels;

    *out = 0;
    if (picture->of_tiles <= tiles)
        return STATUS_OK;
    beyond = mem_calloc(tiles * 2, sizeof *beyond);
    NEED(beyond, err, "a picture's tiles");
    pixels = beyond + tiles;
    for (uint32_t y = 0; y < g->height; y += 2) /* spreads are smooth: every fourth says enough */
        for (uint32_t x = 0; x < g->width; x += 2) {
            size_t tile = y / ACCURACY_TILE * across + x / ACCURACY_TILE;
            double spread = (double)g->spread[(size_t)y * g->width + x];
            if (spread > display_error / 5) /* less is never beyond */
                beyond[tile] += complement_erf_quick(display_error / (spread * SQRT_2));
            pixels[tile] += picture->subject ? (double)picture->subject[tile] : 1;
        }
    for (size_t t = 0; t < tiles; t++)
        beyond[t] = fmin(beyond[t], pixels[t]);
    *out = sample_ratio_variance(picture, beyond, pixels, tiles);
    mem_free(beyond);
    return STATUS_OK;
}

static void display_of(struct accuracy_figures *out, const struct spreads *all, const struct spreads *seen,
                       double of_sample)
{
    double share = share_deviation((double)seen->count / PIXEL_ONE), factor, model = NORMAL_95 * MODEL_SPREAD;
    double off = NORMAL_95 * sqrt(share * share + of_sample);

    out->display_all = spreads_quantile(all, DISPLAY_BEYOND);
    out->display_lo = spreads_quantile(seen, DISPLAY_BEYOND + off);
    out->display_hi = spreads_quantile(seen, DISPLAY_BEYOND > off ? DISPLAY_BEYOND - off : DISPLAY_BEYOND / 2);
    if (!(out->display_error > 0) && SAFEGUARD(DISPLAY_OF_EQUAL))
        return; /* its logarithm is none */
    /* Chance and the model are independent: their logarithms' deviations add up as squares. */
    factor = det_log_d(out->display_hi / out->display_error);
    out->display_hi = out->display_error * det_exp_d(sqrt(factor * factor + model * model));
    factor = out->display_lo > 0 ? det_log_d(out->display_error / out->display_lo) : 10;
    out->display_lo = out->display_error * det_exp_d(-sqrt(factor * factor + model * model));
}

static status figure_display(struct accuracy_figures *out, struct gathered *g, struct error *err)
{
    struct spreads *all, *seen;
    double of_sample = 0;
    status s = gather_spreads(out, g, &all, &seen, err);

    if (s == STATUS_OK) {
        out->display_error = spreads_quantile(seen, DISPLAY_BEYOND);
        s = share_of_sample(&of_sample, g, out->display_error, err);
    }
    if (s == STATUS_OK)
        display_of(out, all, seen, of_sample);
    out->fireflies = round((double)g->firefly_count * sample_scale(g->picture));
    mem_free(all);
    mem_free(seen);
    return s;
}

/* What few samples have met is seen by the grain: it may raise the figures. */
static status figure_grain(struct accuracy_figures *out, struct gathered *g, struct error *err)
{
    struct accuracy_figures scratch = *out;
    struct spreads *seen;
    struct grain grain;
    double raised, factor;
    status s;

    if (!(out->lone > LONE_GRAIN))
        return STATUS_OK;
    seen = mem_calloc(1, sizeof *seen);
    s = grain_make(&grain, g, err);
    if (s == STATUS_OK && !seen)
        s = error_no_memory(err, "a picture's grain");
    if (s == STATUS_OK) {
        float *spread = g->spread;
        g->spread = grain.codes;
        s = spread_counted(&scratch, g, seen, err);
        g->spread = spread;
    }
    if (s == STATUS_OK) {
        raised = sqrt(grain.noise) * det_pow_d(GRAIN_SELF, grain.noise / 2) * spreads_largest(seen, DISPLAY_BEYOND);
        factor = out->display_error > 0 ? raised / out->display_error : 1;
        if (factor > 1) {
            factor = det_pow_d(factor, fmin((out->lone - LONE_GRAIN) * GRAIN_SLOPE, GRAIN_MOST));
            out->display_error *= factor;
            out->display_hi *= factor; /* and lo stays: the interval spans both */
            out->display_all *= factor;
            out->worst_part *= factor;
        }
    }
    grain_release(&grain);
    mem_free(seen);
    return s;
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
    spread =
        NORMAL_95 * sqrt(g->linear_variance / (4 * g->linear * g->linear) + g->mean_variance / (g->mean * g->mean));
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

/* What figure_sparse() reads of a picture: a strip's groups, a line's means over 3x3 pixels. */
struct sparse {
    float *groups[2];
    double *means[2], *squares; /* of both groups' channels, and of the pixels' C^2 */
};

static int sparse_make(struct sparse *out, size_t width)
{
    const size_t line = width * 3;

    out->groups[0] = mem_alloc_array(line * (STRIP_LINES + 2), 2 * sizeof(float));
    out->means[0] = mem_alloc_array(line * 2 + width, sizeof(double));
    if (!out->groups[0] || !out->means[0])
        return 0;
    out->groups[1] = out->groups[0] + line * (STRIP_LINES + 2);
    out->means[1] = out->means[0] + line;
    out->squares = out->means[1] + line;
    return 1;
}

static void sparse_release(struct sparse *s)
{
    mem_free(s->groups[0]);
    mem_free(s->means[0]);
}

/* Is the error of the pixel, number `x` of the line, a bright sample that one group alone has met? Then the pixel is
 * brighter than its neighbours by just |C|. 0 on average where noise is as often up as down; 1 on average of 3x3 pixels of
 * which one was met. */
static double lone_share(const struct sparse *s, const float *a, const float *b, size_t x)
{
    double own = 0, square = s->squares[x], share;

    if (!(square > 0))
        return 0;
    for (size_t i = x * 3; i < x * 3 + 3; i++)
        own +=
            fabs((double)a[i] - (double)b[i]) / 2 * ((double)a[i] + (double)b[i] - s->means[0][i] - s->means[1][i]) / 2;
    share = own / square;
    return share > LONE_LIMIT ? LONE_LIMIT : share < -LONE_LIMIT ? -LONE_LIMIT : share;
}

/* Of the pixels that make the display error: how far lone bright samples make it, and how many show no error
 * themselves beside neighbours that do. ERR_NO_MEMORY. */
static status figure_sparse(struct accuracy_figures *out, struct gathered *g, struct error *err)
{
    struct strip strip = {0};
    struct sparse sparse = {0};
    double lone = 0;
    size_t count = 0, dark = 0;
    const int made = sparse_make(&sparse, g->width);

    while (made && strip_next(&strip, g->height)) {
        const float *groups[2];
        gathered_lines(g, &strip, sparse.groups, groups);
        for (uint32_t y = strip.y; y < strip.y + strip.height; y++) {
            const size_t p = (size_t)y * g->width, at = (size_t)(y - strip.first) * g->width * 3;
            int known = 0; /* the line's means: not where no pixel is noisy */
            for (uint32_t x = 0; x < g->width; x++) {
                double spread = (double)g->spread[p + x], share = spread / DARK;
                if (!(spread > out->display_error / NOISY))
                    continue;
                for (int i = 0; i < 2 && !known; i++)
                    means_of_line(groups[i], 3, g, strip.first, y, sparse.means[i]);
                if (!known)
                    means_of_line(g->squared, 1, g, 0, y, sparse.squares);
                known = 1;
                count++;
                lone += lone_share(&sparse, groups[0] + at, groups[1] + at, x);
                dark += (double)g->error[p + x] < share * share;
            }
        }
    }
    sparse_release(&sparse);
    NEED(made, err, "the figures of a picture's error");
    out->lone = count ? lone / (double)count : 0;
    out->dark = count ? (double)dark / (double)count : 0;
    return STATUS_OK;
}

static status figure_evidence(struct accuracy_figures *out, struct gathered *g, const struct accuracy_evidence *e,
                              struct error *err)
{
    double a = g->brighter[0], b = g->brighter[1];

    TRY(figure_sparse(out, g, err));
    out->top_share = top_share(g);
    out->disagreement = a > 0 && b > 0 ? fabs(det_log_d(a / b)) : a > 0 || b > 0 ? INFINITY : 0;
    out->tail_index = e && e->tails ? accuracy_tails_index(e->tails) : NAN;
    out->unseen = e ? word_unseen(e, g->linear * sample_scale(g->picture)) : 0;
    word_choose(out, e);
    return STATUS_OK;
}

static void map_tiles(const struct gathered *g, struct accuracy_map *map)
{
    const uint32_t width = g->width, height = g->height;
    size_t tile = 0;

    for (uint32_t top = 0; top < height; top += ACCURACY_TILE)
        for (uint32_t left = 0; left < width; left += ACCURACY_TILE, tile++) {
            double codes = 0, linear = 0;
            uint32_t count = 0, fireflies = 0;
            for (uint32_t y = top; y < top + ACCURACY_TILE && y < height; y++)
                for (uint32_t x = left; x < left + ACCURACY_TILE && x < width; x++, count++) {
                    codes += (double)g->error[(size_t)y * width + x];
                    linear += (double)g->squared[(size_t)y * width + x];
                    fireflies += g->fireflies[(size_t)y * width + x];
                }
            if (map->display)
                map->display[tile] = (float)sqrt(codes / count);
            if (map->linear)
                map->linear[tile] = (float)sqrt(linear / (count * 3.0));
            if (map->fireflies)
                map->fireflies[tile] = (uint16_t)fireflies;
        }
}

static void figures_unknown(struct accuracy_figures *out)
{
    *out = (struct accuracy_figures){
        .display_error = NAN, .display_lo = NAN, .display_hi = NAN, .psnr_db = NAN, .psnr_lo = NAN,
        .psnr_hi = NAN, .rmse_percent = NAN, .rmse_lo = NAN, .rmse_hi = NAN, .mean = NAN,
        .lone = NAN, .dark = NAN, .top_share = NAN, .disagreement = NAN, .unseen = NAN, .tail_index = NAN,
        .display_all = NAN, .worst_part = NAN, .fireflies = NAN, .subject = NAN};
}

status accuracy_figures_of(struct accuracy_figures *out, const struct accuracy_picture *picture,
                           const struct accuracy_transform *transform, const struct accuracy_evidence *evidence,
                           struct accuracy_map *map, struct error *err)
{
    struct gathered g;
    status s;

    figures_unknown(out);
    if (!contrast_is_known(picture))
        return STATUS_OK;
    s = gathered_make(&g, picture, transform, err);
    THEN(s, sample_widen(&g, err));
    if (s == STATUS_OK)
        s = figure_display(out, &g, err);
    if (s == STATUS_OK) {
        out->known = 1;
        figure_psnr(out, &g);
        figure_rmse(out, &g);
        s = figure_evidence(out, &g, evidence, err);
        if (map)
            map_tiles(&g, map);
        THEN(s, figure_grain(out, &g, err));
    }
    gathered_release(&g);
    return s;
}
