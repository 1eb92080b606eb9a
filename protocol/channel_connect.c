#include <stdio.h>
#include <string.h>

#include "common/system/clock.h"
#include "protocol/channel_parts.h"

static void connect_next(struct channel *c);

/* The socket of a failed attempt is closed: try the next address with a new one. */
static void on_attempt_closed(uv_handle_t *handle)
{
    struct channel *c = handle->data;

    if (c->state == DEAD) {
        channel_hold_drop(c);
        return;
    }
    uv_tcp_init(c->loop, &c->tcp);
    c->tcp.data = c;
    connect_next(c);
}

static void attempt_failed(struct channel *c, int uv_error)
{
    uv_timer_stop(&c->timer);
    if (!c->next_address || clock_monotonic_ns() >= c->connect_deadline_ns) {
        channel_end_now(c, STATUS_ERR_UNREACHABLE, "cannot connect: %s%s", uv_strerror(uv_error),
                        uv_error == UV_ECONNREFUSED ? " (is azulejo-coordinator running there?)" : "");
        return;
    }
    uv_close((uv_handle_t *)&c->tcp, on_attempt_closed);
}

static void on_connected(uv_connect_t *request, int result)
{
    struct channel *c = request->data;

    if (c->state == DEAD || result == UV_ECANCELED)
        return;
    if (result < 0) {
        attempt_failed(c, result);
        return;
    }
    channel_limit(c, CHANNEL_PATIENCE_MS);
    channel_read_start(c);
    if (c->state != DEAD)
        channel_begin_handshake(c);
}

static void on_attempt_timeout(uv_timer_t *timer) { attempt_failed(timer->data, UV_ETIMEDOUT); }

static void connect_next(struct channel *c)
{
    struct addrinfo *address = c->next_address;
    uint64_t now = clock_monotonic_ns(), left_ms;
    int result;

    left_ms = now < c->connect_deadline_ns ? (c->connect_deadline_ns - now) / NS_PER_MS : 0;
    c->next_address = address->ai_next;
    if (c->next_address && left_ms > CHANNEL_ADDRESS_MS)
        left_ms = CHANNEL_ADDRESS_MS;
    uv_timer_start(&c->timer, on_attempt_timeout, left_ms, 0);
    c->connect.data = c;
    result = uv_tcp_connect(&c->connect, &c->tcp, address->ai_addr, on_connected);
    if (result < 0)
        attempt_failed(c, result);
}

static void on_resolved(uv_getaddrinfo_t *request, int result, struct addrinfo *addresses)
{
    struct channel *c = request->data;

    c->addresses = c->next_address = addresses;
    if (c->state == DEAD) {
        channel_hold_drop(c);
        return;
    }
    c->holds--; /* the two handles remain */
    if (result < 0 || !addresses)
        channel_end_now(c, STATUS_ERR_UNREACHABLE, "no such host: %s",
                        uv_strerror(result < 0 ? result : UV_EAI_NONAME));
    else
        connect_next(c);
}

status channel_connect(struct channel **out, uv_loop_t *loop, const char *host, uint16_t port,
                       const struct farm_key *key, enum farm_role role, const struct channel_callbacks *callbacks,
                       void *user, struct error *err)
{
    const struct addrinfo hints = {.ai_socktype = SOCK_STREAM, .ai_protocol = IPPROTO_TCP};
    struct channel *c = channel_new(loop, callbacks, user);
    char service[8];
    status s;
    int result;

    *out = NULL;
    NEED(c, err, "a connection");
    s = tls_new_client(&c->tls, key, role, err);
    if (s != STATUS_OK) {
        channel_free(c);
        return s;
    }
    snprintf(c->peer, sizeof c->peer, strchr(host, ':') ? "[%s]:%u" : "%s:%u", host, port);
    snprintf(service, sizeof service, "%u", port);
    channel_start_handles(c);
    c->connect_deadline_ns = clock_monotonic_ns() + channel_limit_ms(CHANNEL_CONNECT_MS) * NS_PER_MS;
    c->resolve.data = c;
    result = uv_getaddrinfo(loop, &c->resolve, on_resolved, host, service, &hints);
    if (result < 0)
        channel_end_now(c, STATUS_ERR_UNREACHABLE, "no such host: %s", uv_strerror(result));
    else
        c->holds++;
    *out = c;
    return STATUS_OK;
}
