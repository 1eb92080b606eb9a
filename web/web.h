/* web: the page and its API, for which this program is a client of the farm.
 *
 *   web_new --> connecting <--> connected --the first time--> listening; web_stop --> closing --> web_free
 *
 * The parts hang on struct web; each is begun and ended in web.c. When the coordinator goes away what it would have
 * answered is answered as unavailable, streams stay, and the connection is tried again.
 */
#pragma once

#include <stdint.h>
#include <uv.h>

#include "common/base/status.h"
#include "protocol/azulejo.pb-c.h"
#include "web/base/callers.h"
#include "web/http/guard.h"
#include "web/base/link.h"

enum {
    WEB_URL_MAX = 512,
    WEB_TICK_MS = 100,
    WEB_AGAIN_MIN_MS = 200,      /* between two tries to connect, doubling */
    WEB_AGAIN_MAX_MS = 5000,
    WEB_ENDS_MS = 300,           /* an ended token's own answers are sent first */
};

struct web_options {
    const char *host;                      /* to listen on */
    uint16_t port;                         /* 0: any */
    const char *name;                      /* one more name by which browsers reach it; NULL: none */
    const char *cert, *key;                /* PEM files; NULL: plain HTTP, or a certificate of our own */
    const char *folder;                    /* for uploads and the certificate */
    uint32_t connections_max, address_max; /* of all; of one address */
    const char *client;                    /* the program `azulejo`, for uploads; NULL: beside this program */
};

/* As the coordinator said last. */
struct farm_state {
    int ending;
    char store_why[256]; /* why the store cannot be used; "": it can */
    uint64_t uploads_max, store_limit;
};

struct http;
struct live;
struct imports;
struct web_calls;
struct web_routing;

struct web {
    struct web_options options;
    uv_loop_t *loop;
    uv_timer_t tick, again;
    struct link_peers farm;
    struct link_peer *control; /* the page's own connection; NULL: none */
    int is_connected, is_stopping;
    uint32_t again_ms;
    struct error no_farm; /* why the last connection to the coordinator ended: said once */
    struct farm_state state;
    struct guard guard;
    const struct web_routing *routing; /* routes.h */
    struct http *http;                 /* http.h; NULL: it does not listen yet */
    char *own_cert, *own_key;          /* files of the certificate that we make; NULL: one is named */
    char fingerprint[3 * 32];
    char wall[64], wall_lacks[256]; /* what the kernel has and lacks of it (wall.h) */
    struct callers callers;
    struct live *live;         /* live.h */
    struct web_calls *calls;   /* call.h */
    struct imports *imports;   /* import.h */
    uint64_t ended_ns;         /* a token ended, and what was begun with it is still there; 0: there is none */
    char address[WEB_URL_MAX]; /* "http://127.0.0.1:7421" */
    struct error why;          /* why it ends by itself */
};

/* Listens. Copies `farm` but its loop and host. The options' texts are the caller's and stay. Starts no thread, so that what
 * the program gives up after it holds for all of it (confine.h). ERR_USAGE, ERR_NO_MEMORY. */
status web_new(struct web **out, uv_loop_t *loop, const struct web_options *options, const struct link_peers *farm,
               struct error *err) MUST_CHECK;
/* Connects. ERR_NO_MEMORY, ERR_IO. */
status web_start(struct web *web, struct error *err) MUST_CHECK;
/* Close all handles; the loop ends. */
void web_stop(struct web *web);
/* After the loop has ended; NULL is fine. */
void web_free(struct web *web);
