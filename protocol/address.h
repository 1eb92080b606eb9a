/* address: "HOST:PORT" as people write it, for all three programs. */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/base/status.h"

enum {
    ADDRESS_HOST_MAX = 256,
    ADDRESS_TEXT_SIZE = 64, /* "[IPV6]:PORT", with its end */
};

struct sockaddr_storage;

/* "HOST", "HOST:PORT", "[IPV6]", "[IPV6]:PORT", or ":PORT" for `host_preset` (which may be ""); a bare address with
 * several colons is IPv6 without a port. The port defaults to PROTOCOL_PORT_DEFAULT and must be port_min..65535. `host`
 * takes at most host_size - 1 bytes. ERR_USAGE in words that quote the text. */
status address_parse(const char *text, const char *host_preset, unsigned port_min, char *host, size_t host_size,
                     uint16_t *port, struct error *err) MUST_CHECK;

/* An IPv4 or IPv6 address, which is looked up nowhere. */
int address_is_number(const char *host);

/* An IPv4 or IPv6 address and its port, "127.0.0.1:7420" or "[::1]:7420"; returns the port. */
uint16_t address_print(const struct sockaddr_storage *address, char out[ADDRESS_TEXT_SIZE]);
