#include "coordinator/web/live_parts.h"

#include <string.h>

#include <jansson.h>

#include "common/base/clock.h"
#include "common/base/log.h"
#include "common/base/memory.h"
#include "coordinator/web/json_wire.h"

/* ---- life ------------------------------------------------------------------------------------ */

status live_new(struct live **out, struct server *server, struct error *err)
{
    struct live *live = mem_calloc(1, sizeof *live);

    *out = live;
    if (!live)
        return error_no_memory(err, "the live picture");
    live->server = server;
    events_init(&live->events, (uint64_t)clock_wall_ns());
    uv_timer_init(&server->loop, &live->timer);
    live->timer.data = live;
    return STATUS_OK;
}

void live_stop(struct live *live)
{
    if (!live || live->is_stopped)
        return;
    live->is_stopped = 1;
    uv_close((uv_handle_t *)&live->timer, NULL);
}

static void client_free(struct live_client *client)
{
    struct live *live = client->live;

    watch_end(client);
    if (client->next)
        client->next->previous = client->previous;
    *(client->previous ? &client->previous->next : &live->clients) = client->next;
    mem_free(client);
}

void live_free(struct live *live)
{
    if (!live)
        return;
    while (live->clients)
        client_free(live->clients);
    events_release(&live->events);
    feed_release(&live->feed);
    buffer_release(&live->text);
    mem_free(live->cache);
    mem_free(live);
}

static struct live_client *client_new(struct live *live, struct web_socket *socket, struct web_request *request)
{
    struct live_client *client = mem_calloc(1, sizeof *client);

    if (!client)
        return NULL;
    *client = (struct live_client){.live = live, .socket = socket, .request = request, .next = live->clients,
                                   .sent_ns = clock_monotonic_ns()};
    if (live->clients)
        live->clients->previous = client;
    live->clients = client;
    return client;
}

/* ---- sending --------------------------------------------------------------------------------- */

size_t client_queued(const struct live_client *client)
{
    return client->socket ? web_socket_queued(client->socket) : web_queued(client->request);
}

static void client_send(struct live_client *client, const struct buffer *text)
{
    client->sent_ns = clock_monotonic_ns();
    if (!buffer_ok(text)) /* no memory: the client comes again */
        return;
    if (client->socket)
        web_socket_send(client->socket, 0, text->data, text->size);
    else
        web_write(client->request, text->data, text->size);
}

void client_tell(struct live_client *client, const char *name, const struct buffer *data)
{
    struct buffer *text = &client->live->text;

    buffer_clear(text);
    buffer_printf(text, "{\"event\":\"%s\",\"data\":", name);
    buffer_append(text, data->data, data->size);
    buffer_puts(text, "}");
    client_send(client, text);
}

/* One event of the farm, as this kind of client gets it. Without a name only its id. */
static void send_event(struct live_client *client, const char *name, const char *json, size_t size)
{
    struct buffer *text = &client->live->text;
    char id[EVENT_ID_SIZE];

    events_id(&client->live->events, client->seq, id);
    buffer_clear(text);
    if (client->socket)
        buffer_printf(text, "{\"id\":\"%s\",\"event\":\"%s\",\"data\":", id, name);
    else
        buffer_printf(text, "id: %s\nevent: %s\ndata: ", id, name);
    buffer_append(text, json, size);
    buffer_puts(text, client->socket ? "}" : "\n\n");
    client_send(client, text);
}

static void send_events(struct live_client *client)
{
    const struct event *event;

    while (client->listens && client_has_room(client)) {
        switch (events_next(&client->live->events, &client->seq, &event)) {
        case EVENTS_NONE:
            return;
        case EVENTS_RESET:
            send_event(client, "reset", "{}", 2);
            break;
        case EVENTS_NEXT:
            send_event(client, event->name, event->json, event->size);
            break;
        }
    }
}

/* `id`: of the last event that it knows; NULL: it begins, and gets an id to come back with. */
static void listen_from(struct live_client *client, const char *id)
{
    struct live *live = client->live;
    int knows = events_parse(&live->events, id, &client->seq);

    if (!live_is_heard(live, clock_monotonic_ns()))
        feed_begin(&live->feed);
    client->listens = 1;
    live->listened_ns = clock_monotonic_ns();
    if (!knows) {
        client->seq = live->events.last;
        send_event(client, id ? "reset" : "begin", "{}", 2);
    }
    send_events(client);
}

/* ---- WebSockets ------------------------------------------------------------------------------ */

static void refuse(struct live_client *client, const char *why)
{
    struct buffer data = BUFFER_INIT;

    buffer_puts(&data, "{\"detail\":");
    json_put_text(&data, why);
    buffer_puts(&data, "}");
    client_tell(client, "refused", &data);
    buffer_release(&data);
}

static uint64_t number_of(const json_t *object, const char *name, uint64_t most)
{
    const json_t *value = json_object_get(object, name);
    json_int_t number = json_integer_value(value);

    return json_is_integer(value) && number > 0 && (uint64_t)number <= most ? (uint64_t)number : 0;
}

static void take_watch(struct live_client *client, const json_t *message)
{
    const char *layer = json_string_value(json_object_get(message, "layer"));
    uint32_t serial = (uint32_t)number_of(message, "watch", UINT32_MAX);

    watch_end(client);
    if (serial)
        watch_begin(client, serial, number_of(message, "job", INT64_MAX),
                    (uint32_t)number_of(message, "frame", UINT32_MAX), layer ? layer : linear_layer_name(LINEAR_PICTURE));
}

static void on_text(struct web_socket *socket, const char *text, size_t size)
{
    struct live_client *client = socket->state;
    json_error_t error;
    json_t *message = size <= LIVE_TEXT_MAX ? json_loadb(text, size, JSON_REJECT_DUPLICATES, &error) : NULL;

    if (!json_is_object(message))
        refuse(client, "a message is a JSON object of at most 4096 bytes");
    else if (json_object_get(message, "resume"))
        listen_from(client, json_string_value(json_object_get(message, "resume")));
    else if (json_is_integer(json_object_get(message, "watch")))
        take_watch(client, message);
    else
        refuse(client, "unknown message: {\"resume\": ID or null} and {\"watch\": N, \"job\": N, ...} are known");
    json_decref(message);
}

static void on_socket_writable(struct web_socket *socket)
{
    struct live_client *client = socket->state;

    send_events(client);
    if (client->watch.state != WATCH_NONE)
        live_wake(client->live, client->watch.in_turn || client->watch.state == WATCH_STORED);
}

static void on_socket_gone(struct web_socket *socket)
{
    client_free(socket->state);
    socket->state = NULL;
}

void live_socket(struct live *live, struct web_socket *socket)
{
    socket->state = client_new(live, socket, NULL);
    if (!socket->state) {
        web_socket_close(socket, 1013, "the coordinator has no memory for this now");
        return;
    }
    socket->on_text = on_text;
    socket->on_writable = on_socket_writable;
    socket->on_gone = on_socket_gone;
}

/* ---- server-sent events ---------------------------------------------------------------------- */

static void on_stream_writable(struct web_request *request)
{
    send_events(request->state);
}

static void on_stream_gone(struct web_request *request)
{
    client_free(request->state);
    request->state = NULL;
}

void live_stream(struct live *live, struct web_request *request)
{
    const char *last = web_header(request, "last-event-id");
    struct live_client *client = client_new(live, NULL, request);
    struct error err = {0};

    if (!client) {
        error_no_memory(&err, "a stream of events");
        web_fail(request, &err);
        return;
    }
    request->state = client;
    request->on_writable = on_stream_writable;
    request->on_gone = on_stream_gone;
    web_begin(request, 200, "text/event-stream", NULL, 0);
    listen_from(client, last ? last : web_query(request, "after"));
}

/* ---- the clock ------------------------------------------------------------------------------- */

int live_is_heard(const struct live *live, uint64_t now_ns)
{
    return live->listened_ns && now_ns - live->listened_ns < LIVE_LINGER_MS * NS_PER_MS;
}

/* What may be spent on tiles that clients saw before, for this much time. */
static int64_t share_of(const struct live *live, uint64_t passed_ns)
{
    uint64_t threads = live->server->farm.workforce.proven_threads, most_ns = passed_ns / LIVE_SHARE_CORE;
    uint64_t share_ns = threads < LIVE_SHARE / LIVE_SHARE_CORE ? passed_ns / LIVE_SHARE * (threads + !threads) : most_ns;

    return (int64_t)(share_ns < most_ns ? share_ns : most_ns);
}

static void on_timer(uv_timer_t *timer)
{
    struct live *live = timer->data;
    uint64_t begin_ns = clock_monotonic_ns();
    int begins_turn = begin_ns - live->turn_ns >= LIVE_TURN_MS * NS_PER_MS, more = 1, any = 0;

    live->timer_runs = 0;
    if (begins_turn) {
        live->share_ns += share_of(live, begin_ns - live->turn_ns);
        if (live->share_ns > LIVE_SHARE_MAX_NS)
            live->share_ns = LIVE_SHARE_MAX_NS;
        live->turn_ns = begin_ns;
        for (struct live_client *c = live->clients; c; c = c->next)
            if (c->watch.state != WATCH_NONE)
                watch_follow(c, begin_ns);
    }
    while (more && clock_monotonic_ns() - begin_ns < LIVE_TURN_NS) {
        more = 0;
        for (struct live_client *c = live->clients; c; c = c->next)
            if (c->watch.state != WATCH_NONE)
                more |= watch_slice(c, begin_ns, begins_turn);
        begins_turn = 0;
    }
    for (struct live_client *c = live->clients; c; c = c->next) {
        watch_flush(c);
        any |= c->watch.state != WATCH_NONE;
    }
    if (any)
        live_wake(live, more);
}

void live_wake(struct live *live, int at_once)
{
    uint64_t now_ns = clock_monotonic_ns(), next_ns = live->turn_ns + LIVE_TURN_MS * NS_PER_MS;
    uint64_t wait_ms = at_once || now_ns >= next_ns ? LIVE_AGAIN_MS : (next_ns - now_ns) / NS_PER_MS + 1;
    int kind = at_once ? 2 : 1;

    if (live->is_stopped || live->timer_runs >= kind)
        return;
    live->timer_runs = kind;
    /* The loop's clock is that of its last turn. */
    uv_update_time(&live->server->loop);
    uv_timer_start(&live->timer, on_timer, wait_ms, 0);
}

void live_tick(struct live *live, uint64_t now_ns)
{
    int listeners = 0;

    for (struct live_client *c = live->clients; c; c = c->next)
        listeners += c->listens;
    if (listeners)
        live->listened_ns = now_ns;
    if (live_is_heard(live, now_ns))
        feed_tick(live, now_ns);
    for (struct live_client *c = live->clients; c; c = c->next) {
        send_events(c);
        if (c->request && client_has_room(c) && now_ns > c->sent_ns && now_ns - c->sent_ns >= LIVE_COMMENT_MS * NS_PER_MS) {
            c->sent_ns = now_ns;
            web_write(c->request, ":\n\n", 3);
        }
    }
}

/* ---- what the farm tells --------------------------------------------------------------------- */

/* Nobody listens: only the numbers go on. 0: somebody does. */
static int is_unheard(struct live *live)
{
    if (live_is_heard(live, clock_monotonic_ns()))
        return 0;
    events_skip(&live->events);
    return 1;
}

void live_job_changed(struct live *live, const struct job *job)
{
    if (!is_unheard(live))
        feed_job_changed(live, job->id);
}

void live_job_removed(struct live *live, uint64_t job)
{
    if (!is_unheard(live))
        feed_job_removed(live, job);
}

void live_workers_changed(struct live *live)
{
    if (!is_unheard(live))
        live->feed.workers_changed = 1;
}

void live_job_event(struct live *live, const struct job_event *event)
{
    if (!is_unheard(live))
        feed_job_event(live, event);
}
