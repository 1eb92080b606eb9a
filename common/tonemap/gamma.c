/* Gamma compression: a power of each channel, L_out = A L^(1/gamma), gives the display code
 * directly. It replaces the sRGB curve. */
#include "common/base/memory.h"
#include "common/math/curve_table.h"
#include "common/tonemap/operators.h"

enum { GAMMA, GAIN };

/* Gains from 0.001 reach white at 0.001^-5 < 2^50, and below 2^-126 a gain of 1000 and a gamma
 * of 5 leave less than 3e-5. */
enum { FIRST_OCTAVE = -126, OCTAVES = 50 - FIRST_OCTAVE };

static const struct tonemap_parameter parameters[] = {
    [GAMMA] = {"gamma", 1.0, 5.0, 2.2, "display code = gain * light^(1/gamma)", TONEMAP_NUMBER,
               NULL},
    [GAIN] = {"gain", 0.001, 1000.0, 1.0, "multiplies the display code", TONEMAP_NUMBER, NULL},
};

struct power {
    double exponent, gain;
};

struct curve {
    struct curve_table table;
    float pieces[OCTAVES * CURVE_PIECES][4];
};

static double power_at(double light, const void *user)
{
    const struct power *power = user;

    return power->gain * det_pow_d(light, power->exponent);
}

static void gamma_row(const void *user, float *rgb, uint32_t width)
{
    const struct curve_table *table = user;

    for (size_t i = 0; i < (size_t)width * 3; i++)
        rgb[i] = rgb[i] >= table->low ? curve_table_at(table, rgb[i]) : 0.0f;
}

static status gamma_prepare(void **out, const struct tonemap_frame *frame, const double *state UNUSED, struct error *err)
{
    struct power power = {1.0 / frame->values[GAMMA], frame->values[GAIN]};
    struct curve *curve = *out = mem_alloc(sizeof *curve);

    NEED(curve, err, "a gamma curve");
    curve_table_build(&curve->table, curve->pieces, FIRST_OCTAVE, OCTAVES, power_at, &power);
    return STATUS_OK;
}

static status gamma_apply(const struct tonemap_frame *frame, const double *state UNUSED, struct error *err UNUSED)
{
    const struct curve *curve = frame->prepared;

    tonemap_each_row(frame, gamma_row, &curve->table);
    return STATUS_OK;
}

const struct tonemap_operator tonemap_gamma = {
    .name = "gamma",
    .summary = "A power curve on each channel, in place of the sRGB curve.",
    .source = "C. A. Poynton, \"Gamma and its disguises\", SMPTE Journal 102(12), 1993",
    .parameters = parameters,
    .parameter_count = sizeof parameters / sizeof *parameters,
    .display_encoded = 1,
    .prepare = gamma_prepare,
    .prepared_free = mem_free,
    .apply = gamma_apply,
};
