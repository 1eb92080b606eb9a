/* azulejo remove: forget jobs that have ended. */
#include "client/commands/steer.h"
#include "client/farm/job_info.h"

static status ask(struct connection *c, uint64_t job, const void *options,
                  Azulejo__Wire__Envelope **answer, struct error *err)
{
    Azulejo__Wire__Envelope question = AZULEJO__WIRE__ENVELOPE__INIT;
    Azulejo__Wire__JobRemove body = AZULEJO__WIRE__JOB_REMOVE__INIT;

    (void)options;
    body.job = job;
    question.body_case = AZULEJO__WIRE__ENVELOPE__BODY_JOB_REMOVE;
    question.job_remove = &body;
    return job_ask(c, &question, job, answer, err);
}

static status run(const struct command *command, int argc, char *const *argv, int *exit_code,
                  struct error *err)
{
    static const struct steer_verb verb = {
        .word = "remove",
        .states = STEER_ENDED,
        .ask = ask,
        .outcome = "removed",
    };
    struct connection_options where = CONNECTION_OPTIONS_INIT;
    struct job_choice choice = {0};
    int json = 0;
    const struct option table[] = {
        JOB_CHOICE_ROWS(choice, "removed"),
        {"json", 0, OPTION_FLAG, &json, NULL, "print JSON", 0, 0, NULL},
        CONNECTION_OPTION_ROWS(where),
        {0},
    };

    return steer_run(command, table, argc, argv, &verb, &choice, &where, NULL, &json, exit_code, err);
}

const struct command command_remove = {
    .name = "remove",
    .group = COMMAND_JOBS,
    .usage = "azulejo remove JOB... [OPTION]...",
    .summary = "forget jobs that have ended, with their pictures",
    .description =
        "Remove jobs that have ended from the coordinator, with their logs, films and pictures. Files that were\n"
        "fetched stay.",
    .run = run,
};
