/* control: the page's own connection to the coordinator, as the rest of the page sees it. web.c makes it. */
#pragma once

#include "common/base/status.h"
#include "protocol/azulejo.pb-c.h"

struct web;

/* Send on it. 0: there is none. */
int web_tell(struct web *web, const Azulejo__Wire__Envelope *message);
int web_is_connected(const struct web *web);
/* ERR_IO: the coordinator's store cannot be used, or the coordinator is away. */
status web_store_usable(const struct web *web, struct error *err) MUST_CHECK;
