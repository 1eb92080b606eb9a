/* admission: which of the connections that have proved nothing yet may stay, and whose TLS
 * handshake comes next. Logic only: the door (door.h) owns the sockets and does what is said here.
 *
 *   admission_enter --> SILENT --admission_ready--> READY --admission_next--> SHAKING
 *   SHAKING --admission_refused--> LEAVING;  any --admission_leave--> gone (also: it is a session)
 *
 * Invariants:
 * - at most places_max connections have a place, in whatever stage;
 * - at most ADMISSION_HANDSHAKES_MAX are SHAKING, of one address at most half of them;
 * - handshakes go to the addresses in turn, within an address first come first served;
 * - no connection loses its place while there is another free one. When all are taken, one goes to
 *   make room: of the address with the most places the oldest that is SILENT or LEAVING; if it has
 *   none, and more than half of the places, its newest READY, or the newcomer if that is its own;
 *   otherwise the oldest SILENT or LEAVING of all; and if there is none, the newcomer. None that
 *   is SHAKING goes.
 *
 * A SILENT one has not sent a whole first TLS record. A handshake costs memory and time, so it is
 * begun only with peers whose part of it is there: peers that say nothing, or a byte a second,
 * delay no one else. An address is an IPv4 address or the first 64 bits of an IPv6 address, which is
 * what one machine commonly has.
 */
#ifndef AZULEJO_COORDINATOR_ADMISSION_H
#define AZULEJO_COORDINATOR_ADMISSION_H

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
    struct admission_place *next, *previous; /* of the same address, in the same line */
    struct admission_address *address;
    enum admission_stage stage;
    uint64_t number;                         /* in the order of coming into the line */
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
    struct admission_line ready, idle;         /* idle: SILENT and LEAVING */
};

struct admission {
    uint32_t places_max;                       /* the caller may change it before admission_enter */
    uint32_t places, shaking, ready;
    uint64_t numbers;
    struct admission_address *first, *last;
    struct admission_address *buckets[ADMISSION_BUCKETS];
};

/* places_max is at least 1. Nothing has to be released once every place was left. */
void admission_init(struct admission *a, uint32_t places_max);

/* A connection came. *out is the place that must go to make room, NULL when there is room; it may
 * be the newcomer's own. It has left already: the caller closes its connection. ERR_NO_MEMORY: the
 * newcomer has no place. */
status admission_enter(struct admission *a, struct admission_place *place,
                       const uint8_t address[ADMISSION_ADDRESS_BYTES],
                       struct admission_place **out, struct error *err) MUST_CHECK;

/* Its first record is whole: SILENT to READY; nothing in another stage. */
void admission_ready(struct admission *a, struct admission_place *place);

/* Whose handshake is to begin now: READY to SHAKING. NULL: there is none. Call until NULL. */
struct admission_place *admission_next(struct admission *a);

/* Its handshake failed, and it is being told why: SHAKING to LEAVING. */
void admission_refused(struct admission *a, struct admission_place *place);

/* It is gone, or through: its place is free. Nothing for one that has none. */
void admission_leave(struct admission *a, struct admission_place *place);

#endif
