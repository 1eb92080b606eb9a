/* stored_tiles: the tiles of a frame that is done, one after the other, from what the store kept of it.
 *
 * The kept film has everything. Where it was not kept, the stored picture has the means: then the standard error is
 * not known, and the samples are the frame's mean. A film takes the memory of one tile and of its index (5 MiB at
 * 3840x2160), a picture that of all its pixels: hence few at once.
 *
 * Made on the farm's thread; stored_tiles_read from any thread.
 */
#pragma once

#include "common/base/buffer.h"
#include "coordinator/pictures/linear.h"
#include "coordinator/store/store.h"

enum {
    STORED_TILES_OPEN = 16,
    STORED_PICTURES_OPEN = 2, /* of them, at most so many that are not known to have a film */
};

struct stored_tiles;

/* Copies what it needs of the job. ERR_NO_MEMORY. */
status stored_tiles_new(struct stored_tiles **out, const struct job *job, uint32_t frame, int layer,
                        struct error *err) MUST_CHECK;
/* Append the records (linear.h) of the next tiles, about `bytes` of them. *end: these are the last.
 * ERR_NOT_FOUND: nothing of the frame's layer was kept; ERR_IO, ERR_CORRUPT, ERR_NO_MEMORY. */
status stored_tiles_read(struct stored_tiles *t, const struct store *store, size_t bytes, struct buffer *out, int *end,
                         struct error *err) MUST_CHECK;
/* The records have the samples of their tiles: they come from the film. */
int stored_tiles_are_exact(const struct stored_tiles *t);
void stored_tiles_free(struct stored_tiles *t); /* NULL is fine */
