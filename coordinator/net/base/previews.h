/* previews: unfinished frames as pictures, for clients that ask, and kept ready for them
 * (coordinator/frame/preview.h). */
#pragma once

#include <stdint.h>

#include "coordinator/frame/preview.h"

struct job_frame;
struct server;
struct session;

/* Answer the request with the frame as it is, which has samples. */
void previews_ask(struct session *session, uint64_t request, struct job_frame *frame, enum preview_kind kind);
/* Make those again that are due. A few times a second. */
void previews_tick(struct server *server, uint64_t now_ns);
/* One that was made for this holder (holders.h; 0: none) is over. */
void previews_ended(struct server *server, uint64_t holder);
