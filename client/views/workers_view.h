/* workers_view: the farm's workers, for people. */
#pragma once

#include "common/base/status.h"
#include "protocol/azulejo.pb-c.h"

/* "idle", "working", "paused", "draining", "drained", "blocked", "leaving"; "unknown" for anything else. */
const char *worker_state_name(Azulejo__Wire__WorkerState state);

/* The connected ones, and blocked names that are not. */
void workers_print(const Azulejo__Wire__WorkerList *list);
/* Those that left. */
void workers_print_gone(const Azulejo__Wire__WorkerList *list);
/* All that is known of one name. */
void workers_print_one(const Azulejo__Wire__WorkerList *list);
