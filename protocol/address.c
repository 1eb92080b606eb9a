#include "protocol/address.h"

#include <arpa/inet.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "protocol/channel.h"

status address_parse(const char *text, const char *host_preset, unsigned port_min, char *host, size_t host_size,
                     uint16_t *port, struct error *err)
{
    const char *name = text, *colon = strchr(text, ':');
    size_t length = strlen(text);

    *port = PROTOCOL_PORT_DEFAULT;
    host[0] = 0;
    if (text[0] == '[') {
        const char *end = strchr(text, ']');
        if (!end || end == text + 1 || (end[1] != 0 && end[1] != ':'))
            goto malformed;
        name = text + 1;
        length = (size_t)(end - name);
        colon = end[1] == ':' ? end + 1 : NULL;
    } else if (colon && strchr(colon + 1, ':')) {
        colon = NULL;
    } else if (colon) {
        length = (size_t)(colon - text);
    }
    if (colon) {
        char *end;
        unsigned long number = strtoul(colon + 1, &end, 10);
        if (colon[1] < '0' || colon[1] > '9' || *end || number < port_min || number > 65535)
            return error_set(err, STATUS_ERR_USAGE, "'%s': the port must be %u..65535", text, port_min);
        *port = (uint16_t)number;
    }
    if (length == 0 && colon == text) {
        name = host_preset;
        length = strlen(name);
    } else if (length == 0) {
        goto malformed;
    }
    if (length >= host_size)
        return error_set(err, STATUS_ERR_USAGE, "'%s': the host's name is longer than %zu bytes", text, host_size - 1);
    memcpy(host, name, length);
    host[length] = 0;
    return STATUS_OK;
malformed:
    return error_set(err, STATUS_ERR_USAGE, "'%s' is not an address: write HOST, HOST:PORT or [IPV6]:PORT", text);
}

int address_is_number(const char *host)
{
    unsigned char bytes[16];

    return inet_pton(AF_INET, host, bytes) == 1 || inet_pton(AF_INET6, host, bytes) == 1;
}

uint16_t address_print(const struct sockaddr_storage *address, char out[ADDRESS_TEXT_SIZE])
{
    const struct sockaddr_in6 *six = (const struct sockaddr_in6 *)address;
    const struct sockaddr_in *four = (const struct sockaddr_in *)address;
    const int is_six = address->ss_family == AF_INET6;
    const uint16_t port = ntohs(is_six ? six->sin6_port : four->sin_port);
    char host[INET6_ADDRSTRLEN] = "?";

    (void)inet_ntop(address->ss_family, is_six ? (const void *)&six->sin6_addr : &four->sin_addr, host, sizeof host);
    snprintf(out, ADDRESS_TEXT_SIZE, is_six ? "[%s]:%u" : "%s:%u", host, port);
    return port;
}
