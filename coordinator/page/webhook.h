/* webhook: what happens to jobs, posted as JSON to other programs.
 *
 *   event --its thread--> in the store (survives a restart) --POST--> 2xx: removed
 *                                         ^                   \-> else again, after WEBHOOK_WAIT_MIN_S, doubling
 *                                         |                       up to WEBHOOK_WAIT_MAX_S; given up after WEBHOOK_AGE_S
 *                                         +--------------------------+
 *
 * The body is {"event": "job-done", "delivery": HEX, "at": seconds since 1970, ...}; an event that is sent again has
 * the same `delivery`. A request has the headers
 *   X-Azulejo-Timestamp: seconds since 1970, of this attempt
 *   X-Azulejo-Signature: sha256=HEX     HMAC-SHA256 over TIMESTAMP "." BODY; the key is the secret's text
 *
 * One thread of its own sends, one request after another, so neither the loop nor the pool waits for a foreign
 * server. Redirects are not followed, answers are not read, no proxy is used, and only http and https are spoken. The
 * coordinator itself is refused as a target, under whatever name. Everything else that this machine reaches can be reached: only admins
 * may add webhooks (SSRF).
 *
 * An event that the coordinator did not yet hand to the store when it was killed, some milliseconds' worth, is lost.
 * While the store cannot be written events wait in memory, at most WEBHOOK_WAITING_MAX; further ones are given up.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/base/status.h"
#include "coordinator/store/store_web.h"

enum {
    WEBHOOKS_MAX = 16,
    WEBHOOK_WAITING_MAX = 1000,  /* events of one webhook */
    WEBHOOK_BODY_MAX = 8192,
    WEBHOOK_CONNECT_S = 5,
    WEBHOOK_TIMEOUT_S = 10,      /* of a whole request */
    WEBHOOK_WAIT_MIN_S = 2,
    WEBHOOK_WAIT_MAX_S = 900,
    WEBHOOK_AGE_S = 86400,
};

struct webhooks;

/* What became of events, since the start. */
struct webhook_counts {
    uint64_t sent, failed, given_up; /* failed: attempts */
    uint32_t waiting;
};
struct webhook_view {
    struct webhook_row row;
    struct webhook_counts counts;
    char last_error[256];
};

/* Reads the store's webhooks and what they were not sent; starts the thread. ERR_IO, ERR_NO_MEMORY. */
status webhooks_open(struct webhooks **out, struct store *store, struct error *err) MUST_CHECK;
/* Ends the thread, in about a second; a request on its way is broken off. NULL is fine. */
void webhooks_close(struct webhooks *webhooks);
/* The coordinator listens on these ports of this machine (0: on none): webhooks may not be sent there. */
void webhooks_set_own_ports(struct webhooks *webhooks, uint16_t page, uint16_t farm);

/* Send an event to all webhooks. `fields` are further members of the JSON object, as in "\"job\": 12". Nothing waits. */
void webhooks_send(struct webhooks *webhooks, const char *event, const char *fields);

/* Gives the row its number, secret and time. ERR_INPUT: the address; ERR_LIMIT, ERR_IO, ERR_NO_MEMORY. */
status webhook_add(struct webhooks *webhooks, struct webhook_row *row, struct error *err) MUST_CHECK;
/* ERR_NOT_FOUND, ERR_IO, ERR_NO_MEMORY. */
status webhook_remove(struct webhooks *webhooks, uint64_t number, struct error *err) MUST_CHECK;
/* Copies those that there are, ascending, to out[WEBHOOKS_MAX]; how many. */
size_t webhooks_list(struct webhooks *webhooks, struct webhook_view out[WEBHOOKS_MAX]);
struct webhook_counts webhooks_counts(struct webhooks *webhooks);

/* Only one test at a time: it takes a thread of the pool. ERR_LIMIT. On the loop's thread, as its end. */
status webhooks_try_begin(struct webhooks *webhooks, struct error *err) MUST_CHECK;
void webhooks_try_ended(struct webhooks *webhooks);
/* Send one request with the event "test" now, and wait for its end. [any thread] ERR_NOT_FOUND; ERR_UNREACHABLE: it
 * was not taken, and why. */
status webhook_try(struct webhooks *webhooks, uint64_t number, struct error *err) MUST_CHECK;
