/* The channel over real loopback sockets, with peers that behave and peers that do not. */
#include <arpa/inet.h>
#include <netinet/in.h>
#include <pthread.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cmocka.h>

#include "common/base/memory.h"
#include "protocol/channel.h"
#include "protocol/framing.h"
#include "protocol/message.h"
#include "protocol/tls.h"

enum { WATCHDOG_MS = 60000 };

struct side {
    struct channel *channel;
    int opened, closed;
    unsigned messages, drains;
    enum farm_role role;
    struct error why;
};

/* One listener, one server side, perhaps one client side; tests set the hooks. */
struct farm {
    uv_loop_t loop;
    uv_tcp_t listener;
    uv_timer_t watchdog;
    uint16_t port;
    struct farm_key key, client_key;
    enum farm_role role;
    struct side server, client;
    int closes_expected;
    int accepting;
    const struct channel_gate *gate;
    uv_idle_cb turn; /* started when the gate is ready; NULL: its turn never comes */
    unsigned ready, refused;
    void (*on_open)(struct farm *f, struct side *s);
    void (*on_message)(struct farm *f, struct side *s, const Azulejo__Wire__Envelope *m);
    void (*on_drain)(struct farm *f, struct side *s);
    /* for the tests */
    unsigned sent, received;
    size_t most_queued;
    uv_idle_t idle;
    unsigned idle_turns, received_before;
};

static struct farm *farm_of(struct channel *c, void *user, struct side **side)
{
    struct farm *f = user;

    *side = c == f->client.channel ? &f->client : &f->server;
    return f;
}

static void cb_open(struct channel *c, void *user)
{
    struct side *s;
    struct farm *f = farm_of(c, user, &s);

    s->opened++;
    s->role = channel_role(c);
    if (f->on_open)
        f->on_open(f, s);
}

static void cb_message(struct channel *c, const Azulejo__Wire__Envelope *m, void *user)
{
    struct side *s;
    struct farm *f = farm_of(c, user, &s);

    assert_int_equal(s->closed, 0);
    s->messages++;
    if (f->on_message)
        f->on_message(f, s, m);
}

static void cb_drain(struct channel *c, void *user)
{
    struct side *s;
    struct farm *f = farm_of(c, user, &s);

    s->drains++;
    assert_true(channel_queued_bytes(c) <= CHANNEL_QUEUE_LOW);
    if (f->on_drain)
        f->on_drain(f, s);
}

static void farm_stop(struct farm *f)
{
    if (!uv_is_closing((uv_handle_t *)&f->listener))
        uv_close((uv_handle_t *)&f->listener, NULL);
    if (!uv_is_closing((uv_handle_t *)&f->watchdog))
        uv_close((uv_handle_t *)&f->watchdog, NULL);
    if (!uv_is_closing((uv_handle_t *)&f->idle))
        uv_close((uv_handle_t *)&f->idle, NULL);
}

static void cb_close(struct channel *c, const struct error *why, void *user)
{
    struct side *s;
    struct farm *f = farm_of(c, user, &s);

    s->closed++;
    s->why = *why;
    if (f->server.closed + f->client.closed == f->closes_expected)
        farm_stop(f);
}

static const struct channel_callbacks callbacks = {cb_open, cb_message, cb_drain, cb_close};

static void on_connection(uv_stream_t *listener, int result)
{
    struct farm *f = listener->data;
    struct error err = {0};

    assert_int_equal(result, 0);
    f->accepting = channel_accept(&f->server.channel, listener, &f->key, &callbacks, f->gate, f, &err);
    if (f->accepting != STATUS_OK && f->closes_expected == 2)
        f->closes_expected = 1;
}

static void on_watchdog(uv_timer_t *timer)
{
    (void)timer;
    fail_msg("the test hangs");
}

static void farm_begin(struct farm *f)
{
    struct sockaddr_in address;
    int size = sizeof address;

    memset(f, 0, sizeof *f);
    assert_int_equal(farm_key_generate(&f->key, NULL), STATUS_OK);
    f->client_key = f->key;
    f->role = FARM_ROLE_WORKER;
    f->closes_expected = 2;
    assert_int_equal(uv_loop_init(&f->loop), 0);
    uv_timer_init(&f->loop, &f->watchdog);
    uv_timer_start(&f->watchdog, on_watchdog, WATCHDOG_MS, 0);
    uv_idle_init(&f->loop, &f->idle);
    uv_tcp_init(&f->loop, &f->listener);
    f->idle.data = f->listener.data = f;
    uv_ip4_addr("127.0.0.1", 0, &address);
    assert_int_equal(uv_tcp_bind(&f->listener, (struct sockaddr *)&address, 0), 0);
    assert_int_equal(uv_listen((uv_stream_t *)&f->listener, 16, on_connection), 0);
    uv_tcp_getsockname(&f->listener, (struct sockaddr *)&address, &size);
    f->port = ntohs(address.sin_port);
}

static void farm_connect(struct farm *f)
{
    assert_int_equal(channel_connect(&f->client.channel, &f->loop, "127.0.0.1", f->port, &f->client_key, f->role,
                                     &callbacks, f, NULL),
                     STATUS_OK);
}

static void farm_run(struct farm *f)
{
    uv_run(&f->loop, UV_RUN_DEFAULT);
    assert_int_equal(uv_loop_close(&f->loop), 0);
    assert_true(f->server.closed <= 1 && f->client.closed <= 1);
}

static void send_heartbeat(struct side *s) { assert_int_equal(message_send_heartbeat(s->channel), STATUS_OK); }

/* ---- good peers ------------------------------------------------------------------------ */

static void exchange_open(struct farm *f, struct side *s)
{
    Azulejo__Wire__Hello hello = AZULEJO__WIRE__HELLO__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(HELLO, hello, &hello);

    if (s != &f->client)
        return;
    hello.host = (char *)"here";
    e.request = 77;
    assert_int_equal(channel_send(s->channel, &e), STATUS_OK);
    assert_true(channel_last_sent_ns(s->channel) > 0);
}

static void exchange_message(struct farm *f, struct side *s, const Azulejo__Wire__Envelope *m)
{
    if (s == &f->server) {
        assert_int_equal(m->body_case, AZULEJO__WIRE__ENVELOPE__BODY_HELLO);
        assert_string_equal(m->hello->host, "here");
        assert_int_equal(m->request, 77);
        send_heartbeat(s);
    } else {
        assert_int_equal(m->body_case, AZULEJO__WIRE__ENVELOPE__BODY_HEARTBEAT);
        channel_close(s->channel);
        channel_close(s->channel);
        assert_int_equal(message_send_heartbeat(s->channel), STATUS_ERR_IO);
    }
}

static void test_exchange_in_every_role(void **state)
{
    (void)state;
    for (int role = FARM_ROLE_WORKER; role < FARM_ROLE_COUNT; role++) {
        for (int derived = 0; derived < 2; derived++) {
            struct farm f;
            farm_begin(&f);
            f.role = role;
            if (derived)
                assert_int_equal(farm_key_derive(&f.key, role, &f.client_key, NULL), STATUS_OK);
            f.on_open = exchange_open;
            f.on_message = exchange_message;
            farm_connect(&f);
            assert_int_equal(message_send_heartbeat(f.client.channel), STATUS_ERR_IO);
            farm_run(&f);
            assert_int_equal(f.server.opened, 1);
            assert_int_equal(f.client.opened, 1);
            assert_int_equal(f.server.role, role);
            assert_int_equal(f.client.role, role);
            assert_int_equal(f.server.messages, 1);
            assert_int_equal(f.client.messages, 1);
            assert_int_equal(f.server.why.code, STATUS_OK);
            assert_int_equal(f.client.why.code, STATUS_OK);
        }
    }
}

/* The listener is on 127.0.0.1 only; "localhost" may name ::1 first. */
static void test_host_with_several_addresses(void **state)
{
    struct farm f;

    (void)state;
    farm_begin(&f);
    f.on_open = exchange_open;
    f.on_message = exchange_message;
    assert_int_equal(channel_connect(&f.client.channel, &f.loop, "localhost", f.port, &f.key, f.role, &callbacks, &f,
                                     NULL),
                     STATUS_OK);
    farm_run(&f);
    assert_int_equal(f.client.messages, 1);
    assert_int_equal(f.client.why.code, STATUS_OK);
}

static status send_piece(struct channel *c, uint64_t number, const uint8_t *bytes, size_t size)
{
    Azulejo__Wire__BlobData data = AZULEJO__WIRE__BLOB_DATA__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(BLOB_DATA, blob_data, &data);

    data.offset = number;
    data.data.data = (uint8_t *)bytes;
    data.data.len = size;
    return channel_send(c, &e);
}

enum { FLOOD_PIECE = 64 << 10, FLOOD_COUNT = (64 << 20) / FLOOD_PIECE };

static void flood(struct farm *f, struct side *s)
{
    static uint8_t bytes[FLOOD_PIECE];

    if (s != &f->client)
        return;
    while (f->sent < FLOOD_COUNT && channel_queued_bytes(s->channel) < CHANNEL_QUEUE_HIGH) {
        memset(bytes, (int)(f->sent % 251), sizeof bytes);
        assert_int_equal(send_piece(s->channel, f->sent, bytes, sizeof bytes), STATUS_OK);
        f->sent++;
        if (channel_queued_bytes(s->channel) > f->most_queued)
            f->most_queued = channel_queued_bytes(s->channel);
    }
    if (f->sent == FLOOD_COUNT)
        channel_close(s->channel);
}

static void flood_message(struct farm *f, struct side *s, const Azulejo__Wire__Envelope *m)
{
    assert_ptr_equal(s, &f->server);
    assert_int_equal(m->body_case, AZULEJO__WIRE__ENVELOPE__BODY_BLOB_DATA);
    assert_int_equal(m->blob_data->offset, f->received);
    assert_int_equal(m->blob_data->data.len, FLOOD_PIECE);
    assert_int_equal(m->blob_data->data.data[0], f->received % 251);
    assert_int_equal(m->blob_data->data.data[FLOOD_PIECE - 1], f->received % 251);
    f->received++;
}

static void test_flood(void **state)
{
    struct farm f;

    (void)state;
    farm_begin(&f);
    f.on_open = flood;
    f.on_drain = flood;
    f.on_message = flood_message;
    farm_connect(&f);
    farm_run(&f);
    assert_int_equal(f.received, FLOOD_COUNT);
    assert_true(f.client.drains > 0);
    assert_true(f.most_queued >= CHANNEL_QUEUE_HIGH);
    assert_true(f.most_queued < CHANNEL_QUEUE_HIGH + 2 * FLOOD_PIECE);
    assert_int_equal(f.server.why.code, STATUS_OK);
    assert_int_equal(f.client.why.code, STATUS_OK);
}

/* Corked: 64 messages, then, uncorked or not, the end. */
static void corked_open(struct farm *f, struct side *s)
{
    static uint8_t bytes[FLOOD_PIECE];

    if (s != &f->client)
        return;
    channel_cork(s->channel);
    for (; f->sent < 64; f->sent++) {
        size_t before = channel_queued_bytes(s->channel);
        memset(bytes, (int)(f->sent % 251), sizeof bytes);
        assert_int_equal(send_piece(s->channel, f->sent, bytes, sizeof bytes), STATUS_OK);
        /* Some at a time: what is not sent yet stays small. */
        if (f->sent % 4 != 3)
            assert_int_equal(channel_queued_bytes(s->channel), before);
        else
            assert_true(channel_queued_bytes(s->channel) >= before);
    }
    if (f->idle_turns)
        channel_uncork(s->channel);
    send_heartbeat(s);
    channel_close(s->channel);
}

static void corked_message(struct farm *f, struct side *s, const Azulejo__Wire__Envelope *m)
{
    if (m->body_case == AZULEJO__WIRE__ENVELOPE__BODY_BLOB_DATA)
        flood_message(f, s, m);
    else
        assert_int_equal(f->received, 64);
}

/* What is corked arrives whole and in order, before what is sent later and before the end. */
static void test_corked(void **state)
{
    (void)state;
    for (unsigned uncorked = 0; uncorked < 2; uncorked++) {
        struct farm f;
        farm_begin(&f);
        f.idle_turns = uncorked;
        f.on_open = corked_open;
        f.on_message = corked_message;
        farm_connect(&f);
        farm_run(&f);
        assert_int_equal(f.received, 64);
        assert_int_equal(f.server.messages, 65);
        assert_int_equal(f.server.why.code, STATUS_OK);
        assert_int_equal(f.client.why.code, STATUS_OK);
    }
}

static void short_turn(uv_idle_t *idle)
{
    struct farm *f = idle->data;

    assert_true(f->received - f->received_before <= 2); /* the bytes of one may complete two */
    f->received_before = f->received;
    f->idle_turns++;
    channel_turn_begin(FLOOD_PIECE);
}

/* The loop comes to its other work however much arrives, and nothing is lost. */
static void test_turns_end(void **state)
{
    struct farm f;

    (void)state;
    farm_begin(&f);
    f.on_open = flood;
    f.on_drain = flood;
    f.on_message = flood_message;
    uv_idle_start(&f.idle, short_turn);
    farm_connect(&f);
    farm_run(&f);
    channel_turn_begin(0);
    assert_int_equal(f.received, FLOOD_COUNT);
    assert_true(f.idle_turns >= FLOOD_COUNT / 2);
    assert_int_equal(f.server.why.code, STATUS_OK);
}

enum { PAUSES = 500 };

static void say_much_at_once(struct farm *f, struct side *s)
{
    if (s != &f->client)
        return;
    channel_cork(s->channel);
    for (f->sent = 0; f->sent < PAUSES; f->sent++)
        send_heartbeat(s);
    channel_uncork(s->channel);
    channel_close(s->channel);
}

static void hear_one(struct farm *f, struct side *s, const Azulejo__Wire__Envelope *m)
{
    assert_int_equal(m->body_case, AZULEJO__WIRE__ENVELOPE__BODY_HEARTBEAT);
    assert_int_equal(f->idle_turns, 0);
    f->received++;
    f->idle_turns = 2;
    channel_pause(s->channel, 1);
}

static void hear_on(uv_idle_t *idle)
{
    struct farm *f = idle->data;

    if (f->idle_turns == 0 || --f->idle_turns > 0)
        return;
    channel_pause(f->server.channel, 0);
    assert_int_equal(f->idle_turns, 0); /* nothing in that call */
}

/* A paused channel delivers nothing, not even what came with the message at which it was paused; then all, and the end. */
static void test_pause(void **state)
{
    struct farm f;

    (void)state;
    farm_begin(&f);
    f.on_open = say_much_at_once;
    f.on_message = hear_one;
    uv_idle_start(&f.idle, hear_on);
    farm_connect(&f);
    farm_run(&f);
    assert_int_equal(f.received, PAUSES);
    assert_int_equal(f.server.why.code, STATUS_OK);
    assert_int_equal(f.client.why.code, STATUS_OK);
}

/* Both ends talk at once; the client says 4 MiB and closes in the same breath. */
static void flush_open(struct farm *f, struct side *s)
{
    static uint8_t bytes[FLOOD_PIECE];

    for (int i = 0; i < 64; i++)
        assert_int_equal(send_piece(s->channel, (uint64_t)i, bytes, sizeof bytes), STATUS_OK);
    if (s == &f->client)
        channel_close(s->channel);
}

static void flush_message(struct farm *f, struct side *s, const Azulejo__Wire__Envelope *m)
{
    assert_ptr_equal(s, &f->server); /* the client closed: it hears no more */
    assert_int_equal(m->blob_data->offset, f->received);
    f->received++;
}

static void test_close_flushes(void **state)
{
    (void)state;
    for (int round = 0; round < 10; round++) {
        struct farm f;
        farm_begin(&f);
        f.on_open = flush_open;
        f.on_message = flush_message;
        farm_connect(&f);
        farm_run(&f);
        assert_int_equal(f.received, 64);
        assert_int_equal(f.client.why.code, STATUS_OK);
        assert_int_equal(f.server.why.code, STATUS_OK);
    }
}

/* ---- ends ------------------------------------------------------------------------------ */

static void abort_message(struct farm *f, struct side *s, const Azulejo__Wire__Envelope *m)
{
    (void)m;
    assert_ptr_equal(s, &f->server);
    channel_abort(s->channel, STATUS_ERR_LIMIT, "enough of %d", 42);
    channel_abort(s->channel, STATUS_ERR_IO, "not this one");
    channel_close(s->channel);
    assert_int_equal(message_send_heartbeat(s->channel), STATUS_ERR_IO);
}

static void test_abort(void **state)
{
    struct farm f;

    (void)state;
    farm_begin(&f);
    f.on_open = exchange_open;
    f.on_message = abort_message;
    farm_connect(&f);
    farm_run(&f);
    assert_int_equal(f.server.why.code, STATUS_ERR_LIMIT);
    assert_non_null(strstr(f.server.why.text, "127.0.0.1:"));
    assert_non_null(strstr(f.server.why.text, "enough of 42"));
    assert_int_equal(f.client.why.code, STATUS_ERR_UNREACHABLE);
    assert_non_null(strstr(f.client.why.text, "was lost"));
}

static void close_at_once(struct farm *f, struct side *s)
{
    (void)f;
    channel_close(s->channel);
}

static void test_close_on_open(void **state)
{
    struct farm f;

    (void)state;
    farm_begin(&f);
    f.on_open = close_at_once;
    farm_connect(&f);
    farm_run(&f);
    assert_int_equal(f.client.why.code, STATUS_OK);
    assert_int_equal(f.client.opened, 1);
}

static void test_close_while_connecting(void **state)
{
    struct farm f;

    (void)state;
    farm_begin(&f);
    f.closes_expected = 1;
    farm_connect(&f);
    channel_close(f.client.channel);
    assert_int_equal(f.client.closed, 0); /* never from within the call */
    farm_run(&f);
    assert_int_equal(f.client.closed, 1);
    assert_int_equal(f.client.opened, 0);
    assert_int_equal(f.client.why.code, STATUS_OK);
}

static void test_nobody_listens(void **state)
{
    static const char *const hosts[] = {"127.0.0.1", "a..b", ""};

    (void)state;
    for (int i = 0; i < 3; i++) {
        struct farm f;
        farm_begin(&f);
        f.closes_expected = 1;
        uv_close((uv_handle_t *)&f.listener, NULL);
        uv_run(&f.loop, UV_RUN_NOWAIT);
        assert_int_equal(channel_connect(&f.client.channel, &f.loop, hosts[i], f.port, &f.key, f.role, &callbacks, &f,
                                         NULL),
                         STATUS_OK);
        farm_run(&f);
        assert_int_equal(f.client.why.code, STATUS_ERR_UNREACHABLE);
        assert_non_null(strstr(f.client.why.text, i == 0 ? "cannot connect" : "no such host"));
    }
}

static void too_large_open(struct farm *f, struct side *s)
{
    static uint8_t bytes[CHANNEL_FRAME_MAX];

    if (s != &f->client)
        return;
    assert_int_equal(send_piece(s->channel, 0, bytes, sizeof bytes), STATUS_ERR_LIMIT);
    assert_int_equal(send_piece(s->channel, 0, bytes, sizeof bytes - 64), STATUS_OK);
    channel_close(s->channel);
}

static void test_largest_message(void **state)
{
    struct farm f;

    (void)state;
    farm_begin(&f);
    f.on_open = too_large_open;
    farm_connect(&f);
    farm_run(&f);
    assert_int_equal(f.server.messages, 1);
    assert_int_equal(f.server.why.code, STATUS_OK);
}

static void stuff(struct farm *f, struct side *s)
{
    static uint8_t bytes[CHANNEL_FRAME_MAX - 64];
    status result = STATUS_OK;

    if (s != &f->client)
        return;
    for (int i = 0; i < 80 && result == STATUS_OK; i++)
        result = send_piece(s->channel, 0, bytes, sizeof bytes);
    assert_int_equal(result, STATUS_ERR_LIMIT);
    assert_int_equal(send_piece(s->channel, 0, bytes, 1), STATUS_ERR_IO);
}

static void test_peer_that_reads_nothing(void **state)
{
    struct farm f;

    (void)state;
    farm_begin(&f);
    f.on_open = stuff;
    /* One loop serves both ends, and encrypts 256 MiB before the server's end has its turn. */
    channel_fault_handshake_ms(300000);
    farm_connect(&f);
    farm_run(&f);
    channel_fault_handshake_ms(0);
    assert_int_equal(f.client.why.code, STATUS_ERR_LIMIT);
    assert_non_null(strstr(f.client.why.text, "does not read"));
    assert_int_equal(f.server.why.code, STATUS_ERR_UNREACHABLE);
}

/* ---- keys ------------------------------------------------------------------------------ */

static void refused_run(struct farm *f)
{
    farm_connect(f);
    farm_run(f);
    assert_int_equal(f->server.opened, 0);
    assert_int_equal(f->client.opened, 0);
    assert_int_equal(f->server.why.code, STATUS_ERR_REFUSED);
    assert_int_equal(f->client.why.code, STATUS_ERR_REFUSED);
    assert_non_null(strstr(f->client.why.text, "key was not taken"));
}

static void test_wrong_key(void **state)
{
    struct farm f;

    (void)state;
    farm_begin(&f);
    assert_int_equal(farm_key_generate(&f.client_key, NULL), STATUS_OK);
    refused_run(&f);
    assert_non_null(strstr(f.server.why.text, "worker key is not of this farm"));
}

/* The key of one bit's difference, and another role's secret under this role's name. */
static void test_almost_right_keys(void **state)
{
    struct farm f;

    (void)state;
    farm_begin(&f);
    f.client_key.secret[31] ^= 1;
    refused_run(&f);
    farm_begin(&f);
    assert_int_equal(farm_key_derive(&f.key, FARM_ROLE_WORKER, &f.client_key, NULL), STATUS_OK);
    f.client_key.id = key_identity_shared(FARM_ROLE_ADMIN);
    f.role = FARM_ROLE_ADMIN;
    refused_run(&f);
    assert_non_null(strstr(f.server.why.text, "admin key is not of this farm"));
}

static void test_role_that_the_server_cannot_check(void **state)
{
    struct farm f;

    (void)state;
    farm_begin(&f);
    assert_int_equal(farm_key_derive(&f.client_key, FARM_ROLE_CLIENT, &f.key, NULL), STATUS_OK);
    refused_run(&f);
    assert_non_null(strstr(f.server.why.text, "no role"));
}

static void test_role_that_the_client_lacks(void **state)
{
    struct farm f;
    struct farm_key worker;
    struct error err = {0};

    (void)state;
    farm_begin(&f);
    assert_int_equal(farm_key_derive(&f.key, FARM_ROLE_WORKER, &worker, NULL), STATUS_OK);
    assert_int_equal(channel_connect(&f.client.channel, &f.loop, "127.0.0.1", f.port, &worker, FARM_ROLE_ADMIN,
                                     &callbacks, &f, &err),
                     STATUS_ERR_REFUSED);
    assert_null(f.client.channel);
    assert_non_null(strstr(err.text, "worker key cannot act as admin"));
    farm_stop(&f);
    farm_run(&f);
}

/* ---- peers that do not behave ---------------------------------------------------------- */

/* A peer in a thread of its own, on blocking sockets: TLS by hand, then any bytes. */
struct raw_peer {
    pthread_t thread;
    uint16_t port;
    struct farm_key key;
    int with_tls;
    struct buffer bytes; /* sent in pieces of `piece` bytes, each a TLS record */
    size_t piece;
    int goodbye;           /* close_notify before the end */
    int hold_until_closed; /* do not close: wait for the other end to do so */
    int reset;             /* end by RST */
    struct buffer heard;   /* decrypted */
};

static void raw_send_output(int fd, struct tls *tls)
{
    uint8_t bytes[4096];
    size_t size;

    while ((size = tls_output_take(tls, bytes, sizeof bytes)) > 0)
        for (size_t at = 0; at < size;) {
            ssize_t put = send(fd, bytes + at, size - at, MSG_NOSIGNAL);
            if (put <= 0)
                return;
            at += (size_t)put;
        }
}

/* Read once and decrypt; 0 at the end. */
static int raw_hear(struct raw_peer *p, int fd, struct tls *tls)
{
    uint8_t bytes[4096];
    ssize_t got = recv(fd, bytes, sizeof bytes, 0);
    size_t size;

    if (got <= 0)
        return 0;
    if (!tls)
        return 1;
    if (tls_feed(tls, bytes, (size_t)got, NULL) != STATUS_OK || tls_step(tls, NULL) != STATUS_OK)
        return 0;
    raw_send_output(fd, tls);
    while (tls_state_of(tls) == TLS_OPEN && tls_read(tls, bytes, sizeof bytes, &size, NULL) == STATUS_OK && size > 0)
        buffer_append(&p->heard, bytes, size);
    return 1;
}

static void *raw_main(void *argument)
{
    struct raw_peer *p = argument;
    struct sockaddr_in address = {.sin_family = AF_INET, .sin_port = htons(p->port),
                                  .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    struct linger hard = {1, 0};
    struct tls *tls = NULL;
    int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);

    if (connect(fd, (struct sockaddr *)&address, sizeof address) != 0)
        goto done;
    if (p->with_tls) {
        if (tls_new_client(&tls, &p->key, FARM_ROLE_CLIENT, NULL) != STATUS_OK || tls_step(tls, NULL) != STATUS_OK)
            goto done;
        raw_send_output(fd, tls);
        while (tls_state_of(tls) == TLS_HANDSHAKE)
            if (!raw_hear(p, fd, tls))
                goto done;
    }
    for (size_t at = 0; at < p->bytes.size;) {
        size_t size = p->bytes.size - at < p->piece ? p->bytes.size - at : p->piece;
        if (!tls && send(fd, p->bytes.data + at, size, MSG_NOSIGNAL) <= 0)
            break;
        if (tls && tls_write(tls, p->bytes.data + at, size, NULL) != STATUS_OK)
            break;
        if (tls)
            raw_send_output(fd, tls);
        at += size;
    }
    if (tls && p->goodbye) {
        tls_end(tls);
        raw_send_output(fd, tls);
    }
    while (p->hold_until_closed && raw_hear(p, fd, tls))
        ;
    if (p->reset)
        setsockopt(fd, SOL_SOCKET, SO_LINGER, &hard, sizeof hard);
done:
    tls_free(tls);
    close(fd);
    return NULL;
}

static void raw_start(struct farm *f, struct raw_peer *p)
{
    f->closes_expected = 1;
    p->port = f->port;
    p->key = f->key;
    if (!p->piece)
        p->piece = SIZE_MAX;
    assert_int_equal(pthread_create(&p->thread, NULL, raw_main, p), 0);
}

static void raw_finish(struct farm *f, struct raw_peer *p)
{
    farm_run(f);
    pthread_join(p->thread, NULL);
    assert_int_equal(f->server.closed, 1);
    buffer_release(&p->bytes);
}

static void put_message(struct buffer *out, const Azulejo__Wire__Envelope *e)
{
    size_t size = azulejo__wire__envelope__get_packed_size(e);
    uint8_t header[FRAME_HEADER_BYTES], *space;

    framing_header_write(header, (uint32_t)size);
    buffer_append(out, header, sizeof header);
    space = buffer_append_space(out, size);
    assert_non_null(space);
    azulejo__wire__envelope__pack(e, space);
}

static void put_hello(struct buffer *out)
{
    Azulejo__Wire__Hello hello = AZULEJO__WIRE__HELLO__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(HELLO, hello, &hello);

    hello.host = (char *)"a raw peer";
    put_message(out, &e);
}

static void count_hello(struct farm *f, struct side *s, const Azulejo__Wire__Envelope *m)
{
    (void)s;
    assert_int_equal(m->body_case, AZULEJO__WIRE__ENVELOPE__BODY_HELLO);
    assert_string_equal(m->hello->host, "a raw peer");
    f->received++;
}

/* Every byte in a TLS record of its own, so that frames are split everywhere. */
static void test_one_byte_records(void **state)
{
    struct farm f;
    struct raw_peer p = {.with_tls = 1, .piece = 1, .goodbye = 1};

    (void)state;
    farm_begin(&f);
    f.on_message = count_hello;
    for (int i = 0; i < 5; i++)
        put_hello(&p.bytes);
    raw_start(&f, &p);
    raw_finish(&f, &p);
    assert_int_equal(f.received, 5);
    assert_int_equal(f.server.why.code, STATUS_OK);
}

/* Cut off at every byte of the second frame, by a reset and by a plain end. */
static void test_peer_vanishes_in_mid_frame(void **state)
{
    struct buffer wire = BUFFER_INIT;
    size_t first;

    (void)state;
    put_hello(&wire);
    first = wire.size;
    put_hello(&wire);
    for (size_t cut = first; cut < wire.size; cut++) {
        struct farm f;
        struct raw_peer p = {.with_tls = 1};
        farm_begin(&f);
        f.on_message = count_hello;
        buffer_append(&p.bytes, wire.data, cut);
        raw_start(&f, &p);
        raw_finish(&f, &p);
        assert_int_equal(f.received, 1);
        assert_int_equal(f.server.why.code, STATUS_ERR_UNREACHABLE);
        assert_non_null(strstr(f.server.why.text, "was lost"));
        assert_true((strstr(f.server.why.text, "middle of a message") != NULL) == (cut > first));
    }
    buffer_release(&wire);
}

static void test_reset(void **state)
{
    struct farm f;
    struct raw_peer p = {.with_tls = 1, .reset = 1};

    (void)state;
    farm_begin(&f);
    put_hello(&p.bytes);
    raw_start(&f, &p);
    raw_finish(&f, &p);
    assert_int_equal(f.server.why.code, STATUS_ERR_UNREACHABLE);
}

static void test_goodbye_in_mid_frame(void **state)
{
    struct farm f;
    struct raw_peer p = {.with_tls = 1, .goodbye = 1};

    (void)state;
    farm_begin(&f);
    put_hello(&p.bytes);
    p.bytes.size -= 3;
    raw_start(&f, &p);
    raw_finish(&f, &p);
    assert_int_equal(f.server.why.code, STATUS_ERR_PROTOCOL);
    assert_int_equal(f.server.messages, 0);
}

/* A frame that breaks the rules: the server says why and ends, within its time. */
static void check_bad_frame(const void *bytes, size_t size, status expected)
{
    struct farm f;
    struct raw_peer p = {.with_tls = 1, .hold_until_closed = 1};
    struct framing_reader r;
    const uint8_t *payload;
    Azulejo__Wire__Envelope *e;
    size_t length;

    farm_begin(&f);
    f.on_message = count_hello;
    put_hello(&p.bytes);
    buffer_append(&p.bytes, bytes, size);
    raw_start(&f, &p);
    raw_finish(&f, &p);
    assert_int_equal(f.received, 1);
    assert_int_equal(f.server.why.code, expected);
    framing_reader_init(&r, CHANNEL_FRAME_MAX);
    assert_int_equal(framing_reader_push(&r, p.heard.data, p.heard.size, NULL), STATUS_OK);
    assert_int_equal(framing_reader_next(&r, &payload, &length, NULL), STATUS_OK);
    assert_non_null(payload);
    assert_int_equal(message_unpack(&e, payload, length, NULL), STATUS_OK);
    assert_int_equal(e->body_case, AZULEJO__WIRE__ENVELOPE__BODY_FAILURE);
    assert_int_equal(e->failure->code, expected);
    message_free(e);
    framing_reader_release(&r);
    buffer_release(&p.heard);
}

static void test_bad_frames(void **state)
{
    const uint8_t huge[] = {0xff, 0xff, 0xff, 0xff}, empty[] = {0, 0, 0, 0};
    const uint8_t over[] = {1, 0, 0x40, 0}; /* CHANNEL_FRAME_MAX + 1 */
    const uint8_t garbage[] = {4, 0, 0, 0, 0xff, 0xff, 0xff, 0xff};
    const uint8_t group[] = {2, 0, 0, 0, 0x13, 0x14}; /* a protobuf group, which is not ours */

    (void)state;
    check_bad_frame(huge, sizeof huge, STATUS_ERR_PROTOCOL);
    check_bad_frame(empty, sizeof empty, STATUS_ERR_PROTOCOL);
    check_bad_frame(over, sizeof over, STATUS_ERR_PROTOCOL);
    check_bad_frame(garbage, sizeof garbage, STATUS_ERR_PROTOCOL);
    check_bad_frame(group, sizeof group, STATUS_ERR_PROTOCOL);
}

static void test_garbage_instead_of_tls(void **state)
{
    static const char *const texts[] = {"GET / HTTP/1.1\r\nHost: x\r\n\r\n", "\x16\x03\x01\xff\xff",
                                        "\x16\x03\x01\x00\x05\x01\x00\x00\x01\x00",
                                        "\xff\xff\xff\xff\xff\xff"};

    (void)state;
    for (int i = 0; i < 4; i++) {
        struct farm f;
        struct raw_peer p = {.hold_until_closed = 1};
        farm_begin(&f);
        /* the third has zeros inside */
        buffer_append(&p.bytes, texts[i], i == 2 ? 10 : strlen(texts[i]));
        raw_start(&f, &p);
        raw_finish(&f, &p);
        assert_int_equal(f.server.why.code, STATUS_ERR_PROTOCOL);
        assert_non_null(strstr(f.server.why.text, "TLS"));
        assert_int_equal(f.server.opened, 0);
    }
}

static void test_peer_leaves_before_tls(void **state)
{
    struct farm f;
    struct raw_peer p = {0};

    (void)state;
    farm_begin(&f);
    raw_start(&f, &p);
    raw_finish(&f, &p);
    assert_int_equal(f.server.why.code, STATUS_ERR_UNREACHABLE);
    assert_non_null(strstr(f.server.why.text, "before the TLS handshake"));
}

/* ---- before the handshake -------------------------------------------------------------- */

static void gate_ready(struct channel *c, void *user)
{
    struct farm *f = user;

    assert_ptr_equal(c, f->server.channel);
    f->ready++;
    if (f->turn)
        uv_idle_start(&f->idle, f->turn);
}

static void gate_refused(struct channel *c, void *user)
{
    struct farm *f = user;

    assert_ptr_equal(c, f->server.channel);
    assert_int_equal(f->server.closed, 0);
    f->refused++;
}

static const struct channel_gate gate = {gate_ready, gate_refused};

/* The turn comes after some turns of the loop. */
static void gate_turn(uv_idle_t *idle)
{
    struct farm *f = idle->data;

    assert_int_equal(f->server.opened + f->client.opened, 0);
    if (++f->idle_turns < 20)
        return;
    uv_idle_stop(idle);
    channel_handshake(f->server.channel);
    channel_handshake(f->server.channel);
}

static void test_handshake_waits_for_its_turn(void **state)
{
    struct farm f;

    (void)state;
    farm_begin(&f);
    f.gate = &gate;
    f.turn = gate_turn;
    f.on_open = exchange_open;
    f.on_message = exchange_message;
    farm_connect(&f);
    farm_run(&f);
    assert_int_equal(f.ready, 1);
    assert_int_equal(f.refused, 0);
    assert_int_equal(f.server.messages, 1);
    assert_int_equal(f.client.why.code, STATUS_OK);
}

static void test_gate_hears_of_refusals(void **state)
{
    struct farm f;

    (void)state;
    farm_begin(&f);
    f.gate = &gate;
    f.turn = gate_turn;
    f.client_key.secret[0] ^= 1;
    refused_run(&f);
    assert_int_equal(f.ready, 1);
    assert_int_equal(f.refused, 1);
}

/* Who waits for its turn is not limited: this timer would run after the limit's. */
static void gate_much_later(uv_timer_t *timer)
{
    struct farm *f = timer->data;

    assert_int_equal(f->server.closed, 0);
    uv_close((uv_handle_t *)timer, NULL);
    channel_close(f->server.channel);
}

static void gate_wait(uv_idle_t *idle)
{
    static uv_timer_t later;
    struct farm *f = idle->data;

    uv_idle_stop(idle);
    uv_timer_init(&f->loop, &later);
    later.data = f;
    uv_timer_start(&later, gate_much_later, 300, 0);
}

static void test_no_limit_while_it_waits(void **state)
{
    struct farm f;
    struct raw_peer p = {.with_tls = 1, .hold_until_closed = 1};

    (void)state;
    channel_fault_handshake_ms(100);
    farm_begin(&f);
    f.gate = &gate;
    f.turn = gate_wait;
    raw_start(&f, &p);
    raw_finish(&f, &p);
    assert_int_equal(f.ready, 1);
    assert_int_equal(f.server.why.code, STATUS_OK);
    channel_fault_handshake_ms(0);
}

/* A part of a record is no reason for a handshake, and its time is limited. */
static void test_part_of_a_record(void **state)
{
    static const uint8_t record[] = {22, 3, 1, 0, 100, 1, 0, 0, 96, 3, 3};

    (void)state;
    channel_fault_handshake_ms(100);
    for (size_t size = 1; size <= sizeof record; size++) {
        struct farm f;
        struct raw_peer p = {.hold_until_closed = 1};
        farm_begin(&f);
        f.gate = &gate;
        buffer_append(&p.bytes, record, size);
        raw_start(&f, &p);
        raw_finish(&f, &p);
        assert_int_equal(f.ready, 0);
        assert_int_equal(f.server.why.code, STATUS_ERR_TIMEOUT);
    }
    channel_fault_handshake_ms(0);
}

/* More than a record may hold, announced or sent after it, ends the connection. */
static void test_too_much_before_the_handshake(void **state)
{
    static const uint8_t long_record[] = {22, 3, 1, CHANNEL_FIRST_MAX >> 8, 0},
                         short_record[] = {22, 3, 1, 0, 1, 1};
    static const uint8_t zeros[2 * CHANNEL_FIRST_MAX];

    (void)state;
    for (int after = 0; after < 2; after++) {
        struct farm f;
        struct raw_peer p = {.hold_until_closed = 1};
        farm_begin(&f);
        f.gate = &gate;
        if (after) {
            buffer_append(&p.bytes, short_record, sizeof short_record);
            buffer_append(&p.bytes, zeros, sizeof zeros);
            p.piece = sizeof short_record;
        } else {
            buffer_append(&p.bytes, long_record, sizeof long_record);
        }
        raw_start(&f, &p);
        raw_finish(&f, &p);
        assert_int_equal(f.server.why.code, STATUS_ERR_PROTOCOL);
        assert_non_null(strstr(f.server.why.text, "4096"));
    }
}

/* Silence on both sides: a peer that never speaks, and a listener that nobody serves. */
static void test_handshake_limit(void **state)
{
    struct farm f;
    struct raw_peer p = {.hold_until_closed = 1};
    struct sockaddr_in address;
    int size = sizeof address, fd;

    (void)state;
    channel_fault_handshake_ms(100);
    farm_begin(&f);
    raw_start(&f, &p);
    raw_finish(&f, &p);
    assert_int_equal(f.server.why.code, STATUS_ERR_TIMEOUT);

    fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    uv_ip4_addr("127.0.0.1", 0, &address);
    assert_int_equal(bind(fd, (struct sockaddr *)&address, sizeof address), 0);
    assert_int_equal(listen(fd, 1), 0); /* the kernel connects; nobody accepts */
    assert_int_equal(getsockname(fd, (struct sockaddr *)&address, (socklen_t *)&size), 0);
    farm_begin(&f);
    f.closes_expected = 1;
    f.port = ntohs(address.sin_port);
    farm_connect(&f);
    farm_run(&f);
    assert_int_equal(f.client.why.code, STATUS_ERR_UNREACHABLE);
    assert_non_null(strstr(f.client.why.text, "no TLS handshake"));
    close(fd);
    channel_fault_handshake_ms(0);
}

/* ---- memory ---------------------------------------------------------------------------- */

static void memory_open(struct farm *f, struct side *s)
{
    Azulejo__Wire__Hello hello = AZULEJO__WIRE__HELLO__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(HELLO, hello, &hello);

    hello.host = (char *)"here";
    e.request = 77;
    if (s == &f->client && channel_send(s->channel, &e) != STATUS_OK)
        channel_abort(s->channel, STATUS_ERR_NO_MEMORY, "no memory");
}

static void memory_message(struct farm *f, struct side *s, const Azulejo__Wire__Envelope *m)
{
    (void)m;
    if (s == &f->server && message_send_heartbeat(s->channel) != STATUS_OK)
        channel_abort(s->channel, STATUS_ERR_NO_MEMORY, "no memory");
    if (s == &f->client)
        channel_close(s->channel);
}

/* Fail the Nth allocation, for every N until a run is clean: both ends always end. */
static void test_every_allocation_fails_once(void **state)
{
    long n;

    (void)state;
    for (n = 0; n < 1000; n++) {
        struct farm f;
        struct error err = {0};
        long failed;
        status result;
        farm_begin(&f);
        f.on_open = memory_open;
        f.on_message = memory_message;
        mem_fault_arm(n, 1);
        result = channel_connect(&f.client.channel, &f.loop, "127.0.0.1", f.port, &f.key, f.role, &callbacks, &f, &err);
        if (result != STATUS_OK) {
            assert_int_equal(result, STATUS_ERR_NO_MEMORY);
            farm_stop(&f);
        }
        farm_run(&f);
        failed = mem_fault_count();
        mem_fault_arm(-1, 0);
        if (!failed) {
            assert_int_equal(f.client.why.code, STATUS_OK);
            assert_int_equal(f.server.why.code, STATUS_OK);
            assert_int_equal(f.client.messages, 1);
            break;
        }
    }
    assert_true(n > 10 && n < 1000);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_exchange_in_every_role),
        cmocka_unit_test(test_host_with_several_addresses),
        cmocka_unit_test(test_flood),
        cmocka_unit_test(test_corked),
        cmocka_unit_test(test_turns_end),
        cmocka_unit_test(test_pause),
        cmocka_unit_test(test_close_flushes),
        cmocka_unit_test(test_abort),
        cmocka_unit_test(test_close_on_open),
        cmocka_unit_test(test_close_while_connecting),
        cmocka_unit_test(test_nobody_listens),
        cmocka_unit_test(test_largest_message),
        cmocka_unit_test(test_peer_that_reads_nothing),
        cmocka_unit_test(test_wrong_key),
        cmocka_unit_test(test_almost_right_keys),
        cmocka_unit_test(test_role_that_the_server_cannot_check),
        cmocka_unit_test(test_role_that_the_client_lacks),
        cmocka_unit_test(test_one_byte_records),
        cmocka_unit_test(test_peer_vanishes_in_mid_frame),
        cmocka_unit_test(test_reset),
        cmocka_unit_test(test_goodbye_in_mid_frame),
        cmocka_unit_test(test_bad_frames),
        cmocka_unit_test(test_garbage_instead_of_tls),
        cmocka_unit_test(test_handshake_waits_for_its_turn),
        cmocka_unit_test(test_gate_hears_of_refusals),
        cmocka_unit_test(test_no_limit_while_it_waits),
        cmocka_unit_test(test_part_of_a_record),
        cmocka_unit_test(test_too_much_before_the_handshake),
        cmocka_unit_test(test_peer_leaves_before_tls),
        cmocka_unit_test(test_handshake_limit),
        cmocka_unit_test(test_every_allocation_fails_once),
    };
    return cmocka_run_group_tests_name("channel", tests, NULL, NULL);
}
