/* steer: the verbs that change jobs, for one job or many. A command gives a struct steer_verb and its own options; the
 * rest is common: the command line, choosing, confirming, doing it job by job, reporting.
 */
#pragma once

#include "client/commands/command.h"
#include "client/farm/job_choice.h"

/* Wait, and replace *answer by a later one. On failure it may be NULL. */
typedef status steer_settle(struct connection *c, uint64_t job, Azulejo__Wire__Envelope **answer, struct error *err);

struct steer_verb {
    const struct job_verb *verb;
    const char *word, *past; /* where they are not the verb's: "prune", "pruned" */
    /* Check the verb's own options before a connection is opened, and complete the choice from them: choice->verb is
     * the one that jobs must offer. ERR_USAGE. NULL: nothing to check. */
    status (*check)(void *options, struct job_choice *choice, struct error *err);
    /* Ask the coordinator to do it to one job; *answer is a JobList with the job, which the caller
     * frees with message_free. Errors: job_ask's. */
    status (*ask)(struct connection *c, uint64_t job, const void *options, Azulejo__Wire__Envelope **answer,
                  struct error *err);
    steer_settle *settle;                             /* of one job by its number; NULL: nothing to wait for */
    void (*show)(const Azulejo__Wire__JobInfo *info); /* prints it; NULL: its state, `outcome` and `print` */
    const char **text;                                /* gets the last argument, which is no job; NULL: all are jobs */
    const char *outcome;                              /* printed after "job 3: "; NULL: its state */
    /* The rest of what is printed about one job; NULL: nothing. */
    void (*print)(const void *options);
};

/* Parse the command line and do it. `own`: the verb's rows before the common ones, ended by a row
 * without a name, at most STEER_OWN_MAX; NULL: none. Their targets are in `options`, which `check`,
 * `ask` and `print` get. A failure that is about one job does not stop the others: *exit_code is that of the first.
 * ERR_USAGE, ERR_NOT_FOUND, the connection's errors, or `ask`'s. */
enum { STEER_OWN_MAX = 2 };
status steer_run(const struct command *command, const struct steer_verb *verb, const struct option *own, void *options,
                 int argc, char *const *argv, int *exit_code, struct error *err) MUST_CHECK;

/* The same for a verb of the table; `settle` and `show` as above (cmd_verbs.c). */
status verb_run(const struct command *command, steer_settle *settle, void (*show)(const Azulejo__Wire__JobInfo *info),
                int argc, char *const *argv, int *exit_code, struct error *err) MUST_CHECK;
