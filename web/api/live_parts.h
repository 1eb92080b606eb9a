/* live_parts: the inside of live, private to its files.
 *
 * live.c        clients, the farm's events, WebSockets, server-sent events, the clock
 * live_tiles.c  a frame's tiles: over a WebSocket, or as the answer to a request
 */
#pragma once

#include "common/base/buffer.h"
#include "web/api/live.h"
#include "web/base/events.h"

struct live_client {
    struct live_client *next, *previous;
    struct live *live;
    struct web_socket *socket;   /* or */
    struct web_request *request; /* a stream of server-sent events, or of a frame's tiles */
    int is_tiles;                /* the latter */
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
    int begun;           /* the answer to its request */
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

/* NULL: no memory. */
struct live_client *live_client_new(struct live *live, struct web_socket *socket, struct web_request *request);
void live_client_free(struct live_client *client);
int live_client_has_room(const struct live_client *client);
void live_client_send(struct live_client *client, int binary, const struct buffer *message);
/* An event without an id, to this client alone. */
void live_client_tell(struct live_client *client, const char *name, const struct buffer *data);

/* Watch from now on what the message says; a watch of 0: nothing. */
void tiles_watch(struct live_client *client, uint32_t serial, uint64_t job, uint32_t frame, const char *layer);
/* The connection that brought its tiles was lost: ask again. Frees a client whose answer ends with it. */
void tiles_again(struct live_client *client);
/* Tell the farm what the client took, if it has room. */
void tiles_taken(struct live_client *client);
/* The client goes. */
void tiles_end(struct live_client *client);
