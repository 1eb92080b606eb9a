/* watch: follow a job until it ends, with a progress line. */
#ifndef AZULEJO_CLIENT_WATCH_H
#define AZULEJO_CLIENT_WATCH_H

#include "client/farm/connection.h"

/* Returns when the job has ended, in whatever state; *last is the last JobList, which the caller
 * frees. ERR_TIMEOUT after deadline_ns (monotonic; 0: none). If the connection's watch function
 * ends the wait (Ctrl-C), its error is returned. */
status watch_job(struct connection *c, uint64_t job, int quiet, uint64_t deadline_ns,
                 Azulejo__Wire__Envelope **last, struct error *err) MUST_CHECK;

/* Is told each state of the job, the last one too; an error ends the wait with it. */
typedef status watch_update_fn(void *user, struct connection *c,
                               const Azulejo__Wire__JobInfo *info, struct error *err);
/* The same; `update` may be NULL. */
status watch_job_updates(struct connection *c, uint64_t job, int quiet, uint64_t deadline_ns,
                         watch_update_fn *update, void *user, Azulejo__Wire__Envelope **last,
                         struct error *err) MUST_CHECK;

#endif
