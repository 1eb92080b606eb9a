#include "web/uploads/import_relay.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/system/log.h"
#include "protocol/channel.h"
#include "protocol/message.h"

enum { BACKLOG = 2, HEARTBEAT_MS = 2000, SILENCE_MS = 3600 * 1000 /* the child's limits end it (child.h) */ };

struct import_relay {
    struct link_peers *farm;
    struct farm_key master; /* of this relay alone: random, and kept by no one else */
    uv_tcp_t listener;
    struct channel *program; /* NULL: not connected, or no longer */
    struct link_peer *coordinator;
    int is_listening, was_taken, is_ending;
};

static void release(struct import_relay *r)
{
    if (r->is_listening || r->program || r->coordinator || !r->is_ending)
        return;
    explicit_bzero(&r->master, sizeof r->master);
    mem_free(r);
}

static void on_closed(uv_handle_t *handle)
{
    struct import_relay *r = handle->data;

    r->is_listening = 0;
    release(r);
}

static void stop_listening(struct import_relay *r)
{
    if (r->is_listening && !uv_is_closing((uv_handle_t *)&r->listener))
        uv_close((uv_handle_t *)&r->listener, on_closed);
}

/* ---- what the coordinator says ----------------------------------------------------------------- */

static void on_answer(void *user, const Azulejo__Wire__Envelope *message)
{
    struct import_relay *r = user;

    if (r->program && channel_send(r->program, message) != STATUS_OK)
        channel_abort(r->program, STATUS_ERR_NO_MEMORY, "out of memory for an answer");
}

static void on_room(void *user)
{
    const struct import_relay *r = user;

    if (r->program)
        channel_pause(r->program, 0);
}

static void on_coordinator_end(void *user, const struct error *why)
{
    struct import_relay *r = user;

    r->coordinator = NULL;
    if (r->program) {
        struct error said = *why;
        if (said.code == STATUS_OK)
            (void)error_set(&said, STATUS_ERR_UNREACHABLE, "the coordinator is ending");
        (void)!message_send_failure(r->program, 0, &said);
        channel_close(r->program);
    }
    release(r);
}

/* ---- what the program says --------------------------------------------------------------------- */

static int is_of_an_import(const Azulejo__Wire__Envelope *message)
{
    return message->body_case == AZULEJO__WIRE__ENVELOPE__BODY_BLOB_QUERY ||
           message->body_case == AZULEJO__WIRE__ENVELOPE__BODY_BLOB_PUT ||
           message->body_case == AZULEJO__WIRE__ENVELOPE__BODY_JOB_SUBMIT;
}

static void greet(struct import_relay *r, uint64_t request)
{
    Azulejo__Wire__Welcome welcome = AZULEJO__WIRE__WELCOME__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(WELCOME, welcome, &welcome);

    welcome.protocol_version = PROTOCOL_VERSION;
    welcome.software = (char *)"azulejo " AZULEJO_VERSION;
    welcome.heartbeat_ms = HEARTBEAT_MS;
    welcome.silence_limit_ms = SILENCE_MS;
    envelope.request = request;
    if (channel_send(r->program, &envelope) != STATUS_OK)
        channel_abort(r->program, STATUS_ERR_NO_MEMORY, "out of memory for a greeting");
}

static void on_message(struct channel *channel, const Azulejo__Wire__Envelope *message, void *user)
{
    struct import_relay *r = user;
    struct error err = {0};

    if (message->body_case == AZULEJO__WIRE__ENVELOPE__BODY_HEARTBEAT) {
        (void)!message_send_heartbeat(channel);
    } else if (message->body_case == AZULEJO__WIRE__ENVELOPE__BODY_HELLO) {
        greet(r, message->request);
    } else if (!is_of_an_import(message)) {
        log_warn("a scene's import asked the coordinator for what an import does not need (message %d)", (int)message->body_case);
        channel_abort(channel, STATUS_ERR_PROTOCOL, "an import may not ask for message %d", (int)message->body_case);
    } else if (!r->coordinator || link_send(r->coordinator, message, &err) != STATUS_OK) {
        channel_abort(channel, STATUS_ERR_IO, "%s", err.text[0] ? err.text : "the coordinator has ended the connection");
    } else if (link_is_full(r->coordinator)) {
        channel_pause(channel, 1);
    }
}

static void on_open(struct channel *channel UNUSED, void *user)
{
    static const struct link_callbacks callbacks = {on_answer, on_room, on_coordinator_end};
    struct import_relay *r = user;
    struct error err = {0};

    if (link_open(&r->coordinator, r->farm, 0, &callbacks, r, &err) != STATUS_OK) {
        r->coordinator = NULL;
        channel_abort(r->program, err.code, "%s", err.text);
    }
}

static void on_close(struct channel *channel UNUSED, const struct error *why UNUSED, void *user)
{
    struct import_relay *r = user;

    r->program = NULL;
    if (r->coordinator)
        link_close(r->coordinator);
    release(r);
}

static void on_connection(uv_stream_t *listener, int code)
{
    static const struct channel_callbacks callbacks = {.on_open = on_open, .on_message = on_message, .on_close = on_close};
    struct import_relay *r = listener->data;
    struct error err = {0};

    if (code != 0)
        return;
    if (r->was_taken || r->is_ending) {
        channel_reject(listener);
        return;
    }
    if (channel_accept(&r->program, listener, &r->master, &callbacks, NULL, r, &err) != STATUS_OK)
        r->program = NULL;
    else
        r->was_taken = 1; /* and another does not get in; a stranger that comes first lacks the key, and the import fails */
}

/* ---- begin and end ----------------------------------------------------------------------------- */

static status listen_(struct import_relay *r, uv_loop_t *loop, uint16_t *port, struct error *err)
{
    struct sockaddr_in address = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    struct sockaddr_storage bound = {0};
    int size = sizeof bound, code = uv_tcp_init(loop, &r->listener);

    if (code == 0) {
        r->listener.data = r;
        r->is_listening = 1;
        code = uv_tcp_bind(&r->listener, (const struct sockaddr *)&address, 0);
    }
    if (code == 0)
        code = uv_listen((uv_stream_t *)&r->listener, BACKLOG, on_connection);
    if (code == 0)
        code = uv_tcp_getsockname(&r->listener, (struct sockaddr *)&bound, &size);
    if (code != 0)
        return error_set(err, STATUS_ERR_IO, "an import cannot be connected with the farm: %s", uv_strerror(code));
    *port = ntohs(((const struct sockaddr_in *)&bound)->sin_port);
    return STATUS_OK;
}

status import_relay_new(struct import_relay **out, struct link_peers *farm, uint16_t *port, struct buffer *key,
                        struct error *err)
{
    struct import_relay *r = mem_calloc(1, sizeof *r);
    struct farm_key own = {0};
    status s;

    *out = NULL;
    NEED(r, err, "an import");
    r->farm = farm;
    s = farm_key_generate(&r->master, err);
    THEN(s, farm_key_derive(&r->master, FARM_ROLE_CLIENT, &own, err));
    if (s == STATUS_OK)
        farm_key_print(&own, key);
    explicit_bzero(&own, sizeof own);
    if (s == STATUS_OK && !buffer_ok(key))
        s = error_no_memory(err, "a key");
    THEN(s, listen_(r, farm->loop, port, err));
    if (s == STATUS_OK)
        *out = r;
    else
        import_relay_end(r);
    return s;
}

void import_relay_end(struct import_relay *r)
{
    if (!r)
        return;
    r->is_ending = 1;
    stop_listening(r);
    if (r->program) {
        channel_close(r->program);
    } else if (r->coordinator) {
        link_close(r->coordinator);
    } else {
        release(r);
    }
}
