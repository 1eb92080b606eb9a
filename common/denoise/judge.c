/* The figures of a denoised picture O = (F_A + F_B) / 2.
 *
 * error_of() gives each pixel's squared error without bias, but with a noise of the size of the raw picture's squared
 * error: only sums over thousands of pixels say anything. So pixels are sorted into classes by a guess of their error,
 * the square of (F_A - F_B) / 2 around them, which has the filter's noise but not what it blurs; the mean of error_of() over a
 * class says how large the error is there. Errors in display codes are those times the slope of what the display shows. */
#include "common/denoise/judge.h"

#include <math.h>
#include <string.h>

#include "common/accuracy/quantile.h"
#include "common/accuracy/word.h"
#include "common/base/memory.h"
#include "common/math/elementary.h"

/* Two-sided 95 % of a normal distribution. */
#define NORMAL_95 1.959963984540054
/* What the display error's model may be off besides chance, as a standard deviation of its logarithm: measured
 * (docs/DENOISING.md). */
#define MODEL_SPREAD 0.1
/* The slope of the display is taken over the guessed error, at least this share of the pixel's and of the picture's
 * brightness. */
#define STEP 0.02f
#define STEP_DARK 0.002f
/* A class has at least so many pixels; smaller ones join the next. */
#define CLASS_MIN 512

enum { CODE_STEPS = 256, CLASSES = 96, CLASS_MIDDLE = 48, CLASSES_PER_OCTAVE = 2, AROUND = 2 };

struct class_sum {
    double error, squares, noise; /* sums of squared errors of pixels in codes, their squares, and of what
                                    * the filters' own noise makes of them */
    double pixels;
};

struct judged {
    const struct filtered *f;
    const float *image, *first; /* O, F_A */
    uint32_t width, height;
    double mean;
    double linear, linear_squares, linear_noise; /* as in struct class_sum, of radiance */
    double coded, coded_squares, coded_noise;    /* of all channels' codes */
    struct class_sum classes[CLASSES];
    float *guess;           /* [pixels]: of the error's square, the channels' mean */
    float *lines;           /* one line of sums, for guesses */
    float *moved, *codes;   /* shown with one colour of a chessboard moved up */
    uint16_t *codes_before; /* the same with the other, times CODE_STEPS, to save memory */
};

static void figures_unknown(struct accuracy_figures *out)
{
    *out = (struct accuracy_figures){
        .display_error = NAN, .display_lo = NAN, .display_hi = NAN, .psnr_db = NAN, .psnr_lo = NAN,
        .psnr_hi = NAN, .rmse_percent = NAN, .rmse_lo = NAN, .rmse_hi = NAN, .mean = NAN,
        .lone = NAN, .dark = NAN, .top_share = NAN, .disagreement = NAN, .unseen = NAN, .tail_index = NAN};
}

static float other_of(const struct judged *j, size_t i) { return 2 * j->image[i] - j->first[i]; }

/* A quarter of (F_A - F_B)^2, the channels' mean. */
static float noise_at(const struct judged *j, size_t p)
{
    float sum = 0;

    for (size_t i = p * 3; i < p * 3 + 3; i++)
        sum += (j->first[i] - j->image[i]) * (j->first[i] - j->image[i]);
    return sum / 3;
}

/* The mean of noise_at() over the pixels around each, without itself: its own error would choose its class. */
static void guess(struct judged *j)
{
    const int64_t width = j->width, height = j->height;

    for (int64_t y = 0; y < height; y++) {
        const int64_t top = y > AROUND ? y - AROUND : 0, bottom = y + AROUND < height ? y + AROUND : height - 1;
        for (int64_t x = 0; x < width; x++) {
            float sum = 0;
            for (int64_t v = top; v <= bottom; v++)
                sum += j->guess[v * width + x];
            j->lines[x] = sum;
        }
        for (int64_t x = 0; x < width; x++) {
            const int64_t left = x > AROUND ? x - AROUND : 0, right = x + AROUND < width ? x + AROUND : width - 1;
            const int64_t count = (right - left + 1) * (bottom - top + 1) - 1;
            float sum = -j->guess[y * width + x];
            for (int64_t u = left; u <= right; u++)
                sum += j->lines[u];
            /* Into the place of a channel that is not needed yet. */
            j->moved[y * width + x] = count && sum > 0 ? sum / (float)count : 0;
        }
    }
    memcpy(j->guess, j->moved, (size_t)width * j->height * sizeof *j->guess);
}

/* The picture moved up on one colour of a chessboard and down on the other, so that metering sees the same light. */
static void move(struct judged *j, int side)
{
    for (uint32_t y = 0; y < j->height; y++)
        for (uint32_t x = 0; x < j->width; x++) {
            const size_t p = (size_t)y * j->width + x;
            const float sign = ((x + y) & 1) == (uint32_t)side ? 1 : -1, error = sqrtf(j->guess[p]);
            for (size_t i = p * 3; i < p * 3 + 3; i++) {
                const float least = STEP * j->image[i] + STEP_DARK * (float)j->mean;
                const float moved = j->image[i] + sign * (error > least ? error : least);
                j->moved[i] = moved > 0 ? moved : 0;
            }
        }
}

static int class_of(double square)
{
    int exponent;
    const double part = frexp(square, &exponent);
    const int at = CLASS_MIDDLE + exponent * CLASSES_PER_OCTAVE + (part >= 0.70710678118654752);

    return !(square > 0) || at < 0 ? 0 : at >= CLASSES ? CLASSES - 1 : at;
}

static void gather(struct judged *j)
{
    const struct denoise_input *in = j->f->input;

    for (size_t p = 0; p < (size_t)j->width * j->height; p++) {
        double linear = 0, codes = 0, noise = 0, own = 0, own_noise = 0, most = -1;
        for (size_t i = p * 3; i < p * 3 + 3; i++) {
            const float first = j->first[i], other = other_of(j, i);
            const double e = (double)error_of(in->groups[0][i], in->groups[1][i], first, other) / 4;
            const double moved[2] = {(double)j->image[i], 0};
            linear += e;
            if (j->moved) {
                const double error = sqrt((double)j->guess[p]);
                const double least = (double)STEP * moved[0] + (double)STEP_DARK * j->mean;
                const double step = error > least ? error : least, down = moved[0] > step ? step : moved[0];
                const double rise = ((double)j->codes[i] - (double)j->codes_before[i] / CODE_STEPS) / (step + down);
                const double slope = rise * rise, expected = slope * (double)j->guess[p];
                const double apart = (double)first - moved[0];
                codes += slope * e;
                noise += slope * apart * apart;
                if (expected > most) {
                    most = expected;
                    own = slope * e;
                    own_noise = slope * apart * apart;
                }
            }
        }
        j->linear += linear;
        j->linear_squares += linear * linear;
        j->linear_noise += 3 * (double)noise_at(j, p);
        if (j->moved) {
            struct class_sum *c = &j->classes[class_of(most)];
            j->coded += codes;
            j->coded_squares += codes * codes;
            j->coded_noise += noise;
            c->error += own;
            c->squares += own * own;
            c->noise += own_noise;
            c->pixels++;
        }
    }
}

static void class_join(struct class_sum *to, struct class_sum *from)
{
    to->error += from->error;
    to->squares += from->squares;
    to->noise += from->noise;
    to->pixels += from->pixels;
    memset(from, 0, sizeof *from);
}

/* The squared error of a sum, which is not less than the filters' own noise. */
static double at_least_noise(double error, double noise) { return error > noise ? error : noise; }

static double class_error(const struct class_sum *c) { return at_least_noise(c->error, c->noise) / c->pixels; }

/* Classes of few pixels join the next; then neighbours whose errors fall while their guesses rise. */
static int join_classes(struct judged *j, struct class_sum out[CLASSES])
{
    int count = 0;
    struct class_sum few = {0};

    for (int i = 0; i < CLASSES; i++) {
        class_join(&few, &j->classes[i]);
        if (few.pixels < CLASS_MIN)
            continue;
        out[count++] = few;
        few = (struct class_sum){0};
    }
    if (few.pixels > 0) {
        if (count)
            class_join(&out[count - 1], &few);
        else
            out[count++] = few;
    }
    for (int i = 1; i < count; i++)
        while (i > 0 && class_error(&out[i]) < class_error(&out[i - 1])) {
            class_join(&out[i - 1], &out[i]);
            memmove(out + i, out + i + 1, (size_t)(count - i - 1) * sizeof *out);
            count--;
            i--;
        }
    return count;
}

/* Half the width of a 95 % interval of the logarithm of a mean squared error's root. */
static double spread_of(double sum, double squares)
{
    return sum > 0 ? NORMAL_95 * sqrt(squares + MODEL_SPREAD * MODEL_SPREAD * 4 * sum * sum) / (2 * sum) : 0;
}

static status figure_display(struct judged *j, struct accuracy_figures *out, struct error *err)
{
    struct spreads *spreads = mem_calloc(1, sizeof *spreads);
    struct class_sum classes[CLASSES];
    const int count = join_classes(j, classes);
    double error = 0, squares = 0;

    NEED(spreads, err, "a picture's error");
    for (int i = 0; i < count; i++)
        spreads_add(spreads, (float)sqrt(class_error(&classes[i])), (uint64_t)classes[i].pixels);
    out->display_error = spreads_quantile(spreads, DISPLAY_BEYOND);
    /* The classes that the figure comes from. */
    for (int i = 0; i < count; i++)
        if (class_error(&classes[i]) * 9 > out->display_error * out->display_error) {
            error += class_error(&classes[i]) * classes[i].pixels;
            squares += classes[i].squares;
        }
    mem_free(spreads);
    squares = spread_of(error, squares);
    out->display_lo = out->display_error * det_exp_d(-squares);
    out->display_hi = out->display_error * det_exp_d(squares);
    return STATUS_OK;
}

static void figure_psnr(const struct judged *j, struct accuracy_figures *out)
{
    const double scale = 10 / 2.302585092994045684, values = (double)j->width * j->height * 3;
    const double sum = at_least_noise(j->coded, j->coded_noise), spread = 2 * scale * spread_of(sum, j->coded_squares);

    out->psnr_db = sum > 0 ? scale * det_log_d(255.0 * 255.0 * values / sum) : INFINITY;
    out->psnr_lo = out->psnr_db - spread;
    out->psnr_hi = out->psnr_db + spread;
}

static void figure_rmse(const struct judged *j, struct accuracy_figures *out)
{
    const double values = (double)j->width * j->height * 3, sum = at_least_noise(j->linear, j->linear_noise);
    const double spread = spread_of(sum, j->linear_squares);

    out->mean = j->mean;
    out->rmse_percent = sum > 0 && j->mean != 0 ? 100 * sqrt(sum / values) / fabs(j->mean) : 0;
    out->rmse_lo = out->rmse_percent * det_exp_d(-spread);
    out->rmse_hi = out->rmse_percent * det_exp_d(spread);
}

static status judge_codes(struct judged *j, const struct denoise_options *options, struct accuracy_figures *out,
                          struct error *err)
{
    const struct accuracy_transform *t = options->transform;

    for (int side = 0; side < 2; side++) {
        move(j, side);
        TRY(t->apply(t->user, j->moved, j->width, j->height, j->codes, err));
        for (size_t i = 0; side == 0 && i < (size_t)j->width * j->height * 3; i++)
            j->codes_before[i] = (uint16_t)(fminf(fmaxf(j->codes[i], 0), 255) * CODE_STEPS + 0.5f);
    }
    gather(j);
    figure_psnr(j, out);
    return figure_display(j, out, err);
}

static status judge_known(struct judged *j, const struct denoise_options *options, struct denoise_result *result,
                          struct error *err)
{
    struct accuracy_figures *out = &result->figures;
    const size_t pixels = (size_t)j->width * j->height;

    for (size_t i = 0; i < pixels * 3; i++)
        j->mean += (double)j->image[i];
    j->mean /= (double)pixels * 3;
    for (size_t p = 0; p < pixels; p++)
        j->guess[p] = noise_at(j, p);
    guess(j);
    if (options->transform) {
        TRY(judge_codes(j, options, out, err));
    } else {
        mem_free(j->moved);
        j->moved = NULL;
        gather(j);
    }
    figure_rmse(j, out);
    out->lone = out->dark = out->disagreement = out->top_share = 0;
    out->tail_index = options->evidence && options->evidence->tails ? accuracy_tails_index(options->evidence->tails) : NAN;
    out->unseen = options->evidence ? word_unseen(options->evidence, j->linear) : 0;
    out->known = 1;
    word_choose(out, options->evidence);
    /* RMSE holds within 15 %; codes were measured at 0.4 to 1.1 of the truth, and are never called reliable. */
    out->reliable &= !options->transform;
    return STATUS_OK;
}

status judge_result(const struct filtered *f, const struct denoise_options *options, struct denoise_result *result,
                    struct error *err)
{
    struct judged *j;
    const uint32_t tiles = mix_tiles(f->input);
    const size_t pixels = (size_t)f->input->width * f->input->height;
    status s = STATUS_OK;

    figures_unknown(&result->figures);
    for (uint32_t tile = 0; tile < tiles; tile++)
        if (!mix_tile_is_known(f->input, tile))
            return STATUS_OK;
    j = mem_calloc(1, sizeof *j);
    NEED(j, err, "a picture's error");
    j->f = f;
    j->image = result->image;
    j->first = f->pictures[0];
    j->width = f->input->width;
    j->height = f->input->height;
    j->guess = mem_alloc_array(pixels, sizeof(float));
    j->lines = mem_alloc_array(j->width, sizeof(float));
    j->moved = mem_alloc_array(pixels * 3, sizeof(float));
    if (options->transform) {
        j->codes = mem_alloc_array(pixels * 3, sizeof *j->codes);
        j->codes_before = mem_alloc_array(pixels * 3, sizeof *j->codes_before);
    }
    if (!j->guess || !j->lines || !j->moved || (options->transform && (!j->codes || !j->codes_before)))
        s = error_no_memory(err, "a picture's error");
    THEN(s, judge_known(j, options, result, err));
    mem_free(j->codes_before);
    mem_free(j->codes);
    mem_free(j->moved);
    mem_free(j->lines);
    mem_free(j->guess);
    mem_free(j);
    return s;
}
