/* listen: sockets that listen on every address of a host's name, IPv4 and IPv6, all on one port.
 *
 * "localhost" is 127.0.0.1 and ::1 (RFC 6761, section 6.3), "" all addresses of the machine; neither is looked up. An address that this
 * machine does not have is left out with a warning, if another one is left. Blocks while a name is looked up.
 */
#pragma once

#include <stdint.h>

#include "common/base/status.h"
#include "protocol/address.h"

enum {
    LISTEN_ADDRESSES_MAX = 8,
    LISTEN_TRIES_MAX = 16, /* of free ports, of which one of the addresses has none */
};

struct listen_request {
    const char *host;
    uint16_t port; /* 0: any, the same for all addresses */
    int backlog;
    const char *option;  /* for messages: "--listen" */
    const char *if_busy; /* what to do about an address that is in use */
    status busy;         /* the code then */
};

struct listen_sockets {
    int fds[LISTEN_ADDRESSES_MAX];
    char names[LISTEN_ADDRESSES_MAX][ADDRESS_TEXT_SIZE]; /* "127.0.0.1:7420", "[::1]:7420" */
    unsigned count;
    uint16_t port;
};

/* On failure none is open. The caller owns the sockets, which do not block. */
status listen_open(struct listen_sockets *out, const struct listen_request *request, struct error *err) MUST_CHECK;

/* Is its name looked up, in files and on the network? */
int listen_looks_up(const char *host);
