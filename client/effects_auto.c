#include "client/effects_auto.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "client/effects_measure.h"

#define SHARE_OF_TARGET 0.25
#define LEAST_SAVED 0.01 /* of the time */
#define LOOSE_CODES 2.0 /* is seen by anyone */

status parse_target_codes(const char *text, double *codes, struct error *err)
{
    char *rest;

    *codes = strtod(text, &rest);
    if (rest > text && strcmp(rest, "/255") == 0 && *codes > 0 && *codes <= 255)
        return STATUS_OK;
    return error_set(err, STATUS_ERR_USAGE,
                     "--target-error %s: give steps of a screen, as in 3/255", text);
}

status effects_auto_check(struct effects_auto *o, const char *target, struct error *err)
{
    const int on = o->effects && strcmp(o->effects, "auto") == 0;

    o->target_codes = 0;
    if (on && !target)
        return error_set(err, STATUS_ERR_USAGE,
                         "--effects auto: say how exact the picture shall be, as in --target-error 3/255");
    return on ? parse_target_codes(target, &o->target_codes, err) : STATUS_OK;
}

struct candidate {
    int bit;
    struct effects_price price;
};

struct chosen {
    struct candidate all[EFFECT_COUNT];
    size_t count;
    uint64_t set;
    struct effects_price together;
};

static double upper_end(const struct effects_price *price)
{
    return pair_bias_worse(&price->bias).high;
}

static double worth(const struct candidate *c)
{
    return c->price.saved.value / fmax(0.02, upper_end(&c->price));
}

/* Everything that surely saves time, a hundredth or more, and is hidden alone, bargains first. */
static status find_candidates(struct chosen *out, const struct effects_measure *m, double most,
                              struct error *err)
{
    for (int bit = 0; bit < EFFECT_COUNT; bit++) {
        const size_t trial = effects_measure_find(m, bit);
        struct candidate c = {.bit = bit};
        size_t at;
        if (trial == 0)
            continue;
        if (effects_measure_price(m, trial, &c.price, err) != STATUS_OK)
            return STATUS_ERR_NO_MEMORY;
        if (!(c.price.saved.low > 0) || c.price.saved.value < LEAST_SAVED || !(upper_end(&c.price) < most))
            continue;
        for (at = out->count++; at > 0 && worth(&c) > worth(&out->all[at - 1]); at--)
            out->all[at] = out->all[at - 1];
        out->all[at] = c;
    }
    return STATUS_OK;
}

/* The first of them whose upper ends together stay below; a bargain that does not fit is passed over. */
static void fill(struct chosen *out, double most)
{
    double sum = 0;
    size_t kept = 0;

    for (size_t i = 0; i < out->count; i++)
        if (sum + upper_end(&out->all[i].price) < most) {
            sum += upper_end(&out->all[i].price);
            out->all[kept++] = out->all[i];
        }
    out->count = kept;
}

/* Effects may add up to more than their sum, or save nothing together: only measuring tells. */
static status verify(struct chosen *out, struct effects_measure *m, double most, struct error *err)
{
    const size_t singles = m->count;
    status result = STATUS_OK;
    size_t trial;

    while (out->count > 0 && result == STATUS_OK) {
        out->set = 0;
        for (size_t i = 0; i < out->count; i++)
            out->set |= (uint64_t)1 << out->all[i].bit;
        out->together = out->all[0].price;
        if (out->count == 1)
            break;
        m->count = singles; /* the last set's trial makes room */
        result = effects_measure_add(m, out->set, &trial, err);
        if (result == STATUS_OK)
            result = effects_measure_price(m, trial, &out->together, err);
        if (result == STATUS_OK && upper_end(&out->together) < most && out->together.saved.value > 0)
            break;
        out->count--;
    }
    if (out->count == 0)
        out->set = 0;
    return result;
}

static void report(const struct chosen *c, const struct effects_auto *o, double core_s)
{
    const double most = o->target_codes * SHARE_OF_TARGET;
    const struct study_interval bias = pair_bias_worse(&c->together.bias);

    if (c->count == 0) {
        fprintf(stderr, "effects auto: nothing is left out: no effect both saves time and surely changes "
                        "less than %.3g/255; measuring took %.3g core-seconds\n", most, core_s);
        return;
    }
    fprintf(stderr, "effects auto: left out");
    for (size_t i = 0; i < c->count; i++) {
        const struct study_interval own = pair_bias_worse(&c->all[i].price.bias);
        fprintf(stderr, "%s %s (%.2f/255, at most %.2f)", i ? "," : "",
                effect_name((enum effect_bit)c->all[i].bit), own.value, own.high);
    }
    fprintf(stderr, "\neffects auto: leaving them out changes %.2f/255 (at most %.2f; a quarter of the target is "
                    "%.3g) and saves %.0f %% of the time; measuring took %.3g core-seconds\n",
            bias.value, bias.high, most, 100 * c->together.saved.value, core_s);
    if (most > LOOSE_CODES)
        fprintf(stderr, "effects auto: the target is loose: a change of %.3g/255 can be seen\n", most);
}

status effects_auto_apply(const struct effects_auto *o, struct connection *c,
                          const struct import_result *scene, struct job_request *request, int quiet,
                          struct error *err)
{
    struct job_request small = *request; /* owns nothing */
    struct effects_measure m = {.connection = c, .scene = scene, .request = &small, .quiet = quiet};
    const double most = o->target_codes * SHARE_OF_TARGET;
    struct chosen chosen = {0};
    uint64_t set;
    status result = STATUS_OK;

    if (!(o->target_codes > 0))
        return STATUS_OK;
    set = scene_effects(&scene->scene, &request->settings, request->first_frame, NULL);
    if (!(set & EFFECTS_SWITCHABLE)) {
        if (!quiet)
            fprintf(stderr, "effects auto: the scene calls for nothing that can be left out\n");
        return STATUS_OK;
    }
    effects_measure_shrink(&small.settings, request->settings.height <= EFFECTS_PILOT_ROWS, 0);
    result = effects_measure_run(&m, set, err);
    if (result == STATUS_OK)
        result = find_candidates(&chosen, &m, most, err);
    if (result == STATUS_OK) {
        fill(&chosen, most);
        result = verify(&chosen, &m, most, err);
    }
    if (result == STATUS_OK) {
        request->settings.without |= chosen.set;
        if (!quiet)
            report(&chosen, o, m.core_s);
    }
    effects_measure_release(&m);
    return result;
}
