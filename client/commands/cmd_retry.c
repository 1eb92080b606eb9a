/* azulejo retry: go on with jobs that have ended. */
#include "client/commands/steer.h"
#include "client/farm/job_info.h"
#include "protocol/message.h"

static status check(const void *options, struct error *err)
{
    return frame_choice_check(options, err);
}

static status ask(struct connection *c, uint64_t job, const void *options,
                  Azulejo__Wire__Envelope **answer, struct error *err)
{
    Azulejo__Wire__JobRetry body = AZULEJO__WIRE__JOB_RETRY__INIT;
    Azulejo__Wire__Envelope question = MESSAGE(JOB_RETRY, job_retry, &body);
    struct frame_list frames;
    status result = frame_choice_of_job(c, job, options, &frames, err);

    body.job = job;
    body.frames = frames.items;
    body.n_frames = frames.count;
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
        .past = "tried again",
        .states = STEER_STATE(FAILED) | STEER_STATE(CANCELLED),
        .check = check,
        .ask = ask,
    };
    struct frame_choice frames = {0};
    const struct option own[] = {
        FRAME_CHOICE_ROWS(frames, 'f', "try"),
        {0},
    };

    return steer_run(command, &verb, own, &frames, argc, argv, exit_code, err);
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
