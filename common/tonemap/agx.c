/* AgX as Troy Sobotka first published it (2022, "AgX Kraken"): an inset of the primaries, a logarithm over 16.5 stops
 * around middle grey, and a sigmoid on each channel. Its result is code for a display with a power of 2.2. Blender's
 * AgX is different: it starts from Rec. 2020, with its own insets, rotations and range.
 *
 * The sigmoid is the exact one from which the published table of 4096 entries was computed, not one of the polynomials
 * fitted to it.
 */
#include <pthread.h>

#include "common/image/color.h"
#include "common/math/curve_table.h"
#include "common/tonemap/operators.h"

enum { OUTSET };

static const char *const outset_choices[] = {"off", "on", NULL};

static const struct tonemap_parameter parameters[] = {
    [OUTSET] = {"outset", 0, 1, 0,
                "off: as published, colours stay inset; on: the inset is undone after the curve, "
                "for more saturated colours",
                TONEMAP_CHOICE, outset_choices},
};

static const double inset[3][3] = {{0.842479062253094, 0.0784335999999992, 0.0792237451477643},
                                   {0.0423282422610123, 0.878468636469772, 0.0791661274605434},
                                   {0.0423756549057051, 0.0784336, 0.879142973793104}};

/* log2 of the light at the ends of the curve, and the place of middle grey on it. */
static const double LOG2_MIN = -12.47393, LOG2_MAX = 4.026069;
static const double PIVOT = 20.0 / 33.0;

enum { FIRST_OCTAVE = -13, OCTAVES = 18 };
static float pieces[OCTAVES * CURVE_PIECES][4];
static struct curve_table table;
static float light_min, light_max;
static pthread_once_t table_once = PTHREAD_ONCE_INIT;

static double sigmoid(double light, const void *user UNUSED)
{
    double t = (det_log_d(light) / det_log_d(2.0) - LOG2_MIN) / (LOG2_MAX - LOG2_MIN) - PIVOT;

    if (t < 0.0)
        return 0.5 + 2.0 * t * det_pow_d(1.0 - 59.507875 * t * t * t, -1.0 / 3.0);
    return 0.5 + 2.0 * t * det_pow_d(1.0 + 69.862789 * det_pow_d(t, 3.25), -4.0 / 13.0);
}

static void table_build(void)
{
    curve_table_build(&table, pieces, FIRST_OCTAVE, OCTAVES, sigmoid, NULL);
    light_min = (float)det_pow_d(2.0, LOG2_MIN);
    light_max = (float)det_pow_d(2.0, LOG2_MAX);
}

static float curve(double light)
{
    if (!(light > (double)light_min))
        return 0.0f;
    return curve_table_at(&table, light < (double)light_max ? (float)light : light_max);
}

static void agx_row(const void *user, float *rgb, uint32_t width)
{
    const double(*outset)[3] = user; /* NULL: none */

    for (float *p = rgb; p < rgb + (size_t)width * 3; p += 3) {
        double v[3];

        for (int i = 0; i < 3; i++)
            v[i] = (double)curve(inset[i][0] * (double)p[0] + inset[i][1] * (double)p[1] + inset[i][2] * (double)p[2]);
        for (int i = 0; i < 3; i++)
            p[i] = outset ? (float)(outset[i][0] * v[0] + outset[i][1] * v[1] + outset[i][2] * v[2]) : (float)v[i];
    }
}

static status agx_apply(const struct tonemap_frame *frame, const double *state UNUSED, struct error *err UNUSED)
{
    double outset[3][3];
    int wanted = frame->values[OUTSET] != 0.0;

    pthread_once(&table_once, table_build);
    wanted = wanted && color_matrix_invert(inset, outset);
    tonemap_each_row(frame, agx_row, wanted ? outset : NULL);
    return STATUS_OK;
}

const struct tonemap_operator tonemap_agx = {
    .name = "agx",
    .summary = "Sobotka's AgX (Kraken): a filmic curve under which bright colours go to white.",
    .source = "T. Sobotka, AgX (github.com/sobotka/AgX), 2022; for displays with a power of 2.2",
    .parameters = parameters,
    .parameter_count = sizeof parameters / sizeof *parameters,
    .display_encoded = 1,
    .apply = agx_apply,
};
