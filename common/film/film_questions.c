#include <math.h>
#include <string.h>

#include "common/film/film_parts.h"
#include "common/math/elementary.h"

uint32_t film_width(const struct film *film) { return film->width; }

uint32_t film_height(const struct film *film) { return film->height; }

uint32_t film_spp(const struct film *film) { return film->spp; }

uint32_t film_aovs(const struct film *film) { return film->aovs; }

uint32_t film_tile_count(const struct film *film) { return film->tiles_total; }

uint32_t film_pass_count(const struct film *film, uint32_t group) { return film->passes_total[group]; }

uint32_t film_tile_passes(const struct film *film, uint32_t tile, uint32_t group)
{
    return film->tiles[tile].groups[group].passes;
}

uint32_t film_tile_seen(const struct film *film, uint32_t tile, uint32_t group)
{
    return film_group_seen(&film->tiles[tile].groups[group]);
}

uint32_t film_tile_wanted(const struct film *film, uint32_t tile, uint32_t group)
{
    return film->tiles[tile].groups[group].wanted;
}

uint32_t film_tile_waiting(const struct film *film, uint32_t tile)
{
    uint32_t count = 0;

    for (uint32_t g = 0; g < GROUPS; g++)
        count += film->tiles[tile].groups[g].waiting_count;
    return count;
}

uint64_t film_wanted(const struct film *film) { return film->wanted; }

static const struct waiting *waiting_find(const struct film_group *g, uint32_t pass)
{
    for (const struct waiting *w = g->waiting; w && w->unit.pass <= pass; w = w->next)
        if (w->unit.pass == pass)
            return w;
    return NULL;
}

int film_has(const struct film *film, uint32_t tile, uint32_t group, uint32_t pass)
{
    const struct film_group *g = &film->tiles[tile].groups[group];

    return pass < film_group_seen(g) || waiting_find(g, pass) != NULL;
}

uint32_t film_deliverer(const struct film *film, uint32_t tile, uint32_t group, uint32_t pass)
{
    const struct film_group *g = &film->tiles[tile].groups[group];
    const struct waiting *w = waiting_find(g, pass);

    return pass < g->passes ? g->log[pass].deliverer : w ? w->deliverer : 0;
}

uint64_t film_unit_hash(const struct film *film, uint32_t tile, uint32_t group, uint32_t pass)
{
    const struct film_group *g = &film->tiles[tile].groups[group];
    const struct waiting *w = waiting_find(g, pass);

    return pass < g->passes ? g->log[pass].hash : w ? w->hash : 0;
}

/* ---- who rendered it ------------------------------------------------------------------------- */

/* In 32 bits, from the lowest: the thread, then digits and exponent of the time. */
enum {
    COST_THREAD_BITS = 13,
    COST_DIGIT_BITS = 14,
    COST_EXPONENT_MAX = 31,      /* 2^45 ns are 9 hours */
    COST_THREAD_MAX = (1 << COST_THREAD_BITS) - 1,
    COST_DIGITS_MAX = (1 << COST_DIGIT_BITS) - 1,
};

static uint32_t cost_pack(uint32_t thread, uint64_t cpu_ns)
{
    uint32_t exponent = 0;

    while (cpu_ns > COST_DIGITS_MAX && exponent < COST_EXPONENT_MAX) {
        cpu_ns >>= 1;
        exponent++;
    }
    if (cpu_ns > COST_DIGITS_MAX)
        cpu_ns = COST_DIGITS_MAX;
    return (thread <= COST_THREAD_MAX ? thread : 0) | (uint32_t)cpu_ns << COST_THREAD_BITS |
           exponent << (COST_THREAD_BITS + COST_DIGIT_BITS);
}

static uint64_t cost_ns(uint32_t cost)
{
    return (uint64_t)(cost >> COST_THREAD_BITS & COST_DIGITS_MAX) << (cost >> (COST_THREAD_BITS + COST_DIGIT_BITS));
}

void film_note_cost(struct film *film, uint32_t tile, uint32_t group, uint32_t pass, uint32_t thread, uint64_t cpu_ns)
{
    struct film_group *g = &film->tiles[tile].groups[group];
    struct waiting *w = g->waiting;

    while (w && w->unit.pass < pass)
        w = w->next;
    if (pass < g->passes)
        g->log[pass].cost = cost_pack(thread, cpu_ns);
    else if (w && w->unit.pass == pass)
        w->cost = cost_pack(thread, cpu_ns);
}

void film_cost(const struct film *film, uint32_t tile, uint32_t group, uint32_t pass, uint32_t *thread,
               uint64_t *cpu_ns)
{
    const struct film_group *g = &film->tiles[tile].groups[group];
    uint32_t cost = pass < g->passes ? g->log[pass].cost : 0;

    *thread = cost & COST_THREAD_MAX;
    *cpu_ns = cost_ns(cost);
}

struct film_origin film_tile_origin(const struct film *film, uint32_t tile)
{
    const struct film_group *groups = film->tiles[tile].groups, *newest = groups;
    struct film_origin origin = {0};

    for (uint32_t g = 0; g < GROUPS; g++) {
        if (groups[g].passes > 0 && groups[g].passes >= newest->passes)
            newest = &groups[g]; /* units are lent in the order (pass, group) */
        origin.units += groups[g].passes;
        for (uint32_t pass = 0; pass < groups[g].passes; pass++)
            origin.cpu_ns += cost_ns(groups[g].log[pass].cost);
    }
    if (origin.units > 0) {
        origin.deliverer = newest->log[newest->passes - 1].deliverer;
        origin.thread = newest->log[newest->passes - 1].cost & COST_THREAD_MAX;
    }
    return origin;
}

uint32_t film_group_samples(const struct film *film, uint32_t tile, uint32_t group)
{
    return film_samples_after(film, group, film->tiles[tile].groups[group].passes);
}

uint32_t film_tile_samples(const struct film *film, uint32_t tile)
{
    uint32_t samples = 0;

    for (uint32_t g = 0; g < GROUPS; g++)
        samples += film_group_samples(film, tile, g);
    return samples;
}

uint64_t film_samples(const struct film *film) { return film->samples; }

uint64_t film_samples_total(const struct film *film) { return (uint64_t)film->width * film->height * film->spp; }

int film_complete(const struct film *film) { return film->behind == 0; }

int film_covered(const struct film *film) { return film->tiles_started == film->tiles_total; }

/* A group's sums for a mean sample of the tile's. 0: it has none. */
static int group_depth_light(const struct film_group *g, struct depth_light *mean)
{
    const struct film_sums *both[2] = {g->whole, g->cut};
    struct depth_light sum = {{0}};
    uint64_t samples = 0;

    for (int k = 0; k < 2; k++)
        if (both[k]) {
            depth_light_add(&sum, &both[k]->work.depth);
            samples += both[k]->work.samples;
        }
    if (samples > 0)
        depth_light_add_weighted(mean, &sum, 1 / (double)samples);
    return samples > 0;
}

/* As if each pixel had the mean number of samples, half of them in each group, so that it is about the picture
 * and not about where the samples are. In a fixed order, as sums of doubles depend on theirs. */
static struct depth_light film_depth_light(const struct film *film)
{
    struct depth_light all = {{0}}, scaled = {{0}};
    uint64_t pixels = 0;

    for (uint32_t t = 0; t < film->tiles_total; t++) {
        const uint32_t here = film_tile_pixels(film, t);
        struct depth_light mean = {{0}};
        int groups = 0;
        for (uint32_t i = 0; i < GROUPS; i++)
            groups += group_depth_light(&film->tiles[t].groups[i], &mean);
        if (groups == 0)
            continue;
        depth_light_add_weighted(&all, &mean, (double)here / groups);
        pixels += here;
    }
    if (pixels > 0)
        depth_light_add_weighted(&scaled, &all, (double)film->work.samples / (double)pixels);
    return scaled;
}

struct unit_work film_work(const struct film *film)
{
    struct unit_work work = film->work;
    const int ill = health_is_ill(&work.health);

    memset(work.health.first, 0, sizeof work.health.first);
    work.depth = film_depth_light(film);
    if (work.clamped_samples == 0 && !(work.kept_luminance > 0) && !ill)
        return work;
    /* film->work is in the order of arrival, and sums of doubles depend on theirs; its examples may be
     * of passes that were taken back. */
    work.clamped_luminance = work.kept_luminance = 0;
    for (uint32_t t = 0; t < film->tiles_total; t++)
        for (uint32_t i = 0; i < GROUPS; i++) {
            const struct film_group *g = &film->tiles[t].groups[i];
            const struct film_sums *both[2] = {g->whole, g->cut};
            for (int k = 0; k < 2; k++) {
                work.clamped_luminance += both[k] ? both[k]->work.clamped_luminance : 0;
                work.kept_luminance += both[k] ? both[k]->work.kept_luminance : 0;
                for (int h = 0; ill && both[k] && h < HEALTH_KINDS; h++)
                    health_example(&work.health, (enum health_kind)h, 0, both[k]->work.health.first[h]);
            }
        }
    return work;
}

uint64_t film_rays(const struct film *film) { return film->work.rays; }

uint64_t film_tile_rays(const struct film *film, uint32_t tile, uint32_t group)
{
    const struct film_group *g = &film->tiles[tile].groups[group];

    return (g->whole ? g->whole->work.rays : 0) + (g->cut ? g->cut->work.rays : 0);
}

double film_tile_subject(const struct film *film, uint32_t tile)
{
    uint64_t samples = 0, subject = 0;

    for (uint32_t i = 0; i < GROUPS; i++) {
        const struct film_group *g = &film->tiles[tile].groups[i];
        const struct film_sums *both[2] = {g->whole, g->cut};
        for (int k = 0; k < 2; k++) {
            samples += both[k] ? both[k]->work.samples : 0;
            subject += both[k] ? both[k]->work.subject_samples : 0;
        }
    }
    return samples > 0 ? (double)subject / (double)samples : 0;
}

void film_tail(const struct film *film, uint32_t tile, uint32_t group, struct tail *out)
{
    const struct film_group *g = &film->tiles[tile].groups[group];

    memset(out, 0, sizeof *out);
    if (g->whole)
        *out = g->whole->tail;
    if (g->cut)
        tail_merge(out, &g->cut->tail);
}

int film_level(const struct film *film, uint32_t tile, uint32_t group, uint32_t level, struct film_level *out)
{
    const struct film_group *g = &film->tiles[tile].groups[group];

    if (level < g->level_count)
        *out = g->levels[level];
    else if (g->watch && level < g->watch->level_count)
        *out = g->watch->levels[level];
    else
        return 0;
    return !out->skipped;
}

int film_level_is_complete(const struct film *film, uint32_t group, uint32_t level)
{
    return film->at_level[group][level] == film->tiles_total;
}

int film_level_is_skipped(const struct film *film, uint32_t group, uint32_t level)
{
    return film->skipped[group][level] > 0;
}

int film_has_skipped(const struct film *film)
{
    for (uint32_t g = 0; g < GROUPS; g++)
        for (uint32_t k = 0; k < LEVELS_MAX; k++)
            if (film->skipped[g][k] > 0)
                return 1;
    return 0;
}

double film_covered_share(const struct film *film) { return (double)film->tiles_started / (double)film->tiles_total; }

double film_unevenness(const struct film *film)
{
    double sum = 0, squares = 0, count = 0;

    for (uint32_t i = 0; i < film->tiles_total; i++)
        for (uint32_t g = 0; g < GROUPS; g++) {
            uint32_t passes = film_tile_passes(film, i, g), wanted = film_tile_wanted(film, i, g), begin, has, wants;
            double half;
            if (passes == 0 || wanted == 0)
                continue;
            pass_range(film->spp, g, passes - 1, &begin, &has);
            pass_range(film->spp, g, (wanted > passes ? wanted : passes) - 1, &begin, &wants);
            half = det_log_d((double)has / wants) / 2;
            sum += half;
            squares += half * half;
            count++;
        }
    return count > 0 ? sqrt(fmax(squares / count - sum * sum / count / count, 0)) : 0;
}

struct film_coverage film_coverage(const struct film *film)
{
    struct film_coverage c = {.samples = film->samples, .least = UINT32_MAX,
                              .tiles = film->tiles_total,
                              .tiles_empty = film->tiles_total - film->tiles_started};

    for (uint32_t i = 0; i < film->tiles_total; i++) {
        uint32_t samples = film_tile_samples(film, i);
        c.least = samples < c.least ? samples : c.least;
        c.most = samples > c.most ? samples : c.most;
        for (uint32_t g = 0; g < GROUPS; g++)
            if (film_group_samples(film, i, g) > c.group_most)
                c.group_most = film_group_samples(film, i, g);
    }
    return c;
}
