/* request: one HTTP request and its answer, or one WebSocket, as the rest of this room sees them.
 * Nothing here knows libwebsockets: http.c makes requests, and the tests make them without a socket.
 *
 *   made --handler runs--> answered at once: web_answer, web_fail
 *                      \-> kept, and answered later, unless on_gone comes first
 *                      \-> web_begin, web_write ..., web_end: a stream
 *
 * All on the loop's thread. After web_answer, web_fail, web_end or on_gone the request is freed when the
 * handler has returned: nothing may keep it.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/base/buffer.h"
#include "common/base/status.h"
#include "common/schema/token_roles.h"

struct web;
struct web_route;

enum web_method { WEB_GET, WEB_POST, WEB_PUT, WEB_PATCH, WEB_DELETE, WEB_METHODS };

enum {
    WEB_PARAMETERS_MAX = 4,      /* {job}, {frame}, ... of a path */
    WEB_BODY_MAX = 1 << 20,      /* bytes of a body that is held in memory */
    WEB_WHO_MAX = 127,
    WEB_TOKEN_NAME_MAX = 63,
    WEB_QUEUE_HIGH = 1 << 20,    /* a stream's writer stops above this many queued bytes */
};

/* Who asks: found by the token of the request. */
struct web_caller {
    enum web_role role; /* NONE: no valid token */
    uint64_t token;     /* number of the token; 0: none */
    char token_name[WEB_TOKEN_NAME_MAX + 1];
    char who[WEB_WHO_MAX + 1]; /* owner of what it submits: user@host */
    int by_cookie;             /* the browser sent it by itself: Origin was checked for writes */
};

struct web_request {
    struct web *web;
    const struct web_route *route;
    enum web_method method;
    struct web_caller caller;
    const char *path;                           /* percent-decoded, without the query; "/api/v1/jobs/12" */
    const char *parameters[WEB_PARAMETERS_MAX]; /* of the route's path, in its order; texts */
    const char *peer;                           /* "127.0.0.1:40312" */
    struct buffer body;                         /* whole; empty if there was none, or the route streams it */

    /* For handlers that answer later or stream; may be NULL. */
    void *state;
    void *own;                   /* the handler's besides, when `state` is a call's (call.h); given to */
    void (*own_free)(void *own); /* this when the request is freed; NULL: nothing to free */
    void (*on_gone)(struct web_request *request);     /* the client vanished: drop `state` */
    void (*on_writable)(struct web_request *request); /* the queue is short again */
    /* A route with `streams_body`: pieces as they arrive, then size 0. While paused (web_pause_body) none. */
    void (*on_body)(struct web_request *request, const uint8_t *data, size_t size);
    void *connection; /* http.c's own */
};

/* A value of the query, percent-decoded; NULL: not given. Valid until the request ends. */
const char *web_query(const struct web_request *request, const char *name);
/* The query's values one after the other, as "name=value"; NULL: there are no more. */
const char *web_query_at(const struct web_request *request, size_t index);
/* A header of the request by its lower-case name ("if-none-match", "last-event-id"); NULL: not given or
 * not one that http.c keeps. */
const char *web_header(const struct web_request *request, const char *name);

/* Headers of an answer beyond the common ones (no-store, CSP, nosniff, ...): whole lines "name: value\r\n";
 * NULL: none. Names in lower case. */
void web_answer(struct web_request *request, unsigned http_status, const char *content_type, const char *headers,
                const void *data, size_t size);
/* application/problem+json (RFC 9457) made of the error: type, title, status, detail, code. */
void web_fail(struct web_request *request, const struct error *why);
/* A stream; length 0: not known, sent in chunks. */
void web_begin(struct web_request *request, unsigned http_status, const char *content_type, const char *headers,
               uint64_t length);
void web_write(struct web_request *request, const void *data, size_t size); /* copied */
size_t web_queued(const struct web_request *request);                       /* bytes not taken by the kernel */
void web_end(struct web_request *request);
void web_pause_body(struct web_request *request, int paused);

/* A WebSocket; its Origin and caller were checked. */
struct web_socket {
    struct web *web;
    struct web_caller caller;
    const char *peer;
    void *state;
    void (*on_text)(struct web_socket *socket, const char *text, size_t size); /* a whole message, UTF-8 */
    void (*on_writable)(struct web_socket *socket);
    void (*on_gone)(struct web_socket *socket);
    void *connection;
};
void web_socket_send(struct web_socket *socket, int binary, const void *data, size_t size); /* copied */
size_t web_socket_queued(const struct web_socket *socket);
void web_socket_close(struct web_socket *socket, unsigned code, const char *reason);
