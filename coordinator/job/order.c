#include "coordinator/job/order.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/system/clock.h"
#include "common/base/memory.h"
#include "common/math/elementary.h"
#include "coordinator/job/queue.h"

_Static_assert((int)ORDER_OWNER_MAX == (int)JOB_WHO_MAX, "an owner is a person");

void order_init(struct order *order)
{
    *order = (struct order){
        .rules = {ORDER_HALF_LIFE_S, ORDER_LONGEST_WAIT_S}, .stale = 1};
}

void order_release(struct order *order)
{
    for (size_t i = 0; i < order->share_count; i++)
        mem_free(order->shares[i]);
    mem_free(order->shares);
    mem_free(order->jobs);
    mem_free(order->sorted);
    mem_free(order->band);
    order_init(order);
}

/* ---- shares ---------------------------------------------------------------------------------- */

double owner_share_at(const struct owner_share *share, double half_life_s, int64_t wall_s)
{
    if (wall_s <= share->at_s || !(half_life_s > 0))
        return share->core_s;
    return share->core_s * det_pow_d(0.5, (double)(wall_s - share->at_s) / half_life_s);
}

/* The place of the first owner that does not come before this one. */
static size_t share_place(const struct order *order, const char *owner)
{
    size_t low = 0, high = order->share_count;

    while (low < high) {
        size_t middle = low + (high - low) / 2;
        if (strcmp(order->shares[middle]->owner, owner) < 0)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

struct owner_share *order_share(struct order *order, const char *owner)
{
    size_t place = share_place(order, owner);
    struct owner_share *share;

    if (place < order->share_count && strcmp(order->shares[place]->owner, owner) == 0)
        return order->shares[place];
    if (!MEM_GROW(order->shares, order->share_capacity, order->share_count + 1))
        return NULL;
    share = mem_calloc(1, sizeof *share);
    if (!share)
        return NULL;
    snprintf(share->owner, sizeof share->owner, "%s", owner);
    memmove(order->shares + place + 1, order->shares + place,
            (order->share_count - place) * sizeof(struct owner_share *));
    order->shares[place] = share;
    order->share_count++;
    return share;
}

/* The share of the job's present owner. */
static struct owner_share *share_of(struct order *order, struct job *job)
{
    struct job_place *place = &job->place;

    if (!place->share || strcmp(place->share->owner, job->owner) != 0)
        place->share = order_share(order, job->owner);
    return place->share;
}

void order_charge(struct order *order, struct job *job, double core_s, int64_t wall_s)
{
    struct owner_share *share = share_of(order, job);

    if (!share)
        return;
    share->core_s = owner_share_at(share, order->rules.half_life_s, wall_s) + core_s;
    if (wall_s > share->at_s)
        share->at_s = wall_s;
    share->changed = 1;
}

void order_served(struct job *job, uint64_t now_ns) { job->place.served_ns = now_ns; }

/* ---- the list -------------------------------------------------------------------------------- */

static int has_turn(const struct job_place *place, uint64_t now_ns) { return place->turn_end_ns > now_ns; }

/* Collect the ready jobs, by priority and submission. 1: one of them was not ready before. */
static int collect(struct order *order, const struct queue *queue, const struct order_questions *ask, uint64_t now_ns)
{
    int newcomer = 0;

    order->count = 0;
    order->stale = 0;
    for (size_t i = 0; i < queue->active_count; i++) {
        struct job *job = queue->active[i];
        struct job_place *place = &job->place;

        if (!job_state_is_open(job->state) || !ask->is_ready(ask->user, job)) {
            place->ready = 0;
            continue;
        }
        if (!place->ready) {
            place->ready = newcomer = 1;
            place->served_ns = now_ns;
            place->turn_end_ns = 0;
        }
        if (order->count < order->capacity || MEM_GROW(order->jobs, order->capacity, queue->active_count))
            order->jobs[order->count++] = job;
        else
            order->stale = 1; /* no memory: try again */
    }
    return newcomer;
}

static void rank_owners(struct order *order, int64_t wall_s)
{
    for (size_t i = 0; i < order->share_count; i++) {
        struct owner_share *share = order->shares[i];
        share->rank = order->rules.half_life_s > 0 ? owner_share_at(share, order->rules.half_life_s, wall_s) : 0;
    }
}

/* Is this the first job of its owner and priority in this pass? */
static int is_head(const struct order *order, struct job *job)
{
    struct owner_share *share = job->place.share;

    if (!share || (share->pass == order->pass && share->pass_priority == job->priority))
        return 0;
    share->pass = order->pass;
    share->pass_priority = job->priority;
    return 1;
}

static void undo_head(struct job *job) { job->place.share->pass = 0; }

/* Give a turn to the job of the priority that has waited for too long, unless another one has its
 * turn: of jobs[from .. to-1], in the order of submission. */
static void give_turn(struct order *order, const struct order_questions *ask, size_t from, size_t to, uint64_t now_ns)
{
    uint64_t wait_ns = (uint64_t)(order->rules.longest_wait_s * 1e9);
    uint64_t turn_ns = wait_ns / ORDER_TURN_PARTS;
    struct job *longest = NULL;

    if (turn_ns < ORDER_ROUND_MS * NS_PER_MS)
        turn_ns = ORDER_ROUND_MS * NS_PER_MS;
    for (size_t i = from; i < to; i++) {
        struct job *job = order->jobs[i];
        if (has_turn(&job->place, now_ns))
            return;
        if (!is_head(order, job) || now_ns - job->place.served_ns < wait_ns)
            continue;
        if (!ask->has_worker(ask->user, job)) { /* the owner's next one may have waited as well */
            undo_head(job);
            continue;
        }
        if (!longest || job->place.served_ns < longest->place.served_ns)
            longest = job;
    }
    if (longest)
        longest->place.turn_end_ns = now_ns + turn_ns;
}

/* The end of the priority that begins there. */
static size_t band_end(const struct order *order, size_t from)
{
    size_t to = from + 1;

    while (to < order->count && order->jobs[to]->priority == order->jobs[from]->priority)
        to++;
    return to;
}

static void give_turns(struct order *order, const struct order_questions *ask, uint64_t now_ns)
{
    size_t to;

    if (!(order->rules.longest_wait_s > 0))
        return;
    order->pass++;
    for (size_t from = 0; from < order->count; from = to) {
        to = band_end(order, from);
        give_turn(order, ask, from, to, now_ns);
    }
}

static int by_rank(const void *a, const void *b)
{
    const struct owner_share *one = *(struct owner_share *const *)a, *other = *(struct owner_share *const *)b;

    return (one->rank > other->rank) - (one->rank < other->rank);
}

/* Where each owner's jobs of the band begin: after `at`, owners by rank. Owners of equal rank are one: their
 * jobs go by submission. */
static void place_owners(struct order *order, size_t count, size_t at)
{
    struct owner_share *leader = NULL;

    qsort(order->band, count, sizeof(struct owner_share *), by_rank);
    for (size_t k = 0; k < count; k++) {
        struct owner_share *share = order->band[k];
        if (!leader || leader->rank != share->rank) {
            leader = share;
            leader->next = at;
        }
        share->leader = leader;
        at += share->jobs;
    }
}

static struct owner_share *share_or_nobody(struct order *order, const struct job *job)
{
    return job->place.share ? job->place.share : &order->unowned;
}

/* Bring jobs[from .. to-1], of one priority and in the order of submission, into their order: in time linear
 * in their number, as this is done whenever a job comes or goes. */
static void sort_band(struct order *order, size_t from, size_t to, uint64_t now_ns)
{
    size_t owners = 0, turns = from;

    order->pass++;
    for (size_t i = from; i < to; i++) {
        struct owner_share *share = share_or_nobody(order, order->jobs[i]);
        if (has_turn(&order->jobs[i]->place, now_ns)) {
            turns++;
            continue;
        }
        if (share->pass != order->pass) {
            share->pass = order->pass;
            share->jobs = 0;
            order->band[owners++] = share;
        }
        share->jobs++;
    }
    place_owners(order, owners, turns);
    turns = from;
    for (size_t i = from; i < to; i++) {
        struct job *job = order->jobs[i];
        if (has_turn(&job->place, now_ns))
            order->sorted[turns++] = job;
        else
            order->sorted[share_or_nobody(order, job)->leader->next++] = job;
    }
}

/* Without memory the order is that of submission for now. */
static void sort(struct order *order, uint64_t now_ns)
{
    if (!MEM_GROW(order->sorted, order->sorted_capacity, order->capacity) ||
        !MEM_GROW(order->band, order->band_capacity, order->share_count + 1)) {
        order->stale = 1;
        return;
    }
    for (size_t from = 0, to; from < order->count; from = to) {
        to = band_end(order, from);
        sort_band(order, from, to, now_ns);
    }
    memcpy(order->jobs, order->sorted, order->count * sizeof(struct job *));
}

int order_update(struct order *order, const struct queue *queue, const struct order_questions *ask, uint64_t now_ns,
                 int64_t wall_s)
{
    int round = now_ns >= order->round_end_ns;
    int newcomer;

    if (!round && !order->stale && order->seen_changes == queue->changes)
        return 0;
    newcomer = collect(order, queue, ask, now_ns);
    for (size_t i = 0; i < order->count; i++)
        (void)share_of(order, order->jobs[i]);
    if (round || newcomer) {
        rank_owners(order, wall_s);
        give_turns(order, ask, now_ns);
        order->round_end_ns = now_ns + ORDER_ROUND_MS * NS_PER_MS;
    }
    if (order->count > 1)
        sort(order, now_ns);
    for (size_t i = 0; i < order->count; i++)
        order->jobs[i]->place.before = i;
    order->seen_changes = queue->changes;
    return 1;
}
