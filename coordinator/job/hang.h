/* hang: work units that are rendered for far longer than their kind ever took.
 *
 * Results teach how much processor time one pixel sample took at most. A unit hangs when a worker's thread has been
 * rendering it for HANG_FACTOR times what its samples took at the worst, and for the farm's least limit besides. Before
 * the first result of a job nothing hangs.
 *
 * A unit that hangs is lent to another worker as well; the one that hangs gets it no more, as long as there is another.
 * The first of the two results counts, as always. A unit that hung HANG_SESSIONS_MAX workers is the job's own fault.
 *
 * This is not stored: a restart of the coordinator forgets it.
 */
#pragma once

#include <stdint.h>

enum {
    HANG_FACTOR = 20,
    HANG_LEAST_S = 60,
    HANG_UNITS_MAX = 16,         /* of a job; more are not noted */
    HANG_SESSIONS_MAX = 3,
};

struct hang_unit {
    uint32_t frame, tile, group, pass;
    uint32_t session_count;
    uint32_t sessions[HANG_SESSIONS_MAX];
};

/* All zero: nothing is known. */
struct hangs {
    double sample_ns_max; /* processor time of one pixel sample; 0: no result yet */
    uint32_t count;
    struct hang_unit units[HANG_UNITS_MAX];
};

/* A result arrived. */
void hangs_learn(struct hangs *hangs, uint64_t samples, uint64_t cpu_ns);
/* How long a unit of so many samples may be rendered; 0: for ever. */
uint64_t hangs_limit_ns(const struct hangs *hangs, uint64_t samples, uint64_t least_ns);
/* The unit hangs at that session. NULL: this is known, or there is no room to note it. */
const struct hang_unit *hangs_note(struct hangs *hangs, struct hang_unit unit, uint32_t session);
/* Does the unit hang at that session? */
int hangs_has(const struct hangs *hangs, struct hang_unit unit, uint32_t session);
/* There is a result of the unit. */
void hangs_settle(struct hangs *hangs, struct hang_unit unit);
/* Forget which units hang. */
void hangs_clear(struct hangs *hangs);
