/* The global operator of Reinhard et al. 2002, with burn-out at a white point (their
 * equations 1, 2 and 4). Colours keep their ratios: every channel is scaled like the
 * luminance.
 *
 *   L  = key / log_mean * Y
 *   Ld = L (1 + L / white^2) / (1 + L)
 *
 * The scale Ld / Y is computed without dividing by Y, so that black stays black without a
 * special case.
 */
#include <math.h>

#include "common/tonemap/operators.h"

enum { KEY, WHITE };

static const struct tonemap_parameter parameters[] = {
    [KEY] = {"key", 0.001, 100.0, 0.18,
             "what the picture's log-mean luminance becomes before compression; "
             "0.045 is low key, 0.72 high key"},
    [WHITE] = {"white", 0.0, 1e9, 0.0,
               "the scaled luminance that becomes white; 0: the picture's maximum"},
};

struct curve {
    double scale, inverse_white2;
};

static void reinhard_row(const void *user, float *rgb, uint32_t width)
{
    const struct curve *curve = user;

    for (float *p = rgb; p < rgb + (size_t)width * 3; p += 3) {
        double luminance = curve->scale * tonemap_luminance(p);
        double factor = curve->scale * (1.0 + luminance * curve->inverse_white2) /
                        (1.0 + luminance);

        for (int c = 0; c < 3; c++)
            p[c] = (float)fmin((double)p[c] * factor, 1.0);
    }
}

static status reinhard_apply(const struct tonemap_frame *frame, const double *state,
                             struct error *err)
{
    struct curve curve = {.scale = frame->values[KEY] / frame->statistics.log_mean};
    double white = frame->values[WHITE] > 0.0 ? frame->values[WHITE]
                                              : curve.scale * frame->statistics.max;

    (void)state;
    (void)err;
    curve.inverse_white2 = white > 0.0 ? 1.0 / (white * white) : 0.0;
    tonemap_each_row(frame, reinhard_row, &curve);
    return STATUS_OK;
}

const struct tonemap_operator tonemap_reinhard02 = {
    .name = "reinhard02",
    .summary = "Photographic tone reproduction, global, with a white point.",
    .source = "E. Reinhard, M. Stark, P. Shirley, J. Ferwerda, \"Photographic Tone Reproduction "
              "for Digital Images\", ACM TOG 21(3), 2002",
    .parameters = parameters,
    .parameter_count = sizeof parameters / sizeof *parameters,
    .apply = reinhard_apply,
};
