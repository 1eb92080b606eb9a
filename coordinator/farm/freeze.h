/* freeze: how a display shows a frame, for the frame's level statistics (common/film/levels.h).
 *
 *   level 0 of a group is complete --freeze_step--> measured on that picture, smoothed [any thread]
 *     --> noted in the film's file, on disk --> film_freeze: passes beyond level 0 are folded
 *
 * Level 0 has two samples a pixel: what goes by single pixels, as percentiles do, would follow the noise. Smoothed over
 * 5x5 pixels it comes near to that of the finished picture, which decides what the error is.
 *
 * A note holds settings and a state (common/tonemap): the job's own, or settings that replace an operator that needs
 * the whole picture. They do not change when the job gets other output settings: a statistic must not depend on the
 * time of that change. If nothing needs measuring, the groups are frozen when the film is opened.
 *
 * A crash before the note is on disk loses nothing: nothing beyond level 0 was folded, so the same picture is loaded or
 * rendered again, and measured again.
 */
#pragma once

#include "coordinator/farm/farm.h"

enum { FREEZE_RADIUS = 2 }; /* of the smoothing, in pixels */

/* Freeze the groups of a newly opened film whose display is known. ERR_IO, ERR_NO_MEMORY. */
status freeze_open(struct job_frame *frame, struct error *err) MUST_CHECK;

/* Was it measured on the frame's first samples how a display shows it, so that what its groups' levels say depends on all
 * tiles? ERR_IO, ERR_NO_MEMORY. */
status freeze_was_measured(const struct job_frame *frame, int *measured, struct error *err) MUST_CHECK;

/* Begin the measurement that the frame's film wants (film_wants_freeze), by events.freeze; without that event it is
 * done at once. A failure of the environment is noted as the frame's trouble, and farm_tick begins again. */
void freeze_step(struct farm *farm, struct job_frame *frame, uint64_t now_ns);

/* One measurement. freezing_run may be called from any thread; freezing_end frees it.
 * freezing_abandon also frees it, without its result: nothing is frozen. */
struct freezing;
const struct job_frame *freezing_frame(const struct freezing *freezing);
void freezing_run(struct freezing *freezing);
void freezing_end(struct farm *farm, struct freezing *freezing, uint64_t now_ns);
void freezing_abandon(struct farm *farm, struct freezing *freezing);
