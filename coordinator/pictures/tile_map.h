/* tile_map: what a frame's tiles have, and who rendered them.
 *
 *   tile_map_new --tile_map_take of each tile, in any thread--> tile_map_name --> as a message
 */
#pragma once

#include "coordinator/farm/farm.h"

enum {
    TILE_MAP_TILES_MAX = 65536,
    TILE_MAP_SHARES_MAX = 1 << 19, /* that are taken of all tiles together, */
    TILE_MAP_SHARES_LEAST = 8,     /* but at least of each */
    /* After tile_map_join so many are left that a message (CHANNEL_FRAME_MAX) holds them, at least one of each tile. */
    TILE_MAP_MESSAGE_BYTES = 7 << 19,
    TILE_MAP_TILE_BYTES = 45,      /* of a tile, and */
    TILE_MAP_SHARE_BYTES = 17,     /* of a share in a message, at most */
};

/* What one thread of a worker sent of a tile. */
struct tile_share {
    uint32_t worker;         /* its place in `workers`, from 1 */
    uint32_t thread;         /* from 1; 0: not known */
    uint32_t units, samples; /* samples of a pixel */
};

struct tile_cell {
    uint32_t samples, units, passes;
    uint32_t group_passes[GROUPS];
    uint32_t worker; /* its place in `workers`, from 1; 0: not known */
    uint32_t thread; /* from 1; 0: not known */
    float error;     /* display codes (message FrameTile); NaN: not known */
    uint64_t cpu_ns;
    uint32_t first_share, share_count; /* in `shares` */
};

struct tile_map {
    uint32_t width, height, count;
    struct tile_cell *cells;   /* [count] */
    struct deliverer *workers; /* `number` only, until they are named */
    uint32_t worker_count;
    size_t worker_capacity;
    int with_shares; /* shares are taken */
    struct tile_share *shares;
    size_t share_count, share_capacity;
};

/* ERR_LIMIT: too many tiles; ERR_NO_MEMORY. */
status tile_map_new(struct tile_map *map, uint32_t width, uint32_t height, int with_shares,
                    struct error *err) MUST_CHECK;
void tile_map_release(struct tile_map *map);
/* ERR_NO_MEMORY. */
status tile_map_take(struct tile_map *map, const struct film *film, uint32_t tile, struct error *err) MUST_CHECK;
/* Find out who the workers are, and join those that are the same. On the farm's thread. ERR_NO_MEMORY. */
status tile_map_name(struct tile_map *map, const struct farm *farm, struct error *err) MUST_CHECK;
/* Workers of one name, or of one process, become one; each tile's shares are sorted: the worker with the most
 * samples first, then its thread with the most; of equal ones the one with the older unit.
 * Of huge frames only the first ones are left. ERR_NO_MEMORY. */
status tile_map_join(struct tile_map *map, struct error *err) MUST_CHECK;

/* Error of a tile's picture in display codes; NaN: not known. */
double tile_map_error(const struct film *film, uint32_t tile);
