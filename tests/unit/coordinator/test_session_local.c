/* A session over a channel without a socket: a client's, without a Hello, never silent, ended from either side. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <uv.h>

#include "common/base/clock.h"
#include "common/base/file.h"
#include "common/base/memory.h"
#include "coordinator/net/server.h"
#include "coordinator/net/session_table.h"
#include "protocol/channel_local.h"
#include "protocol/message.h"

/* The other side of the channel: what it was given last. */
struct other {
    unsigned answers, heartbeats, closed;
    uint64_t request;
    int body;
    status failure;
    char text[256];
};

struct place {
    char folder[64];
    struct server *server;
    struct channel *channel;
    struct other other;
};

static void on_send(void *user, const Azulejo__Wire__Envelope *message)
{
    struct other *other = user;

    other->heartbeats += message->body_case == AZULEJO__WIRE__ENVELOPE__BODY_HEARTBEAT;
    other->answers++;
    other->request = message->request;
    other->body = (int)message->body_case;
    other->failure = STATUS_OK;
    if (message->body_case == AZULEJO__WIRE__ENVELOPE__BODY_FAILURE) {
        other->failure = (status)message->failure->code;
        snprintf(other->text, sizeof other->text, "%s", message->failure->text);
    }
}

static size_t queued_bytes(void *user)
{
    (void)user;
    return 0;
}

static void on_closed(void *user, const struct error *why)
{
    (void)why;
    ((struct other *)user)->closed++;
}

static void no_message(struct channel *c, const Azulejo__Wire__Envelope *m, void *user)
{
    (void)c, (void)m, (void)user;
}

static void no_close(struct channel *c, const struct error *why, void *user)
{
    (void)c, (void)why, (void)user;
}

static const struct channel_sink sink = {on_send, queued_bytes, on_closed};
static const struct channel_callbacks none = {NULL, no_message, NULL, no_close};

static void begin(struct place *p)
{
    static const struct farm_events events = {0};
    struct error err = {0};

    memset(p, 0, sizeof *p);
    snprintf(p->folder, sizeof p->folder, "/tmp/azulejo-session-XXXXXX");
    assert_non_null(mkdtemp(p->folder));
    p->server = mem_calloc(1, sizeof *p->server);
    assert_non_null(p->server);
    assert_int_equal(uv_loop_init(&p->server->loop), 0);
    assert_int_equal(store_open(&p->server->store, p->folder, &err), STATUS_OK);
    assert_int_equal(audit_init(&p->server->audit, p->folder, &err), STATUS_OK);
    assert_int_equal(farm_init(&p->server->farm, p->server->store, NS_PER_SECOND, &events, clock_wall_s(), &err),
                     STATUS_OK);
    assert_int_equal(channel_local(&p->channel, &p->server->loop, &sink, &p->other, FARM_ROLE_CLIENT,
                                   "the API, token 7", &none, NULL, &err),
                     STATUS_OK);
    assert_int_equal(session_begin_local(p->server, p->channel, "ana@ws3", &err), STATUS_OK);
}

static void end(struct place *p)
{
    uv_run(&p->server->loop, UV_RUN_DEFAULT);
    assert_int_equal(p->other.closed, 1);
    assert_null(p->server->sessions);
    farm_release(&p->server->farm, clock_monotonic_ns());
    audit_release(&p->server->audit);
    store_close(p->server->store);
    assert_int_equal(uv_loop_close(&p->server->loop), 0);
    mem_free(p->server);
    file_remove_tree(p->folder);
}

static void ask_jobs(struct place *p, uint64_t request, uint64_t job)
{
    Azulejo__Wire__JobQuery query = AZULEJO__WIRE__JOB_QUERY__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(JOB_QUERY, job_query, &query);

    query.job = job;
    envelope.request = request;
    channel_local_message(p->channel, &envelope);
}

static void test_answers_at_once(void **state)
{
    struct place p;
    const struct session *session;

    (void)state;
    begin(&p);
    session = p.server->sessions;
    assert_int_equal(session->state, SESSION_OPEN);
    assert_string_equal(session->who, "ana@ws3");
    assert_string_equal(session->host, "ws3");
    assert_string_equal(session->peer, "the API, token 7");
    assert_int_equal(p.other.answers, 0); /* no Welcome */
    ask_jobs(&p, 41, 0);
    assert_int_equal(p.other.body, AZULEJO__WIRE__ENVELOPE__BODY_JOB_LIST);
    assert_int_equal(p.other.request, 41);
    ask_jobs(&p, 42, 12);
    assert_int_equal(p.other.failure, STATUS_ERR_NOT_FOUND);
    assert_string_equal(p.other.text, "there is no job 12");
    assert_int_equal(p.other.request, 42);
    channel_close(p.channel);
    end(&p);
}

/* Whatever the clock says: no heartbeat is sent, and nobody counts as dead. */
static void test_never_silent(void **state)
{
    struct place p;

    (void)state;
    begin(&p);
    for (int i = 0; i < 100; i++)
        session_tick(p.server->sessions, clock_monotonic_ns());
    assert_int_equal(p.other.heartbeats, 0);
    assert_int_equal(p.server->sessions->state, SESSION_OPEN);
    channel_close(p.channel);
    end(&p);
}

/* Workers' messages are refused, as from any client, and end the session. */
static void test_is_a_client(void **state)
{
    Azulejo__Wire__LeaseRequest lease = AZULEJO__WIRE__LEASE_REQUEST__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(LEASE_REQUEST, lease_request, &lease);
    struct place p;

    (void)state;
    begin(&p);
    envelope.request = 5;
    channel_local_message(p.channel, &envelope);
    assert_int_equal(p.other.failure, STATUS_ERR_REFUSED);
    ask_jobs(&p, 6, 0);
    assert_int_equal(p.other.request, 5); /* no answer after that */
    end(&p);
}

static void test_server_ends(void **state)
{
    struct place p;

    (void)state;
    begin(&p);
    session_end(p.server->sessions, NULL);
    assert_int_equal(p.other.closed, 0);
    end(&p);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_answers_at_once),
        cmocka_unit_test(test_never_silent),
        cmocka_unit_test(test_is_a_client),
        cmocka_unit_test(test_server_ends),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
