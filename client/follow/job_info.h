/* job_info: the coordinator's report of a job, for people. */
#pragma once

#include <stdio.h>

#include "client/link/connection.h"
#include "client/terminal/frame_list.h"
#include "client/terminal/json.h"
#include "common/schema/verbs.h"

/* Send a request about one job (0: all) that is answered by a JobList. ERR_NOT_FOUND if the job is
 * not in the answer. The caller frees the answer; it is NULL after an error. */
status job_ask(struct connection *c, Azulejo__Wire__Envelope *question, uint64_t job, Azulejo__Wire__Envelope **out,
               struct error *err) MUST_CHECK;
/* The same with a plain query. */
status job_query(struct connection *c, uint64_t job, Azulejo__Wire__Envelope **out, struct error *err) MUST_CHECK;

/* The chosen frames of a job that the coordinator knows; count 0: all. It is asked only if there is
 * a choice. ERR_USAGE, and the errors of job_query. */
status frame_choice_of_job(struct connection *c, uint64_t job, const struct frame_choice *choice,
                           struct frame_list *out, struct error *err) MUST_CHECK;

/* Why it waits or how it ended, for people: state_text, with times in local time. Fills `out` and returns it. */
enum { JOB_NOTE_SIZE = 512 };
const char *job_info_note(char out[JOB_NOTE_SIZE], const Azulejo__Wire__JobInfo *job);

/* The one job of a JobList, or NULL. */
const Azulejo__Wire__JobInfo *job_list_find(const Azulejo__Wire__JobList *list, uint64_t job);

/* The summary's lines: the samples rendered, the time taken, the problems. */
void job_info_print_summary(FILE *out, const Azulejo__Wire__JobInfo *job);

/* ERR_JOB_FAILED with the coordinator's text for a job that failed or was cancelled. */
status job_info_verdict(const Azulejo__Wire__JobInfo *job, struct error *err) MUST_CHECK;
/* ERR_INCOMPLETE with the coordinator's text for a job that is done and misses its target error. */
status job_info_missed(const Azulejo__Wire__JobInfo *job, struct error *err) MUST_CHECK;
