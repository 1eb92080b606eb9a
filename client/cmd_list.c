/* azulejo list: the farm's jobs. */
#include <inttypes.h>

#include "client/command.h"
#include "client/format.h"
#include "client/job_info.h"
#include "client/table.h"
#include "protocol/message.h"

static const char *const titles[] = {">JOB",   "NAME",  "STATE",  ">FRAMES",  ">DONE",
                                     ">RATE/s", ">LEFT", ">ERROR", ">WORKERS", "SUBMITTED",
                                     "NOTE"};
enum { COLUMNS = sizeof titles / sizeof titles[0] };

static status print_table(const Azulejo__Wire__JobList *list, struct error *err)
{
    struct table table;
    char text[FORMAT_SIZE];
    status result;

    table_init(&table, titles, COLUMNS);
    for (size_t i = 0; i < list->n_jobs; i++) {
        const Azulejo__Wire__JobInfo *job = list->jobs[i];
        int running = job->state == AZULEJO__WIRE__JOB_STATE__JOB_RUNNING;
        table_add(&table, "%" PRIu64, job->job);
        table_add(&table, "%s", job->name);
        table_add(&table, "%s", job_state_name(job->state));
        table_add(&table, "%u/%u", job->frames_done, job->last_frame - job->first_frame + 1);
        table_add(&table, "%.0f %%", job->samples_total ? 100.0 * (double)job->samples_done /
                                                              (double)job->samples_total
                                                        : 0.0);
        table_add(&table, "%s", running ? format_count(text, job->samples_per_second) : "-");
        table_add(&table, "%s", running ? format_duration(text, job->seconds_left) : "-");
        table_add(&table, "%s", format_error(text, job->relative_mse));
        table_add(&table, "%u", job->workers);
        table_add(&table, "%s", format_time(text, job->submitted_at));
        table_add(&table, "%s", job->state_text);
    }
    result = table_print(&table, err);
    table_release(&table);
    return result;
}

static status print_json(const Azulejo__Wire__JobList *list, struct error *err)
{
    json_t *jobs = json_array();

    for (size_t i = 0; i < list->n_jobs; i++)
        json_array_append_new(jobs, job_info_json(list->jobs[i]));
    return json_print(json_pack("{s:o}", "jobs", jobs), err);
}

static status run(const struct command *command, int argc, char *const *argv, int *exit_code,
                  struct error *err)
{
    struct connection_options where = CONNECTION_OPTIONS_INIT;
    int json = 0, done;
    const struct option table[] = {
        {"json", 0, OPTION_FLAG, &json, NULL, "print JSON", 0, 0, NULL},
        CONNECTION_OPTION_ROWS(where),
        {0},
    };
    struct positionals rest;
    struct connection *connection = NULL;
    Azulejo__Wire__Envelope *answer = NULL;
    status result = command_parse(command, table, argc, argv, 0, 0, &rest, &done, err);

    (void)exit_code;
    if (result != STATUS_OK || done)
        return result;
    result = connection_open(&connection, &where, err);
    if (result == STATUS_OK)
        result = job_query(connection, 0, &answer, err);
    if (result == STATUS_OK)
        result = json ? print_json(answer->job_list, err) : print_table(answer->job_list, err);
    message_free(answer);
    connection_close(connection);
    return result;
}

const struct command command_list = {
    .name = "list",
    .group = COMMAND_JOBS,
    .usage = "azulejo list [OPTION]...",
    .summary = "list the jobs",
    .description = "List the farm's jobs: the running and queued ones, and those that have ended.",
    .run = run,
};
