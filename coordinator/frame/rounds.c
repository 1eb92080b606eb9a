#include "coordinator/frame/rounds.h"

#include <string.h>

#include "common/accuracy/allocate.h"
#include "common/base/memory.h"

/* How samples are distributed. Uniform: only the floor. */
static struct allocation_rules rules_for(const struct stop_rules *stop)
{
    struct allocation_rules rules = allocation_rules;

    if (!stop->adaptive)
        rules.ratio_max = 1;
    return rules;
}

/* Does the cap allow this level for the group? */
static int level_is_reachable(const struct film *film, uint32_t group, uint32_t level)
{
    return level < LEVELS_MAX && film_pass_count(film, group) > 1 &&
           level_samples(level) <= group_samples(film_spp(film), group);
}

static void want(const struct rounds *r, struct film *film, uint32_t group)
{
    for (uint32_t t = 0; t < r->tiles; t++)
        film_want(film, t, group, r->wanted[group][t]);
}

static void raise(const struct rounds *r, uint32_t group, uint32_t passes)
{
    for (uint32_t t = 0; t < r->tiles; t++)
        if (r->wanted[group][t] < passes)
            r->wanted[group][t] = passes;
}

/* The group gets no more samples. */
static void end_group(struct rounds *r, struct film *film, uint32_t group, enum frame_end end)
{
    r->end[group] = end;
    want(r, film, group);
    film_end_group(film, group);
}

/* The floor of the group's round, or everything that the cap allows if no statistics will decide about it. */
static void begin_round(struct rounds *r, struct film *film, uint32_t group)
{
    uint32_t other = GROUPS - 1 - group;

    if (!level_is_reachable(film, other, r->level[group])) {
        raise(r, group, film_pass_count(film, group));
        end_group(r, film, group, FRAME_END_CAP);
        return;
    }
    raise(r, group, level_passes(r->level[group]));
    want(r, film, group);
}

/* ---- life ----------------------------------------------------------------------------------- */

static void take_schedule(struct rounds *r, struct film *film, const struct buffer *schedule)
{
    film_want_nothing(film); /* it may leave out tiles */
    for (uint32_t g = 0; g < GROUPS; g++) {
        int empty = 0;
        for (uint32_t t = 0; t < r->tiles; t++) {
            r->wanted[g][t] = schedule->data[t * GROUPS + g];
            empty |= r->wanted[g][t] == 0;
        }
        if (empty) /* level 0 will never be complete, and no decision uses its codes */
            film_freeze(film, g, NULL);
        end_group(r, film, g, FRAME_END_SCHEDULE);
    }
}

/* The first round: the last one whose floor every pixel gets in any case. */
static uint32_t first_level(uint32_t spp_min)
{
    uint32_t level = 0;

    while (level + 1 < LEVELS_MAX && level_passes(level + 1) <= pass_count(spp_min, GROUPS - 1))
        level++;
    return level;
}

uint32_t rounds_measure_from(const struct stop_rules *rules, const struct buffer *schedule, uint32_t spp)
{
    uint32_t first = first_level(spp);

    if (schedule->size > 0)
        return LEVELS_MAX;
    return stop_has_rounds(rules) || first == 0 ? 0 : first - 1; /* and the one before it */
}

status rounds_init(struct rounds *r, struct film *film, const struct stop_rules *rules, const struct buffer *schedule,
                   struct error *err)
{
    memset(r, 0, sizeof *r);
    r->tiles = film_tile_count(film);
    for (uint32_t g = 0; g < GROUPS; g++) {
        r->wanted[g] = mem_calloc(r->tiles, sizeof *r->wanted[g]);
        NEED(r->wanted[g], err, "the wanted samples of a frame");
    }
    if (schedule->size > 0) {
        take_schedule(r, film, schedule);
        return STATUS_OK;
    }
    for (uint32_t g = 0; g < GROUPS; g++) {
        if (stop_has_rounds(rules)) {
            r->level[g] = first_level(rules->spp_min);
            raise(r, g, pass_count(rules->spp_min, g));
            begin_round(r, film, g);
        } else {
            raise(r, g, film_pass_count(film, g));
            end_group(r, film, g, FRAME_END_CAP);
        }
    }
    return STATUS_OK;
}

void rounds_release(struct rounds *r)
{
    for (uint32_t g = 0; g < GROUPS; g++)
        mem_free(r->wanted[g]);
    memset(r, 0, sizeof *r);
}

/* ---- decisions ------------------------------------------------------------------------------ */

/* Does the cap stop a tile from getting its wanted samples? */
static int cap_cuts(const struct rounds *r, const struct film *film, uint32_t group)
{
    for (uint32_t t = 0; t < r->tiles; t++)
        if (pass_samples(r->wanted[group][t]) > group_samples(film_spp(film), group))
            return 1;
    return 0;
}

/* The statistics of a group that has ended are still completed while the other group's rounds need them. */
static void watch(const struct rounds *r, struct film *film)
{
    for (uint32_t g = 0; g < GROUPS; g++) {
        uint32_t other = GROUPS - 1 - g;
        if (r->end[g] == FRAME_END_NONE || r->end[other] != FRAME_END_NONE)
            continue;
        for (uint32_t t = 0; t < r->tiles; t++)
            film_want(film, t, g, level_passes(r->level[other]));
    }
}

static void apply(struct rounds *r, struct film *film, uint32_t group, const struct allocation_round *round,
                  const struct stop_rules *rules)
{
    uint32_t lambda = round->full;
    int met = rules->has_target && allocation_target(round, &rules->target, &lambda);

    allocation_wanted(round, lambda, r->wanted[group]);
    if (met) {
        end_group(r, film, group, cap_cuts(r, film, group) ? FRAME_END_CAP : FRAME_END_TARGET);
        return;
    }
    r->level[group]++;
    begin_round(r, film, group);
}

static void take_levels(const struct rounds *r, const struct film *film, uint32_t group, uint32_t level,
                        struct film_level *out)
{
    for (uint32_t t = 0; t < r->tiles; t++)
        (void)film_level(film, t, group, level, &out[t]);
}

static status decide(struct rounds *r, struct film *film, uint32_t group, const struct stop_rules *stop,
                     struct error *err)
{
    uint32_t level = r->level[group], other = GROUPS - 1 - group;
    struct film_level *levels = mem_alloc_array(2 * (size_t)r->tiles, sizeof *levels);
    const struct allocation_rules rules = rules_for(stop);
    struct allocation_input in = {.width = film_width(film), .height = film_height(film),
                                  .level = level, .tiles = levels, .wanted = r->wanted[group],
                                  .rules = &rules};
    struct allocation_round round;
    status s;

    NEED(levels, err, "a round of samples");
    take_levels(r, film, other, level, levels);
    if (level > 1 && !film_level_is_skipped(film, other, level - 1)) {
        take_levels(r, film, other, level - 1, levels + r->tiles);
        in.previous = levels + r->tiles;
    }
    s = allocation_round(&round, &in, err);
    if (s == STATUS_OK)
        apply(r, film, group, &round, stop);
    allocation_round_release(&round);
    mem_free(levels);
    return s;
}

/* A level without statistics decides nothing: the group gets the next one's floor. Which levels these are does not depend
 * on any sample. */
static int skip_levels(struct rounds *r, struct film *film, uint32_t group)
{
    uint32_t before = r->level[group];

    while (r->end[group] == FRAME_END_NONE && film_level_is_skipped(film, GROUPS - 1 - group, r->level[group])) {
        r->level[group]++;
        begin_round(r, film, group);
    }
    r->skipped |= r->level[group] > before;
    return r->level[group] > before;
}

/* Does the other group have all statistics that decide about this one? */
static int may_decide(const struct rounds *r, const struct film *film, uint32_t group)
{
    uint32_t other = GROUPS - 1 - group;

    return r->end[group] == FRAME_END_NONE && film_is_frozen(film, other) &&
           film_level_is_complete(film, other, r->level[group]);
}

status rounds_step(struct rounds *r, struct film *film, const struct stop_rules *rules, int *changed, struct error *err)
{
    int again = 1;

    *changed = 0;
    while (again) {
        again = 0;
        for (uint32_t g = 0; g < GROUPS; g++) {
            if (skip_levels(r, film, g)) {
                watch(r, film);
                again = *changed = 1;
            }
            if (!may_decide(r, film, g))
                continue;
            TRY(decide(r, film, g, rules, err));
            watch(r, film);
            again = *changed = 1;
        }
    }
    return STATUS_OK;
}

/* ---- questions ------------------------------------------------------------------------------ */

int rounds_are_over(const struct rounds *r) { return r->end[0] != FRAME_END_NONE && r->end[1] != FRAME_END_NONE; }

enum frame_end rounds_end(const struct rounds *r)
{
    if (!rounds_are_over(r))
        return FRAME_END_NONE;
    return r->end[0] == r->end[1] ? r->end[0] : FRAME_END_CAP;
}

uint32_t rounds_ahead(const struct rounds *r, const struct film *film, uint32_t group)
{
    uint32_t level = r->level[0] > r->level[1] ? r->level[0] : r->level[1];
    uint32_t most = film_pass_count(film, group), passes;

    if (rounds_are_over(r))
        return 0;
    passes = level + 1 < LEVELS_MAX ? level_passes(level + 1) : most;
    return passes < most ? passes : most;
}

int rounds_made(const struct rounds *r, const struct film *film)
{
    for (uint32_t g = 0; g < GROUPS; g++)
        for (uint32_t t = 0; t < r->tiles; t++) {
            uint32_t wanted = r->wanted[g][t], most = film_pass_count(film, g);
            if (film_tile_passes(film, t, g) != (wanted < most ? wanted : most))
                return 0;
        }
    return rounds_are_over(r) && r->end[0] != FRAME_END_SCHEDULE && !r->skipped;
}

int rounds_exceeded(const struct rounds *r, const struct film *film)
{
    for (uint32_t g = 0; g < GROUPS; g++)
        for (uint32_t t = 0; r->end[g] != FRAME_END_NONE && t < r->tiles; t++)
            if (film_tile_passes(film, t, g) > r->wanted[g][t])
                return 1;
    return 0;
}
