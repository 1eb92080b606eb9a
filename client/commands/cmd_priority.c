/* azulejo priority: serve jobs earlier or later. */
#include <stdio.h>

#include "client/commands/steer.h"
#include "client/farm/job_info.h"

static status ask(struct connection *c, uint64_t job, const void *options,
                  Azulejo__Wire__Envelope **answer, struct error *err)
{
    Azulejo__Wire__Envelope question = AZULEJO__WIRE__ENVELOPE__INIT;
    Azulejo__Wire__JobPriority body = AZULEJO__WIRE__JOB_PRIORITY__INIT;

    body.job = job;
    body.priority = *(const int32_t *)options;
    question.body_case = AZULEJO__WIRE__ENVELOPE__BODY_JOB_PRIORITY;
    question.job_priority = &body;
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
        .states = STEER_ACTIVE,
        .ask = ask,
        .print = print,
    };
    struct connection_options where = CONNECTION_OPTIONS_INIT;
    struct job_choice choice = {0};
    int64_t to = INT64_MIN;
    int32_t priority;
    struct positionals rest;
    int json = 0, done;
    const struct option table[] = {
        {"to", 0, OPTION_INT, &to, "N", "the new priority: jobs with a higher number go first", -1000000,
         1000000, NULL},
        JOB_CHOICE_ROWS(choice, "changed"),
        {"json", 0, OPTION_FLAG, &json, NULL, "print JSON", 0, 0, NULL},
        CONNECTION_OPTION_ROWS(where),
        {0},
    };

    status result = command_parse(command, table, argc, argv, 0, OPTIONS_POSITIONAL_MAX, &rest, &done,
                                  err);

    if (result != STATUS_OK || done)
        return result;
    result = job_choice_check(&choice, &rest, err);
    if (result == STATUS_OK && to == INT64_MIN)
        return error_set(err, STATUS_ERR_USAGE, "which priority? Give --to N");
    if (result != STATUS_OK)
        return result;
    priority = (int32_t)to;
    return steer_jobs(&verb, &choice, &rest, &where, &priority, json, exit_code, err);
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
