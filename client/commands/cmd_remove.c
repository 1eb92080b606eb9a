/* azulejo remove: forget jobs that have ended. */
#include "client/commands/steer.h"
#include "client/farm/job_info.h"
#include "protocol/message.h"

static status ask(struct connection *c, uint64_t job, const void *options,
                  Azulejo__Wire__Envelope **answer, struct error *err)
{
    Azulejo__Wire__JobRemove body = AZULEJO__WIRE__JOB_REMOVE__INIT;
    Azulejo__Wire__Envelope question = MESSAGE(JOB_REMOVE, job_remove, &body);

    (void)options;
    body.job = job;
    return job_ask(c, &question, job, answer, err);
}

static status run(const struct command *command, int argc, char *const *argv, int *exit_code,
                  struct error *err)
{
    static const struct steer_verb verb = {
        .word = "remove",
        .past = "removed",
        .states = STEER_ENDED,
        .ask = ask,
        .outcome = "removed",
    };

    return steer_run(command, &verb, NULL, NULL, argc, argv, exit_code, err);
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
