/* rounds: how many passes of each tile and group a frame wants, and when it has enough.
 *
 *   every tile's floor --statistics of group h's level k are complete--> what group g gets in round k,
 *   or that g has ended; then the floor of round k + 1 (common/accuracy/allocate.h)
 *
 * A decision about a group is a function of the other group's level statistics and of the rules only. It does not
 * depend on which worker rendered what and when, nor on a crash. Decisions are not stored: statistics are pure
 * functions of results, and the acknowledged results are on disk, so a restarted coordinator decides the same.
 *
 * Without rounds, everything that the cap allows is wanted at once; with a schedule, the passes in it. Logic without
 * sockets or clocks. A struct rounds owns its arrays; film and rules stay the caller's.
 */
#pragma once

#include "common/accuracy/stop.h"
#include "common/base/buffer.h"
#include "common/base/status.h"
#include "common/film/film.h"

struct rounds {
    uint32_t level[GROUPS];     /* the level at which the other group decides about this one next */
    enum frame_end end[GROUPS]; /* FRAME_END_NONE: it goes on */
    uint32_t *wanted[GROUPS];   /* passes of each tile in the picture; the cap may allow fewer */
    uint32_t tiles;
    int skipped; /* a level had no statistics, so that nothing was decided at it */
};

/* The first level whose statistics a frame with these rules may need, now or when it is extended: a job without rounds
 * needs those by which rounds would begin where it ends (extend.h), none with a schedule. */
uint32_t rounds_measure_from(const struct stop_rules *rules, const struct buffer *schedule, uint32_t spp);

/* Want the first passes. `schedule`: passes [tile][group], of the film's size; empty: none. After a
 * failure it is zeroed, and must still be released. ERR_NO_MEMORY. */
status rounds_init(struct rounds *rounds, struct film *film, const struct stop_rules *rules,
                   const struct buffer *schedule, struct error *err) MUST_CHECK;
void rounds_release(struct rounds *rounds);

/* Take the decisions whose statistics are complete; *changed: more is wanted, or a group has ended.
 * Call it again after every fold: without complete statistics it returns at once. ERR_NO_MEMORY:
 * the decisions taken so far stand; call again. */
status rounds_step(struct rounds *rounds, struct film *film, const struct stop_rules *rules, int *changed,
                   struct error *err) MUST_CHECK;

/* Both groups have ended: when the film is complete, so is the frame. */
int rounds_are_over(const struct rounds *rounds);
/* The reason why they ended; FRAME_END_NONE: they have not. */
enum frame_end rounds_end(const struct rounds *rounds);
/* The number of passes of the group that may be rendered before they are wanted: the floor of the
 * next round, which is wanted unless the group ends. */
uint32_t rounds_ahead(const struct rounds *rounds, const struct film *film, uint32_t group);
/* The film has exactly the samples that the rules decided: the rules alone reproduce it. */
int rounds_made(const struct rounds *rounds, const struct film *film);

/* Does the film have more samples of an ended group than the rounds want? Call after rounds_step. */
int rounds_exceeded(const struct rounds *r, const struct film *film);
