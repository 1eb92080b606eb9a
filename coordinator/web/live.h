/* live: what pages see without asking: events of the farm, and a picture while it is rendered. docs/API.md has the
 * messages.
 *
 *   farm changes --feed.h--> events.h --> every listener: a WebSocket, or a stream of server-sent events
 *   a frame's tiles --picture.h--> linear.h --> the WebSockets that watch it
 *
 * A client is never waited for: a slow one misses events, and is told so, and older states of tiles, which nobody
 * needs. What is queued for it is at most WEB_QUEUE_HIGH and one message. While nobody listens no event is made,
 * and while nobody watches no tile is looked at.
 *
 * All on the loop's thread. live_new's caller owns it; sockets and requests stay http.c's.
 */
#ifndef AZULEJO_COORDINATOR_WEB_LIVE_H
#define AZULEJO_COORDINATOR_WEB_LIVE_H

#include "coordinator/net/guest.h"
#include "coordinator/web/request.h"

struct live;
struct job_event;

/* ERR_NO_MEMORY. */
status live_new(struct live **out, struct server *server, struct error *err) MUST_CHECK;
/* Close its handle; its clients are http.c's to close. */
void live_stop(struct live *live);
/* When the loop has ended; NULL is fine. */
void live_free(struct live *live);

/* The calls of guest.h. */
void live_job_changed(struct live *live, const struct job *job);
void live_job_removed(struct live *live, uint64_t job);
void live_workers_changed(struct live *live);
void live_job_event(struct live *live, const struct job_event *event);
void live_tick(struct live *live, uint64_t now_ns);

/* A WebSocket of /api/v1/live is open. */
void live_socket(struct live *live, struct web_socket *socket);
/* GET /api/v1/events: server-sent events. */
void live_stream(struct live *live, struct web_request *request);

#endif
