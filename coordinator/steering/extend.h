/* extend: some or all frames of a DONE job continue from their kept films (retarget.h has jobs that have not ended).
 *
 * Complete frames that do not continue are noted as cut short by the old cap.
 *
 * The pictures are bit-identical to those that the new rules would have given from the start, with
 * the old cap as spp_min if every pixel had it: the wanted samples only grow with rounds, targets
 * and caps, and a short pass under the old cap is rendered again in full. Samples that a time limit
 * decided about stay in the picture; such a frame then carries its schedule.
 */
#pragma once

#include "coordinator/farm/farm.h"

struct job_extension {
    uint32_t spp;            /* the new cap; 0: SETTINGS_SPP_MAX */
    struct stop_rules rules; /* spp_min and adaptive are ignored */
    const uint32_t *frames;  /* that go on */
    size_t frame_count;      /* 0: all */
};

/* ERR_REFUSED: not DONE, another release, films missing, or rules that would have given fewer samples; the text says
 * what to do. ERR_INPUT: no such frame. ERR_IO, ERR_NO_MEMORY, ERR_LIMIT: nothing changed. */
status farm_extend(struct farm *farm, struct job *job, const struct job_extension *extension,
                   struct error *err) MUST_CHECK;

/* The smallest cap that allows all samples that the done frames have. */
uint32_t extend_least_cap(const struct job *job);
/* ERR_REFUSED: another release rendered the job, whose samples do not mix with ours. */
status extend_check_release(const struct job *job, struct error *err) MUST_CHECK;
/* Store the job with its changed settings, and continue the chosen frames: it is QUEUED. The caller
 * has called job_reopen_check. `before` is the job as it was, `submitted` its new submission or NULL.
 * ERR_IO, ERR_NO_MEMORY: the job is as it was. */
status farm_go_on(struct farm *farm, struct job *job, const struct job *before, const struct job_reopening *chosen,
                  const struct job *submitted, struct error *err) MUST_CHECK;

/* The newest estimate that this job can continue; NULL: none. */
struct job *farm_find_estimate(const struct farm *farm, const struct job *job);
/* The estimate becomes the job. The job's pictures do not depend on it: a frame of which the estimate rendered more
 * than the rules want begins again. `job` stays the caller's. Errors as above. */
status farm_continue_estimate(struct farm *farm, struct job *estimate, const struct job *job,
                              struct error *err) MUST_CHECK;
