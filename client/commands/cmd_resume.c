/* azulejo resume: put paused and parked jobs back into the queue. */
#include "client/commands/steer.h"
#include "client/farm/job_info.h"
#include "protocol/message.h"

static status ask(struct connection *c, uint64_t job, const void *options,
                  Azulejo__Wire__Envelope **answer, struct error *err)
{
    Azulejo__Wire__JobResume body = AZULEJO__WIRE__JOB_RESUME__INIT;
    Azulejo__Wire__Envelope question = MESSAGE(JOB_RESUME, job_resume, &body);

    (void)options;
    body.job = job;
    return job_ask(c, &question, job, answer, err);
}

static status run(const struct command *command, int argc, char *const *argv, int *exit_code,
                  struct error *err)
{
    static const struct steer_verb verb = {
        .word = "resume",
        .past = "resumed",
        .states = STEER_STATE(PAUSED) | STEER_STATE(PARKED),
        .ask = ask,
    };

    return steer_run(command, &verb, NULL, NULL, argc, argv, exit_code, err);
}

const struct command command_resume = {
    .name = "resume",
    .group = COMMAND_JOBS,
    .usage = "azulejo resume JOB... [OPTION]...",
    .summary = "put paused and parked jobs back into the queue",
    .description =
        "Put jobs back into the queue that were paused, or parked because workers died while they rendered them.\n"
        "They go on where they were. 'azulejo show JOB' says why a job was parked.",
    .run = run,
};
