/* azulejo retry: go on with jobs that have ended. */
#include "client/commands/steer.h"
#include "client/farm/job_info.h"

static status ask(struct connection *c, uint64_t job, const void *options,
                  Azulejo__Wire__Envelope **answer, struct error *err)
{
    Azulejo__Wire__Envelope question = AZULEJO__WIRE__ENVELOPE__INIT;
    Azulejo__Wire__JobRetry body = AZULEJO__WIRE__JOB_RETRY__INIT;

    struct frame_list frames;
    status result = frame_choice_of_job(c, job, options, &frames, err);

    body.job = job;
    body.frames = frames.items;
    body.n_frames = frames.count;
    question.body_case = AZULEJO__WIRE__ENVELOPE__BODY_JOB_RETRY;
    question.job_retry = &body;
    if (result == STATUS_OK)
        result = job_ask(c, &question, job, answer, err);
    frame_list_free(&frames);
    return result;
}

static status run(const struct command *command, int argc, char *const *argv, int *exit_code,
                  struct error *err)
{
    static const struct steer_verb verb = {
        .word = "retry",
        .states = STEER_STATE(FAILED) | STEER_STATE(CANCELLED),
        .ask = ask,
    };
    struct connection_options where = CONNECTION_OPTIONS_INIT;
    struct job_choice choice = {0};
    struct frame_choice frames = {0};
    struct positionals rest;
    int json = 0, done;
    const struct option table[] = {
        FRAME_CHOICE_ROWS(frames, 'f', "try"),
        JOB_CHOICE_ROWS(choice, "tried again"),
        {"json", 0, OPTION_FLAG, &json, NULL, "print JSON", 0, 0, NULL},
        CONNECTION_OPTION_ROWS(where),
        {0},
    };

    status result = command_parse(command, table, argc, argv, 0, OPTIONS_POSITIONAL_MAX, &rest, &done,
                                  err);

    if (result != STATUS_OK || done)
        return result;
    result = job_choice_check(&choice, &rest, err);
    if (result == STATUS_OK)
        result = frame_choice_check(&frames, err);
    if (result != STATUS_OK)
        return result;
    return steer_jobs(&verb, &choice, &rest, &where, &frames, json, exit_code, err);
}

const struct command command_retry = {
    .name = "retry",
    .group = COMMAND_JOBS,
    .usage = "azulejo retry JOB... [OPTION]...",
    .summary = "go on with jobs that failed or were cancelled",
    .description =
        "Put jobs that have ended back into the queue. Frames that are not done, or that a person cut short, go on\n"
        "with the films that are there, or from the beginning; with --frames these frames, whatever they have.",
    .run = run,
};
