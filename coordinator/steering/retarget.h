/* retarget: a job that has not ended gets other rules about when its frames have enough samples (extend.h has those
 * that are DONE). Its state stays.
 *
 * Open frames are closed as soon as what was merged is on disk, and opened again with the new rules; units in the
 * hands of workers are rendered again where they are still wanted. A frame that is done goes on if the new rules
 * may want more of it than it has, and if its film was kept; a frame that met its target keeps its picture under a
 * laxer one. A frame whose pictures are being made goes on as an open one.
 *
 * The pictures are bit-identical to those that the new rules would have given from the start, as long as a frame
 * has no more samples than they want, and the statistics that decide are there or can be measured from its units
 * (film_levels_load). A frame that has more ends with what it has; one that skipped a level (rounds.h) goes on from the
 * next one; both carry their schedules.
 */
#pragma once

#include "coordinator/steering/extend.h"

/* What became of the frames that were done. */
struct retarget_result {
    int same;              /* the job has these rules already; nothing happened */
    uint32_t reopened;     /* they go on */
    uint32_t without_film; /* they would, but their films were not kept */
};

/* ERR_REFUSED: another release, a schedule, an estimate, `frames`, or fewer samples than a frame has; the text says
 * what to do. ERR_LIMIT, ERR_IO, ERR_NO_MEMORY. On failure nothing changed. */
status farm_retarget(struct farm *farm, struct job *job, const struct job_extension *extension,
                     struct retarget_result *result, uint64_t now_ns, struct error *err) MUST_CHECK;
