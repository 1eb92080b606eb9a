#include <stdio.h>
#include <string.h>

#include "common/base/memory.h"
#include "protocol/address.h"
#include "protocol/channel_parts.h"

enum { TLS_RECORD_HEADER_BYTES = 5, TLS_RECORD_HANDSHAKE = 22, TLS_MAJOR = 3 };

/* ---- the first record ------------------------------------------------------------------ */

/* No OpenSSL object is made for a peer before its ClientHello is complete (RFC 8446, section 5.1).
 * A stranger that sends nothing, little or something else costs this struct and a few bytes. */
void channel_take_first(struct channel *c, const void *data, size_t size_bytes)
{
    const uint8_t *p;
    size_t record;

    if (c->first.size == 0)
        channel_limit(c, CHANNEL_HANDSHAKE_MS);
    if (size_bytes > CHANNEL_FIRST_MAX - c->first.size)
        size_bytes = CHANNEL_FIRST_MAX - c->first.size + 1; /* enough to see that it is too much */
    buffer_append(&c->first, data, size_bytes);
    if (!buffer_ok(&c->first)) {
        channel_end_now(c, STATUS_ERR_NO_MEMORY, "out of memory for bytes being received");
        return;
    }
    p = c->first.data;
    if (p[0] != TLS_RECORD_HANDSHAKE || (c->first.size > 1 && p[1] != TLS_MAJOR)) {
        channel_end_now(c, STATUS_ERR_PROTOCOL, "it does not speak TLS");
        return;
    }
    record = TLS_RECORD_HEADER_BYTES;
    if (c->first.size >= TLS_RECORD_HEADER_BYTES)
        record += (size_t)p[3] << 8 | p[4];
    if (record > CHANNEL_FIRST_MAX || c->first.size > CHANNEL_FIRST_MAX) {
        channel_end_now(c, STATUS_ERR_PROTOCOL, "it sent more than %d bytes before the TLS handshake",
                        CHANNEL_FIRST_MAX);
        return;
    }
    if (c->state == READY || c->first.size < record)
        return;
    c->state = READY;
    uv_timer_stop(&c->timer);
    if (c->gate)
        c->gate->on_ready(c, c->user);
    else
        channel_handshake(c);
}

void channel_handshake(struct channel *c)
{
    struct error err = {0};
    status s;

    if (c->state != READY)
        return;
    s = tls_new_server(&c->tls, c->key, &err);
    THEN(s, tls_feed(c->tls, c->first.data, c->first.size, &err));
    buffer_release(&c->first);
    if (s != STATUS_OK) {
        channel_end_now(c, s, "%s", err.text);
        return;
    }
    channel_limit(c, CHANNEL_HANDSHAKE_MS);
    channel_begin_handshake(c);
}

/* ---- arriving -------------------------------------------------------------------------- */

static int peer_address(const struct channel *c, struct sockaddr_storage *address)
{
    int size = sizeof *address;

    memset(address, 0, sizeof *address);
    return uv_tcp_getpeername(&c->tcp, (struct sockaddr *)address, &size) == 0;
}

static void name_peer(struct channel *c)
{
    struct sockaddr_storage address;

    if (peer_address(c, &address))
        address_print(&address, c->peer);
    else
        snprintf(c->peer, sizeof c->peer, "unknown:0");
}

void channel_address(const struct channel *c, uint8_t out[CHANNEL_ADDRESS_BYTES])
{
    struct sockaddr_storage address;

    memset(out, 0, CHANNEL_ADDRESS_BYTES);
    if (!peer_address(c, &address))
        return;
    if (address.ss_family == AF_INET6) {
        memcpy(out, &((const struct sockaddr_in6 *)&address)->sin6_addr, CHANNEL_ADDRESS_BYTES);
    } else if (address.ss_family == AF_INET) {
        out[10] = out[11] = 0xff; /* RFC 4291, section 2.5.5.2 */
        memcpy(out + 12, &((const struct sockaddr_in *)&address)->sin_addr, 4);
    }
}

static void on_rejected(uv_handle_t *handle) { mem_free(handle); }

void channel_reject(uv_stream_t *listener)
{
    uv_tcp_t *tcp = mem_alloc(sizeof *tcp);

    if (!tcp)
        return;
    uv_tcp_init(listener->loop, tcp);
    (void)!uv_accept(listener, (uv_stream_t *)tcp);
    uv_close((uv_handle_t *)tcp, on_rejected);
}

status channel_accept(struct channel **out, uv_stream_t *listener, const struct farm_key *key,
                      const struct channel_callbacks *callbacks, const struct channel_gate *gate, void *user,
                      struct error *err)
{
    struct channel *c = channel_new(listener->loop, callbacks, user);
    int result;

    *out = NULL;
    if (!c) {
        channel_reject(listener);
        return error_no_memory(err, "a connection");
    }
    c->is_server = 1;
    c->key = key;
    c->gate = gate;
    c->state = ARRIVED;
    channel_start_handles(c);
    snprintf(c->peer, sizeof c->peer, "unknown peer");
    *out = c;
    result = uv_accept(listener, (uv_stream_t *)&c->tcp);
    if (result < 0) {
        channel_end_now(c, STATUS_ERR_UNREACHABLE, "cannot accept: %s", uv_strerror(result));
        return STATUS_OK;
    }
    name_peer(c);
    channel_limit(c, CHANNEL_SILENT_MS);
    channel_read_start(c);
    return STATUS_OK;
}
