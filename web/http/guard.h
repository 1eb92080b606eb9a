/* guard: which requests are answered at all, by their headers. Without sockets, so that it can be tested.
 *
 * A browser sends what any page makes it send, so a page of another origin must get nothing: a foreign name
 * that resolves to us (DNS rebinding) is recognised by the Host header, a foreign page's request by its
 * Origin and Sec-Fetch-Site.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/base/status.h"

enum {
    GUARD_NAME_MAX = 255,
    GUARD_NAMES_MAX = 8,
    GUARD_TOKEN_MAX = 255,
};

/* With the port behind it: browsers send cookies to every port of a host, so each coordinator needs a name of its own. */
#define GUARD_COOKIE "azulejo_session_"

/* What every response has. */
enum { GUARD_LINES = 6 };
struct guard_line { const char *name, *value; };
extern const struct guard_line guard_lines[GUARD_LINES];

struct guard {
    char names[GUARD_NAMES_MAX][GUARD_NAME_MAX + 1]; /* lower case, IPv6 in brackets */
    size_t name_count;
    int any_address; /* bound to every address: any IP address is a name of ours, as it cannot be rebound */
    int is_tls;
    uint16_t port;
};

/* `host` is what the page listens on, `name` one more name (NULL: none). ERR_USAGE: not a name. */
status guard_init(struct guard *guard, const char *host, const char *name, uint16_t port, int is_tls,
                  struct error *err) MUST_CHECK;
/* The name to print: `name`, or what it listens on, or one by which that can be reached. */
const char *guard_public_name(const struct guard *guard, const char *host, const char *name);
/* Is the address (as given to bind) on this machine only? */
int guard_is_loopback(const char *host);

/* What a request says of itself; NULL: no such header. */
struct guard_headers_of {
    const char *host, *origin, *fetch_site, *fetch_mode;
    int changes;   /* not GET or HEAD */
    int is_socket; /* wants to become a WebSocket */
    int by_cookie; /* the browser sent its token by itself */
    int is_api;
};
/* 0: go on; else the HTTP status of the refusal, and why. */
unsigned guard_check(const struct guard *guard, const struct guard_headers_of *request, struct error *why);

/* The token of "Bearer TOKEN", or of our cookie (that of the coordinator on this port), into out[GUARD_TOKEN_MAX + 1]. 0: there is none. */
int guard_bearer(const char *authorization, char *out);
int guard_cookie(const char *cookies, uint16_t port, char *out);
