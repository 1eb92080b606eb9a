/* The channel without a socket: what its owner sends reaches the sink at once, and its end comes once and last. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "common/base/clock.h"
#include "common/base/memory.h"
#include "protocol/channel_local.h"
#include "protocol/message.h"

enum { PIECE_BYTES = 1 << 20 };

struct pair {
    uv_loop_t loop;
    struct channel *channel;
    /* the owner's */
    unsigned opened, heard, drains, closed;
    uint64_t last_request;
    struct error why;
    int answers;              /* a message is answered at once by another one */
    /* the sink's */
    unsigned got, gone;
    size_t queued;
    int close_from_sink;
    int closed_before_gone;
};

static void on_open(struct channel *c, void *user)
{
    (void)c;
    ((struct pair *)user)->opened++;
}

static void on_message(struct channel *c, const Azulejo__Wire__Envelope *m, void *user)
{
    struct pair *p = user;

    p->heard++;
    p->last_request = m->request;
    if (p->answers)
        assert_int_equal(message_send_heartbeat(c), STATUS_OK);
}

static void on_drain(struct channel *c, void *user)
{
    (void)c;
    ((struct pair *)user)->drains++;
}

static void on_close(struct channel *c, const struct error *why, void *user)
{
    struct pair *p = user;

    (void)c;
    p->closed++;
    p->why = *why;
}

static void sink_send(void *user, const Azulejo__Wire__Envelope *m)
{
    struct pair *p = user;

    p->got++;
    p->queued += azulejo__wire__envelope__get_packed_size(m);
    if (p->close_from_sink)
        channel_close(p->channel);
}

static size_t sink_queued(void *user)
{
    return ((struct pair *)user)->queued;
}

static void sink_closed(void *user, const struct error *why)
{
    struct pair *p = user;

    (void)why;
    p->gone++;
    p->closed_before_gone = p->closed == 1;
}

static const struct channel_callbacks callbacks = {on_open, on_message, on_drain, on_close};
static const struct channel_sink sink = {sink_send, sink_queued, sink_closed};

static void begin(struct pair *p)
{
    struct error err = {0};

    memset(p, 0, sizeof *p);
    assert_int_equal(uv_loop_init(&p->loop), 0);
    assert_int_equal(channel_local(&p->channel, &p->loop, &sink, p, FARM_ROLE_CLIENT, "the API, token 3",
                                   &callbacks, p, &err),
                     STATUS_OK);
}

static void end(struct pair *p)
{
    uv_run(&p->loop, UV_RUN_DEFAULT);
    assert_int_equal(uv_loop_close(&p->loop), 0);
    assert_int_equal(p->closed, 1);
    assert_int_equal(p->gone, 1);
    assert_true(p->closed_before_gone);
    assert_int_equal(p->opened, 0);
}

static void say(struct pair *p, uint64_t request)
{
    Azulejo__Wire__JobQuery query = AZULEJO__WIRE__JOB_QUERY__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(JOB_QUERY, job_query, &query);

    envelope.request = request;
    channel_local_message(p->channel, &envelope);
}

static void test_both_ways(void **state)
{
    struct pair p;

    (void)state;
    begin(&p);
    assert_int_equal(channel_role(p.channel), FARM_ROLE_CLIENT);
    assert_string_equal(channel_peer(p.channel), "the API, token 3");
    assert_int_equal(message_send_heartbeat(p.channel), STATUS_OK);
    assert_int_equal(p.got, 1); /* it does not wait for the loop */
    p.answers = 1;
    say(&p, 17);
    assert_int_equal(p.heard, 1);
    assert_int_equal(p.last_request, 17);
    assert_int_equal(p.got, 2);
    channel_close(p.channel);
    end(&p);
    assert_int_equal(p.why.code, STATUS_OK);
}

/* Heard of just now, however long ago anything was said. */
static void test_never_silent(void **state)
{
    struct pair p;
    uint64_t before_ns;

    (void)state;
    begin(&p);
    uv_sleep(20);
    before_ns = clock_monotonic_ns();
    assert_true(channel_last_heard_ns(p.channel) >= before_ns);
    assert_true(channel_last_sent_ns(p.channel) >= before_ns);
    channel_close(p.channel);
    end(&p);
}

static status send_piece(struct channel *c, size_t size)
{
    static uint8_t bytes[CHANNEL_FRAME_MAX + 1];
    Azulejo__Wire__BlobData data = AZULEJO__WIRE__BLOB_DATA__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(BLOB_DATA, blob_data, &data);

    data.data = (ProtobufCBinaryData){size, bytes};
    return channel_send(c, &envelope);
}

/* What is queued is what the sink says; a message has the limit of a frame; more than the maximum ends it. */
static void test_back_pressure(void **state)
{
    struct pair p;
    int sent = 0;

    (void)state;
    begin(&p);
    assert_int_equal(channel_queued_bytes(p.channel), 0);
    assert_int_equal(send_piece(p.channel, CHANNEL_FRAME_MAX + 1), STATUS_ERR_LIMIT);
    assert_int_equal(p.got, 0);
    assert_int_equal(send_piece(p.channel, PIECE_BYTES), STATUS_OK);
    assert_true(channel_queued_bytes(p.channel) >= PIECE_BYTES);
    p.queued = 0;
    channel_local_drained(p.channel);
    assert_int_equal(p.drains, 1);
    while (send_piece(p.channel, PIECE_BYTES) == STATUS_OK)
        assert_true(++sent <= CHANNEL_QUEUE_MAX / PIECE_BYTES);
    assert_true(sent >= CHANNEL_QUEUE_MAX / PIECE_BYTES - 1);
    end(&p);
    assert_int_equal(p.why.code, STATUS_ERR_LIMIT);
    assert_non_null(strstr(p.why.text, "the API, token 3: it does not read"));
}

/* Nothing goes through once it is closed, from whichever side and wherever. */
static void test_ends(void **state)
{
    struct pair p;

    (void)state;
    begin(&p);
    p.close_from_sink = 1;
    assert_int_equal(message_send_heartbeat(p.channel), STATUS_OK);
    assert_int_equal(p.closed + p.gone, 0); /* never from within */
    assert_int_equal(message_send_heartbeat(p.channel), STATUS_ERR_IO);
    say(&p, 1);
    channel_local_drained(p.channel);
    channel_close(p.channel);
    assert_int_equal(p.heard + p.drains, 0);
    assert_int_equal(p.got, 1);
    end(&p);

    begin(&p);
    channel_abort(p.channel, STATUS_ERR_REFUSED, "token %d was revoked", 3);
    channel_close(p.channel);
    end(&p);
    assert_int_equal(p.why.code, STATUS_ERR_REFUSED);
    assert_string_equal(p.why.text, "the API, token 3: token 3 was revoked");
}

static void test_no_memory(void **state)
{
    struct pair p = {0};
    struct error err = {0};

    (void)state;
    assert_int_equal(uv_loop_init(&p.loop), 0);
    mem_fault_arm(0, 1);
    assert_int_equal(channel_local(&p.channel, &p.loop, &sink, &p, FARM_ROLE_CLIENT, "x", &callbacks, &p, &err),
                     STATUS_ERR_NO_MEMORY);
    mem_fault_arm(-1, 0);
    assert_null(p.channel);
    assert_int_equal(uv_loop_close(&p.loop), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_both_ways),
        cmocka_unit_test(test_never_silent),
        cmocka_unit_test(test_back_pressure),
        cmocka_unit_test(test_ends),
        cmocka_unit_test(test_no_memory),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
