/* freeze: how a display shows a frame, as far as its level statistics (common/film/levels.h) go.
 *
 *   level 0 of a group is in everywhere --freeze_step--> measured on that picture [any thread]
 *     --> noted in the film's file, on disk --> film_freeze: passes beyond level 0 are folded
 *
 * What is noted is settings and a state (common/tonemap): the job's own, or settings that stand in for an
 * operator that needs the whole picture. They stay when the job is given other output settings: a
 * statistic must not depend on when that happened. Where nothing is to be measured the groups are
 * frozen when the film is opened.
 *
 * A crash before the note is on disk loses nothing: nothing beyond level 0 was folded, so the same picture
 * is there again, or is rendered again, and measured again.
 */
#ifndef AZULEJO_COORDINATOR_FREEZE_H
#define AZULEJO_COORDINATOR_FREEZE_H

#include "coordinator/farm/farm.h"

/* Freeze the groups of a film that was just opened whose display is known. ERR_IO, ERR_NO_MEMORY. */
status freeze_open(struct job_frame *frame, struct error *err) MUST_CHECK;

/* Begin what the frame's film wants (film_wants_freeze), by events.freeze; without that it is done at once.
 * What the environment keeps from being done is noted as the frame's trouble, and begun again by farm_tick. */
void freeze_step(struct farm *farm, struct job_frame *frame, uint64_t now_ns);

/* One measurement. freezing_run may be called from any thread; freezing_end frees it, and so does
 * freezing_abandon, without learning how it ended: nothing is frozen. */
struct freezing;
void freezing_run(struct freezing *freezing);
void freezing_end(struct farm *farm, struct freezing *freezing, uint64_t now_ns);
void freezing_abandon(struct farm *farm, struct freezing *freezing);

#endif
