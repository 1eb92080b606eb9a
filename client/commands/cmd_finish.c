/* azulejo finish: end jobs early, with whole pictures. */
#include "client/commands/steer.h"
#include "client/farm/job_info.h"
#include "protocol/message.h"

static status ask(struct connection *c, uint64_t job, const void *options,
                  Azulejo__Wire__Envelope **answer, struct error *err)
{
    Azulejo__Wire__JobFinish body = AZULEJO__WIRE__JOB_FINISH__INIT;
    Azulejo__Wire__Envelope question = MESSAGE(JOB_FINISH, job_finish, &body);

    (void)options;
    body.job = job;
    return job_ask(c, &question, job, answer, err);
}

static status run(const struct command *command, int argc, char *const *argv, int *exit_code,
                  struct error *err)
{
    static const struct steer_verb verb = {
        .word = "finish",
        .past = "finished",
        .states = STEER_STATE(QUEUED) | STEER_STATE(RUNNING) | STEER_STATE(PAUSED),
        .ask = ask,
    };

    return steer_run(command, &verb, NULL, NULL, argc, argv, exit_code, err);
}

const struct command command_finish = {
    .name = "finish",
    .group = COMMAND_JOBS,
    .usage = "azulejo finish JOB... [OPTION]...",
    .summary = "end jobs early, with whole pictures",
    .description =
        "Frames in work complete their first pass, if they have not, and become pictures with the samples that\n"
        "they have. Frames that were not begun stay undone. The jobs are then done, finished early; 'azulejo\n"
        "extend' and 'azulejo retry' go on with them.",
    .run = run,
};
