/* cancel: end a job, and report what remains. */
#ifndef AZULEJO_CLIENT_CANCEL_H
#define AZULEJO_CLIENT_CANCEL_H

#include "client/farm/connection.h"

/* Cancel the job. Unless `discard`, the coordinator makes pictures of what is rendered: until then
 * the job is cancelling. *out is a JobList with the job, which the caller frees. */
status cancel_job(struct connection *c, uint64_t job, int discard, Azulejo__Wire__Envelope **out,
                  struct error *err) MUST_CHECK;

#endif
