/* session_keys: the keys of connections, and what an admin asks about keys of names. */
#pragma once

#include "coordinator/net/session/session_messages.h"

struct server;

/* At its Hello: is its key good? Then it is noted as used. ERR_REFUSED. */
status session_key_greet(struct session *session, struct error *err) MUST_CHECK;
/* It is not: say so, in the log once a minute, and end the session. */
void session_key_refused(struct session *session, const struct error *why);
/* End the connections whose older generation has run out. At each tick. */
void session_keys_tick(struct server *server);

session_handler session_key_query;
session_handler session_key_change;
