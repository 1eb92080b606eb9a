/* outbox: results that the coordinator has not acknowledged yet.
 *
 * A result stays until its ResultAck arrives, and is sent again after a lost connection. The outbox
 * owns its results. Above OUTBOX_HIGH the worker asks for no more work.
 */
#pragma once

#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>

#include "common/film/tiles.h"
#include "protocol/channel.h"
#include "common/scene/effects.h"
#include "common/scene/stages.h"
#include "worker/pool.h"
#include "worker/render/render.h"

enum { OUTBOX_HIGH = 8192 }; /* results; 6 KiB each, up to 56 KiB with AOVs */

struct lease;

/* One work unit: first leased, then a result. */
struct work_unit {
    struct pool_task task;             /* first: a task is its unit */
    struct work_unit *previous, *next; /* in its lease, later in the outbox */
    struct lease *lease;               /* NULL in the outbox */
    uint64_t lease_id, epoch, job;
    uint32_t frame;
    atomic_uint_fast64_t begun_ns; /* monotonic: when a thread began it; 0: none did */
    int dropped;                   /* revoked while it ran: its result is discarded */
    int sent;                      /* on this connection */
    uint64_t cpu_ns, wall_ns, trace_ns;
    uint32_t thread;                    /* of the pool, from 1 */
    uint64_t effects;                   /* what the scene needed */
    uint32_t stages[STAGE_COUNT];       /* how often the thread was found in each */
    uint32_t accounts[EFFECT_ACCOUNTS]; /* the same samples, by effect */
    struct unit_result result;          /* with these sums: */
    float sums[];
};

struct outbox {
    struct work_unit *first, *last;
    struct work_unit *unsent; /* the first that this connection has not sent */
    size_t count;
};

void outbox_release(struct outbox *o);
void outbox_add(struct outbox *o, struct work_unit *unit);
/* Send unsent results until the channel's queue is high; call again on its drain. */
void outbox_pump(struct outbox *o, struct channel *channel);
/* The connection is lost: all results must be sent again. */
void outbox_reset(struct outbox *o);
/* Forget an acknowledged result. An unknown one was acknowledged before and is ignored. */
void outbox_acknowledge(struct outbox *o, uint64_t job, uint32_t frame, struct unit_name name);

/* Forget the results of a lease that is no longer wanted. */
void outbox_drop_lease(struct outbox *o, uint64_t lease_id);
