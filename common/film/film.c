#include <float.h>
#include <math.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/base/safeguard.h"
#include "common/film/film_parts.h"
#include "common/film/matte.h"

enum { LEVEL_OF_ONE_PASS = 3 }; /* the last level whose second half is one pass */

/* ---- life ----------------------------------------------------------------------------------- */

struct film *film_new(uint32_t width, uint32_t height, uint32_t spp) { return film_new_aovs(width, height, spp, 0); }

struct film *film_new_aovs(uint32_t width, uint32_t height, uint32_t spp, uint32_t aovs)
{
    struct film *film = mem_calloc(1, sizeof *film);

    if (!film)
        return NULL;
    film->width = width;
    film->height = height;
    film->spp = spp;
    film->aovs = aovs;
    film->tiles_total = tile_count(width, height);
    film->tiles = mem_calloc(film->tiles_total, sizeof *film->tiles);
    if (!film->tiles) {
        mem_free(film);
        return NULL;
    }
    for (uint32_t g = 0; g < GROUPS; g++) {
        film->passes_total[g] = pass_count(spp, g);
        for (uint32_t i = 0; i < film->tiles_total; i++) {
            film->tiles[i].groups[g].end = UINT32_MAX;
            film_want(film, i, g, 1);
        }
    }
    return film;
}

void film_group_forget_waiting(struct film_group *group)
{
    while (group->waiting) {
        struct waiting *next = group->waiting->next;
        mem_free(group->waiting);
        group->waiting = next;
    }
    group->waiting_count = 0;
}

void film_free(struct film *film)
{
    if (!film)
        return;
    for (uint32_t i = 0; i < film->tiles_total; i++)
        for (uint32_t g = 0; g < GROUPS; g++) {
            struct film_group *group = &film->tiles[i].groups[g];
            film_group_forget_waiting(group);
            mem_free(group->watch);
            mem_free(group->levels);
            mem_free(group->log);
            mem_free(group->cut);
            mem_free(group->whole);
            mem_free(group->recent);
        }
    mem_free(film->tiles);
    mem_free(film);
}

uint32_t film_tile_pixels(const struct film *film, uint32_t tile)
{
    struct tile_rect rect = tile_rect_of(film->width, film->height, tile);

    return rect.width * rect.height;
}

size_t film_unit_numbers(const struct film *film, uint32_t tile, uint32_t group, uint32_t pass)
{
    return tile_floats(film->width, film->height, tile, unit_aovs(film->aovs, group, pass));
}

size_t film_group_numbers(const struct film *film, uint32_t tile, uint32_t group)
{
    return film_unit_numbers(film, tile, group, 0);
}

uint32_t film_samples_after(const struct film *film, uint32_t group, uint32_t passes)
{
    uint32_t begin, end = 0;

    if (passes > 0)
        pass_range(film->spp, group, passes - 1, &begin, &end);
    return end;
}

/* ---- folding -------------------------------------------------------------------------------- */

static int sums_reserve(struct film_sums **sums, size_t numbers)
{
    if (!*sums)
        *sums = mem_calloc(1, sizeof **sums + numbers * sizeof *(*sums)->values);
    return *sums != NULL;
}

/* The second half of a level that has several passes. */
static int recent_reserve(const struct film *film, uint32_t tile, struct film_group *g, uint32_t passes)
{
    if (!g->recent && passes > level_passes(LEVEL_OF_ONE_PASS))
        g->recent = mem_alloc_array(film_radiance_numbers(film, tile), sizeof *g->recent);
    return g->recent || passes <= level_passes(LEVEL_OF_ONE_PASS);
}

int film_group_reserve(const struct film *film, uint32_t tile, uint32_t group, uint32_t passes)
{
    struct film_group *g = &film->tiles[tile].groups[group];
    int cut = passes > 0 && pass_is_short(film->spp, group, passes - 1);
    size_t numbers = film_group_numbers(film, tile, group);
    uint32_t levels = level_count(passes);

    return ((int)passes == cut || sums_reserve(&g->whole, numbers)) && (!cut || sums_reserve(&g->cut, numbers)) &&
           recent_reserve(film, tile, g, passes) && MEM_GROW(g->log, g->log_capacity, passes) &&
           MEM_GROW(g->levels, g->level_capacity, levels);
}

/* How many passes are to be folded. */
static uint32_t group_goal(const struct film_group *g) { return g->wanted < g->end ? g->wanted : g->end; }

void film_group_set_passes(struct film *film, uint32_t index, uint32_t group, uint32_t passes)
{
    struct film_group *g = &film->tiles[index].groups[group];
    uint64_t pixels = film_tile_pixels(film, index);
    uint32_t begins = (uint32_t)(passes > 0) - (uint32_t)(g->passes > 0); /* -1, 0 or 1 */

    if (film_tile_samples(film, index) == film_group_samples(film, index, group))
        film->tiles_started += begins;
    film->begun[group] += begins;
    film->samples -= pixels * film_samples_after(film, group, g->passes);
    film->samples += pixels * film_samples_after(film, group, passes);
    film->behind += (uint32_t)(passes < group_goal(g)) - (uint32_t)(g->passes < group_goal(g));
    g->passes = passes;
}

/* `second`: the sums of the level's second half. */
static void measure_level(const struct film *film, uint32_t tile, uint32_t group, uint32_t level, uint64_t rays,
                          uint64_t subject, const double *sums, const float *second, struct film_level *out)
{
    struct tile_rect rect = tile_rect_of(film->width, film->height, tile);

    out->rays = rays;
    out->subject = subject;
    film_level_measure(out, sums, level > 0 ? second : NULL, rect.width, rect.height, level_samples(level),
                       &film->codes[group]);
}

/* The sums of the passes since the last level, with this one, which is whole and comes after `passes`
 * others. `recent` is used if there are several. */
static const float *add_recent(float *recent, uint32_t passes, const float *sums, size_t count)
{
    if (film_has_recent(passes))
        for (size_t i = 0; i < count; i++) /* finite, as it is stored */
            recent[i] = fmaxf(fminf(recent[i] + sums[i], FLT_MAX), -FLT_MAX);
    else if (film_has_recent(passes + 1))
        memcpy(recent, sums, count * sizeof *recent);
    else
        return sums;
    return recent;
}

/* In double: in float the 296 passes of a million samples are off by up to 1.3e-6. */
static double film_add(double sum, float more)
{
    return SAFEGUARD(FILM_DOUBLE) ? sum + (double)more : (double)((float)sum + more);
}

/* A result's AOVs: those that are point-sampled are in one of a group's passes only, so they, too, may be added. */
static void add_aovs(const struct film *film, uint32_t tile, uint32_t group, uint32_t pass, const float *from,
                     double *to)
{
    uint32_t pixels = film_tile_pixels(film, tile);
    uint32_t sent = unit_aovs(film->aovs, group, pass), kept = unit_aovs(film->aovs, group, 0);

    for (int aov = 0; aov < AOV_COUNT; aov++) {
        size_t count = sent >> aov & 1 ? (size_t)pixels * aov_channels((enum aov)aov) : 0;
        const float *in = from + tile_aov_offset(pixels, sent, (enum aov)aov);
        double *out = to + tile_aov_offset(pixels, kept, (enum aov)aov);
        if (AOV_MATTES >> aov & 1) {
            for (size_t i = 0; i < count; i += MATTE_FLOATS)
                matte_add(out + i, in + i);
            continue;
        }
        for (size_t i = 0; i < count; i++)
            out[i] = film_add(out[i], in[i]);
    }
}

/* The group's statistics at the level that `pass`, a whole one, completes; NULL: it completes none, or they are left
 * out. */
static const struct film_level *group_level(struct film *film, const struct unit_result *unit,
                                            const struct film_level *known)
{
    struct film_group *g = &film->tiles[unit->tile].groups[unit->group];
    const float *recent = add_recent(g->recent, unit->pass, unit->sums, film_radiance_numbers(film, unit->tile));
    int level = level_at(g->passes);
    struct film_level *out = &g->levels[level < 0 ? 0 : level];

    if (level < 0)
        return NULL;
    g->level_count = (uint32_t)level + 1;
    if (known)
        *out = *known;
    else if ((uint32_t)level < film->measure_from || (level > 0 && !film->frozen[unit->group]))
        *out = (struct film_level){.skipped = 1};
    else
        measure_level(film, unit->tile, unit->group, (uint32_t)level, g->whole->work.rays,
                      g->whole->work.subject_samples, g->whole->values, recent, out);
    film_level_count(film, unit->group, (uint32_t)level, out, 1);
    return out->skipped ? NULL : out;
}

void film_on_fold(struct film *film, void (*fold)(void *user, const struct film_fold *fold), void *user)
{
    film->on_fold = fold;
    film->on_fold_user = user;
}

void film_group_fold(struct film *film, const struct unit_result *unit, struct film_log_entry entry,
                     const struct film_level *known)
{
    uint32_t tile = unit->tile, group = unit->group, pass = unit->pass;
    struct film_group *g = &film->tiles[tile].groups[group];
    int cut = pass_is_short(film->spp, group, pass);
    struct film_sums *into = cut ? g->cut : g->whole;
    const struct film_level *level;
    size_t count = film_radiance_numbers(film, tile);

    for (size_t i = 0; i < count; i++)
        into->values[i] = film_add(into->values[i], unit->sums[i]);
    if (film->aovs)
        add_aovs(film, tile, group, pass, unit->sums, into->values);
    tail_merge(&into->tail, &unit->tail);
    unit_work_add(&into->work, &unit->work);
    unit_work_add(&film->work, &unit->work);
    g->log[pass] = entry;
    film_group_set_passes(film, tile, group, pass + 1);
    level = cut ? NULL : group_level(film, unit, known);
    if (film->on_fold)
        film->on_fold(film->on_fold_user,
                      &(struct film_fold){.unit = unit, .deliverer = entry.deliverer, .cost = entry.cost,
                                          .hash = entry.hash, .level = level});
}

/* Begin to watch a group that has ended. 0: out of memory. */
static int watch_reserve(const struct film *film, uint32_t tile, uint32_t group)
{
    struct film_group *g = &film->tiles[tile].groups[group];
    size_t count = film_radiance_numbers(film, tile);

    if (g->watch)
        return 1;
    g->watch = mem_calloc(1, sizeof *g->watch + count * (sizeof *g->watch->values + sizeof *g->watch->recent));
    if (!g->watch)
        return 0;
    g->watch->recent = (float *)(g->watch->values + count);
    if (film_has_recent(g->passes))
        memcpy(g->watch->recent, g->recent, count * sizeof *g->watch->recent);
    g->watch->passes = g->passes;
    g->watch->level_count = g->level_count;
    if (g->whole) {
        g->watch->rays = g->whole->work.rays;
        g->watch->subject = g->whole->work.subject_samples;
        memcpy(g->watch->values, g->whole->values, count * sizeof *g->watch->values);
    }
    return 1;
}

static void watch_fold(struct film *film, uint32_t tile, uint32_t group, const float *sums,
                       const struct unit_work *work)
{
    struct film_watch *w = film->tiles[tile].groups[group].watch;
    size_t count = film_radiance_numbers(film, tile);
    const float *recent = add_recent(w->recent, w->passes, sums, count);
    int level;

    for (size_t i = 0; i < count; i++)
        w->values[i] = film_add(w->values[i], sums[i]);
    w->rays += work->rays;
    w->subject += work->subject_samples;
    w->passes++;
    level = level_at(w->passes);
    if (level < 0)
        return;
    w->level_count = (uint32_t)level + 1;
    film->at_level[group][level]++; /* rounds read what is watched */
    measure_level(film, tile, group, (uint32_t)level, w->rays, w->subject, w->values, recent, &w->levels[level]);
}

/* How many passes may be folded at present. */
static uint32_t group_limit(const struct film *film, const struct film_group *g, uint32_t group)
{
    return film->frozen[group] || g->wanted == 0 ? g->wanted : 1;
}

/* Fold a result that may be folded; watch it if the group has ended. 0: out of memory. */
static int group_take(struct film *film, const struct unit_result *unit, struct film_log_entry entry)
{
    const struct film_group *g = &film->tiles[unit->tile].groups[unit->group];

    if (film_group_seen(g) < g->end)
        film_group_fold(film, unit, entry, NULL);
    else if (watch_reserve(film, unit->tile, unit->group))
        watch_fold(film, unit->tile, unit->group, unit->sums, &unit->work);
    else
        return 0;
    return 1;
}

/* Waiting results that may be folded now. Memory was reserved when they arrived. Without memory for
 * watching, a result is forgotten and rendered again. */
static void group_fold_waiting(struct film *film, uint32_t tile, uint32_t group)
{
    struct film_group *g = &film->tiles[tile].groups[group];

    while (g->waiting && g->waiting->unit.pass == film_group_seen(g) && film_group_seen(g) < group_limit(film, g, group)) {
        struct waiting *w = g->waiting;
        (void)group_take(film, &w->unit,
                         (struct film_log_entry){.hash = w->hash, .deliverer = w->deliverer, .cost = w->cost});
        g->waiting = w->next;
        g->waiting_count--;
        mem_free(w);
    }
}

static status group_wait(struct film_group *g, struct waiting **at, const struct unit_result *unit, uint32_t deliverer,
                         uint64_t hash, struct error *err)
{
    struct waiting *entry = mem_alloc(sizeof *entry + unit->count * sizeof *unit->sums);

    NEED(entry, err, "an early tile result");
    entry->deliverer = deliverer;
    entry->cost = 0;
    entry->hash = hash;
    entry->unit = *unit;
    entry->unit.sums = memcpy(entry->sums, unit->sums, unit->count * sizeof *unit->sums);
    entry->next = *at;
    *at = entry;
    g->waiting_count++;
    return STATUS_OK;
}

int film_mattes_are_valid(const struct film *film, const struct unit_result *unit)
{
    const uint32_t pixels = film_tile_pixels(film, unit->tile), sent = unit_aovs(film->aovs, unit->group, unit->pass);
    uint32_t begin, end;

    pass_range(film->spp, unit->group, unit->pass, &begin, &end);
    for (int aov = 0; aov < AOV_COUNT && film->aovs & AOV_MATTES; aov++) {
        const float *values = unit->sums + tile_aov_offset(pixels, sent, (enum aov)aov);
        for (uint32_t p = 0; (film->aovs & AOV_MATTES) >> aov & 1 && p < pixels; p++)
            if (!matte_is_valid(values + (size_t)p * MATTE_FLOATS, end - begin))
                return 0;
    }
    return 1;
}

static status check_result(const struct film *film, const struct unit_result *unit, struct error *err)
{
    uint32_t tile = unit->tile, group = unit->group, pass = unit->pass;

    if (tile >= film->tiles_total)
        return error_set(err, STATUS_ERR_INPUT, "tile %u: the frame has %u", tile, film->tiles_total);
    if (group >= GROUPS || pass >= film->passes_total[group])
        return error_set(err, STATUS_ERR_INPUT, "tile %u, group %u: the frame has no pass %u", tile, group, pass);
    if (unit->count != film_unit_numbers(film, tile, group, pass))
        return error_set(err, STATUS_ERR_INPUT, "tile %u, group %u, pass %u: %zu numbers instead of %zu", tile, group,
                         pass, unit->count, film_unit_numbers(film, tile, group, pass));
    for (size_t i = 0; i < unit->count; i++)
        if (!isfinite(unit->sums[i]) && SAFEGUARD(FINITE_UNIT))
            return error_set(err, STATUS_ERR_INPUT, "tile %u, group %u, pass %u: number %zu is not finite", tile, group,
                             pass, i);
    if (!tail_is_valid(&unit->tail, film_tile_pixels(film, tile)))
        return error_set(err, STATUS_ERR_INPUT,
                         "tile %u, group %u, pass %u: its largest contributions are out of order "
                         "or range",
                         tile, group, pass);
    if (!film_mattes_are_valid(film, unit))
        return error_set(err, STATUS_ERR_INPUT, "tile %u, group %u, pass %u: its counts of things are impossible", tile,
                         group, pass);
    return STATUS_OK;
}

/* Was the result folded, watched, or did it come and wait? Then says what this one is: it is not added
 * again. `next`: the first that waits and is not of an earlier pass; NULL: none. */
static int is_known(const struct film_group *g, uint32_t pass, uint64_t hash, const struct waiting *next,
                    enum film_merge_result *result)
{
    const struct waiting *same = next && next->unit.pass == pass ? next : NULL;

    *result = FILM_DUPLICATE;
    if (!SAFEGUARD(DUPLICATE_UNIT))
        return 0;
    if (pass < g->passes && g->log[pass].hash != hash)
        *result = FILM_CONFLICT;
    if (same && same->hash != hash)
        *result = FILM_CONFLICT;
    /* Of what was watched nothing is known but its part of a sum. */
    return same || pass < film_group_seen(g);
}

/* Must the result wait for those before it? Sums follow the order of passes, not of arrival. */
static int is_early(const struct film *film, const struct film_group *g, uint32_t group, uint32_t pass)
{
    return (pass > film_group_seen(g) && SAFEGUARD(PASS_ORDER)) || pass >= group_limit(film, g, group);
}

status film_merge(struct film *film, const struct unit_result *unit, uint32_t deliverer, enum film_merge_result *result,
                  struct error *err)
{
    struct film_group *g;
    struct waiting **at;
    uint64_t hash;
    status s = check_result(film, unit, err);

    *result = FILM_DUPLICATE;
    if (s != STATUS_OK)
        return s;
    g = &film->tiles[unit->tile].groups[unit->group];
    hash = unit_hash(unit);
    for (at = &g->waiting; *at && (*at)->unit.pass < unit->pass; at = &(*at)->next)
        ;
    if (is_known(g, unit->pass, hash, *at, result))
        return STATUS_OK;
    NEED(film_group_reserve(film, unit->tile, unit->group, unit->pass + 1), err, "the film");
    if (is_early(film, g, unit->group, unit->pass)) {
        *result = FILM_WAITING;
        return group_wait(g, at, unit, deliverer, hash, err);
    }
    if (!group_take(film, unit, (struct film_log_entry){.hash = hash, .deliverer = deliverer}))
        return error_no_memory(err, "the film");
    group_fold_waiting(film, unit->tile, unit->group);
    *result = FILM_MERGED;
    return STATUS_OK;
}

/* ---- wanted numbers and levels -------------------------------------------------------------- */

void film_want(struct film *film, uint32_t tile, uint32_t group, uint32_t passes)
{
    struct film_group *g = &film->tiles[tile].groups[group];

    if (passes > film->passes_total[group])
        passes = film->passes_total[group];
    if (passes <= g->wanted)
        return;
    film->wanted += passes - g->wanted;
    film->behind += g->passes == group_goal(g) && g->wanted < g->end;
    g->wanted = passes;
    group_fold_waiting(film, tile, group);
}

void film_want_all(struct film *film)
{
    for (uint32_t i = 0; i < film->tiles_total; i++)
        for (uint32_t g = 0; g < GROUPS; g++)
            film_want(film, i, g, film->passes_total[g]);
}

void film_want_nothing(struct film *film)
{
    for (uint32_t i = 0; i < film->tiles_total; i++)
        for (uint32_t k = 0; k < GROUPS; k++) {
            struct film_group *g = &film->tiles[i].groups[k];
            film->wanted -= g->wanted - g->passes;
            film->behind -= g->passes < group_goal(g);
            g->wanted = g->passes;
        }
}

void film_end_group(struct film *film, uint32_t group)
{
    for (uint32_t i = 0; i < film->tiles_total; i++) {
        struct film_group *g = &film->tiles[i].groups[group];
        if (g->end == UINT32_MAX)
            g->end = g->wanted;
    }
}

void film_freeze(struct film *film, uint32_t group, const struct film_codes *codes)
{
    if (film->frozen[group])
        return;
    film->frozen[group] = 1;
    if (codes)
        film->codes[group] = *codes;
    for (uint32_t i = 0; i < film->tiles_total; i++)
        group_fold_waiting(film, i, group);
}

int film_is_frozen(const struct film *film, uint32_t group) { return film->frozen[group]; }

const struct film_codes *film_codes_of(const struct film *film, uint32_t group)
{
    return film->frozen[group] && film->codes[group].codes ? &film->codes[group] : NULL;
}

void film_measure_from(struct film *film, uint32_t level) { film->measure_from = level; }

void film_take_levels(struct film *film, const struct film *other)
{
    for (uint32_t i = 0; i < film->tiles_total; i++)
        for (uint32_t group = 0; group < GROUPS; group++) {
            struct film_group *g = &film->tiles[i].groups[group];
            const struct film_group *from = &other->tiles[i].groups[group];
            for (uint32_t k = 0; k < g->level_count && k < from->level_count; k++) {
                if (!g->levels[k].skipped || from->levels[k].skipped)
                    continue;
                film_level_count(film, group, k, &g->levels[k], -1);
                g->levels[k] = from->levels[k];
                film_level_count(film, group, k, &g->levels[k], 1);
            }
        }
}

int film_wants_freeze(const struct film *film, uint32_t group)
{
    return !film->frozen[group] && film->passes_total[group] > 1 && film->begun[group] == film->tiles_total;
}
