/* door: connections from the listeners until a key is proved. Then they are sessions.
 *
 * Anyone who can reach the port can connect, so the cost of strangers is bounded here: places,
 * handshakes and log lines (admission.h, log_limit.h). Ownership: the door owns its channels until
 * it hands one to session_begin or its on_close has run.
 */
#pragma once

#include <uv.h>

#include "common/system/log_limit.h"
#include "coordinator/net/admission.h"
#include "protocol/listen.h"

/* Per iteration of the loop, so that sessions are served in between (9 ms of handshakes). There are at least as many
 * handshakes as connections, so that a flood of bad ones does not fill the queue. */
enum { DOOR_ACCEPTS_PER_TURN = 64, DOOR_HANDSHAKES_PER_TURN = 64 };

struct server;
struct visitor;

struct door {
    struct server *server;
    struct admission admission;
    struct log_limit complaints;
    struct visitor *visitors;
    uv_idle_t turn;                             /* active while the next iteration may have work */
    uint32_t accepted;                          /* in this turn */
    uv_stream_t *waiting[LISTEN_ADDRESSES_MAX]; /* listeners that have a connection for the next turn */
    unsigned waiting_count;
};

void door_init(struct door *door, struct server *server);

/* In the listener's connection callback. Failures are logged. */
void door_connection(struct door *door, uv_stream_t *listener, int uv_error);

/* End all connections that are not sessions yet, and the door's own handle. */
void door_close(struct door *door);
