/* The tables of the program that pages need: tone mappers, effects, layers, choices, verbs. */
#include <ctype.h>
#include <stdio.h>

#include "common/film/health.h"
#include "common/scene/effects.h"
#include "common/scene/settings.h"
#include "common/scene/stages.h"
#include "common/schema/verbs.h"
#include "common/tonemap/tonemap.h"
#include "web/api/api_tables.h"
#include "protocol/json/json_wire.h"
#include "web/base/problem.h"

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

/* The words of a choice, or of those that the set has. */
static void put_choice(struct buffer *out, const char *before, const char *key, enum choice_name choice, uint64_t set)
{
    const char *word, *comma = "";

    buffer_printf(out, "%s\"%s\":[", before, key);
    for (unsigned i = 0; (word = choice_word(choice, i)) != NULL; i++)
        if (set >> i & 1) {
            buffer_puts(out, comma);
            json_put_word(out, word);
            comma = ",";
        }
    buffer_puts(out, "]");
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
    put_choice(&out, "],", "metering", CHOICE_TONEMAP_METERING, UINT64_MAX);
    put_choice(&out, ",", "denoise", CHOICE_DENOISING, UINT64_MAX);
    buffer_printf(&out, ",\"exposure_max\":%g,\"kelvin_min\":%g,\"kelvin_max\":%g,\"temporal_max\":%g}",
                  look_rows[LOOK_exposure_ev].most, look_rows[LOOK_white_kelvin].least,
                  look_rows[LOOK_white_kelvin].most, look_rows[LOOK_temporal].most);
    answer_table(request, &out);
}

/* ---- effects ------------------------------------------------------------------------------------- */

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
        enum choice_name choice;
    } lists[] = {
        {"effects", CHOICE_EFFECT},
        {"stages", CHOICE_STAGE},
        {"aovs", CHOICE_AOV},
        {"isas", CHOICE_ISA},
        {"env_samplings", CHOICE_ENV_SAMPLING},
        {"samplers", CHOICE_SAMPLER},
        {"light_choices", CHOICE_LIGHT_CHOICE},
        {"texture_filters", CHOICE_TEXTURE_FILTER},
        {"bvh_qualities", CHOICE_BVH_QUALITY},
        {"pixel_filters", CHOICE_PIXEL_FILTER},
        {"stop_measures", CHOICE_STOP_MEASURE},
    };
    struct buffer out = BUFFER_INIT;

    put_choice(&out, "{", "switchable", CHOICE_EFFECT, EFFECTS_SWITCHABLE);
    for (size_t k = 0; k < sizeof lists / sizeof *lists; k++)
        put_choice(&out, ",", lists[k].key, lists[k].choice, UINT64_MAX);
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
