/* farm_info: what the farm is, as a message. */
#pragma once

#include "common/base/status.h"
#include "common/schema/job_states.h"
#include "protocol/azulejo.pb-c.h"

struct server;

/* The message and what it points at; must not move once made. */
struct farm_info {
    Azulejo__Wire__FarmInfo message;
    Azulejo__Wire__FarmInfo__StatesEntry states[JOB_STATE_COUNT];
    Azulejo__Wire__FarmInfo__StatesEntry *state_pointers[JOB_STATE_COUNT];
    char address[96];
    struct error why;
};
void farm_info_make(struct farm_info *out, struct server *server, uint64_t now_ns);
