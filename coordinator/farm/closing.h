/* closing: how frames end, how jobs stop before they are done, and what happens to their films.
 *
 *   A frame ends with its rounds (rounds.h), at its time or core limit, or when its job is
 *   cancelled. From then on none of its units is lent and no new result is accepted, so it waits
 *   for nothing in flight. Once its merged tiles are on disk it is developed, whatever ended it.
 *   CANCELLING: no unit is lent and no result is accepted. A frame without samples is closed. A
 *   frame with samples waits until its merged tiles are on disk and is then developed like a
 *   complete frame; it counts as done and as cut short. Films on disk are opened for that, one
 *   after another. After the last one the job is CANCELLED. A restart continues it, and trouble
 *   with the disk delays it.
 *   FINISHING: no frame is begun. A frame in work, or with a film on disk, gets units of its first pass
 *   only, and ends when every tile has samples; it is then developed, and counts as done and cut short.
 *   After the last one the job is DONE, with JOB_MARK_EARLY if any frame has fewer samples for that.
 *   PAUSED, PARKED: no unit is lent and no result is accepted. A frame is closed as soon as its merged
 *   tiles are on disk; its film stays there. A complete frame is developed.
 *
 * closing_step may be called for a job in any state.
 */
#pragma once

#include "coordinator/farm/farm.h"

/* End the frame if it has reached a limit of its job's rules, but not before every tile has samples. */
void closing_note_limits(struct farm *farm, struct job_frame *frame, uint64_t now_ns);
/* From any state that is not final to CANCELLING, or to CANCELLED if no frame needs a picture. */
void closing_begin(struct farm *farm, struct job *job, uint64_t now_ns);
/* The job that a worker's death counts against: among the jobs that it holds leases of, the first one other than the
 * job of its last result. *lent_ns: when the oldest of these leases was granted. NULL: none. */
struct job *closing_suspected(const struct farm *farm, const struct farm_worker *worker, uint64_t *lent_ns);
/* The worker died, and its leases have ended. The job may go from QUEUED or RUNNING to PARKED. */
void closing_note_death(struct farm *farm, struct job *job, const struct farm_worker *worker, uint64_t lent_ns,
                        uint64_t now_ns);
/* The unit hung as many workers as it may: the job goes to PARKED. */
void closing_note_hang(struct farm *farm, struct job *job, const struct hang_unit *unit, uint64_t now_ns);
/* Does the job have a frame in work, open or on disk? */
int closing_has_begun(const struct farm *farm, const struct job *job);
/* Take the steps that are due. Call after a develop and at every tick. May end the job. */
void closing_step(struct farm *farm, struct job *job, uint64_t now_ns);
