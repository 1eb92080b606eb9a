/* One choice at a time: what each costs, and its bias. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "client/study/run.h"
#include "client/study/run_ways.h"
#include "client/study/study_fields.h"
#include "client/study/study_words.h"
#include "common/base/memory.h"
#include "common/film/tiles.h"

enum {
    ADAPTIVE_CAP = 4,      /* times a level's samples, in any tile */
    ADAPTIVE_SPP_MIN = 64, /* the first rounds give all tiles the same, and may already be enough */
};

static struct study_question *question_of(struct study *s, const char *title, struct error *err)
{
    struct study_question *q;

    for (size_t i = 0; i < s->questions.count; i++)
        if (s->questions.items[i].title && strcmp(s->questions.items[i].title, title) == 0)
            return &s->questions.items[i];
    q = study_add_question(s);
    if (!q || study_text_set(&q->title, title, err) != STATUS_OK)
        return NULL;
    return q;
}

static struct study_choice *choice_of(struct study_question *q, const char *name)
{
    for (size_t i = 0; i < q->choices.count; i++)
        if (q->choices.items[i].name && strcmp(q->choices.items[i].name, name) == 0)
            return &q->choices.items[i];
    return NULL;
}

static int is_known(const struct study *s, const struct way *way)
{
    for (size_t i = 0; i < s->questions.count; i++)
        if (s->questions.items[i].title && strcmp(s->questions.items[i].title, way_title(way->knob)) == 0 &&
            choice_of(&s->questions.items[i], way->name))
            return 1;
    return 0;
}

/* ---- levels --------------------------------------------------------------------------------- */

/* The numbers of samples at which all ways are compared, each four times the one before. */
struct levels {
    uint32_t count, spp[RUN_LEVELS_MAX];
};

static double way_wall_s(const struct study_run *run, const struct levels *l)
{
    double sum = 0;

    for (uint32_t i = 0; i < l->count; i++)
        sum += 2 * run_picture_s(run, l->spp[i]);
    return sum;
}

static struct levels levels_to(uint32_t most, uint32_t count)
{
    struct levels l = {.count = count};

    for (uint32_t i = 0; i < count; i++)
        l.spp[i] = most >> 2 * (count - 1 - i);
    return l;
}

/* Those of an earlier run, or else the most that the budget allows for all ways. */
static struct levels levels_choose(const struct study_run *run, size_t missing)
{
    const struct study *s = run->study;
    struct levels l = {0};
    uint32_t most = (uint32_t)(study_last_point(s)->samples + 0.5);

    for (size_t i = 0; i < s->questions.count; i++)
        for (size_t k = 0; k < s->questions.items[i].choices.count; k++) {
            const study_points *points = &s->questions.items[i].choices.items[k].points;
            const char *title = s->questions.items[i].title;
            if (title && strcmp(title, way_title(KNOB_ALLOCATION)) == 0)
                continue; /* has samples of its own */
            if (points->count > 0 && points->count <= RUN_LEVELS_MAX)
                return levels_to((uint32_t)(points->items[points->count - 1].samples + 0.5),
                                 (uint32_t)points->count);
        }
    for (uint32_t count = run->levels; count > 0; count--)
        for (uint32_t spp = most; spp >= (uint32_t)RUN_SPP_FIRST << 2 * (count - 1); spp /= 2) {
            /* More points are of little use if all are far from the main curve's end. */
            if (count > 1 && spp < most / 8)
                break;
            l = levels_to(spp, count);
            if (way_wall_s(run, &l) * (double)(missing + 1) < 0.85 * run_left_s(run))
                return l;
        }
    return levels_to(RUN_SPP_FIRST, 1);
}

/* ---- one way -------------------------------------------------------------------------------- */

struct measured {
    struct study_point points[RUN_LEVELS_MAX];
    struct image pair[2];        /* of the last level */
    struct image sampling;       /* of the last level, where it is adaptive */
    double clamped_share;
};

static void measured_release(struct measured *m)
{
    for (size_t i = 0; i < RUN_LEVELS_MAX; i++)
        mem_free(m->points[i].reason);
    image_release(&m->sampling);
    image_release(&m->pair[0]);
    image_release(&m->pair[1]);
}

/* The usual picture that an adaptive one is compared with: of the main curve, because the levels
 * may have fewer samples than the rounds distribute. NULL: there is none. */
static const struct study_point *adaptive_rival(const struct study *s, const struct levels *levels)
{
    const double least = fmax(levels->spp[levels->count - 1], ADAPTIVE_SPP_MIN);

    for (size_t i = 0; i < s->points.count; i++)
        if (s->points.items[i].samples >= least && s->points.items[i].codes.value > 0)
            return &s->points.items[i];
    return NULL;
}

/* An adaptive picture ends when it is as good as its rival; its cost is the question. No tile gets
 * more than a few times the samples. */
static void aim(struct job_request *request, uint32_t *spp, double codes)
{
    request->stop.has_target = 1;
    request->stop.target = (struct allocation_target){ALLOCATION_DISPLAY, fmin(fmax(codes, 0.01), 128)};
    *spp *= ADAPTIVE_CAP;
}

/* The last level's pictures. */
static void keep_pictures(struct measured *out, struct trial pair[2])
{
    for (size_t k = 0; k < 2; k++) {
        out->pair[k] = pair[k].picture;
        memset(&pair[k].picture, 0, sizeof pair[k].picture);
    }
    out->sampling = pair[0].sampling;
    memset(&pair[0].sampling, 0, sizeof pair[0].sampling);
}

static status measure(struct study_run *run, const struct job_request *request, const char *what,
                      const struct levels *levels, const struct measured *usual, struct measured *out,
                      struct error *err)
{
    status result = STATUS_OK;

    memset(out, 0, sizeof *out);
    for (uint32_t i = 0; i < levels->count && result == STATUS_OK; i++) {
        struct job_request mine = *request;
        struct trial pair[2] = {0};
        uint32_t spp = levels->spp[i];
        struct pair_error e;
        if (mine.stop.adaptive)
            aim(&mine, &spp, usual->points[i].codes.value);
        /* Seeds of their own: the main curve's pictures stay independent of them. */
        result = run_pair(run, &mine, spp, run->request->settings.seed + 2, what, pair, err);
        if (result == STATUS_OK)
            result = pair_error_of(&e, &run->shown, &pair[0].picture, &pair[1].picture, NULL, err);
        if (result == STATUS_OK) {
            result = run_point_set(&out->points[i], pair, err);
            run_point_error(&out->points[i], &e);
            out->clamped_share = (pair[0].clamped_share + pair[1].clamped_share) / 2;
        }
        if (result == STATUS_OK && i + 1 == levels->count)
            keep_pictures(out, pair);
        trial_release(&pair[1]);
        trial_release(&pair[0]);
    }
    return result;
}

/* Half the width of the interval of ln(time of one way / time of another), from the spread of the
 * times of equal jobs so far. */
static double clock_width(const struct study_run *run)
{
    const unsigned pairs = (unsigned)run->clock_pairs;

    return pairs ? student_t95(pairs) * sqrt(run->clock_squares / run->clock_pairs / 2) : NAN;
}

static double log_width(const struct study_interval *v)
{
    return (v->high - v->low) / (2 * v->value);
}

/* The usual way's core seconds over this one's, at equal error: the law's exponent turns errors
 * into time. With a bias, the noise must be lower by the bias's share of the target. */
static void set_gain(struct study_choice *c, const struct study_run *run, const struct study_point *usual,
                     const struct study_point *mine)
{
    const struct study *s = run->study;
    const double exponent = study_has_fit(s) ? fmin(fmax(s->fit.exponent.value, 0.2), 1) : 0.5;
    const double target = s->target_codes > 0 ? s->target_codes : 3;
    const double bias = c->floor.low > 0 ? c->floor.value : 0;
    double value, width;

    /* If the target cannot be met: twice the bias, in whole codes. */
    c->gain_at = bias < 0.7 * target ? target : ceil(2 * bias);
    if (!(usual->codes.value > 0) || !(mine->codes.value > 0) || c->gain_at > 50)
        return;
    value = log(usual->core_s / mine->core_s) + log(usual->codes.value / mine->codes.value) / exponent +
            log(1 - bias * bias / (c->gain_at * c->gain_at)) / (2 * exponent);
    width = hypot(clock_width(run),
                  hypot(log_width(&usual->codes), log_width(&mine->codes)) / exponent);
    c->gain = (struct study_interval){exp(value), exp(value - width), exp(value + width)};
}

static status add_effect(struct study_run *run, const struct way *way, const struct measured *usual,
                         const struct measured *mine, uint32_t top, const struct study_interval *bias,
                         struct error *err)
{
    struct study_effect *e = study_add_effect(run->study);
    const double ratio = mine->points[top].core_s / usual->points[top].core_s, width = clock_width(run);

    if (!e)
        return error_no_memory(err, "an effect");
    e->saved = (struct study_interval){1 - ratio, 1 - ratio * exp(width), 1 - ratio * exp(-width)};
    e->bias = *bias;
    return study_text_set(&e->name, way->name, err);
}

/* A picture's error is its noise and its bias. */
static struct study_interval with_bias(struct study_interval noise, double bias)
{
    return (struct study_interval){hypot(noise.value, bias), hypot(noise.low, bias),
                                   hypot(noise.high, bias)};
}

static status set_texts(struct study_choice *c, const struct way *way, const struct measured *mine,
                        struct error *err)
{
    char text[128];
    status result = study_text_set(&c->name, way->name, err);

    snprintf(text, sizeof text, way->knob == KNOB_EFFECT ? "Without %s" : "%s", way->words);
    if (result == STATUS_OK)
        result = study_text_set(&c->words, text, err);
    if (way->knob == KNOB_CLAMP && result == STATUS_OK) {
        snprintf(text, sizeof text, "takes away %.2g %% of the light", 100 * mine->clamped_share);
        result = study_text_set(&c->note, text, err);
    }
    if (way->knob == KNOB_ALLOCATION && way->value && result == STATUS_OK)
        result = study_text_set(&c->note, "this is how --target-error renders", err);
    return result;
}

/* A way with the usual one's expectation has no bias. If its picture is still significantly
 * different, its samples have missed light, and the difference is a part of its error that they do
 * not show. */
static status unbiased_choice(struct study_choice *c, uint32_t spp, struct error *err)
{
    const struct study_interval differs = c->floor;
    char text[160];
    status result = STATUS_OK;

    c->unbiased = 1;
    c->floor = (struct study_interval){0, 0, 0};
    if (!(differs.low > 0))
        return STATUS_OK;
    c->missed = 1;
    snprintf(text, sizeof text, "%u samples of a pixel have not met all of the light", spp);
    result = study_text_set(&c->note, text, err);
    for (size_t i = 0; i < c->points.count && result == STATUS_OK; i++) {
        struct study_point *p = &c->points.items[i];
        p->codes = with_bias(p->codes, differs.value);
        p->reliable = 0;
        result = study_text_set(&p->reason, text, err);
    }
    return result;
}

/* Tiles of 16 pixels square have one number each. */
static status set_tile_samples(struct study *s, const struct image *sampling, struct error *err)
{
    const uint32_t columns = tiles_across(sampling->width), rows = tiles_across(sampling->height);

    if (!sampling->pixels || (size_t)columns * rows > STUDY_NUMBERS_MAX)
        return STATUS_OK;
    s->tile_samples.values.count = 0;
    s->tile_samples.columns = columns;
    s->tile_samples.rows = rows;
    for (size_t y = 0; y < rows; y++)
        for (size_t x = 0; x < columns; x++)
            if (!study_numbers_add(&s->tile_samples.values,
                                   (double)sampling->pixels[3 * (y * TILE_SIZE * sampling->width + x * TILE_SIZE)]))
                return error_no_memory(err, "a map of tiles");
    return STATUS_OK;
}

static status add_choice(struct study_run *run, const struct way *way, const struct measured *usual,
                         struct measured *mine, const struct levels *levels, struct error *err)
{
    const uint32_t top = levels->count - 1;
    struct study_interval worse;
    struct study_question *q = question_of(run->study, way_title(way->knob), err);
    struct study_choice *c = q ? study_add_choice(q) : NULL;
    struct pair_bias bias = {0};
    status result = c ? set_texts(c, way, mine, err) : error_no_memory(err, "a choice");

    if (result == STATUS_OK && usual->pair[0].pixels)
        result = pair_bias_of(&bias, &run->shown, &run->usual, &usual->pair[0], &mine->pair[0],
                              &usual->pair[1], &mine->pair[1], err);
    if (result != STATUS_OK)
        return result;
    c->floor = bias.codes;
    for (uint32_t i = 0; i < levels->count; i++) {
        struct study_point *p = study_add_point(&c->points);
        if (!p)
            return error_no_memory(err, "a point");
        *p = mine->points[i];
        mine->points[i].reason = NULL; /* moved */
    }
    if (way_is_unbiased(way, &run->request->settings))
        result = unbiased_choice(c, levels->spp[top], err);
    set_gain(c, run, &usual->points[top], &c->points.items[top]);
    for (uint32_t i = 0; i < levels->count; i++)
        c->points.items[i].codes = with_bias(c->points.items[i].codes, c->floor.low > 0 ? c->floor.value : 0);
    if (result == STATUS_OK && way->knob == KNOB_ALLOCATION)
        result = set_tile_samples(run->study, &mine->sampling, err);
    if (result != STATUS_OK)
        return result;
    worse = pair_bias_worse(&bias);
    if (!c->unbiased && !(c->floor.low > 0) && worse.low > run->study->target_codes / 4 && !c->note)
        result = study_text_set(&c->note, "but a few pixels change by more", err);
    if (result != STATUS_OK)
        return result;
    return way->knob == KNOB_EFFECT ? add_effect(run, way, usual, mine, top, &worse, err) : STATUS_OK;
}

/* The usual way is in each question, without points: its curve is the main one. */
static status add_usual(struct study_run *run, const struct way *way, struct error *err)
{
    struct study_question *q = question_of(run->study, way_title(way->knob), err);
    struct study_choice *c = q ? study_add_choice(q) : NULL;
    struct measured none = {0};

    if (!c)
        return error_no_memory(err, "a choice");
    c->baseline = 1;
    return set_texts(c, way, &none, err);
}

static int all_known(const struct study_run *run, const struct plan *plan)
{
    for (size_t i = 0; i < plan->count; i++)
        if (!is_known(run->study, &plan->ways[i]))
            return 0;
    return 1;
}

/* A question needs an alternative. */
static int has_alternative(const struct study_run *run, const struct plan *plan, enum knob knob)
{
    for (size_t i = 0; i < plan->count; i++)
        if (plan->ways[i].knob == knob && !plan_is_usual(run, plan, i))
            return 1;
    return 0;
}

static status one_way(struct study_run *run, const struct plan *plan, size_t i,
                      const struct levels *levels, const struct measured *usual, struct error *err)
{
    const struct way *way = &plan->ways[i];
    const struct study_point *rival;
    struct measured mine = {0}, main_curve = {0};
    struct levels one;
    char what[160];
    status result;

    if (plan_is_usual(run, plan, i)) {
        result = has_alternative(run, plan, way->knob) ? add_usual(run, way, err) : STATUS_OK;
    } else {
        if (way->knob == KNOB_ALLOCATION && (rival = adaptive_rival(run->study, levels)) != NULL) {
            one = levels_to((uint32_t)(rival->samples + 0.5), 1);
            main_curve.points[0] = *rival;
            main_curve.points[0].reason = NULL; /* the study's */
            usual = &main_curve;
            levels = &one;
        }
        snprintf(what, sizeof what, "%s: %s", way_title(way->knob), way->name);
        result = way->knob == KNOB_PRECISION ? run->connect(run->user, 1, err) : STATUS_OK;
        if (result == STATUS_OK)
            result = measure(run, &plan->requests[i], what, levels, usual, &mine, err);
        if (result == STATUS_OK && way->knob == KNOB_PRECISION)
            result = run->connect(run->user, 0, err);
        if (result == STATUS_OK)
            result = add_choice(run, way, usual, &mine, levels, err);
    }
    measured_release(&mine);
    return result == STATUS_OK ? run->save(run->user, err) : result;
}

static size_t count_missing(const struct study_run *run, const struct plan *plan)
{
    size_t missing = 0;

    for (size_t i = 0; i < plan->count; i++)
        missing += !is_known(run->study, &plan->ways[i]) && !plan_is_usual(run, plan, i);
    return missing;
}

status run_choices(struct study_run *run, struct error *err)
{
    static struct plan plan; /* too large for the stack */
    struct measured usual = {0};
    struct levels levels;
    size_t missing;
    status result = STATUS_OK;

    if (!run->usual.pixels) { /* the main curve is an earlier run's */
        struct trial pair[2] = {0};
        result = run_pair(run, run->request, RUN_SPP_FIRST * 4, run->request->settings.seed,
                          "the usual way", pair, err);
        if (result == STATUS_OK)
            result = pair_mean(&run->usual, &pair[0].picture, &pair[1].picture, err);
        if (result == STATUS_OK)
            result = shown_meter(&run->shown, &run->usual, &run->request->output.tonemap,
                                 &run->request->output.tonemap_file, err);
        trial_release(&pair[1]);
        trial_release(&pair[0]);
        if (result != STATUS_OK)
            return result;
    }
    plan_make(&plan, run);
    missing = count_missing(run, &plan);
    levels = levels_choose(run, missing);
    if (!adaptive_rival(run->study, &levels)) {
        plan_drop(&plan, KNOB_ALLOCATION);
        missing = count_missing(run, &plan);
    }
    run->steps = missing + 1;
    if (missing)
        result = measure(run, run->request, "the usual way", &levels, NULL, &usual, err);
    for (size_t i = 0; i < plan.count && result == STATUS_OK; i++) {
        if (is_known(run->study, &plan.ways[i]))
            continue;
        if (!plan_is_usual(run, &plan, i)) {
            if (way_wall_s(run, &levels) > run_left_s(run))
                break;
            run->steps_done++;
        }
        result = one_way(run, &plan, i, &levels, &usual, err);
    }
    if (result == STATUS_OK)
        run->study->complete = all_known(run, &plan);
    measured_release(&usual);
    return result;
}
