/* watching: a frame's tiles for those who watch it, while it is rendered.
 *
 *   TilesWatch --> picture.h says which tile comes next --> linear.h --> Tiles --TilesTaken--> more
 *
 * A watcher is a session (coordinator/net/session/session.h) and is never waited for: at most WATCH_UNREAD_MAX bytes and
 * one message are on their way to it; then it misses older states of tiles, which are not needed. While no client
 * watches no tile is looked at.
 *
 * All on the loop's thread.
 */
#pragma once

#include "common/base/status.h"
#include "protocol/azulejo.pb-c.h"

struct server;
struct session;
struct watching;

enum { WATCH_UNREAD_MAX = 1 << 20 };

status watching_new(struct watching **out, struct server *server, struct error *err) MUST_CHECK;
/* Close its handle; watching has ended. */
void watching_stop(struct watching *all);
/* When the loop has ended; NULL is fine. */
void watching_free(struct watching *all);
/* A session's TilesWatch or TilesTaken. ERR_NO_MEMORY. */
status watching_message(struct watching *all, struct session *session, const Azulejo__Wire__Envelope *message,
                        struct error *err) MUST_CHECK;
void watching_session_gone(struct watching *all, const struct session *session);
