/* http_parts: what the http*.c files share. */
#pragma once

#include <libwebsockets.h>
#include <uv.h>

#include "common/base/buffer.h"
#include "common/system/log_limit.h"
#include "protocol/listen.h"
#include "web/http/http.h"
#include "web/http/http_queue.h"
#include "web/api/routes.h"
#include "web/web.h"

enum {
    HTTP_QUERY_MAX = 32,       /* values of a query */
    HTTP_ACCEPTS_PER_TURN = 16,
    HTTP_KEPT_MAX = 9,         /* headers that handlers can ask for */
    HTTP_PIECE_MAX = 64 << 10, /* handed to the kernel at once */
};

enum http_state { HTTP_IDLE, HTTP_BODY, HTTP_ANSWERING, HTTP_LINGER, HTTP_SOCKET };

/* A request with its texts. */
struct http_request {
    struct web_request base;
    struct buffer texts;
    const char *query[HTTP_QUERY_MAX]; /* "name=value" */
    const char *kept[HTTP_KEPT_MAX];   /* values, in the order of http_kept_names */
    int is_over, running;              /* answered or gone; handlers on the stack */
};

struct http_connection {
    struct http *http;
    struct lws *wsi;
    struct http_connection *prev, *next;
    enum http_state state;
    uint64_t deadline_ns; /* it is ended at this time; 0: none */
    char peer[64];
    uint8_t address[16]; /* IPv6, or IPv4 mapped into it */
    struct http_queue out;
    struct http_request *request; /* NULL: none, or it is over */
    struct web_socket *socket;
    struct buffer message;          /* of a WebSocket, so far */
    const struct web_route *route;  /* that a WebSocket asked for */
    struct web_caller caller;       /* the same */
    uint64_t token;                 /* of its last request; 0: none */
    uint64_t body_left;             /* bytes of the body that have not come */
    uint64_t discarded;             /* bytes of a body that is not wanted */
    int is_head, is_old;            /* HEAD; HTTP/1.0 */
    int begun, is_chunked, no_body; /* of the answer */
    uint64_t length_left;           /* bytes of the announced length that were not written */
    int ended;                      /* its last byte is in the queue */
    int close_after;                /* the connection ends with this answer, */
    int lingers;                    /* and some of what still comes is skipped first */
    int body_over;                  /* the library has reported the end of the body */
    int reading_paused;             /* it is not read: its handler is behind, or its answer is under way */
    int running;                    /* a socket's handlers on the stack */
    int is_dead;                    /* to be ended; */
    int is_ending;                  /* the library ends it, once the loop has closed its socket */
    int was_refused;                /* by the library, when it was new */
    int retires;                    /* the token of its request or WebSocket has ended since */
    uint64_t heard_ns, pinged_ns;   /* of a WebSocket */
    int ping_wanted;
    unsigned close_code; /* of a WebSocket; 0: not closing */
    char close_reason[64];
};

struct http {
    struct web *web;
    struct lws_context *context;
    struct lws_vhost *vhost;
    struct http_listener {
        struct http *http;
        uv_poll_t poll;
        int fd;
    } listeners[LISTEN_ADDRESSES_MAX]; /* an address each */
    unsigned listener_count;
    struct http_connection *first;                            /* newest first */
    uint32_t connection_count, connections_max, ending_count; /* those that are ending are in both */
    uint32_t address_max;                                     /* of one address */
    struct log_limit complaints;
    struct http_counts counts;
    int is_stopping;
    struct lws_protocol_vhost_options lines[GUARD_LINES]; /* for the library's own answers */
};

extern const char *const http_kept_names[HTTP_KEPT_MAX];

/* ---- http_connection.c ---- */
/* A new one, in the list; NULL: out of memory. */
struct http_connection *http_connection_new(struct http *http, const char *peer);
void http_connection_free(struct http_connection *c);       /* request and socket are gone */
void http_deadline(struct http_connection *c, unsigned ms); /* 0: none */
/* End it in the next tick: the library frees no connection whose event is being served, and its own timers run
 * only after an event of its own. */
void http_kill(struct http_connection *c);
void http_end_now(struct http_connection *c); /* outside of the library's events only; it is freed soon */
/* ---- http_listen.c ---- */
status http_listen(struct http *http, const char *host, uint16_t port, uint16_t *bound, struct error *err) MUST_CHECK;
void http_listen_stop(struct http *http);
/* ---- http_head.c ---- */
/* What the checks need and nothing later does: places in `texts`, or SIZE_MAX. */
struct http_head {
    struct buffer texts;
    size_t host, origin, site, mode, authorization, cookie, transfer, expect, version, connection, length;
};
static inline const char *http_head_text(const struct http_head *head, size_t at)
{
    return at == SIZE_MAX ? NULL : (const char *)head->texts.data + at;
}
int http_head_read(struct lws *wsi, struct http_head *head); /* 0: out of memory */
/* Path, query and the headers that handlers may ask for. *path is a copy that may be cut. 0: out of memory, a 0 in
 * the path, or too many values. */
int http_take_texts(struct http_connection *c, struct http_request *request, const char *uri, size_t uri_size,
                    char **path);
/* ---- http_life.c ---- */
struct http_request *http_request_new(struct http_connection *c);
void http_request_call(struct http_request *request, void (*handler)(struct web_request *));
void http_give_body(struct http_connection *c, const uint8_t *data, size_t size);
void http_request_over(struct http_connection *c); /* from now on only the connection is left of it */
void http_request_gone(struct http_connection *c); /* the same, and its handler is called */
/* ---- http_request.c: each returns 0, or -1 to end the connection ---- */
int http_on_request(struct http_connection *c);
int http_on_body(struct http_connection *c, const uint8_t *data, size_t size);
int http_on_body_end(struct http_connection *c);
int http_on_upgrade(struct http_connection *c, const char *to); /* 1: answered already */
int http_on_no_request(struct http_connection *c, const char *data, size_t size); /* its first line is none that the library knows */
/* ---- http_answer.c ---- */
void http_resume_reading(struct http_connection *c); /* if it is paused */
int http_on_writable(struct http_connection *c);
void http_pause_reading(struct http_connection *c); /* if need be, or resume it: of one that is IDLE or ANSWERING */
/* ---- http_socket.c ---- */
int http_socket_open(struct http_connection *c);
void http_socket_heard(struct http_connection *c);
void http_socket_tick(struct http_connection *c, uint64_t now_ns); /* asks, or marks it for its end */
int http_socket_receive(struct http_connection *c, const void *data, size_t size);
int http_socket_writable(struct http_connection *c);
void http_socket_gone(struct http_connection *c);
