/* tonemap_options: the tone mapping on the command line; shared by all commands that have it.
 *
 * A parameter of an operator is given as --tonemap-param NAME=VALUE or directly, as --NAME VALUE. The rows of the
 * direct options are made from the operators' own tables, so that a new operator needs no change here; if a command
 * already has an option of that name, only --tonemap-param sets the parameter.
 */
#pragma once

#include "client/options/setting_option.h"
#include "common/base/buffer.h"
#include "common/cli/options.h"
#include "common/tonemap/tonemap.h"

#define TONEMAP_DEFAULT "reinhard02"

enum {
    TONEMAP_DIRECT_MAX = 64,       /* different names of parameters, of all operators */
    TONEMAP_DIRECT_HELP_SIZE = 512,
    TONEMAP_ROWS_MAX = 160,        /* of a command's table with the direct options */
};

struct tonemap_direct {
    const char *name, *value; /* value NULL: not given */
    char help[TONEMAP_DIRECT_HELP_SIZE];
};

struct tonemap_options {
    const char *tonemap;           /* NULL: TONEMAP_DEFAULT */
    struct option_list parameters; /* NAME=VALUE */
    union setting_said said[LOOK_COUNT];
    const char *file; /* path */
    struct tonemap_direct direct[TONEMAP_DIRECT_MAX];
    size_t direct_count;
};

#define LOOK_ROW(o, name) setting_option(&look_rows[LOOK_##name], &(o).said[LOOK_##name])
/* Rows for a command's table; `o` is a struct tonemap_options. */
#define TONEMAP_OPTION_ROWS(o)                                                                  \
    {"tonemap", 't', OPTION_STRING, &(o).tonemap, "OPERATOR",                                   \
     "the tone mapping operator (default "                                                         \
     TONEMAP_DEFAULT "; 'azulejo tonemap --list' lists all)",                                      \
     0, 0, NULL},                                                                               \
    {"tonemap-param", 'p', OPTION_LIST, &(o).parameters, "NAME=VALUE",                          \
     "a parameter of the operator, a number or a word; may be given several times", 0, 0, NULL}, \
    {"lut", 0, OPTION_STRING, &(o).file, "FILE", "the look-up table of an operator that takes one", \
     0, 0, NULL},                                                                               \
    LOOK_ROW(o, exposure_ev), LOOK_ROW(o, metering), LOOK_ROW(o, metering_percentile), LOOK_ROW(o, white_kelvin), \
    LOOK_ROW(o, denoise)

/* The command's rows with the direct options behind them, under a heading. `o` must stay where it
 * is while the rows are in use. Returns `out`. */
const struct option *tonemap_options_table(struct tonemap_options *o, const struct option *rows,
                                           struct option out[TONEMAP_ROWS_MAX]);

/* Evaluate the options. The operator's file is read, and the operator is tried; `file`, initialised
 * by the caller, gets the bytes (it stays empty without a file). ERR_USAGE for errors on the
 * command line, ERR_INPUT and ERR_LIMIT for a bad file. */
status tonemap_options_check(const struct tonemap_options *o, struct tonemap_settings *out, struct buffer *file,
                             struct error *err) MUST_CHECK;

/* If --key names the farm's key: was the operator's parameter meant? `path` may be NULL. ERR_USAGE. */
status tonemap_key_check(const struct tonemap_settings *s, const char *path, struct error *err) MUST_CHECK;

/* Does the operator have a parameter of that name? (The first `length` bytes of `name`.) */
int tonemap_has_parameter(const struct tonemap_operator *op, const char *name, size_t length);

/* Remove the parameters that the operator does not have. */
void tonemap_options_keep(struct tonemap_options *o, const struct tonemap_operator *op);
