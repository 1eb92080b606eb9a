/* azulejo pause: stop jobs until they are resumed. */
#include "client/commands/steer.h"
#include "client/farm/job_info.h"
#include "protocol/message.h"

static status ask(struct connection *c, uint64_t job, const void *options,
                  Azulejo__Wire__Envelope **answer, struct error *err)
{
    Azulejo__Wire__JobPause body = AZULEJO__WIRE__JOB_PAUSE__INIT;
    Azulejo__Wire__Envelope question = MESSAGE(JOB_PAUSE, job_pause, &body);

    (void)options;
    body.job = job;
    return job_ask(c, &question, job, answer, err);
}

static status run(const struct command *command, int argc, char *const *argv, int *exit_code,
                  struct error *err)
{
    static const struct steer_verb verb = {
        .word = "pause",
        .past = "paused",
        .states = STEER_STATE(QUEUED) | STEER_STATE(RUNNING),
        .ask = ask,
    };

    return steer_run(command, &verb, NULL, NULL, argc, argv, exit_code, err);
}

const struct command command_pause = {
    .name = "pause",
    .group = COMMAND_JOBS,
    .usage = "azulejo pause JOB... [OPTION]...",
    .summary = "stop jobs until they are resumed",
    .description =
        "Stop rendering jobs. What is rendered stays, and nothing but 'azulejo resume' puts them back into the\n"
        "queue. A JOB is a number or a name, in which * and ? may stand for anything.",
    .run = run,
};
