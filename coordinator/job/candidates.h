/* candidates: lists of the few jobs that an event or a tick must look at, so that nothing walks the whole queue.
 *
 *   working    have open frames: their units can be lent, their results written
 *   lanes      may have a frame to begin (QUEUED or RUNNING), those with the same needs in one lane
 *   closing    FINISHING or CANCELLING: they end by steps
 *   troubled   a film of theirs cannot be opened: it is tried again
 *
 * Each list is in the order of service (order.h): ready jobs as their `place` says, then the others by job_is_before.
 * Invariant: a list holds exactly the active jobs that candidates_belongs names. Whatever changes the answer for a job
 * must call candidates_update afterwards (queue.c does after a change of state, farm_* after a frame was opened, closed
 * or found to be the last); its place in the order must not change while it is in a list (candidates_remove first).
 *
 * A lane keeps apart the jobs that many workers cannot serve: a worker skips a lane, not its jobs. The lane of a job is
 * its instruction set, and whether a ray tracer is pinned. Other needs that many waiting jobs may share belong here,
 * too (candidates_lane).
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/scene/settings.h"

struct job;

enum candidate_list {
    CANDIDATES_WORKING,
    CANDIDATES_CLOSING,
    CANDIDATES_TROUBLED,
    CANDIDATES_LANES, /* the first lane */
    CANDIDATES_LISTS = CANDIDATES_LANES + 2 * ISA_COUNT,
};

struct job_list {
    struct job **jobs;
    size_t count, capacity;
};

struct candidates {
    struct job_list lists[CANDIDATES_LISTS];
    uint64_t changes; /* calls of candidates_update and candidates_remove */
};

void candidates_release(struct candidates *c);
/* Room for `jobs` jobs in each list; 0: out of memory. */
int candidates_reserve(struct candidates *c, size_t jobs);

/* Of higher priority, or of the same and submitted earlier. */
int job_is_before(const struct job *a, const struct job *b);

/* Does the (active) job belong to the list? */
int candidates_belongs(const struct job *job, enum candidate_list list);
/* Its lane, whether it is in it or not. */
enum candidate_list candidates_lane(const struct job *job);

/* Put the job where it belongs. `active`: it is one of the queue's active jobs. */
void candidates_update(struct candidates *c, struct job *job, int active);
/* The places of jobs have changed. */
void candidates_sort(struct candidates *c);
/* Take it out of every list. */
void candidates_remove(struct candidates *c, struct job *job);

/* A set of lists, as bits. */
#define CANDIDATES_BIT(list) (1u << (list))
#define CANDIDATES_ALL_LANES ((CANDIDATES_BIT(CANDIDATES_LISTS) - 1) & ~(CANDIDATES_BIT(CANDIDATES_LANES) - 1))
/* The first job after `after` (NULL: the first of all) that is in one of the lists; NULL: none. The
 * lists may change between two calls, also by `after` leaving them. */
struct job *candidates_next(const struct candidates *c, unsigned lists, const struct job *after);
