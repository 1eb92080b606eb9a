/* WebSockets: whole messages in, whole messages out in frames of at most HTTP_PIECE_MAX. */
#include <stdio.h>
#include <string.h>

#include "common/system/clock.h"
#include "common/base/memory.h"
#include "web/http/http_parts.h"

int http_socket_open(struct http_connection *c)
{
    struct web_socket *socket = mem_calloc(1, sizeof *socket);

    if (!socket || !c->route)
        return mem_free(socket), -1;
    *socket = (struct web_socket){.web = c->http->web, .caller = c->caller, .peer = c->peer, .connection = c};
    c->socket = socket;
    c->state = HTTP_SOCKET;
    c->heard_ns = clock_monotonic_ns();
    http_deadline(c, 0);
    c->route->open(socket);
    return c->is_dead ? -1 : 0;
}

void http_socket_heard(struct http_connection *c) { c->heard_ns = clock_monotonic_ns(); }

void http_socket_tick(struct http_connection *c, uint64_t now_ns)
{
    if (now_ns < c->heard_ns + HTTP_PING_MS * NS_PER_MS || c->is_dead)
        return;
    if (now_ns >= c->heard_ns + HTTP_SILENCE_MS * NS_PER_MS) {
        http_kill(c);
    } else if (now_ns >= c->pinged_ns + HTTP_PING_MS * NS_PER_MS) {
        c->pinged_ns = now_ns;
        c->ping_wanted = 1;
        lws_callback_on_writable(c->wsi);
    }
}

void http_socket_gone(struct http_connection *c)
{
    struct web_socket *socket = c->socket;

    if (!socket)
        return;
    if (socket->on_gone)
        socket->on_gone(socket);
    c->socket = NULL;
    mem_free(socket);
}

static int refuse(struct http_connection *c, enum lws_close_status code, const char *reason)
{
    lws_close_reason(c->wsi, code, (unsigned char *)reason, strlen(reason));
    return -1;
}

int http_socket_receive(struct http_connection *c, const void *data, size_t size)
{
    struct buffer *message = &c->message;

    if (!c->socket || c->is_dead)
        return -1;
    http_socket_heard(c);
    if (c->close_code)
        return 0; /* it is called soon */
    if (lws_frame_is_binary(c->wsi))
        return refuse(c, LWS_CLOSE_STATUS_UNACCEPTABLE_OPCODE, "only text is understood here");
    if (message->size + size > HTTP_MESSAGE_MAX)
        return refuse(c, LWS_CLOSE_STATUS_MESSAGE_TOO_LARGE, "the message is too long");
    buffer_append(message, data, size);
    if (!buffer_ok(message))
        return -1;
    if (lws_remaining_packet_payload(c->wsi) > 0 || !lws_is_final_fragment(c->wsi))
        return 0;
    if (c->socket->on_text)
        c->socket->on_text(c->socket, buffer_text(message), message->size);
    buffer_clear(message);
    return c->is_dead ? -1 : 0;
}

/* With a byte in it: the library says nothing of an answer without one. */
static int write_ping(struct lws *wsi)
{
    uint8_t ping[LWS_PRE + 1] = {0};

    return lws_write(wsi, ping + LWS_PRE, 1, LWS_WRITE_PING);
}

int http_socket_writable(struct http_connection *c)
{
    struct http_queue *out = &c->out;
    enum http_piece_kind kind;
    int is_start, is_end;
    size_t size;
    uint8_t *data;

    if (!c->socket || c->is_dead || out->failed)
        return -1;
    if (c->ping_wanted && (!out->first || out->first->taken == 0)) {
        c->ping_wanted = 0;
        if (write_ping(c->wsi) < 0)
            return -1;
    }
    data = http_queue_next(out, HTTP_PIECE_MAX, &size, &kind, &is_start, &is_end);
    if (data) {
        enum lws_write_protocol type = kind == HTTP_PIECE_TEXT ? LWS_WRITE_TEXT : LWS_WRITE_BINARY;
        if (lws_write(c->wsi, data, size, lws_write_ws_flags(type, is_start, is_end)) < 0)
            return -1;
        http_queue_taken(out, size);
        http_deadline(c, out->bytes > 0 ? HTTP_STALL_MS : 0);
    }
    if (c->close_code && out->bytes == 0)
        return refuse(c, c->close_code, c->close_reason);
    if (c->socket->on_writable && !c->close_code && out->bytes < WEB_QUEUE_HIGH / 2)
        c->socket->on_writable(c->socket);
    if (out->bytes > 0)
        lws_callback_on_writable(c->wsi);
    return c->is_dead || out->failed ? -1 : 0;
}

void web_socket_send(struct web_socket *socket, int binary, const void *data, size_t size)
{
    struct http_connection *c = socket->connection;

    if (c->is_dead || c->close_code)
        return;
    if (c->out.bytes == 0)
        http_deadline(c, HTTP_STALL_MS);
    http_queue_add(&c->out, binary ? HTTP_PIECE_BINARY : HTTP_PIECE_TEXT, data, size);
    lws_callback_on_writable(c->wsi);
}

size_t web_socket_queued(const struct web_socket *socket)
{
    return ((const struct http_connection *)socket->connection)->out.bytes;
}

void web_socket_close(struct web_socket *socket, unsigned code, const char *reason)
{
    struct http_connection *c = socket->connection;

    if (c->close_code)
        return;
    c->close_code = code;
    snprintf(c->close_reason, sizeof c->close_reason, "%s", reason);
    http_deadline(c, HTTP_STALL_MS);
    lws_callback_on_writable(c->wsi);
}
