/* azulejo priority: serve jobs earlier or later. */
#include <stdio.h>

#include "client/commands/steer.h"
#include "client/farm/job_info.h"
#include "protocol/message.h"

enum { PRIORITY_MAX = 1000000, NOT_GIVEN = PRIORITY_MAX + 1 };

static status check(const void *options, struct error *err)
{
    if (*(const int64_t *)options == NOT_GIVEN)
        return error_set(err, STATUS_ERR_USAGE, "which priority? Give --to N");
    return STATUS_OK;
}

static status ask(struct connection *c, uint64_t job, const void *options,
                  Azulejo__Wire__Envelope **answer, struct error *err)
{
    Azulejo__Wire__JobPriority body = AZULEJO__WIRE__JOB_PRIORITY__INIT;
    Azulejo__Wire__Envelope question = MESSAGE(JOB_PRIORITY, job_priority, &body);

    body.job = job;
    body.priority = (int32_t)*(const int64_t *)options;
    return job_ask(c, &question, job, answer, err);
}

static void print(const Azulejo__Wire__JobInfo *info)
{
    printf("  priority %d\n", info->priority);
}

static status run(const struct command *command, int argc, char *const *argv, int *exit_code,
                  struct error *err)
{
    static const struct steer_verb verb = {
        .word = "change the priority of",
        .past = "changed",
        .states = STEER_ACTIVE,
        .check = check,
        .ask = ask,
        .print = print,
    };
    int64_t to = NOT_GIVEN;
    const struct option own[] = {
        {"to", 0, OPTION_INT, &to, "N", "the new priority: jobs with a higher number go first",
         -PRIORITY_MAX, PRIORITY_MAX, NULL},
        {0},
    };

    return steer_run(command, &verb, own, &to, argc, argv, exit_code, err);
}

const struct command command_priority = {
    .name = "priority",
    .group = COMMAND_JOBS,
    .usage = "azulejo priority JOB... --to N [OPTION]...",
    .summary = "serve jobs earlier or later",
    .description =
        "Change the priority of jobs. Jobs with a higher number go first; what is being rendered is not stopped.",
    .run = run,
};
