/* One choice at a time: which there are, what each costs, and what it changes for ever. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "client/study/run.h"
#include "client/study/study_words.h"
#include "common/base/memory.h"
#include "common/scene/effects.h"

enum knob {
    KNOB_SAMPLER, KNOB_ENVIRONMENT, KNOB_LIGHTS, KNOB_DEPTH, KNOB_ROULETTE, KNOB_CLAMP, KNOB_HALF,
    KNOB_ROBUST, KNOB_BVH, KNOB_FILTER, KNOB_ISA, KNOB_EFFECT, KNOB_COUNT
};

static const char *const titles[KNOB_COUNT] = {
    "Sampler", "Environment sampling", "Choice of lights", "Path depth", "Russian roulette",
    "Clamping of fireflies", "Bits of the picture", "Robust traversal", "Quality of the BVH",
    "Texture filter", "Instruction set", "Effects left out"};

struct way {
    enum knob knob;
    int value;
    const char *name, *words;
};

/* Clamps are in multiples of the picture's mean. */
static const struct way ways[] = {
    {KNOB_SAMPLER, SAMPLER_SOBOL, "Sobol", "Scrambled Sobol' points"},
    {KNOB_SAMPLER, SAMPLER_INDEPENDENT, "independent", "Independent random numbers"},
    {KNOB_ENVIRONMENT, ENV_SAMPLING_IMPORTANCE, "importance", "Environment sampled by importance"},
    {KNOB_ENVIRONMENT, ENV_SAMPLING_UNIFORM, "uniform", "Environment sampled uniformly"},
    {KNOB_ENVIRONMENT, ENV_SAMPLING_BSDF, "BSDF", "Environment found by the surfaces' directions alone"},
    {KNOB_ENVIRONMENT, ENV_SAMPLING_IMPORTANCE_ONLY, "no MIS", "Environment sampled by importance alone"},
    {KNOB_ENVIRONMENT, ENV_SAMPLING_UNIFORM_ONLY, "uniform, no MIS", "Environment sampled uniformly, alone"},
    {KNOB_LIGHTS, LIGHT_CHOICE_TREE, "tree", "Lights chosen by a tree"},
    {KNOB_LIGHTS, LIGHT_CHOICE_POWER, "power", "Lights chosen by power"},
    {KNOB_LIGHTS, LIGHT_CHOICE_UNIFORM, "uniform", "Lights chosen all alike"},
    {KNOB_DEPTH, 1, "1", "Paths of 1 edge"},
    {KNOB_DEPTH, 2, "2", "Paths of at most 2 edges"},
    {KNOB_DEPTH, 4, "4", "Paths of at most 4 edges"},
    {KNOB_DEPTH, 8, "8", "Paths of at most 8 edges"},
    {KNOB_DEPTH, 16, "16", "Paths of at most 16 edges"},
    {KNOB_ROULETTE, 0, "on", "Russian roulette on"},
    {KNOB_ROULETTE, 1, "off", "Russian roulette off"},
    {KNOB_CLAMP, 100, "100 x mean", "Samples above 100 times the picture's mean scaled down"},
    {KNOB_CLAMP, 10, "10 x mean", "Samples above 10 times the picture's mean scaled down"},
    {KNOB_HALF, 0, "32", "32-bit floats"},
    {KNOB_HALF, 1, "16", "16-bit floats"},
    {KNOB_ROBUST, 0, "on", "Robust traversal"},
    {KNOB_ROBUST, 1, "off", "Robust traversal off"},
    {KNOB_BVH, BVH_QUALITY_MEDIUM, "medium", "BVH of medium quality"},
    {KNOB_BVH, BVH_QUALITY_LOW, "low", "BVH of low quality"},
    {KNOB_BVH, BVH_QUALITY_HIGH, "high", "BVH of high quality, robust traversal off"},
    {KNOB_FILTER, TEXTURE_FILTER_CONE, "cone", "Textures filtered by the ray's cone"},
    {KNOB_FILTER, TEXTURE_FILTER_BILINEAR, "bilinear", "Textures interpolated at their finest level"},
    {KNOB_FILTER, TEXTURE_FILTER_NEAREST, "nearest", "Textures by their nearest texel"},
    {KNOB_ISA, ISA_SSE2, "sse2", "Rays traced with SSE2"},
    {KNOB_ISA, ISA_AVX2, "avx2", "Rays traced with AVX2"},
    {KNOB_ISA, ISA_AVX512, "avx512", "Rays traced with AVX-512"},
};

enum { WAYS = sizeof ways / sizeof *ways, PLAN_MAX = WAYS + EFFECT_COUNT };

struct plan {
    struct way ways[PLAN_MAX];
    struct job_request requests[PLAN_MAX]; /* copies that own nothing */
    size_t count;
};

static double mean_radiance(const struct image *picture)
{
    const size_t count = (size_t)picture->width * picture->height * 3;
    double sum = 0;

    for (size_t i = 0; i < count; i++)
        sum += (double)picture->pixels[i];
    return sum / (double)count;
}

static void apply(struct job_request *request, const struct way *way, double mean)
{
    struct render_settings *s = &request->settings;

    switch (way->knob) {
    case KNOB_SAMPLER: s->sampler = (enum sampler_kind)way->value; break;
    case KNOB_ENVIRONMENT: s->env_sampling = (enum env_sampling)way->value; break;
    case KNOB_LIGHTS: s->light_choice = (enum light_choice)way->value; break;
    case KNOB_DEPTH: s->max_depth = (uint32_t)way->value; break;
    case KNOB_ROULETTE: s->no_roulette = way->value; break;
    case KNOB_CLAMP: s->clamp = (float)(mean * way->value); break;
    case KNOB_HALF: request->output.half = way->value; break;
    case KNOB_ROBUST: s->not_robust = way->value; break;
    case KNOB_BVH:
        s->bvh_quality = (enum bvh_quality)way->value;
        s->not_robust |= way->value == BVH_QUALITY_HIGH;
        break;
    case KNOB_FILTER: s->texture_filter = (enum texture_filter)way->value; break;
    case KNOB_ISA: s->isa = (enum isa)way->value; break;
    case KNOB_EFFECT: s->without |= (uint64_t)1 << way->value; break;
    case KNOB_COUNT: break;
    }
}

/* Does the question arise in this scene? */
static int arises(const struct study_run *run, const struct way *way, uint64_t set, double mean)
{
    const struct render_settings *s = &run->request->settings;

    switch (way->knob) {
    case KNOB_ENVIRONMENT: return (set & EFFECT_ENVIRONMENT) != 0;
    case KNOB_LIGHTS: return (set & (EFFECT_EMISSIVE_MESH | EFFECT_PUNCTUAL_LIGHT)) != 0;
    case KNOB_CLAMP: return mean > 0 && s->clamp <= 0;
    case KNOB_ROBUST: return way->value == 0 || s->bvh_quality != BVH_QUALITY_HIGH;
    case KNOB_FILTER: return (set & EFFECT_TEXTURE) != 0;
    /* Of other machines' processors nothing is known here. */
    case KNOB_ISA: return (int)s->isa == way->value ||
                          (run->local && (isa_supported_mask() >> way->value & 1));
    case KNOB_EFFECT: return (set & EFFECTS_SWITCHABLE) >> way->value & 1;
    default: return 1;
    }
}

static void plan_make(struct plan *plan, const struct study_run *run)
{
    const uint64_t set = scene_effects(&run->scene->scene, &run->request->settings,
                                       run->request->first_frame, NULL);
    const double mean = mean_radiance(&run->usual);

    plan->count = 0;
    for (size_t i = 0; i < PLAN_MAX; i++) {
        struct way way = {KNOB_EFFECT, (int)(i - WAYS), NULL, NULL};
        if (i < WAYS)
            way = ways[i];
        else
            way.name = way.words = effect_name((enum effect_bit)way.value);
        if (!arises(run, &way, set, mean))
            continue;
        plan->ways[plan->count] = way;
        plan->requests[plan->count] = *run->request;
        apply(&plan->requests[plan->count++], &way, mean);
    }
}

static int is_usual(const struct study_run *run, const struct job_request *request)
{
    return render_settings_equal(&request->settings, &run->request->settings) &&
           request->output.half == run->request->output.half;
}

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
        if (s->questions.items[i].title && strcmp(s->questions.items[i].title, titles[way->knob]) == 0 &&
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

/* Those of an earlier run, or else the most that the budget lets all ways have. */
static struct levels levels_choose(const struct study_run *run, size_t missing)
{
    const struct study *s = run->study;
    struct levels l = {0};
    uint32_t most = (uint32_t)(study_last_point(s)->samples + 0.5);

    for (size_t i = 0; i < s->questions.count; i++)
        for (size_t k = 0; k < s->questions.items[i].choices.count; k++) {
            const study_points *points = &s->questions.items[i].choices.items[k].points;
            if (points->count > 0 && points->count <= RUN_LEVELS_MAX)
                return levels_to((uint32_t)(points->items[points->count - 1].samples + 0.5),
                                 (uint32_t)points->count);
        }
    for (uint32_t count = run->levels; count > 0; count--)
        for (uint32_t spp = most; spp >= (uint32_t)RUN_SPP_FIRST << 2 * (count - 1); spp /= 2) {
            /* More points are worth little where they are all far from the main curve's end. */
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
    struct image pair[2];    /* of the last level */
    double clamped_share;
};

static void measured_release(struct measured *m)
{
    for (size_t i = 0; i < RUN_LEVELS_MAX; i++)
        mem_free(m->points[i].reason);
    image_release(&m->pair[0]);
    image_release(&m->pair[1]);
}

static status measure(struct study_run *run, const struct job_request *request, const char *what,
                      const struct levels *levels, struct measured *out, struct error *err)
{
    status result = STATUS_OK;

    memset(out, 0, sizeof *out);
    for (uint32_t i = 0; i < levels->count && result == STATUS_OK; i++) {
        struct trial pair[2] = {0};
        struct pair_error e;
        /* Seeds of their own: the main curve's pictures stay independent of them. */
        result = run_pair(run, request, levels->spp[i], run->request->settings.seed + 2, what, pair, err);
        if (result == STATUS_OK)
            result = pair_error_of(&e, &run->shown, &pair[0].picture, &pair[1].picture, NULL, err);
        if (result == STATUS_OK) {
            result = run_point_set(&out->points[i], pair, err);
            run_point_error(&out->points[i], &e);
            out->clamped_share = (pair[0].clamped_share + pair[1].clamped_share) / 2;
        }
        if (result == STATUS_OK && i + 1 == levels->count)
            for (size_t k = 0; k < 2; k++) {
                out->pair[k] = pair[k].picture;
                memset(&pair[k].picture, 0, sizeof pair[k].picture);
            }
        trial_release(&pair[1]);
        trial_release(&pair[0]);
    }
    return result;
}

/* Half the width of the interval of ln(time of one way / time of another), from how far apart the times
 * of equal jobs were so far. */
static double clock_width(const struct study_run *run)
{
    const unsigned pairs = (unsigned)run->clock_pairs;

    return pairs ? student_t95(pairs) * sqrt(run->clock_squares / run->clock_pairs / 2) : NAN;
}

static double log_width(const struct study_interval *v)
{
    return (v->high - v->low) / (2 * v->value);
}

/* The usual way's core seconds over this one's, at equal error: the law's exponent turns errors into
 * time. With a bias the noise must be below the target by what the bias takes. */
static void set_gain(struct study_choice *c, const struct study_run *run, const struct study_point *usual,
                     const struct study_point *mine)
{
    const struct study *s = run->study;
    const double exponent = study_has_fit(s) ? fmin(fmax(s->fit.exponent.value, 0.2), 1) : 0.5;
    const double target = s->target_codes > 0 ? s->target_codes : 3;
    const double bias = c->floor.low > 0 ? c->floor.value : 0;
    double value, width;

    /* Where the target cannot be met: twice the bias, in whole codes. */
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

/* A picture is wrong by its noise and its bias. */
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
    return result;
}

static status add_choice(struct study_run *run, const struct way *way, const struct measured *usual,
                         struct measured *mine, const struct levels *levels, struct error *err)
{
    const uint32_t top = levels->count - 1;
    struct study_interval worse;
    struct study_question *q = question_of(run->study, titles[way->knob], err);
    struct study_choice *c = q ? study_add_choice(q) : NULL;
    struct pair_bias bias;
    status result = c ? set_texts(c, way, mine, err) : error_no_memory(err, "a choice");

    if (result == STATUS_OK)
        result = pair_bias_of(&bias, &run->shown, &run->usual, &usual->pair[0], &mine->pair[0],
                              &usual->pair[1], &mine->pair[1], err);
    if (result != STATUS_OK)
        return result;
    c->floor = bias.codes;
    set_gain(c, run, &usual->points[top], &mine->points[top]);
    for (uint32_t i = 0; i < levels->count; i++) {
        struct study_point *p = study_add_point(&c->points);
        if (!p)
            return error_no_memory(err, "a point");
        *p = mine->points[i];
        mine->points[i].reason = NULL; /* moved */
        p->codes = with_bias(p->codes, c->floor.low > 0 ? c->floor.value : 0);
    }
    worse = pair_bias_worse(&bias);
    return way->knob == KNOB_EFFECT ? add_effect(run, way, usual, mine, top, &worse, err) : STATUS_OK;
}

/* The usual way is in each question, without points: its curve is the main one. */
static status add_usual(struct study_run *run, const struct way *way, struct error *err)
{
    struct study_question *q = question_of(run->study, titles[way->knob], err);
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

/* A question without an alternative is none. */
static int has_alternative(const struct study_run *run, const struct plan *plan, enum knob knob)
{
    for (size_t i = 0; i < plan->count; i++)
        if (plan->ways[i].knob == knob && !is_usual(run, &plan->requests[i]))
            return 1;
    return 0;
}

static status one_way(struct study_run *run, const struct plan *plan, size_t i,
                      const struct levels *levels, const struct measured *usual, struct error *err)
{
    const struct way *way = &plan->ways[i];
    struct measured mine = {0};
    char what[160];
    status result;

    if (is_usual(run, &plan->requests[i])) {
        result = has_alternative(run, plan, way->knob) ? add_usual(run, way, err) : STATUS_OK;
    } else {
        snprintf(what, sizeof what, "%s: %s", titles[way->knob], way->name);
        result = measure(run, &plan->requests[i], what, levels, &mine, err);
        if (result == STATUS_OK)
            result = add_choice(run, way, usual, &mine, levels, err);
    }
    measured_release(&mine);
    return result == STATUS_OK ? run->save(run->user, err) : result;
}

status run_choices(struct study_run *run, struct error *err)
{
    static struct plan plan; /* too large for the stack of a command that is small otherwise */
    struct measured usual = {0};
    struct levels levels;
    size_t missing = 0;
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
    for (size_t i = 0; i < plan.count; i++)
        missing += !is_known(run->study, &plan.ways[i]) && !is_usual(run, &plan.requests[i]);
    levels = levels_choose(run, missing);
    run->steps = missing + 1;
    if (missing)
        result = measure(run, run->request, "the usual way", &levels, &usual, err);
    for (size_t i = 0; i < plan.count && result == STATUS_OK; i++) {
        if (is_known(run->study, &plan.ways[i]))
            continue;
        if (!is_usual(run, &plan.requests[i])) {
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
