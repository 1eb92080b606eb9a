/* azulejo distrust: what a worker rendered is rendered again. */
#include <inttypes.h>
#include <stdio.h>
#include <time.h>

#include "client/commands/command.h"
#include "client/terminal/json.h"
#include "client/terminal/moment.h"
#include "protocol/message.h"

/* "0-3,7" */
static void print_frames(const Azulejo__Wire__DistrustFrames *group)
{
    for (size_t i = 0, end; i < group->n_frames; i = end) {
        for (end = i + 1; end < group->n_frames && group->frames[end] == group->frames[end - 1] + 1; end++)
            ;
        printf("%s%u", i ? "," : "", group->frames[i]);
        if (end - i > 1)
            printf("-%u", group->frames[end - 1]);
    }
}

static void print_group(const Azulejo__Wire__DistrustFrames *group)
{
    char name[MESSAGE_TEXT_MAX];

    printf("job %" PRIu64 " (%s), frame%s ", group->job, message_text(name, sizeof name, group->name),
           group->n_frames == 1 ? "" : "s");
    print_frames(group);
    switch (group->fate) {
    case AZULEJO__WIRE__DISTRUST_FATE__DISTRUST_AGAIN: printf(": rendered again without its samples\n"); break;
    case AZULEJO__WIRE__DISTRUST_FATE__DISTRUST_NO_FILM:
        printf(": no film was kept, so the pictures stay as they are; to render them again: azulejo retry %" PRIu64
               " --frames ",
               group->job);
        print_frames(group);
        printf("\n");
        break;
    default: printf(": rendered by another release, so the pictures stay as they are; submit the scene again\n"); break;
    }
}

static void print_report(const Azulejo__Wire__DistrustReport *report)
{
    char name[MESSAGE_TEXT_MAX];

    printf("worker %s: blocked, and what it delivered is not believed\n", message_text(name, sizeof name, report->worker));
    for (size_t i = 0; i < report->n_jobs; i++)
        print_group(report->jobs[i]);
    if (report->again + report->left == 0)
        printf("no picture has samples of it\n");
    else
        printf("%" PRIu64 " frame%s rendered again, %" PRIu64 " left as they are\n", report->again,
               report->again == 1 ? "" : "s", report->left);
}

static status run(const struct command *command, int argc, char *const *argv, int *exit_code, struct error *err)
{
    struct connection_options where = CONNECTION_OPTIONS_INIT;
    const char *since = NULL;
    int json = 0, done;
    const struct option table[] = {
        {"since", 0, OPTION_STRING, &since, "TIME",
         "frames that were done before that stay as they are: a date, a time of day, or a length of time ago as in 2h", 0, 0,
         NULL},
        {"json", 0, OPTION_FLAG, &json, NULL, "print JSON", 0, 0, NULL},
        CONNECTION_OPTION_ROWS(where),
        {0},
    };
    Azulejo__Wire__WorkerDistrust body = AZULEJO__WIRE__WORKER_DISTRUST__INIT;
    Azulejo__Wire__Envelope question = MESSAGE(WORKER_DISTRUST, worker_distrust, &body), *answer = NULL;
    struct positionals rest;
    struct connection *c = NULL;
    status result = command_parse(command, table, argc, argv, 1, 1, &rest, &done, err);

    if (result != STATUS_OK || done)
        return result;
    if (since)
        result = moment_parse_past("--since", since, (int64_t)time(NULL), &body.since, err);
    body.name = (char *)(uintptr_t)rest.items[0];
    THEN(result, connection_open(&c, &where, err));
    THEN(result, connection_ask(c, &question, AZULEJO__WIRE__ENVELOPE__BODY_DISTRUST_REPORT, &answer, err));
    if (result == STATUS_OK && json)
        result = json_print(json_message(&answer->distrust_report->base), err);
    else if (result == STATUS_OK)
        print_report(answer->distrust_report);
    if (result == STATUS_OK && answer->distrust_report->left > 0)
        *exit_code = status_exit_code(STATUS_ERR_INCOMPLETE);
    message_free(answer);
    connection_close(c);
    return result;
}

const struct command command_distrust = {
    .name = "distrust",
    .group = COMMAND_FARM,
    .usage = "azulejo distrust WORKER [--since TIME] [OPTION]...",
    .summary = "render again what a worker rendered, and block it",
    .description =
        "Believe no result that the worker of that name has delivered so far, and block it ('azulejo workers unblock'\n"
        "ends only that). Frames that have results of it are rendered again without them, in work or done, as long as\n"
        "their films are kept; the pictures get the bits that they would have had. The others are listed with what\n"
        "renders them again, and the exit status is 9. It may be repeated.",
    .run = run,
};
