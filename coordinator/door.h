/* door: connections from the listener to the proof of a key. What comes through is a session.
 *
 * Whoever can reach the port can knock, so what a stranger may cost is bounded here: places,
 * handshakes and log lines (admission.h, log_limit.h). Ownership: the door owns its channels until
 * it hands one to session_begin or the channel's on_close ran.
 */
#ifndef AZULEJO_COORDINATOR_DOOR_H
#define AZULEJO_COORDINATOR_DOOR_H

#include <uv.h>

#include "common/base/log_limit.h"
#include "coordinator/admission.h"

enum { DOOR_HANDSHAKES_PER_TURN = 8 }; /* of the loop: sessions are served in between */

struct server;
struct visitor;

struct door {
    struct server *server;
    struct admission admission;
    struct log_limit complaints;
    struct visitor *visitors;
    uv_idle_t turn;            /* active while a handshake may begin */
};

void door_init(struct door *door, struct server *server);

/* In the listener's connection callback. Failures are logged. */
void door_connection(struct door *door, uv_stream_t *listener, int uv_error);

/* End all connections that are no sessions yet, and the door's own handle. */
void door_close(struct door *door);

#endif
