/* Division by a reference taken from the picture: the value below which a percentile of the pixels lies, a pixel's
 * value being its largest channel, so that at 100 nothing is cut off. The preset gives up the brightest thousandth,
 * because in rendered pictures the maximum is a firefly or the sun, and everything else would be black. */
#include "common/math/elementary.h"
#include "common/tonemap/operators.h"

enum { PERCENTILE };

static const struct tonemap_parameter parameters[] = {
    [PERCENTILE] = {"percentile", 0.0, 100.0, 99.9,
                    "of the pixels' largest channels; becomes white; 100: the maximum",
                    TONEMAP_NUMBER, NULL},
};

/* The logarithm of the reference, before exposure. */
static status normalize_measure(const struct tonemap_frame *frame, double *state, struct error *err)
{
    double reference;
    status st = tonemap_percentile_of(&reference, frame->image, TONEMAP_LARGEST_CHANNEL, frame->values[PERCENTILE],
                                      frame->threads, err);

    if (st == STATUS_OK)
        state[0] = reference > 0.0 ? det_log_d(reference / frame->gain) : 0.0;
    return st;
}

static void scale_row(const void *user, float *rgb, uint32_t width)
{
    double scale = *(const double *)user;

    for (size_t i = 0; i < (size_t)width * 3; i++)
        rgb[i] = (float)fmin((double)rgb[i] * scale, 1.0);
}

static status normalize_apply(const struct tonemap_frame *frame, const double *state, struct error *err UNUSED)
{
    double scale = state ? det_exp_d(-state[0]) : 1.0;

    tonemap_each_row(frame, scale_row, &scale);
    return STATUS_OK;
}

const struct tonemap_operator tonemap_normalize = {
    .name = "normalize",
    .summary = "Division by the picture's maximum, or by a percentile; no curve.",
    .source = "linear scaling to the display's range",
    .parameters = parameters,
    .parameter_count = sizeof parameters / sizeof *parameters,
    .state_count = 1,
    .measured = 1,
    .measure = normalize_measure,
    .apply = normalize_apply,
};
