/* door: connections from the listener to the proof of a key. What comes through is a session.
 *
 * Anyone who can reach the port can knock, so what a stranger may cost is bounded here: places,
 * handshakes and log lines (admission.h, log_limit.h). Ownership: the door owns its channels until
 * it hands one to session_begin or the channel's on_close ran.
 */
#ifndef AZULEJO_COORDINATOR_DOOR_H
#define AZULEJO_COORDINATOR_DOOR_H

#include <uv.h>

#include "common/base/log_limit.h"
#include "coordinator/net/admission.h"

/* In one turn of the loop, so that sessions are served in between (9 ms of handshakes), and no fewer
 * handshakes than connections, so that a flood of bad ones does not fill the line. */
enum { DOOR_ACCEPTS_PER_TURN = 64, DOOR_HANDSHAKES_PER_TURN = 64 };

struct server;
struct visitor;

struct door {
    struct server *server;
    struct admission admission;
    struct log_limit complaints;
    struct visitor *visitors;
    uv_idle_t turn;            /* active while there may be something to do in the next turn */
    uint32_t accepted;         /* in this turn */
    uv_stream_t *waiting;      /* the listener, when it has a connection for the next turn */
};

void door_init(struct door *door, struct server *server);

/* In the listener's connection callback. Failures are logged. */
void door_connection(struct door *door, uv_stream_t *listener, int uv_error);

/* End all connections that are no sessions yet, and the door's own handle. */
void door_close(struct door *door);

#endif
