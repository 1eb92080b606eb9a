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

#include "coordinator/net/server.h"
#include "coordinator/web/http_parts.h"

enum { BACKLOG = 128 };

static void name_peer(char *out, size_t size, const struct sockaddr_storage *address, socklen_t length)
{
    char host[48] = "?", port[8] = "?";

    getnameinfo((const struct sockaddr *)address, length, host, sizeof host, port, sizeof port,
                NI_NUMERICHOST | NI_NUMERICSERV);
    snprintf(out, size, address->ss_family == AF_INET6 ? "[%s]:%s" : "%s:%s", host, port);
}

/* All places are taken: the connection that has waited longest for its next request gives its own up. 0: none
 * waits. This runs in no event of the library's, so it may end one at once. */
static int make_room(struct http *http)
{
    struct http_connection *oldest = NULL;

    for (struct http_connection *c = http->first; c; c = c->next)
        if ((c->state == HTTP_IDLE || c->is_dead) && !c->is_ending)
            oldest = c;
    if (oldest)
        http_end_now(oldest);
    return oldest != NULL;
}

static void adopt(struct http *http, int fd, const char *peer)
{
    static const unsigned gone_ms = HTTP_SILENCE_MS; /* a peer that acknowledges nothing is gone */
    struct http_connection *c = http_connection_new(http, peer);
    lws_adopt_desc_t how = {
        .vh = http->vhost, .type = LWS_ADOPT_HTTP | LWS_ADOPT_SOCKET | LWS_ADOPT_ALLOW_SSL, .fd.sockfd = fd, .opaque = c};

    if (!c) {
        close(fd);
        return;
    }
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

static void on_listener(uv_poll_t *poll, int code, int events)
{
    struct http *http = poll->data;

    (void)events;
    if (code < 0)
        return;
    for (int i = 0; i < HTTP_ACCEPTS_PER_TURN; i++) {
        struct sockaddr_storage address = {0};
        socklen_t length = sizeof address;
        char peer[64];
        int fd = accept4(http->listener, (struct sockaddr *)&address, &length, SOCK_NONBLOCK | SOCK_CLOEXEC);

        if (fd < 0)
            return;
        if (http->connection_count - http->ending_count >= http->connections_max && !make_room(http)) {
            http->counts.answers[0]++;
            close(fd);
            continue;
        }
        name_peer(peer, sizeof peer, &address, length);
        adopt(http, fd, peer);
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
    if (code == 0 && uv_poll_init(&http->web->server->loop, &http->poll, fd) == 0) {
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
