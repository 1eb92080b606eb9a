#include "tests/support/judge.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "common/accuracy/quantile.h"
#include "common/base/memory.h"
#include "common/image/color.h"

/* What a mean of floats is off by even where every sample is the same. */
#define ROUNDING_PERCENT 1e-4

static status srgb_codes(void *user, const float *rgb, uint32_t width, uint32_t height, float *codes,
                         struct error *err)
{
    float gain = *(const float *)user;

    (void)err;
    for (size_t i = 0; i < (size_t)width * height * 3; i++)
        codes[i] = 255 * srgb_encode(rgb[i] * gain);
    return STATUS_OK;
}

static double largest_error(const float *a, const float *b)
{
    double largest = 0;

    for (int c = 0; c < 3; c++)
        largest = fmax(largest, fabs((double)a[c] - (double)b[c]));
    return largest;
}

static void check(int ok, const char *what)
{
    if (!ok) {
        fprintf(stderr, "judge: %s\n", what);
        abort();
    }
}

void judge(struct judgement *out, const struct calibration *c, uint32_t seed, uint32_t level)
{
    const struct calibration_view *v = &c->views[seed * c->levels + level];
    size_t pixels = (size_t)c->width * c->height, values = pixels * 3;
    double *truth = mem_calloc(values, sizeof *truth), mean = 0, squared = 0, codes = 0, unsure;
    float *picture = mem_calloc(values, sizeof(float)), *exact = mem_calloc(values, sizeof(float));
    float *shown = mem_calloc(values, sizeof(float)), *right = mem_calloc(values, sizeof(float));
    float *errors = mem_calloc(pixels, sizeof(float)), gain;
    float *tail = mem_calloc((size_t)tile_count(c->width, c->height) * RECORD_GROUPS * RECORD_TAIL_MAX, sizeof(float));
    struct accuracy_transform transform = {srgb_codes, &gain};
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
        picture[i] = (v->replicates[0][i] + v->replicates[1][i] + v->replicates[2][i] + v->replicates[3][i]) / 4;
        exact[i] = (float)truth[i];
        mean += truth[i] / (double)values;
        squared += ((double)picture[i] - truth[i]) * ((double)picture[i] - truth[i]);
    }
    gain = mean > 0 ? (float)(0.18 / mean) : 1;
    check(srgb_codes(&gain, picture, c->width, c->height, shown, &err) == STATUS_OK &&
          srgb_codes(&gain, exact, c->width, c->height, right, &err) == STATUS_OK, "codes");
    for (size_t i = 0; i < pixels; i++)
        errors[i] = (float)largest_error(shown + i * 3, right + i * 3);
    for (size_t i = 0; i < values; i++)
        codes += ((double)shown[i] - (double)right[i]) * ((double)shown[i] - (double)right[i]);
    for (int r = 0; r < CALIBRATION_PARTS; r++)
        p.replicates[r] = v->replicates[r];
    check(accuracy_figures_of(&out->figures, &p, &transform, &evidence, NULL, &err) == STATUS_OK, err.text);
    out->true_display = (double)quantile_select(errors, pixels, (size_t)((double)(pixels - 1) * 0.95));
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
}
