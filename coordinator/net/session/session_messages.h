/* session_messages: what clients ask for, a function a message.
 *
 * A handler answers `message` itself, now or through a task (session_tasks.h). When it fails it has
 * sent nothing: session_client.c sends *err as a Failure.
 */
#pragma once

#include "coordinator/net/session/session.h"

typedef status session_handler(struct session *session, const Azulejo__Wire__Envelope *message, uint64_t now_ns,
                               struct error *err);

/* session_reply.c: NULL and ERR_NOT_FOUND in *err if there is no such job. */
struct job *session_job(struct session *session, uint64_t id, struct error *err) MUST_CHECK;

/* session_client.c: answer a change of the job, which returned `s`, with its state once that is on disk (held.h). */
status session_answer_change(struct session *session, uint64_t request, const struct job *job, status s,
                             struct error *err) MUST_CHECK;

session_handler session_submit;     /* session_submit.c */
session_handler session_output_get; /* session_outputs.c */
session_handler session_history_get;
session_handler session_frame_tiles; /* session_tiles.c */
session_handler session_steer;       /* session_steer.c: every verb of verbs.h but remove */
session_handler session_remove;
session_handler session_log;
session_handler session_store;   /* collector.c */
session_handler session_farm;    /* farm_info.c */
session_handler session_trace;   /* session_trace.c */
session_handler session_workers; /* session_workers.c */
session_handler session_worker_steer;
session_handler session_worker_distrust;
session_handler session_blob_query; /* session_blobs.c */
session_handler session_blob_get;
session_handler session_blob_put;
/* session_blobs.c: blobs_find, and the blob stays until the session ends, if it is a client's. */
int session_blob_hold(struct session *session, const struct digest *digest, uint64_t *size_bytes);
/* session_submit.c: is the blob of the tone mapping's file there? */
status session_check_tonemap(struct session *session, const struct output_settings *output,
                             struct error *err) MUST_CHECK;

/* session_look.c: the job's settings with what the request wants otherwise. ERR_INPUT. */
status session_look(struct output_settings *output, const Azulejo__Wire__OutputGet *asked,
                    struct error *err) MUST_CHECK;
