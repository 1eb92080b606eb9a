/* health: is the coordinator alive, and does it take work? For those who supervise it: without a token, as text. */
#pragma once

#include "web/api/request.h"

/* 200 whenever the loop runs. */
void web_healthz(struct web_request *request);
/* 200, or 503 with the reason: it is ending, or the store cannot be used. Without a token it names no paths. */
void web_readyz(struct web_request *request);
