/* job_choice: which jobs a verb is for: numbers, names with wildcards, or a filter. */
#ifndef AZULEJO_CLIENT_JOB_CHOICE_H
#define AZULEJO_CLIENT_JOB_CHOICE_H

#include <stddef.h>

#include "client/farm/connection.h"

struct job_choice {
    const char *states;          /* "queued,failed"; NULL: not given */
    int mine;
    int yes;                     /* do not ask */
};
/* The help of --yes, as in JOB_CHOICE_YES_HELP("paused"). */
#define JOB_CHOICE_YES_HELP(past) "do not ask before several jobs are " past
#define JOB_CHOICE_ROWS(c, yes_help)                                                              \
    {"state", 0, OPTION_STRING, &(c).states, "STATE,...",                                         \
     "only jobs in these states, as in queued,failed (without a JOB: all of them)", 0, 0, NULL},  \
    {"mine", 0, OPTION_FLAG, &(c).mine, NULL,                                                     \
     "only jobs that you submitted from this machine (without a JOB: all of them)", 0, 0, NULL},  \
    {"yes", 'y', OPTION_FLAG, &(c).yes, NULL, yes_help, 0, 0, NULL}

/* The chosen jobs, ascending numbers. The infos belong to `answers`. Zero-initialise. */
struct chosen_jobs {
    struct chosen_job {
        uint64_t job;
        const Azulejo__Wire__JobInfo *info; /* NULL: one job by its number, nothing was asked */
    } *items;
    size_t count, capacity;
    Azulejo__Wire__Envelope **answers;
    size_t answer_count, answer_capacity;
    int several;                 /* more than one number was given, or anything else: to be confirmed */
};

/* Check what was typed, before a connection is opened. ERR_USAGE. */
status job_choice_check(const struct job_choice *choice, const struct positionals *rest,
                        struct error *err) MUST_CHECK;
/* Find the jobs. `states`: bits of JobState, to which a filter or a wildcard without --state is
 * limited: those in which the verb does something. ERR_NOT_FOUND: none, or not one of the numbers. */
status job_choice_find(struct connection *c, const struct job_choice *choice,
                       const struct positionals *rest, unsigned states, struct chosen_jobs *out,
                       struct error *err) MUST_CHECK;
void chosen_jobs_release(struct chosen_jobs *jobs);

/* Show what will be done ("pause" 3 jobs) and ask. 0: the answer was no. ERR_USAGE if nobody can be
 * asked. */
status job_choice_confirm(const struct job_choice *choice, const struct chosen_jobs *jobs,
                          const char *verb, int *go_on, struct error *err) MUST_CHECK;

#endif
