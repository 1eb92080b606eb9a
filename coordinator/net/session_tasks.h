/* session_tasks: the tasks (task.h) of sessions. Each answers its request with a message or a
 * Failure, unless the session has ended by then. */
#ifndef AZULEJO_COORDINATOR_SESSION_TASKS_H
#define AZULEJO_COORDINATOR_SESSION_TASKS_H

#include <stdint.h>

#include "common/base/digest.h"

struct job;
struct session;
struct upload;

/* Send the file, unless its digest is `have`: then say that it is unchanged. */
void session_task_output(struct session *session, uint64_t request, const char *path,
                         const struct digest *have);
/* Store a complete upload. Takes it. */
void session_task_upload(struct session *session, uint64_t request, struct upload *upload);
/* Store a job and put it in the queue. Takes it. `force`: also if it does not fit the disk. */
void session_task_submit(struct session *session, uint64_t request, struct job *job, int force);

#endif
