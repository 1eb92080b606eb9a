/* http: HTTP/1.1 and WebSockets on the server's loop, by libwebsockets. It makes the requests of request.h,
 * gives them to the routes, and bounds what anyone who can connect may cost: connections, header and body
 * sizes, and the time for each step.
 *
 *   a connection: IDLE --headers--> BODY --whole--> ANSWERING --sent--> IDLE ...
 *                  |                 \--answered before it was whole--> LINGER --some of the rest was skipped--> ended
 *                  \--> SOCKET, until it ends
 */
#pragma once

#include <stdint.h>

#include "common/base/status.h"

struct http;
struct web;

enum {
    HTTP_CONNECTIONS_MAX = 256,
    HTTP_CONNECTIONS_MIN = 8,
    HTTP_HEADERS_MAX = 16 << 10,   /* of one request, all together */
    HTTP_MESSAGE_MAX = 64 << 10,   /* of a WebSocket's client */
    HTTP_HEADERS_MS = 10000,       /* the whole of a request's headers must come within this, */
    HTTP_BODY_MS = 30000,          /* a body that is held in memory within this, */
    HTTP_STALL_MS = 20000,         /* and of streams something within this, in either direction */
    HTTP_IDLE_MS = 75000,          /* between requests */
    HTTP_PING_MS = 10000,          /* a WebSocket that has said nothing for so long is asked, */
    HTTP_SILENCE_MS = 30000,       /* and after this, with no answer, ended */
    HTTP_LINGER_MS = 2000,         /* bodies that are refused are skipped for so long, */
    HTTP_LINGER_BYTES = 8 << 20,   /* and so far */
};

/* Listen, and put the port's number into web->guard and the address into web->address.
 * ERR_UNREACHABLE: the port is in use. */
status http_start(struct http **out, struct web *web, struct error *err) MUST_CHECK;
/* End everything: what is sent is not waited for. Then the loop closes its handles. */
void http_stop(struct http *http);
/* After the loop has ended. */
void http_free(struct http *http);
void http_tick(struct http *http, uint64_t now_ns);

/* Of all requests so far, by the first digit of their status; [0]: refused connections. */
struct http_counts {
    uint64_t answers[6];
    uint32_t connections, sockets;
};
struct http_counts http_counts(const struct http *http);
/* Note what was begun with this token, or with any cookie if `cookies`: requests, streams and WebSockets; and end it. */
void http_retire_token(struct http *http, uint64_t token, int cookies);
void http_end_retired(struct http *http);
