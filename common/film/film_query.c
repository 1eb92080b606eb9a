/* What is asked of a film: its size, what is folded, wanted and waits, work, statistics. */
#include <string.h>

#include "common/film/film_parts.h"

uint32_t film_width(const struct film *film)
{
    return film->width;
}

uint32_t film_height(const struct film *film)
{
    return film->height;
}

uint32_t film_spp(const struct film *film)
{
    return film->spp;
}

uint32_t film_aovs(const struct film *film)
{
    return film->aovs;
}

uint32_t film_tile_count(const struct film *film)
{
    return film->tiles_total;
}

uint32_t film_pass_count(const struct film *film, uint32_t group)
{
    return film->passes_total[group];
}

uint32_t film_tile_passes(const struct film *film, uint32_t tile, uint32_t group)
{
    return film->tiles[tile].groups[group].passes;
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

uint64_t film_wanted(const struct film *film)
{
    return film->wanted;
}

uint32_t film_wanted_most(const struct film *film)
{
    uint32_t most = 0;

    for (uint32_t i = 0; i < film->tiles_total; i++)
        for (uint32_t g = 0; g < GROUPS; g++)
            if (film->tiles[i].groups[g].wanted > most)
                most = film->tiles[i].groups[g].wanted;
    return most;
}

static const struct waiting *waiting_find(const struct film_group *g, uint32_t pass)
{
    for (const struct waiting *w = g->waiting; w && w->pass <= pass; w = w->next)
        if (w->pass == pass)
            return w;
    return NULL;
}

int film_has(const struct film *film, uint32_t tile, uint32_t group, uint32_t pass)
{
    const struct film_group *g = &film->tiles[tile].groups[group];

    return pass < g->passes || waiting_find(g, pass) != NULL;
}

uint32_t film_deliverer(const struct film *film, uint32_t tile, uint32_t group, uint32_t pass)
{
    const struct film_group *g = &film->tiles[tile].groups[group];
    const struct waiting *w = waiting_find(g, pass);

    return pass < g->passes ? g->log[pass].deliverer : w ? w->deliverer : 0;
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

uint64_t film_samples(const struct film *film)
{
    return film->samples;
}

uint64_t film_samples_total(const struct film *film)
{
    return (uint64_t)film->width * film->height * film->spp;
}

int film_complete(const struct film *film)
{
    return film->behind == 0;
}

int film_covered(const struct film *film)
{
    return film->tiles_started == film->tiles_total;
}

const struct unit_work *film_work(const struct film *film)
{
    return &film->work;
}

uint64_t film_rays(const struct film *film)
{
    return film->work.rays;
}

uint64_t film_tile_rays(const struct film *film, uint32_t tile, uint32_t group)
{
    const struct film_group *g = &film->tiles[tile].groups[group];

    return (g->whole ? g->whole->work.rays : 0) + (g->cut ? g->cut->work.rays : 0);
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

int film_level(const struct film *film, uint32_t tile, uint32_t group, uint32_t level,
               struct film_level *out)
{
    const struct film_group *g = &film->tiles[tile].groups[group];

    if (level >= g->level_count)
        return 0;
    *out = g->levels[level];
    return 1;
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
    }
    return c;
}
