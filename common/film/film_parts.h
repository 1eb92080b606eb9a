/* film_parts: the internals of a film, shared by its files and private to them.
 *
 * film.c            life, merging
 * film_questions.c  what a film holds
 * film_develop.c    means, AOVs, the groups' difference
 * film_tile.c       the same of one tile, quickly
 * film_state.c      a tile's state as bytes
 * film_unit.c       a folded unit as bytes
 */
#pragma once

#include "common/film/film.h"

/* A result that may not be folded yet. */
struct waiting {
    struct waiting *next; /* ascending pass */
    uint32_t deliverer, cost;
    uint64_t hash;
    struct unit_result unit; /* with these sums: */
    float sums[];
};

/* Sums of a group's whole passes, or of its short one. */
struct film_sums {
    struct unit_work work;
    struct tail tail;
    double values[]; /* as tile_floats() with unit_aovs(aovs, group, 0) */
};

struct film_log_entry {
    uint64_t hash; /* unit_hash() */
    uint32_t deliverer;
    uint32_t cost; /* film_note_cost: the time and the thread; 0: not known */
};

/* Passes of a group that has ended, for the statistics of their levels alone. */
struct film_watch {
    uint32_t passes, level_count; /* as if they were folded */
    uint64_t rays, subject;
    struct film_level levels[LEVELS_MAX]; /* those that the folded passes do not reach */
    float *recent;                        /* as in struct film_group; in the same memory */
    double values[];                      /* sums of the folded passes and these, radiance only */
};

struct film_group {
    struct film_sums *whole;  /* NULL until the first pass is folded */
    struct film_sums *cut;    /* the short pass; NULL: not folded */
    float *recent;            /* sums of radiance of the whole passes since the last level; NULL: no
                               * level has needed them yet */
    struct film_watch *watch; /* NULL: nothing is watched */
    uint32_t passes;          /* folded: a prefix of the schedule */
    uint32_t wanted;          /* to be rendered; up to `end` they are folded, then watched */
    uint32_t end;             /* UINT32_MAX until film_end_group */
    uint32_t waiting_count, level_count;
    struct waiting *waiting;
    struct film_log_entry *log; /* of the passes folded */
    size_t log_capacity, level_capacity;
    struct film_level *levels;
};

struct film_tile {
    struct film_group groups[GROUPS];
};

struct film {
    uint32_t width, height, spp, aovs;
    uint32_t tiles_total;
    uint32_t passes_total[GROUPS];
    struct film_tile *tiles;
    uint64_t samples;                      /* folded, over all pixels */
    uint64_t wanted;                       /* units */
    uint32_t tiles_started;                /* with at least one pass */
    uint32_t begun[GROUPS];                /* tiles with pass 0 of the group */
    uint32_t behind;                       /* tiles' groups with fewer passes folded than are to be */
    uint32_t at_level[GROUPS][LEVELS_MAX]; /* tiles with statistics of the level */
    uint32_t skipped[GROUPS][LEVELS_MAX];  /* tiles that reached it without */
    uint32_t measure_from;                 /* levels below it are skipped */
    int frozen[GROUPS];
    struct film_codes codes[GROUPS];
    struct unit_work work;
    void (*on_fold)(void *user, const struct film_fold *fold); /* NULL: none */
    void *on_fold_user;
};

uint32_t film_tile_pixels(const struct film *film, uint32_t tile);
/* Sums of radiance of the tile's pixels. */
static inline size_t film_radiance_numbers(const struct film *film, uint32_t tile)
{
    return (size_t)film_tile_pixels(film, tile) * PIXEL_FLOATS;
}
/* After so many whole passes, are some of them since the last level? */
static inline int film_has_recent(uint32_t passes) { return passes > 0 && level_at(passes) < 0; }
/* Values of film_sums. */
size_t film_group_numbers(const struct film *film, uint32_t tile, uint32_t group);
/* Samples of the group that `passes` passes hold. */
uint32_t film_samples_after(const struct film *film, uint32_t group, uint32_t passes);
/* Reserve memory for so many folded passes, so that folding itself cannot fail. 0: out of memory. */
int film_group_reserve(const struct film *film, uint32_t tile, uint32_t group, uint32_t passes);
/* Record that the group has this many folded passes now. */
void film_group_set_passes(struct film *film, uint32_t tile, uint32_t group, uint32_t passes);
void film_group_forget_waiting(struct film_group *group);
/* Fold the group's next pass, for which memory is reserved. `level`: what is known of the level that it completes;
 * NULL: it is measured. */
void film_group_fold(struct film *film, const struct unit_result *unit, struct film_log_entry entry,
                     const struct film_level *level);
/* Are the result's counts of things (matte.h) possible? Its other numbers are finite and as many as they should be. */
int film_mattes_are_valid(const struct film *film, const struct unit_result *unit);
/* Floats of a unit's result. */
size_t film_unit_numbers(const struct film *film, uint32_t tile, uint32_t group, uint32_t pass);

/* Count a tile's level, or take it out again (`tiles` -1). */
static inline void film_level_count(struct film *film, uint32_t group, uint32_t level, const struct film_level *is,
                                    int tiles)
{
    *(is->skipped ? &film->skipped[group][level] : &film->at_level[group][level]) += (uint32_t)tiles;
}

/* The work as bytes: so many of WORK_COUNTERS, and of the health's counters those in `mask`. All counters are put. */
size_t film_work_bytes(uint32_t counters, uint32_t mask);
uint8_t *film_work_put(uint8_t *out, const struct unit_work *work, uint32_t mask);
void film_work_get(const uint8_t **in, struct unit_work *work, uint32_t counters, uint32_t mask);

/* A level as bytes. */
enum { FILM_LEVEL_BYTES = 8 + 8 + 8 + 8 + 4 + 4 + 4 + LEVEL_BINS * 2 + LEVEL_SPREADS * 2 };
uint8_t *film_level_put(uint8_t *out, const struct film_level *level);
void film_level_get(const uint8_t **in, struct film_level *level);

/* How many passes are folded or watched. */
static inline uint32_t film_group_seen(const struct film_group *group)
{
    return group->watch ? group->watch->passes : group->passes;
}

/* Half the difference of the groups' means of radiance `i` of the tile, where both have samples: it has
 * the second moment of the picture's error. */
double film_half_difference(const struct film *film, uint32_t tile, size_t i);

static inline double film_sum(const struct film_group *group, size_t i)
{
    return group->cut ? group->whole ? group->whole->values[i] + group->cut->values[i] : group->cut->values[i]
                      : group->whole->values[i];
}
