#include "common/cli/options.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/guess.h"

static int choice_is_valid(const char *choices, const char *value)
{
    size_t length = strlen(value);

    while (*choices) {
        size_t part = strcspn(choices, "|");
        if (part == length && memcmp(choices, value, length) == 0)
            return 1;
        choices += part + (choices[part] == '|');
    }
    return 0;
}

status options_size_parse(const char *text, uint64_t *out)
{
    char *end;
    double value;
    double scale = 1;

    value = strtod(text, &end);
    if (end == text || !(value >= 0) || !isfinite(value))
        return STATUS_ERR_USAGE;
    switch (*end) {
    case 'K': case 'k': scale = 1024.0; end++; break;
    case 'M': case 'm': scale = 1024.0 * 1024; end++; break;
    case 'G': case 'g': scale = 1024.0 * 1024 * 1024; end++; break;
    case 'T': case 't': scale = 1024.0 * 1024 * 1024 * 1024; end++; break;
    default: break;
    }
    if (*end != 0 || value * scale > 9e18)
        return STATUS_ERR_USAGE;
    *out = (uint64_t)(value * scale);
    return STATUS_OK;
}

static status option_store(const struct option *o, const char *value, struct error *err)
{
    int ranged = o->min != 0 || o->max != 0;
    char *end;

    switch (o->kind) {
    case OPTION_FLAG: *(int *)o->target = 1; return STATUS_OK;
    case OPTION_STRING: *(const char **)o->target = value; return STATUS_OK;
    case OPTION_INT: {
        long long number;
        errno = 0;
        number = strtoll(value, &end, 10);
        if (end == value || *end || errno == ERANGE)
            return error_set(err, STATUS_ERR_USAGE, "--%s: '%s' is not a whole number", o->name, value);
        if (ranged && ((double)number < o->min || (double)number > o->max))
            return error_set(err, STATUS_ERR_USAGE, "--%s: %lld is outside %.0f..%.0f", o->name, number, o->min,
                             o->max);
        *(int64_t *)o->target = number;
        return STATUS_OK;
    }
    case OPTION_REAL: {
        double number = strtod(value, &end);
        if (end == value || *end || !isfinite(number))
            return error_set(err, STATUS_ERR_USAGE, "--%s: '%s' is not a number", o->name, value);
        if (ranged && (number < o->min || number > o->max))
            return error_set(err, STATUS_ERR_USAGE, "--%s: %g is outside %g..%g", o->name, number, o->min, o->max);
        *(double *)o->target = number;
        return STATUS_OK;
    }
    case OPTION_SIZE:
        if (options_size_parse(value, o->target) != STATUS_OK)
            return error_set(err, STATUS_ERR_USAGE, "--%s: '%s' is not a size (a number with K, M, G or T)", o->name,
                             value);
        return STATUS_OK;
    case OPTION_CHOICE:
        if (!choice_is_valid(o->choices, value))
            return error_set(err, STATUS_ERR_USAGE, "--%s: '%s' is not one of %s", o->name, value, o->choices);
        *(const char **)o->target = value;
        return STATUS_OK;
    case OPTION_LIST: {
        struct option_list *list = o->target;
        if (list->count == OPTIONS_LIST_MAX)
            return error_set(err, STATUS_ERR_USAGE, "--%s: given more than %d times", o->name, OPTIONS_LIST_MAX);
        list->items[list->count++] = value;
        return STATUS_OK;
    }
    case OPTION_GROUP: break;
    }
    return error_set(err, STATUS_ERR_INTERNAL, "--%s: unknown kind of option", o->name);
}

const struct option *option_find(const struct option *table, const char *text, size_t length)
{
    for (const struct option *o = table; o->name; o++)
        if (o->kind != OPTION_GROUP && strlen(o->name) == length && memcmp(o->name, text, length) == 0)
            return o;
    return NULL;
}

static status option_unknown(const struct option *table, const char *word, struct error *err)
{
    const char *at = word[1] == '-' ? word + 2 : "";
    char name[GUESS_WORD_MAX + 1], hint[GUESS_HINT_SIZE];
    struct guess guess = {.word = name, .prefix = "--"};

    snprintf(name, sizeof name, "%.*s", (int)strcspn(at, "="), at);
    for (const struct option *o = table; o->name && *at; o++)
        if (o->kind != OPTION_GROUP)
            guess_try(&guess, o->name);
    return error_set(err, STATUS_ERR_USAGE, "unknown option '%s'%s (--help lists them)", word, guess_hint(hint, &guess));
}

status options_parse(const struct option *table, int argc, char *const *argv, struct positionals *rest,
                     int *help_wanted, struct error *err)
{
    int only_positionals = 0;

    memset(rest, 0, sizeof *rest);
    *help_wanted = 0;
    for (int i = 1; i < argc; i++) {
        const char *word = argv[i];
        const struct option *o = NULL;
        const char *value = NULL;

        if (only_positionals || word[0] != '-' || word[1] == 0) {
            if (rest->count == OPTIONS_POSITIONAL_MAX)
                return error_set(err, STATUS_ERR_USAGE, "more than %d arguments", OPTIONS_POSITIONAL_MAX);
            rest->items[rest->count++] = word;
            continue;
        }
        if (strcmp(word, "--") == 0) {
            only_positionals = 1;
            continue;
        }
        if (strcmp(word, "--help") == 0 || strcmp(word, "-h") == 0) {
            *help_wanted = 1;
            return STATUS_OK;
        }
        if (word[1] == '-') {
            o = option_find(table, word + 2, strcspn(word + 2, "="));
            value = strchr(word, '=');
            if (value)
                value++;
        } else {
            for (o = table; o->name; o++)
                if (o->letter == word[1])
                    break;
            if (!o->name)
                o = NULL;
            else if (word[2])
                value = word + 2 + (word[2] == '=');
        }
        if (!o)
            return option_unknown(table, word, err);
        if (o->kind == OPTION_FLAG) {
            if (value)
                return error_set(err, STATUS_ERR_USAGE, "--%s takes no value", o->name);
        } else if (!value) {
            if (i + 1 >= argc)
                return error_set(err, STATUS_ERR_USAGE, "--%s needs a value (%s)", o->name, o->argument);
            value = argv[++i];
        }
        TRY(option_store(o, value, err));
    }
    return STATUS_OK;
}
