/* session_tasks: the tasks (task.h) of sessions. Each answers its request with a message or a
 * Failure, unless the session has ended by then. */
#ifndef AZULEJO_COORDINATOR_SESSION_TASKS_H
#define AZULEJO_COORDINATOR_SESSION_TASKS_H

#include <stdint.h>

struct job;
struct session;
struct upload;

/* Store a complete upload. Takes it. */
void session_task_upload(struct session *session, uint64_t request, struct upload *upload);
/* Store a job and put it in the queue. Takes it. */
void session_task_submit(struct session *session, uint64_t request, struct job *job);

#endif
