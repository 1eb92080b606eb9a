/* command: one row of the command line's table.
 *
 * Every command is one file, cmd_NAME.c, with one const struct command; main.c lists them.
 * `run` gets argv[0] = the command's name and reports nothing itself: the error that it
 * returns is printed, once, by main.
 */
#ifndef AZULEJO_CLIENT_COMMAND_H
#define AZULEJO_CLIENT_COMMAND_H

#include "client/farm/connection.h"
#include "common/base/options.h"
#include "common/base/status.h"

enum command_group { COMMAND_RENDER, COMMAND_JOBS, COMMAND_FARM, COMMAND_PICTURES, COMMAND_GROUPS };

struct command {
    const char *name;
    enum command_group group;
    const char *usage;       /* "azulejo list [OPTION]..." */
    const char *summary;     /* a phrase for the list of commands */
    const char *description; /* for the command's own help */
    status (*run)(const struct command *command, int argc, char *const *argv,
                  int *exit_code, struct error *err);
};

extern const struct command command_accuracy, command_cancel, command_compare, command_debug_pixel, command_develop, command_effects, command_estimate,
    command_extend, command_fetch, command_import, command_keygen, command_list, command_render, command_resume, command_show,
    command_submit, command_tonemap, command_watch, command_workers, command_top, command_start,
    command_pause, command_finish, command_priority, command_retry, command_remove, command_log,
    command_prune, command_gc, command_trace, command_owners, command_completion, command_token, command_webhook;

/* completion completes these. */
void command_completion_of(const struct command *const *commands, size_t count);

/* Parse the command's options and check the number of its arguments. *done is set when --help was
 * given and printed. ERR_USAGE. */
status command_parse(const struct command *command, const struct option *table, int argc,
                     char *const *argv, size_t least, size_t most, struct positionals *rest,
                     int *done, struct error *err) MUST_CHECK;

/* The same for a command whose only argument is a job; also opens the connection that the options
 * put into `where`. *connection is NULL after --help, and on failure. ERR_USAGE, or
 * connection_open's. */
status command_open_job(const struct command *command, const struct option *table, int argc,
                        char *const *argv, const struct connection_options *where, uint64_t *job,
                        struct connection **connection, struct error *err) MUST_CHECK;

#endif
