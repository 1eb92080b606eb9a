/* credit: how much work a worker is trusted with, judged by its results.
 *
 * A worker claims a number of threads. It is trusted with CREDIT_THREADS_FIRST of them until its results show more:
 * every CREDIT_PERIOD_MS in which it held work, the CPU time of its results over the time that passed is the number of
 * threads that were busy, and CREDIT_GROWTH times that is trusted in the next period. A worker that ran out of work
 * loses nothing, because the coordinator was too slow. A lapsed lease halves the trust; results bring it back.
 *
 * Invariant: 1 <= threads <= claimed.
 */
#pragma once

#include <stdint.h>

enum {
    CREDIT_THREADS_FIRST = 16,     /* before any result */
    CREDIT_GROWTH = 2,             /* times the threads that were busy */
    CREDIT_PERIOD_MS = 2000,
    CREDIT_PROVEN_MS = 30 * 1000,  /* a worker that delivered within this time is proven */
};

struct credit {
    uint32_t claimed, threads;
    uint64_t delivered_ns;       /* its last result; 0: none yet */
    uint64_t progress_ns;        /* its last result, or since when it holds anything */
    uint64_t halved_ns;          /* when a lapsed lease last counted */
    uint64_t period_ns, busy_ns; /* this period's begin, and the CPU time delivered in it */
    int starved;                 /* in this period it held less than it is trusted with */
};

void credit_init(struct credit *credit, uint32_t claimed); /* claimed: >= 1 */

/* It was lent work; it held `held_units` before. */
void credit_lent(struct credit *credit, uint32_t held_units, uint64_t now_ns);
/* A result of it was merged, which took cpu_ns; it still holds `held_units`. */
void credit_delivered(struct credit *credit, uint32_t held_units, uint64_t cpu_ns, uint64_t now_ns);
/* A lease of it, granted at granted_ns, ended without its result. Leases granted before the last
 * halving do not count again. */
void credit_lapsed(struct credit *credit, uint64_t granted_ns, uint64_t now_ns);

/* It delivered something recently. */
int credit_is_proven(const struct credit *credit, uint64_t now_ns);
/* It holds units and has delivered none for limit_ns, or since its last result it lost a lease. */
int credit_is_stuck(const struct credit *credit, uint32_t held_units, uint64_t limit_ns, uint64_t now_ns);
