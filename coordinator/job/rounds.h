/* rounds: how many passes of each tile and group a frame wants, and when it has enough.
 *
 *   every tile's floor --statistics of group h's level k are complete--> what group g gets in round k,
 *   or that g has ended; then the floor of round k + 1 (common/accuracy/allocate.h)
 *
 * A decision about a group is a function of the other group's level statistics, of the rules and of
 * nothing else: not of who rendered what, when, nor of a crash. Nothing of it is stored: statistics are
 * pure functions of results, and those that a worker may forget are on disk, so a coordinator that
 * starts again decides the same.
 *
 * Without rounds, everything that the cap allows is wanted at once; with a schedule, what that says.
 * Logic without sockets or clocks. A struct rounds owns its arrays; film and rules stay the caller's.
 */
#ifndef AZULEJO_COORDINATOR_ROUNDS_H
#define AZULEJO_COORDINATOR_ROUNDS_H

#include "common/accuracy/stop.h"
#include "common/base/buffer.h"
#include "common/base/status.h"
#include "common/film/film.h"

struct rounds {
    uint32_t level[GROUPS];     /* at which the other group decides about this one next */
    enum frame_end end[GROUPS]; /* FRAME_END_NONE: it goes on */
    uint32_t *wanted[GROUPS];   /* passes of each tile in the picture; the cap may allow fewer */
    uint32_t tiles;
};

/* Want the first passes. `schedule`: passes [tile][group], of the film's size; empty: none. Zeroed and to be
 * released also when it fails. ERR_NO_MEMORY. */
status rounds_init(struct rounds *rounds, struct film *film, const struct stop_rules *rules,
                   const struct buffer *schedule, struct error *err) MUST_CHECK;
void rounds_release(struct rounds *rounds);

/* Decide what can be decided; *changed: more is wanted, or a group has ended. To be called again after
 * whatever was folded: without complete statistics it does nothing and costs nothing. ERR_NO_MEMORY: what
 * was decided stands; call again. */
status rounds_step(struct rounds *rounds, struct film *film, const struct stop_rules *rules,
                   int *changed, struct error *err) MUST_CHECK;

/* Both groups have ended: when the film is complete, so is the frame. */
int rounds_are_over(const struct rounds *rounds);
/* What ended them; FRAME_END_NONE: nothing yet. */
enum frame_end rounds_end(const struct rounds *rounds);
/* So many passes of the group may be rendered before they are wanted: the floor of the next round, which
 * every outcome but the end asks for. */
uint32_t rounds_ahead(const struct rounds *rounds, const struct film *film, uint32_t group);
/* The film has exactly what the rules decided: with them alone it can be rendered again. */
int rounds_made(const struct rounds *rounds, const struct film *film);

/* Has the film more than the rounds want of a group that has ended? After rounds_step. */
int rounds_exceeded(const struct rounds *r, const struct film *film);

#endif
