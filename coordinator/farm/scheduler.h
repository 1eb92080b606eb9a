/* scheduler: chooses the work units that a worker gets next.
 *
 * Jobs in the order of order.h, a job's frames in order, a frame's passes in order over all its tiles. The next frame
 * is begun when the earlier ones have no unit left to lend. When no job has any, units of a frame's next round are lent
 * before that round is decided (in a job with a time or core limit: before its next frame is begun). When no unlent
 * unit is left, units that are overdue with another worker are lent a second time, so that one stopped worker does not
 * delay the others.
 *
 * A job that is suspected of killing its workers (suspicion.h) is lent to one worker at a time, one with max_cores to
 * so many cores: a unit keeps one busy.
 *
 * A lease is sized by time: LEASE_WORK_MS of work at the worker's measured speed on the threads that it is trusted with
 * (credit.h), less while the frame is not covered yet. Towards a frame's end the leases get smaller, so that all
 * workers end together.
 *
 * Overdue units go to workers that are not stuck themselves (credit_is_stuck). A unit's last place
 * (UNIT_HOLDERS_UNPROVEN_MAX) is for a worker that delivered recently. If all places that a worker may take are taken,
 * the unproven worker that has held the unit longest loses its place; its result is still accepted. These choices
 * decide which worker renders what and when, never the result.
 */
#pragma once

#include "coordinator/farm/farm.h"

enum {
    LEASE_WORK_MS = 500,
    LEASE_WORK_FIRST_MS = 200,   /* until every tile of the frame has samples */
    HELD_WORK_MS = 1500,         /* a worker that holds this much gets no more */
    OVERDUE_FACTOR = 4,          /* times a job's usual turnaround */
    OVERDUE_LEAST_MS = 1000,
    OVERDUE_UNKNOWN_MS = 5000,   /* before any result of the job */
};

/* Lend work to a worker that has room; NULL: there is nothing for it now. The lease has the frame and units to send. */
struct lease *scheduler_grant(struct farm *farm, struct farm_worker *worker, uint64_t now_ns);

/* A result of the worker was merged: learn its speed from the samples and their CPU time, and the
 * job's turnaround; charge the job's owner. granted_ns: when the unit was lent; 0: not known. */
void scheduler_learn(struct farm *farm, struct farm_worker *worker, struct job *job, uint64_t samples, uint64_t cpu_ns,
                     uint64_t granted_ns, uint64_t now_ns);
