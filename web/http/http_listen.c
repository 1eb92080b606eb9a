/* The page's listeners. The sockets are accepted here and handed to the library, so that they are counted
 * before it spends anything on them. */
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
    struct http_listener *l = poll->data;
    struct http *http = l->http;

    if (code < 0)
        return;
    for (int i = 0; i < HTTP_ACCEPTS_PER_TURN; i++) {
        struct sockaddr_storage address = {0};
        socklen_t length = sizeof address;
        uint8_t bytes[16];
        int of_address;
        char peer[ADDRESS_TEXT_SIZE];
        int fd = accept4(l->fd, (struct sockaddr *)&address, &length, SOCK_NONBLOCK | SOCK_CLOEXEC);

        if (fd < 0)
            return;
        address_print(&address, peer);
        get_address(bytes, &address);
        of_address = count_of(http, bytes) >= http->address_max && !make_room(http, bytes);
        if (of_address || (http->connection_count - http->ending_count >= http->connections_max && !make_room(http, NULL)))
            turn_away(http, fd, peer, of_address);
        else
            adopt(http, fd, peer, bytes);
    }
}

status http_listen(struct http *http, const char *host, uint16_t port, uint16_t *bound, struct error *err)
{
    const struct listen_request request = {
        .host = host,
        .port = port,
        .backlog = BACKLOG,
        .option = "--web",
        .if_busy = "choose another address for the page with --web",
        .busy = STATUS_ERR_UNREACHABLE,
    };
    struct listen_sockets sockets;
    int is_good = 1;

    TRY(listen_open(&sockets, &request, err));
    *bound = sockets.port;
    for (unsigned i = 0; i < sockets.count; i++) {
        struct http_listener *l = &http->listeners[http->listener_count];
        *l = (struct http_listener){.http = http, .fd = sockets.fds[i]};
        is_good = is_good && uv_poll_init(http->web->loop, &l->poll, l->fd) == 0;
        if (!is_good) {
            close(l->fd);
            continue;
        }
        l->poll.data = l;
        http->listener_count++;
        uv_poll_start(&l->poll, UV_READABLE, on_listener);
    }
    return is_good ? STATUS_OK
                   : error_set(err, STATUS_ERR_IO, "the page cannot listen on %s:%u: no event loop", host, port);
}

static void on_poll_closed(uv_handle_t *handle) { close(((struct http_listener *)handle->data)->fd); }

void http_listen_stop(struct http *http)
{
    while (http->listener_count > 0)
        uv_close((uv_handle_t *)&http->listeners[--http->listener_count].poll, on_poll_closed);
}
