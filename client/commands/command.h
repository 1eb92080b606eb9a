/* command: one row of the command line's table.
 *
 * Every command is one file, cmd_NAME.c, with one const struct command; main.c lists them. `run` gets argv[0] = the
 * command's name and reports nothing itself: the error that it returns is printed, once, by main.
 */
#pragma once

#include "client/link/connection.h"
#include "common/cli/options.h"
#include "common/base/status.h"
#include "common/schema/verbs.h"

enum command_group { COMMAND_RENDER, COMMAND_JOBS, COMMAND_FARM, COMMAND_PICTURES, COMMAND_GROUPS };

struct command {
    const char *name;
    enum command_group group;
    const char *usage;       /* "azulejo list [OPTION]..." */
    const char *summary;     /* a phrase for the list of commands */
    const char *description; /* for the command's own help */
    status (*run)(const struct command *command, int argc, char *const *argv, int *exit_code, struct error *err);
};

typedef status command_run(const struct command *command, int argc, char *const *argv, int *exit_code,
                           struct error *err);

extern const struct command command_accuracy, command_compare, command_completion, command_debug_pixel, command_distrust, command_effects,
    command_estimate, command_fetch, command_gc, command_import, command_key, command_keygen, command_list, command_log,
    command_owners, command_prune, command_render, command_show, command_submit, command_token, command_tonemap,
    command_top, command_trace, command_verify, command_watch, command_workers;
/* The verbs (cmd_verbs.c), and the functions of those that have a file of their own. */
#define VERB(NAME, name, ...) extern const struct command command_##name;
#define VARIANT(...)
JOB_VERBS(VERB, VARIANT)
#undef VERB
#undef VARIANT
command_run cancel_command, develop_command, extend_command;

/* cmd_keygen.c: print the key's file, or write it as a new one. */
status command_write_key(const struct farm_key *key, const char *output, struct error *err) MUST_CHECK;

/* completion completes these. */
void command_completion_of(const struct command *const *commands, size_t count);

/* Parse the command's options and check the number of its arguments. *done is set when --help was
 * given and printed. ERR_USAGE. */
status command_parse(const struct command *command, const struct option *table, int argc, char *const *argv,
                     size_t least, size_t most, struct positionals *rest, int *done, struct error *err) MUST_CHECK;

/* ERR_USAGE: the word is none of "show, drain or block"; which one was meant. */
status command_word_unknown(const char *word, const char *words, struct error *err) MUST_CHECK;

/* As command_parse, for a command whose only argument is a job; also opens the connection that the options put into `where`.
 * *connection is NULL after --help, and on failure. ERR_USAGE, or connection_open's. */
status command_open_job(const struct command *command, const struct option *table, int argc, char *const *argv,
                        const struct connection_options *where, uint64_t *job, struct connection **connection,
                        struct error *err) MUST_CHECK;
