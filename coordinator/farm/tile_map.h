/* tile_map: what a frame's tiles have, and who rendered them.
 *
 *   tile_map_new --tile_map_take of each tile, in any thread--> tile_map_name --> as a message
 */
#ifndef AZULEJO_COORDINATOR_TILE_MAP_H
#define AZULEJO_COORDINATOR_TILE_MAP_H

#include "coordinator/farm/farm.h"

enum { TILE_MAP_TILES_MAX = 65536 };

struct tile_cell {
    uint32_t samples, units, passes;
    uint32_t worker;             /* its place in `workers`, from 1; 0: not known */
    uint32_t thread;             /* from 1; 0: not known */
    float error;                 /* display codes (message FrameTile); NaN: not known */
    uint64_t cpu_ns;
};

struct tile_map {
    uint32_t width, height, count;
    struct tile_cell *cells;     /* [count] */
    struct deliverer *workers;   /* `number` only, until they are named */
    uint32_t worker_count;
    size_t worker_capacity;
};

/* ERR_LIMIT: too many tiles; ERR_NO_MEMORY. */
status tile_map_new(struct tile_map *map, uint32_t width, uint32_t height, struct error *err) MUST_CHECK;
void tile_map_release(struct tile_map *map);
/* ERR_NO_MEMORY. */
status tile_map_take(struct tile_map *map, const struct film *film, uint32_t tile, struct error *err) MUST_CHECK;
/* Find out who the workers are. On the farm's thread. */
void tile_map_name(struct tile_map *map, const struct farm *farm);

/* Error of a tile's picture in display codes; NaN: not known. */
double tile_map_error(const struct film *film, uint32_t tile);

#endif
