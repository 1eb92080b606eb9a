/* distrusted: the deliverers whose results are not believed, and what becomes of these in films.
 *
 *   believed --a loser of an audit, `azulejo distrust`, a retry of frames of a blocked worker--> distrusted, for ever
 *
 * A film that is opened gives up the tiles that a distrusted deliverer sent units of: they are rendered again from pass 0.
 * Where a lie may have reached other tiles (rounds decide by all of them, and so does how a display shows the frame), it
 * gives up all. A worker that is unblocked gets another number, so its new results count. */
#pragma once

#include "coordinator/farm/farm.h"

/* After farm_init, before a film is opened. farm_release frees it. ERR_IO, ERR_NO_MEMORY. */
status distrusted_load(struct farm *farm, struct error *err) MUST_CHECK;
/* The deliverers that have, or had, that name or key (worker_label_is_of): numbers of 32 bits, appended. ERR_IO, ERR_NO_MEMORY. */
status distrusted_numbers(const struct farm *farm, const char *label, struct buffer *numbers, struct error *err) MUST_CHECK;
/* Do not believe what these have delivered so far; `since`: as in struct distrusted. ERR_NO_MEMORY: not all are noted, and
 * it may be repeated. */
status distrusted_add(struct farm *farm, const struct buffer *numbers, int64_t since, struct error *err) MUST_CHECK;
/* The same of all blocked names: no film that is opened from now on keeps what they sent; frames that are done stay. */
status distrusted_add_blocked(struct farm *farm, struct error *err) MUST_CHECK;
/* Is it among them, and of a frame that was done at that moment? */
int distrusted_has(const struct farm *farm, uint32_t deliverer, int64_t done_at);

/* What of a film that was just opened goes. */
enum distrusted_part { DISTRUSTED_NONE, DISTRUSTED_TILES, DISTRUSTED_ALL };
struct distrusted_loss {
    enum distrusted_part part;
    uint32_t tiles; /* that have results which are not believed */
};
/* Take those tiles out of the film, without waiting for the disk (film_file_empty_tile). If all must go, nothing is done:
 * the caller removes the film. The frame has not begun (job_frame_begin). ERR_IO, ERR_NO_MEMORY: some tiles are left. */
status distrusted_take_out(const struct farm *farm, struct job_frame *frame, struct distrusted_loss *loss,
                           struct error *err) MUST_CHECK;

/* The name of a deliverer; "": it is not known. */
void distrusted_label(const struct farm *farm, uint32_t deliverer, char out[WORKER_LABEL_MAX + 1]);
