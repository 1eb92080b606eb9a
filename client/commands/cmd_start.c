/* azulejo start: jobs wait no longer for other jobs and for their time. */
#include "client/commands/steer.h"
#include "client/farm/job_info.h"
#include "protocol/message.h"

static status ask(struct connection *c, uint64_t job, const void *options,
                  Azulejo__Wire__Envelope **answer, struct error *err)
{
    Azulejo__Wire__JobStart body = AZULEJO__WIRE__JOB_START__INIT;
    Azulejo__Wire__Envelope question = MESSAGE(JOB_START, job_start, &body);

    (void)options;
    body.job = job;
    return job_ask(c, &question, job, answer, err);
}

static status run(const struct command *command, int argc, char *const *argv, int *exit_code,
                  struct error *err)
{
    static const struct steer_verb verb = {
        .word = "start",
        .past = "started",
        .states = STEER_ACTIVE,
        .ask = ask,
    };

    return steer_run(command, &verb, NULL, NULL, argc, argv, exit_code, err);
}

const struct command command_start = {
    .name = "start",
    .group = COMMAND_JOBS,
    .usage = "azulejo start JOB... [OPTION]...",
    .summary = "let jobs begin that wait for other jobs or for a time",
    .description =
        "Jobs that were submitted with --after or --not-before wait for that no longer. What they --require of\n"
        "workers remains, and a paused job stays paused.",
    .run = run,
};
