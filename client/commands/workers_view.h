/* workers_view: the farm's workers, for people and for programs. */
#ifndef AZULEJO_CLIENT_WORKERS_VIEW_H
#define AZULEJO_CLIENT_WORKERS_VIEW_H

#include "client/terminal/json.h"
#include "common/base/status.h"
#include "protocol/azulejo.pb-c.h"

/* "idle", "working", "paused", "draining", "drained", "blocked", "leaving"; "unknown" for anything else. */
const char *worker_state_name(Azulejo__Wire__WorkerState state);

/* The connected ones, and blocked names that are not. ERR_NO_MEMORY. */
status workers_print(const Azulejo__Wire__WorkerList *list, struct error *err) MUST_CHECK;
/* Those that left. ERR_NO_MEMORY. */
status workers_print_gone(const Azulejo__Wire__WorkerList *list, struct error *err) MUST_CHECK;
/* All that is known of one name. */
void workers_print_one(const Azulejo__Wire__WorkerList *list);

json_t *worker_json(const Azulejo__Wire__WorkerInfo *worker);
/* {"workers": [...]}, and "blocked" names, and with_gone those that left. */
json_t *workers_json(const Azulejo__Wire__WorkerList *list, int with_gone);

#endif
