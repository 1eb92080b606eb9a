/* steer: the verbs that change jobs, for one job or many. A command gives a struct steer_verb and its
 * own options; the rest is common: the command line, choosing, confirming, doing it job by job,
 * reporting.
 */
#ifndef AZULEJO_CLIENT_STEER_H
#define AZULEJO_CLIENT_STEER_H

#include "client/commands/command.h"
#include "client/farm/job_choice.h"

/* Bits of states. */
#define STEER_STATE(name) (1u << AZULEJO__WIRE__JOB_STATE__JOB_##name)
#define STEER_ACTIVE                                                                            \
    (STEER_STATE(QUEUED) | STEER_STATE(RUNNING) | STEER_STATE(PAUSED) | STEER_STATE(PARKED) |   \
     STEER_STATE(FINISHING) | STEER_STATE(CANCELLING))
#define STEER_ENDED (STEER_STATE(DONE) | STEER_STATE(FAILED) | STEER_STATE(CANCELLED))

struct steer_verb {
    const char *word, *past;     /* "pause", "paused" */
    unsigned states;             /* bits: in which it does something, so what a filter chooses */
    /* Check the verb's own options before a connection is opened: ERR_USAGE, ERR_NO_MEMORY. NULL:
     * nothing to check. */
    status (*check)(const void *options, struct error *err);
    /* Ask the coordinator to do it to one job; *answer is a JobList with the job, which the caller
     * frees with message_free. Errors: job_ask's. */
    status (*ask)(struct connection *c, uint64_t job, const void *options,
                  Azulejo__Wire__Envelope **answer, struct error *err);
    /* Complete the choice from the verb's own options. NULL: nothing to add. */
    status (*choose)(const void *options, struct job_choice *choice, struct error *err);
    const char *outcome;         /* printed after "job 3: "; NULL: its state */
    /* The rest of what is printed about one job; NULL: nothing. */
    void (*print)(const Azulejo__Wire__JobInfo *info);
};

/* Do it to the chosen jobs. A failure that is about one job does not stop the others: *exit_code is
 * that of the first. ERR_USAGE, ERR_NOT_FOUND, ERR_NO_MEMORY, the connection's errors, or `ask`'s. */
status steer_jobs(const struct steer_verb *verb, const struct job_choice *choice,
                  const struct positionals *rest, const struct connection_options *where,
                  const void *options, int json, int *exit_code, struct error *err) MUST_CHECK;

/* Parse the command line and do it. `own`: the verb's rows before the common ones, ended by a row
 * without a name, at most STEER_OWN_MAX; NULL: none. Their targets are in `options`, which `check` and
 * `ask` get. ERR_USAGE, or steer_jobs's. */
enum { STEER_OWN_MAX = 2 };
status steer_run(const struct command *command, const struct steer_verb *verb,
                 const struct option *own, const void *options, int argc, char *const *argv,
                 int *exit_code, struct error *err) MUST_CHECK;

#endif
