#include "client/study/pair.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "client/terminal/must.h"
#include "common/base/memory.h"

enum { BOX_RADIUS = 1 /* pixels around one that choose its secant */ };

double student_t95(unsigned degrees)
{
    static const double t[] = {NAN,  12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228,
                               2.201, 2.179, 2.160, 2.145, 2.131, 2.120, 2.110, 2.101, 2.093, 2.086};

    return degrees < sizeof t / sizeof *t ? t[degrees] : 1.96 + 2.5 / degrees;
}

/* ---- how pictures are shown ----------------------------------------------------------------- */

static struct tonemap_context context_of(const struct buffer *file)
{
    struct tonemap_context context = {0};

    if (file && file->size) {
        context.file_data = file->data;
        context.file_size = file->size;
    }
    return context;
}

status shown_meter(struct shown *out, const struct image *picture, const struct tonemap_settings *settings,
                   const struct buffer *file, struct error *err)
{
    const struct tonemap_context context = context_of(file);

    out->settings = settings;
    out->file = file;
    return tonemap_measure(&out->state, picture, settings, &context, err);
}

status shown_codes(const struct shown *shown, struct image *out, const struct image *in, struct error *err)
{
    struct tonemap_context context = context_of(shown->file);
    status result;

    context.state = &shown->state;
    result = tonemap_apply(out, in, shown->settings, &context, err);
    for (size_t i = 0; result == STATUS_OK && i < (size_t)out->width * out->height * 3; i++)
        out->pixels[i] *= 255;
    return result;
}

status pair_mean(struct image *out, const struct image *a, const struct image *b, struct error *err)
{
    status result = image_init(out, a->width, a->height, 3, err);

    for (size_t i = 0; result == STATUS_OK && i < (size_t)a->width * a->height * 3; i++)
        out->pixels[i] = a->pixels[i] / 2 + b->pixels[i] / 2;
    return result;
}

/* ---- jackknife ------------------------------------------------------------------------------ */

/* A pixel's pseudo-random group, the same everywhere. */
static unsigned group_of(uint32_t x, uint32_t y)
{
    uint32_t h = x * 0x9e3779b1u ^ (y * 0x85ebca77u + 0x165667b1u);

    h = (h ^ h >> 15) * 0x2c1b3c6du;
    h = (h ^ h >> 12) * 0x297a2d39u;
    return (h ^ h >> 15) % PAIR_GROUPS;
}

/* A statistic of all pixels [PAIR_GROUPS], and of all but one group [0..PAIR_GROUPS). */
struct leave_out {
    double value[PAIR_GROUPS + 1];
};

static double leave_out_width(const struct leave_out *l)
{
    double mean = 0, square = 0;

    for (int g = 0; g < PAIR_GROUPS; g++)
        mean += l->value[g] / PAIR_GROUPS;
    for (int g = 0; g < PAIR_GROUPS; g++)
        square += (l->value[g] - mean) * (l->value[g] - mean);
    return student_t95(PAIR_GROUPS - 1) * sqrt(square * (PAIR_GROUPS - 1) / PAIR_GROUPS);
}

/* The interval of a square's root. A square that is below 0 by chance may be 0: the upper end is
 * computed from 0, or chance could give an upper end of 0. */
static struct study_interval root_of(const struct leave_out *l)
{
    const double width = leave_out_width(l), value = l->value[PAIR_GROUPS];

    return (struct study_interval){sqrt(fmax(0, value)), sqrt(fmax(0, value - width)), sqrt(fmax(0, value) + width)};
}

/* Sums over the pixels of each group. */
struct group_sums {
    double sum[PAIR_GROUPS], count[PAIR_GROUPS];
};

static struct leave_out means_without(const struct group_sums *s)
{
    struct leave_out out;
    double sum = 0, count = 0;

    for (int g = 0; g < PAIR_GROUPS; g++) {
        sum += s->sum[g];
        count += s->count[g];
    }
    for (int g = 0; g <= PAIR_GROUPS; g++) {
        double less = g < PAIR_GROUPS ? s->sum[g] : 0, fewer = g < PAIR_GROUPS ? s->count[g] : 0;
        out.value[g] = count > fewer ? (sum - less) / (count - fewer) : sum / count;
    }
    return out;
}

struct grouped {
    float value;
    uint32_t group;
};

static int falling(const void *a, const void *b)
{
    const float x = ((const struct grouped *)a)->value, y = ((const struct grouped *)b)->value;

    return (x < y) - (x > y);
}

/* The value that a twentieth of the pixels exceed; sorts them. */
static struct leave_out percentiles_without(struct grouped *pixels, size_t count)
{
    size_t members[PAIR_GROUPS + 1] = {0};
    struct leave_out out;

    qsort(pixels, count, sizeof *pixels, falling);
    for (size_t i = 0; i < count; i++)
        members[pixels[i].group]++;
    for (unsigned g = 0; g <= PAIR_GROUPS; g++) {
        size_t rank = (count - members[g]) / 20, at = 0;
        for (; at + 1 < count; at++) {
            if (pixels[at].group == g)
                continue;
            if (rank-- == 0)
                break;
        }
        out.value[g] = (double)pixels[at].value;
    }
    return out;
}

/* ---- noise ---------------------------------------------------------------------------------- */

static float largest_difference(const float *a, const float *b)
{
    float most = 0;

    for (int c = 0; c < 3; c++)
        most = fmaxf(most, fabsf(a[c] - b[c]));
    return most;
}

static status check_sizes(const struct image *a, const struct image *b, struct error *err)
{
    if (a->width == b->width && a->height == b->height && a->channels == 3 && b->channels == 3)
        return STATUS_OK;
    return error_set(err, STATUS_ERR_INPUT, "pictures of %ux%u and %ux%u pixels cannot be compared", a->width,
                     a->height, b->width, b->height);
}

static double squared_difference(const float *a, const float *b)
{
    double sum = 0;

    for (int c = 0; c < 3; c++) {
        const double d = (double)a[c] - (double)b[c];
        sum += d * d / 2;
    }
    return sum;
}

static void linear_error(struct pair_error *out, const struct image *a, const struct image *b)
{
    const size_t count = (size_t)a->width * a->height;
    struct group_sums squares = {0};
    struct leave_out mean_square;
    double mean = 0;

    for (size_t i = 0; i < count; i++) {
        const unsigned g = group_of((uint32_t)(i % a->width), (uint32_t)(i / a->width));
        for (size_t c = 3 * i; c < 3 * i + 3; c++)
            mean += ((double)a->pixels[c] + (double)b->pixels[c]) / 2;
        squares.sum[g] += squared_difference(a->pixels + 3 * i, b->pixels + 3 * i);
        squares.count[g] += 3;
    }
    mean /= 3 * (double)count;
    mean_square = means_without(&squares);
    out->rmse = root_of(&mean_square);
    out->rmse.value /= mean;
    out->rmse.low /= mean;
    out->rmse.high /= mean;
}

status pair_error_of(struct pair_error *out, const struct shown *shown, const struct image *a, const struct image *b,
                     float *pixels, struct error *err)
{
    const size_t count = (size_t)a->width * a->height;
    struct grouped *work = must(mem_calloc(count, sizeof *work));
    struct image code_a = {0}, code_b = {0};
    status result = check_sizes(a, b, err);

    memset(out, 0, sizeof *out);
    THEN(result, shown_codes(shown, &code_a, a, err));
    THEN(result, shown_codes(shown, &code_b, b, err));
    if (result == STATUS_OK) {
        struct leave_out percentiles;
        double square = 0, width;

        linear_error(out, a, b);
        for (size_t i = 0; i < count; i++) {
            const float *x = code_a.pixels + 3 * i, *y = code_b.pixels + 3 * i;
            work[i].value = largest_difference(x, y) * (float)M_SQRT1_2;
            work[i].group = group_of((uint32_t)(i % a->width), (uint32_t)(i / a->width));
            if (pixels)
                pixels[i] = work[i].value;
            for (int c = 0; c < 3; c++)
                square += (double)(x[c] - y[c]) * (double)(x[c] - y[c]) / 2;
        }
        percentiles = percentiles_without(work, count);
        width = leave_out_width(&percentiles);
        out->codes = (struct study_interval){percentiles.value[PAIR_GROUPS],
                                             fmax(0, percentiles.value[PAIR_GROUPS] - width),
                                             percentiles.value[PAIR_GROUPS] + width};
        out->rms_codes = sqrt(square / (3 * (double)count));
    }
    image_release(&code_b);
    image_release(&code_a);
    mem_free(work);
    return result;
}

status pair_tail_of(double *held, const double *pixels, size_t count, const struct image *a, const struct image *b,
                    struct error *err)
{
    const size_t all = (size_t)a->width * a->height;
    struct grouped *work = must(mem_calloc(all, sizeof *work));
    status result = check_sizes(a, b, err);
    double sum = 0, whole = 0;
    size_t at = 0;

    for (size_t i = 0; i < all && result == STATUS_OK; i++) {
        work[i].value = (float)squared_difference(a->pixels + 3 * i, b->pixels + 3 * i);
        whole += (double)work[i].value;
    }
    if (result == STATUS_OK)
        qsort(work, all, sizeof *work, falling);
    for (size_t i = 0; i < count && result == STATUS_OK; i++) {
        for (; at < all && (double)at + 0.5 < pixels[i] * (double)all; at++)
            sum += (double)work[at].value;
        held[i] = whole > 0 ? sum / whole : NAN;
    }
    mem_free(work);
    return result;
}

const struct accuracy_figures *pair_judge(const struct accuracy_figures *a, const struct accuracy_figures *b)
{
    if (a->reliable != b->reliable)
        return a->reliable ? b : a;
    return b->top_share > a->top_share ? b : a;
}

/* ---- bias ----------------------------------------------------------------------------------- */

/* The usual picture's value at a pixel, and by how much the other one is lower around it. */
struct place {
    float at, step;
};

/* With the pixel itself, or only of its neighbours. */
static struct place place_of(const struct image *usual, const struct image *const p[4], size_t i, int itself)
{
    const size_t w = usual->width, h = usual->height, x = i / 3 % w, y = i / 3 / w;
    const size_t x0 = x > BOX_RADIUS ? x - BOX_RADIUS : 0, x1 = x + BOX_RADIUS < w ? x + BOX_RADIUS : w - 1;
    const size_t y0 = y > BOX_RADIUS ? y - BOX_RADIUS : 0, y1 = y + BOX_RADIUS < h ? y + BOX_RADIUS : h - 1;
    struct place sum = {0, 0};
    float count = 0;

    for (size_t v = y0; v <= y1; v++)
        for (size_t u = x0; u <= x1; u++) {
            const size_t k = (v * w + u) * 3 + i % 3;
            if (k == i && !itself && w * h > 1)
                continue;
            sum.at += usual->pixels[k];
            sum.step += ((p[0]->pixels[k] - p[1]->pixels[k]) + (p[2]->pixels[k] - p[3]->pixels[k])) / 2;
            count++;
        }
    return (struct place){itself ? usual->pixels[i] : sum.at / count, sum.step / count};
}

/* Codes per radiance between the usual picture and one that is changed by about as much as leaving
 * something out changes it: a tangent would be wrong for large changes. */
static status secants_of(struct image *slope, const struct shown *shown, const struct image *usual,
                         const struct image *const p[4], int itself, struct error *err)
{
    const size_t count = (size_t)usual->width * usual->height * 3;
    struct image from = {0}, to = {0}, code = {0}, code_to = {0};
    status result = image_init(&from, usual->width, usual->height, 3, err);

    THEN(result, image_init(&to, usual->width, usual->height, 3, err));
    THEN(result, image_init(slope, usual->width, usual->height, 3, err));
    for (size_t i = 0; result == STATUS_OK && i < count; i++) {
        struct place q = place_of(usual, p, i, itself);
        const float least = 0.01f * q.at + 1e-6f;
        if (fabsf(q.step) < least)
            q.step = q.step < 0 ? -least : least;
        from.pixels[i] = q.at;
        to.pixels[i] = q.at - q.step >= 0 ? q.at - q.step : q.at > 0 ? 0 : fabsf(q.step);
        if (to.pixels[i] == q.at)
            to.pixels[i] = q.at + least;
    }
    THEN(result, shown_codes(shown, &code, &from, err));
    THEN(result, shown_codes(shown, &code_to, &to, err));
    for (size_t i = 0; result == STATUS_OK && i < count; i++) {
        const float step = to.pixels[i] - from.pixels[i];
        slope->pixels[i] = step != 0 ? (code_to.pixels[i] - code.pixels[i]) / step : 0;
    }
    image_release(&code_to);
    image_release(&code);
    image_release(&to);
    image_release(&from);
    return result;
}

/* The flatter of the secants at a pixel and at its neighbours. The pixel's own is steep where noise
 * has made both pictures dark together, which would look like a bias; its neighbours' is steep at a
 * dark edge of a bright area, where its own is correct. */
static status slopes_of(struct image *slope, const struct shown *shown, const struct image *usual,
                        const struct image *const p[4], struct error *err)
{
    struct image own = {0};
    status result = secants_of(slope, shown, usual, p, 0, err);

    THEN(result, secants_of(&own, shown, usual, p, 1, err));
    for (size_t i = 0; result == STATUS_OK && i < (size_t)usual->width * usual->height * 3; i++)
        if (fabsf(own.pixels[i]) < fabsf(slope->pixels[i]))
            slope->pixels[i] = own.pixels[i];
    image_release(&own);
    return result;
}

struct bias_work {
    struct grouped *both, *noise;
    struct group_sums product[3];
};

static void bias_pixel(struct bias_work *w, size_t i, unsigned group, const float *slope,
                       const struct image *const p[4])
{
    float both = 0, noise = 0;

    for (size_t c = 0; c < 3; c++) {
        const size_t at = 3 * i + c;
        const float da = slope[c] * (p[0]->pixels[at] - p[1]->pixels[at]);
        const float db = slope[c] * (p[2]->pixels[at] - p[3]->pixels[at]);
        both = fmaxf(both, fabsf(da + db) / 2);
        noise = fmaxf(noise, fabsf(da - db) / 2);
        w->product[c].sum[group] += (double)da * (double)db;
        w->product[c].count[group]++;
    }
    w->both[i] = (struct grouped){both, group};
    w->noise[i] = (struct grouped){noise, group};
}

static void bias_finish(struct pair_bias *out, struct bias_work *w, size_t count)
{
    struct leave_out both = percentiles_without(w->both, count);
    const struct leave_out noise = percentiles_without(w->noise, count);
    double most = 0;

    for (int c = 0; c < 3; c++) {
        const struct leave_out means = means_without(&w->product[c]);
        const struct study_interval rms = root_of(&means);
        most = fmax(most, rms.high);
        if (c == 0 || rms.value > out->rms_codes.value)
            out->rms_codes = rms;
    }
    out->rms_codes.high = most; /* chance may have raised another channel */
    for (int g = 0; g <= PAIR_GROUPS; g++)
        both.value[g] = both.value[g] * both.value[g] - noise.value[g] * noise.value[g];
    out->codes = root_of(&both);
    if (!(out->rms_codes.low > 0))
        out->codes.low = 0;
}

struct study_interval pair_bias_worse(const struct pair_bias *bias)
{
    return bias->rms_codes.high > bias->codes.high ? bias->rms_codes : bias->codes;
}

static double mean_of(const struct image *a, const struct image *b)
{
    double sum = 0;

    for (size_t i = 0; i < (size_t)a->width * a->height * 3; i++)
        sum += (double)a->pixels[i] + (double)b->pixels[i];
    return sum;
}

status pair_bias_of(struct pair_bias *out, const struct shown *shown, const struct image *usual, const struct image *a,
                    const struct image *a2, const struct image *b, const struct image *b2, struct error *err)
{
    const struct image *const p[4] = {a, a2, b, b2};
    const size_t count = (size_t)a->width * a->height;
    struct bias_work work = {must(mem_calloc(count, sizeof *work.both)),
                             must(mem_calloc(count, sizeof *work.noise)), {{{0}, {0}}}};
    struct image slope = {0};
    status result = check_sizes(usual, a, err);

    memset(out, 0, sizeof *out);
    for (int i = 1; i < 4 && result == STATUS_OK; i++)
        result = check_sizes(a, p[i], err);
    THEN(result, slopes_of(&slope, shown, usual, p, err));
    if (result == STATUS_OK) {
        const double whole = mean_of(a, b);
        for (size_t i = 0; i < count; i++)
            bias_pixel(&work, i, group_of((uint32_t)(i % a->width), (uint32_t)(i / a->width)), slope.pixels + 3 * i, p);
        bias_finish(out, &work, count);
        out->mean_change = whole > 0 ? mean_of(a2, b2) / whole - 1 : NAN;
        out->same = memcmp(a->pixels, a2->pixels, count * 12) == 0 && memcmp(b->pixels, b2->pixels, count * 12) == 0;
    }
    image_release(&slope);
    mem_free(work.noise);
    mem_free(work.both);
    return result;
}
