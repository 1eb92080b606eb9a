/* Requests from their headers to their end, and what their handlers ask of them. A request is freed once it is over
 * and none of its handlers is on the stack. */
#include "web/api/request.h"

#include <string.h>

#include "common/base/memory.h"
#include "web/http/http_parts.h"

/* ---- a request's life ------------------------------------------------------------------------ */

static void release(struct http_request *request)
{
    if (request->running || !request->is_over)
        return;
    if (request->base.own_free)
        request->base.own_free(request->base.own);
    buffer_release(&request->base.body);
    buffer_release(&request->texts);
    mem_free(request);
}

/* From now on only the connection is left of it. */
void http_request_over(struct http_connection *c)
{
    struct http_request *request = c->request;

    c->request = NULL;
    if (!request)
        return;
    request->base.connection = NULL;
    request->is_over = 1;
    release(request);
}

void http_request_gone(struct http_connection *c)
{
    struct http_request *request = c->request;

    if (!request)
        return;
    request->running++;
    if (request->base.on_gone)
        request->base.on_gone(&request->base);
    request->running--;
    if (c->request)
        http_request_over(c);
    else
        release(request);
}

void http_request_call(struct http_request *request, void (*handler)(struct web_request *))
{
    request->running++;
    handler(&request->base);
    request->running--;
    release(request);
}

void http_give_body(struct http_connection *c, const uint8_t *data, size_t size)
{
    struct http_request *request = c->request;

    request->running++;
    request->base.on_body(&request->base, data, size);
    request->running--;
    release(request);
}

struct http_request *http_request_new(struct http_connection *c)
{
    struct http_request *request = mem_calloc(1, sizeof *request);

    if (!request)
        return NULL;
    request->base = (struct web_request){.web = c->http->web, .peer = c->peer, .path = "", .connection = c};
    c->request = request;
    c->state = HTTP_ANSWERING;
    c->begun = c->ended = c->is_chunked = c->no_body = c->is_head = c->is_old = c->close_after = c->lingers = 0;
    c->body_left = c->discarded = 0;
    c->body_over = c->retires = 0;
    http_resume_reading(c);
    http_deadline(c, 0);
    return request;
}

/* ---- what handlers ask ----------------------------------------------------------------------- */

const char *web_query(const struct web_request *base, const char *name)
{
    const struct http_request *request = (const struct http_request *)base;
    const size_t size = strlen(name);

    for (size_t i = 0; i < HTTP_QUERY_MAX && request->query[i]; i++)
        if (strncmp(request->query[i], name, size) == 0 && (request->query[i][size] == '=' || !request->query[i][size]))
            return request->query[i] + size + (request->query[i][size] == '=');
    return NULL;
}

const char *web_query_at(const struct web_request *base, size_t index)
{
    const struct http_request *request = (const struct http_request *)base;

    return index < HTTP_QUERY_MAX ? request->query[index] : NULL;
}

const char *web_header(const struct web_request *base, const char *name)
{
    const struct http_request *request = (const struct http_request *)base;

    for (size_t i = 0; i < HTTP_KEPT_MAX; i++)
        if (strcmp(name, http_kept_names[i]) == 0)
            return request->kept[i];
    return NULL;
}
