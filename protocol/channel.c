#include "protocol/channel_parts.h"

#include <signal.h>
#include <stdarg.h>
#include <stdio.h>

#include "common/system/clock.h"
#include "common/base/memory.h"
#include "protocol/message.h"

enum { READ_BYTES = 64 << 10 };

struct write_request {
    uv_write_t request;
    struct channel *channel;
    size_t size_bytes;
    char bytes[];
};

static _Thread_local size_t turn_bytes; /* that a channel reads in a turn; 0: no limit */
static _Thread_local uint64_t turn_number;

static uint32_t fault_limit_ms; /* 0: the limits are unchanged */

static void close_gently(struct channel *c);
static void go_on(struct channel *c);
static void process_input(struct channel *c);

/* ---- the end --------------------------------------------------------------------------- */

void channel_free(struct channel *c)
{
    if (c->addresses)
        uv_freeaddrinfo(c->addresses);
    tls_free(c->tls);
    buffer_release(&c->first);
    framing_reader_release(&c->frames);
    buffer_release(&c->outgoing);
    mem_free(c);
}

void channel_hold_drop(struct channel *c)
{
    if (--c->holds > 0)
        return;
    c->callbacks.on_close(c, &c->why, c->user);
    channel_free(c);
}

static void on_handle_closed(uv_handle_t *handle) { channel_hold_drop(handle->data); }

/* Release everything at once; on_close follows when libuv has released it, too. */
static void finish(struct channel *c)
{
    if (c->state == DEAD)
        return;
    c->state = DEAD;
    uv_close((uv_handle_t *)&c->timer, on_handle_closed);
    if (!uv_is_closing((uv_handle_t *)&c->tcp))
        uv_close((uv_handle_t *)&c->tcp, on_handle_closed);
    uv_cancel((uv_req_t *)&c->resolve); /* refused if it is not waiting, which is fine */
}

/* Remember the reason, with the peer's name; the first reason is kept. */
__attribute__((format(printf, 3, 0))) static void set_why(struct channel *c, status code, const char *format,
                                                          va_list args)
{
    char text[sizeof c->why.text];

    if (c->why.code != STATUS_OK)
        return;
    vsnprintf(text, sizeof text, format, args);
    (void)error_set(&c->why, code, "%s: %s", c->peer, text);
}

void channel_end_now(struct channel *c, status code, const char *format, ...)
{
    va_list args;

    va_start(args, format);
    set_why(c, code, format, args);
    va_end(args);
    finish(c);
}

/* End, but first send the peer what is queued and the reason: the TLS alert of a failed handshake, or a Failure. */
__attribute__((format(printf, 3, 4))) static void end_telling(struct channel *c, status code, const char *format, ...)
{
    va_list args;

    va_start(args, format);
    set_why(c, code, format, args);
    va_end(args);
    if (c->state == OPEN && message_send_failure(c, 0, &c->why) != STATUS_OK)
        finish(c);
    close_gently(c);
}

static void lost(struct channel *c, int uv_error)
{
    if (c->state == CLOSING)
        finish(c);
    else if (c->state < OPEN && uv_error == UV_EOF)
        channel_end_now(c, STATUS_ERR_UNREACHABLE, "closed the connection %s the TLS handshake",
                        c->state == HANDSHAKE ? "during" : "before");
    else if (uv_error == UV_EOF)
        channel_end_now(c, STATUS_ERR_UNREACHABLE, "the connection was lost%s (it ended without a goodbye)",
                        framing_reader_waiting(&c->frames) ? " in the middle of a message" : "");
    else
        channel_end_now(c, STATUS_ERR_UNREACHABLE, "the connection was lost%s: %s",
                        framing_reader_waiting(&c->frames) ? " in the middle of a message" : "", uv_strerror(uv_error));
}

static void begin_limit(struct channel *c);

/* The loop was held up (the process was stopped, or its machine): what the peer sent may lie unread. */
static int fires_late(const struct channel *c) { return uv_now(c->timer.loop) > c->limit_end_ms + c->limit_ms / 4; }

static void on_timer(uv_timer_t *timer)
{
    struct channel *c = timer->data;

    switch (c->state) {
    case ARRIVED:
    case HANDSHAKE:
        if (c->is_server && fires_late(c)) {
            begin_limit(c);
            break;
        }
        channel_end_now(c, c->is_server ? STATUS_ERR_TIMEOUT : STATUS_ERR_UNREACHABLE, "no TLS handshake within %.1f s",
                        c->limit_ms / 1000.0);
        break;
    case CLOSING:
        if (!c->shutdown_done)
            channel_end_now(c, STATUS_ERR_UNREACHABLE, "%zu bytes were not read by the time of closing",
                            c->queued_bytes);
        else
            finish(c);
        break;
    case OPEN: go_on(c); break;
    case CONNECTING: /* has its own: on_attempt_timeout */
    case READY:
    case DEAD: break;
    }
}

uint32_t channel_limit_ms(uint32_t limit_ms) { return fault_limit_ms ? fault_limit_ms : limit_ms; }

static void begin_limit(struct channel *c)
{
    c->limit_end_ms = uv_now(c->timer.loop) + c->limit_ms;
    uv_timer_start(&c->timer, on_timer, c->limit_ms, 0);
}

void channel_limit(struct channel *c, uint32_t limit_ms)
{
    c->limit_ms = channel_limit_ms(limit_ms);
    begin_limit(c);
}

/* ---- writing --------------------------------------------------------------------------- */

static void on_written(uv_write_t *request, int result)
{
    struct write_request *w = (struct write_request *)request;
    struct channel *c = w->channel;

    c->queued_bytes -= w->size_bytes;
    mem_free(w);
    if (c->state == DEAD)
        return;
    if (result < 0) {
        lost(c, result);
        return;
    }
    if (c->state == CLOSING && !c->shutdown_done)
        uv_timer_start(&c->timer, on_timer, CHANNEL_FLUSH_MS, 0);
    if (c->state == OPEN && c->was_high && c->queued_bytes <= c->queue_high / (CHANNEL_QUEUE_HIGH / CHANNEL_QUEUE_LOW)) {
        c->was_high = 0;
        if (c->callbacks.on_drain)
            c->callbacks.on_drain(c, c->user);
    }
}

/* Give TLS what is packed, and libuv all the output of TLS, in one write. */
static status flush_output(struct channel *c)
{
    struct error err = {0};
    struct write_request *w;
    uv_buf_t bytes;
    status s;
    size_t size;

    if (c->state == OPEN && c->outgoing.size > 0) {
        s = tls_write(c->tls, c->outgoing.data, c->outgoing.size, &err);
        buffer_clear(&c->outgoing);
        if (s != STATUS_OK) {
            channel_end_now(c, s, "%s", err.text);
            return s;
        }
    }
    size = tls_output_bytes(c->tls);
    if (size == 0 || c->state == DEAD || c->state < HANDSHAKE)
        return STATUS_OK;
    w = mem_alloc(sizeof *w + size);
    if (!w) {
        channel_end_now(c, STATUS_ERR_NO_MEMORY, "out of memory for %zu bytes to send", size);
        return STATUS_ERR_NO_MEMORY;
    }
    w->channel = c;
    w->size_bytes = tls_output_take(c->tls, w->bytes, size);
    bytes = uv_buf_init(w->bytes, (unsigned)w->size_bytes);
    c->queued_bytes += w->size_bytes;
    if (channel_is_full(c))
        c->was_high = 1;
    int result = uv_write(&w->request, (uv_stream_t *)&c->tcp, &bytes, 1, on_written);
    if (result < 0) {
        c->queued_bytes -= w->size_bytes;
        mem_free(w);
        channel_end_now(c, STATUS_ERR_UNREACHABLE, "cannot send: %s", uv_strerror(result));
        return STATUS_ERR_IO;
    }
    return STATUS_OK;
}

status channel_send(struct channel *c, const Azulejo__Wire__Envelope *message)
{
    size_t size;
    uint8_t *space;
    status s;

    if (c->state != OPEN)
        return STATUS_ERR_IO;
    size = azulejo__wire__envelope__get_packed_size(message);
    if (size == 0 || size > CHANNEL_FRAME_MAX)
        return STATUS_ERR_LIMIT;
    space = buffer_append_space(&c->outgoing, FRAME_HEADER_BYTES + size);
    if (!space)
        return STATUS_ERR_NO_MEMORY;
    framing_header_write(space, (uint32_t)size);
    azulejo__wire__envelope__pack(message, space + FRAME_HEADER_BYTES);
    c->last_sent_ns = clock_monotonic_ns();
    if (c->is_corked && c->outgoing.size < CHANNEL_CORK_BYTES)
        return STATUS_OK;
    s = flush_output(c);
    if (s == STATUS_OK && c->queued_bytes > CHANNEL_QUEUE_MAX) {
        channel_end_now(c, STATUS_ERR_LIMIT, "it does not read: %zu bytes wait to be sent (limit %d)", c->queued_bytes,
                        CHANNEL_QUEUE_MAX);
        return STATUS_ERR_LIMIT;
    }
    return s;
}

void channel_cork(struct channel *c) { c->is_corked = 1; }

void channel_uncork(struct channel *c)
{
    c->is_corked = 0;
    (void)!flush_output(c); /* if it fails the channel ends */
}

/* ---- reading --------------------------------------------------------------------------- */

void channel_turn_begin(size_t bytes_each)
{
    turn_bytes = bytes_each;
    turn_number++;
}

/* How much the channel may read now. */
static size_t turn_allowance(struct channel *c)
{
    if (turn_bytes == 0)
        return READ_BYTES;
    if (c->turn != turn_number) {
        c->turn = turn_number;
        c->turn_bytes = turn_bytes;
    }
    return c->turn_bytes < READ_BYTES ? c->turn_bytes : READ_BYTES;
}

/* One buffer for all channels of a thread: libuv fills it and calls on_read at once, and on_read
 * passes the bytes on before it calls anything that could read again. */
static void on_allocate(uv_handle_t *handle, size_t suggested UNUSED, uv_buf_t *out)
{
    static _Thread_local char bytes[READ_BYTES];

    /* If it is 0, on_read gets UV_ENOBUFS, and libuv polls the socket again. */
    *out = uv_buf_init(bytes, (unsigned)turn_allowance(handle->data));
}

static void on_read(uv_stream_t *stream, ssize_t got, const uv_buf_t *buffer)
{
    struct channel *c = stream->data;
    struct error err = {0};

    if (got == 0 || got == UV_ENOBUFS || c->state == DEAD)
        return;
    if (got < 0) {
        c->peer_ended = 1;
        if (c->state == CLOSING && got == UV_EOF && !c->shutdown_done)
            uv_read_stop(stream); /* it no longer listens, but our last bytes may be under way */
        else
            lost(c, (int)got);
        return;
    }
    c->last_heard_ns = clock_monotonic_ns();
    c->turn_bytes -= turn_bytes == 0 || (size_t)got > c->turn_bytes ? c->turn_bytes : (size_t)got;
    if (c->state == CLOSING)
        return;
    if (c->state < HANDSHAKE) {
        channel_take_first(c, buffer->base, (size_t)got);
        return;
    }
    if (tls_feed(c->tls, buffer->base, (size_t)got, &err) != STATUS_OK) {
        channel_end_now(c, err.code, "%s", err.text);
        return;
    }
    process_input(c);
}

static int handshake_step(struct channel *c)
{
    struct error err = {0};
    status s = tls_step(c->tls, &err);

    if (s != STATUS_OK) {
        end_telling(c, s, "%s", err.text);
        return 0;
    }
    if (flush_output(c) != STATUS_OK || tls_state_of(c->tls) != TLS_OPEN)
        return 0;
    uv_timer_stop(&c->timer);
    c->identity = tls_identity(c->tls);
    c->state = OPEN;
    if (c->callbacks.on_open)
        c->callbacks.on_open(c, c->user);
    return c->state == OPEN;
}

/* Deliver the complete frames. 0: the channel left OPEN, or pauses. */
static int deliver(struct channel *c)
{
    while (c->state == OPEN && !c->is_paused) {
        Azulejo__Wire__Envelope *message;
        struct error err = {0};
        const uint8_t *payload;
        size_t size;
        status s = framing_reader_next(&c->frames, &payload, &size, &err);
        if (s == STATUS_OK && !payload)
            return 1;
        THEN(s, message_unpack(&message, payload, size, &err));
        if (s != STATUS_OK) {
            end_telling(c, s, "%s", err.text);
            return 0;
        }
        c->callbacks.on_message(c, message, c->user);
        message_free(message);
    }
    return 0;
}

/* The peer sent its close_notify; it no longer reads what we would send. */
static void peer_said_goodbye(struct channel *c)
{
    if (framing_reader_waiting(&c->frames)) {
        channel_end_now(c, STATUS_ERR_PROTOCOL, "ended the conversation in the middle of a message");
        return;
    }
    tls_end(c->tls);
    if (flush_output(c) == STATUS_OK)
        finish(c);
}

static void process_input(struct channel *c)
{
    if (c->state == HANDSHAKE && !handshake_step(c))
        return;
    while (deliver(c)) {
        uint8_t plain[16384]; /* the maximum in one TLS record */
        struct error err = {0};
        size_t got;
        status s = tls_read(c->tls, plain, sizeof plain, &got, &err);
        if (s == STATUS_OK && got > 0)
            s = framing_reader_push(&c->frames, plain, got, &err);
        if (s != STATUS_OK) {
            end_telling(c, s, "%s", err.text);
            return;
        }
        if (got == 0) {
            if (tls_state_of(c->tls) == TLS_ENDED)
                peer_said_goodbye(c);
            else
                (void)!flush_output(c); /* TLS may have answered a key update */
            return;
        }
    }
}

/* ---- beginning ------------------------------------------------------------------------- */

static void ignore_sigpipe(void)
{
    struct sigaction now;

    /* A write to a peer that is gone must be an error, not end the process. */
    if (sigaction(SIGPIPE, NULL, &now) == 0 && !(now.sa_flags & SA_SIGINFO) &&
        now.sa_handler == SIG_DFL) {
        now.sa_handler = SIG_IGN;
        sigaction(SIGPIPE, &now, NULL);
    }
}

struct channel *channel_new(uv_loop_t *loop, const struct channel_callbacks *callbacks, void *user)
{
    struct channel *c = mem_calloc(1, sizeof *c);

    if (!c)
        return NULL;
    ignore_sigpipe();
    c->loop = loop;
    c->callbacks = *callbacks;
    c->user = user;
    c->queue_high = CHANNEL_QUEUE_HIGH;
    c->last_heard_ns = c->last_sent_ns = clock_monotonic_ns();
    framing_reader_init(&c->frames, CHANNEL_FRAME_MAX);
    return c;
}

void channel_start_handles(struct channel *c)
{
    uv_timer_init(c->loop, &c->timer);
    uv_tcp_init(c->loop, &c->tcp);
    c->timer.data = c->tcp.data = c;
    c->holds = 2;
}

void channel_read_start(struct channel *c)
{
    int result;

    uv_tcp_nodelay(&c->tcp, 1);
    result = uv_read_start((uv_stream_t *)&c->tcp, on_allocate, on_read);
    if (result < 0)
        channel_end_now(c, STATUS_ERR_UNREACHABLE, "cannot read: %s", uv_strerror(result));
}

void channel_begin_handshake(struct channel *c)
{
    c->state = HANDSHAKE;
    process_input(c);
}

/* ---- closing --------------------------------------------------------------------------- */

static void on_shutdown(uv_shutdown_t *request, int result)
{
    struct channel *c = request->data;

    if (c->state == DEAD)
        return;
    c->shutdown_done = 1;
    if (result < 0 || c->peer_ended)
        finish(c);
    else
        uv_timer_start(&c->timer, on_timer, CHANNEL_LINGER_MS, 0);
}

static void close_gently(struct channel *c)
{
    int result, was_open;

    if (c->state == CLOSING || c->state == DEAD)
        return;
    if (c->state < HANDSHAKE) {
        finish(c);
        return;
    }
    if (flush_output(c) != STATUS_OK)
        return;
    tls_end(c->tls);
    if (flush_output(c) != STATUS_OK)
        return;
    was_open = c->state == OPEN;
    c->state = CLOSING;
    if (!was_open && c->gate)
        c->gate->on_refused(c, c->user);
    if (c->state == DEAD)
        return;
    c->shutdown.data = c;
    result = uv_shutdown(&c->shutdown, (uv_stream_t *)&c->tcp, on_shutdown);
    if (result < 0) {
        finish(c);
        return;
    }
    uv_timer_start(&c->timer, on_timer, CHANNEL_FLUSH_MS, 0);
    uv_read_start((uv_stream_t *)&c->tcp, on_allocate, on_read);
}

void channel_close(struct channel *c) { close_gently(c); }

void channel_abort(struct channel *c, status code, const char *format, ...)
{
    va_list args;

    va_start(args, format);
    set_why(c, code, format, args);
    va_end(args);
    finish(c);
}

/* ---- queries by the owner --------------------------------------------------------------- */

/* What waited while it was paused comes before what is read from now on. */
static void go_on(struct channel *c)
{
    process_input(c);
    if (c->state == OPEN && !c->is_paused)
        (void)uv_read_start((uv_stream_t *)&c->tcp, on_allocate, on_read);
}

void channel_pause(struct channel *c, int paused)
{
    if (c->state != OPEN || c->is_paused == paused)
        return;
    c->is_paused = paused;
    c->last_heard_ns = clock_monotonic_ns();
    if (paused) {
        uv_timer_stop(&c->timer);
        (void)uv_read_stop((uv_stream_t *)&c->tcp);
        return;
    }
    uv_timer_start(&c->timer, on_timer, 0, 0); /* go_on, not in this call */
}

int channel_is_full(const struct channel *c) { return c->queued_bytes >= c->queue_high; }

int channel_is_overfull(const struct channel *c) { return c->queued_bytes / 2 >= c->queue_high; }

void channel_set_high(struct channel *c, size_t bytes) { c->queue_high = bytes; }

size_t channel_queued_bytes(const struct channel *c) { return c->queued_bytes; }

enum farm_role channel_role(const struct channel *c) { return c->identity.role; }

const struct key_identity *channel_identity(const struct channel *c) { return &c->identity; }

const char *channel_peer(const struct channel *c) { return c->peer; }

uint64_t channel_last_heard_ns(const struct channel *c)
{
    return c->is_paused ? clock_monotonic_ns() : c->last_heard_ns;
}

uint64_t channel_last_sent_ns(const struct channel *c) { return c->last_sent_ns; }

void channel_adopt(struct channel *c, const struct channel_callbacks *callbacks, void *user)
{
    c->callbacks = *callbacks;
    c->user = user;
}

void channel_fault_handshake_ms(uint32_t limit_ms) { fault_limit_ms = limit_ms; }
