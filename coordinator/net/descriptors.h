/* descriptors: how the process's file descriptors are shared out.
 *
 * Connections must never take those that the store needs for films, blobs and pictures: a frame
 * that cannot be opened fails. So the connections are counted, and their number is bounded by
 * what is left of RLIMIT_NOFILE.
 */
#ifndef AZULEJO_COORDINATOR_DESCRIPTORS_H
#define AZULEJO_COORDINATOR_DESCRIPTORS_H

#include <stdint.h>

#include "common/base/status.h"

enum {
    DESCRIPTORS_RESERVE_MIN = 64,   /* for the store; of a larger limit an eighth */
    DESCRIPTORS_RESERVE_MAX = 8192,
    STRANGERS_MIN = 16,             /* connections before their handshake is done */
    STRANGERS_MAX = 4096,           /* and of a smaller limit up to all that sessions do not use */
    SESSIONS_MIN = 16,
    SESSIONS_MAX = 8192,
};

struct descriptors {
    uint64_t limit;
    uint32_t reserve;
    uint32_t connections_max;       /* of both kinds */
    uint32_t sessions_max;          /* which leaves some for strangers at all times */
};

/* Share out `limit`, of which `open` are in use. ERR_LIMIT: too few for a farm. */
status descriptors_share(struct descriptors *out, uint64_t limit, uint64_t open,
                         struct error *err) MUST_CHECK;

/* How many strangers there may be beside so many sessions (at most sessions_max). */
uint32_t descriptors_strangers(const struct descriptors *d, uint32_t sessions);

/* Raise the process's soft limit to its hard one, count what is open, share out the rest and log
 * it. ERR_LIMIT as above. */
status descriptors_plan(struct descriptors *out, struct error *err) MUST_CHECK;

#endif
