/* azulejo resume: put paused and parked jobs back into the queue. */
#include "client/commands/steer.h"
#include "client/farm/job_info.h"

static status ask(struct connection *c, uint64_t job, const void *options,
                  Azulejo__Wire__Envelope **answer, struct error *err)
{
    Azulejo__Wire__Envelope question = AZULEJO__WIRE__ENVELOPE__INIT;
    Azulejo__Wire__JobResume body = AZULEJO__WIRE__JOB_RESUME__INIT;

    (void)options;
    body.job = job;
    question.body_case = AZULEJO__WIRE__ENVELOPE__BODY_JOB_RESUME;
    question.job_resume = &body;
    return job_ask(c, &question, job, answer, err);
}

static status run(const struct command *command, int argc, char *const *argv, int *exit_code,
                  struct error *err)
{
    static const struct steer_verb verb = {
        .word = "resume",
        .states = STEER_STATE(PAUSED) | STEER_STATE(PARKED),
        .ask = ask,
    };
    struct connection_options where = CONNECTION_OPTIONS_INIT;
    struct job_choice choice = {0};
    int json = 0;
    const struct option table[] = {
        JOB_CHOICE_ROWS(choice, "resumed"),
        {"json", 0, OPTION_FLAG, &json, NULL, "print JSON", 0, 0, NULL},
        CONNECTION_OPTION_ROWS(where),
        {0},
    };

    return steer_run(command, table, argc, argv, &verb, &choice, &where, NULL, &json, exit_code, err);
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
