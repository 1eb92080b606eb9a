/* leases: the work that this worker holds.
 *
 *   a unit: granted --scene READY--> in the pool --> rendered --> outbox --ResultAck--> freed
 *              \--revoked, returned, connection lost, job broken--> freed
 *
 * A lease lives until its last unit has left it, and holds its scene until then. A unit that is
 * being rendered when its lease is revoked is finished and then discarded. A unit that is being
 * rendered when the connection is lost keeps its result, which stays valid.
 * Everything here runs in the loop's thread; only the units' tasks run in the pool.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "protocol/channel.h"
#include "worker/outbox.h"
#include "worker/pool.h"
#include "worker/scene_cache.h"

enum {
    LEASES_HELD_MAX = 4096,
    UNITS_PER_THREAD_MIN = 4,  /* held, so that no thread waits for the network */
    UNITS_PER_THREAD_MAX = 1024,
    UNITS_HOLD_MS = 300,       /* work to hold for each thread, estimated from past units, */
    UNITS_HOLD_TRIPS = 4,      /* and at least so many times what a request takes, */
    UNITS_HOLD_MAX_MS = 1500,  /* but not more than this: the coordinator grants no more (scheduler.h) */
};

struct leases {
    struct pool *pool;
    struct scene_cache *scenes;
    struct lease *first;
    unsigned threads;
    uint32_t isa_mask; /* offered to the coordinator */
    size_t lease_count;
    size_t held;      /* units not rendered yet, including those being rendered */
    uint64_t unit_ns; /* recent duration of a unit, smoothed; 0: unknown */
    uint64_t trip_ns; /* from a request to its grant, smoothed */
    uint64_t units_done, samples_done;
};

void leases_init(struct leases *l, struct pool *pool, struct scene_cache *scenes, unsigned threads, uint32_t isa_mask);
void leases_release(struct leases *l); /* after the pool has ended */

/* Take a grant. ERR_PROTOCOL: it breaks the rules (ends the connection). If a job cannot be
 * rendered, send JobBroken on `channel` and return STATUS_OK. */
status leases_grant(struct leases *l, const Azulejo__Wire__LeaseGrant *grant, struct channel *channel,
                    struct error *err) MUST_CHECK;
void leases_revoke(struct leases *l, const Azulejo__Wire__LeaseRevoke *revoke);
/* The scene became READY or BROKEN. `channel` NULL: not connected. */
void leases_scene_settled(struct leases *l, struct scene_slot *slot, struct channel *channel);
/* A pool task of a unit is done. Returns the unit if its result is to be sent (now the caller's). */
struct work_unit *leases_unit_done(struct leases *l, struct pool_task *task);

/* Forget all units that are not being rendered (the connection is lost: they will be leased again). */
void leases_forget_unstarted(struct leases *l);
/* The same, and tell the coordinator. */
void leases_return_unstarted(struct leases *l, struct channel *channel, const char *reason);

/* A unit that a thread renders now. */
struct running_unit {
    uint64_t job, running_ns;
    uint32_t frame;
    struct unit_name name;
};
/* The number of threads that render. Those units that they began at least `least_ns` ago go to `out`: at
 * most `max`, the longest first; *count is how many. */
uint32_t leases_running(const struct leases *l, uint64_t now_ns, uint64_t least_ns, struct running_unit *out,
                        size_t max, size_t *count);

/* A request was granted after so long. */
void leases_learn_trip(struct leases *l, uint64_t trip_ns);
/* How many more units to ask for now; 0 while enough are held: more than half of the work to hold. */
uint32_t leases_room(const struct leases *l);
