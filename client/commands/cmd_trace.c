/* azulejo trace: when the farm did what for a job. */
#include <inttypes.h>
#include <stdio.h>

#include "client/commands/command.h"
#include "client/farm/trace_file.h"
#include "client/terminal/format.h"
#include "common/system/file.h"

/* What is missing, on standard error. */
static void tell_missing(const struct job_trace *t)
{
    char when[FORMAT_SIZE];

    if (t->lost)
        fprintf(stderr, "azulejo trace: the oldest %" PRIu64 " events of job %" PRIu64 " are no longer kept\n", t->lost,
                t->job);
    if (t->cut)
        fprintf(stderr, "azulejo trace: nothing of job %" PRIu64 " is known from before %s, when the coordinator started\n",
                t->job, format_time(when, t->begun_at));
    else if (t->event_count == 0 && !t->lost)
        fprintf(stderr, "azulejo trace: no result of job %" PRIu64 " has come yet\n", t->job);
}

static status put(const struct job_trace *t, const char *path, struct error *err)
{
    struct buffer text = BUFFER_INIT;
    status s = STATUS_OK;

    job_trace_write(t, &text);
    if (path)
        s = file_write_atomic(path, text.data, text.size, err);
    else
        fwrite(text.data, 1, text.size, stdout);
    buffer_release(&text);
    if (s == STATUS_OK && path)
        printf("%s: %zu units, %zu other events (open it with https://ui.perfetto.dev or chrome://tracing)\n", path,
               t->units, t->event_count - t->units);
    return s;
}

static status run(const struct command *command, int argc, char *const *argv, int *exit_code UNUSED, struct error *err)
{
    struct connection_options where = CONNECTION_OPTIONS_INIT;
    const char *path = NULL;
    const struct option table[] = {
        {"output", 'o', OPTION_STRING, &path, "FILE", "write it there, not to standard output", 0, 0, NULL},
        CONNECTION_OPTION_ROWS(where),
        {0},
    };
    struct connection *connection = NULL;
    struct job_trace trace = {0};
    uint64_t job = 0;
    status result = command_open_job(command, table, argc, argv, &where, &job, &connection, err);

    if (result == STATUS_OK && connection) {
        result = job_trace_get(connection, job, &trace, err);
        connection_close(connection);
        if (result == STATUS_OK) {
            tell_missing(&trace);
            result = put(&trace, path, err);
        }
    }
    job_trace_release(&trace);
    return result;
}

const struct command command_trace = {
    .name = "trace",
    .group = COMMAND_JOBS,
    .usage = "azulejo trace JOB [OPTION]...",
    .summary = "print when each thread of the farm did what for a job",
    .description =
        "Print a job's trace in Chrome's trace format, which https://ui.perfetto.dev and chrome://tracing show:\n"
        "which unit each worker's threads rendered when, and when the coordinator merged, wrote and synced results\n"
        "and made pictures. The coordinator keeps the newest 262,144 events of a job, and none over a restart.",
    .run = run,
};
