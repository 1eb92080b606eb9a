/* farm_tasks: the tasks (task.h) that the farm asks for by its events. Each ends by a call of the
 * farm. `server` is the events' user. */
#pragma once

#include "common/base/status.h"
#include "coordinator/farm/farm.h"

struct server;

/* Make what was merged durable; one at a time (server->commit_running). */
void farm_task_commit(struct server *server);

/* As struct farm_events wants them. */
status farm_task_freeze(void *server, struct freezing *freezing, struct error *err);
status farm_task_develop(void *server, struct job_frame *frame);
status farm_task_measure(void *server, struct job_frame *frame);
status farm_task_redevelop(void *server, struct job *job, uint32_t frame);
