/* azulejo log: what happened to a job, when, and who did it. */
#include <inttypes.h>
#include <poll.h>
#include <stdio.h>

#include "client/commands/command.h"
#include "client/farm/job_info.h"
#include "client/farm/reconnect.h"
#include "client/farm/signals.h"
#include "client/terminal/format.h"
#include "client/terminal/parse.h"
#include "protocol/message.h"

enum { FOLLOW_MS = 500 };

struct job_log {
    uint64_t job, after;
    int json, final;
};

static status print_event(const Azulejo__Wire__JobEvent *e, int json, struct error *err)
{
    char when[FORMAT_SIZE], who[160], text[512];

    if (json)
        return json_print_line(json_pack("{s:I, s:I, s:o, s:b, s:o}", "seq", (json_int_t)e->seq,
                                         "at", (json_int_t)e->at, "who", json_text(e->who),
                                         "from_worker", (int)e->from_worker, "text",
                                         json_text(e->text)),
                               err);
    printf("%s  %s%s: %s\n", format_time(when, e->at), e->from_worker ? "worker " : "",
           message_text(who, sizeof who, e->who), message_text(text, sizeof text, e->text));
    return STATUS_OK;
}

/* Print what is new. */
static status print_new(struct connection *c, struct job_log *log, struct error *err)
{
    Azulejo__Wire__Envelope question = AZULEJO__WIRE__ENVELOPE__INIT, *answer = NULL;
    Azulejo__Wire__JobLogGet get = AZULEJO__WIRE__JOB_LOG_GET__INIT;
    status result;

    get.job = log->job;
    get.after = log->after;
    question.body_case = AZULEJO__WIRE__ENVELOPE__BODY_JOB_LOG_GET;
    question.job_log_get = &get;
    result = connection_ask(c, &question, AZULEJO__WIRE__ENVELOPE__BODY_JOB_LOG, &answer, err);
    if (result != STATUS_OK)
        return result;
    for (size_t i = 0; i < answer->job_log->n_events && result == STATUS_OK; i++) {
        result = print_event(answer->job_log->events[i], log->json, err);
        log->after = answer->job_log->events[i]->seq;
    }
    log->final = job_state_is_final(answer->job_log->state);
    message_free(answer);
    fflush(stdout);
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

static status follow(struct connection **c, const struct reconnect *again, struct job_log *log,
                     struct error *err)
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

static status run(const struct command *command, int argc, char *const *argv, int *exit_code,
                  struct error *err)
{
    struct connection_options where = CONNECTION_OPTIONS_INIT;
    struct reconnect again = {.patience_s = RECONNECT_DEFAULT_S};
    struct job_log log = {0};
    int follows = 0;
    const struct option table[] = {
        {"follow", 'f', OPTION_FLAG, &follows, NULL, "print what is new until the job ends", 0, 0, NULL},
        {"json", 0, OPTION_FLAG, &log.json, NULL, "print JSON, an object a line", 0, 0, NULL},
        RECONNECT_OPTION_ROW(again.patience_s),
        CONNECTION_OPTION_ROWS(where),
        {0},
    };
    struct connection *connection = NULL;
    status result =
        command_open_job(command, table, argc, argv, &where, &log.job, &connection, err);

    (void)exit_code;
    again.where = where;
    if (result == STATUS_OK && connection)
        result = follows ? follow(&connection, &again, &log, err) : print_new(connection, &log, err);
    connection_close(connection);
    return result;
}

const struct command command_log = {
    .name = "log",
    .group = COMMAND_JOBS,
    .usage = "azulejo log JOB [OPTION]...",
    .summary = "print what happened to a job, and who did it",
    .description =
        "Print a job's log: when it was submitted, ran, waited and ended, what people did to it, and the last\n"
        "lines of workers about it. The coordinator keeps the last 1000 events and 64 lines.",
    .run = run,
};
