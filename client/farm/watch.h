/* watch: follow a job until it ends, with a progress line. */
#ifndef AZULEJO_CLIENT_WATCH_H
#define AZULEJO_CLIENT_WATCH_H

#include "client/farm/connection.h"

/* Returns when the job has ended, in whatever state; *last is the last JobList, which the caller
 * frees. ERR_TIMEOUT after deadline_ns (monotonic; 0: none). If the connection's watch function
 * ends the wait (Ctrl-C), its error is returned. */
status watch_job(struct connection *c, uint64_t job, int quiet, uint64_t deadline_ns,
                 Azulejo__Wire__Envelope **last, struct error *err) MUST_CHECK;

#endif
