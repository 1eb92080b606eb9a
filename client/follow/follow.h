/* follow: watch a job for a person at a terminal, and report how it ended.
 *
 * Ctrl-C leaves the job alone and says so.
 */
#pragma once

#include "client/link/reconnect.h"
#include "client/follow/watch.h"

struct follow {
    struct connection_options where; /* for another connection when this one is lost */
    double reconnect_s;              /* how long to wait for a coordinator that goes away */
    double limit_s;                  /* how long to follow the job; 0: until it ends */
    int quiet, json;
    watch_update_fn *update; /* NULL: none */
    void *update_user;
    int workers; /* also show who renders it */
};

/* *c is a new connection if the first was lost, and NULL if it could not be replaced.
 * ERR_JOB_FAILED when the job failed or was cancelled; ERR_TIMEOUT after the limit. */
status follow_job(struct connection **c, uint64_t job, const struct follow *how, struct error *err) MUST_CHECK;

/* Only wait until the job has ended; *last is the last JobList, which the caller frees. */
status follow_wait(struct connection **c, uint64_t job, const struct follow *how, Azulejo__Wire__Envelope **last,
                   struct error *err) MUST_CHECK;
