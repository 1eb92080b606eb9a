/* setting: one row of a table of settings (settings.h), and what can be done with any: functions of the row and of the
 * struct that holds its member. */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/base/status.h"
#include "common/schema/choices.h"

enum setting_kind {
    SETTING_KIND_NUMBER, /* float or double */
    SETTING_KIND_WHOLE,  /* uint32_t or uint64_t */
    SETTING_KIND_CHOICE, /* an enum of choices.h */
    SETTING_KIND_SWITCH, /* int: 1 is off */
    SETTING_KIND_DURATION, /* uint64_t: milliseconds */
    SETTING_KIND_SET,    /* uint32_t or uint64_t: a bit for each word of a choice */
    SETTING_KIND_OWN     /* an option's text that code of its own reads: no function here does anything with it */
};
enum setting_shown { SETTING_SHOWN_ALWAYS, SETTING_SHOWN_OWN_LINE, SETTING_SHOWN_LISTED };

struct setting {
    const char *name; /* of the member, and of the message's field */
    enum setting_kind kind;
    size_t offset, bytes; /* of the member */
    double initial, least, most;
    enum setting_shown shown;
    const char *option, *placeholder; /* NULL: it has none */
    const char *attribute;            /* "azulejo:maxDepth"; NULL: none */
    const char *help;                 /* of the option */
    const char *says;                 /* for people, "light choice"; NULL: the option */
    enum choice_name choice;          /* of a CHOICE or SET */
    const char *words; /* what the option takes, "a|b", in the order in which people read them; NULL: others */
};

/* A row, for a table of the members of `record`. */
#define SETTING_ROW(record, KIND, type, member, preset, from, to, SHOWN, header, argument, value, text, ...)           \
    {.name = #member, .kind = SETTING_KIND_##KIND, .offset = offsetof(struct record, member), .bytes = sizeof(type),   \
     .initial = (double)(preset), .least = (double)(from), .most = (double)(to), .shown = SETTING_SHOWN_##SHOWN,       \
     .option = argument, .placeholder = value, .attribute = header, .help = text, __VA_ARGS__},
#define OPTION_ROW(o, member, argument, value, text, ...)                                                              \
    {.name = #member, .kind = SETTING_KIND_OWN, .shown = SETTING_SHOWN_OWN_LINE, .option = argument,                   \
     .placeholder = value, .help = text, __VA_ARGS__},
#define CHOICE_OF(NAME, ROWS) .choice = CHOICE_##NAME, .words = CHOICE_WORDS(ROWS)

void setting_reset(const struct setting *row, void *record);
/* A NUMBER that is 0 and cannot be, as one that an older message has not: the default. */
void setting_default_absent(const struct setting *row, void *record);
int setting_is_default(const struct setting *row, const void *record);
/* Is it in the header, and in the command there? */
int setting_is_told(const struct setting *row, const void *record);
/* Is it a number there? Not a seed, which doubles cannot hold. */
int setting_is_number(const struct setting *row);
int setting_equal(const struct setting *row, const void *a, const void *b); /* by value */

/* As the option takes it: "0.1", "12", "sobol", "off", "caustics,fog". Returns `out`. */
enum { SETTING_TEXT_SIZE = 1024 /* holds any set */ };
const char *setting_text(const struct setting *row, const void *record, char out[SETTING_TEXT_SIZE]);
double setting_number(const struct setting *row, const void *record);
/* The names of a set's bits, "a,b". Returns `out`. */
const char *setting_set_text(enum choice_name choice, uint64_t set, char out[SETTING_TEXT_SIZE]);

/* ERR_INPUT names the setting, its value and its range. */
status setting_check(const struct setting *row, const void *record, struct error *err) MUST_CHECK;
/* From the option's text; a SET gains the words' bits. ERR_USAGE. */
status setting_parse(const struct setting *row, const char *text, void *record, struct error *err) MUST_CHECK;
