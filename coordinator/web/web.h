/* web: the page and its API, a guest of the server (coordinator/net/guest.h).
 *
 *   web_new --guest.start--> listening --guest.stop--> closing --its handles are closed--> web_free
 *
 * The parts of this room hang on struct web; each is begun and ended in web.c.
 */
#ifndef AZULEJO_COORDINATOR_WEB_H
#define AZULEJO_COORDINATOR_WEB_H

#include <stdint.h>

#include "common/base/status.h"
#include "coordinator/net/guest.h"
#include "coordinator/web/guard.h"
#include "coordinator/web/metrics.h"
#include "coordinator/web/token_end.h"

enum { WEB_URL_MAX = 512 };

struct web_options {
    const char *host;          /* to listen on */
    uint16_t port;             /* 0: any */
    int was_asked_for;         /* a port in use is an error, else only a warning */
    const char *name;          /* one more name by which browsers reach it; NULL: none */
    const char *cert, *key;    /* PEM files; NULL: plain HTTP, or a certificate of our own */
    const char *store;         /* the store's folder */
    uint32_t connections_max, address_max; /* of all; of one address */
    const char *client;        /* the program `azulejo`, for uploads; NULL: beside this program */
};

struct http;
struct live;
struct imports;
struct web_calls;
struct webhooks;
struct web_routing;
struct web_tokens;

struct web {
    struct web_options options;
    struct server *server;     /* from start to stop */
    struct guard guard;
    const struct web_routing *routing; /* routes.h */
    struct http *http;         /* http.h; NULL: there is no page, as its port was in use */
    struct web_tokens *tokens; /* tokens.h */
    char *own_cert, *own_key;  /* files of the certificate that we make; NULL: one is named */
    struct live *live;         /* live.h; NULL: there is no page */
    struct web_calls *calls;   /* call.h */
    struct token_ends token_ends;
    struct imports *imports;   /* import.h */
    struct webhooks *webhooks; /* webhook.h */
    int store_was_told;        /* webhooks were told that the store cannot be used */
    struct metrics metrics;    /* metrics.h */
    char address[WEB_URL_MAX]; /* "http://127.0.0.1:7421" */
};

/* The options' texts are the caller's and stay. ERR_USAGE, ERR_NO_MEMORY. */
status web_new(struct web **out, const struct web_options *options, struct error *err) MUST_CHECK;
struct server_guest web_guest(struct web *web);
/* After the server's loop has ended; NULL is fine. */
void web_free(struct web *web);

#endif
