#include "tests/support/judge.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "common/accuracy/fireflies.h"
#include "common/accuracy/quantile.h"
#include "common/base/memory.h"

/* What a mean of floats is off by even where every sample is the same. */
#define ROUNDING_PERCENT 1e-4

/* As the coordinator shows it: every picture is metered by itself. */
static status show_codes(void *user, const float *rgb, uint32_t width, uint32_t height, float *codes, struct error *err)
{
    const struct tonemap_context context = {.threads = 1};
    const struct image in = {.width = width, .height = height, .channels = 3, .pixels = (float *)rgb}; /* only read */
    struct image out = {0};
    status s = tonemap_apply(&out, &in, user, &context, err);

    for (size_t i = 0; s == STATUS_OK && i < (size_t)width * height * 3; i++)
        codes[i] = 255 * out.pixels[i];
    image_release(&out);
    return s;
}

/* ln of the log-mean. */
static double log_mean_of(const float *rgb, uint32_t width, uint32_t height, const struct tonemap_settings *look)
{
    const struct tonemap_context context = {.threads = 1};
    const struct image in = {.width = width, .height = height, .channels = 3, .pixels = (float *)rgb}; /* only read */
    struct tonemap_state state;

    return tonemap_measure(&state, &in, look, &context, NULL) == STATUS_OK ? state.ln_log_mean : NAN;
}

static double largest_error(const float *a, const float *b)
{
    double largest = 0;

    for (int c = 0; c < 3; c++)
        largest = fmax(largest, fabs((double)a[c] - (double)b[c]));
    return largest;
}

struct weighted {
    double value, weight;
};

static int ascending(const void *a, const void *b)
{
    const struct weighted *x = a, *y = b;

    return (x->value > y->value) - (x->value < y->value);
}

/* The value that a share `within` of the weight does not exceed; sorts them. */
static double weighted_quantile(struct weighted *values, size_t count, double within)
{
    double sum = 0, below = 0;
    size_t i = 0;

    for (size_t k = 0; k < count; k++)
        sum += values[k].weight;
    qsort(values, count, sizeof *values, ascending);
    for (; i + 1 < count; i++) {
        below += values[i].weight;
        if (below >= within * sum)
            break;
    }
    return values[i].value;
}

static float brightest(const float *codes) { return fmaxf(codes[0], fmaxf(codes[1], codes[2])); }

/* By the truth, of which `right` are the codes. */
static void judge_fireflies(struct judgement *out, const struct calibration *c, const float *a, const float *b,
                            const float *shown, const float *right)
{
    size_t pixels = (size_t)c->width * c->height;
    uint8_t *marks = mem_calloc(pixels, 1);

    if (!marks)
        abort();
    fireflies_find(a, b, shown, c->width, c->height, marks);
    out->fireflies = out->found = out->wrong = 0;
    for (size_t p = 0; p < pixels; p++) {
        uint32_t x = (uint32_t)(p % c->width), y = (uint32_t)(p / c->width);
        float off = brightest(shown + p * 3) - brightest(right + p * 3);
        int is = off >= FIREFLY_CODES && firefly_height(shown, c->width, c->height, x, y) > 0 &&
                 firefly_height(right, c->width, c->height, x, y) == 0;
        out->fireflies += (uint32_t)is;
        out->found += is && marks[p];
        out->wrong += marks[p] && off < FIREFLY_CODES / 2;
    }
    mem_free(marks);
}

/* Errors of the pixels that see the subject, and of the parts. */
static void judge_subject(struct judgement *out, const struct calibration *c, const float *errors)
{
    size_t pixels = (size_t)c->width * c->height, tiles = tile_count(c->width, c->height);
    struct weighted *values = mem_calloc(pixels, sizeof *values), *parts = mem_calloc(tiles, sizeof *parts);
    double seen = 0;

    if (!values || !parts)
        abort();
    for (size_t p = 0; p < pixels; p++)
        seen += (double)c->subject[p];
    for (size_t p = 0; p < pixels; p++) {
        struct weighted *part = &parts[p / c->width / 16 * ((c->width + 15) / 16) + p % c->width / 16];
        values[p] = (struct weighted){(double)errors[p], seen > 0 ? (double)c->subject[p] : 1};
        part->value += values[p].value * values[p].value * values[p].weight;
        part->weight += values[p].weight;
    }
    for (size_t t = 0; t < tiles; t++)
        parts[t].value = parts[t].weight > 0 ? sqrt(parts[t].value / parts[t].weight) : 0;
    out->true_display = weighted_quantile(values, pixels, 0.95);
    out->true_part = weighted_quantile(parts, tiles, 0.99);
    mem_free(values);
    mem_free(parts);
}

static void check(int ok, const char *what)
{
    if (!ok) {
        fprintf(stderr, "judge: %s\n", what);
        abort();
    }
}

void judge(struct judgement *out, const struct calibration *c, uint32_t seed, uint32_t level,
           const struct tonemap_settings *look)
{
    const struct calibration_view *v = &c->views[seed * c->levels + level];
    size_t pixels = (size_t)c->width * c->height, values = pixels * 3;
    double *truth = mem_calloc(values, sizeof *truth), mean = 0, squared = 0, codes = 0, unsure;
    float *picture = mem_calloc(values, sizeof(float)), *exact = mem_calloc(values, sizeof(float));
    float *shown = mem_calloc(values, sizeof(float)), *right = mem_calloc(values, sizeof(float));
    float *errors = mem_calloc(pixels, sizeof(float)), *share;
    float *tail = mem_calloc((size_t)tile_count(c->width, c->height) * RECORD_GROUPS * RECORD_TAIL_MAX, sizeof(float));
    struct accuracy_transform transform = {.apply = show_codes, .user = (void *)look};
    struct accuracy_tails tails = {tail, (size_t)tile_count(c->width, c->height) * RECORD_GROUPS,
                                   RECORD_TAIL_MAX, pixels * calibration_spp(level)};
    struct accuracy_evidence evidence = {.samples = calibration_spp(level), .effects = c->effects,
                                         .brightest = c->brightest, .tails = &tails};
    struct accuracy_picture p = {.width = c->width, .height = c->height};
    struct error err = {0};

    check(truth && picture && exact && shown && right && errors && tail, "out of memory");
    for (size_t i = 0; i < tails.lists * tails.length; i++)
        tail[i] = v->tails[i].luminance;
    unsure = calibration_truth(c, seed, truth);
    for (size_t i = 0; i < values; i++) {
        picture[i] = (v->groups[0][i] + v->groups[1][i]) / 2;
        exact[i] = (float)truth[i];
        mean += truth[i] / (double)values;
        squared += ((double)picture[i] - truth[i]) * ((double)picture[i] - truth[i]);
    }
    check(show_codes((void *)look, picture, c->width, c->height, shown, &err) == STATUS_OK &&
          show_codes((void *)look, exact, c->width, c->height, right, &err) == STATUS_OK, "codes");
    out->exposure = log_mean_of(picture, c->width, c->height, look) - log_mean_of(exact, c->width, c->height, look);
    for (size_t i = 0; i < pixels; i++)
        errors[i] = (float)largest_error(shown + i * 3, right + i * 3);
    for (size_t i = 0; i < values; i++)
        codes += ((double)shown[i] - (double)right[i]) * ((double)shown[i] - (double)right[i]);
    p.subject = share = mem_calloc(tile_count(c->width, c->height), sizeof *share);
    check(share != NULL, "out of memory");
    for (size_t i = 0; i < pixels; i++) {
        struct tile_rect rect;
        uint32_t tile = (uint32_t)(i / c->width / 16 * ((c->width + 15) / 16) + i % c->width / 16);
        rect = tile_rect_of(c->width, c->height, tile);
        share[tile] += c->subject[i] / (float)(rect.width * rect.height);
    }
    for (int r = 0; r < RECORD_GROUPS; r++)
        p.groups[r] = v->groups[r];
    check(accuracy_figures_of(&out->figures, &p, &transform, &evidence, NULL, &err) == STATUS_OK, err.text);
    out->true_all = (double)quantile_select(errors, pixels, (size_t)((double)(pixels - 1) * 0.95));
    judge_subject(out, c, errors);
    for (int r = 0; r < RECORD_GROUPS; r++) /* both are used up */
        check(show_codes((void *)look, v->groups[r], c->width, c->height, r ? exact : picture, &err) == STATUS_OK, "codes");
    judge_fireflies(out, c, picture, exact, shown, right);
    out->true_rmse = squared > unsure ? 100 * sqrt((squared - unsure) / (double)values) / mean : 0;
    if (out->true_rmse < ROUNDING_PERCENT)
        out->true_rmse = 0;
    out->true_psnr = codes > 0 ? 10 * log10(255.0 * 255.0 * (double)values / codes) : INFINITY;
    out->cpu_s = (double)v->cpu_ns * 1e-9;
    mem_free(truth);
    mem_free(picture);
    mem_free(exact);
    mem_free(shown);
    mem_free(right);
    mem_free(errors);
    mem_free(tail);
    mem_free(share);
}
