/* link: connections to the coordinator, by the farm's protocol and the key of the role `web`.
 *
 *   link_open --> CONNECTING --Welcome--> OPEN --link_close, either side's end, silence--> on_end, once --> freed
 *
 * What is sent while it is CONNECTING is kept, at most LINK_KEPT_BYTES, and sent when it is OPEN. A connection acts for a token, so that
 * the coordinator knows who asks, or for the page itself (token 0). All on the loop's thread.
 */
#pragma once

#include <stdint.h>
#include <uv.h>

#include "common/base/status.h"
#include "protocol/azulejo.pb-c.h"
#include "protocol/key.h"

enum {
    LINK_KEPT_BYTES = 4 << 20,
    LINK_QUEUE_BYTES = 1 << 20,   /* that wait to be sent, before what is passed on waits itself */
};

struct link_peer;

/* The coordinator, and the connections to it. Zeroed, then host, port, key and loop. */
struct link_peers {
    uv_loop_t *loop;
    const char *host;
    uint16_t port;
    struct farm_key key;
    struct link_peer *first;
};

struct link_callbacks {
    void (*on_message)(void *user, const Azulejo__Wire__Envelope *message);
    void (*on_drain)(void *user);                        /* there is room again; may be NULL */
    void (*on_end)(void *user, const struct error *why); /* `why` is STATUS_OK after an orderly end */
};

status link_open(struct link_peer **out, struct link_peers *all, uint64_t token, const struct link_callbacks *callbacks,
                 void *user, struct error *err) MUST_CHECK;
/* ERR_LIMIT: too much waits, or it is too large; ERR_NO_MEMORY; ERR_IO: it is ending. */
status link_send(struct link_peer *peer, const Azulejo__Wire__Envelope *message, struct error *err) MUST_CHECK;
/* Does so much wait to be sent that more should wait, too, until on_drain? */
int link_is_full(const struct link_peer *peer);
/* Take no more messages for now. */
void link_pause(struct link_peer *peer, int paused);
/* End it; on_end follows. */
void link_close(struct link_peer *peer);
void link_abort(struct link_peer *peer, status code, const char *text);
/* Heartbeats and silence: ten times a second. */
void link_tick(struct link_peers *all, uint64_t now_ns);
void link_close_all(struct link_peers *all);
