/* scheduler: which work units a worker gets next.
 *
 * Jobs in the queue's order, a job's frames in order, a frame's passes in order over all its
 * tiles. The next frame is begun when the earlier ones have no unit left to lend. When no job has
 * any, units of the next round of a frame are lent before it is decided that they are wanted (of a job
 * with a time or core limit: before its next frame is begun). When there is nothing fresh at all, units that are overdue with another worker are lent a second time, so
 * that one stopped worker holds up nobody.
 *
 * A job that is suspected of killing its workers (suspicion.h) is lent to one worker at a time.
 *
 * A lease is sized by time: LEASE_WORK_MS of work at the worker's measured speed on the threads that
 * it is trusted with (credit.h), less while the frame is not covered yet; towards a frame's end
 * shares get smaller, so that all workers end together.
 *
 * Overdue units go to workers that are not stuck themselves (credit_is_stuck). A unit's last place
 * (UNIT_HOLDERS_UNPROVEN_MAX) is for a worker that delivered lately; where all places that a worker may
 * take are taken, the unproven worker that holds the unit longest loses its place. Its result is still
 * welcome. These choices decide who renders what and when, never what comes out.
 */
#ifndef AZULEJO_COORDINATOR_SCHEDULER_H
#define AZULEJO_COORDINATOR_SCHEDULER_H

#include "coordinator/farm/farm.h"

enum {
    LEASE_WORK_MS = 500,
    LEASE_WORK_FIRST_MS = 200,   /* until every tile of the frame has samples */
    HELD_WORK_MS = 1500,         /* a worker that holds this much gets no more */
    OVERDUE_FACTOR = 4,          /* times a job's usual turnaround */
    OVERDUE_LEAST_MS = 1000,
    OVERDUE_UNKNOWN_MS = 5000,   /* before any result of the job */
};

/* Lend work to a worker that has room; NULL: there is nothing for it now. The lease's frame and
 * units tell what to send. */
struct lease *scheduler_grant(struct farm *farm, struct farm_worker *worker, uint64_t now_ns);

/* A result of the worker, of so many samples in so much CPU time, was merged: learn its speed and the job's turnaround. granted_ns: when
 * the unit was lent; 0: not known. */
void scheduler_learn(struct farm_worker *worker, struct job *job, uint64_t samples,
                     uint64_t cpu_ns, uint64_t granted_ns, uint64_t now_ns);

#endif
