/* verb: ask the coordinator to do something to a job (common/schema/verbs.h). */
#pragma once

#include "client/link/connection.h"
#include "client/terminal/frame_list.h"
#include "common/schema/verbs.h"

/* What it takes; a flag is set by its variant. */
struct verb_argument {
    int64_t number;
    const char *text;
    struct frame_list frames;
};

/* *out is a JobList with the job, which the caller frees. `argument` NULL: the verb takes none. job_ask's errors. */
status verb_ask(struct connection *c, uint64_t job, enum job_verb_name verb, const struct verb_argument *argument,
                Azulejo__Wire__Envelope **out, struct error *err) MUST_CHECK;
