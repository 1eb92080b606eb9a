/* job_choice: which jobs a verb is for: numbers, names with wildcards, or a filter. */
#pragma once

#include <stddef.h>

#include "client/link/connection.h"
#include "common/schema/job_needs.h"
#include "common/schema/verbs.h"

struct job_choice {
    const struct job_verb *verb; /* names and filters choose jobs that offer it; NULL: all */
    const char *states;          /* "queued,failed"; NULL: not given */
    int mine;
    int yes;              /* do not ask */
    int64_t ended_before; /* seconds since 1970: only jobs that ended before; 0: not given */
};
/* The help of --yes, as in JOB_CHOICE_YES_HELP("paused"). */
#define JOB_CHOICE_YES_HELP(past) "do not ask before several jobs are " past
#define JOB_CHOICE_ROWS(c, yes_help)                                                              \
    {"state", 0, OPTION_STRING, &(c).states, "STATE,...",                                         \
     "only jobs in these states, as in queued,failed (without a JOB: all of them)", 0, 0, NULL},  \
    {"mine", 0, OPTION_FLAG, &(c).mine, NULL,                                                     \
     "only jobs that you submitted from this machine (without a JOB: all of them)", 0, 0, NULL},  \
    {"yes", 'y', OPTION_FLAG, &(c).yes, NULL, yes_help, 0, 0, NULL}

/* The chosen jobs, ascending numbers. The infos belong to `answers`. Zero-initialise; release with
 * chosen_jobs_release, after a failure, too. */
struct chosen_jobs {
    struct chosen_job {
        uint64_t job;
        const Azulejo__Wire__JobInfo *info; /* NULL: one job by its number, nothing was asked */
    } * items;
    size_t count, capacity;
    Azulejo__Wire__Envelope **answers;
    size_t answer_count, answer_capacity;
    int several; /* more than one number was given, or anything else */
    int asks;    /* to be confirmed: not one job by its number or its whole name */
};

/* Check the command line before a connection is opened. ERR_USAGE: it names no job by any of these, or an unknown
 * state, or a number that is too large. */
status job_choice_check(const struct job_choice *choice, const struct positionals *rest, struct error *err) MUST_CHECK;
/* Find the jobs. A filter or a wildcard without --state is limited to jobs for which the verb does something.
 * ERR_NOT_FOUND: no job matches, or a number is no job's; job_ask's errors. */
status job_choice_find(struct connection *c, const struct job_choice *choice, const struct positionals *rest,
                       struct chosen_jobs *out, struct error *err) MUST_CHECK;
void chosen_jobs_release(struct chosen_jobs *jobs);

/* The same for a command that takes one job, by its number or its name: check the word, and find the job once there is a
 * connection (a number is not asked for). ERR_USAGE: no job is called so, or `text` fits several. ERR_NOT_FOUND. */
status job_word_check(const char *text, struct error *err) MUST_CHECK;
status job_word_find(struct connection *c, const char *text, uint64_t *job, struct error *err) MUST_CHECK;

/* The jobs of --after, "3,walk"; without a connection its words are only checked. ERR_USAGE, ERR_NOT_FOUND. */
status job_needs_find(struct connection *c, const char *after, struct job_needs *out, struct error *err) MUST_CHECK;

/* Print what will be done ("pause" 3 jobs) to standard error and ask if they ask for it, unless --yes was given. *go_on is 0 if the answer was no. ERR_USAGE: standard input is not a terminal. */
status job_choice_confirm(const struct job_choice *choice, const struct chosen_jobs *jobs, const char *verb, int *go_on,
                          struct error *err) MUST_CHECK;
