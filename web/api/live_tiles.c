/* A frame's tiles, for one client: over a WebSocket, or as the answer to a request. */
#include <inttypes.h>
#include <string.h>

#include "common/base/bytes.h"
#include "common/base/memory.h"
#include "protocol/json/json_wire.h"
#include "protocol/message.h"
#include "web/api/call.h"
#include "web/api/live_parts.h"
#include "web/base/link.h"
#include "web/base/problem.h"
#include "web/web.h"

enum {
    TILES_HEADER = 12,       /* bytes of a message of tiles before its records */
    TILES_ANSWER_SERIAL = 1, /* an answer has one watch */
};

/* A connection to the farm, for one client that watches. */
struct tile_link {
    struct live_client *client; /* NULL: it went */
    struct link_peer *peer;
};

void tiles_end(struct live_client *client)
{
    if (!client->link)
        return;
    client->link->client = NULL;
    link_close(client->link->peer);
    client->link = NULL;
}

/* ---- what the client is told --------------------------------------------------------------------- */

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
    live_client_tell(client, "picture", &data);
    buffer_release(&data);
}

/* All of it was sent, or with `why` nothing more will come. */
static void tell_done(struct live_client *client, const struct error *why)
{
    struct buffer data = BUFFER_INIT;

    buffer_puts(&data, "{");
    put_field(&data, "watch", client->serial);
    if (why) {
        buffer_puts(&data, ",\"error\":");
        json_put_text(&data, why->text);
    }
    buffer_puts(&data, "}");
    live_client_tell(client, "picture-done", &data);
    buffer_release(&data);
}

static void send_tiles(struct live_client *client, const Azulejo__Wire__Tiles *tiles)
{
    struct buffer *message = &client->live->text;
    uint8_t *header;

    buffer_clear(message);
    header = buffer_append_space(message, TILES_HEADER);
    if (header) {
        memcpy(header, "AZL1", 4);
        bytes_put32(header + 4, client->serial);
        bytes_put32(header + 8, tiles->count);
    }
    buffer_append(message, tiles->records.data, tiles->records.len);
    live_client_send(client, 1, message);
}

/* ---- the end of an answer -------------------------------------------------------------------------- */

/* The request, which goes on without the client. */
static struct web_request *let_go(struct live_client *client)
{
    struct web_request *request = client->request;

    request->state = NULL;
    request->on_gone = NULL;
    request->on_writable = NULL;
    live_client_free(client);
    return request;
}

/* Nothing will come of what it watches. An answer that has not begun says so by its status. */
static void refuse(struct live_client *client, enum problem problem, const struct error *why)
{
    if (client->is_tiles && !client->begun) {
        problem_answer(let_go(client), problem, why->text);
        return;
    }
    tell_done(client, why);
    if (client->is_tiles)
        web_end(let_go(client));
}

/* One frame's answer ends with it; frame 0 is followed by the next one. */
static void finish(struct live_client *client)
{
    tell_done(client, NULL);
    if (client->is_tiles && client->frame)
        web_end(let_go(client));
}

/* ---- the farm ---------------------------------------------------------------------------------------- */

/* It sends no more than the client takes. */
void tiles_taken(struct live_client *client)
{
    Azulejo__Wire__TilesTaken taken = AZULEJO__WIRE__TILES_TAKEN__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(TILES_TAKEN, tiles_taken, &taken);

    if (!client->link || client->sent_bytes == 0 || !live_client_has_room(client))
        return;
    taken.bytes = client->sent_bytes;
    client->sent_bytes = 0;
    (void)!link_send(client->link->peer, &envelope, NULL); /* if not, the connection ends */
}

static void take_message(struct live_client *client, const Azulejo__Wire__Envelope *message)
{
    struct error why = {0};

    switch (message->body_case) {
    case AZULEJO__WIRE__ENVELOPE__BODY_TILES: send_tiles(client, message->tiles); break;
    case AZULEJO__WIRE__ENVELOPE__BODY_TILES_PICTURE: tell_picture(client, message->tiles_picture); break;
    case AZULEJO__WIRE__ENVELOPE__BODY_TILES_DONE: finish(client); break;
    case AZULEJO__WIRE__ENVELOPE__BODY_FAILURE:
        (void)!message_failure_get(message->failure, &why);
        refuse(client, problem_of_farm(why.code), &why);
        break;
    default: break;
    }
}

static void on_message(void *user, const Azulejo__Wire__Envelope *message)
{
    struct tile_link *link = user;
    struct live_client *client = link->client;

    if (!client)
        return;
    if (message->body_case == AZULEJO__WIRE__ENVELOPE__BODY_TILES)
        client->sent_bytes += message->tiles->records.len;
    if (client->serial && message->request == client->asked)
        take_message(client, message);
    if (link->client && message->body_case == AZULEJO__WIRE__ENVELOPE__BODY_TILES)
        tiles_taken(client);
}

/* What has begun is asked for again when the farm is back (live_tick). */
static void on_link_end(void *user, const struct error *why)
{
    struct tile_link *link = user;
    struct live_client *client = link->client;

    if (client)
        client->link = NULL;
    if (client && client->is_tiles && !client->begun)
        problem_answer_lost(let_go(client), why);
    mem_free(link);
}

static struct tile_link *link_new(struct live_client *client, struct error *err)
{
    static const struct link_callbacks callbacks = {on_message, NULL, on_link_end};
    const struct web_caller *caller = client->socket ? &client->socket->caller : &client->request->caller;
    struct tile_link *link = mem_calloc(1, sizeof *link);

    if (!link) {
        error_no_memory(err, "the live picture");
        return NULL;
    }
    link->client = client;
    if (link_open(&link->peer, &client->live->web->farm, caller->token, &callbacks, link, err) != STATUS_OK) {
        mem_free(link);
        return NULL;
    }
    return link;
}

void tiles_again(struct live_client *client)
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
    if (client->socket) {
        tell_done(client, &err);
        client->serial = 0;
    } else {
        refuse(client, problem_of_request(err.code, 1), &err);
    }
}

void tiles_watch(struct live_client *client, uint32_t serial, uint64_t job, uint32_t frame, const char *layer)
{
    struct error err = {0};

    client->serial = serial;
    client->job = job;
    client->frame = frame;
    snprintf(client->layer, sizeof client->layer, "%s", layer ? layer : "");
    if (serial && !job) {
        error_set(&err, STATUS_ERR_NOT_FOUND, "job 0: there is none of that number");
        tell_done(client, &err);
        client->serial = 0;
    }
    tiles_again(client);
}

/* ---- as an answer -------------------------------------------------------------------------------------- */

static void on_gone(struct web_request *request)
{
    live_client_free(request->state);
    request->state = NULL;
}

static void on_writable(struct web_request *request) { tiles_taken(request->state); }

void live_tiles(struct live *live, struct web_request *request)
{
    struct live_client *client;
    Azulejo__Wire__Envelope envelope;
    struct error err = {0};
    ProtobufCMessage *body;

    if (web_call_message(request, &envelope, &body, &err) != STATUS_OK) {
        web_fail(request, &err);
        return;
    }
    client = live_client_new(live, NULL, request);
    if (client) {
        client->is_tiles = 1;
        request->state = client;
        request->on_writable = on_writable;
        request->on_gone = on_gone;
        tiles_watch(client, TILES_ANSWER_SERIAL, envelope.tiles_watch->job, envelope.tiles_watch->frame,
                    web_query(request, "layer"));
    } else {
        problem_answer(request, PROBLEM_UNAVAILABLE, "out of memory for the live picture");
    }
    json_wire_free(body);
}
