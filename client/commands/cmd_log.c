/* azulejo log: what happened to a job, or to all, when, and who did it. */
#include <inttypes.h>
#include <poll.h>
#include <stdio.h>

#include "client/commands/command.h"
#include "client/follow/job_info.h"
#include "client/link/reconnect.h"
#include "client/link/signals.h"
#include "client/terminal/format.h"
#include "client/farm/job_choice.h"
#include "protocol/message.h"

enum { FOLLOW_MS = 500 };

struct job_log {
    uint64_t job, after; /* job 0: all */
    int json, final;
};

static status print_event(const Azulejo__Wire__JobEvent *e, const struct job_log *log, struct error *err)
{
    char when[FORMAT_SIZE], who[160], text[512], job[32] = "";

    if (log->json)
        return json_print_line(json_message(&e->base), err);
    if (!log->job)
        snprintf(job, sizeof job, "job %" PRIu64 "  ", e->job);
    printf("%s  %s%s%s: %s\n", format_time(when, e->at), job, e->from_worker ? "worker " : "",
           message_text(who, sizeof who, e->who), message_text(text, sizeof text, e->text));
    return STATUS_OK;
}

/* Print what is new; of all jobs, `more`: there is more. */
static status print_some(struct connection *c, int *more, struct job_log *log, struct error *err)
{
    Azulejo__Wire__Envelope question = AZULEJO__WIRE__ENVELOPE__INIT, *answer = NULL;
    Azulejo__Wire__JobLogGet get = AZULEJO__WIRE__JOB_LOG_GET__INIT;
    status result = STATUS_OK;

    get.job = log->job;
    get.after = log->after;
    question.body_case = AZULEJO__WIRE__ENVELOPE__BODY_JOB_LOG_GET;
    question.job_log_get = &get;
    TRY(connection_ask(c, &question, AZULEJO__WIRE__ENVELOPE__BODY_JOB_LOG, &answer, err));
    for (size_t i = 0; i < answer->job_log->n_events && result == STATUS_OK; i++) {
        result = print_event(answer->job_log->events[i], log, err);
        log->after = answer->job_log->events[i]->seq;
    }
    log->final = log->job && job_state_ended(answer->job_log->state);
    *more = answer->job_log->more;
    message_free(answer);
    fflush(stdout);
    return result;
}

static status print_new(struct connection *c, struct job_log *log, struct error *err)
{
    int more = 1;
    status result = STATUS_OK;

    while (more && result == STATUS_OK && !signals_stop())
        result = print_some(c, &more, log, err);
    return result;
}

/* Until the next look, or a signal. */
static void wait_a_while(struct connection *c)
{
    struct pollfd wake = {.fd = signals_fd(), .events = POLLIN};

    (void)poll(&wake, 1, FOLLOW_MS);
    signals_drain();
    (void)connection_pump(c, 0);
}

static status follow(struct connection **c, const struct reconnect *again, struct job_log *log, struct error *err)
{
    status result = signals_catch(err);

    while (result == STATUS_OK) {
        result = print_new(*c, log, err);
        if (result == STATUS_OK && (log->final || signals_stop()))
            return STATUS_OK;
        if (result == STATUS_OK)
            wait_a_while(*c);
        else if (reconnect_is_loss(result))
            result = reconnect(c, again, err);
    }
    return result;
}

static status run(const struct command *command, int argc, char *const *argv, int *exit_code UNUSED, struct error *err)
{
    struct connection_options where = CONNECTION_OPTIONS_INIT;
    struct reconnect again = {.patience_s = RECONNECT_DEFAULT_S};
    struct job_log log = {0};
    struct positionals rest;
    int follows = 0, all = 0, done;
    const struct option table[] = {
        {"all", 'a', OPTION_FLAG, &all, NULL, "the logs of all jobs together", 0, 0, NULL},
        {"follow", 'f', OPTION_FLAG, &follows, NULL, "print what is new until the job ends; with --all until it is interrupted", 0, 0, NULL},
        {"json", 0, OPTION_FLAG, &log.json, NULL, "print JSON, an object a line", 0, 0, NULL},
        RECONNECT_OPTION_ROW(again.patience_s),
        CONNECTION_OPTION_ROWS(where),
        {0},
    };
    struct connection *connection = NULL;
    status result = command_parse(command, table, argc, argv, 0, 1, &rest, &done, err);

    where.patience_s = follows ? &again.patience_s : NULL;
    again.where = where;
    if (result != STATUS_OK || done)
        return result;
    if (all == (rest.count > 0))
        result = error_set(err, STATUS_ERR_USAGE, all ? "--all is for all jobs: leave out '%s'" : "name a job, or give --all%s",
                           all ? rest.items[0] : "");
    else if (!all)
        result = job_word_check(rest.items[0], err);
    THEN(result, connection_open_waiting(&connection, &where, err));
    THEN(result, all ? STATUS_OK : job_word_find(connection, rest.items[0], &log.job, err));
    THEN(result, follows ? follow(&connection, &again, &log, err) : print_new(connection, &log, err));
    connection_close(connection);
    return result;
}

const struct command command_log = {
    .name = "log",
    .group = COMMAND_JOBS,
    .usage = "azulejo log JOB|--all [OPTION]...",
    .summary = "print what happened to a job or to all, and who did it",
    .description =
        "Print a job's log: when it was submitted, ran, waited and ended, what people did to it, and the last\n"
        "lines of workers about it; or with --all the logs of all jobs that are listed. The coordinator keeps the last 1000\n"
        "events of a job and 64 lines.",
    .run = run,
};
