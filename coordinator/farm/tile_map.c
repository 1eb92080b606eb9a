#include "coordinator/farm/tile_map.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "common/base/memory.h"

status tile_map_new(struct tile_map *map, uint32_t width, uint32_t height, struct error *err)
{
    *map = (struct tile_map){.width = width, .height = height, .count = tile_count(width, height)};
    if (map->count > TILE_MAP_TILES_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "the frame has %u tiles: their data is sent of at most %d", map->count,
                         TILE_MAP_TILES_MAX);
    map->cells = mem_calloc(map->count, sizeof *map->cells);
    for (uint32_t i = 0; map->cells && i < map->count; i++)
        map->cells[i].error = NAN;
    return map->cells ? STATUS_OK : error_no_memory(err, "a frame's tiles");
}

void tile_map_release(struct tile_map *map)
{
    mem_free(map->cells);
    mem_free(map->workers);
    memset(map, 0, sizeof *map);
}

/* The variance of the mean of n samples is that of the level's samples, less in proportion; the picture is the mean
 * of two groups' means (film.h). */
double tile_map_error(const struct film *film, uint32_t tile)
{
    struct tile_rect rect = tile_rect_of(film_width(film), film_height(film), tile);
    uint32_t groups = 0;
    double sum = 0;

    for (uint32_t g = 0; g < GROUPS; g++) {
        uint32_t samples = film_group_samples(film, tile, g), level = LEVELS_MAX;
        struct film_level at;
        if (samples == 0)
            continue;
        groups++;
        while (level > 0 && !film_level(film, tile, g, level - 1, &at))
            level--;
        if (level == 0 || !at.has_codes)
            return NAN;
        sum += (double)at.display * level_samples(level - 1) / samples;
    }
    return groups ? sqrt(sum / ((double)rect.width * rect.height)) / groups : (double)NAN;
}

/* The worker's place, from 1. 0: no memory. */
static uint32_t place_of(struct tile_map *map, uint32_t deliverer)
{
    for (uint32_t i = 0; i < map->worker_count; i++)
        if (map->workers[i].number == deliverer)
            return i + 1;
    if (!MEM_GROW(map->workers, map->worker_capacity, (size_t)map->worker_count + 1))
        return 0;
    map->workers[map->worker_count++] = (struct deliverer){.number = deliverer};
    return map->worker_count;
}

status tile_map_take(struct tile_map *map, const struct film *film, uint32_t tile, struct error *err)
{
    struct film_origin origin = film_tile_origin(film, tile);
    struct tile_cell *cell = &map->cells[tile];

    cell->samples = film_tile_samples(film, tile);
    cell->units = origin.units;
    cell->cpu_ns = origin.cpu_ns;
    cell->thread = origin.thread;
    cell->error = (float)tile_map_error(film, tile);
    for (uint32_t g = 0; g < GROUPS; g++)
        if (film_tile_passes(film, tile, g) > cell->passes)
            cell->passes = film_tile_passes(film, tile, g);
    cell->worker = origin.deliverer ? place_of(map, origin.deliverer) : 0;
    return cell->worker || !origin.deliverer ? STATUS_OK : error_no_memory(err, "a frame's tiles");
}

static int find_connected(const struct farm *farm, struct deliverer *out)
{
    for (uint32_t i = 0; i < farm->worker_count; i++)
        if (farm->workers[i]->deliverer.number == out->number) {
            *out = farm->workers[i]->deliverer;
            snprintf(out->label, sizeof out->label, "%s", farm->workers[i]->label);
            return 1;
        }
    return 0;
}

void tile_map_name(struct tile_map *map, const struct farm *farm)
{
    for (uint32_t i = 0; i < map->worker_count; i++) {
        uint32_t number = map->workers[i].number;
        if (find_connected(farm, &map->workers[i]) || !farm->store)
            continue;
        if (store_deliverer_find(farm->store, number, &map->workers[i], NULL) != STATUS_OK)
            memset(&map->workers[i], 0, sizeof map->workers[i]);
        map->workers[i].number = number;
    }
}
