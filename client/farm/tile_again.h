/* tile_again: a tile of a job's frame, rendered again by the farm's workers and compared with a picture of it.
 *
 *   its units as RenderRequests --sums--> a film of this one tile --means--> compared bit for bit
 *
 * The contract (the same bits on any machine) makes that exact. Workers that rendered the tile are asked last.
 */
#pragma once

#include "client/link/connection.h"
#include "common/film/film.h"
#include "common/image/image.h"

enum { TILE_AGAIN_NAMES_MAX = 8 };

struct tile_again {
    uint64_t job;
    uint32_t frame, tile;
    uint32_t passes[GROUPS];              /* that the picture has */
    const Azulejo__Wire__FrameTiles *map; /* who rendered it; NULL: not known */
    struct tile_rect rect;                /* in the frame */
    /* What is found. */
    uint32_t units, pixels_differ;
    double most;                       /* the largest difference of a channel */
    char by[TILE_AGAIN_NAMES_MAX][64]; /* who rendered it now */
    uint32_t by_count;
    int same_worker; /* one of them had rendered it before */
};

/* ERR_PROTOCOL, and connection_ask's errors. */
status tile_again_render(struct connection *c, struct tile_again *t, struct film *film, struct error *err) MUST_CHECK;
/* `half`: the picture's numbers have 16 bits. ERR_NO_MEMORY. */
status tile_again_compare(struct tile_again *t, const struct film *film, const struct image *picture, int half,
                          struct error *err) MUST_CHECK;
/* Names of those that rendered the tile, the one with the most samples first; "" at the end. */
const char *tile_again_maker(const struct tile_again *t, uint32_t place);
