/* azulejo resume: put a parked job back into the queue. */
#include <inttypes.h>
#include <stdio.h>

#include "client/commands/command.h"
#include "client/farm/job_info.h"
#include "protocol/message.h"

static status resume(struct connection *c, uint64_t job, int json, struct error *err)
{
    Azulejo__Wire__Envelope envelope = AZULEJO__WIRE__ENVELOPE__INIT;
    Azulejo__Wire__JobResume body = AZULEJO__WIRE__JOB_RESUME__INIT;
    Azulejo__Wire__Envelope *answer = NULL;
    const Azulejo__Wire__JobInfo *info;
    status result;

    body.job = job;
    envelope.body_case = AZULEJO__WIRE__ENVELOPE__BODY_JOB_RESUME;
    envelope.job_resume = &body;
    result = job_ask(c, &envelope, job, &answer, err);
    if (result != STATUS_OK)
        return result;
    info = job_list_find(answer->job_list, job);
    if (json)
        result = json_print(job_info_json(info), err);
    else
        printf("job %" PRIu64 ": %s\n", job, job_state_name(info->state));
    message_free(answer);
    return result;
}

static status run(const struct command *command, int argc, char *const *argv, int *exit_code,
                  struct error *err)
{
    struct connection_options where = CONNECTION_OPTIONS_INIT;
    int json = 0;
    const struct option table[] = {
        {"json", 0, OPTION_FLAG, &json, NULL, "print JSON", 0, 0, NULL},
        CONNECTION_OPTION_ROWS(where),
        {0},
    };
    struct connection *connection = NULL;
    uint64_t job;
    status result = command_open_job(command, table, argc, argv, &where, &job, &connection, err);

    (void)exit_code;
    if (result == STATUS_OK && connection)
        result = resume(connection, job, json, err);
    connection_close(connection);
    return result;
}

const struct command command_resume = {
    .name = "resume",
    .group = COMMAND_JOBS,
    .usage = "azulejo resume JOB [OPTION]...",
    .summary = "put a parked job back into the queue",
    .description =
        "Put a job back into the queue that was parked because workers died while they rendered it.\n"
        "It goes on where it was. 'azulejo show JOB' says why it was parked.",
    .run = run,
};
