/* The tables of the program that pages need: tone mappers, effects, layers, choices, verbs. */
#include <ctype.h>
#include <stdio.h>

#include "common/film/health.h"
#include "common/scene/effects.h"
#include "common/scene/settings.h"
#include "common/scene/stages.h"
#include "common/schema/verbs.h"
#include "common/tonemap/tonemap.h"
#include "coordinator/web/api_farm.h"
#include "coordinator/web/json_wire.h"
#include "coordinator/web/problem.h"
#include "coordinator/web/tokens.h"

static void answer_table(struct web_request *request, struct buffer *text)
{
    if (buffer_ok(text))
        web_answer(request, 200, "application/json", NULL, text->data, text->size);
    else
        problem_answer(request, PROBLEM_UNAVAILABLE, "out of memory for a table");
    buffer_release(text);
}

static void put_bool(struct buffer *out, const char *name, int value)
{
    buffer_printf(out, ",\"%s\":%s", name, value ? "true" : "false");
}

/* ---- operators ---------------------------------------------------------------------------------- */

/* As `azulejo tonemap --list --json` has it. */
static void put_parameter(struct buffer *out, const struct tonemap_parameter *parameter)
{
    static const char *const kinds[] = {"number", "integer", "choice"};

    buffer_puts(out, "{\"name\":");
    json_put_text(out, parameter->name);
    buffer_printf(out, ",\"kind\":\"%s\"", kinds[parameter->kind]);
    if (parameter->kind == TONEMAP_CHOICE) {
        for (int i = 0; parameter->choices[i]; i++) {
            buffer_puts(out, i ? "," : ",\"choices\":[");
            json_put_text(out, parameter->choices[i]);
        }
        buffer_puts(out, "],\"default\":");
        json_put_text(out, parameter->choices[(size_t)parameter->preset]);
    } else {
        buffer_puts(out, ",\"min\":");
        json_put_number(out, parameter->min);
        buffer_puts(out, ",\"max\":");
        json_put_number(out, parameter->max);
        buffer_puts(out, ",\"default\":");
        json_put_number(out, parameter->preset);
    }
    buffer_puts(out, ",\"help\":");
    json_put_text(out, parameter->help);
    buffer_puts(out, "}");
}

static void put_operator(struct buffer *out, const struct tonemap_operator *op)
{
    buffer_puts(out, "{\"name\":");
    json_put_text(out, op->name);
    buffer_puts(out, ",\"summary\":");
    json_put_text(out, op->summary);
    buffer_puts(out, ",\"source\":");
    json_put_text(out, op->source);
    put_bool(out, "adaptive", op->adaptive);
    put_bool(out, "measured", op->measured);
    put_bool(out, "display_encoded", op->display_encoded);
    put_bool(out, "local", op->is_local != NULL);
    buffer_printf(out, ",\"file\":\"%s\"", !op->file_load ? "none" : op->file_required ? "required" : "optional");
    buffer_puts(out, ",\"parameters\":[");
    for (size_t i = 0; i < op->parameter_count; i++) {
        buffer_puts(out, i ? "," : "");
        put_parameter(out, &op->parameters[i]);
    }
    buffer_puts(out, "]}");
}

void api_operators(struct web_request *request)
{
    struct buffer out = BUFFER_INIT;
    size_t count;
    const struct tonemap_operator *const *operators = tonemap_operators(&count);

    buffer_puts(&out, "{\"operators\":[");
    for (size_t i = 0; i < count; i++) {
        buffer_puts(&out, i ? "," : "");
        put_operator(&out, operators[i]);
    }
    buffer_puts(&out, "],\"metering\":[");
    for (int i = 0; i < TONEMAP_METERING_COUNT; i++) {
        buffer_puts(&out, i ? "," : "");
        json_put_text(&out, tonemap_metering_name((enum tonemap_metering)i));
    }
    buffer_printf(&out, "],\"exposure_max\":%d,\"kelvin_min\":%d,\"kelvin_max\":%d,\"temporal_max\":%d}",
                  TONEMAP_EXPOSURE_MAX, TONEMAP_KELVIN_MIN, TONEMAP_KELVIN_MAX, TONEMAP_TEMPORAL_MAX);
    answer_table(request, &out);
}

/* ---- effects ------------------------------------------------------------------------------------- */

static const char *name_of_effect(int i) { return effect_name((enum effect_bit)i); }
static const char *name_of_stage(int i) { return stage_name((enum stage)i); }
static const char *name_of_aov(int i) { return aov_name((enum aov)i); }
static const char *name_of_isa(int i) { return isa_name((enum isa)i); }
static const char *name_of_sampler(int i) { return sampler_name((enum sampler_kind)i); }
static const char *name_of_lights(int i) { return light_choice_name((enum light_choice)i); }
static const char *name_of_filter(int i) { return texture_filter_name((enum texture_filter)i); }
static const char *name_of_bvh(int i) { return bvh_quality_name((enum bvh_quality)i); }

/* What a job's Work.health counts, by its kind. */
static void put_health(struct buffer *out)
{
    buffer_puts(out, ",\"health\":[");
    for (int i = 0; i < HEALTH_KINDS; i++) {
        const struct health_row *row = &health_rows[i];
        buffer_puts(out, i ? ",{\"name\":" : "{\"name\":");
        json_put_text(out, row->name);
        buffer_puts(out, ",\"one\":");
        json_put_text(out, row->one);
        buffer_puts(out, ",\"many\":");
        json_put_text(out, row->many);
        buffer_puts(out, ",\"remedy\":");
        json_put_text(out, row->remedy);
        buffer_puts(out, "}");
    }
    buffer_puts(out, "]");
}

void api_effects(struct web_request *request)
{
    static const struct {
        const char *key;
        int count;
        const char *(*name)(int i);
    } lists[] = {
        {"effects", EFFECT_COUNT, name_of_effect},
        {"stages", STAGE_COUNT, name_of_stage},
        {"aovs", AOV_COUNT, name_of_aov},
        {"isas", ISA_COUNT, name_of_isa},
        {"samplers", SAMPLER_COUNT, name_of_sampler},
        {"light_choices", LIGHT_CHOICE_COUNT, name_of_lights},
        {"texture_filters", TEXTURE_FILTER_COUNT, name_of_filter},
        {"bvh_qualities", BVH_QUALITY_COUNT, name_of_bvh},
    };
    struct buffer out = BUFFER_INIT;

    buffer_puts(&out, "{\"switchable\":");
    json_put_u64(&out, EFFECTS_SWITCHABLE);
    for (size_t k = 0; k < sizeof lists / sizeof *lists; k++) {
        buffer_printf(&out, ",\"%s\":[", lists[k].key);
        for (int i = 0; i < lists[k].count; i++) {
            buffer_puts(&out, i ? "," : "");
            json_put_text(&out, lists[k].name(i));
        }
        buffer_puts(&out, "]");
    }
    put_health(&out);
    buffer_puts(&out, "}");
    answer_table(request, &out);
}

/* ---- verbs --------------------------------------------------------------------------------------- */

static void put_words(struct buffer *out, const char *name, const char *text)
{
    buffer_printf(out, ",\"%s\":", name);
    json_put_text(out, text);
}

static void put_states(struct buffer *out, const char *name, unsigned states)
{
    int any = 0;

    buffer_printf(out, ",\"%s\":[", name);
    for (int s = 0; s < JOB_STATE_COUNT; s++)
        if (states >> s & 1)
            buffer_printf(out, "%s\"%s\"", any++ ? "," : "", job_state_word(s));
    buffer_puts(out, "]");
}

static void put_verb(struct buffer *out, const struct job_verb *verb)
{
    static const char *const takes[] = {"nothing", "flag", "number", "text", "frames", "form"};
    char label[32];
    const char *const words[][2] = {
        {"path", verb->path}, {"says", verb->says}, {"label", label}, {"done", verb->done ? verb->done : verb->past},
        {"question", verb->question}, {"button", verb->button ? verb->button : label}, {"takes", takes[verb->takes]},
        {"field", verb->field},
    };

    snprintf(label, sizeof label, "%s", verb->label ? verb->label : verb->name);
    label[0] = (char)toupper((unsigned char)label[0]);
    buffer_puts(out, "{\"name\":");
    json_put_text(out, verb->name);
    for (size_t i = 0; i < sizeof words / sizeof *words; i++)
        put_words(out, words[i][0], words[i][1]);
    put_bool(out, "single", verb->single);
    put_states(out, "states", verb->states);
    put_states(out, "accepted", verb->accepted);
    put_states(out, "front", verb->front);
}

void api_verbs(struct web_request *request)
{
    static const enum web_role roles[VERB_COUNT] = {
#define VERB(NAME, name, ROLE, ...) [VERB_##NAME] = WEB_ROLE_##ROLE,
#define VARIANT(...)
        JOB_VERBS(VERB, VARIANT)
#undef VERB
#undef VARIANT
    };
    struct buffer out = BUFFER_INIT;

    for (int v = 0; v < VERB_COUNT; v++) {
        buffer_puts(&out, v ? "," : "{\"verbs\":[");
        put_verb(&out, &job_verbs[v]);
        put_words(&out, "role", web_role_name(roles[job_verb_find(job_verbs[v].path) - job_verbs]));
        buffer_puts(&out, "}");
    }
    buffer_puts(&out, "]}");
    answer_table(request, &out);
}
