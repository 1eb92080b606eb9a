/* azulejo cancel: end jobs. */
#include <inttypes.h>
#include <stdio.h>

#include "client/farm/cancel.h"
#include "client/commands/steer.h"
#include "client/terminal/parse.h"
#include "client/farm/cut_frame.h"
#include "client/farm/job_info.h"
#include "client/farm/signals.h"
#include "client/farm/watch.h"
#include "common/base/clock.h"
#include "protocol/message.h"

/* How long to wait for the pictures. They are made even if the wait ends. */
enum { WAIT_LIMIT_MS = 30000 };

static status stop_wanted(void *user, struct error *err)
{
    (void)user;
    if (!signals_stop())
        return STATUS_OK;
    return error_set(err, STATUS_ERR_JOB_FAILED, "detached; the job is still being cancelled");
}

/* Wait until the job has ended, and replace *answer by a later one. */
static status await_end(struct connection *c, uint64_t job, Azulejo__Wire__Envelope **answer,
                        struct error *err)
{
    status result = signals_catch(err);

    if (result != STATUS_OK || job_state_ended(job_list_find((*answer)->job_list, job)->state))
        return result;
    message_free(*answer);
    *answer = NULL;
    connection_set_watch(c, stop_wanted, NULL);
    result = watch_job(c, job, 1, clock_monotonic_ns() + WAIT_LIMIT_MS * NS_PER_MS, answer, err);
    if (result == STATUS_ERR_TIMEOUT)
        result = job_query(c, job, answer, err);
    return result;
}

static void print(const Azulejo__Wire__JobInfo *info)
{
    char text[512];
    const char *why = message_text(text, sizeof text, info->state_text);

    if (info->state == AZULEJO__WIRE__JOB_STATE__JOB_CANCELLED && why[0])
        printf("job %" PRIu64 ": %s", info->job, why); /* it begins with the state */
    else
        printf("job %" PRIu64 ": %s", info->job, job_state_word(info->state));
    if (!job_state_ended(info->state) && why[0])
        printf(": %s", why);
    printf("\n");
    for (size_t i = 0; i < info->n_cut_frames; i++)
        printf("  %s\n", cut_frame_text(text, info, info->cut_frames[i]));
    if (info->frames_done > 0)
        printf("  'azulejo fetch %" PRIu64 "' brings the pictures\n", info->job);
}

static status cancel(struct connection *c, uint64_t job, int discard, int json, struct error *err)
{
    Azulejo__Wire__Envelope *answer = NULL;
    status result = cancel_job(c, job, discard, &answer, err);

    if (result == STATUS_OK)
        result = await_end(c, job, &answer, err);
    if (result == STATUS_OK && json)
        result = json_print(job_info_json(job_list_find(answer->job_list, job)), err);
    else if (result == STATUS_OK)
        print(job_list_find(answer->job_list, job));
    message_free(answer);
    return result;
}

/* One of several jobs: its pictures are not waited for. */
static status ask(struct connection *c, uint64_t job, const void *options,
                  Azulejo__Wire__Envelope **answer, struct error *err)
{
    return cancel_job(c, job, *(const int *)options, answer, err);
}

/* A single job by its number. */
static int is_one(const struct positionals *rest, const struct job_choice *choice, uint64_t *job)
{
    struct error ignored;

    return rest->count == 1 && !choice->states && !choice->mine &&
           parse_job(rest->items[0], job, &ignored) == STATUS_OK;
}

status cancel_command(const struct command *command, int argc, char *const *argv, int *exit_code,
                      struct error *err)
{
    static const struct steer_verb verb = {.verb = &job_verbs[VERB_CANCEL], .ask = ask};
    struct connection_options where = CONNECTION_OPTIONS_INIT;
    struct job_choice choice = {0};
    int discard = 0, json = 0, done;
    const struct option table[] = {
        JOB_CHOICE_ROWS(choice, JOB_CHOICE_YES_HELP("cancelled")),
        {"discard", 0, OPTION_FLAG, &discard, NULL,
         "discard the samples of unfinished frames instead of making pictures of them", 0, 0, NULL},
        {"json", 0, OPTION_FLAG, &json, NULL, "print JSON", 0, 0, NULL},
        CONNECTION_OPTION_ROWS(where),
        {0},
    };
    struct connection *connection = NULL;
    struct positionals rest;
    uint64_t job;
    status result = command_parse(command, table, argc, argv, 0, OPTIONS_POSITIONAL_MAX, &rest, &done,
                                  err);

    if (result != STATUS_OK || done)
        return result;
    choice.verb = &job_verbs[discard ? VERB_DISCARD : VERB_CANCEL];
    result = job_choice_check(&choice, &rest, err);
    if (result == STATUS_OK && !is_one(&rest, &choice, &job))
        return steer_jobs(&verb, &choice, &rest, &where, &discard, json, exit_code, err);
    if (result == STATUS_OK)
        result = connection_open(&connection, &where, err);
    if (result == STATUS_OK)
        result = cancel(connection, job, discard, json, err);
    connection_close(connection);
    return result;
}
