#include "common/accuracy/grain.h"

#include <math.h>

#include "common/base/memory.h"
#include "common/math/elementary.h"
#include "common/math/real.h"

/* What the transform makes of a channel's radiance, learnt from the picture itself: to apply it to the means would meter
 * them, and their brightness would differ. Eight points an octave, their mean radiance and code. */
enum { CURVE_BINS = 1 << 11, CURVE_SHIFT = 20 };
struct shown_curve {
    double value[CURVE_BINS], code[CURVE_BINS]; /* sums of each bin, then the points' means */
    uint64_t counts[CURVE_BINS];
    uint32_t points;
    uint16_t before[CURVE_BINS]; /* points of smaller bins */
};
/* How codes fall towards black below the darkest point. */
#define TOE (1 / 2.4)

static void learn(void *user, struct gathered *g, const struct strip *s, const float *const groups[2],
                  float *const codes[3])
{
    struct shown_curve *out = user;
    const size_t from = (size_t)(s->y - s->first) * g->width * 3, to = from + (size_t)s->height * g->width * 3;

    for (size_t i = from; i < to; i++) {
        float value = (groups[0][i] + groups[1][i]) / 2;
        uint32_t bin;
        if (!(value > 0))
            continue;
        bin = float_bits(value) >> CURVE_SHIFT;
        out->value[bin] += (double)value;
        out->code[bin] += (double)codes[2][i];
        out->counts[bin]++;
    }
}

static void means_of_bins(struct shown_curve *out)
{
    for (uint32_t bin = 0; bin < CURVE_BINS; bin++) {
        out->before[bin] = (uint16_t)out->points;
        if (out->counts[bin] > 0) {
            out->value[out->points] = out->value[bin] / (double)out->counts[bin];
            out->code[out->points++] = out->code[bin] / (double)out->counts[bin];
        }
    }
}

static double code_of(const struct shown_curve *c, double value)
{
    uint32_t low;

    if (!(value > 0) || c->points == 0)
        return 0;
    low = c->before[float_bits((float)value) >> CURVE_SHIFT];
    low += low < c->points && c->value[low] <= value; /* points up to the value: its own bin has one at most */
    low -= low > 0;
    if (value <= c->value[0])
        return c->code[0] * det_pow_d(value / c->value[0], TOE);
    if (low + 1 == c->points)
        return c->code[low];
    return c->code[low] + (c->code[low + 1] - c->code[low]) * (value - c->value[low]) / (c->value[low + 1] - c->value[low]);
}

struct deviations {
    struct grain *out;
    const struct shown_curve *curve;
    double *means[4]; /* of a line's channels: of both groups, and of their codes */
    double both, squares;
};

static void deviate_line(struct deviations *d, const struct gathered *g, uint32_t y, const float *const codes[3])
{
    float *out = d->out->codes + (size_t)y * g->width;

    for (size_t x = 0, i = 0; x < g->width; x++) {
        double most = 0;
        for (size_t c = 0; c < 3; c++, i++) {
            double mean = (d->means[0][i] + d->means[1][i]) / 2;
            double first = (double)codes[0][i] - d->means[2][i], second = (double)codes[1][i] - d->means[3][i];
            double off = fabs((double)codes[2][i] - code_of(d->curve, mean));
            most = off > most ? off : most;
            d->both += first * second;
            d->squares += (first + second) * (first + second) / 4;
        }
        out[x] = (float)most;
    }
}

static void deviate(void *user, struct gathered *g, const struct strip *s, const float *const groups[2],
                    float *const codes[3])
{
    struct deviations *d = user;

    for (uint32_t y = s->y; y < s->y + s->height; y++) {
        const size_t at = (size_t)(y - s->first) * g->width * 3;
        const float *const own[3] = {codes[0] + at, codes[1] + at, codes[2] + at};
        for (int i = 0; i < 2; i++) {
            means_of_line(groups[i], 3, g, s->first, y, d->means[i]);
            means_of_line(codes[i], 3, g, s->first, y, d->means[2 + i]);
        }
        deviate_line(d, g, y, own);
    }
}

status grain_make(struct grain *out, struct gathered *g, struct error *err)
{
    struct shown_curve *curve = mem_calloc(1, sizeof *curve);
    const size_t line = (size_t)g->width * 3;
    double *means = mem_alloc_array(line, 4 * sizeof *means);
    struct deviations d = {.out = out, .curve = curve};
    status s = STATUS_OK;

    *out = (struct grain){.codes = mem_alloc_array(g->pixels, sizeof(float))};
    if (!curve || !means || !out->codes)
        s = error_no_memory(err, "a picture's grain");
    THEN(s, gathered_walk(g, CODES_OF_MEAN, learn, curve, err));
    if (s == STATUS_OK) {
        means_of_bins(curve);
        for (size_t i = 0; i < 4; i++)
            d.means[i] = means + i * line;
        s = gathered_walk(g, CODES_OF_ALL, deviate, &d, err);
    }
    mem_free(means);
    mem_free(curve);
    out->noise = d.squares > 0 ? 1 - d.both / d.squares : 0;
    out->noise = out->noise < 0 ? 0 : out->noise > 1 ? 1 : out->noise;
    return s;
}

void grain_release(struct grain *grain)
{
    mem_free(grain->codes);
    *grain = (struct grain){0};
}
