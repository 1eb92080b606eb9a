#include "client/link/connection.h"

#include <assert.h>
#include <stdio.h>
#include <pwd.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <uv.h>

#include "client/link/signals.h"
#include "client/terminal/must.h"
#include "common/system/log.h"
#include "common/base/memory.h"
#include "protocol/channel.h"
#include "protocol/message.h"

enum {
    INBOX_MAX = 4096,        /* unasked-for messages kept; more is a protocol violation */
    CLOSE_LIMIT_MS = 3000,   /* how long a goodbye may take */
    SILENCE_MS = 5000,       /* is said after this, by those who wait for longer */
};

struct inbox_message {
    struct inbox_message *next;
    Azulejo__Wire__Envelope *envelope;
};

struct connection {
    uv_loop_t loop;
    struct channel *channel; /* NULL once its on_close ran */
    uv_timer_t deadline;     /* running while a call waits, */
    uv_timer_t silence;      /* and this one where silence is said */
    int says_silence, was_silent;
    uv_timer_t heartbeat;
    uv_poll_t signals;
    int signals_polled;
    int opened, timed_out, woken;
    struct inbox_message *inbox, **inbox_end;
    size_t inbox_count;
    uint64_t last_request;
    double timeout_s;
    connection_watch_fn watch;
    void *watch_user;
    struct error broken; /* why the channel ended; code OK while it is open */
    int ended;
    char address[CONNECTION_HOST_MAX + 16];
    char who[CONNECTION_WHO_MAX];
    struct farm_key key; /* lives as long as the channel may use it */
};

/* ---- what the channel tells us ----------------------------------------------------------- */

static void on_open(struct channel *channel UNUSED, void *user)
{
    struct connection *c = user;

    c->opened = 1;
}

static void on_message(struct channel *channel, const Azulejo__Wire__Envelope *message, void *user)
{
    struct connection *c = user;
    struct inbox_message *item = NULL;
    struct error why = {0};
    uint8_t *bytes = NULL;
    size_t size;
    status result;

    if (message->body_case == AZULEJO__WIRE__ENVELOPE__BODY_HEARTBEAT)
        return;
    if (message->body_case == AZULEJO__WIRE__ENVELOPE__BODY_NOTICE) {
        unsigned level = message->notice->level;
        char text[MESSAGE_TEXT_MAX];
        log_line(level > LOG_LEVEL_DEBUG ? LOG_LEVEL_DEBUG : (enum log_level)level, "coordinator: %s",
                 message_text(text, sizeof text, message->notice->text));
        return;
    }
    if (c->inbox_count >= INBOX_MAX) {
        channel_abort(channel, STATUS_ERR_PROTOCOL, "the coordinator sent more than %d messages that was not requested",
                      INBOX_MAX);
        return;
    }
    /* The envelope is only borrowed: keep a copy, made through its wire form. */
    size = azulejo__wire__envelope__get_packed_size(message);
    bytes = must(mem_alloc(size));
    item = must(mem_calloc(1, sizeof *item));
    azulejo__wire__envelope__pack(message, bytes);
    result = message_unpack(&item->envelope, bytes, size, &why);
    mem_free(bytes);
    if (result != STATUS_OK) {
        mem_free(item);
        channel_abort(channel, result, "%s", why.text);
        return;
    }
    *c->inbox_end = item;
    c->inbox_end = &item->next;
    c->inbox_count++;
}

static void on_drain(struct channel *channel UNUSED, void *user)
{
    (void)user; /* the sender checks the queue's length after each iteration of the loop */
}

static void on_channel_close(struct channel *channel UNUSED, const struct error *why, void *user)
{
    struct connection *c = user;

    c->channel = NULL;
    c->ended = 1;
    c->broken = *why;
    if (why->code == STATUS_OK)
        error_set(&c->broken, STATUS_ERR_UNREACHABLE,
                  "the coordinator at %s ended the connection (it is being stopped?)", c->address);
}

static const struct channel_callbacks callbacks = {
    .on_open = on_open,
    .on_message = on_message,
    .on_drain = on_drain,
    .on_close = on_channel_close,
};

static void on_deadline(uv_timer_t *timer) { ((struct connection *)timer->data)->timed_out = 1; }

static void on_silence(uv_timer_t *timer)
{
    struct connection *c = timer->data;

    if (!c->was_silent)
        fprintf(stderr, "%sthe coordinator at %s does not answer; waiting for it\n", isatty(STDERR_FILENO) ? "\n" : "", c->address);
    c->was_silent = 1;
}

static void on_heartbeat(uv_timer_t *timer)
{
    struct connection *c = timer->data;

    if (c->channel && message_send_heartbeat(c->channel) != STATUS_OK) {
        /* The channel closes by itself; on_close gets the reason. */
    }
}

static void on_signal(uv_poll_t *poll, int result UNUSED, int events UNUSED)
{
    struct connection *c = poll->data;

    signals_drain();
    c->woken = 1;
}

/* ---- waiting ------------------------------------------------------------------------------ */

static void timer_arm(struct connection *c)
{
    c->timed_out = 0;
    uv_update_time(&c->loop);
    uv_timer_start(&c->deadline, on_deadline, (uint64_t)(c->timeout_s * 1000) + 1, 0);
    if (c->says_silence)
        uv_timer_start(&c->silence, on_silence, SILENCE_MS, 0);
}

static void timer_stop(struct connection *c, status result)
{
    uv_timer_stop(&c->deadline);
    uv_timer_stop(&c->silence);
    if (c->was_silent && result == STATUS_OK) {
        fprintf(stderr, "the coordinator at %s answers again\n", c->address);
        c->was_silent = 0;
    }
}

static status look_at_signals(struct connection *c, struct error *err)
{
    if (!c->woken)
        return STATUS_OK;
    c->woken = 0;
    return c->watch ? c->watch(c->watch_user, err) : STATUS_OK;
}

/* Run one iteration of the loop; returns the error of the connection, the watch or the deadline. */
static status wait_turn(struct connection *c, const char *what, struct error *err)
{
    if (c->ended) {
        if (err)
            *err = c->broken;
        return c->broken.code;
    }
    if (c->timed_out)
        return error_set(err, STATUS_ERR_TIMEOUT, "no %s from the coordinator at %s within %g seconds (--timeout)",
                         what, c->address, c->timeout_s);
    TRY(look_at_signals(c, err));
    uv_run(&c->loop, UV_RUN_ONCE);
    return look_at_signals(c, err);
}

static struct inbox_message **inbox_find(struct connection *c, uint64_t request)
{
    for (struct inbox_message **at = &c->inbox; *at; at = &(*at)->next)
        if (request == 0 || (*at)->envelope->request == request)
            return at;
    return NULL;
}

static Azulejo__Wire__Envelope *inbox_take(struct connection *c, struct inbox_message **at)
{
    struct inbox_message *item = *at;
    Azulejo__Wire__Envelope *envelope = item->envelope;

    *at = item->next;
    if (!*at)
        c->inbox_end = at;
    c->inbox_count--;
    mem_free(item);
    return envelope;
}

status connection_receive(struct connection *c, uint64_t request, Azulejo__Wire__Envelope **out, struct error *err)
{
    struct inbox_message **at;
    status result = STATUS_OK;

    *out = NULL;
    timer_arm(c);
    while (!(at = inbox_find(c, request))) {
        /* A Failure without a request number is for the waiting caller. */
        if (request && (at = inbox_find(c, 0)) && (*at)->envelope->request == 0 &&
            (*at)->envelope->body_case == AZULEJO__WIRE__ENVELOPE__BODY_FAILURE)
            break;
        result = wait_turn(c, "answer", err);
        if (result != STATUS_OK)
            break;
    }
    timer_stop(c, result);
    if (result != STATUS_OK)
        return result;
    *out = inbox_take(c, at);
    if ((*out)->body_case == AZULEJO__WIRE__ENVELOPE__BODY_FAILURE) {
        result = message_failure_get((*out)->failure, err);
        message_free(*out);
        *out = NULL;
    }
    return result;
}

int connection_pump(struct connection *c, uint64_t request)
{
    if (!c->ended)
        uv_run(&c->loop, UV_RUN_NOWAIT);
    return inbox_find(c, request) != NULL;
}

uint64_t connection_request_id(struct connection *c) { return ++c->last_request; }

status connection_send(struct connection *c, Azulejo__Wire__Envelope *message, struct error *err)
{
    status result = look_at_signals(c, err);

    timer_arm(c);
    while (result == STATUS_OK && c->channel && channel_queued_bytes(c->channel) > CHANNEL_QUEUE_HIGH) {
        size_t before = channel_queued_bytes(c->channel);
        result = wait_turn(c, "progress", err);
        if (c->channel && channel_queued_bytes(c->channel) < before)
            timer_arm(c);
    }
    timer_stop(c, result);
    if (result != STATUS_OK)
        return result;
    if (!c->channel) {
        if (err)
            *err = c->broken;
        return c->broken.code;
    }
    result = channel_send(c->channel, message);
    if (result != STATUS_OK)
        return error_set(err, result, "a message to %s could not be sent: %s", c->address, status_text(result));
    return STATUS_OK;
}

status connection_ask(struct connection *c, Azulejo__Wire__Envelope *question,
                      Azulejo__Wire__Envelope__BodyCase expected, Azulejo__Wire__Envelope **out, struct error *err)
{
    status result;

    *out = NULL;
    question->request = connection_request_id(c);
    result = connection_send(c, question, err);
    THEN(result, connection_receive(c, question->request, out, err));
    assert(result != STATUS_OK || *out);
    if (result == STATUS_OK && (*out)->body_case != expected) {
        result = error_set(err, STATUS_ERR_PROTOCOL,
                           "the coordinator at %s answered with message %d, not %d: are both of "
                           "the same version?",
                           c->address, (int)(*out)->body_case, (int)expected);
        message_free(*out);
        *out = NULL;
    }
    return result;
}

/* ---- opening and closing ------------------------------------------------------------------ */

void connection_set_watch(struct connection *c, connection_watch_fn watch, void *user)
{
    c->watch = watch;
    c->watch_user = user;
    if (!c->signals_polled && signals_fd() >= 0 &&
        uv_poll_init(&c->loop, &c->signals, signals_fd()) == 0) {
        c->signals.data = c;
        c->signals_polled = 1;
        uv_poll_start(&c->signals, UV_READABLE, on_signal);
    }
}

const char *connection_address(const struct connection *c) { return c->address; }

/* The login name, cleaned; it may be empty. */
static void user_name(char out[64])
{
    const struct passwd *entry = getpwuid(getuid());
    const char *name = entry ? entry->pw_name : getenv("USER");

    message_text(out, 64, name ? name : "");
}

const char *connection_who(const struct connection *c) { return c->who; }

static status say_hello(struct connection *c, enum farm_role role, struct error *err)
{
    Azulejo__Wire__Envelope envelope = AZULEJO__WIRE__ENVELOPE__INIT;
    Azulejo__Wire__Hello hello = AZULEJO__WIRE__HELLO__INIT;
    Azulejo__Wire__Envelope *answer = NULL;
    char software[] = "azulejo " AZULEJO_VERSION;
    char host[256] = "", user[64];
    uint64_t beat_ms;
    status result;

    gethostname(host, sizeof host - 1);
    hello.protocol_version = PROTOCOL_VERSION;
    hello.role = (Azulejo__Wire__Role)role;
    hello.software = software;
    hello.host = host;
    user_name(user);
    hello.user = user;
    hello.process = (uint32_t)getpid();
    envelope.body_case = AZULEJO__WIRE__ENVELOPE__BODY_HELLO;
    envelope.hello = &hello;
    TRY(connection_ask(c, &envelope, AZULEJO__WIRE__ENVELOPE__BODY_WELCOME, &answer, err));
    result = welcome_check(answer->welcome, err);
    if (result == STATUS_OK) {
        message_text(c->who, sizeof c->who, answer->welcome->who);
        /* Twice as often as required, so that a small delay does no harm. */
        beat_ms = answer->welcome->heartbeat_ms / 2;
        uv_timer_start(&c->heartbeat, on_heartbeat, beat_ms, beat_ms);
    }
    message_free(answer);
    return result;
}

static status connection_init(struct connection **out, struct error *err)
{
    struct connection *c = must(mem_calloc(1, sizeof *c));

    *out = NULL;
    c->inbox_end = &c->inbox;
    if (uv_loop_init(&c->loop) != 0) {
        mem_free(c);
        return error_set(err, STATUS_ERR_INTERNAL, "no event loop");
    }
    uv_timer_init(&c->loop, &c->deadline);
    uv_timer_init(&c->loop, &c->silence);
    uv_timer_init(&c->loop, &c->heartbeat);
    c->deadline.data = c;
    c->silence.data = c;
    c->heartbeat.data = c;
    *out = c;
    return STATUS_OK;
}

status connection_open(struct connection **out, const struct connection_options *options, struct error *err)
{
    struct connection *c = NULL;
    char host[CONNECTION_HOST_MAX];
    struct farm_key key;
    enum farm_role role;
    uint16_t port;
    status result;

    *out = NULL;
    TRY(connection_options_resolve(options, host, &port, &key, err));
    role = key.is_farm ? FARM_ROLE_CLIENT : key.id.role;
    if (role == FARM_ROLE_WORKER) {
        result = error_set(err, STATUS_ERR_REFUSED,
                           "this is a worker's key: commands need a client's "
                           "(azulejo key new NAME --role submit)");
        goto done;
    }
    result = connection_init(&c, err);
    if (result != STATUS_OK)
        goto done;
    c->timeout_s = options->timeout_s;
    c->says_silence = options->patience_s && *options->patience_s > 0 && !(options->quiet && *options->quiet);
    c->key = key;
    snprintf(c->address, sizeof c->address, strchr(host, ':') ? "[%s]:%u" : "%s:%u", host, port);
    connection_set_watch(c, options->watch, options->watch_user);
    result = channel_connect(&c->channel, &c->loop, host, port, &c->key, role, &callbacks, c, err);
    if (result != STATUS_OK)
        goto failed;
    timer_arm(c);
    while (result == STATUS_OK && !c->opened)
        result = wait_turn(c, "connection", err);
    timer_stop(c, result);
    THEN(result, say_hello(c, role, err));
    if (result == STATUS_OK)
        goto done;
failed:
    if (result == STATUS_ERR_UNREACHABLE) {
        error_prefix(err, "no coordinator can be reached");
        if (err)
            snprintf(err->text + strlen(err->text), sizeof err->text - strlen(err->text),
                     " (--coordinator HOST:PORT names another)");
    } else if (result == STATUS_ERR_REFUSED) {
        error_prefix(err, "the coordinator at %s refused", c->address);
    }
    connection_close(c);
    c = NULL;
done:
    explicit_bzero(&key, sizeof key);
    *out = c;
    return result;
}

void connection_close(struct connection *c)
{
    if (!c)
        return;
    uv_timer_stop(&c->heartbeat);
    if (c->channel) {
        channel_close(c->channel);
        c->timed_out = 0;
        uv_update_time(&c->loop);
        uv_timer_start(&c->deadline, on_deadline, CLOSE_LIMIT_MS, 0);
        while (c->channel && !c->timed_out)
            uv_run(&c->loop, UV_RUN_ONCE);
        if (c->channel)
            channel_abort(c->channel, STATUS_ERR_TIMEOUT, "the goodbye took too long");
    }
    uv_close((uv_handle_t *)&c->deadline, NULL);
    uv_close((uv_handle_t *)&c->silence, NULL);
    uv_close((uv_handle_t *)&c->heartbeat, NULL);
    if (c->signals_polled) {
        uv_poll_stop(&c->signals);
        uv_close((uv_handle_t *)&c->signals, NULL);
    }
    uv_run(&c->loop, UV_RUN_DEFAULT);
    uv_loop_close(&c->loop);
    while (c->inbox)
        message_free(inbox_take(c, &c->inbox));
    explicit_bzero(&c->key, sizeof c->key);
    mem_free(c);
}
