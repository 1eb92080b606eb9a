/* A tile's state on disk, little-endian:
 *   magic, length in bytes, frame width, height, AOVs, tile (32 bits each)
 *   for each group: whole passes, samples of the short pass's end (0: none), levels, how many of WORK_COUNTERS follow the
 *     first (32 bits each)
 *     sums of the whole passes, if there are any; of the short one, if there is one:
 *       the work (64 bits each: counts, doubles, the health's counts and examples), tail count, 0,
 *       tail, values (doubles)
 *     radiance of the whole passes since the last level, if there are any (floats)
 *     levels (those that were left out say so, and are 0), log of the passes
 *   64-bit check of all before
 * Frame and tile are repeated so that a state that was written to the wrong place is detected. The
 * cap is not part of it: a short pass says where it ended. */
#include <math.h>
#include <string.h>

#include "common/base/bytes.h"
#include "common/base/memory.h"
#include "common/film/film_parts.h"

enum {
    STATE_MAGIC = 0x375a5441, /* "ATZ7": 6 lacks the subject's samples */
    STATE_HEADER_BYTES = 6 * 4,
    GROUP_HEADER_BYTES = 4 * 4,
    HEALTH_ALL = (1 << HEALTH_KINDS) - 1,
    TAIL_BYTES = 8 + TAIL_MAX * 8,
    LOG_BYTES = 16,
    STATE_CHECK_BYTES = 8,
};

/* ---- lengths -------------------------------------------------------------------------------- */

size_t film_work_bytes(uint32_t counters, uint32_t mask)
{
    return (counters + 2 + DEPTH_SUMS + 2 * (size_t)__builtin_popcount(mask)) * 8;
}

static size_t sums_size(uint32_t counters, size_t numbers)
{
    return film_work_bytes(counters, HEALTH_ALL) + TAIL_BYTES + numbers * 8;
}

static size_t recent_size(const struct film *film, uint32_t tile, uint32_t whole_passes)
{
    return film_has_recent(whole_passes) ? film_radiance_numbers(film, tile) * sizeof(float) : 0;
}

static size_t group_size(size_t sums, int parts, size_t recent, uint32_t levels, uint32_t passes)
{
    return GROUP_HEADER_BYTES + (size_t)parts * sums + recent + (size_t)levels * FILM_LEVEL_BYTES +
           (size_t)passes * LOG_BYTES;
}

static int has_cut(const struct film *film, uint32_t group, uint32_t passes)
{
    return passes > 0 && pass_is_short(film->spp, group, passes - 1);
}

static int parts_of(uint32_t whole_passes, int cut) { return (whole_passes > 0) + cut; }

size_t film_tile_state_size(const struct film *film, uint32_t tile)
{
    size_t size = STATE_HEADER_BYTES + STATE_CHECK_BYTES;

    for (uint32_t i = 0; i < GROUPS; i++) {
        const struct film_group *g = &film->tiles[tile].groups[i];
        int cut = has_cut(film, i, g->passes);
        uint32_t whole = g->passes - (uint32_t)cut;
        size += group_size(sums_size(WORK_COUNTER_COUNT, film_group_numbers(film, tile, i)), parts_of(whole, cut),
                           recent_size(film, tile, whole), g->level_count, g->passes);
    }
    return size;
}

size_t film_tile_state_bound(const struct film *film, uint32_t tile)
{
    size_t size = STATE_HEADER_BYTES + STATE_CHECK_BYTES;

    for (uint32_t i = 0; i < GROUPS; i++)
        size += group_size(sums_size(WORK_COUNTER_COUNT, film_group_numbers(film, tile, i)), 2,
                           film_radiance_numbers(film, tile) * sizeof(float), LEVELS_MAX, PASSES_MAX);
    return size;
}

size_t film_tile_length(const uint8_t prefix[FILM_STATE_PREFIX])
{
    const uint8_t *at = prefix;

    return bytes_take32(&at) == STATE_MAGIC ? bytes_take32(&at) : 0;
}

/* ---- to bytes ------------------------------------------------------------------------------- */

uint8_t *film_work_put(uint8_t *at, const struct unit_work *w, uint32_t mask)
{
    for (int i = 0; i < WORK_COUNTER_COUNT; i++)
        at = bytes_add64(at, w->count[i]);
    at = bytes_add_double(at, w->clamped_luminance);
    at = bytes_add_double(at, w->kept_luminance);
    for (int i = 0; i < DEPTH_SUMS; i++)
        at = bytes_add_double(at, w->depth.sum[i]);
    for (int k = 0; k < HEALTH_KINDS; k++) {
        if (!(mask >> k & 1))
            continue;
        at = bytes_add64(at, w->health.count[k]);
        at = bytes_add64(at, w->health.first[k]);
    }
    return at;
}

static uint8_t *put_sums(uint8_t *at, const struct film_sums *sums, size_t numbers)
{
    at = film_work_put(at, &sums->work, HEALTH_ALL);
    at = bytes_add32(at, sums->tail.count);
    at = bytes_add32(at, 0);
    for (uint32_t i = 0; i < TAIL_MAX; i++) {
        struct tail_entry e = i < sums->tail.count ? sums->tail.entries[i] : (struct tail_entry){0};
        at = bytes_add_float(at, e.value);
        at = bytes_add32(at, e.pixel);
    }
    for (size_t i = 0; i < numbers; i++)
        at = bytes_add_double(at, sums->values[i]);
    return at;
}

/* An even number of counts, two in 32 bits. */
static uint8_t *put_counts(uint8_t *at, const uint16_t *counts, int count)
{
    for (int i = 0; i < count; i += 2)
        at = bytes_add32(at, counts[i] | (uint32_t)counts[i + 1] << 16);
    return at;
}

uint8_t *film_level_put(uint8_t *at, const struct film_level *level)
{
    at = bytes_add64(at, level->rays);
    at = bytes_add64(at, level->subject);
    at = bytes_add_double(at, level->radiance);
    at = bytes_add_double(at, level->linear);
    at = bytes_add_float(at, level->display);
    at = bytes_add_float(at, level->channels);
    at = bytes_add32(at, (uint32_t)level->has_codes | (uint32_t)level->skipped << 1);
    at = put_counts(at, level->bins, LEVEL_BINS);
    return put_counts(at, level->spreads, LEVEL_SPREADS);
}

static uint8_t *put_group(uint8_t *at, const struct film *film, uint32_t tile, uint32_t group)
{
    const struct film_group *g = &film->tiles[tile].groups[group];
    int cut = has_cut(film, group, g->passes);
    size_t numbers = film_group_numbers(film, tile, group);

    at = bytes_add32(at, g->passes - (uint32_t)cut);
    at = bytes_add32(at, cut ? film_samples_after(film, group, g->passes) : 0);
    at = bytes_add32(at, g->level_count);
    at = bytes_add32(at, WORK_COUNTER_COUNT - WORK_COUNTERS_FIRST);
    if (g->passes > (uint32_t)cut)
        at = put_sums(at, g->whole, numbers);
    if (cut)
        at = put_sums(at, g->cut, numbers);
    for (size_t i = 0; i < recent_size(film, tile, g->passes - (uint32_t)cut) / sizeof(float); i++)
        at = bytes_add_float(at, g->recent[i]);
    for (uint32_t i = 0; i < g->level_count; i++)
        at = film_level_put(at, &g->levels[i]);
    for (uint32_t i = 0; i < g->passes; i++) {
        at = bytes_add64(at, g->log[i].hash);
        at = bytes_add32(at, g->log[i].deliverer);
        at = bytes_add32(at, g->log[i].cost);
    }
    return at;
}

void film_tile_save(const struct film *film, uint32_t index, uint8_t *out)
{
    uint8_t *at = out;

    at = bytes_add32(at, STATE_MAGIC);
    at = bytes_add32(at, (uint32_t)film_tile_state_size(film, index));
    at = bytes_add32(at, film->width);
    at = bytes_add32(at, film->height);
    at = bytes_add32(at, film->aovs);
    at = bytes_add32(at, index);
    for (uint32_t g = 0; g < GROUPS; g++)
        at = put_group(at, film, index, g);
    bytes_add64(at, hash_bytes(out, (size_t)(at - out)));
}

/* ---- from bytes ----------------------------------------------------------------------------- */

/* A group's header, checked against what follows it. */
struct group_header {
    uint32_t whole, cut_end, levels, counters;
    int keeps_cut;   /* the short pass also belongs to this cap */
    uint32_t passes; /* in the state */
};

static int get_group_header(const struct film *film, uint32_t group, const uint8_t **at, struct group_header *h)
{
    uint32_t samples = group_samples(film->spp, group), end;

    h->whole = bytes_take32(at);
    h->cut_end = bytes_take32(at);
    h->levels = bytes_take32(at);
    h->counters = WORK_COUNTERS_FIRST + bytes_take32(at);
    if (h->whole > PASSES_MAX || h->levels != level_count(h->whole) || h->counters < WORK_COUNTERS_FIRST ||
        h->counters > WORK_COUNTER_COUNT)
        return 0;
    end = h->whole ? pass_boundary(h->whole - 1) : 0;
    if (end > samples)
        return 0;
    if (h->cut_end != 0 && (h->whole == PASSES_MAX || h->cut_end <= end || h->cut_end >= pass_boundary(h->whole)))
        return 0;
    h->passes = h->whole + (h->cut_end != 0);
    h->keeps_cut = h->cut_end == samples && h->cut_end != 0;
    return 1;
}

static int floats_are_finite(const uint8_t *at, size_t size)
{
    for (size_t i = 0; i < size; i += sizeof(float))
        if (!isfinite(bytes_take_float(&at)))
            return 0;
    return 1;
}

static int sums_are_good(const uint8_t *at, uint32_t counters, size_t numbers)
{
    uint32_t tails;

    at += film_work_bytes(counters, HEALTH_ALL);
    tails = bytes_take32(&at);
    if (tails > TAIL_MAX)
        return 0;
    at += TAIL_BYTES - 4;
    for (size_t i = 0; i < numbers; i++)
        if (!isfinite(bytes_take_double(&at)))
            return 0;
    return 1;
}

void film_work_get(const uint8_t **at, struct unit_work *w, uint32_t counters, uint32_t mask)
{
    for (uint32_t i = 0; i < counters; i++)
        w->count[i] = bytes_take64(at);
    w->clamped_luminance = bytes_take_double(at);
    w->kept_luminance = bytes_take_double(at);
    for (int i = 0; i < DEPTH_SUMS; i++)
        w->depth.sum[i] = bytes_take_double(at);
    for (int k = 0; k < HEALTH_KINDS; k++) {
        if (!(mask >> k & 1))
            continue;
        w->health.count[k] = bytes_take64(at);
        w->health.first[k] = bytes_take64(at);
    }
}

static void get_sums(const uint8_t **at, struct film_sums *sums, uint32_t counters, size_t numbers)
{
    film_work_get(at, &sums->work, counters, HEALTH_ALL);
    sums->tail.count = bytes_take32(at);
    (void)bytes_take32(at);
    for (uint32_t i = 0; i < TAIL_MAX; i++) {
        sums->tail.entries[i].value = bytes_take_float(at);
        sums->tail.entries[i].pixel = (uint16_t)bytes_take32(at);
    }
    for (size_t i = 0; i < numbers; i++)
        sums->values[i] = bytes_take_double(at);
}

static void get_counts(const uint8_t **at, uint16_t *counts, int count)
{
    for (int i = 0; i < count; i += 2) {
        uint32_t two = bytes_take32(at);
        counts[i] = (uint16_t)two;
        counts[i + 1] = (uint16_t)(two >> 16);
    }
}

void film_level_get(const uint8_t **at, struct film_level *level)
{
    uint32_t flags;

    memset(level, 0, sizeof *level); /* including padding */
    level->rays = bytes_take64(at);
    level->subject = bytes_take64(at);
    level->radiance = bytes_take_double(at);
    level->linear = bytes_take_double(at);
    level->display = bytes_take_float(at);
    level->channels = bytes_take_float(at);
    flags = bytes_take32(at);
    level->has_codes = (int16_t)(flags & 1);
    level->skipped = (int16_t)(flags >> 1 & 1);
    get_counts(at, level->bins, LEVEL_BINS);
    get_counts(at, level->spreads, LEVEL_SPREADS);
}

/* Check the state and find each group's part of it. */
static status check_state(const struct film *film, uint32_t tile, const uint8_t *data, size_t size,
                          struct group_header headers[GROUPS], const uint8_t *parts[GROUPS], struct error *err)
{
    const uint8_t *at = data, *end, *check;

    if (tile >= film->tiles_total || size < STATE_HEADER_BYTES + STATE_CHECK_BYTES || film_tile_length(data) != size)
        return error_set(err, STATUS_ERR_CORRUPT, "tile %u: its state has %zu bytes", tile, size);
    end = check = data + size - STATE_CHECK_BYTES;
    if (bytes_take64(&check) != hash_bytes(data, size - STATE_CHECK_BYTES))
        return error_set(err, STATUS_ERR_CORRUPT, "tile %u: its stored state is damaged", tile);
    at += 8;
    if (bytes_take32(&at) != film->width || bytes_take32(&at) != film->height || bytes_take32(&at) != film->aovs || bytes_take32(&at) != tile)
        return error_set(err, STATUS_ERR_CORRUPT, "tile %u: the stored state belongs to another tile or frame", tile);
    for (uint32_t g = 0; g < GROUPS; g++) {
        struct group_header *h = &headers[g];
        size_t numbers = film_group_numbers(film, tile, g), sums, recent, size_all;
        int count;
        parts[g] = at;
        if (end - at < GROUP_HEADER_BYTES || !get_group_header(film, g, &at, h))
            return error_set(err, STATUS_ERR_CORRUPT, "tile %u: the stored state has passes that the frame has not",
                             tile);
        sums = sums_size(h->counters, numbers);
        count = parts_of(h->whole, h->cut_end != 0);
        recent = recent_size(film, tile, h->whole);
        size_all = group_size(sums, count, recent, h->levels, h->passes);
        if ((size_t)(end - parts[g]) < size_all)
            return error_set(err, STATUS_ERR_CORRUPT, "tile %u: its stored state is cut off", tile);
        for (int i = 0; i < count; i++)
            if (!sums_are_good(at + (size_t)i * sums, h->counters, numbers))
                return error_set(err, STATUS_ERR_CORRUPT, "tile %u: a stored sum is not finite", tile);
        if (!floats_are_finite(at + (size_t)count * sums, recent))
            return error_set(err, STATUS_ERR_CORRUPT, "tile %u: a stored sum is not finite", tile);
        at = parts[g] + size_all;
    }
    if (at != end)
        return error_set(err, STATUS_ERR_CORRUPT, "tile %u: its stored state is too long", tile);
    return STATUS_OK;
}

status film_tile_peek(const struct film *film, uint32_t tile, const uint8_t *data, size_t size_bytes,
                      uint32_t passes[GROUPS], struct error *err)
{
    struct group_header headers[GROUPS];
    const uint8_t *parts[GROUPS];
    status s = check_state(film, tile, data, size_bytes, headers, parts, err);

    for (uint32_t g = 0; g < GROUPS; g++)
        passes[g] = s == STATUS_OK ? headers[g].whole + (uint32_t)headers[g].keeps_cut : 0;
    return s;
}

static void group_clear(struct film *film, uint32_t tile, uint32_t group)
{
    struct film_group *g = &film->tiles[tile].groups[group];
    struct film_sums *both[2] = {g->whole, g->cut};

    film_group_forget_waiting(g);
    for (int i = 0; i < 2; i++) {
        if (!both[i])
            continue;
        unit_work_subtract(&film->work, &both[i]->work);
        memset(both[i], 0, sizeof *both[i] + film_group_numbers(film, tile, group) * sizeof(double));
    }
    for (uint32_t i = 0; i < g->level_count; i++)
        film_level_count(film, group, i, &g->levels[i], -1);
    for (uint32_t i = g->level_count; g->watch && i < g->watch->level_count; i++)
        film->at_level[group][i]--;
    mem_free(g->watch);
    g->watch = NULL;
    g->level_count = 0;
    film_group_set_passes(film, tile, group, 0);
}

static void group_load(struct film *film, uint32_t tile, uint32_t group, const struct group_header *h,
                       const uint8_t *at)
{
    struct film_group *g = &film->tiles[tile].groups[group];
    size_t numbers = film_group_numbers(film, tile, group);
    uint32_t passes = h->whole + (uint32_t)h->keeps_cut;

    group_clear(film, tile, group);
    at += GROUP_HEADER_BYTES;
    if (h->whole > 0) {
        get_sums(&at, g->whole, h->counters, numbers);
        unit_work_add(&film->work, &g->whole->work);
    }
    if (h->keeps_cut) {
        get_sums(&at, g->cut, h->counters, numbers);
        unit_work_add(&film->work, &g->cut->work);
    } else if (h->cut_end != 0) {
        at += sums_size(h->counters, numbers);
    }
    for (size_t i = 0; i < recent_size(film, tile, h->whole) / sizeof(float); i++)
        g->recent[i] = bytes_take_float(&at);
    for (uint32_t i = 0; i < h->levels; i++) {
        film_level_get(&at, &g->levels[i]);
        film_level_count(film, group, i, &g->levels[i], 1);
    }
    g->level_count = h->levels;
    for (uint32_t i = 0; i < passes; i++) {
        g->log[i].hash = bytes_take64(&at);
        g->log[i].deliverer = bytes_take32(&at);
        g->log[i].cost = bytes_take32(&at);
    }
    film_group_set_passes(film, tile, group, passes);
    film_want(film, tile, group, passes);
}

status film_tile_load(struct film *film, uint32_t index, const uint8_t *data, size_t size_bytes, struct error *err)
{
    struct group_header headers[GROUPS];
    const uint8_t *parts[GROUPS];
    TRY(check_state(film, index, data, size_bytes, headers, parts, err));
    for (uint32_t g = 0; g < GROUPS; g++)
        if ((headers[g].whole > 0 && !film_group_reserve(film, index, g, headers[g].whole)) ||
            (headers[g].keeps_cut && !film_group_reserve(film, index, g, headers[g].whole + 1)))
            return error_no_memory(err, "the film");
    for (uint32_t g = 0; g < GROUPS; g++)
        group_load(film, index, g, &headers[g], parts[g]);
    return STATUS_OK;
}

void film_tile_unload(struct film *film, uint32_t tile)
{
    for (uint32_t i = 0; i < GROUPS; i++) {
        struct film_group *g = &film->tiles[tile].groups[i];
        group_clear(film, tile, i);
        mem_free(g->whole);
        mem_free(g->cut);
        mem_free(g->log);
        mem_free(g->levels);
        mem_free(g->recent);
        g->whole = g->cut = NULL;
        g->recent = NULL;
        g->log = NULL;
        g->levels = NULL;
        g->log_capacity = g->level_capacity = 0;
    }
}
