/* Contrast processing in the gradient domain, of Mantiuk, Myszkowski and Seidel 2006. Where the paper leaves a choice
 * open, this follows their own implementation.
 *
 *   log10 Y -> differences G to neighbours at all scales (gradient_field)
 *           -> W = 10^(detail |G|) - 1 -> response R, in just noticeable steps
 *           -> R' = contrast R, or its rank among all responses -> G'
 *           -> the plane whose differences come nearest to G', each weighed by 1 / threshold(G')
 *           -> its 0.1 % and 99.9 % percentiles to 10^-2.3 and 1, times the exposure
 *
 * The response counts discrimination thresholds (section 3.2): R(0) = 0, R(0.01) = 1, and from there each step is one
 * threshold wide, dW(W) = 0.0928 W^1.08 + 0.0046 W^-0.18 after Whittle 1986, with straight lines between. The
 * recurrence gives the 107 numbers that the implementations tabulate up to W = 10510, and continues above it.
 *
 * When equalizing, a pixel's responses to its right and lower neighbour keep their ratio. The length of the two becomes
 * the share of all pixels of all levels that have a shorter one.
 *
 * Differences: black pixels (which would be minus infinity) are 10^-8 of the log-mean, and bright ones end at 10^8 of
 * it, where the implementations take 10^-7 of the maximum and so lose the picture to a firefly; percentiles are only of
 * pixels with light; strips have levels with sides below 3 pixels; a picture without any contrast becomes grey. When
 * equalizing, a difference of 0 stays 0, where pfstools divides 0 by 0 in the last corner of each level and gets a full
 * response there.
 *
 * A frame's state is the two percentiles, taken from a solution for a small copy. The picture's own percentiles are
 * moved by as much as a mean over frames moves the state: a single frame is exact, and in a sequence the brightness is
 * smoothed.
 */
#include <math.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/system/parallel.h"
#include "common/base/safeguard.h"
#include "common/math/elementary.h"
#include "common/math/quick.h"
#include "common/tonemap/gradient_field.h"
#include "common/tonemap/operators.h"

enum { CONTRAST, SATURATION, DETAIL, MODE };
enum mode { MODE_MAPPING, MODE_EQUALIZE };
enum { STATE_LOW, STATE_HIGH, STATE_COUNT };

static const char *const mode_names[] = {"mapping", "equalize", NULL};

static const struct tonemap_parameter parameters[] = {
    [CONTRAST] = {"contrast", 0.001, 4.0, 0.1,
                  "multiplies the response to contrasts; less is sharper, as the picture always "
                  "fills the display's range", TONEMAP_NUMBER, NULL},
    [SATURATION] = {"saturation", 0.0, 2.0, 0.8, "power of the colours' ratios to luminance",
                    TONEMAP_NUMBER, NULL},
    [DETAIL] = {"detail", 0.01, 100.0, 0.8,
                "multiplies contrasts before the response and divides them after it: more keeps "
                "more of the faint ones beside the strong; 1 is the paper's", TONEMAP_NUMBER, NULL},
    [MODE] = {"mode", 0, 1, MODE_MAPPING,
              "mapping: contrasts become smaller; equalize: each becomes its rank among all",
              TONEMAP_CHOICE, mode_names},
};

static const double LN_10 = 2.302585092994045684, LOG10_2 = 0.30102999566398119521;
static const double DISPLAY_RANGE = 2.3; /* decades between the percentiles */
static const double PERCENT = 0.1;       /* cut off at either end */
static const double RANGE_MIN = 1e-4;    /* decades: less is noise of the arithmetic */
static const double DECADES_MAX = 8.0;   /* from the log-mean, either way */
static const double TOLERANCE = 1e-3;
enum { STEPS_MAX = 200, SMALL_SIDE = 192, LINES = 32 };

/* ---- functions that are sampled ------------------------------------------------------------- */

/* A function of x >= 0, linear between samples that lie 1/128 octave apart. Below the first and
 * above the last octave it is constant. */
enum { OCTAVE_FIRST = -14, OCTAVES = 24, SAMPLES_PER_OCTAVE = 128,
       SAMPLES = OCTAVES * SAMPLES_PER_OCTAVE + 1, SAMPLE_SHIFT = 16 };

struct sampled {
    float samples[SAMPLES + 1];
};

static double sample_place(int i)
{
    int octave = i / SAMPLES_PER_OCTAVE, part = i % SAMPLES_PER_OCTAVE;

    return ldexp(1.0 + (double)part / SAMPLES_PER_OCTAVE, octave + OCTAVE_FIRST);
}

static inline float sampled_at(const struct sampled *s, float x)
{
    const uint32_t first = (uint32_t)(127 + OCTAVE_FIRST) << 23;
    const uint32_t last = first + ((uint32_t)(SAMPLES - 1) << SAMPLE_SHIFT);
    uint32_t bits = float_bits(x);
    float part;

    bits = bits > first ? (bits < last ? bits : last) - first : 0;
    part = (float)(bits & 0xffff) * 0x1p-16f;
    bits >>= SAMPLE_SHIFT;
    return s->samples[bits] + part * (s->samples[bits + 1] - s->samples[bits]);
}

/* ---- the transducer ------------------------------------------------------------------------- */

enum { NODES_MAX = 256, FULL_RESPONSE = 106 }; /* the response at the end of the paper's table */

struct transducer {
    double contrast[NODES_MAX]; /* W at which the response is 0, 1, 2 ... */
    int count;
    double detail;
};

static const double CONTRAST_MAX = 1e30;

static void transducer_init(struct transducer *t, double detail)
{
    double w = 0.01;

    t->contrast[0] = 0.0;
    t->count = 1;
    while (t->count < NODES_MAX && w < CONTRAST_MAX) {
        t->contrast[t->count++] = w;
        w += 0.0928 * det_pow_d(w, 1.08) + 0.0046 * det_pow_d(w, -0.18);
    }
    t->detail = detail;
}

/* The response to a difference of log10 luminance, g >= 0. */
static double response(const struct transducer *t, double g)
{
    double exponent = fmin(t->detail * g * LN_10, 69.0), w;
    int low = 0, high = t->count - 1;

    /* 10^x - 1 without cancellation. */
    w = exponent < 1e-5 ? exponent * (1.0 + 0.5 * exponent) : det_exp_d(exponent) - 1.0;
    w = fmin(w, t->contrast[high]);
    while (high - low > 1) {
        int middle = (low + high) / 2;
        if (t->contrast[middle] <= w)
            low = middle;
        else
            high = middle;
    }
    return low + (w - t->contrast[low]) / (t->contrast[high] - t->contrast[low]);
}

static double difference_of(const struct transducer *t, double r)
{
    int low = (int)fmin(floor(r), t->count - 2);
    double part = fmin(r - low, 1.0);
    double w = t->contrast[low] + part * (t->contrast[low + 1] - t->contrast[low]);
    double ln = w < 1e-5 ? w * (1.0 - 0.5 * w) : det_log_d(1.0 + w);

    return ln / (t->detail * LN_10);
}

/* The weight of a wanted difference: one over the threshold of seeing it change, simplified. */
static double weight_of(double g) { return det_pow_d(fmax(g, 0.001), -0.537756) / 0.038737; }

/* ---- what becomes of differences ------------------------------------------------------------ */

struct mapping {
    struct sampled factor, weight; /* of |G| */
};

static void mapping_init(struct mapping *m, const struct transducer *t, double contrast)
{
    for (int i = 0; i < SAMPLES; i++) {
        double g = sample_place(i);
        double wanted = contrast == 1.0 ? g : difference_of(t, contrast * response(t, g));

        m->factor.samples[i] = (float)(wanted / g);
        m->weight.samples[i] = (float)weight_of(wanted);
    }
    m->factor.samples[SAMPLES] = m->factor.samples[SAMPLES - 1];
    m->weight.samples[SAMPLES] = m->weight.samples[SAMPLES - 1];
}

static void map_differences(const void *user, struct gradient_run *run)
{
    const struct mapping *m = user;

    for (size_t i = 0; i < run->count; i++) {
        float x = fabsf(run->x[i]), y = fabsf(run->y[i]);

        run->weight_x[i] = sampled_at(&m->weight, x);
        run->weight_y[i] = sampled_at(&m->weight, y);
        run->x[i] *= sampled_at(&m->factor, x);
        run->y[i] *= sampled_at(&m->factor, y);
    }
}

/* Equalisation: the length of a pixel's response becomes its rank, 0..1, times `contrast`. Counted
 * by the upper half of the bits, linear within. */
enum { RANKS = 1 << 15 };
static const float ROUNDING = 0x1p-16f; /* decades: a 280th of the smallest visible difference */

struct equalizing {
    struct sampled response;           /* R / |G|, of |G| */
    struct sampled difference, weight; /* |G| / R and its weight, of R */
    float contrast;
    float *ranks;              /* [RANKS + 1] */
    uint64_t (*counts)[RANKS]; /* [GRADIENT_STRIPES] */
};

/* Without any contrast before there must be none after. The last digits of a level's means differ,
 * and a difference, however small, would get the rank of all that are equally level. */
static float response_to(const struct equalizing *e, float difference)
{
    float size = fabsf(difference);

    return size > ROUNDING ? difference * sampled_at(&e->response, size) : 0.0f;
}

static float response_length(const struct equalizing *e, const struct gradient_run *run, size_t i, float *x, float *y)
{
    *x = response_to(e, run->x[i]);
    *y = response_to(e, run->y[i]);
    return sqrtf(*x * *x + *y * *y);
}

static void count_responses(void *user, size_t stripe, const struct gradient_run *run)
{
    const struct equalizing *e = user;
    float x, y;

    for (size_t i = 0; i < run->count; i++)
        e->counts[stripe][float_bits(response_length(e, run, i, &x, &y)) >> 16]++;
}

static void equalize_differences(const void *user, struct gradient_run *run)
{
    const struct equalizing *e = user;

    for (size_t i = 0; i < run->count; i++) {
        float x, y, length = response_length(e, run, i, &x, &y), rank, scale;
        uint32_t bits = float_bits(length), at = bits >> 16;

        rank = e->ranks[at] + (float)(bits & 0xffff) * 0x1p-16f * (e->ranks[at + 1] - e->ranks[at]);
        scale = length > 0.0f ? e->contrast * rank / length : 0.0f;
        x *= scale;
        y *= scale;
        run->weight_x[i] = sampled_at(&e->weight, fabsf(x));
        run->weight_y[i] = sampled_at(&e->weight, fabsf(y));
        run->x[i] = x * sampled_at(&e->difference, fabsf(x));
        run->y[i] = y * sampled_at(&e->difference, fabsf(y));
    }
}

static void rank_responses(struct equalizing *e)
{
    uint64_t total = 0, below = 0;

    for (int s = 0; s < GRADIENT_STRIPES; s++)
        for (int i = 0; i < RANKS; i++)
            total += e->counts[s][i];
    for (int i = 0; i < RANKS; i++) {
        e->ranks[i] = (float)((double)below / (double)total);
        for (int s = 0; s < GRADIENT_STRIPES; s++)
            below += e->counts[s][i];
    }
    e->ranks[RANKS] = 1.0f;
}

static status want_equalized(struct gradient_field *field, const float *plane, const struct transducer *t,
                             double contrast, struct error *err)
{
    struct equalizing e = {.contrast = (float)(contrast * FULL_RESPONSE)};
    status st = STATUS_OK;

    for (int i = 0; i < SAMPLES; i++) {
        double x = sample_place(i), g = difference_of(t, x);

        e.response.samples[i] = (float)(response(t, x) / x);
        e.difference.samples[i] = (float)(g / x);
        e.weight.samples[i] = (float)weight_of(g);
    }
    e.response.samples[SAMPLES] = e.response.samples[SAMPLES - 1];
    e.difference.samples[SAMPLES] = e.difference.samples[SAMPLES - 1];
    e.weight.samples[SAMPLES] = e.weight.samples[SAMPLES - 1];
    e.ranks = mem_alloc_array(RANKS + 1, sizeof *e.ranks);
    e.counts = mem_calloc(GRADIENT_STRIPES, sizeof *e.counts);
    if (e.ranks && e.counts) {
        gradient_field_visit(field, plane, count_responses, &e);
        rank_responses(&e);
        gradient_field_want(field, plane, equalize_differences, &e);
    } else
        st = error_no_memory(err, "contrast equalization");
    mem_free(e.counts);
    mem_free(e.ranks);
    return st;
}

/* The plane (log10 luminance) after contrast processing, up to a constant. */
static status process(float *plane, uint32_t width, uint32_t height, const double *values, unsigned threads,
                      struct error *err)
{
    struct gradient_field field;
    struct transducer t;
    struct mapping m;
    status st = gradient_field_init(&field, width, height, threads, err);

    if (st != STATUS_OK)
        return st;
    transducer_init(&t, values[DETAIL]);
    if ((int)values[MODE] == MODE_EQUALIZE)
        st = want_equalized(&field, plane, &t, values[CONTRAST], err);
    else {
        mapping_init(&m, &t, values[CONTRAST]);
        gradient_field_want(&field, plane, map_differences, &m);
    }
    if (st == STATUS_OK)
        gradient_field_solve(&field, plane, TOLERANCE, STEPS_MAX);
    gradient_field_release(&field);
    return st;
}

/* ---- luminance ------------------------------------------------------------------------------ */

struct logging {
    const struct tonemap_frame *frame;
    uint32_t width, height; /* of the plane, not larger than the picture */
    float *plane;
    uint8_t *lit; /* whether there is any light */
    struct quick quick;
};

static double mean_luminance(const struct image *image, size_t x, size_t y, size_t x_end, size_t y_end)
{
    double sum = 0.0;

    for (size_t row = y; row < y_end; row++)
        for (size_t i = x; i < x_end; i++)
            sum += tonemap_luminance(image->pixels + (row * image->width + i) * 3);
    return sum / (double)((x_end - x) * (y_end - y));
}

static void log_lines(void *user, size_t begin, size_t end)
{
    const struct logging *l = user;
    const struct image *image = l->frame->image;
    double inverse_mean = 1.0 / (l->frame->statistics.log_mean * l->frame->gain);
    double min = det_exp_d(-DECADES_MAX * LN_10), max = det_exp_d(DECADES_MAX * LN_10);

    for (size_t y = begin; y < end; y++)
        for (size_t x = 0; x < l->width; x++) {
            double value = mean_luminance(image, x * image->width / l->width, y * image->height / l->height,
                                          (x + 1) * image->width / l->width, (y + 1) * image->height / l->height);

            l->lit[y * l->width + x] = value > 0.0;
            value *= inverse_mean;
            value = value > min ? value : min;
            value = value < max ? value : max;
            l->plane[y * l->width + x] = (float)(LOG10_2 * quick_log2(&l->quick, value));
        }
}

/* ---- percentiles ---------------------------------------------------------------------------- */

/* Floats' bits, so that greater floats have greater numbers. */
static uint32_t ordered_bits(float x)
{
    uint32_t bits = float_bits(x);

    return bits >> 31 ? ~bits : bits | 0x80000000u;
}

enum { HALF_VALUES = 1 << 16 };

/* The value with `rank` smaller ones among those that count; `counts` is scratch memory. */
static float ranked(const float *plane, const uint8_t *lit, size_t count, uint64_t rank, uint64_t *counts)
{
    uint32_t upper = 0, bits = 0;

    for (int half = 0; half < 2; half++) {
        memset(counts, 0, HALF_VALUES * sizeof *counts);
        for (size_t i = 0; i < count; i++) {
            uint32_t value = ordered_bits(plane[i]);
            if (lit[i] && (half == 0 || value >> 16 == upper))
                counts[half == 0 ? value >> 16 : value & 0xffff]++;
        }
        for (bits = 0; bits + 1 < HALF_VALUES && rank >= counts[bits]; bits++)
            rank -= counts[bits];
        upper = half == 0 ? bits : upper;
    }
    bits |= upper << 16;
    return float_from_bits(bits >> 31 ? bits & 0x7fffffffu : ~bits);
}

/* A processed plane, and the values that define the display's range. */
struct processed {
    float *plane;
    double low, high;
};

static status percentiles(struct processed *p, const struct logging *l, struct error *err)
{
    size_t count = (size_t)l->width * l->height, lit = 0;
    uint64_t *counts = mem_alloc_array(HALF_VALUES, sizeof *counts), rank;

    NEED(counts, err, "a histogram");
    for (size_t i = 0; i < count; i++)
        lit += l->lit[i];
    rank = lit > 0 ? (uint64_t)(PERCENT / 100.0 * (double)(lit - 1) + 0.5) : 0;
    p->low = (double)ranked(l->plane, l->lit, count, rank, counts);
    p->high = (double)ranked(l->plane, l->lit, count, lit - (lit > 0) - rank, counts);
    mem_free(counts);
    return STATUS_OK;
}

/* The frame, reduced to `width` by `height`. On success the caller owns the plane. */
static status process_frame(struct processed *out, const struct tonemap_frame *frame, uint32_t width, uint32_t height,
                            struct error *err)
{
    struct logging l = {.frame = frame, .width = width, .height = height};
    size_t count = (size_t)width * height;
    status st = STATUS_OK;

    memset(out, 0, sizeof *out);
    l.plane = mem_alloc_array(count, sizeof *l.plane);
    l.lit = mem_alloc_array(count, sizeof *l.lit);
    quick_init(&l.quick);
    if (!l.plane || !l.lit)
        st = error_no_memory(err, "a picture's luminance");
    if (st == STATUS_OK) {
        parallel_for(frame->threads, height, LINES, log_lines, &l);
        st = process(l.plane, width, height, frame->values, frame->threads, err);
    }
    THEN(st, percentiles(out, &l, err));
    mem_free(l.lit);
    if (st == STATUS_OK)
        out->plane = l.plane;
    else
        mem_free(l.plane);
    return st;
}

/* Percentiles about the mean of the plane, of a small copy. */
static status mantiuk_measure(const struct tonemap_frame *frame, double *state, struct error *err)
{
    uint32_t width = frame->image->width, height = frame->image->height;
    uint32_t side = width > height ? width : height, shrink = 1 + (side - 1) / SMALL_SIDE;
    struct processed p;
    double mean = 0.0;

    width = 1 + (width - 1) / shrink;
    height = 1 + (height - 1) / shrink;
    TRY(process_frame(&p, frame, width, height, err));
    for (size_t i = 0; i < (size_t)width * height; i++)
        mean += (double)p.plane[i];
    mean /= (double)((size_t)width * height);
    state[STATE_LOW] = p.low - mean;
    state[STATE_HIGH] = p.high - mean;
    mem_free(p.plane);
    return STATUS_OK;
}

/* ---- colours -------------------------------------------------------------------------------- */

struct colouring {
    const struct tonemap_frame *frame;
    const float *plane;
    double scale, middle, level; /* log2 of display light: scale (plane - middle) + level */
    double saturation;
    struct quick quick;
};

/* `ratio` of a channel to luminance. Saturation 0 leaves no colour, not even of a channel that is
 * 0. Values above white become white. */
static float coloured(const struct colouring *c, double level, double ratio)
{
    if (!(ratio > 0.0) && c->saturation > 0.0)
        return 0.0f;
    if (c->saturation > 0.0)
        level += c->saturation * quick_log2(&c->quick, ratio);
    return (float)quick_exp2(&c->quick, level < 1.0 ? level : 1.0);
}

static void colour_lines(void *user, size_t begin, size_t end)
{
    const struct colouring *c = user;
    size_t width = c->frame->image->width;

    for (size_t i = begin * width; i < end * width; i++) {
        float *p = c->frame->image->pixels + 3 * i;
        double luminance = tonemap_luminance(p), level, inverse;

        if (!(luminance > 0.0)) {
            p[0] = p[1] = p[2] = 0.0f;
            continue;
        }
        level = ((double)c->plane[i] - c->middle) * c->scale + c->level;
        inverse = 1.0 / luminance;
        for (int k = 0; k < 3; k++)
            p[k] = coloured(c, level, (double)p[k] * inverse);
    }
}

static status mantiuk_apply(const struct tonemap_frame *frame, const double *state, struct error *err)
{
    struct colouring c = {.frame = frame, .saturation = frame->values[SATURATION]};
    double own[STATE_COUNT], range;
    struct processed p;
    status st;

    if (!state)
        return STATUS_OK; /* black */
    st = mantiuk_measure(frame, own, err);
    THEN(st, process_frame(&p, frame, frame->image->width, frame->image->height, err));
    if (st != STATUS_OK)
        return st;
    p.low += state[STATE_LOW] - own[STATE_LOW];
    p.high += state[STATE_HIGH] - own[STATE_HIGH];
    range = SAFEGUARD(MANTIUK06_RANGE) ? fmax(p.high - p.low, RANGE_MIN) : p.high - p.low;
    c.plane = p.plane;
    c.middle = 0.5 * (p.low + p.high);
    c.scale = DISPLAY_RANGE / LOG10_2 / range;
    c.level = (det_log_d(frame->gain) / LN_10 - 0.5 * DISPLAY_RANGE) / LOG10_2;
    quick_init(&c.quick);
    parallel_for(frame->threads, frame->image->height, LINES, colour_lines, &c);
    mem_free(p.plane);
    return STATUS_OK;
}

const struct tonemap_operator tonemap_mantiuk06 = {
    .name = "mantiuk06",
    .summary = "Contrast mapping in the gradient domain, local: much detail, little depth.",
    .source = "R. Mantiuk, K. Myszkowski, H.-P. Seidel, \"A Perceptual Framework for Contrast "
              "Processing of High Dynamic Range Images\", ACM Transactions on Applied Perception "
              "3(3), 2006",
    .parameters = parameters,
    .parameter_count = sizeof parameters / sizeof *parameters,
    .measured = 1,
    .is_local = tonemap_always_local,
    .state_count = STATE_COUNT,
    .measure = mantiuk_measure,
    .apply = mantiuk_apply,
};
