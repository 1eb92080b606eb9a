/* picture: what one client was sent of a frame, and which tile it gets next.
 *
 * Newest wins: a tile has no history here, only the number of samples that the client saw. Tiles that it never
 * saw come first, spread over the picture (frame/spread.h); then those that changed, in the same order, round and
 * round, so that each gets its turn before another gets its second. While results keep coming a tile has changed when
 * it has half as many samples again: less is hardly seen, and costs as much.
 */
#pragma once

#include <stdint.h>

enum { PICTURE_NO_TILE = -1 };

struct picture {
    uint32_t tiles;                 /* 0: none is watched */
    uint32_t *order;                /* spread_order */
    uint32_t *sent;                 /* [tiles] samples of a pixel that the client saw; 0: none */
    uint32_t unseen;                /* tiles with 0 */
    uint32_t fresh, next;           /* places in `order`: where the search for unseen and for changed ones goes on */
    uint32_t fresh_left, next_left; /* places left in this turn */
    int is_exact;                   /* this turn: any new sample counts */
};

/* Begin with a frame of this size. 0: no memory, and nothing is watched. */
int picture_begin(struct picture *p, uint32_t width, uint32_t height);
void picture_end(struct picture *p);

/* Begin to look at all tiles once; `is_exact`: send all that differ. */
void picture_turn(struct picture *p, int is_exact);
/* The last turn did not come to its end: the search for changed tiles goes on, and that for unseen ones begins again,
 * as these never wait for the others. */
void picture_turn_on(struct picture *p);
/* The next tile to send in this turn, of which `shown` has the samples now; PICTURE_NO_TILE: no other. The client
 * counts as having seen it. *is_first: it never saw it before. */
int64_t picture_next(struct picture *p, const uint32_t *shown, int *is_first);
/* The tile as somebody else found it; 1: the client has not seen that. */
int picture_wants(struct picture *p, uint32_t tile, uint32_t samples);
