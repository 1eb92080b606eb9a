/* store_view: what takes the room in the coordinator's store, for people and for programs. */
#ifndef AZULEJO_CLIENT_STORE_VIEW_H
#define AZULEJO_CLIENT_STORE_VIEW_H

#include "client/farm/connection.h"
#include "client/terminal/json.h"

/* Ask for a StoreInfo; `collect`: what may go is removed first. The caller frees the answer. */
status store_ask(struct connection *c, int collect, Azulejo__Wire__Envelope **answer,
                 struct error *err) MUST_CHECK;
json_t *store_json(const Azulejo__Wire__StoreInfo *info);

/* Connect, ask, print. */
status store_show(const struct connection_options *where, int json, struct error *err) MUST_CHECK;

#endif
