/* azulejo watch: follow a job until it ends. */
#include "client/commands/command.h"
#include "client/farm/follow.h"

static status run(const struct command *command, int argc, char *const *argv, int *exit_code,
                  struct error *err)
{
    struct connection_options where = CONNECTION_OPTIONS_INIT;
    struct follow how = {.reconnect_s = RECONNECT_DEFAULT_S};
    const struct option table[] = {
        {"limit", 0, OPTION_REAL, &how.limit_s, "SECONDS",
         "stop watching after this long, with exit status 7; the job continues (default: never)",
         0.01, 1e9, NULL},
        {"workers", 'w', OPTION_FLAG, &how.workers, NULL, "also a line for each worker that renders the job",
         0, 0, NULL},
        {"json", 0, OPTION_FLAG, &how.json, NULL, "print JSON when the job has ended", 0, 0, NULL},
        {"quiet", 'q', OPTION_FLAG, &how.quiet, NULL,
         "only wait; the exit status shows how the job ended", 0, 0, NULL},
        RECONNECT_OPTION_ROW(how.reconnect_s),
        CONNECTION_OPTION_ROWS(where),
        {0},
    };
    struct connection *connection = NULL;
    uint64_t job;
    status result = command_open_job(command, table, argc, argv, &where, &job, &connection, err);

    (void)exit_code;
    how.where = where;
    if (result == STATUS_OK && connection)
        result = follow_job(&connection, job, &how, err);
    connection_close(connection);
    return result;
}

const struct command command_watch = {
    .name = "watch",
    .group = COMMAND_JOBS,
    .usage = "azulejo watch JOB [OPTION]...",
    .summary = "follow a job until it ends",
    .description = "Show a job's name, its time in work and how far it is until it is done, failed or cancelled, then a summary. Ctrl-C leaves\n"
                   "the job alone. A coordinator that goes away is waited for (--reconnect). Exit status 6 when the job failed or\n"
                   "was cancelled.",
    .run = run,
};
