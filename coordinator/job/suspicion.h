/* suspicion: does a job kill the workers that render it?
 *
 * A death is the loss of a worker's connection while it holds units of the job: no goodbye, or
 * silence. It counts against the job when both are true:
 *  - the last result that this worker delivered, if any, was not of this job: a worker that had
 *    rendered the job successfully died of something else;
 *  - the worker was lent its units after the death counted before. So workers that die together (a
 *    preempted cluster, a switched-off rack, a split network) count as one death, and each further
 *    death is a worker that tried again and died again.
 * A result of the job from any worker clears the count: while a job makes progress, no death counts
 * for long. A worker that says goodbye (a drain) never counts.
 *
 * From the first death on, the job is lent to one worker at a time (the probe) until a result comes. The job is suspect
 * after SUSPICION_DEATHS deaths on at least two machines, or after SUSPICION_DEATHS_ALONE on a single one, which may be
 * the machine's own fault. The count is not stored: a restart of the coordinator clears it.
 *
 * A machine is its host name and its address without the port. That survives a restart of the worker's process, and
 * tells apart machines behind one address and containers of one machine. The worker claims its host name itself: this
 * guards against faults, not against forgery.
 */
#pragma once

#include <stdint.h>

enum { SUSPICION_DEATHS = 4, SUSPICION_DEATHS_ALONE = 8 };

/* All zero: no suspicion. */
struct suspicion {
    uint32_t deaths;
    uint32_t probe;    /* the session that was lent units last, since the first death */
    uint64_t death_ns; /* when the last one counted */
    uint64_t machine;  /* of the first */
    int several;       /* there was another machine */
};

/* A number for the machine, never 0. `address` is HOST:PORT or [HOST]:PORT. */
uint64_t machine_identity(const char *host, const char *address);

/* A worker on `machine` died that was lent its oldest units of the job at lent_ns. 1: it counts. */
int suspicion_add(struct suspicion *suspicion, uint64_t machine, uint64_t lent_ns, uint64_t now_ns);
/* The session was lent units of the job. */
void suspicion_lent(struct suspicion *suspicion, uint32_t session);
void suspicion_clear(struct suspicion *suspicion);
/* Should the job be parked? */
int suspicion_is_enough(const struct suspicion *suspicion);
