/* Adaptive logarithmic mapping of Drago et al. 2003: a logarithm whose base moves from 2 in the dark to 10 in the
 * brightest spot, by a bias power function (their equation 4).
 *
 *   Ld = display / 100 / log10(Lmax + 1) * ln(L + 1) / ln(2 + 8 (L / Lmax)^(ln bias / ln 0.5))
 *
 * L is luminance over the world adaptation luminance: the log-mean over (1 + bias - 0.85)^5, so that the picture does
 * not darken as the bias grows (as in the paper; pfstools leaves the power out, which is the same only at bias 0.85).
 * Colours keep their ratios. Ld / Y is computed by log1p(L) / L, which has a limit at 0; it depends only on Y, so it is
 * taken from a table. The paper's changes to the display's gamma are left to the display: the result is light.
 *
 * The paper's Lmax is the picture's maximum, which in a noisy picture is one pixel's luck. Ours is a percentile, as
 * Reinhard has it for his operator's parameters (JGT 7(1), 2002); at 100 it is the paper's.
 */
#include <math.h>

#include "common/base/memory.h"
#include "common/base/safeguard.h"
#include "common/math/curve_table.h"
#include "common/tonemap/operators.h"

enum { BIAS, DISPLAY, PERCENTILE };

static const struct tonemap_parameter parameters[] = {
    [BIAS] = {"bias", 0.5, 1.0, 0.85,
              "how the logarithm's base moves; less is brighter, 0.7 to 0.9 is of use",
              TONEMAP_NUMBER, NULL},
    [DISPLAY] = {"display", 1.0, 10000.0, 100.0,
                 "cd/m2 of the display's white; the picture's brightest part becomes display / 100",
                 TONEMAP_NUMBER, NULL},
    [PERCENTILE] = {"percentile", 0.0, 100.0, 99.9,
                    "of the pixels' luminance: the picture's brightest part; 100: the maximum, one noisy pixel",
                    TONEMAP_NUMBER, NULL},
};

static const double PRESET_BIAS = 0.85; /* of the paper's rescaling, not of ours */

struct curve {
    double adaptation; /* multiplies luminance */
    double max;        /* Lmax, before that */
    double exponent;
    double level;             /* of the display, over log10(Lmax + 1) */
    struct curve_table table; /* of negative_factor over the picture's luminances */
    float pieces[][4];
};

/* ln(1 + x) / x for x >= 0. Dividing by the rounded 1 + x cancels its rounding error. */
static double log1p_ratio(double x)
{
    double sum = 1.0 + x;

    return sum == 1.0 && SAFEGUARD(DRAGO_FAINT) ? 1.0 : det_log_d(sum) / (sum - 1.0);
}

/* Ld / Y of the luminance Y, given as a share of the maximum. */
static double factor_of(const struct curve *curve, double y, double ratio)
{
    double base = 2.0 + 8.0 * det_pow_d(ratio, curve->exponent);

    return curve->level * curve->adaptation * log1p_ratio(curve->adaptation * y) / det_log_d(base);
}

/* It decreases with Y, which a curve_table must not. Nor may it have a corner where Y is the maximum. */
static double negative_factor(double y, const void *user)
{
    const struct curve *curve = user;

    return -factor_of(curve, y, y / curve->max);
}

static void drago_row(const void *user, float *rgb, uint32_t width)
{
    const struct curve *curve = user;

    for (float *p = rgb; p < rgb + (size_t)width * 3; p += 3) {
        double luminance = tonemap_luminance(p), factor;
        float y = (float)luminance;

        if (!(luminance > 0.0))
            continue;
        if (y >= curve->table.low && luminance <= curve->max)
            factor = -(double)curve_table_at(&curve->table, y);
        else /* an average over frames does not contain all values of this one */
            factor = factor_of(curve, luminance, fmin(luminance / curve->max, 1.0));
        for (int c = 0; c < 3; c++) {
            double value = (double)p[c] * factor;

            p[c] = value < 1.0 ? (float)value : 1.0f;
        }
    }
}

enum { OCTAVE_MIN = -126, OCTAVE_MAX = 127 }; /* of normal floats */

/* The octave in which a luminance lies. */
static int octave_of(double luminance)
{
    int exponent;

    frexp(luminance, &exponent);
    exponent--;
    return exponent < OCTAVE_MIN ? OCTAVE_MIN : exponent > OCTAVE_MAX ? OCTAVE_MAX : exponent;
}

/* The logarithm of the brightest part's luminance, before exposure. */
static status drago_measure(const struct tonemap_frame *frame, double *state, struct error *err)
{
    double brightest;
    status st = tonemap_percentile_of(&brightest, frame->image, TONEMAP_LUMINANCE, frame->values[PERCENTILE],
                                      frame->threads, err);

    if (st == STATUS_OK)
        state[0] = det_log_d((brightest > 0.0 ? brightest : frame->statistics.max) / frame->gain);
    return st;
}

/* NULL for a black frame. */
static status drago_prepare(void **out, const struct tonemap_frame *frame, const double *state UNUSED, struct error *err)
{
    double bias = frame->values[BIAS], max, brightest, growth = 1.0 + bias - PRESET_BIAS;
    int first, count;
    struct curve *curve;

    *out = NULL;
    if (!state)
        return STATUS_OK;
    brightest = fmax(det_exp_d(state[0]) * frame->gain, frame->statistics.min);
    first = octave_of(frame->statistics.min);
    count = octave_of(brightest) - first + 1;
    curve = mem_alloc(sizeof *curve + (size_t)count * CURVE_PIECES * sizeof *curve->pieces);
    NEED(curve, err, "a logarithmic curve");
    curve->adaptation = growth * growth * growth * growth * growth / frame->statistics.log_mean;
    max = curve->adaptation * brightest;
    curve->max = brightest;
    curve->exponent = det_log_d(bias) / det_log_d(0.5);
    curve->level = frame->values[DISPLAY] / 100.0 * det_log_d(10.0) / (log1p_ratio(max) * max);
    curve_table_build(&curve->table, curve->pieces, first, count, negative_factor, curve);
    *out = curve;
    return STATUS_OK;
}

static status drago_apply(const struct tonemap_frame *frame, const double *state UNUSED, struct error *err UNUSED)
{
    if (frame->prepared)
        tonemap_each_row(frame, drago_row, frame->prepared);
    return STATUS_OK;
}

const struct tonemap_operator tonemap_drago03 = {
    .name = "drago03",
    .summary = "Adaptive logarithmic mapping: more compression the brighter it is.",
    .source = "F. Drago, K. Myszkowski, T. Annen, N. Chiba, \"Adaptive Logarithmic Mapping For "
              "Displaying High Contrast Scenes\", Computer Graphics Forum 22(3), 2003",
    .parameters = parameters,
    .parameter_count = sizeof parameters / sizeof *parameters,
    .state_count = 1,
    .measured = 1,
    .measure = drago_measure,
    .prepare = drago_prepare,
    .prepared_free = mem_free,
    .apply = drago_apply,
};
