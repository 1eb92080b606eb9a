/* The stages of a picture: white balance and exposure, an operator, codes. */
#include "common/tonemap/tonemap.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/system/parallel.h"
#include "common/base/safeguard.h"
#include "common/image/color.h"
#include "common/math/elementary.h"
#include "common/math/lanes.h"
#include "common/tonemap/operators.h"
#include "common/tonemap/statistics.h"

enum {
    GRAIN = 8,           /* lines in a piece of a loop */
    ALONE_MAX = 1 << 16, /* pixels up to which other threads take longer to begin than one to end */
};

static const double KEY = 0.18;

/* ---- white balance and exposure ------------------------------------------------------------- */

/* 2^ev, exact for whole stops. */
static double stops_to_gain(double ev)
{
    double whole = floor(ev);

    return ldexp(ev == whole ? 1.0 : det_pow_d(2.0, ev - whole), (int)whole);
}

static void balance_of(const struct tonemap_settings *s, double matrix[3][3])
{
    if (s->white_kelvin > 0.0)
        tonemap_white_balance(s->white_kelvin, matrix);
    else
        for (int i = 0; i < 9; i++)
            matrix[i / 3][i % 3] = i % 4 == 0;
}

struct exposing {
    const struct image *in;
    struct image *out;
    double matrix[3][3];
};

static inline float limited(double value)
{
    if (!SAFEGUARD(LIGHT_FINITE))
        return (float)value;
    value = value > 0.0 ? value : 0.0; /* NaN too */
    return (float)(value < (double)FLT_MAX ? value : (double)FLT_MAX);
}

/* `count` values, at most 4. */
static inline void expose_four(float *to, const float *from, size_t count, double gain)
{
    lanes light = {0};

    memcpy(&light, from, count * sizeof *from);
    light = lanes_smaller(lanes_larger(light, lanes_of(0)), lanes_of(FLT_MAX)); /* NaN is 0 */
    light = lanes_smaller(lanes_times(light, gain), lanes_of(FLT_MAX));
    memcpy(to, &light, count * sizeof *to);
}

/* Lines of `in` times the matrix: finite and not negative. */
static void expose_lines(void *user, size_t begin, size_t end)
{
    const struct exposing *e = user;
    const double(*m)[3] = (const double(*)[3])e->matrix;
    size_t first = begin * e->in->width * 3, last = end * e->in->width * 3;
    const float *from = e->in->pixels;
    float *to = e->out->pixels;
    int plain =
        m[0][1] == 0.0 && m[0][2] == 0.0 && m[1][0] == 0.0 && m[1][2] == 0.0 && m[2][0] == 0.0 && m[2][1] == 0.0;

    /* The usual case, for vector units: the gain is above 0. */
    if (plain && m[0][0] == m[1][1] && m[0][0] == m[2][2] && SAFEGUARD(LIGHT_FINITE)) {
        for (; first + 4 <= last; first += 4)
            expose_four(to + first, from + first, 4, m[0][0]);
        expose_four(to + first, from + first, last - first, m[0][0]);
        return;
    }
    for (size_t i = first; i < last; i += 3) {
        double rgb[3];

        for (int c = 0; c < 3; c++)
            rgb[c] = (double)limited((double)from[i + (size_t)c]);
        for (size_t c = 0; c < 3; c++)
            to[i + c] =
                plain ? limited(rgb[c] * m[c][c]) : limited(m[c][0] * rgb[0] + m[c][1] * rgb[1] + m[c][2] * rgb[2]);
    }
}

/* ---- measuring ------------------------------------------------------------------------------ */

/* Stops that the metering adds. */
static status meter(double *ev, const struct tonemap_settings *s, const struct image *in, const double balance[3][3],
                    const struct tonemap_statistics *raw, unsigned threads, struct error *err)
{
    double level = raw->log_mean, target = KEY;
    status st = STATUS_OK;

    *ev = 0.0;
    if (s->metering == TONEMAP_METERING_OFF || raw->counted == 0)
        return STATUS_OK;
    if (s->metering == TONEMAP_METERING_PERCENTILE) {
        st = statistics_percentile(&level, in, balance, s->metering_percentile, threads, err);
        target = 1.0;
    }
    if (st == STATUS_OK && level > 0.0)
        *ev = det_log_d(target / level) / det_log_d(2.0);
    return st;
}

/* A picture in progress. */
struct work {
    const struct tonemap_settings *settings;
    const struct tonemap_context *context;
    const struct image *in;
    struct image *out;
    struct tonemap_frame frame;
    void *file, *prepared;
};

/* White balance and exposure in one matrix, from the state. */
static void exposure_of(double matrix[3][3], const struct tonemap_settings *s, const struct tonemap_state *state)
{
    double all = stops_to_gain(s->exposure_ev) * (state->metered_ev == 0.0 ? 1.0 : stops_to_gain(state->metered_ev));

    balance_of(s, matrix);
    for (int i = 0; i < 9; i++)
        matrix[i / 3][i % 3] *= all;
}

/* The frame's statistics of `pixels` pixels, from the state. */
static void frame_take_state(struct tonemap_frame *frame, const struct tonemap_settings *s,
                             const struct tonemap_state *state, size_t pixels)
{
    frame->gain = stops_to_gain(s->exposure_ev);
    frame->statistics = (struct tonemap_statistics){.log_mean = 1.0};
    if (!state->counts)
        return;
    frame->statistics.log_mean = det_exp_d(state->ln_log_mean);
    frame->statistics.max = det_exp_d(state->ln_max) * frame->gain;
    frame->statistics.min = det_exp_d(state->ln_min) * frame->gain;
    frame->statistics.counted = pixels;
}

/* The frame's exposed pixels and statistics, from the state. */
static void expose(struct work *w, const struct tonemap_state *state)
{
    struct exposing e = {.in = w->in, .out = w->out};

    exposure_of(e.matrix, w->settings, state);
    parallel_for(w->frame.threads, w->in->height, GRAIN, expose_lines, &e);
    frame_take_state(&w->frame, w->settings, state, (size_t)w->in->width * w->in->height);
}

static status measure_raw(struct work *w, struct tonemap_state *state, struct error *err)
{
    struct tonemap_statistics raw;
    double matrix[3][3], ln_gain;
    status st;

    balance_of(w->settings, matrix);
    st = statistics_measure(&raw, w->in, (const double(*)[3])matrix, w->context->apart, w->frame.threads, err);
    THEN(st, meter(&state->metered_ev, w->settings, w->in, (const double(*)[3])matrix, &raw, w->frame.threads, err));
    if (st != STATUS_OK || raw.counted == 0)
        return st;
    ln_gain = state->metered_ev * det_log_d(2.0);
    state->counts = 1;
    state->ln_log_mean = det_log_d(raw.log_mean) + ln_gain;
    state->ln_max = det_log_d(raw.max) + ln_gain;
    state->ln_min = det_log_d(raw.min) + ln_gain;
    return STATUS_OK;
}

/* Leaves the picture exposed in w->out. */
static status measure(struct work *w, struct tonemap_state *state, struct error *err)
{
    const struct tonemap_operator *op = w->settings->op;
    status st;

    memset(state, 0, sizeof *state);
    st = measure_raw(w, state, err);
    if (st != STATUS_OK)
        return st;
    expose(w, state);
    if (state->counts && op->state_count > 0)
        st = op->measure(&w->frame, state->values, err);
    return st;
}

static unsigned threads_for(const struct image *in, const struct tonemap_context *context)
{
    if (context->threads > 0)
        return context->threads;
    return (size_t)in->width * in->height <= ALONE_MAX ? 1 : parallel_processors();
}

static status work_begin(struct work *w, struct image *out, const struct image *in, const struct tonemap_settings *s,
                         const struct tonemap_context *context, struct error *err)
{
    static const struct tonemap_context nothing;
    status st;

    memset(w, 0, sizeof *w);
    memset(out, 0, sizeof *out);
    w->settings = s;
    w->context = context ? context : &nothing;
    w->in = in;
    w->out = out;
    if (in->channels != 3)
        return error_set(err, STATUS_ERR_INTERNAL, "tone mapping needs 3 channels, not %u", (unsigned)in->channels);
    st = tonemap_settings_validate(s, err);
    if (st == STATUS_OK && s->op->file_load && w->context->file_data)
        st = s->op->file_load(&w->file, w->context->file_data, w->context->file_size, s->file_name, err);
    else if (st == STATUS_OK && s->has_file)
        st = error_set(err, STATUS_ERR_INTERNAL, "%s's file %s is not at hand", s->op->name, s->file_name);
    THEN(st, image_init(out, in->width, in->height, 3, err));
    w->frame = (struct tonemap_frame){
        .image = out, .values = s->values, .file = w->file, .gain = 1.0,
        .threads = threads_for(in, w->context),
    };
    return st;
}

static void work_end(struct work *w, status st)
{
    if (w->prepared)
        w->settings->op->prepared_free(w->prepared);
    if (w->file)
        w->settings->op->file_free(w->file);
    if (st != STATUS_OK)
        image_release(w->out);
}

status tonemap_measure(struct tonemap_state *out, const struct image *in, const struct tonemap_settings *s,
                       const struct tonemap_context *context, struct error *err)
{
    struct image exposed;
    struct work w;
    status st = work_begin(&w, &exposed, in, s, context, err);

    THEN(st, measure(&w, out, err));
    work_end(&w, st);
    image_release(&exposed);
    return st;
}

void tonemap_state_mean(struct tonemap_state *out, const struct tonemap_state *const *states, size_t count,
                        const struct tonemap_settings *s)
{
    size_t counted = 0;

    memset(out, 0, sizeof *out);
    for (size_t i = 0; i < count; i++) {
        const struct tonemap_state *state = states[i];

        if (!state->counts)
            continue;
        counted++;
        out->metered_ev += state->metered_ev;
        out->ln_log_mean += state->ln_log_mean;
        out->ln_max += state->ln_max;
        out->ln_min += state->ln_min;
        for (size_t k = 0; k < s->op->state_count; k++)
            out->values[k] += state->values[k];
    }
    if (counted == 0)
        return;
    out->counts = 1;
    out->metered_ev /= (double)counted;
    out->ln_log_mean /= (double)counted;
    out->ln_max /= (double)counted;
    out->ln_min /= (double)counted;
    for (size_t k = 0; k < s->op->state_count; k++)
        out->values[k] /= (double)counted;
}

/* ---- the whole way -------------------------------------------------------------------------- */

struct finishing {
    int encode, decode; /* apply the sRGB curve, or undo it */
};

/* What an operator left of 0..1; NaN is 0. */
static float in_range(float value)
{
    if (!SAFEGUARD(DISPLAY_RANGE))
        return value;
    value = value > 0.0f ? value : 0.0f;
    return value < 1.0f ? value : 1.0f;
}

/* Whatever the operator left: within 0..1, never NaN, and encoded exactly once. */
static void finish_row(const void *user, float *rgb, uint32_t width)
{
    const struct finishing *f = user;

    if (f->encode) {
        srgb_encode_row(rgb, (size_t)width * 3); /* all of that */
        return;
    }
    for (size_t i = 0; i < (size_t)width * 3; i++) {
        float value = in_range(rgb[i]);

        rgb[i] = f->decode ? srgb_decode(value) : value;
    }
}

/* The part of the state that the operator sees. */
static const double *values_of(const struct tonemap_operator *op, const struct tonemap_state *state)
{
    return state->counts && op->state_count ? state->values : NULL;
}

static status prepare(struct work *w, const struct tonemap_state *state, struct error *err)
{
    const struct tonemap_operator *op = w->settings->op;
    status st = op->prepare ? op->prepare(&w->prepared, &w->frame, values_of(op, state), err) : STATUS_OK;

    w->frame.prepared = w->prepared;
    return st;
}

status tonemap_apply(struct image *out, const struct image *in, const struct tonemap_settings *s,
                     const struct tonemap_context *context, struct error *err)
{
    struct finishing finish;
    struct tonemap_state own = {0};
    const struct tonemap_state *state;
    struct work w;
    status st = work_begin(&w, out, in, s, context, err);

    state = w.context->state ? w.context->state : &own;
    if (st == STATUS_OK && state == &own)
        st = measure(&w, &own, err);
    else if (st == STATUS_OK)
        expose(&w, state);
    THEN(st, prepare(&w, state, err));
    THEN(st, s->op->apply(&w.frame, values_of(s->op, state), err));
    if (st == STATUS_OK) {
        finish.encode = !s->op->display_encoded && !w.context->linear;
        finish.decode = s->op->display_encoded && w.context->linear;
        tonemap_each_row(&w.frame, finish_row, &finish);
    }
    work_end(&w, st);
    return st;
}

/* ---- pixels without their picture ------------------------------------------------------------ */

enum tonemap_reach tonemap_reach(const struct tonemap_settings *s)
{
    if (s->op->is_local && s->op->is_local(s->values))
        return TONEMAP_REACH_PICTURE;
    return s->op->measured || s->metering != TONEMAP_METERING_OFF ? TONEMAP_REACH_STATE : TONEMAP_REACH_PIXEL;
}

void tonemap_stand_in(struct tonemap_settings *out, const struct tonemap_settings *s)
{
    *out = *s;
    out->temporal = 0;
    if (tonemap_reach(s) != TONEMAP_REACH_PICTURE)
        return;
    /* The global form of an operator that has both, otherwise the global operator that adapts alike. */
    if (s->op != &tonemap_reinhard02) {
        out->op = &tonemap_reinhard02;
        for (size_t i = 0; i < out->op->parameter_count; i++)
            out->values[i] = out->op->parameters[i].preset;
        out->has_file = 0;
    }
    if (tonemap_settings_set(out, "scale", 0.0, NULL) != STATUS_OK)
        out->op = &tonemap_linear; /* it has that parameter: see reinhard02.c */
}

struct tonemap_pixels {
    struct tonemap_settings settings;
    struct tonemap_state state;
    struct work work; /* file and tables */
    double matrix[3][3];
};

void tonemap_pixels_free(struct tonemap_pixels *pixels)
{
    struct image none = {0};

    if (!pixels)
        return;
    pixels->work.out = &none;
    work_end(&pixels->work, STATUS_OK);
    mem_free(pixels);
}

const struct tonemap_settings *tonemap_pixels_settings(const struct tonemap_pixels *pixels)
{
    return &pixels->settings;
}

/* Codes 0..1 of one line of pixels. */
static status show_line(const struct tonemap_pixels *p, const float *rgb, uint32_t count, float *codes,
                        struct error *err)
{
    struct image in = {count, 1, 3, (float *)rgb}, out = {count, 1, 3, codes};
    struct exposing e = {.in = &in, .out = &out};
    struct finishing finish = {.encode = !p->settings.op->display_encoded};
    struct tonemap_frame frame = p->work.frame;
    status st;

    memcpy(e.matrix, p->matrix, sizeof e.matrix);
    expose_lines(&e, 0, 1);
    frame.image = &out;
    st = p->settings.op->apply(&frame, values_of(p->settings.op, &p->state), err);
    finish_row(&finish, codes, count);
    return st;
}

status tonemap_pixels_new(struct tonemap_pixels **out, const struct tonemap_settings *s,
                          const struct tonemap_state *state, const struct tonemap_context *context, struct error *err)
{
    static const float black[3];
    struct tonemap_pixels *p;
    struct image in = {1, 1, 3, (float *)black}, line;
    float codes[3];
    status st;

    *out = NULL;
    if (tonemap_reach(s) == TONEMAP_REACH_PICTURE)
        return error_set(err, STATUS_ERR_INPUT, "%s needs the whole picture", s->op->name);
    p = mem_calloc(1, sizeof *p);
    NEED(p, err, "a tone mapping");
    p->settings = *s;
    if (tonemap_reach(s) == TONEMAP_REACH_STATE)
        p->state = *state;
    st = work_begin(&p->work, &line, &in, &p->settings, context, err);
    p->work.frame.threads = 1;
    exposure_of(p->matrix, s, &p->state);
    frame_take_state(&p->work.frame, s, &p->state, 1);
    THEN(st, prepare(&p->work, &p->state, err));
    if (st == STATUS_OK) /* fail now if at all: no later pixel needs more memory */
        st = show_line(p, black, 1, codes, err);
    image_release(&line);
    p->work.in = NULL;
    if (st != STATUS_OK)
        tonemap_pixels_free(p);
    else
        *out = p;
    return st;
}

void tonemap_pixels_codes(const struct tonemap_pixels *pixels, const float *rgb, uint32_t count, float *codes)
{
    (void)show_line(pixels, rgb, count, codes, NULL);
    for (size_t i = 0; i < (size_t)count * 3; i++)
        codes[i] *= 255.0f;
}
