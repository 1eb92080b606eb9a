/* Connections in the server's list: made, given time, and ended. */
#include <stdio.h>

#include "common/system/clock.h"
#include "common/base/memory.h"
#include "web/http/http_parts.h"

struct http_connection *http_connection_new(struct http *http, const char *peer)
{
    struct http_connection *c = mem_calloc(1, sizeof *c);

    if (!c)
        return NULL;
    c->http = http;
    snprintf(c->peer, sizeof c->peer, "%s", peer);
    c->next = http->first;
    if (c->next)
        c->next->prev = c;
    http->first = c;
    http->connection_count++;
    return c;
}

void http_deadline(struct http_connection *c, unsigned ms)
{
    if (c->is_dead)
        return;
    c->deadline_ns = ms ? clock_monotonic_ns() + (uint64_t)ms * NS_PER_MS : 0;
}

void http_kill(struct http_connection *c)
{
    c->is_dead = 1;
    c->deadline_ns = c->is_ending ? 0 : 1;
}

void http_end_now(struct http_connection *c)
{
    if (c->is_ending)
        return;
    c->is_ending = c->is_dead = 1;
    c->deadline_ns = 0;
    c->http->ending_count++;
    lws_set_timeout(c->wsi, PENDING_TIMEOUT_USER_REASON_BASE, LWS_TO_KILL_SYNC);
}

/* The library has no more to say about it. */
void http_connection_free(struct http_connection *c)
{
    struct http *http = c->http;

    if (c->prev)
        c->prev->next = c->next;
    else
        http->first = c->next;
    if (c->next)
        c->next->prev = c->prev;
    http->connection_count--;
    http->ending_count -= (uint32_t)c->is_ending;
    http_queue_release(&c->out);
    buffer_release(&c->message);
    mem_free(c);
}
