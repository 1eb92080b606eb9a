#include "client/views/effects_auto.h"
#include "common/scene/scene_effects.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "client/study/effects_choose.h"
#include "common/accuracy/stop.h"

#define SHARE_OF_TARGET 0.25
#define LOOSE_CODES 2.0 /* the smallest visible change */

status parse_target_codes(const char *text, double *codes, struct error *err)
{
    char *rest;

    *codes = strtod(text, &rest);
    if (rest > text && strcmp(rest, "/255") == 0 && *codes > 0 && *codes <= 255)
        return STATUS_OK;
    return error_set(err, STATUS_ERR_USAGE, "--target-error %s: give steps of a screen, as in 3/255", text);
}

status effects_auto_check(struct effects_auto *o, const char *target, struct error *err)
{
    const int on = o->effects && strcmp(o->effects, "auto") == 0;

    o->target_codes = 0;
    if (on && !target)
        return error_set(err, STATUS_ERR_USAGE,
                         "--effects auto: say how exact the picture must be, as in --target-error 3/255");
    return on ? parse_target_codes(target, &o->target_codes, err) : STATUS_OK;
}

/* ---- pilots that are rendered ---------------------------------------------------------------- */

struct auto_pilots {
    struct effects_measure measure;
    struct job_request small; /* owns nothing */
    const struct job_request *request;
    double target_codes;
    double probe_sample_s, probe_samples; /* until pilots are rendered: of one sample, and of a pixel to the target */
};

enum { PROBE_SPP = 8, PROBE_SIDE_MIN = 8, RENDER_SPP_MIN = SPP_MIN_DEFAULT };
#define PROBE_SHARE (CHOOSE_BUDGET_SHARE / 4) /* of the shortest render that is possible */

static double frames_of(const struct job_request *request) { return request->last_frame - request->first_frame + 1.0; }

/* The pilot's picture again, smaller: what the probe takes is little even of a render that is short. */
static void probe_shrink(struct render_settings *s, const struct job_request *request)
{
    const struct render_settings *whole = &request->settings;
    const double least = fmin(whole->spp, RENDER_SPP_MIN) * whole->width * whole->height * frames_of(request);
    const double scale = sqrt(fmin(1, PROBE_SHARE * least / PROBE_SPP / ((double)s->width * s->height)));

    s->spp = PROBE_SPP;
    if (s->whole_width) /* a region stays as it is */
        return;
    s->width = (uint32_t)fmin(s->width, fmax(PROBE_SIDE_MIN, s->width * scale));
    s->height = (uint32_t)fmin(s->height, fmax(PROBE_SIDE_MIN, s->height * scale));
}

/* About what the render will take, from one small picture. */
static status probe(struct auto_pilots *p, struct error *err)
{
    struct effects_measure *m = &p->measure;
    struct job_request mine = p->small;
    struct trial done;
    status result;

    probe_shrink(&mine.settings, p->request);
    mine.stop = (struct stop_rules){0};
    result = trial_render(m->connection, m->scene, &mine, "pilot", NULL, &done, err);
    if (result == STATUS_OK) {
        const double error = done.figures.display_error / p->target_codes;
        p->probe_sample_s = done.core_s / ((double)mine.settings.width * mine.settings.height * PROBE_SPP);
        p->probe_samples = done.figures.known ? PROBE_SPP * error * error : INFINITY;
        m->core_s += done.core_s;
    }
    trial_release(&done);
    return result;
}

static double sample_s(const struct auto_pilots *p)
{
    return p->measure.count ? effects_measure_sample_s(&p->measure) : p->probe_sample_s;
}

static status measure_alone(void *user, uint64_t bits, int length, struct error *err)
{
    struct auto_pilots *p = user;

    return length == 0 ? effects_measure_run(&p->measure, bits, err)
                       : effects_measure_again(&p->measure, bits, choose_lengths[length], err);
}

static status price_alone(void *user, int bit, struct effects_price *out, struct error *err)
{
    struct auto_pilots *p = user;

    return effects_measure_price(&p->measure, effects_measure_find(&p->measure, bit), out, err);
}

static status price_together(void *user, uint64_t set, int length, struct effects_price *out, struct error *err)
{
    struct auto_pilots *p = user;
    size_t trial;
    status result = effects_measure_together(&p->measure, set, choose_lengths[length], &trial, err);

    return result == STATUS_OK ? effects_measure_price(&p->measure, trial, out, err) : result;
}

/* The whole picture is one more. */
static double pilots_s(void *user, unsigned effects, int length)
{
    const struct auto_pilots *p = user;
    const struct render_settings *s = &p->small.settings;

    return sample_s(p) * s->width * s->height * choose_lengths[length] * EFFECTS_ROUNDS * (effects + 1);
}

/* All frames, to the target or to the cap. */
static double render_s(void *user)
{
    const struct auto_pilots *p = user;
    const struct render_settings *s = &p->request->settings;
    const double to_target =
        p->measure.count ? effects_measure_samples_to(&p->measure, p->target_codes) : p->probe_samples;
    const double samples = fmin(s->spp, fmax(RENDER_SPP_MIN, to_target));

    return sample_s(p) * s->width * s->height * samples * frames_of(p->request);
}

/* ---- what is said ------------------------------------------------------------------------------ */

static void print_names(const struct effects_candidate *all, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        const struct study_interval own = pair_bias_worse(&all[i].price.bias);
        fprintf(stderr, "%s %s (%.2f/255, at most %.2f)", i ? "," : "", effect_name((enum effect_bit)all[i].bit),
                own.value, own.high);
    }
}

static void report(const struct effects_choice *c, struct auto_pilots *pilots)
{
    const double most = pilots->target_codes * SHARE_OF_TARGET, expected_s = render_s(pilots);
    const struct study_interval bias = pair_bias_worse(&c->together.bias);

    if (c->count == 0) {
        fprintf(stderr,
                "effects auto: nothing is left out: no effect both saves time to the target and "
                "certainly changes less than %.3g/255\n",
                most);
    } else {
        fprintf(stderr, "effects auto: left out");
        print_names(c->all, c->count);
        fprintf(stderr, "\neffects auto: leaving them out changes %.2f/255 (at most %.2f; a quarter of the "
                        "target is %.3g) and saves %.0f %% of the time to the target\n",
                bias.value, bias.high, most, 100 * effects_price_gain(&c->together).value);
        if (most > LOOSE_CODES)
            fprintf(stderr, "effects auto: the target is loose: a change of %.3g/255 can be seen\n", most);
    }
    if (c->unmeasured) {
        const char *between = "";
        fprintf(stderr, "effects auto: kept, as measuring them would take more than a tenth of the render:");
        for (int bit = 0; bit < EFFECT_COUNT; bit++)
            if (c->unmeasured >> bit & 1) {
                fprintf(stderr, "%s %s", between, effect_name((enum effect_bit)bit));
                between = ",";
            }
        fprintf(stderr, "\n");
    }
    if (c->open_count) {
        fprintf(stderr, "effects auto: kept, as longer pilots would not pay:");
        print_names(c->open, c->open_count);
        fprintf(stderr, "\n");
    }
    fprintf(stderr, "effects auto: measuring took %.3g core-seconds; rendering everything would take about %.3g\n",
            pilots->measure.core_s, expected_s);
}

status effects_auto_apply(const struct effects_auto *o, struct connection *c, const struct import_result *scene,
                          struct job_request *request, int quiet, struct error *err)
{
    struct auto_pilots pilots = {.small = *request, .request = request, .target_codes = o->target_codes};
    const struct effects_pilots table = {&pilots, measure_alone, price_alone, price_together, pilots_s, render_s};
    struct effects_choice choice = {0};
    uint64_t set;
    status result;

    if (!(o->target_codes > 0))
        return STATUS_OK;
    set = EFFECTS_SWITCHABLE & scene_effects(&scene->scene, &request->settings, request->first_frame, NULL);
    if (!set) {
        if (!quiet)
            fprintf(stderr, "effects auto: the scene needs no effect that can be left out\n");
        return STATUS_OK;
    }
    effects_measure_shrink(&pilots.small.settings, request->settings.height <= EFFECTS_PILOT_ROWS, 0);
    pilots.small.settings.spp = choose_lengths[0];
    pilots.measure = (struct effects_measure){
        .connection = c, .scene = scene, .request = &pilots.small, .quiet = quiet};
    result = probe(&pilots, err);
    THEN(result, effects_choose(&choice, &table, set, o->target_codes * SHARE_OF_TARGET, err));
    if (result == STATUS_OK) {
        request->settings.without |= choice.set;
        if (!quiet)
            report(&choice, &pilots);
    }
    effects_measure_release(&pilots.measure);
    return result;
}
