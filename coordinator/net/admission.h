/* admission: decides which unauthenticated connections may stay, and which TLS handshake is next. Logic only: the door
 * (door.h) owns the sockets and carries out the decisions.
 *
 *   admission_enter --> SILENT --admission_ready--> READY --admission_next--> SHAKING
 *   SHAKING --admission_refused--> LEAVING;  any --admission_leave--> gone (also: it is a session)
 *
 * Invariants:
 * - at most places_max connections have a place, in whatever stage;
 * - at most ADMISSION_HANDSHAKES_MAX are SHAKING, of one address at most half of them;
 * - handshakes go to the addresses in turn, within an address first come first served;
 * - no connection loses its place while there is another free one. When all are taken, one is
 *   dropped: at the address with the most places, the oldest that is SILENT or LEAVING; if that
 *   address has none, but has more than half of the places, its newest READY (or the newcomer if it
 *   has that address); otherwise the oldest SILENT or LEAVING of all; and if there is none, the
 *   newcomer. A SHAKING connection is never dropped.
 *
 * A SILENT connection has not sent its whole first TLS record. A handshake costs memory and time, so it begins only
 * when the peer's part has arrived: peers that send nothing, or a byte a second, do not delay others. An address is an
 * IPv4 address or the first 64 bits of an IPv6 address, which is what one machine commonly has.
 */
#pragma once

#include <stdint.h>

#include "common/base/status.h"

enum {
    ADMISSION_HANDSHAKES_MAX = 64,
    ADMISSION_ADDRESS_HANDSHAKES_MAX = ADMISSION_HANDSHAKES_MAX / 2,
    ADMISSION_ADDRESS_BYTES = 16,
    ADMISSION_BUCKETS = 1024,
};

enum admission_stage {
    ADMISSION_OUTSIDE,
    ADMISSION_SILENT,
    ADMISSION_READY,
    ADMISSION_SHAKING,
    ADMISSION_LEAVING,
};

struct admission_address;

/* Embedded in the caller's connection; zeroed before admission_enter. */
struct admission_place {
    struct admission_place *next, *previous; /* of the same address, in the same queue */
    struct admission_address *address;
    enum admission_stage stage;
    uint64_t number; /* in the order of arrival in the queue */
};

/* Oldest first. */
struct admission_line {
    struct admission_place *first, *last;
};

struct admission_address {
    struct admission_address *same_bucket;
    struct admission_address *next, *previous; /* of all addresses; the next in turn is first */
    uint8_t bytes[ADMISSION_ADDRESS_BYTES];
    uint32_t places, shaking;
    struct admission_line ready, idle; /* idle: SILENT and LEAVING */
};

struct admission {
    uint32_t places_max; /* the caller may change it before admission_enter */
    uint32_t places, shaking, ready;
    uint64_t numbers;
    struct admission_address *first, *last;
    struct admission_address *buckets[ADMISSION_BUCKETS];
};

/* places_max is at least 1. Nothing has to be released once all places are free. */
void admission_init(struct admission *a, uint32_t places_max);

/* A connection came. *out is the place that was dropped to make room, NULL if there was room; it may be the newcomer's
 * own. The caller closes its connection. ERR_NO_MEMORY: the newcomer has no place. */
status admission_enter(struct admission *a, struct admission_place *place,
                       const uint8_t address[ADMISSION_ADDRESS_BYTES], struct admission_place **out,
                       struct error *err) MUST_CHECK;

/* Its first record is complete: SILENT to READY; no effect in another stage. */
void admission_ready(struct admission *a, struct admission_place *place);

/* The place whose handshake begins now: READY to SHAKING. NULL: there is none. Call until NULL. */
struct admission_place *admission_next(struct admission *a);

/* Its handshake failed, and the reason is being sent: SHAKING to LEAVING. */
void admission_refused(struct admission *a, struct admission_place *place);

/* It was closed or authenticated: its place is free. No effect without a place. */
void admission_leave(struct admission *a, struct admission_place *place);
