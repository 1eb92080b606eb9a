/* steer: what people do to jobs.
 *
 *             | QUEUED    RUNNING   PAUSED    PARKED  FINISHING  CANCELLING  DONE     FAILED  CANCELLED
 *   pause     | PAUSED    PAUSED    (same)    -       -          -           -        -       -
 *   resume    | -         -         QUEUED    QUEUED  -          -           -        -       -
 *   finish    | FINISHING FINISHING FINISHING -       (same)     -           -        -       -
 *   start     | (same)    (same)    (same)    (same)  (same)     (same)      -        -       -
 *   priority  | (same)    (same)    (same)    (same)  (same)     (same)      -        -       -
 *   extend    | (same)    (same)    (same)    (same)  -          -           QUEUED   -       -
 *   retry     | -         -         -         -       -          -           QUEUED*  QUEUED  QUEUED
 *   remove    | -         -         -         -       -          -           gone     gone    gone
 *   cancel    | CANCELLING from all that have not ended; nothing happens to those that have
 *
 *   "-" is ERR_REFUSED, with a sentence that says what to do instead. * only if it was finished early,
 *   or with frames. finish is refused if no frame is in work.
 *
 * Each function returns when the change and its line in the job's log are on disk, or, if the store
 * cannot be written, noted for later (remove, retry and extend fail instead: ERR_IO). `who` is for the log.
 * `now_ns`: the monotonic clock. Beyond the table's ERR_REFUSED, errors are those at the function.
 */
#ifndef AZULEJO_COORDINATOR_STEER_H
#define AZULEJO_COORDINATOR_STEER_H

#include "coordinator/farm/extend.h"

status steer_pause(struct farm *farm, struct job *job, const char *who, uint64_t now_ns,
                   struct error *err) MUST_CHECK;
/* From PAUSED or PARKED; suspicions against the job, and of machines that cannot render it, are
 * cleared. */
status steer_resume(struct farm *farm, struct job *job, const char *who, uint64_t now_ns,
                    struct error *err) MUST_CHECK;
status steer_finish(struct farm *farm, struct job *job, const char *who, uint64_t now_ns,
                    struct error *err) MUST_CHECK;
/* farm_cancel, with its line in the log. `discard`: unfinished frames become no pictures, and their
 * films are removed. */
void steer_cancel(struct farm *farm, struct job *job, int discard, const char *who, uint64_t now_ns);
/* `priority`: any; jobs with a higher number go first. */
status steer_priority(struct farm *farm, struct job *job, int32_t priority, const char *who,
                      uint64_t now_ns, struct error *err) MUST_CHECK;
/* It waits no longer for other jobs and for its time (needs.h); what it requires of workers remains. Nothing
 * happens to an active job that waits for neither. */
status steer_start(struct farm *farm, struct job *job, const char *who, uint64_t now_ns,
                   struct error *err) MUST_CHECK;
/* The job gets other rules about when its frames have enough samples: farm_extend, or farm_retarget. The log says
 * which, and what they were; nothing happens if the job in work has them. */
status steer_extend(struct farm *farm, struct job *job, const struct job_extension *extension, const char *who,
                    uint64_t now_ns, struct error *err) MUST_CHECK;
/* The frames that are not done, and those that a person cut short, continue with the films that are
 * there; or only these `frames`, if count is not 0: they ascend. A frame without a film begins
 * again. ERR_INPUT: no such frame; ERR_IO, ERR_LIMIT, ERR_NO_MEMORY. */
status steer_retry(struct farm *farm, struct job *job, const uint32_t *frames, size_t count,
                   const char *who, struct error *err) MUST_CHECK;
/* The job leaves the queue, and its row, log, films and pictures are removed; if it was done, nothing waits
 * for it any longer. It is freed now or,
 * while a commit or a develop holds it, later. ERR_IO. */
status steer_remove(struct farm *farm, struct job *job, const char *who, uint64_t now_ns,
                    struct error *err) MUST_CHECK;

#endif
