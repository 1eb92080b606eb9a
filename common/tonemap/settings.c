/* The operators by name, and their settings. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/guess.h"
#include "common/tonemap/operators.h"
#include "common/tonemap/tonemap.h"

#define OPERATOR(name) &tonemap_##name,
static const struct tonemap_operator *const operators[] = {TONEMAP_OPERATORS(OPERATOR)};

#define ROW(o, ...) SETTING_ROW(tonemap_settings, __VA_ARGS__)
const struct setting look_rows[LOOK_COUNT] = {LOOK_SETTINGS(ROW, )};

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

const char *const *tonemap_choices(const char *name, const char *parameter)
{
    const struct tonemap_operator *op = tonemap_find(name);

    for (size_t i = 0; op && i < op->parameter_count; i++)
        if (op->parameters[i].kind == TONEMAP_CHOICE && strcmp(op->parameters[i].name, parameter) == 0)
            return op->parameters[i].choices;
    return NULL;
}

const char *tonemap_choice_word(const char *name, const char *parameter, double value)
{
    const char *const *words = tonemap_choices(name, parameter);

    for (size_t i = 0; words && words[i]; i++)
        if ((double)i == value)
            return words[i];
    return NULL;
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
    for (int i = 0; i < LOOK_COUNT; i++)
        setting_reset(&look_rows[i], s);
    s->op = tonemap_find(name);
    if (!s->op) {
        char known[512] = "", hint[GUESS_HINT_SIZE];
        struct guess guess = {.word = name};

        for (size_t i = 0; i < sizeof operators / sizeof *operators; i++) {
            add_word(known, sizeof known, operators[i]->name);
            guess_try(&guess, operators[i]->name);
        }
        return error_set(err, STATUS_ERR_INPUT, "no tone mapping operator is called \"%.64s\"%s %s: %s", name,
                         guess.nearest ? guess_hint(hint, &guess) : ";", guess.nearest ? "There are" : "there are", known);
    }
    for (size_t i = 0; i < s->op->parameter_count; i++)
        s->values[i] = s->op->parameters[i].preset;
    return STATUS_OK;
}

/* The parameter's number; ERR_INPUT lists the existing ones. */
static status find_parameter(const struct tonemap_settings *s, const char *name, size_t *at, struct error *err)
{
    char known[512] = "";

    for (*at = 0; *at < s->op->parameter_count; ++*at) {
        if (strcmp(s->op->parameters[*at].name, name) == 0)
            return STATUS_OK;
        add_word(known, sizeof known, s->op->parameters[*at].name);
    }
    return error_set(err, STATUS_ERR_INPUT, "the operator %s has no parameter \"%.64s\"; its parameters: %s",
                     s->op->name, name, known[0] ? known : "none");
}

status tonemap_settings_set(struct tonemap_settings *s, const char *parameter, double value, struct error *err)
{
    const struct tonemap_parameter *p;
    size_t at;
    TRY(find_parameter(s, parameter, &at, err));
    p = &s->op->parameters[at];
    if (!(value >= p->min && value <= p->max))
        return error_set(err, STATUS_ERR_INPUT, "%s's %s must be from %g to %g, and is %g", s->op->name, p->name,
                         p->min, p->max, value);
    if (p->kind != TONEMAP_NUMBER && value != floor(value))
        return error_set(err, STATUS_ERR_INPUT, "%s's %s must be a whole number, and is %g", s->op->name, p->name,
                         value);
    s->values[at] = value;
    return STATUS_OK;
}

status tonemap_settings_set_text(struct tonemap_settings *s, const char *parameter, const char *text, struct error *err)
{
    const struct tonemap_parameter *p;
    char known[512] = "", *end;
    double value;
    size_t at;
    TRY(find_parameter(s, parameter, &at, err));
    p = &s->op->parameters[at];
    for (size_t i = 0; p->kind == TONEMAP_CHOICE && p->choices[i]; i++) {
        if (strcmp(p->choices[i], text) == 0) {
            s->values[at] = (double)i;
            return STATUS_OK;
        }
        add_word(known, sizeof known, p->choices[i]);
    }
    if (p->kind == TONEMAP_CHOICE)
        return error_set(err, STATUS_ERR_INPUT, "%s's %s cannot be \"%.64s\"; it is one of: %s", s->op->name, p->name,
                         text, known);
    value = strtod(text, &end);
    if (end == text || *end != 0)
        return error_set(err, STATUS_ERR_INPUT, "%s's %s: \"%.64s\" is not a number", s->op->name, p->name, text);
    return tonemap_settings_set(s, parameter, value, err);
}

status tonemap_settings_validate(const struct tonemap_settings *s, struct error *err)
{
    for (int i = 0; i < LOOK_COUNT; i++)
        TRY(setting_check(&look_rows[i], s, err));
    if (s->has_file && !s->op->file_load)
        return error_set(err, STATUS_ERR_INPUT, "the operator %s takes no file", s->op->name);
    if (!s->has_file && s->op->file_required)
        return error_set(err, STATUS_ERR_INPUT, "the operator %s needs a file: %s", s->op->name, s->op->file_help);
    return STATUS_OK;
}
