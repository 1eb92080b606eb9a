#include "coordinator/pictures/tile_map.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/memory.h"

status tile_map_new(struct tile_map *map, uint32_t width, uint32_t height, int with_shares, struct error *err)
{
    *map = (struct tile_map){
        .width = width, .height = height, .count = tile_count(width, height), .with_shares = with_shares};
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
    mem_free(map->shares);
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
            return sqrt(film_tile_contrast(film, tile));
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

/* ---- shares ---------------------------------------------------------------------------------- */

/* Of one tile, while it is taken. */
struct shares {
    struct tile_share items[GROUPS * PASSES_MAX];
    uint32_t count;
};

static struct tile_share *share_of(struct shares *shares, uint32_t worker, uint32_t thread)
{
    for (uint32_t i = 0; i < shares->count; i++)
        if (shares->items[i].worker == worker && shares->items[i].thread == thread)
            return &shares->items[i];
    shares->items[shares->count] = (struct tile_share){.worker = worker, .thread = thread};
    return &shares->items[shares->count++];
}

struct sortable {
    struct tile_share share;
    uint32_t worker_samples, worker_first, place; /* the worker's samples, and its first place of all */
};

static int in_order(const void *one, const void *other)
{
    const struct sortable *a = one, *b = other;

    if (a->worker_samples != b->worker_samples)
        return a->worker_samples > b->worker_samples ? -1 : 1;
    if (a->worker_first != b->worker_first)
        return a->worker_first < b->worker_first ? -1 : 1;
    if (a->share.samples != b->share.samples)
        return a->share.samples > b->share.samples ? -1 : 1;
    return a->place < b->place ? -1 : 1;
}

static void sort_shares(struct tile_share *shares, uint32_t count)
{
    struct sortable sorted[GROUPS * PASSES_MAX];

    for (uint32_t i = 0; i < count; i++) {
        uint32_t first = count;
        sorted[i] = (struct sortable){.share = shares[i], .place = i};
        for (uint32_t k = count; k-- > 0;)
            if (shares[k].worker == shares[i].worker) {
                sorted[i].worker_samples += shares[k].samples;
                first = k;
            }
        sorted[i].worker_first = first;
    }
    if (count > 1)
        qsort(sorted, count, sizeof *sorted, in_order);
    for (uint32_t i = 0; i < count; i++)
        shares[i] = sorted[i].share;
}

/* How many shares are taken of each tile. */
static uint32_t shares_taken(const struct tile_map *map)
{
    uint32_t kept = TILE_MAP_SHARES_MAX / map->count;

    return kept > TILE_MAP_SHARES_LEAST ? kept : TILE_MAP_SHARES_LEAST;
}

static status take_shares(struct tile_map *map, const struct film *film, uint32_t tile, struct error *err)
{
    struct shares shares = {.count = 0};
    struct tile_cell *cell = &map->cells[tile];

    for (uint32_t pass = 0; pass < cell->passes; pass++) /* units are lent in the order (pass, group) */
        for (uint32_t g = 0; g < GROUPS; g++) {
            uint32_t thread, place, begin, end, deliverer;
            uint64_t cpu_ns;
            struct tile_share *share;

            if (pass >= film_tile_passes(film, tile, g))
                continue;
            deliverer = film_deliverer(film, tile, g, pass);
            place = deliverer ? place_of(map, deliverer) : 0;
            if (deliverer && !place)
                return error_no_memory(err, "a frame's tiles");
            film_cost(film, tile, g, pass, &thread, &cpu_ns);
            pass_range(film_spp(film), g, pass, &begin, &end);
            share = share_of(&shares, place, thread);
            share->units++;
            share->samples += end - begin;
        }
    if (shares.count > shares_taken(map)) {
        sort_shares(shares.items, shares.count);
        shares.count = shares_taken(map);
    }
    NEED(MEM_GROW(map->shares, map->share_capacity, map->share_count + shares.count), err, "a frame's tiles");
    cell->first_share = (uint32_t)map->share_count;
    cell->share_count = shares.count;
    for (uint32_t i = 0; i < shares.count; i++)
        map->shares[map->share_count++] = shares.items[i];
    return STATUS_OK;
}

/* ---- tiles ----------------------------------------------------------------------------------- */

status tile_map_take(struct tile_map *map, const struct film *film, uint32_t tile, struct error *err)
{
    struct film_origin origin = film_tile_origin(film, tile);
    struct tile_cell *cell = &map->cells[tile];

    cell->samples = film_tile_samples(film, tile);
    cell->units = origin.units;
    cell->cpu_ns = origin.cpu_ns;
    cell->thread = origin.thread;
    cell->error = (float)tile_map_error(film, tile);
    for (uint32_t g = 0; g < GROUPS; g++) {
        cell->group_passes[g] = film_tile_passes(film, tile, g);
        if (cell->group_passes[g] > cell->passes)
            cell->passes = cell->group_passes[g];
    }
    cell->worker = origin.deliverer ? place_of(map, origin.deliverer) : 0;
    if (origin.deliverer && !cell->worker)
        return error_no_memory(err, "a frame's tiles");
    return map->with_shares ? take_shares(map, film, tile, err) : STATUS_OK;
}

/* ---- who the workers are ---------------------------------------------------------------------- */

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

status tile_map_name(struct tile_map *map, const struct farm *farm, struct error *err)
{
    for (uint32_t i = 0; i < map->worker_count; i++) {
        uint32_t number = map->workers[i].number;
        if (find_connected(farm, &map->workers[i]) || !farm->store)
            continue;
        if (store_deliverer_find(farm->store, number, &map->workers[i], NULL) != STATUS_OK)
            memset(&map->workers[i], 0, sizeof map->workers[i]);
        map->workers[i].number = number;
    }
    return tile_map_join(map, err);
}

static int is_same(const struct deliverer *a, const struct deliverer *b)
{
    if (a->label[0] && b->label[0])
        return strcmp(a->label, b->label) == 0;
    return a->host[0] && a->process == b->process && strcmp(a->host, b->host) == 0;
}

/* The workers' list without repetitions; places[old] is the new place. */
static void join_workers(struct tile_map *map, uint32_t *places)
{
    uint32_t kept = 0;

    places[0] = 0;
    for (uint32_t i = 0; i < map->worker_count; i++) {
        uint32_t k = 0;
        while (k < kept && !is_same(&map->workers[k], &map->workers[i]))
            k++;
        if (k == kept || map->workers[i].number > map->workers[k].number)
            map->workers[k] = map->workers[i];
        kept += k == kept;
        places[i + 1] = k + 1;
    }
    map->worker_count = kept;
}

/* How many shares of each tile a message holds. */
static uint32_t shares_sent(const struct tile_map *map)
{
    uint32_t tiles = map->count * TILE_MAP_TILE_BYTES;
    uint32_t sent = (TILE_MAP_MESSAGE_BYTES - tiles) / (map->count * TILE_MAP_SHARE_BYTES);

    return sent > 1 ? sent : 1;
}

static void join_shares(struct tile_share *shares, uint32_t *count, const uint32_t *places)
{
    uint32_t kept = 0;

    for (uint32_t i = 0; i < *count; i++) {
        struct tile_share share = shares[i];
        uint32_t k = 0;
        share.worker = places[share.worker];
        while (k < kept && (shares[k].worker != share.worker || shares[k].thread != share.thread))
            k++;
        if (k == kept)
            shares[kept++] = (struct tile_share){.worker = share.worker, .thread = share.thread};
        shares[k].units += share.units;
        shares[k].samples += share.samples;
    }
    *count = kept;
    sort_shares(shares, kept);
}

status tile_map_join(struct tile_map *map, struct error *err)
{
    uint32_t *places = mem_alloc_array((size_t)map->worker_count + 1, sizeof *places);

    NEED(places, err, "a frame's workers");
    join_workers(map, places);
    for (uint32_t i = 0; i < map->count; i++) {
        struct tile_cell *cell = &map->cells[i];
        cell->worker = places[cell->worker];
        if (cell->share_count > 0)
            join_shares(&map->shares[cell->first_share], &cell->share_count, places);
        if (cell->share_count > shares_sent(map))
            cell->share_count = shares_sent(map);
    }
    mem_free(places);
    return STATUS_OK;
}
