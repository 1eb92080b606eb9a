/* watch: follow a job until it ends, with a progress line. */
#pragma once

#include "client/link/connection.h"

/* Gets each state of the job, the last one too; an error ends the wait with it. */
typedef status watch_update_fn(void *user, struct connection *c, const Azulejo__Wire__JobInfo *info, struct error *err);

struct watch_how {
    int quiet;
    int named;               /* the line begins with the job's name */
    int workers;             /* a line for each worker that renders it */
    uint64_t deadline_ns;    /* monotonic; 0: none */
    watch_update_fn *update; /* NULL: none */
    void *update_user;
};

/* Returns when the job has ended, in whatever state; *last is the last JobList, which the caller frees. ERR_TIMEOUT
 * after the deadline. If the connection's watch function ends the wait (Ctrl-C), its error is returned. */
status watch_job_as(struct connection *c, uint64_t job, const struct watch_how *how, Azulejo__Wire__Envelope **last,
                    struct error *err) MUST_CHECK;
/* The same, without name, workers and updates. */
status watch_job(struct connection *c, uint64_t job, int quiet, uint64_t deadline_ns, Azulejo__Wire__Envelope **last,
                 struct error *err) MUST_CHECK;
