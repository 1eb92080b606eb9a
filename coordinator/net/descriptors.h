/* descriptors: how the process's file descriptors are shared out.
 *
 * Connections must never take the descriptors that the store needs for films, blobs and pictures, because a film that
 * cannot be opened stops its frame. So connections are counted, and limited to the rest of RLIMIT_NOFILE.
 */
#pragma once

#include <stdint.h>

#include "common/base/status.h"

enum {
    DESCRIPTORS_RESERVE_MIN = 64,   /* for the store; an eighth of a larger limit */
    DESCRIPTORS_RESERVE_MAX = 8192,
    STRANGERS_MIN = 16,             /* connections before their handshake is done */
    STRANGERS_MAX = 4096,           /* of a smaller limit, up to all that sessions do not use */
    SESSIONS_MIN = 16,
    SESSIONS_MAX = 20000,
};

struct descriptors {
    uint64_t limit;
    uint32_t reserve;
    uint32_t connections_max; /* of both kinds */
    uint32_t sessions_max;    /* always leaves some for strangers */
    uint32_t guests_max;      /* connections of the page, beside these; 0: none */
    uint32_t address_max;     /* sessions, and connections of the page, of one address; 0: its share */
};

/* How many of `most` one address may have: what was configured or, if that is 0, three quarters, so that another one
 * always gets in. */
uint32_t descriptors_of_address(uint32_t most, uint32_t configured);

/* Share out `limit`, of which `open` are in use. ERR_LIMIT: too few for a farm. */
status descriptors_share(struct descriptors *out, uint64_t limit, uint64_t open, struct error *err) MUST_CHECK;

/* The number of strangers allowed beside this many sessions (at most sessions_max). */
uint32_t descriptors_strangers(const struct descriptors *d, uint32_t sessions);

/* Raise the process's soft limit to its hard one, count the open ones, share out the rest and log
 * it. `guests`: what the page would like, of which it gets at most an eighth of the limit. ERR_LIMIT as above. */
status descriptors_plan(struct descriptors *out, uint32_t guests, struct error *err) MUST_CHECK;
