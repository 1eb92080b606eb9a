/* workers_list: what is known of the farm's workers, as a message (session_workers.c). */
#pragma once

#include <stdint.h>

#include "common/base/status.h"
#include "protocol/azulejo.pb-c.h"

struct server;

/* The list, while this runs. */
typedef void workers_use(void *user, Azulejo__Wire__WorkerList *list);

/* All that is known of the name; "": of all workers. `job`: only of those that render it; 0: of all. ERR_IO,
 * ERR_NO_MEMORY. */
status workers_list(struct server *server, const char *name, uint64_t job, int with_gone, workers_use *use, void *user,
                    uint64_t now_ns, struct error *err) MUST_CHECK;
