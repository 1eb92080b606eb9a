/* order: the order in which jobs get work. Pure logic over jobs, owners and time.
 *
 * Of the jobs that are ready: higher priority first; of one priority, first the job whose turn it is
 * (below), then the owner who used fewer core-seconds recently, then the earlier submission.
 *
 *   recent core-seconds  every second of processor time of a merged result counts for the job's owner,
 *                        and half of it is forgotten in every half-life. This is kept over restarts.
 *   round                owners are compared once a round of ORDER_ROUND_MS, and when a job becomes ready.
 *                        Between that the order stands, so that workers do not change scenes all the time.
 *   turn                 the first job of an owner that was lent nothing for `longest_wait_s`, although
 *                        a worker could render it, goes before all others of its priority, for a tenth
 *                        of that time. One job of a priority at a time; the one that waited longest.
 *
 * So no job waits for ever behind jobs of its own priority: an owner's jobs go in order, each has
 * finitely many samples, and with n owners the first job of each is lent work at least once in
 * longest_wait_s + n turns. A job of a lower priority has no such bound.
 *
 * The order is a list. A worker gets the first work in it that it can take, so later jobs render at
 * once when the first ones cannot use all workers.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/base/status.h"

enum {
    ORDER_ROUND_MS = 30 * 1000,
    ORDER_TURN_PARTS = 10,       /* a turn is this part of the longest wait, but not less than a round */
    ORDER_OWNER_MAX = 127,
    ORDER_HALF_LIFE_S = 8 * 3600,
    ORDER_LONGEST_WAIT_S = 3600,
};

struct job;
struct queue;

/* What an owner used recently. */
struct owner_share {
    char owner[ORDER_OWNER_MAX + 1];
    double core_s;         /* as of at_s */
    int64_t at_s;          /* seconds since 1970 */
    int changed;           /* since order_shares_saved */
    double rank;           /* core_s in this round */
    uint64_t pass;         /* that saw a job of it, */
    int32_t pass_priority; /* with this priority */
    /* While jobs are sorted: its number of them, the first owner of its rank, and their next place. */
    size_t jobs, next;
    struct owner_share *leader;
};

/* A job's part of the order; all zero: it has none yet. */
struct job_place {
    struct owner_share *share;
    int ready;            /* as of the last order_update */
    uint64_t served_ns;   /* when it was last lent a unit, or became ready */
    uint64_t turn_end_ns; /* 0: it had no turn */
    size_t before;        /* the number of ready jobs before it */
};

struct order_rules {
    double half_life_s;    /* 0: owners do not count */
    double longest_wait_s; /* 0: there are no turns */
};

struct order {
    struct job **jobs; /* the ready ones, in order */
    size_t count, capacity;
    struct job **sorted; /* while jobs are sorted */
    size_t sorted_capacity;
    struct owner_share **band;
    size_t band_capacity;
    struct owner_share unowned; /* of jobs for whose owner there was no memory */
    struct order_rules rules;
    struct owner_share **shares; /* by owner, ascending */
    size_t share_count, share_capacity;
    uint64_t round_end_ns;
    uint64_t pass;
    unsigned seen_changes; /* queue->changes at the last update */
    int stale;
};

/* Both are asked about open jobs. */
struct order_questions {
    /* May it be lent now, apart from workers? */
    int (*is_ready)(void *user, const struct job *job);
    /* Is there a worker that can render it? */
    int (*has_worker)(void *user, const struct job *job);
    void *user;
};

void order_init(struct order *order);
void order_release(struct order *order);

/* Bring order->jobs up to date; 1: places changed (queue_order_changed must follow). It stays valid until a job leaves the queue. Without memory it has only as
 * many jobs as there is room for: those of the highest priorities. */
int order_update(struct order *order, const struct queue *queue, const struct order_questions *ask, uint64_t now_ns,
                 int64_t wall_s) MUST_CHECK;

/* Add to what the job's owner used. */
void order_charge(struct order *order, struct job *job, double core_s, int64_t wall_s);
/* The job was lent a unit. */
void order_served(struct job *job, uint64_t now_ns);

/* The owner's recent core-seconds at that time; a clock that went back forgets nothing. */
double owner_share_at(const struct owner_share *share, double half_life_s, int64_t wall_s);
/* The owner's share; a new one if there is none. NULL: no memory. */
struct owner_share *order_share(struct order *order, const char *owner);
