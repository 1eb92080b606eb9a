/* azulejo watch: follow a job until it ends. */
#include "client/commands/command.h"
#include "client/follow/follow.h"
#include "client/follow/tev.h"

static status run(const struct command *command, int argc, char *const *argv, int *exit_code UNUSED, struct error *err)
{
    struct follow how = {.reconnect_s = RECONNECT_DEFAULT_S};
    struct connection_options where = {.timeout_s = CONNECTION_TIMEOUT_DEFAULT_S, .patience_s = &how.reconnect_s, .quiet = &how.quiet};
    const char *address = NULL;
    const struct option table[] = {
        {"limit", 0, OPTION_REAL, &how.limit_s, "SECONDS",
         "stop watching after this long, with exit status 7; the job continues (default: never)",
         0.01, 1e9, NULL},
        {"workers", 'w', OPTION_FLAG, &how.workers, NULL, "also a line for each worker that renders the job",
         0, 0, NULL},
        {"json", 0, OPTION_FLAG, &how.json, NULL, "print JSON when the job has ended", 0, 0, NULL},
        {"quiet", 'q', OPTION_FLAG, &how.quiet, NULL,
         "only wait; the exit status shows how the job ended", 0, 0, NULL},
        TEV_OPTION_ROW(address),
        RECONNECT_OPTION_ROW(how.reconnect_s),
        CONNECTION_OPTION_ROWS(where),
        {0},
    };
    struct connection *connection = NULL;
    struct tev *tev = NULL;
    uint64_t job;
    status result = command_open_job(command, table, argc, argv, &where, &job, &connection, err);

    how.where = where;
    if (result == STATUS_OK && connection && address)
        result = tev_new(&tev, address, how.quiet, err);
    how.update = tev ? tev_update : NULL;
    how.update_user = tev;
    if (result == STATUS_OK && connection)
        result = follow_job(&connection, job, &how, err);
    tev_free(tev);
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
                   "was cancelled, 9 when its pictures miss the target error.",
    .run = run,
};
