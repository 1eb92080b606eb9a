#include "web/api/live.h"

#include <inttypes.h>
#include <jansson.h>
#include <string.h>

#include "common/base/bytes.h"
#include "common/system/clock.h"
#include "common/base/memory.h"
#include "protocol/message.h"
#include "web/base/control.h"
#include "web/base/events.h"
#include "protocol/json/json_wire.h"
#include "web/base/link.h"
#include "web/web.h"

enum {
    LIVE_TEXT_MAX = 4096,        /* bytes of a client's message */
    LIVE_LINGER_MS = 30000,      /* the farm is listened to for so long after the last listener went: it may come back */
    LIVE_COMMENT_MS = 15000,     /* a stream of events without any gets a comment */
    LIVE_MESSAGE_HEADER = 12,
};

struct live_client {
    struct live_client *next, *previous;
    struct live *live;
    struct web_socket *socket;   /* or */
    struct web_request *request; /* a stream of server-sent events */
    int listens;
    int waits;              /* to listen, until the farm is listened to, */
    char id[EVENT_ID_SIZE]; /* from this event on; "": from now, and a reset if it had an id */
    int had_id;
    uint64_t seq; /* of the last event that it got */
    uint64_t sent_ns;
    struct tile_link *link; /* that brings it a picture's tiles; NULL: none yet */
    uint32_t serial;        /* of what it watches; 0: nothing, else: */
    uint64_t job;
    uint32_t frame;
    char layer[64];
    uint64_t asked;      /* the number of the request for it */
    uint64_t sent_bytes; /* of tiles, not yet acknowledged to the farm */
};

/* A connection to the farm, for one client that watches. */
struct tile_link {
    struct live_client *client; /* NULL: it went */
    struct link_peer *peer;
};

enum hearing { LIVE_DEAF, LIVE_ASKS, LIVE_HEARS };

struct live {
    struct web *web;
    struct events events;
    enum hearing hearing; /* what the farm says */
    uint64_t listened_ns; /* somebody listened last; 0: never */
    struct live_client *clients;
    uint64_t last_asked;
    struct buffer text, json;
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

static int client_has_room(const struct live_client *client) { return client_queued(client) < WEB_QUEUE_HIGH; }

static void client_free(struct live_client *client)
{
    struct live *live = client->live;

    if (client->link) {
        client->link->client = NULL;
        link_close(client->link->peer);
    }
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
    buffer_release(&live->text);
    buffer_release(&live->json);
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

static void client_tell(struct live_client *client, const char *name, const struct buffer *data)
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

/* ---- a frame's tiles --------------------------------------------------------------------------- */

static void put_field(struct buffer *out, const char *name, uint64_t value)
{
    buffer_printf(out, "%s\"%s\":%" PRIu64, out->size > 1 ? "," : "", name, value);
}

static void tell_picture(struct live_client *client, const Azulejo__Wire__TilesPicture *p)
{
    struct buffer data = BUFFER_INIT;

    buffer_puts(&data, "{");
    put_field(&data, "watch", client->serial);
    put_field(&data, "job", p->job);
    put_field(&data, "frame", p->frame);
    put_field(&data, "width", p->width);
    put_field(&data, "height", p->height);
    put_field(&data, "tiles_x", p->tiles_x);
    put_field(&data, "tiles_y", p->tiles_y);
    buffer_puts(&data, ",\"layer\":");
    json_put_text(&data, p->layer);
    buffer_puts(&data, ",\"layers\":[");
    for (size_t i = 0; i < p->n_layers; i++) {
        buffer_puts(&data, i ? "," : "");
        json_put_text(&data, p->layers[i]);
    }
    buffer_printf(&data, "],\"complete\":%s,\"linear\":true}", p->complete ? "true" : "false");
    client_tell(client, "picture", &data);
    buffer_release(&data);
}

static void tell_done(struct live_client *client, const char *why)
{
    struct buffer data = BUFFER_INIT;

    buffer_puts(&data, "{");
    put_field(&data, "watch", client->serial);
    if (why[0]) {
        buffer_puts(&data, ",\"error\":");
        json_put_text(&data, why);
    }
    buffer_puts(&data, "}");
    client_tell(client, "picture-done", &data);
    buffer_release(&data);
}

static void send_tiles(struct live_client *client, const Azulejo__Wire__Tiles *tiles)
{
    struct buffer *text = &client->live->text;
    uint8_t *header;

    buffer_clear(text);
    header = buffer_append_space(text, LIVE_MESSAGE_HEADER);
    if (header) {
        memcpy(header, "AZL1", 4);
        bytes_put32(header + 4, client->serial);
        bytes_put32(header + 8, tiles->count);
    }
    buffer_append(text, tiles->records.data, tiles->records.len);
    if (buffer_ok(text))
        web_socket_send(client->socket, 1, text->data, text->size);
}

/* The farm sends no more than the client takes. */
static void tell_taken(struct live_client *client)
{
    Azulejo__Wire__TilesTaken taken = AZULEJO__WIRE__TILES_TAKEN__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(TILES_TAKEN, tiles_taken, &taken);

    if (!client->link || client->sent_bytes == 0 || !client_has_room(client))
        return;
    taken.bytes = client->sent_bytes;
    client->sent_bytes = 0;
    (void)!link_send(client->link->peer, &envelope, NULL); /* if not, the connection ends */
}

static void on_tiles(void *user, const Azulejo__Wire__Envelope *message)
{
    struct live_client *client = ((struct tile_link *)user)->client;
    int is_current;

    if (!client)
        return;
    is_current = client->serial && message->request == client->asked;
    if (message->body_case == AZULEJO__WIRE__ENVELOPE__BODY_TILES) {
        client->sent_bytes += message->tiles->records.len;
        if (is_current)
            send_tiles(client, message->tiles);
        tell_taken(client);
    } else if (is_current && message->body_case == AZULEJO__WIRE__ENVELOPE__BODY_TILES_PICTURE) {
        tell_picture(client, message->tiles_picture);
    } else if (is_current && message->body_case == AZULEJO__WIRE__ENVELOPE__BODY_TILES_DONE) {
        tell_done(client, message->tiles_done->why);
    } else if (is_current && message->body_case == AZULEJO__WIRE__ENVELOPE__BODY_FAILURE) {
        tell_done(client, message->failure->text);
    }
}

/* The client watches again when the farm is back (live_tick). */
static void on_link_end(void *user, const struct error *why UNUSED)
{
    struct tile_link *link = user;

    if (link->client)
        link->client->link = NULL;
    mem_free(link);
}

static struct tile_link *link_new(struct live_client *client, struct error *err)
{
    static const struct link_callbacks callbacks = {on_tiles, NULL, on_link_end};
    struct tile_link *link = mem_calloc(1, sizeof *link);

    if (!link) {
        error_no_memory(err, "the live picture");
        return NULL;
    }
    link->client = client;
    if (link_open(&link->peer, &client->live->web->farm, client->socket->caller.token, &callbacks, link, err) != STATUS_OK) {
        mem_free(link);
        return NULL;
    }
    return link;
}

/* Ask for the tiles of what it watches. */
static void ask_tiles(struct live_client *client)
{
    Azulejo__Wire__TilesWatch watch = AZULEJO__WIRE__TILES_WATCH__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(TILES_WATCH, tiles_watch, &watch);
    struct error err = {0};

    if (!client->link) {
        client->sent_bytes = 0;
        client->link = link_new(client, &err);
    }
    watch.job = client->serial ? client->job : 0;
    watch.frame = client->frame;
    watch.layer = client->layer;
    envelope.request = client->asked = ++client->live->last_asked;
    if (client->link && link_send(client->link->peer, &envelope, &err) == STATUS_OK)
        return;
    tell_done(client, err.text);
    client->serial = 0;
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

    if (!serial && !client->serial)
        return;
    client->serial = serial;
    client->job = number_of(message, "job", INT64_MAX);
    client->frame = (uint32_t)number_of(message, "frame", UINT32_MAX);
    snprintf(client->layer, sizeof client->layer, "%s", layer ? layer : "");
    if (serial && !client->job) {
        tell_done(client, "job 0: there is none of that number");
        client->serial = 0;
    }
    ask_tiles(client);
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
    tell_taken(client);
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

static void on_stream_writable(struct web_request *request) { send_events(request->state); }

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

void live_tick(struct live *live, uint64_t now_ns)
{
    follow_listeners(live, now_ns);
    for (struct live_client *c = live->clients; c; c = c->next) {
        send_events(c);
        if (c->serial && !c->link && web_is_connected(live->web))
            ask_tiles(c);
        if (c->request && client_has_room(c) && now_ns > c->sent_ns && now_ns - c->sent_ns >= LIVE_COMMENT_MS * NS_PER_MS) {
            c->sent_ns = now_ns;
            web_write(c->request, ":\n\n", 3);
        }
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
