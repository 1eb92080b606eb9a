#include "common/tonemap/tonemap.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "common/image/color.h"
#include "common/math/elementary.h"
#include "common/tonemap/operators.h"

static const struct tonemap_operator *const operators[] = {
    &tonemap_reinhard,
    &tonemap_gamma,
    &tonemap_linear,
};

const struct tonemap_operator *const *tonemap_operators(size_t *count)
{
    *count = sizeof operators / sizeof *operators;
    return operators;
}

const struct tonemap_operator *tonemap_find(const char *name)
{
    for (size_t i = 0; i < sizeof operators / sizeof *operators; i++)
        if (strcmp(operators[i]->name, name) == 0)
            return operators[i];
    return NULL;
}

status tonemap_settings_init(struct tonemap_settings *s, const char *name, struct error *err)
{
    memset(s, 0, sizeof *s);
    s->op = tonemap_find(name);
    if (!s->op) {
        char known[256] = "";
        size_t used = 0;

        for (size_t i = 0; i < sizeof operators / sizeof *operators && used < sizeof known; i++)
            used += (size_t)snprintf(known + used, sizeof known - used, "%s%s", i ? ", " : "",
                                     operators[i]->name);
        return error_set(err, STATUS_ERR_INPUT,
                         "no tone mapping operator is called \"%.64s\"; there are: %s", name,
                         known);
    }
    for (size_t i = 0; i < s->op->parameter_count; i++)
        s->values[i] = s->op->parameters[i].preset;
    return STATUS_OK;
}

status tonemap_settings_set(struct tonemap_settings *s, const char *parameter, double value,
                            struct error *err)
{
    char known[256] = "none";
    size_t used = 0;

    for (size_t i = 0; i < s->op->parameter_count; i++) {
        const struct tonemap_parameter *p = &s->op->parameters[i];

        if (strcmp(p->name, parameter) == 0) {
            if (!(value >= p->min && value <= p->max))
                return error_set(err, STATUS_ERR_INPUT,
                                 "%s's %s must be from %g to %g, and is %g", s->op->name, p->name,
                                 p->min, p->max, value);
            s->values[i] = value;
            return STATUS_OK;
        }
        if (used < sizeof known)
            used += (size_t)snprintf(known + used, sizeof known - used, "%s%s", i ? ", " : "",
                                     p->name);
    }
    return error_set(err, STATUS_ERR_INPUT,
                     "the operator %s has no parameter \"%.64s\"; its parameters: %s", s->op->name,
                     parameter, known);
}

/* A channel after exposure: finite and not negative. */
static float expose(float value, double gain)
{
    double exposed = (double)value * gain;

    if (!(exposed > 0.0)) /* NaN too */
        return 0.0f;
    return exposed > (double)FLT_MAX ? FLT_MAX : (float)exposed;
}

/* Expose `in` into `out` and take the statistics on the way, row by row, in double. */
static void expose_and_measure(struct image *out, const struct image *in, double gain,
                               struct tonemap_statistics *statistics)
{
    size_t count = (size_t)in->width * in->height;
    double log_sum = 0.0;

    *statistics = (struct tonemap_statistics){.log_mean = 1.0};
    for (size_t i = 0; i < count; i++) {
        const float *from = in->pixels + 3 * i;
        float *to = out->pixels + 3 * i, plain[3];
        double luminance, exposed;

        for (int c = 0; c < 3; c++) {
            to[c] = expose(from[c], gain);
            plain[c] = from[c] > 0.0f ? from[c] : 0.0f;
        }
        if (!isfinite(from[0]) || !isfinite(from[1]) || !isfinite(from[2]))
            continue;
        luminance = tonemap_luminance(plain);
        exposed = tonemap_luminance(to);
        if (!(luminance > 0.0) || !(exposed > 0.0))
            continue;
        log_sum += det_log_d(luminance);
        statistics->counted++;
        if (exposed > statistics->max)
            statistics->max = exposed;
        if (exposed < statistics->min || statistics->min == 0.0)
            statistics->min = exposed;
    }
    if (statistics->counted > 0)
        statistics->log_mean = det_exp_d(log_sum / (double)statistics->counted);
}

/* Whatever the operator left: within 0..1, never NaN, and encoded exactly once. */
static void finish(struct image *image, int display_encoded)
{
    size_t count = (size_t)image->width * image->height * 3;

    for (size_t i = 0; i < count; i++) {
        float value = image->pixels[i];

        if (!display_encoded)
            value = srgb_encode(value);
        if (!(value > 0.0f))
            value = 0.0f;
        image->pixels[i] = value < 1.0f ? value : 1.0f;
    }
}

/* 2^ev, exact for whole stops. */
static double exposure_gain(double ev)
{
    double whole = floor(ev);

    return ldexp(ev == whole ? 1.0 : det_pow_d(2.0, ev - whole), (int)whole);
}

status tonemap_apply(struct image *out, const struct image *in, const struct tonemap_settings *s,
                     struct error *err)
{
    struct tonemap_statistics statistics;
    status st;

    memset(out, 0, sizeof *out);
    if (in->channels != 3)
        return error_set(err, STATUS_ERR_INTERNAL, "tone mapping needs 3 channels, not %u",
                         (unsigned)in->channels);
    if (!(fabs(s->exposure_ev) <= TONEMAP_EXPOSURE_MAX))
        return error_set(err, STATUS_ERR_INPUT,
                         "the exposure must be from -%d to %d stops, and is %g",
                         TONEMAP_EXPOSURE_MAX, TONEMAP_EXPOSURE_MAX, s->exposure_ev);
    st = image_init(out, in->width, in->height, 3, err);
    if (st != STATUS_OK)
        return st;
    expose_and_measure(out, in, exposure_gain(s->exposure_ev), &statistics);
    st = s->op->apply(out, &statistics, s->values, err);
    if (st != STATUS_OK) {
        image_release(out);
        return st;
    }
    finish(out, s->op->display_encoded);
    return STATUS_OK;
}
