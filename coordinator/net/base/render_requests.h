/* render_requests: clients' RenderRequests on their way to workers and back.
 *
 *   begun --a worker that can--> out --RenderResult or Failure--> answered (freed)
 *             ^                   |--its worker is gone: to another, at most RENDER_TRIES_MAX times
 *             |--------------------/  \--its client is gone--> freed
 *
 * A request goes to the worker with the least to do among those that may render its job. It holds a copy of
 * the message, because its first worker may be lost. One thread.
 */
#pragma once

#include <stdint.h>

#include "coordinator/net/session/session_messages.h"
#include "protocol/azulejo.pb-c.h"

enum {
    RENDER_REQUESTS_MAX = 1024,      /* under way in the farm; more: ERR_LIMIT */
    RENDER_REQUESTS_PER_WORKER = 32, /* sent to one worker and not answered */
    RENDER_NOT_BY_MAX = 64,          /* workers that a request rather avoids */
    RENDER_TRIES_MAX = 3,            /* workers lost with it before it fails */
};

struct server;
struct render_request;

struct render_requests {
    struct render_request *first;
    uint64_t last; /* number given to a worker */
    uint32_t count;
};

/* A client's RenderRequest (a handler of session_messages.h). ERR_NOT_FOUND: no such job, frame or
 * scene; ERR_INPUT, ERR_PROTOCOL: the request is wrong; ERR_LIMIT, ERR_NO_MEMORY, ERR_IO. What is found
 * later is answered by a Failure. */
session_handler render_request_begin;
/* A worker's answer; of a request whose client is gone it is ignored. */
void render_request_answer(struct session *worker, const Azulejo__Wire__Envelope *message);
/* The session has left the table: its requests are freed if it was their client, and sent to another
 * worker if it had them to render. */
void render_requests_session_gone(struct server *server, uint32_t session);
void render_requests_release(struct server *server); /* frees all, unanswered */
