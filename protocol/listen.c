#include "protocol/listen.h"

#include <arpa/inet.h>
#include <errno.h>
#include <netdb.h>
#include <netinet/in.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>
#include <sys/socket.h>
#include <unistd.h>

#include "common/system/log.h"

/* Addresses without a port. */
struct addresses {
    struct sockaddr_storage all[LISTEN_ADDRESSES_MAX];
    unsigned count;
};

static int is_local(const char *host) { return strcasecmp(host, "localhost") == 0; }

int listen_looks_up(const char *host) { return host[0] && !is_local(host) && !address_is_number(host); }

/* ---- a host's addresses ---------------------------------------------------------------------- */

static void add_both(struct addresses *out, struct in_addr four, struct in6_addr six)
{
    *(struct sockaddr_in *)&out->all[0] = (struct sockaddr_in){.sin_family = AF_INET, .sin_addr = four};
    *(struct sockaddr_in6 *)&out->all[1] = (struct sockaddr_in6){.sin6_family = AF_INET6, .sin6_addr = six};
    out->count = 2;
}

/* 0: there are too many. A name may have an address twice. */
static int add(struct addresses *out, const struct addrinfo *from)
{
    struct sockaddr_storage address = {0};

    memcpy(&address, from->ai_addr, from->ai_addrlen);
    for (unsigned i = 0; i < out->count; i++)
        if (memcmp(&out->all[i], &address, sizeof address) == 0)
            return 1;
    if (out->count == LISTEN_ADDRESSES_MAX)
        return 0;
    out->all[out->count++] = address;
    return 1;
}

static status look_up(struct addresses *out, const struct listen_request *request, struct error *err)
{
    const struct addrinfo hints = {.ai_family = AF_UNSPEC, .ai_socktype = SOCK_STREAM};
    struct addrinfo *found;
    int code, fit = 1;

    if (is_local(request->host)) {
        add_both(out, (struct in_addr){htonl(INADDR_LOOPBACK)}, in6addr_loopback);
        return STATUS_OK;
    }
    if (!request->host[0]) {
        add_both(out, (struct in_addr){htonl(INADDR_ANY)}, in6addr_any);
        return STATUS_OK;
    }
    code = getaddrinfo(request->host, NULL, &hints, &found);
    if (code != 0)
        return error_set(err, STATUS_ERR_IO, "%s %s: %s", request->option, request->host, gai_strerror(code));
    for (const struct addrinfo *a = found; a && fit; a = a->ai_next)
        fit = (a->ai_family != AF_INET && a->ai_family != AF_INET6) || add(out, a);
    freeaddrinfo(found);
    if (!fit)
        return error_set(err, STATUS_ERR_LIMIT, "%s %s: has more than %d addresses: name one of them", request->option,
                         request->host, LISTEN_ADDRESSES_MAX);
    if (out->count == 0)
        return error_set(err, STATUS_ERR_IO, "%s %s: has no address", request->option, request->host);
    return STATUS_OK;
}

/* ---- sockets --------------------------------------------------------------------------------- */

static void close_all(struct listen_sockets *sockets)
{
    while (sockets->count > 0)
        close(sockets->fds[--sockets->count]);
}

/* One address; 0 or errno. Beside others :: is IPv6's alone. */
static int listen_at(int *out, const struct sockaddr_storage *address, int backlog, int beside_others)
{
    const socklen_t size = address->ss_family == AF_INET6 ? sizeof(struct sockaddr_in6) : sizeof(struct sockaddr_in);
    const int on = 1, fd = socket(address->ss_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    int code;

    if (fd < 0)
        return errno;
    if (setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on) == 0 &&
        (address->ss_family != AF_INET6 || !beside_others ||
         setsockopt(fd, IPPROTO_IPV6, IPV6_V6ONLY, &on, sizeof on) == 0) &&
        bind(fd, (const struct sockaddr *)address, size) == 0 && listen(fd, backlog) == 0) {
        *out = fd;
        return 0;
    }
    code = errno;
    close(fd);
    return code;
}

static void set_port(struct sockaddr_storage *address, uint16_t port)
{
    if (address->ss_family == AF_INET6)
        ((struct sockaddr_in6 *)address)->sin6_port = htons(port);
    else
        ((struct sockaddr_in *)address)->sin_port = htons(port);
}

/* Listen at all addresses, at the port or the first one's. `code` is 0 or why the address `name` failed; those that the
 * machine does not have are in `left_out`, and are no failure if another one is there. */
static status listen_at_all(struct listen_sockets *out, const struct listen_request *request,
                            const struct addresses *addresses, unsigned *left_out, int *code, char name[ADDRESS_TEXT_SIZE])
{
    out->port = request->port;
    *left_out = 0;
    for (unsigned i = 0; i < addresses->count; i++) {
        struct sockaddr_storage address = addresses->all[i];
        socklen_t size = sizeof address;
        set_port(&address, out->port);
        *code = listen_at(&out->fds[out->count], &address, request->backlog, addresses->count > 1);
        address_print(&address, name);
        if (*code == EADDRNOTAVAIL || *code == EAFNOSUPPORT) {
            *left_out |= 1u << i;
            continue;
        }
        if (*code != 0) {
            close_all(out);
            return STATUS_ERR_IO;
        }
        (void)getsockname(out->fds[out->count], (struct sockaddr *)&address, &size);
        out->port = address_print(&address, out->names[out->count]);
        out->count++;
    }
    return out->count > 0 ? STATUS_OK : STATUS_ERR_IO;
}

status listen_open(struct listen_sockets *out, const struct listen_request *request, struct error *err)
{
    struct addresses addresses = {0};
    char name[ADDRESS_TEXT_SIZE];
    unsigned left_out;
    int code;

    *out = (struct listen_sockets){0};
    TRY(look_up(&addresses, request, err));
    for (int tries = 1; listen_at_all(out, request, &addresses, &left_out, &code, name) != STATUS_OK; tries++) {
        if (code == EADDRINUSE && request->port == 0 && tries < LISTEN_TRIES_MAX)
            continue;
        if (code == EADDRINUSE)
            return error_set(err, request->busy, "%s is in use: %s", name, request->if_busy);
        return error_set(err, STATUS_ERR_IO, "%s %s: cannot listen on %s: %s", request->option, request->host, name,
                         strerror(code));
    }
    for (unsigned i = 0; i < addresses.count; i++)
        if (left_out & 1u << i) {
            set_port(&addresses.all[i], out->port);
            address_print(&addresses.all[i], name);
            log_warn("%s %s: this machine does not have %s, nothing listens there", request->option, request->host, name);
        }
    return STATUS_OK;
}
