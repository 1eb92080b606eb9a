#include "web/api/live.h"

#include <inttypes.h>
#include <jansson.h>
#include <string.h>

#include "common/base/bytes.h"
#include "common/system/clock.h"
#include "common/base/memory.h"
#include "protocol/message.h"
#include "web/api/live_parts.h"
#include "web/base/control.h"
#include "protocol/json/json_wire.h"
#include "web/web.h"

enum {
    LIVE_TEXT_MAX = 4096,        /* bytes of a client's message */
    LIVE_LINGER_MS = 30000,      /* the farm is listened to for so long after the last listener went: it may come back */
    LIVE_COMMENT_MS = 15000,     /* a stream of events without any gets a comment */
};

/* ---- life ------------------------------------------------------------------------------------ */

status live_new(struct live **out, struct web *web, struct error *err)
{
    struct live *live = mem_calloc(1, sizeof *live);

    *out = live;
    NEED(live, err, "the live picture");
    live->web = web;
    events_init(&live->events, (uint64_t)clock_wall_ns());
    return STATUS_OK;
}

static size_t client_queued(const struct live_client *client)
{
    return client->socket ? web_socket_queued(client->socket) : web_queued(client->request);
}

int live_client_has_room(const struct live_client *client) { return client_queued(client) < WEB_QUEUE_HIGH; }

void live_client_free(struct live_client *client)
{
    struct live *live = client->live;

    tiles_end(client);
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
        live_client_free(live->clients);
    events_release(&live->events);
    buffer_release(&live->text);
    buffer_release(&live->json);
    mem_free(live);
}

struct live_client *live_client_new(struct live *live, struct web_socket *socket, struct web_request *request)
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

/* An answer has each message's size before it: u32, little-endian. */
static void send_sized(struct live_client *client, const struct buffer *message)
{
    uint8_t size[4];

    if (!client->begun)
        web_begin(client->request, 200, "application/octet-stream", NULL, 0);
    client->begun = 1;
    bytes_put32(size, (uint32_t)message->size);
    web_write(client->request, size, sizeof size);
    web_write(client->request, message->data, message->size);
}

void live_client_send(struct live_client *client, int binary, const struct buffer *message)
{
    client->sent_ns = clock_monotonic_ns();
    if (!buffer_ok(message)) /* no memory: the client comes again */
        return;
    if (client->socket)
        web_socket_send(client->socket, binary, message->data, message->size);
    else if (client->is_tiles)
        send_sized(client, message);
    else
        web_write(client->request, message->data, message->size);
}

void live_client_tell(struct live_client *client, const char *name, const struct buffer *data)
{
    struct buffer *text = &client->live->text;

    buffer_clear(text);
    buffer_printf(text, "{\"event\":\"%s\",\"data\":", name);
    buffer_append(text, data->data, data->size);
    buffer_puts(text, "}");
    live_client_send(client, 0, text);
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
    live_client_send(client, 0, text);
}

static void send_events(struct live_client *client)
{
    const struct event *event;

    while (client->listens && live_client_has_room(client)) {
        switch (events_next(&client->live->events, &client->seq, &event)) {
        case EVENTS_NONE: return;
        case EVENTS_RESET: send_event(client, "reset", "{}", 2); break;
        case EVENTS_NEXT: send_event(client, event->name, event->json, event->size); break;
        }
    }
}

/* It listens from the event on that it knows, or from now. */
static void begin_listening(struct live_client *client)
{
    struct live *live = client->live;
    int knows = events_parse(&live->events, client->had_id ? client->id : NULL, &client->seq);

    client->waits = 0;
    client->listens = 1;
    if (!knows) {
        client->seq = live->events.last;
        send_event(client, client->had_id ? "reset" : "begin", "{}", 2);
    }
    send_events(client);
}

static void hear(struct live *live, int listens)
{
    Azulejo__Wire__PageListen message = AZULEJO__WIRE__PAGE_LISTEN__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(PAGE_LISTEN, page_listen, &message);

    message.listens = listens;
    live->hearing = listens ? LIVE_ASKS : LIVE_DEAF;
    if (!web_tell(live->web, &envelope))
        live->hearing = LIVE_DEAF; /* the next tick asks again */
}

/* `id`: of the last event that it knows; NULL: it begins, and gets an id to come back with. What it loads afterwards
 * and the events sent to it must overlap, so the farm is listened to first. */
static void listen_from(struct live_client *client, const char *id)
{
    struct live *live = client->live;

    client->had_id = id != NULL;
    snprintf(client->id, sizeof client->id, "%s", id ? id : "");
    client->waits = 1;
    client->listens = 0;
    live->listened_ns = clock_monotonic_ns();
    if (live->hearing == LIVE_HEARS)
        begin_listening(client);
    else if (live->hearing == LIVE_DEAF)
        hear(live, 1);
}

/* ---- WebSockets ------------------------------------------------------------------------------ */

static void refuse(struct live_client *client, const char *why)
{
    struct buffer data = BUFFER_INIT;

    buffer_puts(&data, "{\"detail\":");
    json_put_text(&data, why);
    buffer_puts(&data, "}");
    live_client_tell(client, "refused", &data);
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
    uint32_t serial = (uint32_t)number_of(message, "watch", UINT32_MAX);

    if (serial || client->serial)
        tiles_watch(client, serial, number_of(message, "job", INT64_MAX), (uint32_t)number_of(message, "frame", UINT32_MAX),
                    json_string_value(json_object_get(message, "layer")));
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
    tiles_taken(client);
}

static void on_socket_gone(struct web_socket *socket)
{
    live_client_free(socket->state);
    socket->state = NULL;
}

void live_socket(struct live *live, struct web_socket *socket)
{
    socket->state = live_client_new(live, socket, NULL);
    if (!socket->state) {
        web_socket_close(socket, 1013, "the coordinator has no memory for this now");
        return;
    }
    socket->on_text = on_text;
    socket->on_writable = on_socket_writable;
    socket->on_gone = on_socket_gone;
}

/* ---- server-sent events ---------------------------------------------------------------------- */

static void on_stream_writable(struct web_request *request) { send_events(request->state); }

static void on_stream_gone(struct web_request *request)
{
    live_client_free(request->state);
    request->state = NULL;
}

void live_stream(struct live *live, struct web_request *request)
{
    const char *last = web_header(request, "last-event-id");
    struct live_client *client = live_client_new(live, NULL, request);
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

/* The farm is listened to while somebody does, and a while after. */
static void follow_listeners(struct live *live, uint64_t now_ns)
{
    int listeners = 0;

    for (const struct live_client *c = live->clients; c; c = c->next)
        listeners += c->listens || c->waits;
    if (listeners)
        live->listened_ns = now_ns;
    if (listeners && live->hearing == LIVE_DEAF)
        hear(live, 1);
    else if (live->hearing == LIVE_HEARS && now_ns - live->listened_ns >= LIVE_LINGER_MS * NS_PER_MS)
        hear(live, 0);
}

/* Nothing was said for long: that the stream lives. */
static void send_comment(struct live_client *client, uint64_t now_ns)
{
    static const uint8_t nothing[4];

    client->sent_ns = now_ns;
    if (client->is_tiles)
        web_write(client->request, nothing, sizeof nothing);
    else
        web_write(client->request, ":\n\n", 3);
}

void live_tick(struct live *live, uint64_t now_ns)
{
    follow_listeners(live, now_ns);
    for (struct live_client *c = live->clients, *next; c; c = next) {
        next = c->next;
        send_events(c);
        if (c->request && live_client_has_room(c) && now_ns > c->sent_ns && now_ns - c->sent_ns >= LIVE_COMMENT_MS * NS_PER_MS)
            send_comment(c, now_ns);
        if (c->serial && !c->link && web_is_connected(live->web))
            tiles_again(c);
    }
}

/* ---- what the farm tells --------------------------------------------------------------------- */

/* Whatever happened while the farm was not listened to was missed. */
void live_farm_lost(struct live *live)
{
    live->hearing = LIVE_DEAF;
    events_skip(&live->events);
}

void live_listens(struct live *live, int listens)
{
    if (!listens || live->hearing != LIVE_ASKS)
        return;
    live->hearing = LIVE_HEARS;
    events_skip(&live->events);
    for (struct live_client *c = live->clients; c; c = c->next)
        if (c->waits)
            begin_listening(c);
}

static void add(struct live *live, const char *name, const ProtobufCMessage *message)
{
    buffer_clear(&live->json);
    json_wire_put(&live->json, message);
    if (buffer_ok(&live->json))
        events_add(&live->events, name, live->json.data, live->json.size);
    else
        events_skip(&live->events);
}

void live_change(struct live *live, const Azulejo__Wire__FarmChange *change)
{
    switch (change->change_case) {
    case AZULEJO__WIRE__FARM_CHANGE__CHANGE_JOB: add(live, "job", &change->job->base); break;
    case AZULEJO__WIRE__FARM_CHANGE__CHANGE_LINE: add(live, "log", &change->line->base); break;
    case AZULEJO__WIRE__FARM_CHANGE__CHANGE_WORKERS: add(live, "workers", &change->workers->base); break;
    case AZULEJO__WIRE__FARM_CHANGE__CHANGE_FARM: add(live, "farm", &change->farm->base); break;
    case AZULEJO__WIRE__FARM_CHANGE__CHANGE_JOB_REMOVED:
        buffer_clear(&live->json);
        buffer_puts(&live->json, "{\"job\":");
        json_put_u64(&live->json, change->job_removed);
        buffer_puts(&live->json, "}");
        events_add(&live->events, "job-removed", live->json.data, live->json.size);
        break;
    default: events_skip(&live->events); break;
    }
}
