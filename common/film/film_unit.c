/* A folded unit on disk, little-endian:
 *   group, pass, deliverer, cost, tail count, level + 1 (0: none, or left out) (32 bits each)
 *   mask of the health's counters (24 bits), how many of WORK_COUNTERS follow the first (8 bits), floats (32 bits)
 *   hash, work (64 bits each: counts, doubles), of the counters in the mask count and example (64 bits each)
 *   tail (value and pixel, 32 bits each), the level, if there is one, sums (floats) */
#include <math.h>
#include <string.h>

#include "common/base/bytes.h"
#include "common/film/film_parts.h"

enum { HEAD_BYTES = 8 * 4, COST_AT = 12, MASK_BITS = 24, MORE_COUNTERS = WORK_COUNTER_COUNT - WORK_COUNTERS_FIRST };
_Static_assert((int)HEALTH_KINDS <= MASK_BITS, "a unit's head has a bit for each");

static uint32_t health_mask(const struct health *health)
{
    uint32_t mask = 0;

    for (int k = 0; k < HEALTH_KINDS; k++)
        mask |= (uint32_t)(health->count[k] > 0 || health->first[k] > 0) << k;
    return mask;
}

static size_t unit_size(uint32_t more, uint32_t mask, uint32_t tails, int level, size_t count)
{
    return HEAD_BYTES + 8 + film_work_bytes(WORK_COUNTERS_FIRST + more, mask) + tails * 8 +
           (level ? FILM_LEVEL_BYTES : 0) + count * sizeof(float);
}

size_t film_unit_size(const struct film_fold *f)
{
    return unit_size(MORE_COUNTERS, health_mask(&f->unit->work.health), f->unit->tail.count, f->level != NULL,
                     f->unit->count);
}

void film_unit_save(const struct film_fold *f, uint8_t *out)
{
    const struct unit_result *u = f->unit;
    uint32_t mask = health_mask(&u->work.health);
    const uint32_t head[] = {u->group, u->pass, f->deliverer, f->cost, u->tail.count,
                             f->level ? (uint32_t)level_at(u->pass + 1) + 1 : 0,
                             mask | (uint32_t)MORE_COUNTERS << MASK_BITS, (uint32_t)u->count};
    uint8_t *at = out;

    for (size_t i = 0; i < sizeof head / sizeof *head; i++)
        at = bytes_add32(at, head[i]);
    at = film_work_put(bytes_add64(at, f->hash), &u->work, mask);
    for (uint32_t i = 0; i < u->tail.count; i++)
        at = bytes_add32(bytes_add_float(at, u->tail.entries[i].value), u->tail.entries[i].pixel);
    if (f->level)
        at = film_level_put(at, f->level);
    for (size_t i = 0; i < u->count; i++)
        at = bytes_add_float(at, u->sums[i]);
}

void film_unit_set_cost(const struct film *film, uint32_t tile, uint8_t *unit)
{
    const struct film_group *g = &film->tiles[tile].groups[bytes_get32(unit)];

    bytes_put32(unit + COST_AT, g->log[bytes_get32(unit + 4)].cost);
}

/* What a unit begins with, without its hash. */
struct unit_head {
    uint32_t group, pass, deliverer, cost, tails, level, mask, count, more; /* `more`: counters */
};

static int head_fits(const struct film *film, uint32_t tile, const struct unit_head *h, size_t size)
{
    return tile < film->tiles_total && h->group < GROUPS && h->pass < PASSES_MAX && h->tails <= TAIL_MAX &&
           h->level <= 1 + (uint32_t)LEVELS_MAX && h->mask < 1u << HEALTH_KINDS && h->more <= MORE_COUNTERS &&
           h->count == film_unit_numbers(film, tile, h->group, h->pass) &&
           size == unit_size(h->more, h->mask, h->tails, h->level > 0, h->count);
}

static status fold(struct film *film, const struct unit_result *unit, const struct unit_head *h, uint64_t hash,
                   const struct film_level *level, struct error *err)
{
    void (*listener)(void *user, const struct film_fold *fold) = film->on_fold;

    if (!film_group_reserve(film, unit->tile, unit->group, unit->pass + 1))
        return error_no_memory(err, "the film");
    film->on_fold = NULL;
    film_group_fold(film, unit, (struct film_log_entry){.hash = hash, .deliverer = h->deliverer, .cost = h->cost},
                    level);
    film->on_fold = listener;
    film_want(film, unit->tile, unit->group, unit->pass + 1);
    return STATUS_OK;
}

/* Is it of a pass that the film's cap allows, with as many samples? */
static int cap_allows(const struct film *film, uint32_t tile, const struct unit_head *h, uint64_t samples)
{
    uint32_t begin, end;

    if (h->pass >= film->passes_total[h->group])
        return 0;
    pass_range(film->spp, h->group, h->pass, &begin, &end);
    return samples == (uint64_t)(end - begin) * film_tile_pixels(film, tile);
}

status film_unit_load(struct film *film, uint32_t tile, const uint8_t *data, size_t size_bytes,
                      enum film_unit_load *result, struct error *err)
{
    float sums[TILE_FLOATS_MAX];
    struct unit_result unit = {.tile = tile, .sums = sums};
    struct film_level level;
    struct unit_head h = {0};
    uint32_t *const head[] = {&h.group, &h.pass, &h.deliverer, &h.cost, &h.tails, &h.level, &h.mask, &h.count};
    const uint8_t *at = data;
    int completes, finite = 1;
    uint64_t hash;

    *result = FILM_UNIT_OTHER;
    for (size_t i = 0; i < sizeof head / sizeof *head && size_bytes >= HEAD_BYTES; i++, at += 4)
        *head[i] = bytes_get32(at);
    h.more = h.mask >> MASK_BITS;
    h.mask &= (1u << MASK_BITS) - 1;
    if (size_bytes < HEAD_BYTES || !head_fits(film, tile, &h, size_bytes))
        return error_set(err, STATUS_ERR_CORRUPT, "tile %u: a stored result is not of this frame", tile);
    unit.group = h.group;
    unit.pass = h.pass;
    unit.count = h.count;
    hash = bytes_take64(&at);
    film_work_get(&at, &unit.work, WORK_COUNTERS_FIRST + h.more, h.mask);
    unit.tail.count = h.tails;
    for (uint32_t i = 0; i < h.tails; i++, at += 8)
        unit.tail.entries[i] =
            (struct tail_entry){.value = bytes_get_float(at), .pixel = (uint16_t)bytes_get32(at + 4)};
    if (h.level)
        film_level_get(&at, &level);
    for (uint32_t i = 0; i < h.count; i++, at += 4) {
        sums[i] = bytes_get_float(at);
        finite &= isfinite(sums[i]);
    }
    if (!cap_allows(film, tile, &h, unit.work.samples))
        return STATUS_OK;
    completes = pass_is_short(film->spp, h.group, h.pass) ? 0 : level_at(h.pass + 1) + 1;
    if (!finite || !film_mattes_are_valid(film, &unit) || !tail_is_valid(&unit.tail, film_tile_pixels(film, tile)) || (h.level > 0 && h.level != (uint32_t)completes))
        return error_set(err, STATUS_ERR_CORRUPT, "tile %u: a stored result has impossible values", tile);
    *result = h.pass < film_tile_passes(film, tile, h.group) ? FILM_UNIT_KNOWN : FILM_UNIT_GAP;
    if (h.pass != film_tile_passes(film, tile, h.group))
        return STATUS_OK;
    *result = FILM_UNIT_LOADED;
    return fold(film, &unit, &h, hash, h.level ? &level : NULL, err);
}
