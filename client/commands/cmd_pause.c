/* azulejo pause: stop jobs until they are resumed. */
#include "client/commands/steer.h"
#include "client/farm/job_info.h"

static status ask(struct connection *c, uint64_t job, const void *options,
                  Azulejo__Wire__Envelope **answer, struct error *err)
{
    Azulejo__Wire__Envelope question = AZULEJO__WIRE__ENVELOPE__INIT;
    Azulejo__Wire__JobPause body = AZULEJO__WIRE__JOB_PAUSE__INIT;

    (void)options;
    body.job = job;
    question.body_case = AZULEJO__WIRE__ENVELOPE__BODY_JOB_PAUSE;
    question.job_pause = &body;
    return job_ask(c, &question, job, answer, err);
}

static status run(const struct command *command, int argc, char *const *argv, int *exit_code,
                  struct error *err)
{
    static const struct steer_verb verb = {
        .word = "pause",
        .states = STEER_STATE(QUEUED) | STEER_STATE(RUNNING),
        .ask = ask,
    };
    struct connection_options where = CONNECTION_OPTIONS_INIT;
    struct job_choice choice = {0};
    int json = 0;
    const struct option table[] = {
        JOB_CHOICE_ROWS(choice, "paused"),
        {"json", 0, OPTION_FLAG, &json, NULL, "print JSON", 0, 0, NULL},
        CONNECTION_OPTION_ROWS(where),
        {0},
    };

    return steer_run(command, table, argc, argv, &verb, &choice, &where, NULL, &json, exit_code, err);
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
