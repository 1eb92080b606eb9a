/* The operators by name, and their settings. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/tonemap/operators.h"
#include "common/tonemap/tonemap.h"

#define OPERATOR(name) &tonemap_##name,
static const struct tonemap_operator *const operators[] = {TONEMAP_OPERATORS(OPERATOR)};

static const char *const metering_names[TONEMAP_METERING_COUNT] = {
    [TONEMAP_METERING_OFF] = "off",
    [TONEMAP_METERING_KEY] = "key",
    [TONEMAP_METERING_PERCENTILE] = "percentile",
};

const struct tonemap_operator *const *tonemap_operators(size_t *count)
{
    *count = sizeof operators / sizeof *operators;
    return operators;
}

const struct tonemap_operator *tonemap_find(const char *name)
{
    if (strcmp(name, "reinhard") == 0) /* its name in stores of 0.1 */
        name = "reinhard02";
    for (size_t i = 0; i < sizeof operators / sizeof *operators; i++)
        if (strcmp(operators[i]->name, name) == 0)
            return operators[i];
    return NULL;
}

const char *tonemap_metering_name(enum tonemap_metering metering)
{
    return (unsigned)metering < TONEMAP_METERING_COUNT ? metering_names[metering] : "?";
}

int tonemap_metering_parse(const char *name)
{
    for (int i = 0; i < TONEMAP_METERING_COUNT; i++)
        if (strcmp(metering_names[i], name) == 0)
            return i;
    return -1;
}

/* ", word" at the end of a list of words. */
static void add_word(char *list, size_t size, const char *word)
{
    size_t used = strlen(list);

    snprintf(list + used, size - used, "%s%s", used ? ", " : "", word);
}

status tonemap_settings_init(struct tonemap_settings *s, const char *name, struct error *err)
{
    memset(s, 0, sizeof *s);
    s->metering_percentile = 99.0;
    s->op = tonemap_find(name);
    if (!s->op) {
        char known[512] = "";

        for (size_t i = 0; i < sizeof operators / sizeof *operators; i++)
            add_word(known, sizeof known, operators[i]->name);
        return error_set(err, STATUS_ERR_INPUT,
                         "no tone mapping operator is called \"%.64s\"; there are: %s", name,
                         known);
    }
    for (size_t i = 0; i < s->op->parameter_count; i++)
        s->values[i] = s->op->parameters[i].preset;
    return STATUS_OK;
}

/* The parameter's number; ERR_INPUT lists the existing ones. */
static status find_parameter(const struct tonemap_settings *s, const char *name, size_t *at,
                             struct error *err)
{
    char known[512] = "";

    for (*at = 0; *at < s->op->parameter_count; ++*at) {
        if (strcmp(s->op->parameters[*at].name, name) == 0)
            return STATUS_OK;
        add_word(known, sizeof known, s->op->parameters[*at].name);
    }
    return error_set(err, STATUS_ERR_INPUT,
                     "the operator %s has no parameter \"%.64s\"; its parameters: %s", s->op->name,
                     name, known[0] ? known : "none");
}

status tonemap_settings_set(struct tonemap_settings *s, const char *parameter, double value,
                            struct error *err)
{
    const struct tonemap_parameter *p;
    size_t at;
    status st = find_parameter(s, parameter, &at, err);

    if (st != STATUS_OK)
        return st;
    p = &s->op->parameters[at];
    if (!(value >= p->min && value <= p->max))
        return error_set(err, STATUS_ERR_INPUT, "%s's %s must be from %g to %g, and is %g",
                         s->op->name, p->name, p->min, p->max, value);
    if (p->kind != TONEMAP_NUMBER && value != floor(value))
        return error_set(err, STATUS_ERR_INPUT, "%s's %s must be a whole number, and is %g",
                         s->op->name, p->name, value);
    s->values[at] = value;
    return STATUS_OK;
}

status tonemap_settings_set_text(struct tonemap_settings *s, const char *parameter,
                                 const char *text, struct error *err)
{
    const struct tonemap_parameter *p;
    char known[512] = "", *end;
    double value;
    size_t at;
    status st = find_parameter(s, parameter, &at, err);

    if (st != STATUS_OK)
        return st;
    p = &s->op->parameters[at];
    for (size_t i = 0; p->kind == TONEMAP_CHOICE && p->choices[i]; i++) {
        if (strcmp(p->choices[i], text) == 0) {
            s->values[at] = (double)i;
            return STATUS_OK;
        }
        add_word(known, sizeof known, p->choices[i]);
    }
    if (p->kind == TONEMAP_CHOICE)
        return error_set(err, STATUS_ERR_INPUT, "%s's %s cannot be \"%.64s\"; it is one of: %s",
                         s->op->name, p->name, text, known);
    value = strtod(text, &end);
    if (end == text || *end != 0)
        return error_set(err, STATUS_ERR_INPUT, "%s's %s: \"%.64s\" is not a number",
                         s->op->name, p->name, text);
    return tonemap_settings_set(s, parameter, value, err);
}

status tonemap_settings_validate(const struct tonemap_settings *s, struct error *err)
{
    if (!(fabs(s->exposure_ev) <= TONEMAP_EXPOSURE_MAX))
        return error_set(err, STATUS_ERR_INPUT,
                         "the exposure must be from -%d to %d stops, and is %g",
                         TONEMAP_EXPOSURE_MAX, TONEMAP_EXPOSURE_MAX, s->exposure_ev);
    if ((unsigned)s->metering >= TONEMAP_METERING_COUNT)
        return error_set(err, STATUS_ERR_INPUT, "unknown exposure metering %u",
                         (unsigned)s->metering);
    if (!(s->metering_percentile >= 0.0 && s->metering_percentile <= 100.0))
        return error_set(err, STATUS_ERR_INPUT,
                         "the percentile of the automatic exposure must be from 0 to 100, and is %g",
                         s->metering_percentile);
    if (s->white_kelvin != 0.0 && !(s->white_kelvin >= TONEMAP_KELVIN_MIN &&
                                    s->white_kelvin <= TONEMAP_KELVIN_MAX))
        return error_set(err, STATUS_ERR_INPUT,
                         "the white balance must be from %d to %d kelvin, and is %g",
                         TONEMAP_KELVIN_MIN, TONEMAP_KELVIN_MAX, s->white_kelvin);
    if (s->temporal > TONEMAP_TEMPORAL_MAX)
        return error_set(err, STATUS_ERR_INPUT, "at most %d frames are averaged, not %u",
                         TONEMAP_TEMPORAL_MAX, (unsigned)s->temporal);
    if (s->has_file && !s->op->file_load)
        return error_set(err, STATUS_ERR_INPUT, "the operator %s takes no file", s->op->name);
    if (!s->has_file && s->op->file_required)
        return error_set(err, STATUS_ERR_INPUT, "the operator %s needs a file: %s", s->op->name,
                         s->op->file_help);
    return STATUS_OK;
}
