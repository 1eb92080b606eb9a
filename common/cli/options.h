/* options: command lines, from a table.
 *
 * Each program or command has one const table; --help is printed from the same table, so options
 * and documentation agree. `--name value` and `--name=value` are both accepted; `--` ends the
 * options; a repeated option overwrites (OPTION_LIST appends).
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/base/status.h"

enum {
    OPTIONS_POSITIONAL_MAX = 1024,
    OPTIONS_LIST_MAX = 64,
    OPTIONS_PLAIN_MAX = 24, /* a table with more options is shown in groups, where there are any */
};

enum option_kind {
    OPTION_FLAG,   /* int *: 1 when given */
    OPTION_STRING, /* const char **: points into argv */
    OPTION_INT,    /* int64_t *: min..max checked */
    OPTION_REAL,   /* double *: min..max checked, finite */
    OPTION_SIZE,   /* uint64_t *: bytes, suffix K, M, G or T (powers of 1024) */
    OPTION_CHOICE, /* const char **: one of `choices` ("a|b|c"), points into argv */
    OPTION_LIST,   /* struct option_list *: every occurrence is kept */
    OPTION_GROUP,  /* no option: `help` is the title above the rows that follow, with its colon; the name is "" */
};

struct option_list {
    const char *items[OPTIONS_LIST_MAX];
    size_t count;
};

struct option {
    const char *name; /* long name without dashes */
    char letter;      /* short name or 0 */
    enum option_kind kind;
    void *target;
    const char *argument; /* the argument's name in the help, NULL for a flag */
    const char *help;     /* one sentence; say the default and the unit */
    double min, max;      /* for OPTION_INT and OPTION_REAL; both 0: unchecked */
    const char *choices;  /* for OPTION_CHOICE */
};

struct positionals {
    const char *items[OPTIONS_POSITIONAL_MAX];
    size_t count;
};

/* Parse argv[1..]. ERR_USAGE with a sentence that names the option and the remedy.
 * `table` ends with a row whose name is NULL. "--help" sets *help_wanted and stops. */
status options_parse(const struct option *table, int argc, char *const *argv, struct positionals *rest,
                     int *help_wanted, struct error *err) MUST_CHECK;

/* The table's row of this name; NULL: there is none. */
const struct option *option_find(const struct option *table, const char *name, size_t bytes);

/* A number of bytes, with or without K, M, G or T, as OPTION_SIZE takes it. ERR_USAGE, without a text. */
status options_size_parse(const char *text, uint64_t *out) MUST_CHECK;

/* Print "usage: ...", the description and the table to standard output, in lines that fit the terminal; without one
 * COLUMNS, else 80 columns. */
void options_print_help(const char *usage, const char *description, const struct option *table);

/* Print a text and end the line: it has `indent` columns already, and so will the others; as wide as options_print_help's. */
void options_print_words(const char *text, size_t indent);

/* How a long table is shown: title and names, with spaces between, in this order; the group with no names has what
 * stands in no other. Ends with a title that is NULL. --help describes the first group and names the rest. */
struct option_group {
    const char *title, *names;
};
void options_group_help(const struct option_group *groups);
/* From now on describe all groups. */
void options_want_whole_help(void);

/* From now on give the tables to `take` instead of printing them (shells' completion is made from them);
 * NULL: print again. */
typedef void options_take_fn(void *user, const char *usage, const struct option *table);
void options_take_help(options_take_fn *take, void *user);
