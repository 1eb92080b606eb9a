/* live: what pages see without asking: events of the farm, and a picture while it is rendered. docs/API.md has the
 * messages.
 *
 *   FarmChange --events.h--> every listener: a WebSocket, or a stream of server-sent events
 *   Tiles, of a connection of its own --> the WebSocket or the request that watches; TilesTaken as it takes them
 *
 * A client is never waited for: a slow one misses events, and is sent a reset, and older states of tiles, which are not
 * needed. What is queued for it is at most twice WEB_QUEUE_HIGH. Without listeners the farm sends nothing. When the
 * coordinator was away, listeners are asked to load everything again, and what is watched is asked for again.
 *
 * All on the loop's thread. live_new's caller owns it; sockets and requests stay http.c's.
 */
#pragma once

#include "protocol/azulejo.pb-c.h"
#include "web/api/request.h"

struct live;

/* ERR_NO_MEMORY. */
status live_new(struct live **out, struct web *web, struct error *err) MUST_CHECK;
/* When the loop has ended; NULL is fine. */
void live_free(struct live *live);

/* What the coordinator says, and that it went. */
void live_listens(struct live *live, int listens);
void live_change(struct live *live, const Azulejo__Wire__FarmChange *change);
void live_farm_lost(struct live *live);
void live_tick(struct live *live, uint64_t now_ns);

/* A WebSocket of /api/v1/live is open. */
void live_socket(struct live *live, struct web_socket *socket);
/* GET /api/v1/events: server-sent events. */
void live_stream(struct live *live, struct web_request *request);
/* GET /api/v1/jobs/{job}/frames/{frame}/live: a frame's tiles as one answer. */
void live_tiles(struct live *live, struct web_request *request);
