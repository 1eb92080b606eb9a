/* steering: verbs as the coordinator gets them, with the table's checks. */
#pragma once

#include "common/schema/verbs.h"
#include "coordinator/steering/steer.h"

/* The verb or variant, with `number` as its argument: a priority, a frame, samples a pixel. */
status do_verb_with(struct farm *farm, struct job *job, enum job_verb_name verb, uint32_t number, const char *who,
                    uint64_t now_ns, struct error *err) MUST_CHECK;
status do_verb(struct farm *farm, struct job *job, enum job_verb_name verb, const char *who, uint64_t now_ns,
               struct error *err) MUST_CHECK;
