/* store_view: what takes the room in the coordinator's store, for people and for programs. */
#pragma once

#include "client/link/connection.h"

/* Ask for a StoreInfo; `collect`: what may go is removed first. The caller frees the answer. */
status store_ask(struct connection *c, int collect, int now, Azulejo__Wire__Envelope **answer, struct error *err) MUST_CHECK;

/* Connect, ask, print. */
status store_show(const struct connection_options *where, int json, struct error *err) MUST_CHECK;
