/* One choice at a time: what each costs, and its bias. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "client/study/run.h"
#include "client/study/run_ways.h"
#include "client/study/data/study_fields.h"
#include "client/study/data/study_words.h"
#include "common/base/memory.h"
#include "common/film/tiles.h"

enum {
    ADAPTIVE_CAP = 4,      /* times a level's samples, in any tile */
    ADAPTIVE_SPP_MIN = 64, /* the first rounds give all tiles the same, and may already be enough */
};

static struct study_question *question_of(struct study *s, const char *title)
{
    struct study_question *q;

    for (size_t i = 0; i < s->questions.count; i++)
        if (s->questions.items[i].title && strcmp(s->questions.items[i].title, title) == 0)
            return &s->questions.items[i];
    q = study_add_question(s);
    study_text_set(&q->title, title);
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
    return sum + run_picture_s(run, l->spp[l->count - 1]); /* the probe */
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
                return levels_to((uint32_t)(points->items[points->count - 1].samples + 0.5), (uint32_t)points->count);
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
    struct image pair[2];  /* of the last level */
    struct image sampling; /* of the last level, where it is adaptive */
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

/* Times as they would have been when the usual way was measured. */
static void at_first_speed(struct study_point *points, uint32_t count, double drift)
{
    for (uint32_t i = 0; i < count; i++)
        points[i].core_s /= drift;
}

/* usual NULL: this is the usual way. */
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
        run->probe_spp = usual && i + 1 == levels->count ? run->usual_spp : 0;
        result = run_pair(run, &mine, spp, run->request->settings.seed + RUN_WAYS_SEED, what, pair, err);
        THEN(result, pair_error_of(&e, &run->shown, &pair[0].picture, &pair[1].picture, NULL, err));
        if (result == STATUS_OK) {
            run_point_set(&out->points[i], pair);
            run_point_error(&out->points[i], &e);
            if (!usual && i + 1 == levels->count)
                study_clock_probe(&run->clock, pair[0].core_s);
            out->clamped_share = (pair[0].clamped_share + pair[1].clamped_share) / 2;
        }
        THEN(result, run_point_reference(run, &out->points[i], &pair[0].picture, &pair[1].picture, err));
        if (result == STATUS_OK && i + 1 == levels->count)
            keep_pictures(out, pair);
        trial_release(&pair[1]);
        trial_release(&pair[0]);
    }
    run->probe_spp = 0;
    if (usual)
        at_first_speed(out->points, levels->count, study_clock_drift(&run->clock));
    return result;
}

/* Half the width of the interval of ln(time of one way / time of another). */
static double clock_width(const struct study_run *run) { return study_clock_width(&run->clock, 1); }

static double log_width(const struct study_interval *v) { return (v->high - v->low) / (2 * v->value); }

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
    width = hypot(clock_width(run), hypot(log_width(&usual->codes), log_width(&mine->codes)) / exponent);
    c->gain = (struct study_interval){exp(value), exp(value - width), exp(value + width)};
}

static void add_effect(struct study_run *run, const struct way *way, const struct measured *usual,
                       const struct measured *mine, uint32_t top, const struct study_interval *bias)
{
    struct study_effect *e = study_add_effect(run->study);
    const double ratio = mine->points[top].core_s / usual->points[top].core_s, width = clock_width(run);

    e->saved = (struct study_interval){1 - ratio, 1 - ratio * exp(width), 1 - ratio * exp(-width)};
    e->bias = *bias;
    study_text_set(&e->name, way->name);
}

/* A picture's error is its noise and its bias. */
static struct study_interval with_bias(struct study_interval noise, double bias)
{
    return (struct study_interval){hypot(noise.value, bias), hypot(noise.low, bias), hypot(noise.high, bias)};
}

static void set_texts(struct study_choice *c, const struct way *way, const struct measured *mine)
{
    char text[128];

    study_text_set(&c->name, way->name);
    snprintf(text, sizeof text, way->knob == KNOB_EFFECT ? "Without %s" : "%s", way->words);
    study_text_set(&c->words, text);
    if (way->knob == KNOB_CLAMP)
        c->taken = mine->clamped_share;
    if (way->knob == KNOB_ALLOCATION && way->value) {
        c->by_target = 1;
        study_text_set(&c->note, "this is how --target-error renders");
    }
}

/* A way with the usual one's expectation has no bias. If its picture is still significantly different, its samples have
 * missed light, and the difference is a part of its error that they do not show. */
static void unbiased_choice(struct study_choice *c, uint32_t spp)
{
    const struct study_interval differs = c->floor;
    char text[160];

    c->unbiased = 1;
    c->floor = (struct study_interval){0, 0, 0};
    if (!(differs.low > 0))
        return;
    c->missed = 1;
    snprintf(text, sizeof text, "%u samples of a pixel have not met all of the light", spp);
    study_text_set(&c->note, text);
    for (size_t i = 0; i < c->points.count; i++) {
        struct study_point *p = &c->points.items[i];
        p->codes = with_bias(p->codes, differs.value);
        p->reliable = 0;
        study_text_set(&p->reason, text);
    }
}

/* Tiles of 16 pixels square have one number each. */
static void set_tile_samples(struct study *s, const struct image *sampling)
{
    const uint32_t columns = tiles_across(sampling->width), rows = tiles_across(sampling->height);

    if (!sampling->pixels || (size_t)columns * rows > STUDY_NUMBERS_MAX)
        return;
    s->tile_samples.values.count = 0;
    s->tile_samples.columns = columns;
    s->tile_samples.rows = rows;
    for (size_t y = 0; y < rows; y++)
        for (size_t x = 0; x < columns; x++)
            study_numbers_add(&s->tile_samples.values,
                              (double)sampling->pixels[3 * (y * TILE_SIZE * sampling->width + x * TILE_SIZE)]);
}

static status add_choice(struct study_run *run, const struct way *way, const struct measured *usual,
                         struct measured *mine, const struct levels *levels, struct error *err)
{
    const uint32_t top = levels->count - 1;
    struct study_interval worse;
    struct study_question *q = question_of(run->study, way_title(way->knob));
    struct study_choice *c = study_add_choice(q);
    struct pair_bias bias = {0};

    set_texts(c, way, mine);
    if (usual->pair[0].pixels)
        TRY(pair_bias_of(&bias, &run->shown, &run->usual, &usual->pair[0], &mine->pair[0], &usual->pair[1],
                         &mine->pair[1], err));
    c->floor = bias.codes;
    for (uint32_t i = 0; i < levels->count; i++) {
        struct study_point *p = study_add_point(&c->points);
        *p = mine->points[i];
        mine->points[i].reason = NULL; /* moved */
    }
    if (way_is_unbiased(way, &run->request->settings))
        unbiased_choice(c, levels->spp[top]);
    set_gain(c, run, &usual->points[top], &c->points.items[top]);
    for (uint32_t i = 0; i < levels->count; i++)
        c->points.items[i].codes = with_bias(c->points.items[i].codes, c->floor.low > 0 ? c->floor.value : 0);
    if (way->knob == KNOB_ALLOCATION)
        set_tile_samples(run->study, &mine->sampling);
    worse = pair_bias_worse(&bias);
    if (!c->unbiased && !(c->floor.low > 0) && worse.low > run->study->target_codes / 4 && !c->note)
        study_text_set(&c->note, "but a few pixels change by more");
    if (way->knob == KNOB_EFFECT)
        add_effect(run, way, usual, mine, top, &worse);
    return STATUS_OK;
}

/* The usual way is in each question, without points: its curve is the main one. */
static void add_usual(struct study_run *run, const struct way *way)
{
    struct study_question *q = question_of(run->study, way_title(way->knob));
    struct study_choice *c = study_add_choice(q);
    struct measured none = {0};

    c->baseline = 1;
    set_texts(c, way, &none);
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

static status one_way(struct study_run *run, const struct plan *plan, size_t i, const struct levels *levels,
                      const struct measured *usual, struct error *err)
{
    const struct way *way = &plan->ways[i];
    const struct study_point *rival;
    struct measured mine = {0}, main_curve = {0};
    const uint32_t probe_spp = run->usual_spp;
    struct levels one;
    char what[160];
    status result = STATUS_OK;

    if (plan_is_usual(run, plan, i)) {
        if (has_alternative(run, plan, way->knob))
            add_usual(run, way);
    } else {
        if (way->knob == KNOB_ALLOCATION && (rival = adaptive_rival(run->study, levels)) != NULL) {
            one = levels_to((uint32_t)(rival->samples + 0.5), 1);
            main_curve.points[0] = *rival;
            main_curve.points[0].reason = NULL; /* the study's */
            usual = &main_curve;
            levels = &one;
        }
        snprintf(what, sizeof what, "%s: %s", way_title(way->knob), way->name);
        if (way->knob == KNOB_PRECISION) { /* those workers cannot render the probe */
            run->usual_spp = 0;
            result = run->connect(run->user, 1, err);
        }
        THEN(result, measure(run, &plan->requests[i], what, levels, usual, &mine, err));
        run->usual_spp = probe_spp;
        if (result == STATUS_OK && way->knob == KNOB_PRECISION)
            result = run->connect(run->user, 0, err);
        THEN(result, add_choice(run, way, usual, &mine, levels, err));
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
        result =
            run_pair(run, run->request, RUN_SPP_FIRST * 4, run->request->settings.seed, "the usual way", pair, err);
        THEN(result, pair_mean(&run->usual, &pair[0].picture, &pair[1].picture, err));
        THEN(result, shown_meter(&run->shown, &run->usual, &run->request->output.tonemap,
                                 &run->request->output.tonemap_file, err));
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
    run->usual_spp = levels.spp[levels.count - 1];
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
