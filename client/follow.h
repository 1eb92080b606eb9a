/* follow: watch a job for a person at a terminal, and tell how it ended.
 *
 * Ctrl-C leaves the job alone and says so.
 */
#ifndef AZULEJO_CLIENT_FOLLOW_H
#define AZULEJO_CLIENT_FOLLOW_H

#include "client/connection.h"

/* ERR_JOB_FAILED when the job failed or was cancelled; ERR_TIMEOUT after limit_s (0: none). */
status follow_job(struct connection *c, uint64_t job, int quiet, int json, double limit_s,
                  struct error *err) MUST_CHECK;

#endif
