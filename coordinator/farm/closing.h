/* closing: frames that end, and jobs that stop before they are done, and what becomes of their films.
 *
 *   A frame ends when its rounds do (rounds.h), by the time or core limit, by a cancel: from then on none of
 *     its units is lent and no new result taken, so nothing in flight is waited for. When what was merged
 *     is on disk it is developed, whatever ended it.
 *   CANCELLING: no unit is lent and no result taken. A frame without samples is closed. One with
 *     samples waits until its merged tiles are on disk, then is developed with what it has, as any
 *     complete frame is; it counts as done and as cut short. Films on disk are opened for that in
 *     their turn. With the last one the job is CANCELLED. A restart goes on with it, and trouble
 *     with the disk delays it.
 *   PARKED: no unit is lent and no result taken. A frame is closed as soon as its merged tiles are
 *     on disk; its film stays there. A complete frame is developed.
 *
 * closing_step may be called for a job in any state.
 */
#ifndef AZULEJO_COORDINATOR_CLOSING_H
#define AZULEJO_COORDINATOR_CLOSING_H

#include "coordinator/farm/farm.h"

/* End the frame if it has reached a limit of its job's rules. Every tile gets samples before. */
void closing_note_limits(struct farm *farm, struct job_frame *frame, uint64_t now_ns);
/* From any state that is not final to CANCELLING; perhaps to CANCELLED at once. */
void closing_begin(struct farm *farm, struct job *job, uint64_t now_ns);
/* The job that a worker's death would speak against: of those that it holds leases of, the first that
 * it did not deliver its last result of. *lent_ns: when it was lent the oldest of them. NULL: none. */
struct job *closing_suspected(const struct farm *farm, const struct farm_worker *worker,
                              uint64_t *lent_ns);
/* The worker died, and its leases are ended: perhaps from QUEUED or RUNNING to PARKED. */
void closing_note_death(struct farm *farm, struct job *job, const struct farm_worker *worker,
                        uint64_t lent_ns, uint64_t now_ns);
/* From PARKED to QUEUED, all suspicion forgotten. ERR_REFUSED: it is not parked. */
status closing_unpark(struct farm *farm, struct job *job, uint64_t now_ns,
                      struct error *err) MUST_CHECK;
/* Take the steps that are due. Call after a develop and at every tick. May end the job. */
void closing_step(struct farm *farm, struct job *job, uint64_t now_ns);

#endif
