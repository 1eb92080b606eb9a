/* The page's listener. The sockets are accepted here and handed to the library, so that they are counted
 * before it spends anything on them. */
#include <errno.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "common/system/clock.h"
#include "common/system/log.h"
#include "web/http/http_parts.h"

enum { BACKLOG = 128 };

static void name_peer(char *out, size_t size, const struct sockaddr_storage *address, socklen_t length)
{
    char host[48] = "?", port[8] = "?";

    getnameinfo((const struct sockaddr *)address, length, host, sizeof host, port, sizeof port,
                NI_NUMERICHOST | NI_NUMERICSERV);
    snprintf(out, size, address->ss_family == AF_INET6 ? "[%s]:%s" : "%s:%s", host, port);
}

static void get_address(uint8_t out[16], const struct sockaddr_storage *address)
{
    memset(out, 0, 16);
    if (address->ss_family == AF_INET6) {
        memcpy(out, &((const struct sockaddr_in6 *)address)->sin6_addr, 16);
    } else {
        out[10] = out[11] = 0xff; /* RFC 4291, section 2.5.5.2 */
        memcpy(out + 12, &((const struct sockaddr_in *)address)->sin_addr, 4);
    }
}

static uint32_t count_of(const struct http *http, const uint8_t address[16])
{
    uint32_t count = 0;

    for (const struct http_connection *c = http->first; c; c = c->next)
        count += !c->is_ending && memcmp(c->address, address, 16) == 0;
    return count;
}

/* All places are taken, or with `address` all of its places: the connection that has waited longest for its next
 * request gives its own up. 0: none waits. This runs in no event of the library's, so it may end one at once. */
static int make_room(struct http *http, const uint8_t *address)
{
    struct http_connection *oldest = NULL;

    for (struct http_connection *c = http->first; c; c = c->next)
        if ((!address || memcmp(c->address, address, 16) == 0) && (c->state == HTTP_IDLE || c->is_dead) && !c->is_ending)
            oldest = c;
    if (oldest)
        http_end_now(oldest);
    return oldest != NULL;
}

/* No place for it: say so, where no TLS is expected, and once a minute for each address in the log. */
static void turn_away(struct http *http, int fd, const char *peer, int is_address)
{
    static const char body[] =
        "HTTP/1.1 503 Service Unavailable\r\nContent-Type: text/plain\r\nRetry-After: 10\r\nConnection: close\r\n\r\n"
        "The coordinator has no place for another connection of your address: close pages or programs that keep some "
        "open, or raise --connections-per-address.\n";
    const char *port = strrchr(peer, ':');
    char subject[LOG_LIMIT_SUBJECT_SIZE], more[80] = "";
    uint64_t left_out;

    http->counts.answers[0]++;
    snprintf(subject, sizeof subject, "%.*s", port ? (int)(port - peer) : 0, peer);
    if (log_limit_pass(&http->complaints, subject, clock_monotonic_ns(), &left_out)) {
        if (left_out > 0)
            snprintf(more, sizeof more, " (and %llu like it since the last such line)", (unsigned long long)left_out);
        log_warn("the page: %s is turned away: %s, and all of them are in use%s", peer,
                 is_address ? "its address has all the connections that one may have" : "all connections are taken", more);
    }
    if (is_address && !http->web->guard.is_tls)
        (void)!send(fd, body, sizeof body - 1, MSG_NOSIGNAL | MSG_DONTWAIT);
    close(fd);
}

static void adopt(struct http *http, int fd, const char *peer, const uint8_t address[16])
{
    static const unsigned gone_ms = HTTP_SILENCE_MS; /* a peer that acknowledges nothing is gone */
    struct http_connection *c = http_connection_new(http, peer);
    lws_adopt_desc_t how = {
        .vh = http->vhost, .type = LWS_ADOPT_HTTP | LWS_ADOPT_SOCKET | LWS_ADOPT_ALLOW_SSL, .fd.sockfd = fd, .opaque = c};

    if (!c) {
        close(fd);
        return;
    }
    memcpy(c->address, address, sizeof c->address);
    http_deadline(c, HTTP_HEADERS_MS);
    setsockopt(fd, IPPROTO_TCP, TCP_USER_TIMEOUT, &gone_ms, sizeof gone_ms);
    /* On failure the library closes the socket. Its last event comes at the end of this turn of the loop, or not at
     * all: http_tick frees what is left. */
    if (!lws_adopt_descriptor_vhost_via_info(&how) && http->first == c) {
        c->was_refused = c->is_ending = c->is_dead = 1;
        c->deadline_ns = 0;
        http->ending_count++;
    }
}

static void on_listener(uv_poll_t *poll, int code, int events UNUSED)
{
    struct http *http = poll->data;

    if (code < 0)
        return;
    for (int i = 0; i < HTTP_ACCEPTS_PER_TURN; i++) {
        struct sockaddr_storage address = {0};
        socklen_t length = sizeof address;
        uint8_t bytes[16];
        int of_address;
        char peer[64];
        int fd = accept4(http->listener, (struct sockaddr *)&address, &length, SOCK_NONBLOCK | SOCK_CLOEXEC);

        if (fd < 0)
            return;
        name_peer(peer, sizeof peer, &address, length);
        get_address(bytes, &address);
        of_address = count_of(http, bytes) >= http->address_max && !make_room(http, bytes);
        if (of_address || (http->connection_count - http->ending_count >= http->connections_max && !make_room(http, NULL)))
            turn_away(http, fd, peer, of_address);
        else
            adopt(http, fd, peer, bytes);
    }
}

static status bound_port(int fd, uint16_t *out, struct error *err)
{
    struct sockaddr_storage address = {0};
    socklen_t length = sizeof address;

    if (getsockname(fd, (struct sockaddr *)&address, &length) != 0)
        return error_set(err, STATUS_ERR_INTERNAL, "the page's port is not known: %s", strerror(errno));
    *out = ntohs(address.ss_family == AF_INET6 ? ((struct sockaddr_in6 *)&address)->sin6_port
                                               : ((struct sockaddr_in *)&address)->sin_port);
    return STATUS_OK;
}

status http_listen(struct http *http, const char *host, uint16_t port, uint16_t *bound, struct error *err)
{
    struct addrinfo hints = {.ai_family = AF_UNSPEC, .ai_socktype = SOCK_STREAM, .ai_flags = AI_PASSIVE}, *found;
    char service[8];
    const int on = 1;
    int code, fd;

    snprintf(service, sizeof service, "%u", port);
    code = getaddrinfo(host[0] ? host : NULL, service, &hints, &found);
    if (code != 0)
        return error_set(err, STATUS_ERR_IO, "--web %s: %s", host, gai_strerror(code));
    fd = socket(found->ai_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    if (fd >= 0)
        setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
    code = fd < 0 || bind(fd, found->ai_addr, found->ai_addrlen) != 0 || listen(fd, BACKLOG) != 0 ? errno : 0;
    freeaddrinfo(found);
    if (code == 0 && uv_poll_init(http->web->loop, &http->poll, fd) == 0) {
        http->listener = fd;
        http->polls = 1;
        http->poll.data = http;
        uv_poll_start(&http->poll, UV_READABLE, on_listener);
        return bound_port(fd, bound, err);
    }
    if (fd >= 0)
        close(fd);
    if (code == EADDRINUSE)
        return error_set(err, STATUS_ERR_UNREACHABLE, "%s:%u is in use: choose another address for the page with --web",
                         host, port);
    return error_set(err, STATUS_ERR_IO, "the page cannot listen on %s:%u: %s", host, port,
                     code ? strerror(code) : "no event loop");
}

static void on_poll_closed(uv_handle_t *handle)
{
    struct http *http = handle->data;

    close(http->listener);
    http->listener = -1;
}

void http_listen_stop(struct http *http)
{
    if (http->polls)
        uv_close((uv_handle_t *)&http->poll, on_poll_closed);
    http->polls = 0;
}
