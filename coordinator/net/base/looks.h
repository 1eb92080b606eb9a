/* looks: a frame's picture tone mapped with other settings than its job's, so that people
 * can compare. Nothing is kept. */
#pragma once

#include "coordinator/job/queue.h"
#include "coordinator/net/base/transfer.h"

struct session;

/* Answer the request with a PNG of the frame, in work (`frame`) or done (NULL: from its stored picture). `shows`:
 * how complete a frame is that is done. ERR_LIMIT, ERR_NO_MEMORY; later failures are answered. */
status looks_ask(struct session *session, uint64_t request, const struct job *job, uint32_t number,
                 struct job_frame *frame, const struct output_settings *output, const struct transfer_preview *shows,
                 struct error *err) MUST_CHECK;
