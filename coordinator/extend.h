/* extend: a DONE job's frames go on from their kept films.
 *
 * The pictures have the bits that the new rules would have given at once, with the old cap as spp_min
 * where every pixel had it: wanted numbers grow with rounds, targets and caps, and a short pass of the old
 * cap is rendered again, whole. What a clock had decided about stays in the picture; such a frame
 * then carries its schedule.
 */
#ifndef AZULEJO_COORDINATOR_EXTEND_H
#define AZULEJO_COORDINATOR_EXTEND_H

#include "coordinator/farm.h"

/* spp: the new cap; 0: SETTINGS_SPP_MAX. Of `rules` spp_min and adaptive are not looked at. ERR_REFUSED: not
 * DONE, another release, films gone, or rules that would have given fewer samples; the text says what to
 * do. ERR_IO, ERR_NO_MEMORY, ERR_LIMIT: nothing changed. */
status farm_extend(struct farm *farm, struct job *job, uint32_t spp, const struct stop_rules *rules,
                   struct error *err) MUST_CHECK;

#endif
