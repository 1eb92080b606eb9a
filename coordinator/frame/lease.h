/* lease: a batch of work units lent to one worker until a deadline.
 *
 *   granted --last unit merged--> settled (freed)
 *           --deadline passed, or the worker gave it back or died--> ended (freed); its remaining
 *             units return to the frame's pool
 *
 * Every lease carries an epoch, which grows with every grant and never repeats, not even after a restart: a result
 * whose epoch was never granted, or belongs to a time before its job, is refused. A result of a lease that has ended is
 * still good, because a unit's result is a pure function of its name.
 *
 * The table owns the leases. The frame's units point back at the leases that hold them.
 */
#pragma once

#include <stdint.h>

#include "common/base/status.h"
#include "coordinator/frame/frame.h"

enum { LEASE_UNITS_MAX = 4096, LEASE_BUCKETS = 1 << 15, LEASES_MAX = 1 << 18 };

/* What one worker holds. */
struct lease_holder {
    uint32_t session;
    uint32_t leases, units;
    uint64_t samples;              /* pixel samples of the units */
    struct lease *oldest, *newest; /* its leases, by id */
    uint64_t counted;              /* the report's: the last round that met it */
    uint64_t job;                  /* of the newest lease */
};

struct lease {
    uint64_t id, epoch;
    struct lease_holder *holder;
    struct job_frame *frame;
    uint64_t granted_ns, deadline_ns;
    uint32_t unit_count;                       /* lent */
    uint32_t open_count;                       /* of those, not yet merged */
    struct lease *chain;                       /* in its hash bucket */
    struct lease *older, *newer;               /* by id */
    struct lease *holder_older, *holder_newer; /* of its holder, by id */
    struct unit_name units[];                  /* settled ones stay; see job_frame_unit_find */
};

struct lease_table {
    struct lease *buckets[LEASE_BUCKETS];
    struct lease *oldest, *newest;
    uint32_t count;
    uint64_t last_id;
    uint64_t epoch;       /* of the newest grant */
    uint64_t duration_ns; /* a lease without any result lapses after this long */
    uint64_t lapse_ns;    /* no deadline is earlier */
};

/* `epoch` is one that was never granted; those after it must be free as well. */
void lease_table_init(struct lease_table *table, uint64_t epoch, uint64_t duration_ns);
void lease_table_release(struct lease_table *table);

/* Lend `units` to a worker. NULL: out of memory or LEASES_MAX; the units went back to the pool. */
struct lease *lease_grant(struct lease_table *table, struct job_frame *frame, struct lease_holder *holder,
                          const struct unit_name *units, uint32_t count, uint64_t now_ns);
/* NULL: no such lease, or another epoch (0: any). */
struct lease *lease_find(const struct lease_table *table, uint64_t id, uint64_t epoch);
/* Was that unit lent by it? Also if it is settled, or went back. */
int lease_lent(const struct lease *lease, uint64_t job, uint32_t frame, struct unit_name name);
void lease_renew(const struct lease_table *table, struct lease *lease, uint64_t now_ns);

/* End the lease; its remaining units return to the pool. */
void lease_end(struct lease_table *table, struct lease *lease);
void lease_end_all_of(struct lease_table *table, struct lease_holder *holder);
/* One unit goes back unstarted. */
void lease_return_unit(struct lease_table *table, struct lease *lease, struct unit_name name);

/* The film has the unit: remove it from every lease that holds it. Leases without units are then
 * freed; `others` is called first for those of sessions other than `session`. */
void lease_settle_unit(struct lease_table *table, struct job_frame *frame, struct unit_name name, uint32_t session,
                       void (*others)(void *user, uint32_t session, uint64_t lease), void *user);

/* The oldest lease whose deadline has passed; NULL: none. */
struct lease *lease_lapsed(struct lease_table *table, uint64_t now_ns);
