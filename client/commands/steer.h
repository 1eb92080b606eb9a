/* steer: the verbs that change jobs, for one job or many. A command gives a struct steer_verb; the
 * rest is common: choosing, asking, doing it job by job, reporting.
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
    const char *word;            /* "pause" */
    unsigned states;             /* in which it does something: what a filter chooses */
    /* Ask the coordinator to do it to one job; *answer is a JobList with the job. */
    status (*ask)(struct connection *c, uint64_t job, const void *options,
                  Azulejo__Wire__Envelope **answer, struct error *err);
    const char *outcome;         /* printed after "job 3: "; NULL: its state */
    /* The rest of what is printed about one job; NULL: nothing. */
    void (*print)(const Azulejo__Wire__JobInfo *info);
};

/* Do it to the chosen jobs. A failure does not stop the others: *exit_code is the first one's. */
status steer_jobs(const struct steer_verb *verb, const struct job_choice *choice,
                  const struct positionals *rest, const struct connection_options *where,
                  const void *options, int json, int *exit_code, struct error *err) MUST_CHECK;

/* Parse the command line, with at most `most` jobs, and do it. `table` has the rows of `choice` and
 * `where`. `check` is called in between; NULL: none. */
status steer_run(const struct command *command, const struct option *table, int argc,
                 char *const *argv, const struct steer_verb *verb, const struct job_choice *choice,
                 const struct connection_options *where, const void *options, const int *json,
                 int *exit_code, struct error *err) MUST_CHECK;

#endif
