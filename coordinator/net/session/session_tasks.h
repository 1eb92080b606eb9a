/* session_tasks: the tasks (task.h) of sessions. Each answers its request with a message or a
 * Failure, unless the session has ended by then. */
#pragma once

#include <stdint.h>

#include "common/base/digest.h"
#include "coordinator/net/base/transfer.h"

struct job;
struct session;
struct upload;

/* A file of a frame's. */
struct output_asked {
    uint64_t job;
    uint32_t frame;
    char extension[32];
    int has, is_preview;
    struct digest have;            /* of the file that the client has, if `has` */
    struct transfer_preview shows; /* if it is sent as a preview */
};
/* Send the file, unless its digest is `have`: then say that it is unchanged. A damaged one fails (store_output_check). */
void session_task_output(struct session *session, uint64_t request, const char *path, const struct output_asked *asked);
/* Answer which of the blobs are missing or damaged (blobs_vouch). Takes `digests`, plain memory. */
void session_task_vouch(struct session *session, uint64_t request, struct digest *digests, size_t count);
/* Store a complete upload. Takes it. */
void session_task_upload(struct session *session, uint64_t request, struct upload *upload);
/* Store a job, which needs these blobs, and put it in the queue. Takes both. `force`: also if it does not fit the disk. */
void session_task_submit(struct session *session, uint64_t request, struct job *job, struct digest *blobs,
                         size_t blob_count, int force);
